//! Figures with closed forms, causes of their errors, and invalid figures.

mod bedside;
mod coverage;

use std::f64::consts::PI;

use calibration::probe::plane::NUMBERS;
use calibration::probe::plane_covariance::PlaneCovariance;
use calibration::tracker::noise::TrackerNoise;
use glam::{DAffine3, DMat3, DQuat, DVec2, DVec3};
use pipeline::Observer as _;
use reconstruct::kernel::{AxisKernel, Method, Support};
use sonoweave_core::frames::Transform;
use sonoweave_core::slice::{Image, Pixels, Slice};

use super::place::MOST_MM;
use super::*;
use bedside::{Session, across};

/// Returns errors of sampling and clicks alone.
fn sampled() -> Uncertainty {
    Uncertainty { voxel_mm: 0.5, hwhm_mm: [0.6; 3], ..Uncertainty::default() }
}

/// Measures a figure without slices.
fn measured(request: &Request) -> Result<Measured, MeasureError> {
    measure(request, &sampled(), &Slices::default())
}

fn request(kind: Kind, points: &[[f64; 3]]) -> Request {
    Request { kind, points: places(points), contours: Vec::new(), pixel_mm: 0.2 }
}

fn places(points: &[[f64; 3]]) -> Vec<Place> {
    points.iter().copied().map(Place::from).collect()
}

fn turned(at: [f64; 3]) -> [f64; 3] {
    (DQuat::from_axis_angle(DVec3::new(1.0, 2.0, -0.5).normalize(), 0.7) * DVec3::from_array(at)
        + DVec3::new(300.0, -200.0, 150.0))
    .to_array()
}

fn circle(radius: f64, z: f64, sides: u32) -> Vec<[f64; 3]> {
    let at = |n: u32| f64::from(n) / f64::from(sides) * 2.0 * PI;
    (0..sides).map(|n| turned([radius * at(n).cos(), radius * at(n).sin(), z])).collect()
}

#[test]
fn figure_values_match_closed_forms_anywhere() {
    let value = |request: &Request| measured(request).unwrap();
    let distance = value(&request(Kind::Distance, &[turned([0.0; 3]), turned([3.0, 4.0, 12.0])]));
    assert!((distance.value - 13.0).abs() < 1e-9 && distance.unit == "mm");
    let angle = value(&request(Kind::Angle, &[[5.0, 0.0, 0.0], [0.0; 3], [0.0, 0.0, 2.0]].map(turned)));
    assert!((angle.value - 90.0).abs() < 1e-6 && angle.unit == "°");
    let square = [[0.0, 0.0, 5.0], [4.0, 0.0, 5.0], [4.0, 3.0, 5.0], [0.0, 3.0, 5.0]].map(turned);
    let area = value(&request(Kind::Area, &square));
    assert!((area.value - 12.0).abs() < 1e-9 && area.notes.len() == 2, "{area:?}");
    let ends =
        [[-5.0, 0.0, 0.0], [5.0, 0.0, 0.0], [0.0, -4.0, 0.0], [0.0, 4.0, 0.0], [0.0, 0.0, -3.0], [0.0, 0.0, 3.0]];
    let ellipsoid = value(&request(Kind::Ellipsoid, &ends.map(turned)));
    assert!((ellipsoid.value - PI / 6.0 * 480.0).abs() < 1e-9 && ellipsoid.notes.len() == 2);
    // A ball of 10 mm radius in 20 slabs, from below and from above.
    let heights: Vec<f64> = (0..20).map(|n| -9.5 + f64::from(n)).collect();
    let mut contours: Vec<_> = heights.iter().map(|z| circle((100.0 - z * z).sqrt(), *z, 90)).collect();
    for _ in 0..2 {
        contours.reverse();
        let stack =
            Request { contours: contours.iter().map(|contour| places(contour)).collect(), ..request(Kind::Stack, &[]) };
        let ball = value(&stack);
        let truth = 4.0 / 3.0 * PI * 1000.0;
        assert!((ball.value - truth).abs() < 0.005 * truth, "{} of {truth}", ball.value);
        assert!((ball.value - truth).abs() < ball.error && ball.unit == "mm³");
    }
}

