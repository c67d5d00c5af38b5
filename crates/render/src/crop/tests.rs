use std::sync::atomic::{AtomicU64, Ordering};

use fastrand::Rng;
use glam::{DAffine3, DMat3, DVec3};
use volume::Values;
use volume::brick::{BrickIndex, EDGE, VOXELS};

use super::shape::Shape;
use super::*;

/// Returns an operation of a random kind near the origin, some tens of mm large.
pub(in crate::crop) fn any(rng: &mut Rng) -> Operation {
    let mut point = |reach: f64| [0; 3].map(|_| reach * (2.0 * rng.f64() - 1.0));
    let (a, b, c) = (point(15.0), point(15.0), point(1.0));
    let size = point(10.0).map(|x| 4.0 + x.abs());
    match rng.u8(0..5) {
        0 => Operation::OutsideBox { low: a, high: std::array::from_fn(|k| a[k] + 2.0 * size[k]) },
        1 => Operation::BeyondPlane { point: a, normal: c },
        2 => Operation::Ball { centre: a, radius: size[0] },
        3 => {
            let heights = [0; 3].map(|_| [0; 3].map(|_| 8.0 * rng.f64() - 4.0));
            Operation::BeforeSurface { origin: a, across: b, along: [b[1], -b[0], c[2] * 9.0], heights }
        }
        _ => Operation::Lasso {
            origin: a,
            right: b,
            down: c,
            eye: rng.bool().then(|| 20.0 + 40.0 * rng.f64()),
            outline: (0..rng.usize(3..9)).map(|_| [0; 2].map(|_| 30.0 * rng.f64() - 15.0)).collect(),
            outside: rng.bool(),
            depth: rng.bool().then(|| 20.0 * rng.f64() - 10.0),
        },
    }
}

fn shape(operation: &Operation) -> Shape {
    Crop::new(vec![operation.clone()]).unwrap();
    Shape::new(operation).unwrap()
}

#[test]
fn balls_agree_with_all_their_points() {
    let mut rng = Rng::with_seed(1);
    let mut decided = [0; 2];
    for _ in 0..400 {
        let operation = any(&mut rng);
        let shape = shape(&operation);
        for _ in 0..20 {
            let centre = DVec3::from([0; 3].map(|_| 80.0 * rng.f64() - 40.0));
            let radius = 0.5 + 8.0 * rng.f64();
            let Some(all) = shape.hides_ball(centre, radius) else { continue };
            decided[usize::from(all)] += 1;
            for _ in 0..50 {
                let beside = DVec3::from([0; 3].map(|_| 2.0 * rng.f64() - 1.0)).normalize_or_zero();
                let at = centre + radius * rng.f64().cbrt() * beside;
                assert_eq!(shape.hides(at), all, "{operation:?}: {at} of a ball about {centre}");
            }
        }
    }
    assert!(decided.iter().all(|n| *n > 1000), "{decided:?}");
}

#[test]
fn shapes_hide_what_their_numbers_say() {
    let hides = |operation: Operation, at: [f64; 3]| shape(&operation).hides(at.into());
    let cube = Operation::OutsideBox { low: [0.0; 3], high: [2.0, 3.0, 4.0] };
    assert!(!hides(cube.clone(), [2.0, 0.0, 4.0]) && hides(cube, [2.1, 1.0, 1.0]));
    let plane = Operation::BeyondPlane { point: [1.0, 0.0, 0.0], normal: [5.0, 0.0, 0.0] };
    assert!(!hides(plane.clone(), [1.0, 9.0, 9.0]) && hides(plane, [1.01, 9.0, 9.0]));
    let ball = Operation::Ball { centre: [1.0; 3], radius: 2.0 };
    assert!(hides(ball.clone(), [1.0, 1.0, 2.9]) && !hides(ball, [1.0, 1.0, 3.0]));
    // Heights 0, 0, 2 along x: a parabola of 0.75 at three quarters; constant along y.
    let heights = [[0.0, 0.0, 2.0]; 3];
    let surface = |at| {
        let (origin, across, along) = ([0.0; 3], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0]);
        hides(Operation::BeforeSurface { origin, across, along, heights }, at)
    };
    assert!(surface([3.0, 1.0, 0.74]) && !surface([3.0, 1.0, 0.76]));
    assert!(surface([9.0, -5.0, 1.99]) && !surface([9.0, -5.0, 2.01]), "its border continues");
    // From above: the picture's right is x, down is y, and so the depth is z.
    let lasso = |eye, outside, depth, at| {
        let outline = vec![[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
        let (right, down) = ([2.0, 0.0, 0.0], [0.0, 3.0, 0.0]);
        hides(Operation::Lasso { origin: [0.0; 3], right, down, eye, outline, outside, depth }, at)
    };
    assert!(lasso(None, false, None, [0.9, -0.9, 99.0]) && !lasso(None, false, None, [1.1, 0.0, 0.0]));
    assert!(lasso(None, true, None, [1.1, 0.0, 0.0]) && !lasso(None, false, Some(5.0), [0.0, 0.0, 5.1]));
    // Twice as far from the eye, the outline is twice as large; behind the eye there is none.
    assert!(lasso(Some(10.0), false, None, [1.9, 0.0, 10.0]) && !lasso(Some(10.0), false, None, [2.1, 0.0, 10.0]));
    assert!(!lasso(Some(10.0), true, None, [0.0, 0.0, -11.0]));
}

/// A volume all of which was seen, which counts readings.
#[derive(Default)]
struct Full(AtomicU64);

impl Values for Full {
    fn values(&self, start: [i64; 3], value: &mut [f32], weight: &mut [f32]) {
        self.0.fetch_add(1, Ordering::Relaxed);
        for (x, (value, weight)) in (0..).zip(value.iter_mut().zip(weight)) {
            (*value, *weight) = ((start[0] + x + 7 * start[1] + 31 * start[2]) as f32, 1.0);
        }
    }

    fn bricks(&self) -> Box<dyn Iterator<Item = BrickIndex> + '_> {
        Box::new(std::iter::empty())
    }
}

