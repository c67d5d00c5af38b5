//! Tests of degenerate image sizes, boxes that the scan does not fill, and masks.

use glam::DVec3;

use mask::Mask;
use reconstruct::{Reconstructor, Settings, SettingsError};
use sonoweave_core::region::Fan;

use crate::figures::{Sheet, Test};
use crate::insertion::{METHODS, Probe, compare, constant, half_mm, noise, off_constant, turned};
use crate::place::Place;
use crate::sequence::{Sequence, pose};

pub(crate) fn tests() -> Vec<Test> {
    vec![
        Test::new("17", "pictures of 1×1, 1×N and N×1 pixels: the voxels and values of the equations", degenerate),
        Test::new(
            "17",
            "a box that the slices miss is unseen, one that they meet in part is the whole volume's part",
            boxes,
        ),
        Test::new("18", "an empty mask is refused before there is a state", empty_mask),
        Test::new("18", "constant in a fan: within 4·2⁻²³ c up to the border, nothing beyond", fan),
    ]
}

fn degenerate(sheet: &mut Sheet) {
    for size in [[1, 1], [1, 37], [37, 1], [2, 1]] {
        for (name, axes) in [("straight", turned(0.0, 0.0, 0.0)), ("oblique", turned(0.7, -0.4, 0.3))] {
            // Pixels coarser and finer than voxels.
            for pixel_mm in [1.3, 0.2] {
                let probe = Probe { axes, centre: DVec3::new(0.11, -0.07, 0.05), ..Probe::straight(size, pixel_mm) };
                let slice = probe.put(&noise(size, 9), 0.0);
                // σ of at least a pixel: at most 0.4 of the kernel lies on a line of pixels.
                let sigma = 0.75 * pixel_mm;
                let settings = Settings { sigma_mm: [Some(sigma), Some(sigma), None], ..half_mm() };
                let settings = Settings { spacing_mm: DVec3::splat(0.25 * pixel_mm), ..settings };
                let mut r = Reconstructor::new(settings, probe.mask()).unwrap();
                r.insert(&slice).unwrap();
                let c = compare(&r, &slice, &probe.mask(), 1e-5);
                let what = format!("{}×{} pixels of {pixel_mm} mm, {name}", size[0], size[1]);
                sheet.above(&format!("{what}: voxels"), c.both as f64, 0.0);
                sheet.equal(&format!("{what}: missing and surplus"), (c.missing, c.surplus), (0, 0));
                let limit = 5.0 * 2.0 * r.decimation().unwrap().1 * 255.0;
                sheet.at_most(&format!("{what}: largest difference"), c.worst, limit);
            }
        }
    }
}

fn boxes(sheet: &mut Sheet) {
    let place = Place::new();
    place.put("s.mha", Sequence { pose: |frame| pose(0.5 * f64::from(frame)), ..Sequence::default() }.bytes());
    let run = |words: &str| {
        let run = place.run(&format!("reconstruct s.mha --clip none --type f32 --weights w.mha {words}"));
        assert_eq!(run.code, 0, "{words}: {}", run.stderr);
        (place.volume("v.mha").values, place.volume("w.mha").values)
    };
    // Slices start at the world's origin; the whole volume is a box that holds them.
    let (whole, weights) = run("-o v.mha --origin -10,-10,-10 --size 80,80,60");
    sheet.above("voxels seen in the whole box", weights.iter().filter(|w| **w > 0.0).count() as f64, 10_000.0);
    let (values, far) = run("-o v.mha --origin 1000,1000,1000 --size 20,20,20");
    sheet.equal(
        "a box a metre away: voxels of any value or weight",
        values.iter().chain(&far).filter(|x| **x != 0.0).count(),
        0,
    );
    // Starts 40, 30, 20 voxels further, and ends beyond the whole box.
    let (part, part_weights) = run("-o v.mha --origin 10,5,0 --size 60,70,50");
    let (mut differ, mut inside) = (0, 0);
    for (i, (value, weight)) in part.iter().zip(&part_weights).enumerate() {
        let [x, y, z] = [i % 60 + 40, i / 60 % 70 + 30, i / (60 * 70) + 20];
        let (expected, expected_weight) = if x < 80 && y < 80 && z < 60 {
            let at = (z * 80 + y) * 80 + x;
            (whole[at], weights[at])
        } else {
            (0.0, 0.0)
        };
        inside += usize::from(expected_weight > 0.0);
        differ += usize::from(value.to_bits() != expected.to_bits() || weight.to_bits() != expected_weight.to_bits());
    }
    sheet.above("a box half outside: voxels seen", f64::from(u32::try_from(inside).unwrap()), 1_000.0);
    sheet.equal("a box half outside: voxels that differ from the whole's", differ, 0);
}

fn empty_mask(sheet: &mut Sheet) {
    let nothing = Mask::from_fn(20, 20, |_, _| false);
    let refused = Reconstructor::new(half_mm(), nothing).err();
    sheet.equal("reconstructor of an empty mask", refused, Some(SettingsError::EmptyMask));
    let place = Place::new();
    place.put("s.mha", Sequence::default().bytes());
    let run = place.run("reconstruct s.mha -o v.mha --clip 100,100,5,5");
    sheet.equal("the program's exit code", run.code, 4);
    sheet.equal("files it left", place.names().len(), 1);
}

/// Ten slices overlap in a voxel here, and each can add the rounding of a sum. The bound is in
/// units of 2⁻²³, an ulp at the low end of its binade. Counted in ulp of the constant, 255 (at
/// the high end) would be 4.8 off and 0.1 as much as 4.1.
fn fan(sheet: &mut Sheet) {
    let size = [72, 60];
    let fan = Mask::fan(72, 60, &Fan::new([36.0, -20.0], [25.0, 76.0], [-25.0, 25.0]).unwrap());
    for (method, (grey, name)) in
        METHODS.into_iter().flat_map(|m| [(77.3_f32, "77.3"), (0.1, "0.1"), (255.0, "255")].map(|grey| (m, grey)))
    {
        let mut r = Reconstructor::new(Settings { method, ..half_mm() }, fan.clone()).unwrap();
        let probe = Probe::oblique(size, 0.25);
        for i in 0..10_u8 {
            // Pixels outside the data must not matter, whatever their value.
            let picture =
                crate::insertion::image(size, |u, v| if fan.contains(u, v) { grey } else { f32::from(i) * 1e6 });
            r.insert(&probe.put(&picture, 0.3 * f64::from(i))).unwrap();
        }
        let (worst, seen) = off_constant(&r, grey);
        sheet.above(&format!("{}, grey {name}: voxels seen", method.name()), seen as f64, 5_000.0);
        sheet.at_most(
            &format!("{}, grey {name}: largest |r/w − c| / c in 2⁻²³", method.name()),
            worst / f64::from(f32::EPSILON),
            4.0,
        );
        let last = probe.put(&constant(size, grey), 2.7);
        let c = compare(&crate::insertion::reconstruct_all(half_mm(), &fan, [&last]), &last, &fan, 1e-5);
        sheet.equal(&format!("grey {name}: one slice's voxels, missing and surplus"), (c.missing, c.surplus), (0, 0));
    }
}
