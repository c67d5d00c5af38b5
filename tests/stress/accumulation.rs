//! Tests with very many slices over the same voxels: accuracy of the value, and its ability to
//! move.

use reconstruct::settings::MOST_WEIGHT;
use reconstruct::{Reconstructor, Settings, SettingsError};
use sonoweave_core::frames::Transform;
use sonoweave_core::slice::{Image, Slice};
use volume::Voxels;

use crate::figures::{Length, Sheet, Test};
use crate::insertion::{Probe, constant, half_mm, off_constant, reconstruct_all, seen};

/// A value with a full mantissa.
const CONSTANT: f32 = 77.3;

pub(crate) fn tests(length: Length) -> Vec<Test> {
    let slices = length.of("2·10⁴", "10⁶");
    let unclamped = length.of("7e-6", "3e-4");
    vec![
        Test::new(
            "01",
            format!("constant phantom, {slices} slices, default W_max: |r/w − c| ≤ 1e-5 c"),
            clamped_constant,
        ),
        Test::new(
            "01",
            format!(
                "the same, parked: ≤ 1e-5 c where a slice weighs 0.3 and more, 2⁻²⁵ W_max/g elsewhere ({slices} slices)"
            ),
            parked_constant,
        ),
        Test::new(
            "01",
            format!("constant phantom, {slices} slices, no clamp: |r/w − c| ≤ {unclamped} c (rms)"),
            free_constant,
        ),
        Test::new(
            "02",
            format!(
                "W_max up to {}: the clamp acts, the mean is right to 2⁻²⁵ W_max and moves; beyond 10⁶ refused",
                length.of("10⁴", "10⁶")
            ),
            saturation,
        ),
        Test::new("03", "dwell on a step: 99 % after 4.6 W_max/g frames; without clamp the old content stays", step),
    ]
}

/// Small images oblique to the lattice: all weights from none to the peak occur.
fn probe() -> Probe {
    Probe::oblique([6, 6], 0.5)
}

/// Returns the slice shifted minutely along its normal, so that it does not count as repeated.
fn nudged(slice: &Slice, i: u32) -> Slice {
    let mut pose = slice.world_from_image.affine();
    pose.translation += pose.matrix3.z_axis * (1e-5 * f64::from(i % 16));
    Slice { world_from_image: Transform::from_affine(pose), ..slice.clone() }
}

/// Trembling of the operator's hand by millimetres: no two weights of a voxel are alike.
fn trembling(picture: &Image, i: u32) -> Slice {
    let x = f64::from(i.wrapping_mul(2_654_435_761) >> 8) / f64::from(1 << 24) - 0.5;
    probe().put(picture, 4.0 * x)
}

/// Inserts the same image again and again.
fn dwell(reconstructor: &mut Reconstructor, slice: &Slice, times: u32) {
    for i in 0..times {
        reconstructor.insert(&nudged(slice, i)).unwrap();
    }
}

/// Inserts ten thousand slices or more of a constant, placed by `slice`.
fn constants(sheet: &Sheet, settings: Settings, slice: impl Fn(u32) -> Slice) -> Reconstructor {
    let mut r = Reconstructor::new(settings, probe().mask()).unwrap();
    for i in 0..sheet.length.of(20_000, 1_000_000) {
        r.insert(&slice(i)).unwrap();
    }
    r
}

fn clamped_constant(sheet: &mut Sheet) {
    let picture = constant(probe().size, CONSTANT);
    let r = constants(sheet, half_mm(), |i| trembling(&picture, i));
    let (worst, seen) = off_constant(&r, CONSTANT);
    sheet.above("voxels seen", seen as f64, 100.0);
    sheet.above("weights clamped", r.work().weights_clamped as f64, 0.0);
    sheet.at_most("largest |r/w − c| / c", worst, 1e-5);
}

/// In an f32 sum, adding the same number again and again makes the same error each time until
/// the sum has doubled: up to half an ulp of the sum. In relative terms, W_max/g additions give
/// 2⁻²⁵ W_max/g. Trembling of the hand makes the errors random; a resting arm does not.
fn parked_constant(sheet: &mut Sheet) {
    let slice = probe().put(&constant(probe().size, CONSTANT), 0.0);
    let r = constants(sheet, half_mm(), |i| nudged(&slice, i));
    let once = reconstruct_all(half_mm(), &probe().mask(), [&slice]);
    let peak = r.kernels().unwrap()[2].peak();
    let (mut heavy, mut any) = (0.0_f64, 0.0_f64);
    for voxel in seen(&r) {
        let share = f64::from(once.volume().voxel(voxel.index).1) / peak;
        let off = (voxel.value / f64::from(CONSTANT) - 1.0).abs();
        heavy = heavy.max(if share >= 0.3 { off } else { 0.0 });
        any = any.max(off * share);
    }
    sheet.above("weights clamped", r.work().weights_clamped as f64, 0.0);
    sheet.at_most("largest |r/w − c| / c where a slice weighs 0.3 and more", heavy, 1e-5);
    sheet.at_most("largest |r/w − c| / c times what a slice weighs", any, 256.0 * 2.0_f64.powi(-25));
}

