//! The number of parts and bands in which a picture is rendered within a limit of memory.
//!
//! Parts and bands are rendered one after the other. Parts divide the voxels, bands divide the
//! rows of pixels: fewer blocks of rays, and fewer voxels where the volume fills the picture.

use std::ops::Range;

use simd::Simd;
use volume::brick::{BrickIndex, EDGE};

use super::compositor::{block_bytes, row_bytes};
use super::reach::{MARGIN, rows_of, z_steps};
use crate::RenderError;
use crate::camera::Camera;
use crate::mode::VoxelData;
use crate::rays::composite::{Accumulated, Fold};
use crate::rays::rows::Row;
use crate::rays::slab::ViewRays;
use crate::region::RenderRegion;
use crate::settings::{Cache, RenderSettings};
use crate::shaded::ShadedBrick;
use crate::snapshot::Brick;

/// Bytes of the tables of a part for each brick of the region, whether it holds anything or not.
const TABLE_BYTES: u64 = 12;
/// Bytes of the voxels of a brick as they were read, and of its place.
const BRICK_BYTES: u64 = (size_of::<Brick>() + size_of::<usize>()) as u64;
/// Rows of nothing.
const NO_ROWS: [u32; 2] = [u32::MAX, 0];

/// Parts and bands of a picture, and their memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Plan {
    /// Parts of the volume.
    pub parts: u32,
    /// Bands of rows.
    pub bands: u32,
    /// Most bytes of the voxels of a part.
    pub voxel_bytes: u64,
    /// Most bytes of the rays of a part, its message, and the compositor.
    pub ray_bytes: u64,
    height: u32,
}

/// Sizes of a picture, from which plans are made.
struct Survey {
    /// Bytes of the rays of each row.
    rows: Vec<u64>,
    /// Voxels that a step of any ray leads down and up the z axis, at most.
    z_steps: [f64; 2],
}

/// A brick by its place in the region, and the first and last row of pixels that it can change.
struct Seen {
    at: [i64; 3],
    rows: [u32; 2],
}

/// Bricks by layer of the region, and by band.
struct Layers {
    /// Sums over the layers before each, band by band.
    before: Vec<Vec<u64>>,
}

impl Plan {
    /// Finds few bands, then few parts, whose voxels and rays take at most
    /// `voxel_bytes` and `ray_bytes` at a time. `bricks` may hold voxels. `parts` sets the number
    /// of parts.
    ///
    /// # Errors
    /// [`RenderError`] for invalid settings or parts, [`RenderError::Memory`] if no cut is small
    /// enough.
    pub fn new(
        settings: &RenderSettings,
        region: &RenderRegion,
        bricks: &[BrickIndex],
        parts: Option<u32>,
        [voxel_bytes, ray_bytes]: [u64; 2],
    ) -> Result<Self, RenderError> {
        let camera = Camera::new(&settings.view, settings.size, settings.step, region)?;
        let fold = settings.fold(camera.samples())?;
        let is_grey = settings.mode.is_grey(&settings.transfer);
        let survey = match is_grey {
            true => survey::<1>(&camera, region, (fold, settings.simd)),
            false => survey::<3>(&camera, region, (fold, settings.simd)),
        };
        let [layers, height] = [region.bricks()[2], settings.size[1]];
        let choice = match parts {
            Some(parts) if parts == 0 || parts > layers => return Err(RenderError::Part { part: 0, parts, layers }),
            Some(parts) => vec![parts],
            // Each half as many again, for there may be thousands of layers.
            None => std::iter::successors(Some(1), |n: &u32| (*n < layers).then(|| (n + n.div_ceil(2)).min(layers)))
                .collect(),
        };
        let rays = ViewRays::new(&camera);
        let seen: Vec<Seen> = bricks.iter().filter_map(|brick| Seen::new(*brick, region, &rays)).collect();
        let shaded = shaded(&seen, region);
        let tables = table_bytes(region);
        let steepest = survey.z_steps[0].max(survey.z_steps[1]);
        let reach = (f64::from(fold.arity) + 1.0) * steepest + MARGIN;
        let reach = (reach.ceil() as usize).div_ceil(EDGE);
        let mut bands = 1;
        let mut lacking;
        loop {
            let of_rays = (0..bands).map(|band| survey.bytes(rows(band, bands, height))).max().unwrap_or(0);
            lacking = (of_rays, ray_bytes);
            if of_rays <= ray_bytes {
                let [read, kept] = [&seen, &shaded].map(|of| Layers::new(of, layers as usize, bands, height));
                for &parts in &choice {
                    let of_read = read.most(parts as usize, reach) * BRICK_BYTES;
                    // Those of the layer before keep voxels of the first.
                    let of_kept = kept.most(parts as usize, reach + 1) * shaded_bytes(settings);
                    let of_voxels = of_read + of_kept + tables;
                    lacking = (of_voxels, voxel_bytes);
                    if of_voxels <= voxel_bytes {
                        return Ok(Self { parts, bands, voxel_bytes: of_voxels, ray_bytes: of_rays, height });
                    }
                }
            }
            if bands == height {
                let (needed_bytes, limit_bytes) = lacking;
                return Err(RenderError::Memory { needed_bytes, limit_bytes });
            }
            bands = (2 * bands).min(height);
        }
    }

