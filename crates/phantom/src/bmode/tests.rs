//! Each effect alone, against its closed form, and all together against themselves.

use std::sync::Arc;

use glam::{DAffine3, DMat3, DQuat, DVec2, DVec3};

use simd::Simd;
use sonoweave_core::frames::{Transform, World};

use super::*;
use crate::body::{Body, Material, Shape, Solid, Wire, calibration as phantoms, doll, thigh};
use crate::trajectory::PictureMm;

const SIZE: [u32; 2] = [96, 120];

/// A small linear scanner with some effects.
fn linear(effects: Effects) -> Scanner {
    Scanner { beams: 128, effects, ..Scanner::small_parts(60.0) }
}

/// A body of nothing but reference tissue.
fn tissue(attenuation: f64) -> Body {
    Body {
        materials: vec![Material { backscatter_db: Some(0.0), attenuation, ..Material::water("tissue") }],
        ..phantoms::cross_wire(20.0)
    }
}

fn over(scanner: Scanner, body: Body) -> BMode {
    let pixel = scanner.pixel_mm(SIZE);
    let layout = Layout::new(&scanner, SIZE, [pixel; 2]).unwrap();
    BMode::new(scanner, Arc::new(body.placed_at(layout.face_below_middle_mm())), SIZE, [pixel; 2]).unwrap()
}

fn pose(translation: DVec3) -> Transform<World, PictureMm> {
    Transform::from_affine(DAffine3::from_translation(translation))
}