#[test]
fn depth_uncertainty_counts_only_along_its_ray() {
    let deep = |point: [f64; 3], along: DVec3, depth_mm| Place {
        along: along.to_array(),
        depth_mm,
        pixel_mm: Some(0.2),
        ..Place::from(point)
    };
    let of = |points: Vec<Place>| measured(&Request { points, ..request(Kind::Distance, &[]) }).unwrap();
    let ends = [[0.0; 3], [0.0, 0.0, 20.0]];
    let flat = of(places(&ends));
    let across = of(ends.map(|end| deep(end, DVec3::X, 3.0)).to_vec());
    // A ray across the distance also takes the click's error from the distance's direction only.
    // The depth then counts by its curvature only.
    let near = |a: f64, b: f64| (a / b - 1.0).abs() < 0.02;
    assert!(
        near(across.of_sampling, flat.of_sampling) && near(across.of_clicks, flat.of_clicks),
        "{across:?} {flat:?}"
    );
    // Along the distance the depth adds a uniform distribution over its width, and clicks nothing.
    let along = of(ends.map(|end| deep(end, DVec3::Z, 3.0)).to_vec());
    let [added, before] = [along.of_sampling, flat.of_sampling].map(|of| (of / 1.96).powi(2));
    assert!((added - before - 2.0 * 9.0 / 12.0).abs() < 0.12 && along.of_clicks < 0.02, "{added} {before}");
    let wide = of(ends.map(|end| Place { pixel_mm: Some(2.0), ..end.into() }).to_vec());
    assert!((wide.of_clicks / flat.of_clicks - 10.0).abs() < 0.6, "a pixel of its own counts");
}

#[test]
fn place_parses_from_numbers_or_object() {
    let parse = |text: &str| serde_json::from_str::<Place>(text);
    assert_eq!(parse("[1, 2, 3]").unwrap(), [1.0, 2.0, 3.0].into());
    let known = parse("{\"point\": [1, 2, 3], \"along\": [0, 0, 1], \"depth_mm\": 0.5, \"pixel_mm\": 0.25}").unwrap();
    let expected = Place { along: [0.0, 0.0, 1.0], depth_mm: 0.5, pixel_mm: Some(0.25), ..[1.0, 2.0, 3.0].into() };
    assert_eq!(known, expected);
    assert_eq!(parse(&serde_json::to_string(&known).unwrap()).unwrap(), known);
    assert_eq!(parse("{\"point\": [1, 2, 3]}").unwrap(), [1.0, 2.0, 3.0].into());
    for text in ["[1, 2]", "{\"point\": [1, 2, 3], \"width\": 1}", "{\"along\": [0, 0, 1]}"] {
        assert!(parse(text).is_err(), "{text}");
    }
}

#[test]
fn figures_beyond_their_forms_are_noted() {
    let bent = [[0.0; 3], [10.0, 0.0, 0.0], [10.0, 10.0, 3.0], [0.0, 10.0, 0.0]];
    assert!(measured(&request(Kind::Area, &bent)).unwrap().notes[0].contains("off a plane"));
    let leaning =
        [[-5.0, 0.0, 0.0], [5.0, 0.0, 0.0], [-4.0, -4.0, 0.0], [4.0, 4.0, 0.0], [0.0, 0.0, -3.0], [0.0, 0.0, 3.0]];
    assert!(measured(&request(Kind::Ellipsoid, &leaning)).unwrap().notes[0].contains("45° from right angles"));
}

