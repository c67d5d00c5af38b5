//! The small scan of [`weights`](crate::weights), inserted by the reconstructor's own two paths.
//! A voxel is 1 mm.

use std::error::Error;
use std::sync::Arc;

use glam::{DAffine3, DMat3, DVec3};

use mask::Mask;
use reconstruct::kernel::{Method, Support};
use reconstruct::planar::{OnDeparture, PlanarSettings};
use reconstruct::{PathReconstructor, Settings, SettingsError};
use sonoweave_core::frames::Transform;
use sonoweave_core::slice::{Image, Pixels, Slice};

use crate::reconstructed_volumes::value;
use crate::weights::{AT, Coverage, FINE, SIGMA, SIZE, scene};

/// Pixel spacing, and position of the first pixel.
const PIXEL: f64 = 1.0 / FINE as f64;
const FIRST: f64 = -0.5 * PIXEL;

fn settings() -> Settings {
    Settings {
        method: Method::GaussianTruncated,
        sigma_mm: [Some(SIGMA); 3],
        support: [Some(Support::Energy(0.01)); 2],
        ..Settings::new(DVec3::ONE)
    }
}

/// Returns the number of pixels along u and v.
fn pixels() -> [u32; 2] {
    let [_, ny, nz] = SIZE;
    [nz, ny].map(|n| (n * FINE) as u32)
}

/// Returns one mask for all slices. Regions that only some slices see have no mask.
fn mask(coverage: Coverage) -> Mask {
    let [width, height] = pixels();
    let at = |pixel: u32| FIRST + PIXEL * f64::from(pixel);
    Mask::from_fn(width, height, |u, v| coverage.holds(0, at(u), at(v)))
}

fn planar(on_departure: OnDeparture) -> PlanarSettings {
    PlanarSettings { direction: Some(DMat3::IDENTITY), on_departure, ..PlanarSettings::default() }
}

/// Inserts by the general path.
pub(crate) fn general(coverage: Coverage) -> Result<PathReconstructor, Box<dyn Error>> {
    insert_all(PathReconstructor::general(settings(), mask(coverage))?)
}

/// Inserts by the planar path, or by the path that takes over from it.
pub(crate) fn upgrading(coverage: Coverage) -> Result<PathReconstructor, Box<dyn Error>> {
    insert_all(PathReconstructor::planar(settings(), planar(OnDeparture::Upgrade), mask(coverage))?)
}

/// Returns the reason why the planar path refuses the mask, if it does.
pub(crate) fn refusal(coverage: Coverage) -> Option<SettingsError> {
    PathReconstructor::planar(settings(), planar(OnDeparture::Refuse), mask(coverage)).err()
}

fn insert_all(mut reconstructor: PathReconstructor) -> Result<PathReconstructor, Box<dyn Error>> {
    let [width, height] = pixels();
    for at in AT {
        let place = |i: u32| [i % width, i / width].map(|i| FIRST + PIXEL * f64::from(i));
        let grey = (0..width * height).map(place).map(|[u, v]| scene([at, v, u]) as f32).collect::<Arc<[f32]>>();
        reconstructor.insert(&Slice {
            image: Image::new(width, height, Pixels::F32(grey)),
            time_ns: 0,
            world_from_image: Transform::from_affine(DAffine3 {
                matrix3: DMat3::from_cols(DVec3::Z * PIXEL, DVec3::Y * PIXEL, DVec3::NEG_X),
                translation: DVec3::new(at, FIRST, FIRST),
            }),
        })?;
    }
    Ok(reconstructor)
}

/// Returns the voxels' values, in the order of [`crate::weights::Means`].
pub(crate) fn values(reconstructor: &PathReconstructor) -> Vec<Option<f64>> {
    let [nx, ny, nz] = SIZE;
    let voxel = |i: usize| [i / (ny * nz), i / nz % ny, i % nz].map(|x| x as i64);
    (0..nx * ny * nz).map(|i| value(reconstructor.volume(), voxel(i))).collect()
}

#[cfg(test)]
mod tests {
    use reconstruct::Path;

    use super::*;
    use crate::weights::{apart, means};

    #[test]
    fn planar_path_equals_3d_sum_and_detects_fan() {
        let direct = means(Coverage::Full).unwrap().direct;
        let planar_volume = upgrading(Coverage::Full).unwrap();
        let off = apart(&values(&planar_volume), &direct);
        assert!(planar_volume.path() == Path::Planar && off < 1e-5, "{off}");
        let general = apart(&values(&general(Coverage::Full).unwrap()), &direct);
        let fan = upgrading(Coverage::Fan).unwrap();
        assert!(fan.path() == Path::General && fan.upgraded().is_some() && refusal(Coverage::Fan).is_some());
        let off = apart(&values(&fan), &means(Coverage::Fan).unwrap().direct);
        assert!(values(&fan).iter().flatten().count() > 2000);
        assert!(off < 1e-3 && general < 1e-3, "{off} {general}");
    }
}
