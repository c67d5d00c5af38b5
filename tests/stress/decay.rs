//! Tests of decay on both paths: irregular times, the shift of a sweep, and values of later
//! visits.

use std::time::Instant;

use reconstruct::kernel::Method;
use reconstruct::planar::{OnDeparture, PlanarReconstructor};
use reconstruct::{Compounding, Decay, Path, PathReconstructor, Reconstructor, Settings};
use sonoweave_core::slice::Slice;
use volume::Voxels;

use crate::figures::{Sheet, Test};
use crate::insertion::{PATHS, Probe, constant, half_mm, held, on_the_world_s_axes, reconstructor};

const SECOND: f64 = 1e9;

const MODES: [Decay; 3] = [
    Decay::Exponential { rate_per_s: 0.7 },
    Decay::DeadTime { rate_per_s: 0.7, wait_s: 0.5 },
    Decay::PaperLiteral { rate_per_s: 0.7, wait_s: 0.25 },
];

const SLOW: [Decay; 2] = [Decay::Exponential { rate_per_s: 1e-6 }, Decay::DeadTime { rate_per_s: 1e-6, wait_s: 0.5 }];

pub(crate) fn tests() -> Vec<Test> {
    vec![
        Test::new(
            "22",
            "decay, both paths: times alike, backwards, 10⁹ s on, a clock set back: d as the steps say, in [0, 1]; counted",
            steps_of_time,
        ),
        Test::new("22", "every decay, both paths: no time amplifies a weight or moves a constant", absurd_times),
        Test::new(
            "23",
            "exp decay over 1 to 1000 touches: one exp within 1e-5; planar within n·2⁻²³, its factor's own rounding",
            composed,
        ),
        Test::new("23", "exp decay while parked: old content e^(−a·t) of what there is, within 1e-4", parked),
        Test::new(
            "23",
            "black after bright, faded or clamped: no value kept is subnormal, nothing is left; the time of an insert is recorded",
            subnormals,
        ),
        Test::new("24", "exp decay at rate a and speed v: shift a·σ²/v ± 20 %", exponential_shift),
        Test::new("24", "dead-time decay, T = 2d/v: |shift| < 0.02 σ at every rate", dead_time_shift),
        Test::new("24", "paper-literal decay: about −2 σ, the first sample stays", literal_shift),
        Test::new("25", "the base of forward decay moves: every ratio unchanged to 1e-6, after pauses too", rebased),
        Test::new("26", "out and back, the object changed between: old content < e^(−a(dt − T))", out_and_back),
        Test::new("26", "touches below the least refresh no age, nor does what happens beside", faint_touches),
    ]
}

fn decaying(decay: Decay) -> Settings {
    Settings { compounding: Compounding::Decay(decay), max_weight: 1e4, ..half_mm() }
}

fn probe() -> Probe {
    Probe::arm([9, 9], 0.5)
}

/// A slice of one grey level; `turn` moves it minutely, so that it never repeats.
fn touch(grey: f32, seconds: f64, along: f64, turn: u32) -> Slice {
    let slice = probe().put(&constant(probe().size, grey), along + 1e-9 * f64::from(turn % 16));
    Slice { time_ns: (seconds * SECOND).round() as i64, ..slice }
}

fn middle(reconstructor: &PathReconstructor) -> (f64, f64) {
    let (r, w) = reconstructor.volume().voxel([0; 3]);
    (f64::from(r), f64::from(w))
}

fn value(reconstructor: &PathReconstructor, y: i64) -> f64 {
    let (r, w) = reconstructor.volume().voxel([0, y, 0]);
    f64::from(r) / f64::from(w)
}

fn name(path: Path, decay: Decay) -> String {
    format!("{}, {}", path.name(), decay.name())
}

