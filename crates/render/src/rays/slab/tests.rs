use glam::{DAffine3, DMat3, DVec3};

use sonoweave_core::frames::Transform;
use volume::Prism;

use super::*;
use crate::RenderRegion;
use crate::camera::View;

const LAST: i64 = 39;

fn region() -> RenderRegion {
    let turned = DMat3::from_rotation_z(0.3) * DMat3::from_rotation_x(-0.5);
    let affine = DAffine3 {
        matrix3: turned * DMat3::from_diagonal(DVec3::new(0.5, 0.6, 0.7)),
        translation: DVec3::new(5.0, -3.0, 40.0),
    };
    RenderRegion::new(Transform::from_affine(affine), [0; 3], [LAST; 3]).unwrap()
}

/// Returns a prism about a position in the region, given half its extent along each of its axes.
fn prism(centre: DVec3, axes: [DVec3; 3], half: [f64; 3]) -> Prism {
    Prism::between(axes.map(|axis| (-axis.dot(centre), axis)), half.map(|h| [-h, h])).unwrap()
}

/// Returns whether a sample can change with the voxels in a prism: it lies in the cell of one of
/// them, or of a neighbour across a face.
fn changes(at: DVec3, prism: &Prism) -> bool {
    let floor = at.floor().to_array().map(|x| x as i64);
    (0..8_usize).any(|corner| {
        let voxel: [i64; 3] = std::array::from_fn(|a| floor[a] + (corner >> a & 1) as i64);
        let weighs = (0..3).all(|a| (at[a] - voxel[a] as f64).abs() < 1.0);
        let beside = |axis: usize, step: i64| {
            let mut v = voxel;
            v[axis] += step;
            prism.holds(v, 0.0)
        };
        weighs && (prism.holds(voxel, 0.0) || (0..3).any(|a| beside(a, -1) || beside(a, 1)))
    })
}

/// Checks every pixel's interval against each of its samples. Returns the numbers of changed
/// samples, and of pixels marked without any changed sample.
fn check(view: View, prism: &Prism) -> [usize; 2] {
    let region = region();
    let camera = Camera::new(&view, [37, 31], 0.8, &region).unwrap();
    let rays = ViewRays::new(&camera);
    let body = Body::<6>::new(&rays, &prism.faces.map(reached));
    let clip = prism.faces.map(reached);
    let (mut changed, mut outline) = (0, 0);
    for j in 0..31 {
        let row = body.row(j);
        let [left, right] = row.columns([0, 36]);
        for i in 0..37 {
            let ray = camera.ray(i, j);
            let in_columns = (left..=right).contains(&i64::from(i));
            let [from, to] = match in_columns {
                true => whole(row.samples(&rays, i), [0, camera.samples()], 0),
                false => [0, 0],
            };
            let at = |k: u32| ray.base + ray.step * f64::from(k);
            let in_clip = |k: &u32| clip.iter().all(|f| (f.low..=f.high).contains(&f.normal.dot(at(*k))));
            let exact = (0..camera.samples()).filter(in_clip).count();
            assert!((to - from) as usize <= exact + 2, "{view:?} {i} {j}: {from}..{to}, of which {exact} are inside");
            let mut any = false;
            for k in (0..camera.samples()).filter(|k| changes(at(*k), prism)) {
                assert!((from..to).contains(&k), "{view:?} {i} {j}: sample {k} of {from}..{to}");
                any = true;
                changed += 1;
            }
            outline += usize::from(!any && from < to);
        }
    }
    [changed, outline]
}

#[test]
fn intervals_hold_changed_samples_and_at_most_two_more() {
    let centre = DVec3::splat(0.5 * LAST as f64 + 8.0);
    let oblique = DMat3::from_rotation_y(0.7) * DMat3::from_rotation_z(0.4);
    let axes = [oblique.x_axis, oblique.y_axis, oblique.z_axis];
    let straight = [DVec3::X, DVec3::Y, DVec3::Z];
    for perspective in [None, Some(50.0)] {
        for (azimuth, elevation) in [(0.0, 0.0), (90.0, 0.0), (0.0, 90.0), (33.0, 21.0), (200.0, -40.0)] {
            let view = View { azimuth, elevation, roll: 7.0, perspective, turns: false, ..View::default() };
            for (axes, half) in [(axes, [12.0, 9.0, 1.7]), (straight, [15.0, 15.0, 2.0]), (axes, [0.2, 0.2, 0.2])] {
                // Several places, so that the smallest prism holds a voxel somewhere.
                let [changed, _] = check(view, &prism(centre.floor(), axes, half));
                assert!(changed > 5, "{view:?}: {changed}");
            }
        }
    }
}

#[test]
fn slab_viewed_edge_on_is_line_of_pixels() {
    let centre = DVec3::splat(0.5 * LAST as f64 + 8.0);
    for perspective in [None, Some(40.0)] {
        let view = View { azimuth: 25.0, elevation: 10.0, perspective, ..View::default() };
        let camera = Camera::new(&view, [37, 31], 0.8, &region()).unwrap();
        let (ray, [right, down]) = camera.first_ray();
        // The plane of the rays of the middle column, in which the eye lies.
        let middle = camera.ray(18, 15);
        let normal = down.cross(middle.step).normalize();
        let along = middle.step.normalize();
        let across = normal.cross(along);
        let slab = |centre: DVec3, half: f64| prism(centre, [along, across, normal], [60.0, 14.0, half]);
        let [changed, _] = check(view, &slab(middle.base + middle.step * 30.0, 1.5));
        assert!(changed > 300, "{changed}");
        // Beside the eye, and around it.
        let aside = normal * (4.0 * normal.dot(right).signum());
        assert!(check(view, &slab(middle.base + middle.step * 30.0 + aside, 1.5))[0] > 300);
        assert!(check(view, &prism(ray.base, [along, across, normal], [200.0, 30.0, 8.0]))[0] > 300);
        // There is nothing behind the eye or beyond the picture.
        let behind = ray.base - (centre - ray.base);
        assert!(perspective.is_none() || check(view, &prism(behind, [along, across, normal], [3.0; 3])) == [0, 0]);
        assert_eq!(check(view, &prism(centre + across * 500.0, [along, across, normal], [9.0; 3])), [0, 0]);
    }
}

#[test]
fn only_pixels_in_outline_are_tested() {
    let centre = DVec3::splat(0.5 * LAST as f64 + 8.0);
    let camera = Camera::new(&View::default(), [64, 64], 1.0, &region()).unwrap();
    let rays = ViewRays::new(&camera);
    let small = prism(centre, [DVec3::X, DVec3::Y, DVec3::Z], [2.0; 3]);
    let body = Body::<6>::new(&rays, &small.faces.map(reached));
    let mut tested = 0;
    for j in 0..64 {
        let row = body.row(j);
        let [first, last] = row.columns([0, 63]);
        // Within the outline, each ray meets the body.
        for i in first..=last {
            let [from, to] = row.samples(&rays, i as u32);
            assert!(from <= to + 1e-3, "{i} {j}: {from} {to}");
            tested += 1;
        }
    }
    assert!((20..700).contains(&tested), "{tested}");
}
