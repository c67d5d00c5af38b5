//! Compressions of simulated sweeps with pressure, and scans that tell none.

use super::*;
use crate::tests::noise::Noise as Random;
use crate::tests::speckle_scans::{HEIGHT, PIXEL_MM, Speckle, Sweep, TOP_ROWS, WIDTH, scan, uniform, within_sweep_s};

/// A hand whose pressure varies: 1.3 mm at the skin, root mean square.
fn hand(time_s: f64) -> f64 {
    1.3 * (1.0 + (3.0 * time_s + 1.0).sin()) / 1.5_f64.sqrt()
}

/// Light contact.
fn light(_: f64) -> f64 {
    0.0
}

/// Slices 0.35 mm apart, and 0.1 mm from the light ones.
fn beside(skin_mm: fn(f64) -> f64) -> Sweep {
    Sweep { from_mm: 0.1, ..Sweep::new(40, 0.35, skin_mm) }
}

/// Scans a body by a light sweep and another one.
fn scanned(beam_mm: f64, slope_deg: f64, sweeps: &[Sweep; 2]) -> Slices {
    let mut random = Random::new(7);
    let length_mm = sweeps[0].gap_mm * sweeps[0].slices as f64;
    let body = Speckle::new(beam_mm, length_mm + 1.0, slope_deg, &mut random);
    scan(&body, sweeps, &mut random)
}

/// The displacement found less the true one, over slices and depth.
struct Errors {
    /// True displacement, and what is left of it, root mean square, mm.
    before: f64,
    left: f64,
    /// Largest error, and the largest of the mean over slices, mm.
    worst: f64,
    worst_mean: f64,
}

impl Errors {
    fn of(slices: &Slices, sweep: &Sweep, pressure: &Pressure) -> Self {
        let compressions =
            pressure.compressions.iter().enumerate().filter_map(|(slice, of)| Some((slice, of.as_ref()?)));
        let rows = (HEIGHT - TOP_ROWS) as usize;
        let (mut sums, mut all, mut squares, mut worst) = (vec![0.0; rows], 0.0, [0.0; 2], 0.0_f64);
        for (slice, compression) in compressions {
            let skin_mm = (sweep.skin_mm)(within_sweep_s(slices.pixels[slice].0));
            all += 1.0;
            for (row, sum) in sums.iter_mut().enumerate() {
                // The image's first row with data lies at the depth to which the skin is pressed.
                let v = row as f64 * PIXEL_MM;
                let truth = (sweep.profile)(skin_mm, v + skin_mm);
                let off = compression.displacement_mm(v) - truth;
                *sum += off;
                squares = [squares[0] + truth * truth, squares[1] + off * off];
                worst = worst.max(off.abs());
            }
        }
        let [before, left] = squares.map(|sum| (sum / (all * rows as f64)).sqrt());
        let worst_mean = sums.iter().fold(0.0, |most: f64, sum| most.max((sum / all).abs()));
        Self { before, left, worst, worst_mean }
    }
}

fn corrected(name: &str, slices: &Slices, sweep: &Sweep, near_mm: f64) -> (Errors, Pressure) {
    let begin = std::time::Instant::now();
    let found = slices.pressure(1, near_mm).unwrap();
    let took = begin.elapsed();
    let errors = Errors::of(slices, sweep, &found);
    let Errors { before, left, worst, worst_mean } = errors;
    println!("{name}: {before:.3} to {left:.3} mm, worst {worst:.3}, of means {worst_mean:.3}, in {took:.3?}");
    println!("    {:.3?}", found.evidence);
    (errors, found)
}

/// Returns the median correlation of neighbours in the light sweep.
fn neighbours(slices: &Slices) -> f64 {
    let windows = Windows::of(slices);
    let run = &slices.directions().runs(slices)[0];
    let alike = |pair: &[usize]| {
        let [one, other] = [pair[0], pair[1]].map(|slice| Placed::of(slices, slice).unwrap());
        let seen = Picture::new(&Reference::new(slices, vec![other], f64::INFINITY).seen_from(&one));
        windows.alike(&seen, &Picture::of(slices, pair[0])).unwrap()
    };
    median(&mut run.windows(2).map(alike).collect::<Vec<f64>>())
}