fn steps_of_time(sheet: &mut Sheet) {
    // The time, s, and the elapsed seconds it implies: at least none, at most a day.
    let day = 86_400.0;
    let steps = [
        (100.0, 0.0),
        (100.0, 0.0),
        (99.0, 0.0),
        (101.0, 1.0),
        (101.0, 0.0),
        (1e9, day),
        (1e9 + 2.0, 2.0),
        // The clock was set back: time continues from there.
        (3.0, 0.0),
        (4.0, 1.0),
        (3.9, 0.0),
        (5.0, 1.0),
        (-9e9, 0.0),
        (9e9, day),
        (9e9 + 0.75, 0.75),
    ];
    for path in PATHS {
        // At slow rates a day still counts: d is then 0.92, and would be 0 after 10⁹ s.
        for decay in [MODES[0], MODES[1], SLOW[0], SLOW[1]] {
            let what = format!("{}, a = {}/s", name(path, decay), decay.rate_per_s());
            let mut r = reconstructor(path, decaying(decay), probe().mask());
            r.insert(&touch(100.0, 100.0, 0.0, 20)).unwrap();
            let (mut off_factor, mut least, mut most) = (0.0_f64, f64::MAX, 0.0_f64);
            let once = middle(&r).1;
            for ((time, passed), turn) in steps.into_iter().zip(0..) {
                let before = middle(&r).1;
                r.insert(&touch(100.0, time, 0.0, turn)).unwrap();
                let factor = (middle(&r).1 - once) / before;
                off_factor = off_factor.max((factor - decay.factor(passed)).abs());
                (least, most) = (least.min(factor), most.max(factor));
            }
            sheet.at_most(&format!("{what}: d against the step's"), off_factor, 1e-3);
            sheet.at_most(&format!("{what}: largest d − 1"), most - 1.0, 1e-6);
            sheet.at_most(&format!("{what}: least d below 0 by"), -least, 1e-6);
            let off = held(r.volume()).iter().map(|(_, r, w)| (r / w / 100.0 - 1.0).abs()).fold(0.0, f32::max);
            sheet.at_most(&format!("{what}: a constant off by, relative"), f64::from(off), 1e-5);
            let counted = (r.work().times_backwards, r.work().times_absurd);
            sheet.equal(&format!("{what}: counted as backwards, as absurd"), counted, (4, 4));
        }
    }
}

fn absurd_times(sheet: &mut Sheet) {
    let second = SECOND as i64;
    let mut times = vec![0, 0, -second, 5, i64::MAX, i64::MIN, 0, 1_763_700_000 * second, 3, i64::MAX - 1];
    times.extend((0..20).map(|k| (k * 7919 % 13) * second / 10));
    for path in PATHS {
        for decay in MODES {
            let mut r = reconstructor(path, decaying(decay), probe().mask());
            let (mut off, mut most) = (0.0_f32, 0.0_f64);
            for (time, turn) in times.iter().zip(0..) {
                r.insert(&Slice { time_ns: *time, ..touch(100.0, 0.0, 0.0, turn) }).unwrap();
                let held = held(r.volume());
                off = held.iter().map(|(_, r, w)| (r / w / 100.0 - 1.0).abs()).fold(off, f32::max);
                most = most.max(middle(&r).1 / f64::from(turn + 1));
            }
            let what = name(path, decay);
            sheet.at_most(&format!("{what}: a constant off by, relative"), f64::from(off), 1e-5);
            sheet.at_most(&format!("{what}: largest weight / slices"), most, 1.0 + 1e-6);
            sheet.above(&format!("{what}: counted as backwards"), r.work().times_backwards as f64, 7.0);
            sheet.above(&format!("{what}: counted as absurd"), r.work().times_absurd as f64, 3.0);
        }
    }
}

/// Black adds nothing to the numerator: it remains the first slice's, times all factors.
fn composed(sheet: &mut Sheet) {
    let (rate_per_s, span_s) = (0.9, 10.0);
    for path in PATHS {
        for touches in [1_u32, 2, 10, 300, 1000] {
            let mut r = reconstructor(path, decaying(Decay::Exponential { rate_per_s }), probe().mask());
            r.insert(&touch(200.0, 0.0, 0.0, 0)).unwrap();
            let before = middle(&r).0;
            for k in 1..=touches {
                r.insert(&touch(0.0, span_s * f64::from(k) / f64::from(touches), 0.0, k)).unwrap();
            }
            let off = (middle(&r).0 / before / (-rate_per_s * span_s).exp() - 1.0).abs();
            // The general path counts from its brick's base. The planar one multiplies, each
            // time by a factor rounded to f32 and with one rounding more.
            let limit = match path {
                Path::General => 1e-5,
                Path::Planar => 1e-6 + f64::from(touches) * 2.0_f64.powi(-23),
            };
            sheet.at_most(&format!("{}: {touches} touches, relative error", path.name()), off, limit);
        }
    }
}

