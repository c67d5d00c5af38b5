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
//!
//! A picture whose blocks exceed the memory is made in bands of rows, one after the other: parts
//! and compositors may have [some rows](Part::of_rows) only. [`plan`] finds the number of parts
//! and bands for a limit of memory.

pub mod choice;
pub mod compositor;
pub mod plan;
mod reach;
pub(crate) mod shared;

use std::ops::Range;

use simd::Simd;
use simd::sharing::Sharing;
use simd::team::Team;
use volume::brick::{BrickIndex, EDGE};
use volume::{Prism, Values};

use super::RenderError;
use super::camera::Camera;
use super::classify::shade::Shader;
use super::crop::{Cropped, LatticeCrop};
use super::layers::{Channels, Image, Layers, channels};
use super::rays::cast::Casting;
use super::rays::composite::{Accumulated, Fold};
use super::rays::line::Line;
use super::rays::marks::Marks;
use super::rays::rows::Row;
use super::rays::slab::ViewRays;
use super::rays::visible_blocks::blocks_of;
use super::region::RenderRegion;
use super::settings::{Cache, RenderSettings};
use super::snapshot::{Changed, VoxelSnapshot};
use super::voxels::Voxels;
use super::work::{RenderMemory, RenderWork};
pub use compositor::Compositor;
pub use plan::Plan;
use reach::{MARGIN, rows_of, z_steps};

/// One worker's part of the render region.
pub struct Part {
    width: u32,
    rows: Range<u32>,
    rays: ViewRays,
    /// Lattice index of region coordinate 0.
    first: [i64; 3],
    marks: Marks,
    shader: Shader<f32>,
    /// The parts of the volume that the crop hides.
    crop: LatticeCrop,
    snapshot: VoxelSnapshot,
    fold: Fold,
    simd: Simd,
    /// Its layers of voxels, region coordinates, without those of its neighbours.
    layers: Range<i64>,
    /// Lattice indices of the first and last voxel that it needs.
    region: [[i64; 3]; 2],
    /// Changes that were read but are not drawn yet.
    changed: Vec<Changed>,
    /// Bricks that were read since the last message.
    bricks_read: u64,
    /// Whether a message has one block a pixel, composited from all of the part's.
    is_folded: bool,
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

/// Returns the layers of bricks that a box meets, both ends of which are in it; lattice indices
/// divided by 8.
fn layers_of([low, high]: [[i64; 3]; 2]) -> Range<i64> {
    let edge = EDGE as i64;
    low[2].div_euclid(edge)..high[2].div_euclid(edge) + 1
}

/// Returns whether rays of some rows can reach a brick.
fn meets(brick: BrickIndex, first: [i64; 3], rays: &ViewRays, rows: &Range<u32>) -> bool {
    rows_of(brick, first, rays).is_some_and(|[first, last]| first < rows.end && last >= rows.start)
}

impl Part {
    /// Creates part number `part` of `parts`, of an empty volume.
    ///
    /// # Errors
    /// [`RenderError`] for invalid settings, [`RenderError::Part`] for an invalid part.
    pub fn new(settings: &RenderSettings, region: &RenderRegion, part: u32, parts: u32) -> Result<Self, RenderError> {
        Self::of_rows(settings, region, (part, parts), 0..settings.size[1])
    }

    /// Creates part number `part` of `parts` for some rows of the picture.
    ///
    /// # Errors
    /// Same as [`Self::new`], and [`RenderError::Rows`] for no rows of the picture.
    pub fn of_rows(
        settings: &RenderSettings,
        region: &RenderRegion,
        (part, parts): (u32, u32),
        rows: Range<u32>,
    ) -> Result<Self, RenderError> {
        if part >= parts || parts > region.bricks()[2] {
            return Err(RenderError::Part { part, parts, layers: region.bricks()[2] });
        }
        settings.mode.check()?;
        compositor::check_rows(&rows, settings)?;
        let camera = Camera::new(&settings.view, settings.size, settings.step, region)?;
        let fold = settings.fold(camera.samples())?;
        let image = match settings.mode.is_grey(&settings.transfer) {
            true => Image::Grey(Layers::of_rows(&camera, region, settings, fold, rows.clone())),
            false => Image::Colour(Layers::of_rows(&camera, region, settings, fold, rows.clone())),
        };
        let made = Self::of(settings, region, &camera, &image, part, parts)?;
        Ok(Self { rows, ..made })
    }

