//! The renderer's equations in f64, sample by sample and front to back, without blocks, stops,
//! caches or skipping. All other implementations are compared with it.

use volume::Values;

use super::RenderError;
use super::camera::Camera;
use super::classify::classifier::{SampleClassifier, sample};
use super::classify::shade::{Lit, Shader};
use super::crop::{Cropped, LatticeCrop};
use super::mode::{Mode, VoxelData};
use super::region::RenderRegion;
use super::settings::RenderSettings;

/// Largest number of voxels in the reference, 40 bytes each.
const MOST_VOXELS: usize = 1 << 26;

/// A picture in f64: premultiplied red, green, blue, and transmittance of each pixel, row by
/// row.
#[derive(Debug, Clone, PartialEq)]
pub struct ReferencePicture {
    /// Pixels to the right and down.
    pub size: [u32; 2],
    /// Pixels.
    pub pixels: Vec<[f64; 4]>,
}

/// Renders all of a volume that lies in a render region.
///
/// # Errors
/// [`RenderError`] in the same cases as the renderer, and [`RenderError::Box`] beyond 2²⁶
/// voxels.
pub fn render(
    volume: &(impl Values + ?Sized),
    settings: &RenderSettings,
    region: &RenderRegion,
) -> Result<ReferencePicture, RenderError> {
    settings.mode.check()?;
    let crop = LatticeCrop::new(settings.crop.present(), region.world_from_lattice());
    let volume = &Cropped::new(volume, &crop);
    let camera = Camera::new(&settings.view, settings.size, settings.step, region)?;
    let shader = Shader::<f64>::new(settings, &camera, region);
    let pixels = match settings.mode.voxel_data() {
        VoxelData::SampleClassifier => {
            let voxels = Voxels::<4>::keep(volume, &shader, region)?;
            cast(settings, &camera, |at, before| voxels.classified(&shader, at, before))
        }
        VoxelData::Lit | VoxelData::Intensity => {
            let voxels = Voxels::<3>::keep(volume, &shader, region)?;
            cast(settings, &camera, |at, _| voxels.lit(at))
        }
    };
    Ok(ReferencePicture { size: camera.size(), pixels })
}

/// Casts all rays. `sample` gives the light at a place, including the section from the place
/// before it.
fn cast(
    settings: &RenderSettings,
    camera: &Camera,
    sample: impl Fn([f64; 3], [f64; 3]) -> Lit<f64, 3>,
) -> Vec<[f64; 4]> {
    let [width, height] = camera.size();
    (0..height)
        .flat_map(|j| (0..width).map(move |i| (i, j)))
        .map(|(i, j)| {
            let ray = camera.ray(i, j);
            let at = |k: f64| (ray.base + ray.step * k).to_array();
            let samples = (0..camera.samples()).map(|k| sample(at(f64::from(k)), at(f64::from(k) - 1.0)));
            let (colour, transmittance) = match settings.mode {
                Mode::Maximum => most(samples),
                Mode::Average => samples.fold(([0.0; 3], 1.0), |(sum, transmittance), Lit { colour, alpha }| {
                    (std::array::from_fn(|c| sum[c] + colour[c]), transmittance - alpha)
                }),
                Mode::Shaded(_) | Mode::Opacity(_) | Mode::Isosurface(_) => {
                    samples.fold(([0.0; 3], 1.0), |(sum, transmittance), Lit { colour, alpha }| {
                        (std::array::from_fn(|c| sum[c] + transmittance * colour[c]), transmittance * (1.0 - alpha))
                    })
                }
            };
            settings.mode.pixel(colour, transmittance, &settings.transfer)
        })
        .collect()
}

/// Returns the largest intensity seen by half or more.
fn most(samples: impl Iterator<Item = Lit<f64, 3>>) -> ([f64; 3], f64) {
    let seen = samples.filter(|sample| sample.alpha >= 0.5).map(|sample| sample.colour[0] / sample.alpha);
    match seen.reduce(f64::max) {
        Some(value) => ([value; 3], 0.0),
        None => ([0.0; 3], 1.0),
    }
}

/// All voxels of a render region's box and a layer of transparent ones about it.
struct Voxels<const S: usize> {
    /// Region coordinates of the first.
    first: [i64; 3],
    size: [usize; 3],
    kept: Vec<Lit<f64, S>>,
}