#[test]
fn invalid_figure_is_refused() {
    let square = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0]];
    let lifted = |dz: f64, tilt: f64| square.map(|[x, y, _]| [x, y, dz + tilt * x]).to_vec();
    let stack = |contours: Vec<Vec<[f64; 3]>>| Request {
        contours: contours.iter().map(|contour| places(contour)).collect(),
        ..request(Kind::Stack, &[])
    };
    let deep = |along, depth_mm, pixel_mm| {
        let place = Place { along, depth_mm, pixel_mm, ..Place::from([0.0; 3]) };
        Request { points: vec![place, [9.0; 3].into()], ..request(Kind::Distance, &[]) }
    };
    let points = |takes, count| MeasureError::Points { takes, count };
    let outside = MeasureError::Outside { most_mm: MOST_MM };
    let width = |what| MeasureError::Width { what, most_mm: MOST_WIDE_MM };
    for (request, error) in [
        (request(Kind::Distance, &square), points("two points", 3)),
        (request(Kind::Angle, &square[..2]), points("three points, the vertex in the middle", 2)),
        (request(Kind::Angle, &[square[0], square[0], square[1]]), MeasureError::Degenerate),
        (request(Kind::Area, &[[0.0; 3], [1.0; 3], [2.0; 3]]), MeasureError::Degenerate),
        (request(Kind::Ellipsoid, &square), points("six points, the ends of three diameters", 3)),
        (request(Kind::Distance, &[[f64::NAN; 3], [0.0; 3]]), outside.clone()),
        (request(Kind::Distance, &[[1e9; 3], [0.0; 3]]), outside),
        (request(Kind::Stack, &square), MeasureError::Kind),
        (request(Kind::Distance, &[]), MeasureError::Kind),
        (Request { pixel_mm: -1.0, ..request(Kind::Distance, &square[..2]) }, width("pixel_mm")),
        (request(Kind::Area, &vec![[0.0; 3]; 3000]), MeasureError::TooMany { count: 3000, most: MOST_POINTS }),
        (deep([0.0; 3], 1.0, None), MeasureError::Direction),
        (deep([f64::NAN, 1.0, 0.0], 1.0, None), MeasureError::Direction),
        (deep([1.0, 0.0, 0.0], -1.0, None), width("a point's depth_mm and pixel_mm")),
        (deep([1.0, 0.0, 0.0], 0.0, Some(f64::INFINITY)), width("a point's depth_mm and pixel_mm")),
        (stack(vec![lifted(0.0, 0.0)]), MeasureError::FewContours),
        (stack(vec![lifted(0.0, 0.0), lifted(0.0, 0.0)]), MeasureError::SameHeight),
        (stack(vec![lifted(0.0, 0.0), vec![[0.0; 3]; 3]]), MeasureError::Contour),
    ] {
        assert_eq!(measured(&request), Err(error));
    }
    let tilted = stack(vec![lifted(0.0, 0.0), lifted(3.0, 0.5)]);
    assert!(matches!(measured(&tilted), Err(MeasureError::NotParallel { .. })));
}

fn slice(time_ns: i64, at: DAffine3) -> Slice {
    Slice {
        image: Image::new(40, 30, Pixels::U8(vec![0; 1200].into())),
        time_ns,
        world_from_image: Transform::from_affine(at),
    }
}