#[test]
fn hidden_voxels_are_unseen_and_hidden_bricks_not_read() {
    let lattice = DAffine3 {
        matrix3: DMat3::from_rotation_y(0.3) * DMat3::from_diagonal(DVec3::new(0.5, 0.6, 0.4)),
        translation: DVec3::new(-3.0, 1.0, 2.0),
    };
    let mut rng = Rng::with_seed(2);
    let (mut hidden, mut unread) = (0, 0);
    for _ in 0..60 {
        let operations: Vec<Operation> = (0..rng.usize(1..4)).map(|_| any(&mut rng)).collect();
        let crop = LatticeCrop::new(&operations, lattice);
        let shapes: Vec<Shape> = operations.iter().map(shape).collect();
        for _ in 0..20 {
            let block = [0; 3].map(|_| rng.i32(-6..6));
            let full = Full::default();
            let (mut value, mut weight) = ([1.0; VOXELS], [1.0; VOXELS]);
            Cropped::new(&full, &crop).brick(block, &mut value, &mut weight);
            let (mut all, mut ones) = ([0.0; VOXELS], [0.0; VOXELS]);
            full.brick(block, &mut all, &mut ones);
            unread += u64::from(full.0.load(Ordering::Relaxed) == (EDGE * EDGE) as u64);
            let start = block.map(|b| i64::from(b) * EDGE as i64);
            for place in 0..VOXELS {
                let inside = [place % EDGE, place / EDGE % EDGE, place / (EDGE * EDGE)];
                let voxel: [i64; 3] = std::array::from_fn(|a| start[a] + inside[a] as i64);
                let at = lattice.transform_point3(DVec3::from(voxel.map(|x| x as f64)));
                let is_hidden = shapes.iter().any(|shape| shape.hides(at));
                hidden += u64::from(is_hidden);
                let expected = if is_hidden { (0.0, 0.0) } else { (all[place], 1.0) };
                assert_eq!((value[place], weight[place]), expected, "{operations:?}: {voxel:?}");
            }
            assert!(crop.reaches(block) || weight == [1.0; VOXELS]);
            let (mut line, mut seen) = ([0.0; 5], [0.0; 5]);
            Cropped::new(&full, &crop).values([start[0] + 2, start[1], start[2]], &mut line, &mut seen);
            assert_eq!((line, seen), (value[2..7].try_into().unwrap(), weight[2..7].try_into().unwrap()));
        }
    }
    assert!(hidden > 100_000 && unread > 100, "{hidden} voxels hidden, {unread} bricks not read");
}

#[test]
fn operations_are_undone_and_shown_again() {
    let ball = |radius| Operation::Ball { centre: [0.0; 3], radius };
    let crop = Crop::new(vec![ball(1.0), ball(2.0), Operation::Nothing {}, ball(3.0)]).unwrap();
    assert_eq!((crop.operations().len(), crop.present()), (4, &[ball(3.0)][..]));
    let undone = crop.undone().unwrap().undone().unwrap();
    assert_eq!(undone.present(), [ball(1.0), ball(2.0)]);
    assert_eq!(undone.with(ball(4.0)).unwrap().present().len(), 3);
    assert_eq!(undone.differing(&undone.with(ball(4.0)).unwrap()), [&[][..], &[ball(4.0)]]);
    assert_eq!(Crop::default().undone(), None);
}

#[test]
fn impossible_operations_are_refused() {
    let nan = [f64::NAN, 0.0, 0.0];
    let square = vec![[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]];
    let lasso = |right, eye, outline| Operation::Lasso {
        origin: [0.0; 3],
        right,
        down: [0.0, 1.0, 0.0],
        eye,
        outline,
        outside: false,
        depth: None,
    };
    for (operation, says) in [
        (Operation::OutsideBox { low: [0.0; 3], high: [1.0, 0.0, 1.0] }, "low below that of high"),
        (Operation::OutsideBox { low: nan, high: [1.0; 3] }, "finite"),
        (Operation::BeyondPlane { point: [0.0; 3], normal: [0.0; 3] }, "a normal that is not 0"),
        (Operation::Ball { centre: [0.0; 3], radius: 0.0 }, "a radius above 0"),
        (Operation::Ball { centre: nan, radius: 1.0 }, "finite centre"),
        (
            Operation::BeforeSurface {
                origin: [0.0; 3],
                across: [1.0, 0.0, 0.0],
                along: [2.0, 0.0, 0.0],
                heights: [[0.0; 3]; 3],
            },
            "edges that are not parallel",
        ),
        (lasso([0.0, 2.0, 0.0], None, square.clone()), "not parallel"),
        (lasso([1.0, 0.0, 0.0], Some(0.0), square.clone()), "an eye before it"),
        (lasso([1.0, 0.0, 0.0], None, square[..2].to_vec()), "3 to 512 corners"),
    ] {
        let good = Operation::Ball { centre: [0.0; 3], radius: 1.0 };
        let refused = Crop::new(vec![good, operation]).unwrap_err().to_string();
        assert!(refused.starts_with("operation 2 of the crop: ") && refused.contains(says), "{refused}");
    }
    let many = Crop::new(vec![Operation::Nothing {}; MOST_OPERATIONS]).unwrap();
    assert!(many.with(Operation::Nothing {}).unwrap_err().to_string().contains("1000 operations at most"));
}