#[test]
fn varying_pressure_is_found_in_beams_of_any_thickness() {
    for (beam_mm, slope_deg) in [(1.0, 0.0), (0.6, 0.0), (0.3, 0.0), (0.6, 20.0)] {
        let pressed = beside(hand);
        let slices = scanned(beam_mm, slope_deg, &[Sweep::new(40, 0.35, light), pressed.clone()]);
        let name = format!("beam {beam_mm} mm, slope {slope_deg}°, neighbours {:.2}", neighbours(&slices));
        let (errors, found) = corrected(&name, &slices, &pressed, NEAR_MM);
        assert!(errors.before > 0.55 && errors.left < 0.05 && errors.worst < 0.2, "{name}: {}", errors.left);
        assert_eq!(found.evidence.corrected, 40);
        assert!((found.evidence.skin_rms_mm - 1.22).abs() < 0.05, "{}", found.evidence.skin_rms_mm);
    }
}

#[test]
fn tilted_slices_and_far_light_ones_are_compared() {
    let tilted = Sweep { tilt: 0.03, ..beside(hand) };
    let slices = scanned(0.6, 0.0, &[Sweep::new(40, 0.35, light), tilted.clone()]);
    let (errors, _) = corrected("tilted", &slices, &tilted, NEAR_MM);
    assert!(errors.left < 0.1, "{}", errors.left);
    // Each slice lies halfway between light ones 1 mm apart.
    let [sparse, between] = [0.0, 0.5].map(|from_mm| Sweep {
        from_mm,
        uneven: 0.0,
        ..Sweep::new(15, 1.0, if from_mm > 0.0 { hand } else { light })
    });
    for beam_mm in [1.0, 0.6] {
        let slices = scanned(beam_mm, 20.0, &[sparse.clone(), between.clone()]);
        let (errors, _) = corrected(&format!("0.5 mm away, beam {beam_mm} mm"), &slices, &between, 0.51);
        assert!(errors.left < 0.1, "{}", errors.left);
    }
}

#[test]
fn uniform_compression_is_recovered() {
    // 3 % of 42 mm.
    let pressed = Sweep { slices: 60, profile: uniform, ..beside(|_| 1.26) };
    let slices = scanned(0.6, 0.0, &[Sweep::new(60, 0.35, light), pressed.clone()]);
    let (errors, found) = corrected("uniform", &slices, &pressed, NEAR_MM);
    assert!(errors.left < 0.05 && errors.worst_mean < 0.05, "{} {}", errors.left, errors.worst_mean);
    assert_eq!((found.evidence.pressed, found.evidence.corrected), (60, 60));
    assert!(
        found.compressions[..60].iter().all(Option::is_none) && found.compressions[60..].iter().all(Option::is_some)
    );
}

#[test]
fn light_sweep_of_its_own_is_displaced_by_nothing() {
    for beam_mm in [1.0, 0.6] {
        let again = beside(light);
        let slices = scanned(beam_mm, 0.0, &[Sweep::new(40, 0.35, light), again.clone()]);
        let (errors, found) = corrected(&format!("no pressure, beam {beam_mm} mm"), &slices, &again, NEAR_MM);
        assert!(errors.left < 0.01 && found.evidence.skin_rms_mm < 0.03, "{}", found.evidence.skin_rms_mm);
        assert!(errors.worst < 0.06, "{}", errors.worst);
    }
}

#[test]
fn wrong_poses_are_not_taken_for_pressure() {
    let sweeps = |shift_mm: f64| [Sweep::new(40, 0.35, light), Sweep { shift_mm, ..beside(light) }];
    for shift_mm in [-1.0, 0.5, 2.0] {
        let error = scanned(0.6, 0.0, &sweeps(shift_mm)).pressure(1, NEAR_MM).unwrap_err();
        let CalibrationError::Pressure(PressureError::Rigid { mm, .. }) = error else { panic!("{error}") };
        assert!((mm - shift_mm.abs()).abs() < 0.05, "{mm} of {shift_mm}");
    }
    // A small one stays small.
    let found = scanned(0.6, 0.0, &sweeps(0.15)).pressure(1, NEAR_MM).unwrap();
    println!("shift of 0.15 mm: {:.3?}", found.evidence);
    assert!(found.evidence.skin_max_mm < 0.3 && (found.evidence.deep_mm - 0.15).abs() < 0.03);
}