/// The weights settle at those of a hundred slices. This is below the clamp, which must follow
/// the growing units of forward decay.
fn parked(sheet: &mut Sheet) {
    let (rate_per_s, step_s) = (0.3, 1.0 / 30.0);
    for path in PATHS {
        let settings = Settings { max_weight: 256.0, ..decaying(Decay::Exponential { rate_per_s }) };
        let mut r = reconstructor(path, settings, probe().mask());
        // 4000 slices are e⁴⁰: the base moves meanwhile.
        for k in 0..4200_u32 {
            r.insert(&touch(10.0, step_s * f64::from(k), 0.0, k)).unwrap();
        }
        for k in 4200..4300_u32 {
            r.insert(&touch(200.0, step_s * f64::from(k), 0.0, k)).unwrap();
        }
        let old = (200.0 - value(&r, 0)) / 190.0;
        let what = path.name();
        sheet.near(&format!("{what}: old content after 100 slices"), old, (-rate_per_s * 100.0 * step_s).exp(), 1e-4);
        sheet.equal(&format!("{what}: weights clamped"), r.work().weights_clamped, 0);
    }
}

/// Number of subnormal values in a volume.
fn subnormal(way: &Way) -> usize {
    let count = |values: &[f32]| values.iter().filter(|x| x.is_subnormal()).count();
    match way {
        Way::General(r) => r.volume().iter().map(|(_, brick)| count(&brick.r) + count(&brick.w)).sum(),
        Way::Planar(r) => held(r.volume()).iter().map(|(_, r, w)| count(&[*r, *w])).sum(),
    }
}

enum Way {
    General(Box<Reconstructor>),
    Planar(Box<PlanarReconstructor>),
}

impl Way {
    fn insert(&mut self, slice: &Slice) {
        match self {
            Self::General(r) => r.insert(slice).unwrap(),
            Self::Planar(r) => r.insert(slice).unwrap(),
        };
    }

    fn numerator(&self) -> f32 {
        match self {
            Self::General(r) => r.volume().voxel([0; 3]).0,
            Self::Planar(r) => r.volume().voxel([0; 3]).0,
        }
    }
}

/// Bright, then black until the numerators have fallen through the whole range of f32: slowly,
/// in large steps, and where the clamp fades older values.
fn subnormals(sheet: &mut Sheet) {
    let no_wait = Decay::DeadTime { rate_per_s: 0.7, wait_s: 0.0 };
    let mean = (Compounding::Mean, 8.0, 0.2);
    // In steps of 34.3 s, forward decay's base moves by 48, and bright values become subnormal
    // the second time.
    let cases = MODES.into_iter().chain([no_wait]).flat_map(|decay| {
        [0.2, 34.3].map(|step_s| (Compounding::Decay(decay), 1e4, step_s)).into_iter().filter(move |(_, _, step_s)| {
            // Nothing fades within the wait.
            *step_s > decay.wait_s()
        })
    });
    for (compounding, max_weight, step_s) in cases.chain([mean]) {
        for path in PATHS {
            let settings = Settings { compounding, max_weight, ..half_mm() };
            let mut r = match path {
                Path::General => Way::General(Box::new(Reconstructor::new(settings, probe().mask()).unwrap())),
                Path::Planar => {
                    let planar = on_the_world_s_axes(OnDeparture::Refuse);
                    Way::Planar(Box::new(PlanarReconstructor::new(settings, planar, probe().mask()).unwrap()))
                }
            };
            r.insert(&touch(200.0, 0.0, 0.0, 0));
            let (mut found, mut times) = (0, Vec::new());
            for k in 1..=1200_u32 {
                let slice = touch(0.0, step_s * f64::from(k), 0.0, k);
                let began = Instant::now();
                r.insert(&slice);
                times.push(began.elapsed().as_secs_f64());
                found += if k % 5 == 0 { subnormal(&r) } else { 0 };
            }
            let what = format!("{}, {compounding}, {step_s} s apart", path.name());
            sheet.equal(&format!("{what}: subnormal values"), found, 0);
            sheet.equal(&format!("{what}: what is left of the brightness"), r.numerator(), 0.0);
            let median = |times: &[f64]| {
                let mut times = times.to_vec();
                times.sort_by(f64::total_cmp);
                times[times.len() / 2]
            };
            let slower = median(&times[1000..]) / median(&times[..50]);
            sheet.record(&format!("{what}: time of the last inserts / of the first"), format!("{slower:.2}"));
        }
    }
}

/// Returns the mean shift of a ramp along a sweep, as a distance along the sweep in σ (1 mm),
/// and the kernel's effective σ, mm.
fn shift(path: Path, method: Method, decay: Decay, speed_mm_s: f64) -> (f64, f64) {
    let settings = Settings { method, max_weight: 256.0, ..decaying(decay) };
    let mut r = reconstructor(path, settings, probe().mask());
    for i in -100..=100 {
        let along = 0.1 * f64::from(i);
        r.insert(&touch((128.0 + 2.0 * along) as f32, along / speed_mm_s, along, 0)).unwrap();
    }
    let planes = -8..=8_i64;
    let count = planes.clone().count() as f64;
    let mean = planes.map(|y| (value(&r, y) - 128.0) / 2.0 - 0.5 * y as f64).sum::<f64>() / count;
    (mean, r.kernels().unwrap()[2].sigma_effective_mm())
}

