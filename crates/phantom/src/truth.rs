//! Truth volumes: a scene at a grid's voxel centres, the grid that covers a scan, and the
//! voxels that a scan can know.

use glam::{DMat3, DVec3};
use rayon::prelude::*;

use volume::Grid;

use super::PhantomError;
pub use super::grid::covering_grid;
use super::grid::voxels;
use super::paint::{Painter, Sheet};
use super::scan::Scan;
use super::scene::{Scene, isotropic_variance};

/// Samples the scene at the voxel centres of a grid, grey levels, x fastest. A moving scene is
/// sampled at time 0; see [`Scene::at_time`].
///
/// # Errors
/// [`PhantomError::VolumeSize`] beyond 2³⁰ voxels.
pub fn sample(scene: &Scene, grid: &Grid) -> Result<Vec<f32>, PhantomError> {
    let painter = Painter::new(scene.clone());
    let affine = grid.world_from_volume().affine();
    by_layer(grid, |z, layer| {
        let sheet = Sheet {
            origin: affine.translation + affine.matrix3.z_axis * z as f64,
            step_u: affine.matrix3.x_axis,
            step_v: affine.matrix3.y_axis,
            width: grid.size[0] as usize,
            height: grid.size[1] as usize,
        };
        let mut grey = vec![0.0; layer.len()];
        painter.paint(&sheet, &mut grey);
        for (voxel, value) in layer.iter_mut().zip(grey) {
            *voxel = value as f32;
        }
    })
}

/// Samples the scene convolved with a Gaussian of the given covariance (mm², world axes) at the
/// voxel centres of a grid, x fastest. This is the result of a perfect reconstruction with that
/// kernel. `None` if the scene has no closed form under that blur (see [`Scene::blurred`]).
///
/// # Errors
/// [`PhantomError::VolumeSize`] beyond 2³⁰ voxels.
pub fn sample_blurred(scene: &Scene, grid: &Grid, covariance: &DMat3) -> Result<Option<Vec<f32>>, PhantomError> {
    if let Some(variance) = isotropic_variance(covariance) {
        return scene.softened(variance.max(0.0).sqrt()).map(|scene| sample(&scene, grid)).transpose();
    }
    if scene.blurred(grid.origin, covariance).is_none() {
        return Ok(None);
    }
    let world_from_volume = grid.world_from_volume();
    let [nx, ny, _] = grid.size.map(|n| n as usize);
    by_layer(grid, |z, layer| {
        for (k, voxel) in layer.iter_mut().enumerate() {
            let index = DVec3::new((k % nx) as f64, (k / nx % ny) as f64, z as f64);
            let value = scene.blurred(world_from_volume.point(index), covariance);
            // The existence of a closed form does not depend on the position.
            *voxel = value.map_or(f32::NAN, |v| v as f32);
        }
    })
    .map(Some)
}

/// Returns the voxels of a grid that a scan can know, x fastest. Their centres lie within
/// `reach_mm` of some slice's plane and, projected onto it, inside its image: between the
/// outermost pixels' centres, at a pixel of the fan. The slices have their true poses.
///
/// # Errors
/// [`PhantomError`] beyond 2³⁰ voxels, and if the reach is not positive.
pub fn near_slices(scan: &Scan, grid: &Grid, reach_mm: f64) -> Result<Vec<bool>, PhantomError> {
    PhantomError::check_length("the reach around slices", reach_mm)?;
    let [width, height] = scan.settings().image_size;
    let world_from_volume = grid.world_from_volume();
    let image_from_volume: Vec<_> =
        (0..scan.frames()).map(|f| scan.true_world_from_image(f).inverse() * world_from_volume).collect();
    let [nx, ny, _] = grid.size.map(|n| n as f64);
    let last = [width, height].map(|n| f64::from(n - 1));
    let is_data = |u: f64, v: f64| scan.mask().contains((u + 0.5).floor() as u32, (v + 0.5).floor() as u32);
    by_layer(grid, |z, layer: &mut [bool]| {
        for to_image in &image_from_volume {
            // The plane distance is linear: a layer with all corners beyond one side is out of
            // reach.
            let at = |x: f64, y: f64| to_image.point(DVec3::new(x, y, z as f64));
            let distances =
                [(0.0, 0.0), (nx - 1.0, 0.0), (0.0, ny - 1.0), (nx - 1.0, ny - 1.0)].map(|(x, y)| at(x, y).z);
            if distances.iter().all(|d| *d > reach_mm) || distances.iter().all(|d| *d < -reach_mm) {
                continue;
            }
            let columns = grid.size[0] as usize;
            for (k, seen) in layer.iter_mut().enumerate().filter(|(_, seen)| !**seen) {
                let p = at((k % columns) as f64, (k / columns) as f64);
                *seen = p.z.abs() <= reach_mm
                    && (0.0..=last[0]).contains(&p.x)
                    && (0.0..=last[1]).contains(&p.y)
                    && is_data(p.x, p.y);
            }
        }
    })
}