    /// Returns the part with one block a pixel in its messages, composited from all of its own.
    /// They are much shorter where many parts share a picture. The picture is rounded otherwise,
    /// by less than a step of 8 bits.
    #[must_use]
    pub fn folded(self) -> Self {
        Self { is_folded: true, ..self }
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
            Image::Grey(image) => Channels::Grey(PartLayers::new(image, camera, region, settings, fold, &layers)),
            Image::Colour(image) => Channels::Colour(PartLayers::new(image, camera, region, settings, fold, &layers)),
        };
        Ok(Self {
            width: settings.size[0],
            rows: 0..settings.size[1],
            rays: ViewRays::new(camera),
            first: region.first(),
            marks: Marks::new(camera, settings.mode.reach()),
            shader,
            crop: LatticeCrop::new(settings.crop.present(), region.world_from_lattice()),
            snapshot: VoxelSnapshot::new(region, 0),
            fold,
            simd: settings.simd,
            layers,
            region: [low, high],
            changed: Vec::new(),
            bricks_read: 0,
            is_folded: false,
            image,
        })
    }

    /// Returns the lattice indices of the first and last voxel whose changes the part needs: its
    /// own and some of its neighbours'.
    pub fn region(&self) -> [[i64; 3]; 2] {
        self.region
    }

    /// Returns those of some bricks that the part needs: its own and some of its neighbours', as
    /// far as rays of its rows reach them.
    pub fn needed(&self, bricks: &[BrickIndex]) -> Vec<BrickIndex> {
        let Self { first, rays, rows, .. } = self;
        self.reached(bricks).filter(|brick| meets(*brick, *first, rays, rows)).collect()
    }

    /// Returns the bricks that meet its layers or those of its neighbours that it needs.
    fn reached<'a>(&self, bricks: &'a [BrickIndex]) -> impl Iterator<Item = BrickIndex> + use<'a> {
        let layers = layers_of(self.region);
        bricks.iter().filter(move |b| layers.contains(&i64::from(b[2]))).copied()
    }

    /// Reads some bricks of a volume, given by lattice index divided by 8; ignores those that it
    /// does not [need](Self::needed). The volume needs to hold only the part's region. The message
    /// holds the blocks to be composited again.
    pub fn update(&mut self, volume: &(impl Values + ?Sized), bricks: &[BrickIndex]) -> Message {
        let needed = self.needed(bricks);
        self.read_on(None, volume, &needed);
        self.draw_on(None)
    }

    /// Reads bricks, the first half of [`Self::update`], on the threads of a team. Several readings
    /// may precede one drawing.
    pub fn read_on(&mut self, team: Option<&Team>, volume: &(impl Values + ?Sized), bricks: &[BrickIndex]) {
        self.read(volume, bricks, Sharing::of(team));
    }

    /// Draws what was read, the second half of [`Self::update`], on the threads of a team.
    pub fn draw_on(&mut self, team: Option<&Team>) -> Message {
        let bricks_read = std::mem::take(&mut self.bricks_read);
        let mut message = Message { work: RenderWork { bricks_read, ..RenderWork::default() }, ..Message::default() };
        message.work += self.draw(None, Sharing::of(team));
        let (width, fold, is_folded) = (self.width, self.fold, self.is_folded);
        channels!(&mut self.image, layers => layers.tell(width, fold, is_folded, &mut message.bytes));
        message
    }

    /// Returns the memory in use.
    pub fn memory(&self) -> RenderMemory {
        channels!(&self.image, layers => RenderMemory {
            voxels: self.snapshot.bytes() + layers.voxels.bytes(),
            rays: layers.rows.iter().map(Row::bytes).sum::<u64>() + layers.sent_bytes(),
        })
    }

    /// Returns the number of bricks that hold anything.
    pub fn bricks(&self) -> usize {
        self.snapshot.len()
    }

    /// Reads those of some bricks of a volume that lie in its region.
    fn read(&mut self, volume: &(impl Values + ?Sized), bricks: &[BrickIndex], sharing: Sharing) {
        let needed: Vec<BrickIndex> = self.reached(bricks).collect();
        let Self { first, rays, rows, region, snapshot, changed, crop, .. } = self;
        let volume = &Cropped::new(volume, crop);
        let layers = layers_of(*region);
        let wanted = |brick: BrickIndex| layers.contains(&i64::from(brick[2])) && meets(brick, *first, rays, rows);
        snapshot.read(volume, &needed, wanted, self.shader.visible(), (self.simd, sharing), changed);
        self.bricks_read += needed.len() as u64;
    }

    /// Shades what was read and casts the rays that it reaches. All changed voxels lie in the
    /// slab, if one is given; region coordinates.
    fn draw(&mut self, slab: Option<&Prism>, sharing: Sharing) -> RenderWork {
        let mut work = RenderWork { bricks_changed: self.changed.len() as u64, ..RenderWork::default() };
        if self.changed.is_empty() {
            channels!(&mut self.image, layers => layers.cast.fill([usize::MAX, 0]));
            return work;
        }
        let (mut dirty, mut due) = (Vec::new(), Vec::new());
        self.snapshot.dilated(&mut self.changed, &mut due, sharing);
        let (snapshot, shader, simd) = (&self.snapshot, &self.shader, self.simd);
        work.voxels_shaded = channels!(&mut self.image, layers => {
            layers.voxels.update(snapshot, &due, shader, (simd, sharing), &mut dirty).voxels_shaded
        });
        debug_assert!(slab.is_none_or(|slab| self.changed.iter().all(|changed| changed.lies_in(slab))));
        self.marks.set(&dirty, slab.map(|slab| &slab.faces));
        self.changed.clear();
        work += channels!(&mut self.image, layers => layers.cast(&self.marks, shader, (self.fold, simd, sharing)));
        work
    }
}

