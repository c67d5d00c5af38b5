//! Figures with closed forms, their errors compared with random samples, and invalid figures.

use std::f64::consts::PI;

use glam::{DAffine3, DMat3, DQuat, DVec3};
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use pipeline::Observer as _;
use reconstruct::kernel::{AxisKernel, Method, Support};
use sonoweave_core::frames::Transform;
use sonoweave_core::slice::{Image, Pixels, Slice};

use super::place::MOST_MM;
use super::*;

const UNCERTAINTY: Uncertainty = Uncertainty { calibration_mm: Some(0.3), voxel_mm: 0.5, hwhm_mm: 0.6 };

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
    let value = |request: &Request| measure(request, &UNCERTAINTY).unwrap();
    let distance = value(&request(Kind::Distance, &[turned([0.0; 3]), turned([3.0, 4.0, 12.0])]));
    assert!((distance.value - 13.0).abs() < 1e-9 && distance.unit == "mm");
    let angle = value(&request(Kind::Angle, &[[5.0, 0.0, 0.0], [0.0; 3], [0.0, 0.0, 2.0]].map(turned)));
    assert!((angle.value - 90.0).abs() < 1e-6 && angle.unit == "°");
    let square = [[0.0, 0.0, 5.0], [4.0, 0.0, 5.0], [4.0, 3.0, 5.0], [0.0, 3.0, 5.0]].map(turned);
    let area = value(&request(Kind::Area, &square));
    assert!((area.value - 12.0).abs() < 1e-9 && area.notes.is_empty(), "{area:?}");
    let ends =
        [[-5.0, 0.0, 0.0], [5.0, 0.0, 0.0], [0.0, -4.0, 0.0], [0.0, 4.0, 0.0], [0.0, 0.0, -3.0], [0.0, 0.0, 3.0]];
    let ellipsoid = value(&request(Kind::Ellipsoid, &ends.map(turned)));
    assert!((ellipsoid.value - PI / 6.0 * 480.0).abs() < 1e-9 && ellipsoid.notes.is_empty());
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
fn reported_error_matches_spread() {
    let mut random = ChaCha8Rng::seed_from_u64(7);
    let [calibration, sampling] = UNCERTAINTY.of_place(0.2);
    let sigma = calibration.hypot(sampling);
    // Twelve numbers of 0 to 1, less 6: nearly normal, with a variance of 1.
    let mut normal = || (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0;
    let figures = [
        request(Kind::Distance, &[[0.0, 0.0, 0.0], [30.0, 5.0, -2.0]]),
        request(Kind::Angle, &[[20.0, 0.0, 0.0], [0.0; 3], [0.0, 25.0, 3.0]]),
        request(Kind::Area, &[[0.0, 0.0, 0.0], [20.0, 0.0, 0.0], [22.0, 18.0, 0.0], [1.0, 19.0, 0.0]]),
        request(
            Kind::Ellipsoid,
            &[
                [-15.0, 0.0, 0.0],
                [15.0, 0.0, 0.0],
                [0.0, -12.0, 0.0],
                [0.0, 12.0, 0.0],
                [0.0, 0.0, -9.0],
                [0.0, 0.0, 9.0],
            ],
        ),
    ];
    for figure in figures {
        let measured = measure(&figure, &UNCERTAINTY).unwrap();
        let rounds = 4000;
        let values: Vec<f64> = (0..rounds)
            .map(|_| {
                let points =
                    figure.points.iter().map(|place| place.point.map(|x| x + sigma * normal()).into()).collect();
                measure(&Request { points, ..figure.clone() }, &UNCERTAINTY).unwrap().value
            })
            .collect();
        let within = values.iter().filter(|value| (*value - measured.value).abs() <= measured.error).count();
        let share = within as f64 / f64::from(rounds);
        assert!((0.94..0.97).contains(&share), "{:?}: {share}", figure.kind);
        let parts = measured.of_calibration.unwrap().hypot(measured.of_sampling);
        assert!((parts - measured.error).abs() < 1e-12);
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
    let of = |points: Vec<Place>| measure(&Request { points, ..request(Kind::Distance, &[]) }, &UNCERTAINTY).unwrap();
    let ends = [[0.0; 3], [0.0, 0.0, 20.0]];
    let flat = of(places(&ends));
    let across = of(ends.map(|end| deep(end, DVec3::X, 3.0)).to_vec());
    assert!((across.error - flat.error).abs() < 1e-9 && across.of_calibration == flat.of_calibration);
    // Along the distance the depth adds a uniform distribution over its width.
    let along = of(ends.map(|end| deep(end, DVec3::Z, 3.0)).to_vec());
    let added = (along.of_sampling.powi(2) - flat.of_sampling.powi(2)).sqrt();
    assert!((added - 2.0 * (2.0 * 9.0 / 12.0_f64).sqrt()).abs() < 1e-9, "{added}");
    let wide = of(ends.map(|end| Place { pixel_mm: Some(2.0), ..end.into() }).to_vec());
    assert!(wide.of_sampling > flat.of_sampling, "a pixel of its own counts");
    // The reported error matches the spread where depth dominates.
    let mut random = ChaCha8Rng::seed_from_u64(11);
    let [calibration, sampling] = UNCERTAINTY.of_place(0.2);
    let sigma = calibration.hypot(sampling);
    let rays = [DVec3::new(0.6, 0.0, 0.8), DVec3::new(0.0, 0.6, 0.8), DVec3::new(0.6, 0.64, 0.48)];
    let points = [[20.0, 0.0, 0.0], [0.0; 3], [0.0, 25.0, 3.0]];
    for kind in [Kind::Angle, Kind::Area] {
        let figure: Vec<Place> = points.iter().zip(rays).map(|(point, ray)| deep(*point, ray, 5.0)).collect();
        let measured = measure(&Request { points: figure.clone(), ..request(kind, &[]) }, &UNCERTAINTY).unwrap();
        let mut uniform = || random.random::<f64>() - 0.5;
        let rounds = 4000;
        let within = (0..rounds).filter(|_| {
            let drawn = figure.iter().map(|place| {
                let blur = [0; 3].map(|_| sigma * (0..12).map(|_| uniform()).sum::<f64>());
                (DVec3::from_array(place.point) + DVec3::from_array(blur) + place.along() * 5.0 * uniform()).to_array()
            });
            let drawn: Vec<[f64; 3]> = drawn.collect();
            (measure(&request(kind, &drawn), &UNCERTAINTY).unwrap().value - measured.value).abs() <= measured.error
        });
        let share = within.count() as f64 / f64::from(rounds);
        assert!((0.94..0.985).contains(&share), "{kind:?}: {share}");
    }
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
fn unknown_accuracy_is_noted() {
    let points = [[0.0; 3], [10.0, 0.0, 0.0]];
    let known = measure(&request(Kind::Distance, &points), &UNCERTAINTY).unwrap();
    let blind = Uncertainty { calibration_mm: None, ..UNCERTAINTY };
    let unknown = measure(&request(Kind::Distance, &points), &blind).unwrap();
    assert!(unknown.of_calibration.is_none() && unknown.error < known.error);
    assert!(unknown.notes[0].contains("calibration"));
    let bent = [[0.0; 3], [10.0, 0.0, 0.0], [10.0, 10.0, 3.0], [0.0, 10.0, 0.0]];
    assert!(measure(&request(Kind::Area, &bent), &UNCERTAINTY).unwrap().notes[0].contains("off a plane"));
    let leaning =
        [[-5.0, 0.0, 0.0], [5.0, 0.0, 0.0], [-4.0, -4.0, 0.0], [4.0, 4.0, 0.0], [0.0, 0.0, -3.0], [0.0, 0.0, 3.0]];
    assert!(
        measure(&request(Kind::Ellipsoid, &leaning), &UNCERTAINTY).unwrap().notes[0].contains("45° from right angles")
    );
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
        assert_eq!(measure(&request, &UNCERTAINTY), Err(error));
    }
    let tilted = stack(vec![lifted(0.0, 0.0), lifted(3.0, 0.5)]);
    assert!(matches!(measure(&tilted, &UNCERTAINTY), Err(MeasureError::NotParallel { .. })));
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
