//! Rendering by parts: each worker reads, lights, samples and composites its own part of the
//! volume, and a compositor assembles the picture.
//!
//! The render region is cut across its z axis, as in Ohbuchi, Chen & Fuchs (1992, section 4.4).
//! Their regional reconstruction and rendering processors correspond to [`Part`], their global
//! compositing processor to [`Compositor`]. A worker receives slices, or the voxels they changed
//! within [`Part::region`]; it sends the changed composited blocks, as bytes. In one program, the
//! parts are threads' work, and a [`Renderer`](super::Renderer) composites their blocks where
//! they are (`shared`). `choice` decides when it does so.
//!
//! A block of a ray belongs, whole, to the part in which its first sample lies. No sample is
//! lost or taken twice. The compositor composites the same blocks in the same order as a
//! renderer without parts, so the picture has the same bits for any number of parts. A part also
//! holds some of its neighbours' voxels, for samples of its blocks beyond the cut.

pub mod choice;
pub mod compositor;
pub(crate) mod shared;

use std::ops::Range;

use simd::Simd;
use simd::sharing::Sharing;
use volume::brick::{BrickIndex, EDGE};
use volume::{Prism, Values};

use super::RenderError;
use super::camera::Camera;
use super::classify::shade::Shader;
use super::layers::{Channels, Image, Layers, channels};
use super::rays::composite::{Accumulated, Fold};
use super::rays::line::Line;
use super::rays::marks::Marks;
use super::rays::rows::Row;
use super::region::RenderRegion;
use super::settings::{Cache, RenderSettings};
use super::snapshot::{Changed, VoxelSnapshot};
use super::voxels::{Sampler, Voxels};
use super::work::RenderWork;
pub use compositor::Compositor;

/// Voxels beyond its last sample that a part needs: the cell about it, the neighbours of its
/// corners, and one for rays between pixels, which differ a little from theirs in perspective.
const MARGIN: f64 = 3.0;

/// One worker's part of the render region.
pub struct Part {
    width: u32,
    marks: Marks,
    shader: Shader<f32>,
    snapshot: VoxelSnapshot,
    fold: Fold,
    simd: Simd,
    /// Its layers of voxels, region coordinates, without those of its neighbours.
    layers: Range<i64>,
    /// Lattice indices of the first and last voxel that it needs.
    region: [[i64; 3]; 2],
    /// Changes that were read but are not drawn yet.
    changed: Vec<Changed>,
    image: Channels<PartLayers<1>, PartLayers<3>>,
}

/// Message of a part after a change.
#[derive(Debug, Clone, Default)]
pub struct Message {
    /// For each changed block: its pixel number and its number along the ray, then colour and
    /// transmittance; little-endian.
    pub bytes: Vec<u8>,
    /// Work the part did for it.
    pub work: RenderWork,
}

impl Part {
    /// Creates part number `part` of `parts`, of an empty volume.
    ///
    /// # Errors
    /// [`RenderError`] for invalid settings, [`RenderError::Part`] for an invalid part.
    pub fn new(settings: &RenderSettings, region: &RenderRegion, part: u32, parts: u32) -> Result<Self, RenderError> {
        if part >= parts || parts > region.bricks()[2] {
            return Err(RenderError::Part { part, parts, layers: region.bricks()[2] });
        }
        settings.mode.check()?;
        let camera = Camera::new(&settings.view, settings.size, settings.step, region)?;
        let image = match settings.mode.is_grey(&settings.transfer) {
            true => Image::Grey(Layers::new(&camera, region, settings)),
            false => Image::Colour(Layers::new(&camera, region, settings)),
        };
        Self::of(settings, region, &camera, &image, part, parts)
    }

