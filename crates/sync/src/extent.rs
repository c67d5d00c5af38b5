//! The box that a recording's slices will reach, and their mean orientation, from the poses
//! before the first insertion.

use glam::DVec3;

use sonoweave_core::frames::{Transform, Volume, World};
use sonoweave_core::region::ClipRect;

use super::FramePose;

/// Slices beyond this many voxels from the lattice's origin are not inserted.
const FARTHEST: f64 = 1_073_741_824.0;
/// Margin around the box, voxels: a slice on the planar path may lie slightly beside its pose.
const MARGIN: f64 = 1.0;

/// Returns first and last voxel, both inclusive, of the smallest box that holds every slice's
/// data rectangle. Each slice is widened along u, v and normal by the kernel's supports (mm); a
/// margin of one voxel is added. Poses that are not finite or out of range are skipped; `None`
/// if none remains.
pub fn reached(
    poses: &[FramePose],
    data: ClipRect,
    supports_mm: [f64; 3],
    world_from_lattice: Transform<World, Volume>,
) -> Option<[[i64; 3]; 2]> {
    let lattice_from_world = world_from_lattice.affine().inverse();
    let ends = |first: u32, count: u32| [f64::from(first), f64::from(first) + f64::from(count) - 1.0];
    let (us, vs) = (ends(data.x, data.width), ends(data.y, data.height));
    let mut bounds: Option<[DVec3; 2]> = None;
    for pose in poses {
        let to_world = pose.world_from_image;
        let (u, v) = (to_world.vector(DVec3::X).normalize_or_zero(), to_world.vector(DVec3::Y).normalize_or_zero());
        let reach = [u * supports_mm[0], v * supports_mm[1], u.cross(v).normalize_or_zero() * supports_mm[2]];
        // Bounding box of an oblique box: along each lattice axis the half edges add up.
        let wide = reach.map(|r| lattice_from_world.transform_vector3(r).abs()).iter().sum::<DVec3>();
        let corners = [[us[0], vs[0]], [us[1], vs[0]], [us[0], vs[1]], [us[1], vs[1]]]
            .map(|[u, v]| lattice_from_world.transform_point3(to_world.point(DVec3::new(u, v, 0.0))));
        let low = corners.iter().fold(corners[0], |low, c| low.min(*c)) - wide;
        let high = corners.iter().fold(corners[0], |high, c| high.max(*c)) + wide;
        let placed = corners.iter().all(|c| c.is_finite()) && low.abs().max(high.abs()).max_element() < FARTHEST;
        if placed {
            let [l, h] = bounds.unwrap_or([low, high]);
            bounds = Some([l.min(low), h.max(high)]);
        }
    }
    bounds.map(|[low, high]| {
        [(low - MARGIN).floor(), (high + MARGIN).ceil()].map(|corner| corner.to_array().map(|x| x as i64))
    })
}

/// Returns the slices' mean directions of u (to the right in the image) and v (away from the
/// probe), world frame, of length 1 and perpendicular. `None` if the slices differ too much for
/// a mean.
pub fn mean_axes(poses: &[FramePose]) -> Option<[DVec3; 2]> {
    /// Least length of the mean of unit vectors. It is 1 if all are equal, and 0.5 if they lie
    /// 60 degrees to both sides.
    const SHORTEST: f64 = 0.5;
    let (mut us, mut vs, mut count) = (DVec3::ZERO, DVec3::ZERO, 0.0);
    for pose in poses {
        let [u, v] = [DVec3::X, DVec3::Y].map(|axis| pose.world_from_image.vector(axis).normalize_or_zero());
        if u.is_finite() && v.is_finite() {
            us += u;
            vs += v;
            count += 1.0;
        }
    }
    let lasts = |sum: DVec3| sum.length() > SHORTEST * count;
    if !(lasts(us) && lasts(vs)) {
        return None;
    }
    let v = vs.normalize();
    let u = us - v * us.dot(v);
    // If u is nearly along v, the slices are skewed beyond use.
    (u.length() > 1e-3 * count).then(|| [u.normalize(), v])
}

#[cfg(test)]
mod tests {
    use glam::{DAffine3, DMat3, DQuat};
    use sonoweave_core::frames::Image;

    use super::*;

    fn pose(affine: DAffine3) -> FramePose {
        FramePose {
            item: 0,
            time_ns: 0,
            size: [100, 80],
            world_from_image: Transform::<World, Image>::from_affine(affine),
        }
    }

    fn lattice(spacing: f64) -> Transform<World, Volume> {
        Transform::from_affine(DAffine3::from_scale(DVec3::splat(spacing)))
    }

    #[test]
    fn box_holds_data_and_kernel_support() {
        // Pixels of 0.2 mm, the slice across z at 5 mm; columns 10 to 29, rows 20 to 59: 2 to
        // 5.8 and 4 to 11.8 mm.
        let scale = DMat3::from_diagonal(DVec3::new(0.2, 0.2, 1.0));
        let flat = DAffine3 { matrix3: scale, translation: DVec3::new(0.0, 0.0, 5.0) };
        let data = ClipRect::new(10, 20, 20, 40).unwrap();
        let found = reached(&[pose(flat)], data, [0.6, 1.1, 2.6], lattice(0.5)).unwrap();
        // 1.4..6.4, 2.9..12.9, 2.4..7.6 mm in half millimetres, and one more voxel.
        assert_eq!(found, [[1, 4, 3], [14, 27, 17]]);
        // Turned by a right angle about x: rows go along z, the normal along −y.
        let turned = DAffine3::from_quat(DQuat::from_rotation_x(std::f64::consts::FRAC_PI_2)) * flat;
        let found = reached(&[pose(flat), pose(turned)], data, [0.6, 1.1, 2.6], lattice(0.5)).unwrap();
        assert_eq!(found, [[1, -17, 3], [14, 27, 27]]);
    }

    #[test]
    fn non_finite_or_far_poses_skipped() {
        let data = ClipRect::new(0, 0, 11, 11).unwrap();
        let far = DAffine3::from_translation(DVec3::splat(1e12));
        let lost = DAffine3::from_translation(DVec3::splat(f64::NAN));
        let here = reached(&[pose(DAffine3::IDENTITY)], data, [0.0; 3], lattice(1.0));
        assert_eq!(here, Some([[-1; 3], [11, 11, 1]]));
        assert_eq!(reached(&[pose(far), pose(DAffine3::IDENTITY), pose(lost)], data, [0.0; 3], lattice(1.0)), here);
        assert_eq!(reached(&[pose(far)], data, [0.0; 3], lattice(1.0)), None);
    }

    #[test]
    fn mean_axes_only_for_similar_slices() {
        let turned = |degrees: f64| pose(DAffine3::from_quat(DQuat::from_rotation_x(degrees.to_radians())));
        let [u, v] = mean_axes(&[turned(80.0), turned(100.0)]).unwrap();
        assert!((u - DVec3::X).length() < 1e-12 && (v - DVec3::Z).length() < 1e-12, "{u} {v}");
        assert_eq!(mean_axes(&[turned(0.0), turned(180.0)]), None);
        assert_eq!(mean_axes(&[]), None);
        let skewed = DMat3::from_cols(DVec3::Y, DVec3::Y, DVec3::Z);
        assert_eq!(mean_axes(&[pose(DAffine3 { matrix3: skewed, translation: DVec3::ZERO })]), None);
    }
}