#[test]
fn place_sources_are_slices_within_kernel_reach() {
    let across = AxisKernel::new(Method::GaussianTruncated, 0.5, Support::Peak(0.05)).unwrap();
    let reach = across.support_mm;
    let slices = Slices::new(Some(across));
    // A sweep along the image's normal, of pixels of 0.2 mm by 0.3 mm, turned in space.
    let turn = DMat3::from_quat(DQuat::from_rotation_x(0.4));
    for n in 0..50_u32 {
        let at = turn * DVec3::Z * (f64::from(n) * 0.25);
        let map = DAffine3 { matrix3: turn * DMat3::from_diagonal(DVec3::new(0.2, 0.3, 1.0)), translation: at };
        slices.slice("Tracker", 100 + u64::from(n), &slice(i64::from(n) * 10_000_000, map));
    }
    let place = turn * DVec3::new(10.0 * 0.2, 20.0 * 0.3, 5.1);
    let found = slices.of(place.to_array()).unwrap();
    let expected: Vec<u64> = (0..50).filter(|n| (*n as f64 * 0.25 - 5.1).abs() <= reach).map(|n| 100 + n).collect();
    let mut frames: Vec<u64> = found.slices.iter().map(|slice| slice.frame).collect();
    assert_eq!(frames[0], 120, "5.0 mm is the nearest");
    frames.sort_unstable();
    assert_eq!((frames, found.count, found.forgotten), (expected, found.slices.len(), 0));
    let nearest = &found.slices[0];
    assert!((nearest.off_mm - 0.1).abs() < 1e-9 && (nearest.time_s - 0.2).abs() < 1e-12, "{nearest:?}");
    assert!((nearest.pixel[0] - 10.0).abs() < 1e-9 && (nearest.pixel[1] - 20.0).abs() < 1e-9);
    assert!((found.slices.iter().map(|slice| slice.share).sum::<f64>() - 1.0).abs() < 1e-9);
    let across = DVec3::from_array(nearest.corners[2]) - DVec3::from_array(nearest.corners[0]);
    assert!((across.length() - (8.0_f64.powi(2) + 9.0_f64.powi(2)).sqrt()).abs() < 1e-9);
    // There is none outside the image.
    assert_eq!(slices.of((turn * DVec3::new(-1.0, 3.0, 5.0)).to_array()).unwrap().count, 0);
    assert_eq!(slices.of([f64::NAN; 3]), Err(MeasureError::Outside { most_mm: MOST_MM }));
    assert_eq!(Slices::new(None).of([0.0; 3]), Err(MeasureError::UnknownReach));
    slices.cleared();
    assert_eq!((slices.count(), slices.of(place.to_array()).unwrap().count), (0, 0));
}

/// Returns a covariance of one number alone.
fn of_one(number: usize, sd: f64) -> PlaneCovariance {
    let mut entries = [[0.0; NUMBERS]; NUMBERS];
    entries[number][number] = sd * sd;
    PlaneCovariance::of_fit(DVec2::new(410.0, 308.0), entries).unwrap()
}

#[test]
fn scale_error_grows_with_length_and_position_error_cancels() {
    let session = Session::new();
    let of = |covariance: PlaneCovariance, ends: [DVec3; 2]| {
        let exact = TrackerNoise { position_mm: 0.0, rotation_deg: 0.0 };
        let uncertainty = Uncertainty {
            calibration: Some(covariance),
            sensors: Some(exact),
            voxel_mm: 0.0,
            hwhm_mm: [0.0; 3],
            ..session.uncertainty.clone()
        };
        let request = request(Kind::Distance, &ends.map(|at| at.to_array()));
        measure(&Request { pixel_mm: 0.0, ..request }, &uncertainty, &session.slices).unwrap()
    };
    // From edge to edge along u, mostly by this slice and its neighbours, which are hardly tilted.
    let along_u = |from: f64, to: f64| [session.pixel(70, [from, 300.0]), session.pixel(70, [to, 300.0])];
    for (from, to) in [(5.0, 815.0), (200.0, 600.0)] {
        let measured = of(of_one(6, 0.01), along_u(from, to));
        // Errors at opposite edges have opposite directions: the length's error is 1 %.
        let expected = 1.96 * 0.01 * measured.value;
        let found = measured.of_calibration.unwrap();
        assert!((found / expected - 1.0).abs() < 0.01, "{found} {expected}");
    }
    let [scale, place] = [of_one(6, 0.01), of_one(3, 1.0)].map(|covariance| of(covariance, along_u(5.0, 815.0)));
    assert!(place.of_calibration.unwrap() < 0.02 * scale.of_calibration.unwrap(), "{place:?}");
    // Between the upper edge of one slice and the lower edge of another, the plane's tilt counts.
    let across = [session.pixel(36, [400.0, 20.0]), session.pixel(108, [400.0, 600.0])];
    let tilt = of(of_one(0, 0.02), across).of_calibration.unwrap();
    assert!(tilt > 1.0, "{tilt}");
}