impl<const S: usize> Voxels<S> {
    fn keep(volume: &impl Values, shader: &Shader<f64>, region: &RenderRegion) -> Result<Self, RenderError> {
        let [low, high] = region.bounds();
        let size: [usize; 3] = std::array::from_fn(|a| (high[a] - low[a] + 3) as usize);
        let n = size.iter().try_fold(1_usize, |n, s| n.checked_mul(*s)).filter(|n| *n <= MOST_VOXELS);
        let n = n.ok_or(RenderError::Box { low, high })?;
        let (mut value, mut weight) = (vec![0.0_f32; n], vec![0.0_f32; n]);
        let row = size[0] - 2;
        for z in 1..size[2] - 1 {
            for y in 1..size[1] - 1 {
                let at = (z * size[1] + y) * size[0] + 1;
                let start = [low[0], low[1] + y as i64 - 1, low[2] + z as i64 - 1];
                volume.values(start, &mut value[at..at + row], &mut weight[at..at + row]);
            }
        }
        let first: [i64; 3] = std::array::from_fn(|a| low[a] - region.first()[a] - 1);
        let nothing = Lit { colour: [0.0; S], alpha: 0.0 };
        let mut kept = vec![nothing; n];
        let of = |at: usize| (f64::from(value[at]), f64::from(weight[at]));
        let stride = [1, size[0], size[0] * size[1]];
        for z in 1..size[2] - 1 {
            for y in 1..size[1] - 1 {
                for x in 1..size[0] - 1 {
                    let at = z * stride[2] + y * stride[1] + x;
                    let around = stride.map(|s| [of(at - s), of(at + s)]);
                    let place = [x, y, z];
                    let place = std::array::from_fn(|a| first[a] + place[a] as i64);
                    kept[at] = match shader.is_grey() && S == 3 {
                        true => {
                            let Lit { colour: [grey], alpha } = shader.shade(of(at), around, place);
                            Lit { colour: [grey; S], alpha }
                        }
                        false => shader.shade(of(at), around, place),
                    };
                }
            }
        }
        Ok(Self { first, size, kept })
    }

    /// Interpolates trilinearly; transparent outside.
    fn lit(&self, at: [f64; 3]) -> Lit<f64, S> {
        let floor = at.map(f64::floor);
        let (mut colour, mut alpha) = ([0.0; S], 0.0);
        let cell: [i64; 3] = std::array::from_fn(|a| floor[a] as i64 - self.first[a]);
        for corner in 0..8_usize {
            let mut share = 1.0;
            let mut place = 0;
            let mut inside = true;
            for a in (0..3).rev() {
                let up = corner >> a & 1;
                let part = at[a] - floor[a];
                share *= if up == 1 { part } else { 1.0 - part };
                let index = cell[a] + up as i64;
                inside &= (0..self.size[a] as i64).contains(&index);
                place = place * self.size[a] + index.max(0) as usize;
            }
            if inside {
                let lit = &self.kept[place];
                colour.iter_mut().zip(lit.colour).for_each(|(sum, c)| *sum += share * c);
                alpha += share * lit.alpha;
            }
        }
        Lit { colour, alpha }
    }
}

impl SampleClassifier<f64> for Voxels<4> {
    fn between(&self, at: [f64; 3]) -> Option<Lit<f64, 4>> {
        Some(self.lit(at))
    }
}

impl Voxels<4> {
    fn classified(&self, shader: &Shader<f64>, at: [f64; 3], before: [f64; 3]) -> Lit<f64, 3> {
        let interpolated = self.lit(at);
        match shader.is_grey() {
            true => {
                let Lit { colour: [grey], alpha } = sample(shader, self, interpolated, at, before);
                Lit { colour: [grey; 3], alpha }
            }
            false => sample(shader, self, interpolated, at, before),
        }
    }
}

impl ReferencePicture {
    /// Returns the largest and root mean square difference to a picture, over colours and
    /// transmittances.
    ///
    /// # Panics
    /// When the pictures differ in size.
    pub fn difference(&self, picture: &super::Picture) -> [f64; 2] {
        assert_eq!(self.size, picture.size, "pictures of one size are compared");
        let (mut most, mut squares) = (0.0_f64, 0.0);
        for (exact, pixel) in self.pixels.iter().zip(&picture.pixels) {
            for (exact, x) in exact.iter().zip(pixel) {
                let off = (exact - f64::from(*x)).abs();
                most = most.max(off);
                squares += off * off;
            }
        }
        [most, (squares / (4.0 * self.pixels.len().max(1) as f64)).sqrt()]
    }
}