/// Returns squared amplitudes of the detected rows and the displayed beams.
fn power(bmode: &BMode, at: DVec3, frame: u32) -> Vec<Vec<f64>> {
    let mut room = bmode.workspace();
    bmode.echoes(&pose(at), frame, &mut room);
    let layout = bmode.layout();
    let row = |r: usize| &room.power[r * layout.columns..][layout.side..layout.columns - layout.side];
    layout.detected().map(|r| row(r).iter().copied().map(f64::from).collect()).collect()
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Returns the mean power of each row over `n` slices too far apart to share scatterers.
fn mean_rows(bmode: &BMode, n: u32) -> Vec<f64> {
    let slices: Vec<_> = (0..n).map(|k| power(bmode, DVec3::new(0.0, 0.0, 9.0 * f64::from(k)), k)).collect();
    (0..slices[0].len()).map(|r| slices.iter().map(|s| mean(&s[r])).sum::<f64>() / f64::from(n)).collect()
}

fn db(power: f64) -> f64 {
    10.0 * power.log10()
}

#[test]
fn speckle_is_fully_developed_with_stated_power_at_all_depths() {
    let effects = Effects { speckle: true, focusing: true, ..Effects::NONE };
    let curved = Scanner { beams: 128, effects, ..Scanner::abdominal(90.0) };
    for scanner in [linear(effects), curved] {
        let bmode = over(scanner, tissue(0.0));
        let slices: Vec<_> = (0..12).map(|k| power(&bmode, DVec3::new(0.0, 0.0, 12.0 * f64::from(k)), k)).collect();
        let rows = slices[0].len();
        for part in 0..4 {
            // Amplitudes of a quarter of the depth: Rayleigh's law has mean²/variance of π/(4 −
            // π) and mean power 1.
            let rows = part * rows / 4..(part + 1) * rows / 4;
            let all: Vec<f64> =
                slices.iter().flat_map(|s| s[rows.clone()].iter().flatten()).map(|p| p.sqrt()).collect();
            let mean_power = all.iter().map(|a| a * a).sum::<f64>() / all.len() as f64;
            let ratio = mean(&all) / (mean_power - mean(&all).powi(2)).sqrt();
            assert!((ratio - 1.913).abs() < 0.08, "{part}: {ratio}");
            // About 2000 independent speckles.
            assert!((mean_power - 1.0).abs() < 0.1, "{part}: {mean_power}");
        }
    }
}

#[test]
fn attenuation_and_tgc_are_linear_in_decibels() {
    let effects = Effects { speckle: true, focusing: true, attenuation: true, ..Effects::NONE };
    let bmode = over(linear(effects), tissue(0.5));
    let rows = mean_rows(&bmode, 12);
    let depth = |r: usize| r as f64 * bmode.layout().range_step;
    // Least-squares line through the decibels of each row.
    let points: Vec<[f64; 2]> = rows.iter().enumerate().skip(20).map(|(r, p)| [depth(r), db(*p)]).collect();
    let [mx, my] = [0, 1].map(|i| mean(&points.iter().map(|p| p[i]).collect::<Vec<_>>()));
    let slope = points.iter().map(|p| (p[0] - mx) * (p[1] - my)).sum::<f64>()
        / points.iter().map(|p| (p[0] - mx).powi(2)).sum::<f64>();
    // Round trip: 2 · 0.5 dB/cm/MHz · 7.5 MHz.
    assert!((10.0 * slope + 7.5).abs() < 0.3, "{slope}");
    let scanner = Scanner { effects: Effects { tgc: true, ..effects }, ..*bmode.scanner() };
    assert_eq!(scanner.tgc_db(40.0) - scanner.tgc_db(20.0), 2.0 * scanner.tgc_db_per_cm);
    assert_eq!(scanner.tgc_db(1000.0), scanner.tgc_most_db);
    assert_eq!(bmode.scanner().tgc_db(40.0), 0.0);
}

#[test]
fn shadow_behind_layer_matches_layer_losses() {
    let effects = Effects { speckle: true, attenuation: true, losses: true, ..Effects::NONE };
    let half = |depth: f64, material| Solid {
        shape: Shape::HalfSpace { point: DVec3::new(0.0, depth, 0.0), normal: DVec3::NEG_Y },
        material,
    };
    let layered = |layer: Material| {
        let open = tissue(0.0);
        let behind = open.materials[0];
        Body { materials: vec![behind, layer, behind], solids: vec![half(20.0, 1), half(28.0, 2)], ..open }
    };
    let layer = Material { attenuation: 0.8, impedance: 3.0, ..tissue(0.0).materials[0] };
    let rows = mean_rows(&over(linear(effects), layered(layer)), 12);
    let bmode = over(linear(effects), tissue(0.0));
    let open = mean_rows(&bmode, 12);
    let row = |mm: f64| (mm / bmode.layout().range_step) as usize;
    let drop = |from: f64, to: f64| db(mean(&rows[row(from)..row(to)]) / mean(&open[row(from)..row(to)]));
    let reflected: f64 = (3.0 - 1.48) / (3.0 + 1.48);
    let expected = -2.0 * 0.8 * 7.5 * 0.8 + 2.0 * 20.0 * (1.0 - reflected * reflected).log10();
    assert!(drop(2.0, 18.0).abs() < 1e-6);
    assert!((drop(32.0, 55.0) - expected).abs() < 0.05, "{} {expected}", drop(32.0, 55.0));
    // Behind bone the echo is below the receiver's noise.
    let bone = mean_rows(&over(linear(effects), layered(Material::bone("bone"))), 2);
    assert!(db(mean(&bone[row(32.0)..])) < linear(effects).noise_db, "{}", db(mean(&bone[row(32.0)..])));
}

#[test]
fn wire_echo_has_geometric_position_and_beam_width() {
    let effects = Effects { wires: true, focusing: true, ..Effects::NONE };
    let curved = Scanner { beams: 400, effects, ..Scanner::abdominal(90.0) };
    for scanner in [Scanner { beams: 400, ..linear(effects) }, curved] {
        for depth in [15.0, 30.0, 50.0] {
            let wire = Wire::nylon("a", [3.3, depth, -25.0], [3.3, depth, 25.0]);
            let wire_mm = wire.diameter_mm;
            let bmode = over(scanner, Body { wires: vec![wire], ..tissue(0.0) });
            let layout = bmode.layout();
            let amplitudes: Vec<Vec<f64>> =
                power(&bmode, DVec3::ZERO, 0).into_iter().map(|r| r.into_iter().map(f64::sqrt).collect()).collect();
            let (mut sum, mut first, mut second) = (0.0, DVec2::ZERO, DVec2::ZERO);
            for (r, row) in amplitudes.iter().enumerate() {
                for (c, a) in row.iter().enumerate() {
                    let range = r as f64 * layout.range_step;
                    let at = DVec2::new(layout.lateral(c + layout.side), range);
                    (sum, first, second) = (sum + a, first + at * *a, second + at * at * *a);
                }
            }
            let middle = first / sum;
            // Sound returns from the wire's surface.
            let found = layout.transducer.place(middle.x, middle.y + 0.5 * wire_mm);
            assert!(found.distance(DVec2::new(3.3, depth)) < 0.02, "{found} {depth}");
            let sigma = (second / sum - middle * middle).map(f64::sqrt);
            let across = sigma.x * layout.transducer.mm_per_lateral(middle.y);
            // Deviations depend on the position between nodes and on the kernels' ends.
            let [lateral, axial] = spread::Spread::widths(&scanner, middle.y).map(|w| w / FWHM_PER_SIGMA);
            assert!((across / lateral - 0.98).abs() < 0.08, "{across} {lateral}");
            assert!((sigma.y / axial - 0.98).abs() < 0.05, "{} {axial}", sigma.y);
            // The echo has its own amplitude at the focus, and less in wider parts of the beam:
            // the peak of a Gaussian of this volume.
            let cell = layout.lateral_step * layout.transducer.mm_per_lateral(middle.y) * layout.range_step;
            let peak = sum * cell / (std::f64::consts::TAU * lateral * axial);
            let expected = scatter::amplitude(22.0) * scanner.lateral.focal_sigma_mm(scanner.wavelength_mm()) / lateral;
            // A wire at a right angle reflects 1 plus its diffuse part.
            assert!((peak / expected / 1.03 - 1.0).abs() < 0.04, "{peak} {expected}");
        }
    }
}

#[test]
fn tilted_slice_shows_wires_at_crossings() {
    let effects = Effects { wires: true, focusing: true, ..Effects::NONE };
    let scanner = Scanner { beams: 192, effects, white_db: 45.0, ..Scanner::small_parts(50.0) };
    let size = [300, 400];
    let pixel = scanner.pixel_mm(size);
    let layout = Layout::new(&scanner, size, [pixel; 2]).unwrap();
    let body = phantoms::n_wires(&phantoms::NWires::default()).placed_at(layout.face_below_middle_mm());
    let bmode = BMode::new(scanner, Arc::new(body), size, [pixel; 2]).unwrap();
    let turn = DMat3::from_quat(DQuat::from_euler(glam::EulerRot::ZYX, 0.05, 0.08, -0.04));
    let world_from_picture = Transform::from_affine(DAffine3 { matrix3: turn, translation: DVec3::new(0.6, 0.4, 3.0) });
    let mut picture = vec![0; 300 * 400];
    bmode.paint(&world_from_picture, 0, &mut bmode.workspace(), &mut picture);
    let centre = DAffine3 {
        matrix3: DMat3::from_diagonal(DVec3::new(pixel, pixel, 1.0)),
        translation: DVec3::new(-149.5 * pixel, -199.5 * pixel, 0.0),
    };
    let body = bmode.body();
    let body_from_image = body.world_from_body.inverse() * world_from_picture.affine() * centre;
    for wire in &body.wires {
        let at = wire.crossing(&body_from_image).unwrap() - DVec2::Y * (0.5 * wire.diameter_mm / pixel);
        let (mut sum, mut first) = (0.0, DVec2::ZERO);
        for (k, grey) in picture.iter().enumerate() {
            let p = DVec2::new((k % 300) as f64, (k / 300) as f64);
            if p.distance(at) < 1.8 / pixel {
                // Converts back to linear amplitude.
                let echo = 10.0_f64.powf(f64::from(*grey) / 255.0 * scanner.dynamic_range_db / 20.0) - 1.0;
                (sum, first) = (sum + echo, first + p * echo);
            }
        }
        let off = (first / sum - at).length() * pixel;
        assert!(sum > 100.0 && off < 0.08, "{}: {off} mm of {at}", wire.name);
    }
}

#[test]
fn speckle_moves_with_body_and_decorrelates_by_beam_thickness() {
    let effects = Effects { speckle: true, ..Effects::NONE };
    let bmode = over(linear(effects), tissue(0.0));
    let step = bmode.layout().lateral_step;
    let first = power(&bmode, DVec3::ZERO, 0);
    let moved = power(&bmode, DVec3::new(5.0 * step, 0.0, 0.0), 0);
    for (a, b) in first.iter().zip(&moved) {
        // A slice five beams further right shows the body five beams further left.
        let off = a[5..].iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(off < 2e-3, "{off}");
    }
    let sigma = bmode.scanner().elevation_sigma_mm(30.0);
    let flat = |p: Vec<Vec<f64>>| p.into_iter().flatten().collect::<Vec<f64>>();
    for part in [0.0, 0.5, 1.0, 1.5, 4.0] {
        let mut correlation = 0.0;
        for k in 0..6 {
            let z = 20.0 * f64::from(k);
            let [a, b] = [z, z + part * sigma].map(|z| flat(power(&bmode, DVec3::new(0.0, 0.0, z), 0)));
            let covariance = |a: &[f64], b: &[f64]| {
                mean(&a.iter().zip(b).map(|(a, b)| a * b).collect::<Vec<_>>()) - mean(a) * mean(b)
            };
            correlation += covariance(&a, &b) / (covariance(&a, &a) * covariance(&b, &b)).sqrt() / 6.0;
        }
        // Correlation of powers: the square of the amplitudes' exp(−δ²/4σ²).
        assert!((correlation - (-0.5 * part * part).exp()).abs() < 0.05, "{part}: {correlation}");
    }
}

/// Returns the largest amplitude within 2 mm of a depth, and its depth.
fn echo_near(bmode: &BMode, at: DVec3, depth: f64) -> (f64, f64) {
    let rows = power(bmode, at, 0);
    let step = bmode.layout().range_step;
    let near = (((depth - 2.0) / step) as usize..((depth + 2.0) / step) as usize)
        .map(|r| (rows[r][64].sqrt(), r as f64 * step));
    near.fold((0.0, 0.0), |a, b| if b.0 > a.0 { b } else { a })
}

/// A tank floor with an even surface.
fn even_floor(depth: f64, slope: DVec2) -> Body {
    let mut body = phantoms::floor(depth, slope);
    body.materials[1].roughness = 0.0;
    body
}

#[test]
fn surface_echo_follows_angle_and_reverberates() {
    let effects = Effects { surfaces: true, ..Effects::NONE };
    let scanner = linear(effects);
    let floor = even_floor(18.0, DVec2::ZERO);
    let [water, acrylic] = [floor.materials[0], floor.materials[1]];
    let reflected = water.reflection(&acrylic);
    let shine = |degrees: f64| {
        let (sin, cos) = degrees.to_radians().sin_cos();
        (-0.5 * (sin / acrylic.lobe_deg.to_radians()).powi(2)).exp() + acrylic.diffuse * cos
    };
    let expected = |degrees: f64| scatter::amplitude(REFERENCE_DB) * reflected * shine(degrees);
    let bmode = over(scanner, floor);
    let (echo, at) = echo_near(&bmode, DVec3::ZERO, 18.0);
    // The tolerance covers the position between rows.
    assert!((echo / expected(0.0) - 1.0).abs() < 0.08 && (at - 18.0).abs() < bmode.layout().range_step, "{echo} {at}");
    assert_eq!(echo_near(&bmode, DVec3::ZERO, 36.0).0, 0.0);
    // Tilted out of the slice's plane, so that the surface's range does not vary along the
    // beams.
    for degrees in [5.0, 12.0, 20.0_f64] {
        let tilted = over(scanner, even_floor(18.0, DVec2::new(0.0, degrees.to_radians().tan())));
        let (tilted, _) = echo_near(&tilted, DVec3::ZERO, 18.0);
        // The echo is spread over the ranges within the slice's thickness.
        let least = 2.0 / 3.0;
        let ratio = tilted / (echo * shine(degrees) / shine(0.0));
        assert!(ratio < 1.12 && ratio > least * 0.9, "{degrees}: {ratio}");
    }
    let again =
        over(Scanner { effects: Effects { reverberation: true, ..effects }, ..scanner }, even_floor(18.0, DVec2::ZERO));
    let once = reflected * shine(0.0) * scanner.face_reflection;
    for time in 2..=3 {
        let (weaker, at) = echo_near(&again, DVec3::ZERO, 18.0 * f64::from(time));
        assert!((at - 18.0 * f64::from(time)).abs() < 2.0 * again.layout().range_step, "{at}");
        assert!((weaker / (echo * once.powi(time - 1)) - 1.0).abs() < 0.13, "{time}: {weaker}");
    }
}

#[test]
fn echo_and_noise_have_stated_levels() {
    let effects = Effects { surfaces: true, tgc: true, ..Effects::NONE };
    let scanner = Scanner { white_db: 70.0, ..linear(effects) };
    let bmode = over(scanner, even_floor(30.0, DVec2::ZERO));
    let mut picture = vec![1; 96 * 120];
    bmode.paint(&pose(DVec3::ZERO), 0, &mut bmode.workspace(), &mut picture);
    let floor = bmode.layout().pixel(0.0, 30.0).y.round() as usize;
    let brightest = (floor - 1..=floor + 1).map(|v| picture[v * 96 + 48]).max().unwrap();
    let echo = 20.0 * echo_near(&bmode, DVec3::ZERO, 30.0).0.log10();
    let expected = scanner.grey(echo + scanner.tgc_db(30.0));
    // A pixel covers several rows.
    assert!((f64::from(brightest) - expected).abs() < 6.0 && expected < 250.0, "{brightest} {expected}");
    let noisy = over(Scanner { effects: Effects { noise: true, ..Effects::NONE }, ..scanner }, tissue(0.0));
    let rows = mean_rows(&noisy, 4);
    assert!((db(mean(&rows)) - scanner.noise_db).abs() < 0.2, "{}", db(mean(&rows)));
    assert_ne!(power(&noisy, DVec3::ZERO, 0), power(&noisy, DVec3::ZERO, 1));
    assert_eq!(power(&noisy, DVec3::ZERO, 1), power(&noisy, DVec3::ZERO, 1));
}

#[test]
fn disabled_effects_leave_nothing_and_non_data_is_black() {
    let body = || Body { wires: vec![Wire::nylon("a", [0.0, 20.0, -9.0], [0.0, 20.0, 9.0])], ..doll::doll() };
    let none = over(linear(Effects::NONE), body());
    assert!(power(&none, DVec3::ZERO, 0).iter().flatten().all(|p| *p == 0.0));
    for scanner in [linear(Effects::ALL), Scanner::abdominal(110.0)] {
        let bmode = over(Scanner { noise_db: 30.0, ..scanner }, body());
        let mut picture = vec![9; 96 * 120];
        bmode.paint(&pose(DVec3::ZERO), 0, &mut bmode.workspace(), &mut picture);
        let mask = bmode.mask();
        for (k, grey) in (0..).zip(&picture) {
            assert_eq!(*grey != 0, mask.contains(k % 96, k / 96), "{k}");
        }
        // The field lies in the image, and the middle column is data except for its margins.
        let column = (0..120).filter(|v| mask.contains(48, *v)).count();
        assert!((55..120).contains(&column) && mask.area() > 2500, "{column}");
    }
}

#[test]
fn pixel_and_beam_maps_are_inverse_and_fan_covers_field() {
    for scanner in [linear(Effects::ALL), Scanner::abdominal(90.0)] {
        let bmode = over(scanner, tissue(0.0));
        let layout = bmode.layout();
        let half = layout.transducer.half_opening();
        for (lateral, range) in [(0.0, 0.0), (half, 10.0), (-0.7 * half, 55.0), (0.3 * half, 60.0)] {
            let pixel = layout.pixel(lateral, range);
            let [column, row] = layout.raster(pixel);
            assert!((column - layout.column(lateral)).abs() < 1e-9);
            assert!((row - layout.above as f64 - range / layout.range_step).abs() < 1e-9);
        }
        // Just inside and just outside of each border.
        let inside = |lateral: f64, range: f64| {
            let p = layout.pixel(lateral, range);
            layout.fan().map_or_else(
                || {
                    let clip = layout.clip().unwrap();
                    let [u, v] = [p.x.round() as u32, p.y.round() as u32];
                    (clip.x..clip.x + clip.width).contains(&u) && (clip.y..clip.y + clip.height).contains(&v)
                },
                |fan| fan.test().contains(p.x, p.y),
            )
        };
        let (pixel, depth) = (layout.pixel_mm[0], scanner.depth_mm);
        let aside = pixel / layout.transducer.mm_per_lateral(0.5 * depth);
        for sign in [-1.0, 1.0] {
            assert!(inside(sign * (half - aside), 0.5 * depth) && !inside(sign * (half + aside), 0.5 * depth));
        }
        assert!(
            inside(0.0, pixel) && !inside(0.0, -pixel) && inside(0.0, depth - pixel) && !inside(0.0, depth + pixel)
        );
    }
}

#[test]
fn instruction_sets_give_identical_bits() {
    for (scanner, body) in [
        (Scanner { beams: 96, ..Scanner::abdominal(110.0) }, thigh::thigh(60.0)),
        (linear(Effects::ALL), phantoms::n_wires(&phantoms::NWires::default())),
    ] {
        let bmode = over(scanner, body);
        let mut pictures = Vec::new();
        for simd in Simd::ALL.into_iter().filter(|s| s.is_available()) {
            let mut bmode = bmode.clone();
            bmode.simd = simd;
            let (mut room, mut picture) = (bmode.workspace(), vec![0; 96 * 120]);
            // Earlier use of the workspace leaves no trace.
            bmode.paint(&pose(DVec3::new(0.0, 3.0, 40.0)), 9, &mut room, &mut picture);
            bmode.paint(&pose(DVec3::new(0.3, 0.0, 1.0)), 2, &mut room, &mut picture);
            pictures.push(picture);
        }
        assert!(pictures.windows(2).all(|p| p[0] == p[1]) && pictures[0].iter().any(|p| *p > 100));
    }
}

#[test]
fn invalid_scanner_is_refused_with_its_number() {
    let good = Scanner::abdominal(100.0);
    for (scanner, text) in [
        (Scanner { depth_mm: f64::NAN, ..good }, "the depth, mm, is NaN"),
        (Scanner { beams: 1, ..good }, "the number of beams is 1"),
        (Scanner { dynamic_range_db: 0.0, ..good }, "the dynamic range, dB, is 0; it must lie between 1 and 200"),
    ] {
        let error = Layout::new(&scanner, SIZE, [0.5; 2]).unwrap_err().to_string();
        assert!(error.contains(text), "{error}");
    }
    let oblong = Layout::new(&good, SIZE, [0.5, 0.6]).unwrap_err().to_string();
    assert!(oblong.contains("square pixels"), "{oblong}");
}