#[test]
fn unknown_causes_are_named_and_left_out() {
    let session = Session::new();
    let inside = [session.pixel(70, [100.0, 100.0]), session.pixel(70, [700.0, 400.0])].map(|at| at.to_array());
    let beside = [inside[0], (DVec3::from_array(inside[1]) + DVec3::X * 500.0).to_array()];
    let of = |uncertainty: &Uncertainty, ends: &[[f64; 3]]| {
        measure(&request(Kind::Distance, ends), uncertainty, &session.slices).unwrap()
    };
    let known = of(&session.uncertainty, &inside);
    assert!(known.notes.is_empty(), "{:?}", known.notes);
    let parts = [known.of_calibration, known.of_tracker, Some(known.of_sampling), Some(known.of_clicks)];
    let sum: f64 = parts.iter().map(|part| part.unwrap().powi(2)).sum();
    assert!((sum.sqrt() - known.error).abs() < 1e-9 && parts.iter().all(|part| *part > Some(0.0)));

    let blind = of(&Uncertainty { calibration: None, ..session.uncertainty.clone() }, &inside);
    assert_eq!((blind.of_calibration, blind.of_tracker.is_some()), (None, true));
    assert_eq!(
        blind.notes,
        ["calibration error unknown: the calibration holds no covariance; `calibrate probe` writes it"]
    );
    assert!(blind.error < known.error);
    let unreached = of(&session.uncertainty, &beside);
    assert_eq!((unreached.of_calibration, unreached.of_tracker), (None, None));
    assert_eq!(
        unreached.notes,
        [
            "calibration error unknown: no slice reaches point 2",
            "noise of the tracker or arm unknown, and not included"
        ]
    );
    let quiet = of(&Uncertainty { sensors: None, ..session.uncertainty.clone() }, &inside);
    assert_eq!((quiet.of_tracker, quiet.notes.len(), quiet.of_calibration.is_some()), (None, 1, true));
}

#[test]
fn wide_gaps_and_few_slices_enlarge_errors() {
    let of = |gap_mm: f64| {
        let slices = Slices::new(Some(across()));
        for n in -40..=40_i32 {
            let map = DAffine3::from_mat3_translation(
                DMat3::from_diagonal(DVec3::new(0.2, 0.2, 1.0)),
                DVec3::new(0.0, 0.0, gap_mm * (f64::from(n) + 0.5)),
            );
            slices.slice("Tracker", (n + 40) as u64, &slice(i64::from(n), map));
        }
        let uncertainty = Uncertainty {
            probe_from_image: Some(DAffine3::from_mat3(DMat3::from_diagonal(DVec3::new(0.2, 0.2, 1.0)))),
            sensors: Some(TrackerNoise { position_mm: 0.2, rotation_deg: 0.0 }),
            voxel_mm: 0.1,
            hwhm_mm: [0.2, 0.2, 1.2],
            ..Uncertainty::default()
        };
        let ends = [[4.0, 3.0, 0.0], [4.0, 3.0, 8.0 * gap_mm]];
        measure(&request(Kind::Distance, &ends), &uncertainty, &slices).unwrap()
    };
    let [dense, even, wide] = [0.3, 1.0, 3.0].map(of);
    // The kernel's width counts up to its own gap, and the gap beyond.
    assert!((even.of_sampling / dense.of_sampling - 1.0).abs() < 0.01, "{} {}", even.of_sampling, dense.of_sampling);
    let expected = (3.0_f64.powi(2) + 0.01).sqrt() / (1.2_f64.powi(2) + 0.01).sqrt();
    assert!((wide.of_sampling / even.of_sampling / expected - 1.0).abs() < 0.02, "{}", wide.of_sampling);
    // The noise of several slices averages out.
    let [dense, even, wide] = [dense, even, wide].map(|measured| measured.of_tracker.unwrap());
    assert!(dense < 0.65 * even && even < 0.9 * wide, "{dense} {even} {wide}");
}

