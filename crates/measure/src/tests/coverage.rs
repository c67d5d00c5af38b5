//! Monte Carlo: the reported interval holds the truth in 93 to 97 of 100 cases, for every kind of
//! figure, anywhere in the picture and across slices.

use glam::{DQuat, DVec3};

use super::bedside::{PIXEL_MM, Random, SIZE_PX, Session};
use super::{Figure, Kind, Measured, Place, Request, measure};

/// Draws for each kind.
const ROUNDS: u32 = 1500;

fn places(points: &[DVec3]) -> Vec<Place> {
    points.iter().map(|at| at.to_array().into()).collect()
}

fn measured(session: &Session, kind: Kind, points: &[DVec3]) -> Measured {
    let request = Request { kind, points: places(points), contours: Vec::new(), pixel_mm: PIXEL_MM };
    measure(&request, &session.uncertainty, &session.slices).unwrap()
}

/// Measures figures that `draw` makes; asserts that the interval holds the truth as often as it
/// says.
fn holds(kind: Kind, seed: u64, mut draw: impl FnMut(&Session, &mut Random) -> Vec<DVec3>) {
    let session = Session::new();
    let mut random = Random::new(seed);
    let mut within = 0;
    for _ in 0..ROUNDS {
        // At the edge of the sweep an error may move a place out of it.
        let (points, shown) = loop {
            let points = draw(&session, &mut random);
            let shown = session.shown(&points, &mut random);
            if session.reaches(&shown) {
                break (points, shown);
            }
        };
        let truth = Figure::new(kind, &places(&points)).unwrap().value();
        let measured = measured(&session, kind, &shown);
        assert!(measured.of_calibration.is_some() && measured.of_tracker.is_some(), "{:?}", measured.notes);
        within += u32::from((measured.value - truth).abs() <= measured.error);
    }
    let share = f64::from(within) / f64::from(ROUNDS);
    assert!((0.93..=0.97).contains(&share), "{kind:?} {seed}: {share}");
}

/// Returns places that all are reached, by a drawing that is repeated until they are.
fn reached(session: &Session, mut draw: impl FnMut() -> Vec<DVec3>) -> Vec<DVec3> {
    loop {
        let points = draw();
        if session.reaches(&points) {
            return points;
        }
    }
}

#[test]
fn interval_holds_lengths_within_one_slice() {
    holds(Kind::Distance, 1, |session, random| {
        loop {
            let slice = random.between(5.0, 145.0) as usize;
            let mut end = || session.pixel(slice, SIZE_PX.map(|n| random.between(0.0, f64::from(n) - 1.0)));
            let ends = [end(), end()];
            if (5.0..=80.0).contains(&ends[0].distance(ends[1])) {
                return ends.to_vec();
            }
        }
    });
}

#[test]
fn interval_holds_lengths_of_5_to_150_mm_across_slices() {
    holds(Kind::Distance, 2, |session, random| {
        // The length first: long ones are as frequent as short ones.
        let length = random.between(5.0, 150.0);
        reached(session, || {
            let start = session.anywhere(random);
            let sweep = if length > 60.0 { DVec3::Y * 3.0 } else { DVec3::ZERO };
            vec![start, start + (random.direction() + sweep).normalize() * length]
        })
    });
}

#[test]
fn interval_holds_angles() {
    holds(Kind::Angle, 3, |session, random| {
        loop {
            let points = reached(session, || {
                let vertex = session.anywhere(random);
                let mut arm = || vertex + random.direction() * random.between(10.0, 60.0);
                vec![arm(), vertex, arm()]
            });
            let angle = (points[0] - points[1]).angle_between(points[2] - points[1]).to_degrees();
            if (20.0..=160.0).contains(&angle) {
                return points;
            }
        }
    });
}

/// Returns points around a centre, in a plane across `normal`.
fn outline(centre: DVec3, normal: DVec3, radius: f64, sides: u32, random: &mut Random) -> Vec<DVec3> {
    let (x, y) = normal.any_orthonormal_pair();
    let corner = |n: u32| {
        let (sin, cos) = (f64::from(n) / f64::from(sides) * std::f64::consts::TAU).sin_cos();
        centre + (x * cos + y * sin) * (radius * random.between(0.8, 1.2))
    };
    (0..sides).map(corner).collect()
}

#[test]
fn interval_holds_areas() {
    holds(Kind::Area, 4, |session, random| {
        reached(session, || {
            let (centre, normal) = (session.anywhere(random), random.direction());
            outline(centre, normal, random.between(5.0, 20.0), 10, random)
        })
    });
}

#[test]
fn interval_holds_ellipsoid_volumes() {
    holds(Kind::Ellipsoid, 5, |session, random| {
        reached(session, || {
            let centre = session.anywhere(random);
            let turn = DQuat::from_axis_angle(random.direction(), random.between(0.0, 3.0));
            let mut ends = |axis: DVec3| {
                let half = turn * axis * random.between(5.0, 18.0);
                [centre - half, centre + half]
            };
            DVec3::AXES.map(&mut ends).concat()
        })
    });
}

#[test]
fn interval_holds_stack_volumes() {
    const SIDES: u32 = 12;
    let session = Session::new();
    let mut random = Random::new(6);
    let (mut within, mut rounds) = (0, 0);
    let stack = |points: &[DVec3]| points.chunks_exact(SIDES as usize).map(places).collect::<Vec<_>>();
    while rounds < ROUNDS / 2 {
        let points = reached(&session, || {
            let (centre, normal) = (session.anywhere(&mut random), random.direction());
            let (radius, step) = (random.between(12.0, 18.0), random.between(2.0, 4.0));
            (-3..=3)
                .flat_map(|n| outline(centre + normal * (step * f64::from(n)), normal, radius, SIDES, &mut random))
                .collect()
        });
        let (figure, _) = Figure::stack(stack(&points)).unwrap();
        // Both ends of the body are anywhere within a slab.
        let ends: f64 = figure.unsampled().iter().map(|sd| sd * random.between(-3.0_f64.sqrt(), 3.0_f64.sqrt())).sum();
        let truth = figure.value() + ends;
        let contours = stack(&session.shown(&points, &mut random));
        let request = Request { kind: Kind::Stack, points: Vec::new(), contours, pixel_mm: PIXEL_MM };
        // Contours that errors have tilted too far are refused.
        let Ok(measured) = measure(&request, &session.uncertainty, &session.slices) else { continue };
        rounds += 1;
        within += u32::from((measured.value - truth).abs() <= measured.error);
    }
    let share = f64::from(within) / f64::from(rounds);
    assert!((0.93..=0.97).contains(&share), "{share}");
}

#[test]
fn interval_holds_tiny_lengths_or_says_that_it_is_approximate() {
    let session = Session::new();
    let mut random = Random::new(7);
    for length in [0.5, 1.0, 2.0] {
        let (mut within, mut noted) = (0, 0);
        for _ in 0..ROUNDS {
            let points = reached(&session, || {
                let start = session.anywhere(&mut random);
                vec![start, start + random.direction() * length]
            });
            let measured = measured(&session, Kind::Distance, &session.shown(&points, &mut random));
            within += u32::from((measured.value - length).abs() <= measured.error);
            noted += u32::from(measured.notes.iter().any(|note| note.contains("approximate")));
        }
        let [share, noted] = [within, noted].map(|count| f64::from(count) / f64::from(ROUNDS));
        assert!(share >= 0.93, "{length}: {share}, noted {noted}");
    }
}