    /// Creates a part of the rays of a picture.
    fn of(
        settings: &RenderSettings,
        region: &RenderRegion,
        camera: &Camera,
        image: &Image,
        part: u32,
        parts: u32,
    ) -> Result<Self, RenderError> {
        let shader = Shader::new(settings, camera, region);
        let fold = settings.fold(camera.samples())?;
        let bricks = i64::from(region.bricks()[2]);
        let cut = |k: u32| i64::from(k) * bricks / i64::from(parts) * EDGE as i64;
        let layers = cut(part)..cut(part + 1);
        // A block extends out of the part by its own length at most, along its ray. The sample
        // before it may be taken, too.
        let [down, up] = channels!(image, image => z_steps(&image.rows));
        let reach = |to: f64, from: f64| (f64::from(fold.arity) * to + from + MARGIN).ceil() as i64;
        let [mut low, mut high] = region.bounds();
        low[2] = low[2].max(region.first()[2] + layers.start - reach(down, up));
        high[2] = high[2].min(region.first()[2] + layers.end + reach(up, down));
        let image = match image {
            Image::Grey(image) => Channels::Grey(PartLayers::new(&image.rows, region, settings, fold, &layers)),
            Image::Colour(image) => Channels::Colour(PartLayers::new(&image.rows, region, settings, fold, &layers)),
        };
        Ok(Self {
            width: settings.size[0],
            marks: Marks::new(camera, settings.mode.reach()),
            shader,
            snapshot: VoxelSnapshot::new(region),
            fold,
            simd: settings.simd,
            layers,
            region: [low, high],
            changed: Vec::new(),
            image,
        })
    }

    /// Returns the lattice indices of the first and last voxel whose changes the part needs: its
    /// own and some of its neighbours'.
    pub fn region(&self) -> [[i64; 3]; 2] {
        self.region
    }

    /// Reads some bricks of a volume, given by lattice index divided by 8; ignores those out of
    /// its region. The volume needs to hold only the part's region. The message holds the blocks
    /// to be composited again.
    pub fn update(&mut self, volume: &(impl Values + ?Sized), bricks: &[BrickIndex]) -> Message {
        let mut message = Message { work: self.read(volume, bricks), ..Message::default() };
        message.work += self.draw(None);
        let (width, fold) = (self.width, self.fold);
        channels!(&mut self.image, layers => layers.tell(width, fold, &mut message.bytes));
        message
    }

    /// Reads those of some bricks of a volume that lie in its region.
    fn read(&mut self, volume: &(impl Values + ?Sized), bricks: &[BrickIndex]) -> RenderWork {
        let edge = EDGE as i64;
        let [low, high] = [self.region[0][2].div_euclid(edge), self.region[1][2].div_euclid(edge)];
        let needed: Vec<BrickIndex> =
            bricks.iter().filter(|b| (low..=high).contains(&i64::from(b[2]))).copied().collect();
        self.snapshot.read(volume, &needed, self.simd, Sharing::Alone, &mut self.changed);
        RenderWork { bricks_read: needed.len() as u64, ..RenderWork::default() }
    }

    /// Shades what was read and casts the rays that it reaches. All changed voxels lie in the
    /// slab, if one is given; region coordinates.
    fn draw(&mut self, slab: Option<&Prism>) -> RenderWork {
        let mut work = RenderWork { bricks_changed: self.changed.len() as u64, ..RenderWork::default() };
        if self.changed.is_empty() {
            channels!(&mut self.image, layers => layers.cast.fill([usize::MAX, 0]));
            return work;
        }
        let mut dirty = Vec::new();
        let voxels = self.snapshot.dilated(&self.changed);
        let (snapshot, shader, simd) = (&self.snapshot, &self.shader, self.simd);
        work.voxels_shaded = channels!(&mut self.image, layers => {
            layers.voxels.update(snapshot, &voxels, shader, simd, Sharing::Alone, &mut dirty)
        });
        debug_assert!(slab.is_none_or(|slab| self.changed.iter().all(|changed| changed.lies_in(slab))));
        self.marks.set(&dirty, slab.map(|slab| &slab.faces));
        self.changed.clear();
        work += channels!(&mut self.image, layers => layers.cast(&self.marks, shader, self.fold, simd));
        work
    }
}

/// Data of a part for a number of channels.
pub(crate) struct PartLayers<const C: usize> {
    voxels: Voxels<C>,
    rows: Vec<Row<C>>,
    /// The first pixel of each row that was cast last, and the one after the last.
    cast: Vec<[usize; 2]>,
    /// Blocks of each row as last sent to the compositor; empty before the first message.
    sent: Vec<Vec<Accumulated<C>>>,
}