/// Data of a part for a number of channels.
pub(crate) struct PartLayers<const C: usize> {
    voxels: Voxels<C>,
    /// Number of the first row in the picture.
    first_row: u32,
    rows: Vec<Row<C>>,
    /// The first pixel of each row that was cast last, and the one after the last.
    cast: Vec<[usize; 2]>,
    /// Blocks of each row as last sent to the compositor, one a pixel if they are folded; empty
    /// before the first message.
    sent: Vec<Vec<Accumulated<C>>>,
}

impl<const C: usize> PartLayers<C> {
    /// Creates the part of a picture's rows in some layers of voxels.
    fn new(
        image: &Layers<C>,
        camera: &Camera,
        region: &RenderRegion,
        settings: &RenderSettings,
        fold: Fold,
        layers: &Range<i64>,
    ) -> Self {
        let part = |row: &Row<C>| {
            let mut part = row.restricted(fold, |line| own_samples(line, fold, layers));
            part.keep(Cache::OneLevel, fold);
            part
        };
        let rows: Vec<Row<C>> = image.rows.iter().map(part).collect();
        let cast = vec![[usize::MAX, 0]; rows.len()];
        let voxels = Voxels::new(camera, region, settings, fold, 0);
        Self { voxels, first_row: image.first_row, rows, cast, sent: Vec::new() }
    }

    fn cast(
        &mut self,
        marks: &Marks,
        shader: &Shader<f32>,
        (fold, simd, sharing): (Fold, Simd, Sharing),
    ) -> RenderWork {
        let casting = Casting::new(&self.voxels, shader, (fold, simd, sharing));
        let first_row = self.first_row;
        sharing.chunks_beside(&mut self.rows, 1, &mut self.cast, |cast, j, rows| {
            for row in rows {
                row.work = RenderWork::default();
                *cast = row.mark(first_row + j as u32, marks, simd);
                let tiles = casting.visible.of_row(first_row as usize + j);
                (cast[0]..cast[1]).for_each(|at| row.cast(at, tiles, casting));
            }
        });
        let mut work = RenderWork::default();
        self.rows.iter().for_each(|row| work += row.work);
        work
    }

    /// Appends the blocks that were cast last, and differ from those sent before, to a message.
    fn tell(&mut self, width: u32, fold: Fold, is_folded: bool, bytes: &mut Vec<u8>) {
        if self.sent.is_empty() {
            let count = |row: &Row<C>| if is_folded { width as usize } else { row.kept().len() };
            self.sent = self.rows.iter().map(|row| vec![Accumulated::CLEAR; count(row)]).collect();
        }
        for (((j, row), cast), sent) in (self.first_row..).zip(&self.rows).zip(&self.cast).zip(&mut self.sent) {
            for at in cast[0]..cast[1] {
                let (number, range) = row.blocks_of(at, fold);
                let pixel = j * width + at as u32;
                let mut all = Accumulated::CLEAR;
                let mut send = |number: u32, block: &Accumulated<C>, sent: &mut Accumulated<C>| {
                    if !block.same_bits(sent) {
                        *sent = *block;
                        compositor::put(bytes, pixel, number, block);
                    }
                };
                for (place, block) in range.clone().zip(&row.kept()[range.clone()]) {
                    if !is_folded {
                        send(number + (place - range.start) as u32, block, &mut sent[place]);
                    }
                    // Blocks behind this one are hidden within this part already. They are not
                    // up to date and need not be.
                    if all.ends_behind(block, fold, &mut RenderWork::default()) {
                        break;
                    }
                }
                if is_folded {
                    send(number, &all, &mut sent[at]);
                }
            }
        }
    }

    fn sent_bytes(&self) -> u64 {
        self.sent.iter().map(|row| size_of_val(&**row) as u64).sum()
    }
}

/// Returns the samples of a line that belong to blocks whose first sample lies in some layers of
/// voxels.
fn own_samples(line: &Line, fold: Fold, layers: &Range<i64>) -> [u32; 2] {
    let [low, high] = [layers.start as f32, layers.end as f32];
    if line.first == line.end {
        return [line.first, line.first];
    }
    // The blocks of a line, by number. Its z only rises or only falls from one to the next.
    let [first, end] = blocks_of(line, fold);
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