#[test]
fn noise_displaces_edges_along_their_gradient() {
    // Standard errors of 4 grey levels; gradients of 20 grey levels per mm.
    let at = |point: [f64; 3], gradient: DVec3| Place {
        edge: Some(Edge { standard_error: 4.0, gradient }),
        ..Place::from(point)
    };
    let of = |points: Vec<Place>| {
        let figure = request(if points.len() == 2 { Kind::Distance } else { Kind::Area }, &[]);
        measured(&Request { points, ..figure }).unwrap()
    };
    let distance =
        |gradients: [DVec3; 2], length: f64| of(vec![at([0.0; 3], gradients[0]), at([length, 0.0, 0.0], gradients[1])]);
    let along = distance([DVec3::X * 20.0, DVec3::X * -20.0], 30.0);
    // Each end is displaced by 0.2 mm, one standard deviation; the ends are independent.
    let near = |error: Option<f64>, mm: f64| (error.unwrap() / (1.959_964 * mm) - 1.0).abs() < 0.02;
    assert!(near(along.of_noise, 0.2 * 2.0_f64.sqrt()) && along.notes.len() == 2, "{along:?}");
    let parts = [along.of_sampling, along.of_clicks, along.of_noise.unwrap()].map(|part| part * part);
    assert!((parts.iter().sum::<f64>().sqrt() / along.error - 1.0).abs() < 1e-9, "{along:?}");
    // An edge along the distance does not change it.
    let across = distance([DVec3::Y * 20.0, DVec3::Z * 20.0], 30.0);
    assert!(across.of_noise.unwrap() < 0.01, "{across:?}");
    // Where the same noise displaces both ends, they stay apart as they are.
    let shared = distance([DVec3::X * 20.0; 2], 1.0);
    assert!(shared.of_noise.unwrap() < 1e-6, "{shared:?}");
    // No edge is displaced by more than half a kernel: 0.6 mm here.
    let flat = distance([DVec3::X * 20.0, DVec3::X * 6.0], 30.0);
    assert!(
        near(flat.of_noise, 0.2) && flat.notes.iter().any(|note| note.starts_with("1 of 2 points lie on edges")),
        "{flat:?}"
    );
    let nowhere = distance([DVec3::ZERO, DVec3::X * 6.0], 30.0);
    assert_eq!((nowhere.of_noise, nowhere.notes.len()), (None, 2));
    assert_eq!(measured(&request(Kind::Distance, &[[0.0; 3], [3.0, 0.0, 0.0]])).unwrap().of_noise, None);
    // Points of an outline within a kernel share the noise: as many more of them change nothing.
    let outline = |sides: u32| {
        let place = |at: [f64; 3]| at_edge_of_circle(at);
        of((0..sides)
            .map(|n| f64::from(n) / f64::from(sides) * 2.0 * PI)
            .map(|a| place([10.0 * a.cos(), 10.0 * a.sin(), 0.0]))
            .collect())
    };
    let [few, many] = [outline(200), outline(400)].map(|area| area.of_noise.unwrap());
    assert!((few / many - 1.0).abs() < 0.1, "{few} {many}");
}

/// Returns a place on an edge that looks away from the origin.
fn at_edge_of_circle(at: [f64; 3]) -> Place {
    let gradient = DVec3::from_array(at).normalize() * 20.0;
    Place { edge: Some(Edge { standard_error: 4.0, gradient }), ..Place::from(at) }
}