fn exponential_shift(sheet: &mut Sheet) {
    for path in PATHS {
        for method in [Method::Gaussian, Method::GaussianTruncated, Method::BSpline3] {
            for (rate_per_s, speed) in [(1.0, 10.0), (3.0, 10.0), (1.0, 2.5), (10.0, 25.0), (0.1, 1.0)] {
                let (found, sigma) = shift(path, method, Decay::Exponential { rate_per_s }, speed);
                let expected = rate_per_s * sigma * sigma / speed;
                let what = format!("{}, {}, a = {rate_per_s}/s, v = {speed} mm/s", path.name(), method.name());
                sheet.near(&format!("{what}: shift / σ"), found, expected, 0.2 * expected);
            }
        }
    }
}

fn dead_time_shift(sheet: &mut Sheet) {
    for path in PATHS {
        for (rate_per_s, speed) in [(1.0, 10.0), (10.0, 10.0), (100.0, 10.0), (1000.0, 40.0), (3.0, 1.0)] {
            // A support of 2.5758 σ passes in 2d/v.
            let decay = Decay::DeadTime { rate_per_s, wait_s: 2.0 * 2.576 / speed };
            let (found, _) = shift(path, Method::GaussianTruncated, decay, speed);
            let what = format!("{}, a = {rate_per_s}/s, v = {speed} mm/s", path.name());
            sheet.at_most(&format!("{what}: |shift| / σ"), found.abs(), 0.02);
            // Age counts from the last touch: the wait must exceed the time between slices, 0.1
            // mm apart; 2d/v is more than enough.
            for (slices, shifts) in [(2.0, false), (0.5, true)] {
                let short = Decay::DeadTime { rate_per_s: 10.0 * speed, wait_s: slices * 0.1 / speed };
                let (found, _) = shift(path, Method::GaussianTruncated, short, speed);
                let what = format!("{what}, T of {slices} slices at {}/s: |shift| / σ", 10.0 * speed);
                match shifts {
                    true => sheet.above(&what, found.abs(), 0.1),
                    false => sheet.at_most(&what, found.abs(), 0.02),
                }
            }
        }
    }
}

fn literal_shift(sheet: &mut Sheet) {
    for path in PATHS {
        let decay = Decay::PaperLiteral { rate_per_s: 0.01, wait_s: 0.0 };
        let (found, _) = shift(path, Method::GaussianTruncated, decay, 10.0);
        sheet.near(&format!("{}, a = 0.01/s, v = 10 mm/s: shift / σ", path.name()), found, -2.15, 0.35);
    }
}

/// Bricks of 4 mm: planes 0 to 7 lie in one. Only the first slice reaches plane 1; those at 3.5
/// mm reach down to plane 2.
fn rebased(sheet: &mut Sheet) {
    for path in PATHS {
        let mut r = reconstructor(path, decaying(Decay::Exponential { rate_per_s: 1.0 }), probe().mask());
        r.insert(&touch(171.3, 0.0, 0.0, 0)).unwrap();
        // Every second; then up to the base's limit of 40, beyond it, and after pauses that
        // leave nothing.
        let times = (1..=100).map(f64::from).chain([140.0, 180.0, 220.001, 221.0, 1300.0, 1301.0, 9e4]);
        let (mut low, mut high) = (0.0_f64, 0.0_f64);
        for (time, k) in times.zip(1..) {
            r.insert(&touch(40.7, time, 3.5, k)).unwrap();
            let off = |y, grey: f32| (value(&r, y) / f64::from(grey) - 1.0).abs();
            // NaN is a failure.
            low = if off(1, 171.3) <= low { low } else { off(1, 171.3) };
            high = if off(7, 40.7) <= high { high } else { off(7, 40.7) };
        }
        sheet.at_most(&format!("{}: what was touched once, relative", path.name()), low, 1e-6);
        sheet.at_most(&format!("{}: what was touched each time, relative", path.name()), high, 1e-6);
        // The old content is not heavier afterwards: one slice replaces it.
        r.insert(&touch(0.0, 9e4, 0.0, 0)).unwrap();
        sheet.at_most(&format!("{}: old content after a new slice", path.name()), value(&r, 1) / 171.3, 1e-9);
    }
}