impl<const C: usize> PartLayers<C> {
    /// Creates the part of a picture's rows in some layers of voxels.
    fn new(rows: &[Row<C>], region: &RenderRegion, settings: &RenderSettings, fold: Fold, layers: &Range<i64>) -> Self {
        let part = |row: &Row<C>| {
            let mut part = row.restricted(|line| own_samples(line, fold, layers));
            part.keep(Cache::OneLevel, fold);
            part
        };
        let rows: Vec<Row<C>> = rows.iter().map(part).collect();
        let cast = vec![[usize::MAX, 0]; rows.len()];
        Self { voxels: Voxels::new(region, settings), rows, cast, sent: Vec::new() }
    }

    fn cast(&mut self, marks: &Marks, shader: &Shader<f32>, fold: Fold, simd: Simd) -> RenderWork {
        let sampler = Sampler::new(&self.voxels, shader);
        let mut work = RenderWork::default();
        for ((j, row), cast) in (0..).zip(&mut self.rows).zip(&mut self.cast) {
            row.work = RenderWork::default();
            *cast = row.mark(j, marks, simd);
            (cast[0]..cast[1]).for_each(|at| row.cast(at, sampler, fold, simd));
            work += row.work;
        }
        work
    }

    /// Appends the blocks that were cast last, and differ from those sent before, to a message.
    fn tell(&mut self, width: u32, fold: Fold, bytes: &mut Vec<u8>) {
        if self.sent.is_empty() {
            self.sent = self.rows.iter().map(|row| vec![Accumulated::CLEAR; row.kept().len()]).collect();
        }
        for (((j, row), cast), sent) in (0..).zip(&self.rows).zip(&self.cast).zip(&mut self.sent) {
            for at in cast[0]..cast[1] {
                let (number, range) = row.blocks_of(at, fold);
                let mut all = Accumulated::CLEAR;
                for ((number, block), sent) in (number..).zip(&row.kept()[range.clone()]).zip(&mut sent[range]) {
                    if !block.same_bits(sent) {
                        *sent = *block;
                        compositor::put(bytes, j * width + at as u32, number, block);
                    }
                    // Blocks behind this one are hidden within this part already. They are not
                    // up to date and need not be.
                    if all.ends_behind(block, fold, &mut RenderWork::default()) {
                        break;
                    }
                }
            }
        }
    }
}

/// Returns the voxels that a step of any ray leads down and up the z axis, at most.
fn z_steps<const C: usize>(rows: &[Row<C>]) -> [f64; 2] {
    let steps = rows.iter().flat_map(Row::lines).map(|line| f64::from(line.step[2]));
    steps.fold([0.0, 0.0], |[down, up], step| [f64::max(down, -step), f64::max(up, step)])
}

/// Returns the samples of a line that belong to blocks whose first sample lies in some layers of
/// voxels.
fn own_samples(line: &Line, fold: Fold, layers: &Range<i64>) -> [u32; 2] {
    let [low, high] = [layers.start as f32, layers.end as f32];
    if line.first == line.end {
        return [line.first, line.first];
    }
    // The blocks of a line, by number. Its z only rises or only falls from one to the next.
    let [first, end] = [line.first / fold.arity, (line.end - 1) / fold.arity + 1];
    let begin = |block: u32| (block * fold.arity).clamp(line.first, line.end);
    let z = |block: u32| line.at(begin(block))[2];
    let until = |is_before: &dyn Fn(f32) -> bool| {
        let (mut from, mut to) = (first, end);
        while from < to {
            let middle = from.midpoint(to);
            (from, to) = if is_before(z(middle)) { (middle + 1, to) } else { (from, middle) };
        }
        begin(from)
    };
    match line.step[2] < 0.0 {
        true => [until(&|z| z >= high), until(&|z| z >= low)],
        false => [until(&|z| z < low), until(&|z| z < high)],
    }
}

#[cfg(test)]
mod tests;