    /// Returns the bytes of all voxels of a picture that is rendered without parts.
    pub fn whole_bytes(settings: &RenderSettings, region: &RenderRegion, bricks: &[BrickIndex]) -> u64 {
        let held: Vec<Seen> =
            bricks.iter().filter_map(|brick| Some(Seen { at: region.place(*brick)?, rows: [0, 0] })).collect();
        let [read, kept] = [held.len(), shaded(&held, region).len()].map(|count| count as u64);
        read * BRICK_BYTES + kept * shaded_bytes(settings) + table_bytes(region)
    }

    /// Returns the rows of each band.
    pub fn rows(&self) -> impl Iterator<Item = Range<u32>> + use<> {
        let Self { bands, height, .. } = *self;
        (0..bands).map(move |band| rows(band, bands, height))
    }
}

/// Returns the rows of a band.
fn rows(band: u32, bands: u32, height: u32) -> Range<u32> {
    let cut = |band: u32| (u64::from(band) * u64::from(height) / u64::from(bands)) as u32;
    cut(band)..cut(band + 1)
}

fn table_bytes(region: &RenderRegion) -> u64 {
    region.bricks().map(u64::from).iter().product::<u64>() * TABLE_BYTES
}

/// Returns the bytes of what the mode keeps of a brick.
fn shaded_bytes(settings: &RenderSettings) -> u64 {
    let shaded = match (settings.mode.voxel_data(), settings.mode.is_grey(&settings.transfer)) {
        (VoxelData::SampleClassifier, _) => size_of::<ShadedBrick<4>>(),
        (_, true) => size_of::<ShadedBrick<1>>(),
        (_, false) => size_of::<ShadedBrick<3>>(),
    };
    (shaded + size_of::<usize>()) as u64
}

/// Returns the bricks in which anything is kept of some bricks: these and those before them, which
/// hold their first voxels too.
fn shaded(seen: &[Seen], region: &RenderRegion) -> Vec<Seen> {
    let size = region.bricks().map(i64::from);
    let mut rows = vec![NO_ROWS; size.iter().product::<i64>() as usize];
    for Seen { at, rows: of_brick } in seen {
        for corner in 0..8 {
            let [x, y, z]: [i64; 3] = std::array::from_fn(|a| at[a] - (corner >> a & 1));
            if x >= 0 && y >= 0 && z >= 0 {
                let rows = &mut rows[((z * size[1] + y) * size[0] + x) as usize];
                *rows = [rows[0].min(of_brick[0]), rows[1].max(of_brick[1])];
            }
        }
    }
    let place = |index: i64| [index % size[0], index / size[0] % size[1], index / (size[0] * size[1])];
    let kept = (0..).zip(rows).filter(|(_, rows)| *rows != NO_ROWS);
    kept.map(|(index, rows)| Seen { at: place(index), rows }).collect()
}

fn survey<const C: usize>(camera: &Camera, region: &RenderRegion, (fold, simd): (Fold, Simd)) -> Survey {
    let compositor = row_bytes::<C>(camera, fold);
    let mut survey = Survey { rows: Vec::new(), z_steps: [0.0; 2] };
    for j in 0..camera.size()[1] {
        let row = Row::<C>::new(camera, region, (fold, simd), j);
        let kept = row.cache_bytes(Cache::OneLevel);
        // Once kept, once as sent, once in the message.
        let blocks = kept / size_of::<Accumulated<C>>() as u64;
        survey.rows.push(compositor + row.bytes() + 2 * kept + blocks * block_bytes(C) as u64);
        let [down, up] = z_steps(std::slice::from_ref(&row));
        survey.z_steps = [survey.z_steps[0].max(down), survey.z_steps[1].max(up)];
    }
    survey
}

impl Survey {
    fn bytes(&self, rows: Range<u32>) -> u64 {
        self.rows[rows.start as usize..rows.end as usize].iter().sum()
    }
}

impl Layers {
    fn new(seen: &[Seen], layers: usize, bands: u32, height: u32) -> Self {
        let band = |row: u32| {
            // The band whose rows hold it; cuts are rounded down.
            let near = (u64::from(row) * u64::from(bands) / u64::from(height)) as u32;
            (near..bands).find(|band| rows(*band, bands, height).contains(&row)).unwrap_or(near) as usize
        };
        let mut before = vec![vec![0_u64; layers + 1]; bands as usize];
        for Seen { at, rows: [first, last] } in seen {
            for of_band in &mut before[band(*first)..=band(*last)] {
                of_band[at[2] as usize + 1] += 1;
            }
        }
        for of_band in &mut before {
            let mut sum = 0;
            for count in of_band {
                sum += *count;
                *count = sum;
            }
        }
        Self { before }
    }

    /// Returns the most bricks that one of so many parts needs in a band, with `reach` layers of
    /// its neighbours on both sides.
    fn most(&self, parts: usize, reach: usize) -> u64 {
        let layers = self.before[0].len() - 1;
        let cut = |part: usize| part * layers / parts;
        let bands = self.before.iter();
        let of_band = |before: &Vec<u64>| {
            let of_part =
                |part: usize| before[(cut(part + 1) + reach).min(layers)] - before[cut(part).saturating_sub(reach)];
            (0..parts).map(of_part).max().unwrap_or(0)
        };
        bands.map(of_band).max().unwrap_or(0)
    }
}

impl Seen {
    /// Returns `None` if the brick is outside of the region or of the picture.
    fn new(brick: BrickIndex, region: &RenderRegion, rays: &ViewRays) -> Option<Self> {
        Some(Self { at: region.place(brick)?, rows: rows_of(brick, region.first(), rays)? })
    }
}