fn out_and_back(sheet: &mut Sheet) {
    let (speed, pause_s, reach_mm) = (10.0, 6.0, 6.0);
    for path in PATHS {
        for decay in [
            Decay::DeadTime { rate_per_s: 1.0, wait_s: 0.55 },
            Decay::DeadTime { rate_per_s: 3.0, wait_s: 2.0 },
            Decay::Exponential { rate_per_s: 1.0 },
        ] {
            let mut r = reconstructor(path, decaying(decay), probe().mask());
            let steps = (2.0 * reach_mm / 0.2) as i32;
            for i in 0..=steps {
                let along = 0.2 * f64::from(i) - reach_mm;
                r.insert(&touch(0.0, 0.2 * f64::from(i) / speed, along, 0)).unwrap();
            }
            let turned_s = 2.0 * reach_mm / speed + pause_s;
            for i in 0..=steps {
                let along = reach_mm - 0.2 * f64::from(i);
                r.insert(&touch(100.0, turned_s + 0.2 * f64::from(i) / speed, along, 1)).unwrap();
            }
            // The pause lies between the visits of each voxel.
            let old = (-10..=10).map(|y| 1.0 - value(&r, y) / 100.0);
            let (least, most) = old.fold((f64::MAX, 0.0_f64), |(l, m), x| (l.min(x), m.max(x)));
            let what = format!("{}, a = {}/s, T = {} s", name(path, decay), decay.rate_per_s(), decay.wait_s());
            // Four rounding units of the value from which the fraction is computed.
            let bound = decay.factor(pause_s) + 4.0 * f64::from(f32::EPSILON);
            sheet.at_most(&format!("{what}: most of the old content"), most, bound);
            sheet.at_most(&format!("{what}: least of it below 0 by"), -least, 1e-6);
        }
    }
}

fn faint_touches(sheet: &mut Sheet) {
    let decay = Decay::DeadTime { rate_per_s: 1.0, wait_s: 2.0 };
    for path in PATHS {
        let old = |r: &PathReconstructor| 1.0 - value(r, 0) / 100.0;
        let fading_out = Settings { method: Method::Gaussian, ..decaying(decay) };
        let mut r = reconstructor(path, fading_out, probe().mask());
        r.insert(&touch(0.0, 0.0, 0.0, 0)).unwrap();
        let before = middle(&r);
        for k in 1..20 {
            // 0.01 mm inside the support of 2.576 mm: a thousandth of a slice, where the kernel
            // ends without a step.
            r.insert(&touch(0.0, 0.5 * f64::from(k), 2.565, k)).unwrap();
        }
        let what = path.name();
        sheet.equal(&format!("{what}: the voxel after 19 faint touches"), middle(&r), before);
        r.insert(&touch(100.0, 10.0, 0.0, 1)).unwrap();
        sheet.at_most(&format!("{what}: old content after them, 10 s on"), old(&r), decay.factor(10.0));

        // Slices 3.5 mm beside it touch the brick beyond the range of its ages, twice.
        let mut r = reconstructor(path, decaying(decay), probe().mask());
        r.insert(&touch(0.0, 0.0, 0.0, 0)).unwrap();
        for k in 1..100 {
            r.insert(&touch(0.0, f64::from(k), 3.5, k)).unwrap();
        }
        r.insert(&touch(100.0, 100.0, 0.0, 1)).unwrap();
        sheet.at_most(&format!("{what}: old content beside 99 touches, 100 s on"), old(&r), 1e-6);
        // In such a brick 5 s are 5 s, whether or not its ages are shifted meanwhile.
        let factor = decay.factor(5.0);
        let (mut least, mut most) = (f64::MAX, 0.0_f64);
        for touched in (90..110).step_by(4) {
            let mut r = reconstructor(path, decaying(decay), probe().mask());
            for k in 0..touched + 5 {
                let along = if k == touched { 0.0 } else { 3.5 };
                r.insert(&touch(0.0, f64::from(k), along, k)).unwrap();
            }
            r.insert(&touch(100.0, f64::from(touched) + 5.0, 0.0, 1)).unwrap();
            (least, most) = (least.min(old(&r)), most.max(old(&r)));
        }
        let expected = factor / (1.0 + factor);
        sheet.near(&format!("{what}: least of old content there after 5 s"), least, expected, 1e-3 * expected + 1e-6);
        sheet.near(&format!("{what}: most of old content there after 5 s"), most, expected, 1e-3 * expected + 1e-6);
    }
}