/// The root mean square stays within 3e-4, the measured loss of 10⁶ sums of one voxel. The
/// worst voxel was measured 1.1e-3 off: at the ends of the kernel a sum of 5·10⁵ drops summands
/// below 0.03. This is the reason for a largest weight.
fn free_constant(sheet: &mut Sheet) {
    let picture = constant(probe().size, CONSTANT);
    let r = constants(sheet, Settings { max_weight: MOST_WEIGHT, ..half_mm() }, |i| trembling(&picture, i));
    sheet.equal("weights clamped", r.work().weights_clamped, 0);
    let off = seen(&r).iter().map(|voxel| (voxel.value / f64::from(CONSTANT) - 1.0).powi(2)).sum::<f64>();
    let rms = (off / seen(&r).len() as f64).sqrt();
    sheet.at_most("root mean square of |r/w − c| / c", rms, sheet.length.of(7e-6, 3e-4));
    sheet.at_most("largest |r/w − c| / c", off_constant(&r, CONSTANT).0, sheet.length.of(3e-5, 2e-3));
}

/// Value at the world's origin, in the middle of the image and in its plane.
fn middle(reconstructor: &Reconstructor) -> f64 {
    let (r, w) = reconstructor.volume().voxel([0; 3]);
    f64::from(r) / f64::from(w)
}

/// Each sum may err by half an ulp, always in the same direction if an arm rests, and a slice
/// moves the mean by g/W. The mean is thus off by at most 2⁻²⁵ W/g, 3 % at 10⁶. At 2²⁴, f32
/// adds no more ones: the mean of 18.5·10⁶ parked tens was measured to be 8.6. Hence the limit.
fn saturation(sheet: &mut Sheet) {
    let probe = Probe::straight([3, 3], 0.5);
    let widest: &[f64] = sheet.length.of(&[1e3, 1e4], &[1e3, 1e4, 1e5, MOST_WEIGHT]);
    for most in widest.iter().copied() {
        let settings = Settings { max_weight: most, ..half_mm() };
        let mut r = Reconstructor::new(settings, probe.mask()).unwrap();
        dwell(&mut r, &probe.put(&constant([3, 3], 77.3), 0.0), 3 * most as u32);
        let peak = r.kernels().unwrap()[2].peak();
        // A slice's weight as a fraction of the peak: not all of the in-plane kernel lies on
        // 3×3 pixels.
        let once = reconstruct_all(half_mm(), &probe.mask(), [&probe.put(&constant([3, 3], 1.0), 0.0)]);
        let share = f64::from(once.volume().voxel([0; 3]).1) / peak;
        let what = format!("W_max = {most:e}");
        sheet.above(&format!("{what}: weights clamped"), r.work().weights_clamped as f64, 0.0);
        sheet.near(&format!("{what}: weight / W_max"), f64::from(r.volume().voxel([0; 3]).1) / most, peak, 1e-6);
        let before = middle(&r);
        let off = (before / 77.3 - 1.0).abs();
        sheet.at_most(&format!("{what}: mean of 3 W_max parked slices, off by"), off, 2.0_f64.powi(-25) * most + 1e-6);
        let frames = most as u32 / 10;
        dwell(&mut r, &probe.put(&constant([3, 3], 200.0), 0.0), frames);
        let expected = (200.0 - before) * (1.0 - (-0.1 * share).exp());
        sheet.near(
            &format!("{what}: grey levels that W_max/10 brighter slices moved it"),
            middle(&r) - before,
            expected,
            0.05 * expected,
        );
    }
    let refused = Reconstructor::new(Settings { max_weight: 1.001 * MOST_WEIGHT, ..half_mm() }, probe.mask()).err();
    sheet.equal("a largest weight beyond the limit", refused, Some(SettingsError::MaxWeight(1.001 * MOST_WEIGHT)));
}

fn step(sheet: &mut Sheet) {
    let probe = Probe::straight([9, 9], 0.5);
    let [dark, bright] = [10.0, 200.0].map(|grey| probe.put(&constant([9, 9], grey), 0.0));
    let frames = sheet.length.of(4_000, 100_000);
    let mut r = Reconstructor::new(half_mm(), probe.mask()).unwrap();
    dwell(&mut r, &dark, frames);
    let mut count = 0;
    while middle(&r) < 10.0 + 0.99 * 190.0 && count < 100_000 {
        r.insert(&nudged(&bright, count)).unwrap();
        count += 1;
    }
    // Each slice enters with g of the clamp's W_max·peak; g is the peak here.
    let expected = 100.0_f64.ln() * 256.0;
    sheet.near("slices to 99 % of the step, W_max = 256", f64::from(count), expected, 0.01 * expected);

    let mut free = Reconstructor::new(Settings { max_weight: MOST_WEIGHT, ..half_mm() }, probe.mask()).unwrap();
    dwell(&mut free, &dark, frames);
    dwell(&mut free, &bright, frames);
    // All older slices count for ever; if parked, every sum may round in the same direction.
    let rounding = 105.0 * 2.0 * f64::from(frames) * 2.0_f64.powi(-24);
    sheet.near("without clamp, after as many bright as dark: the mean", middle(&free), 105.0, rounding);
}