/// Fills a volume layer by layer in parallel. Each layer belongs to one task, so that the
/// number of threads does not affect the result.
pub(super) fn by_layer<T: Default + Clone + Send>(
    grid: &Grid,
    fill: impl Fn(usize, &mut [T]) + Sync,
) -> Result<Vec<T>, PhantomError> {
    let mut volume = vec![T::default(); voxels(grid)?];
    let layer = (grid.size[0] * grid.size[1]) as usize;
    volume.par_chunks_exact_mut(layer.max(1)).enumerate().for_each(|(z, voxels)| fill(z, voxels));
    Ok(volume)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::corners;
    use crate::scene::Blobs;
    use crate::{Motion, ScanSettings};
    use glam::DQuat;

    fn turned_grid() -> Grid {
        Grid {
            origin: DVec3::new(-14.0, -12.0, -9.0),
            spacing: DVec3::new(0.9, 1.1, 1.3),
            direction: DMat3::from_quat(DQuat::from_euler(glam::EulerRot::ZYX, 0.2, 0.1, -0.3)),
            size: [21, 17, 13],
        }
    }

    fn centre(grid: &Grid, k: usize) -> DVec3 {
        let [nx, ny, _] = grid.size.map(|n| n as usize);
        grid.world_from_volume().point(DVec3::new((k % nx) as f64, (k / nx % ny) as f64, (k / nx / ny) as f64))
    }

    #[test]
    fn truth_equals_scene_at_voxel_centres() {
        let grid = turned_grid();
        for scene in [Scene::Blobs(Blobs::draw(4)), Scene::standard_ramp(), Scene::standard_sphere()] {
            let truth = sample(&scene, &grid).unwrap();
            assert_eq!(truth.len(), 21 * 17 * 13);
            for (k, value) in truth.iter().enumerate() {
                assert!((f64::from(*value) - scene.value(centre(&grid, k))).abs() < 1e-4);
            }
        }
    }

    #[test]
    fn blurred_truth_is_closed_form_or_none() {
        let grid = turned_grid();
        let oblong = DMat3::from_diagonal(DVec3::new(0.2, 0.3, 1.0));
        let scene = Scene::Blobs(Blobs::draw(4));
        assert_eq!(sample_blurred(&scene, &grid, &oblong).unwrap(), None);
        let no_sphere = Scene::Blobs(Blobs { sphere: None, ..Blobs::draw(4) });
        let round = DMat3::from_diagonal(DVec3::splat(0.5));
        for (scene, covariance) in [(no_sphere, oblong), (scene, round)] {
            let truth = sample_blurred(&scene, &grid, &covariance).unwrap().unwrap();
            for (k, value) in truth.iter().enumerate() {
                let expected = scene.blurred(centre(&grid, k), &covariance).unwrap();
                assert!((f64::from(*value) - expected).abs() < 1e-4);
            }
        }
    }

    #[test]
    fn grid_covers_slices_on_lattice_through_origin() {
        let scan =
            Scan::new(ScanSettings { frames: 20, image_size: [64, 48], pixel_mm: [0.4; 2], ..Default::default() });
        let scan = scan.unwrap();
        let spacing = DVec3::new(0.5, 0.7, 0.9);
        for margin in [0.0, 2.0] {
            let grid = scan.grid(spacing, margin).unwrap();
            let index = grid.origin / spacing;
            assert!((index - index.round()).abs().max_element() < 1e-9);
            let end = grid.origin + spacing * DVec3::from_array(grid.size.map(|n| (n - 1) as f64));
            let corners: Vec<DVec3> = (0..20).flat_map(|f| corners(&scan.world_from_image(f), [64, 48])).collect();
            let low = corners.iter().copied().reduce(DVec3::min).unwrap() - margin;
            let high = corners.iter().copied().reduce(DVec3::max).unwrap() + margin;
            // The grid lies inside the margin, and the next lattice point on each side does
            // not.
            assert!(grid.origin.cmpge(low - 1e-9).all() && end.cmple(high + 1e-9).all());
            assert!((grid.origin - spacing).cmplt(low).all() && (end + spacing).cmpgt(high).all());
        }
        assert!(scan.grid(DVec3::splat(1e-4), 0.0).unwrap_err().to_string().contains("coarser"));
        assert!(scan.grid(DVec3::new(0.5, 0.0, 0.5), 0.0).is_err());
        assert!(covering_grid([], DVec3::ONE, 0.0).is_err());
    }

    #[test]
    fn near_voxels_lie_within_reach_inside_image_and_fan() {
        use crate::scan::convex_fan;
        for (motion, fan) in [(Motion::Parallel, None), (Motion::Freehand, Some(convex_fan([41, 31]).unwrap()))] {
            let settings = ScanSettings {
                motion,
                fan,
                frames: 5,
                gap_mm: 2.0,
                image_size: [41, 31],
                pixel_mm: [0.5; 2],
                ..Default::default()
            };
            let scan = Scan::new(settings).unwrap();
            let grid = scan.grid(DVec3::splat(0.5), 1.0).unwrap();
            let near = near_slices(&scan, &grid, 0.26).unwrap();
            for (k, near) in near.iter().enumerate() {
                let p = centre(&grid, k);
                let expected = (0..5).any(|f| {
                    let q = scan.world_from_image(f).inverse().point(p);
                    let inside = q.z.abs() <= 0.26 && (0.0..=40.0).contains(&q.x) && (0.0..=30.0).contains(&q.y);
                    inside && scan.mask().contains(q.x.round() as u32, q.y.round() as u32)
                });
                assert_eq!(*near, expected, "voxel {k}");
            }
            assert!(near.iter().any(|n| *n) && near.iter().any(|n| !*n));
        }
    }
}