fn refused(slices: &Slices, sweep: usize, near_mm: f64) -> PressureError {
    match slices.pressure(sweep, near_mm) {
        Err(CalibrationError::Pressure(error)) => {
            println!("{error}");
            error
        }
        other => panic!("{:?}", other.map(|found| found.evidence)),
    }
}

#[test]
fn what_is_not_pressure_is_refused_by_name() {
    let all = scanned(0.6, 0.0, &[Sweep::new(40, 0.35, light), beside(hand)]);
    for number in [0, 3] {
        let error = refused(&all, number, NEAR_MM);
        let PressureError::NoSweep { sweeps_s } = &error else { panic!("{error}") };
        assert!(sweeps_s.len() == 2 && sweeps_s[0][0] == 0.0 && sweeps_s[0][1] < sweeps_s[1][0], "{error}");
        assert!(error.to_string().starts_with("the scan has 2 sweeps: 1 (0.0 to "), "{error}");
    }
    for near_mm in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(matches!(refused(&all, 1, near_mm), PressureError::Limit { .. }));
    }
    assert!(matches!(refused(&all, 1, 0.01), PressureError::Few { all: 40, least: 20, .. }));
    // The one that presses in the place of the light one.
    assert!(matches!(refused(&all, 2, NEAR_MM), PressureError::Heavier { light: 2, mm } if (0.6..1.4).contains(&mm)));
    let mut shallow = all.clone();
    shallow.bounds[1][1] = 38.0;
    assert_eq!(refused(&shallow, 1, NEAR_MM), PressureError::Shallow { windows: 4, least: 5 });
    let mut repeats = all.clone();
    (1..80).step_by(8).for_each(|slice| repeats.pixels[slice].1 = repeats.pixels[slice - 1].1.clone());
    assert_eq!(refused(&repeats, 1, NEAR_MM), PressureError::Repeats { frames: 10, all: 80 });
    // Nothing is seen at depth.
    let mut dark = all.clone();
    dark.pixels.iter_mut().for_each(|(_, pixels)| pixels[64 * WIDTH as usize..].fill(25_600));
    assert_eq!(refused(&dark, 1, NEAR_MM), PressureError::Deep { slices: 0, all: 40 });
    // Images of other places.
    let mut other = all.clone();
    (40..80).for_each(|slice| other.pixels[slice].1 = all.pixels[40 + (slice * 17) % 40].1.clone());
    assert!(matches!(refused(&other, 1, NEAR_MM), PressureError::Unrelated { share, .. } if share > 0.5));
}

#[test]
fn scans_that_hide_pressure_are_refused_by_name() {
    let of = |sweep: Sweep| scanned(0.6, 0.0, &[Sweep::new(40, 0.35, light), sweep]);
    let turned = of(Sweep { turn: 0.15, ..beside(hand) });
    assert!(matches!(refused(&turned, 1, NEAR_MM), PressureError::Few { near: 0, all: 40, .. }));
    let elsewhere = of(Sweep { from_mm: 9.0, ..beside(hand) });
    assert!(matches!(refused(&elsewhere, 1, NEAR_MM), PressureError::Few { near: 10..20, .. }));
    let far = of(beside(|_| 4.6));
    assert!(matches!(refused(&far, 1, NEAR_MM), PressureError::Far { share, .. } if share > 0.5));
    // Rows of two windows change places.
    let mut folded = of(beside(light));
    for (_, pixels) in &mut folded.pixels[40..] {
        let rows = |row: usize| row * WIDTH as usize..(row + 8) * WIDTH as usize;
        let [above, below] = [34, 42].map(|row| pixels[rows(row)].to_vec());
        pixels[rows(42)].copy_from_slice(&above);
        pixels[rows(34)].copy_from_slice(&below);
    }
    assert!(matches!(refused(&folded, 1, NEAR_MM), PressureError::Folds { share } if share > 0.5));
    let [averaged, single] = [0.7, 0.0].map(|persistence| {
        let sweep = Sweep { persistence, ..Sweep::new(24, 1.2, light) };
        scanned(0.3, 0.0, &[sweep.clone(), Sweep { from_mm: 0.05, ..sweep }])
    });
    assert!(single.pressure(1, NEAR_MM).is_ok());
    assert!(matches!(refused(&averaged, 1, NEAR_MM), PressureError::Persistence { far, .. } if far > 0.5));
}
