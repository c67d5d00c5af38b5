//! Rendering by parts: each worker lights, samples and composites its own part of the volume,
//! and a compositor assembles the picture from their messages.
//!
//! The render region is cut across its z axis, as in Ohbuchi, Chen & Fuchs (1992, section 4.4).
//! Their regional reconstruction and rendering processors correspond to [`Part`], their global
//! compositing processor to [`Compositor`]. A worker receives slices, or the voxels they changed
//! within [`Part::region`]; it sends the changed composited blocks, as bytes.
//!
//! A block of a ray belongs, whole, to the part in which its first sample lies. No sample is
//! lost or taken twice. The compositor composites the same blocks in the same order as a
//! [`Renderer`](super::Renderer), so the picture has the same bits for any number of parts. A
//! part also holds some of its neighbours' voxels, for samples of its blocks beyond the cut.

use simd::Simd;
use simd::sharing::Sharing;
use volume::Values;
use volume::brick::{BrickIndex, EDGE};

use super::RenderError;
use super::camera::Camera;
use super::classify::shade::Shader;
use super::classify::transfer::Transfer;
use super::layers::{Channels, channels};
use super::mode::Mode;
use super::picture::Picture;
use super::rays::composite::{Accumulated, Fold};
use super::rays::line::Line;
use super::rays::marks::Marks;
use super::rays::rows::Row;
use super::region::RenderRegion;
use super::settings::{Cache, RenderSettings};
use super::snapshot::VoxelSnapshot;
use super::voxels::{Sampler, Voxels};
use super::work::RenderWork;

/// Voxels beyond its last sample that a part needs: the cell about it, and the neighbours of its
/// corners.
const MARGIN: f64 = 2.0;

/// One worker's part of the render region.
pub struct Part {
    width: u32,
    marks: Marks,
    shader: Shader<f32>,
    snapshot: VoxelSnapshot,
    fold: Fold,
    simd: Simd,
    /// Lattice indices of the first and last voxel that it needs.
    region: [[i64; 3]; 2],
    image: Channels<PartLayers<1>, PartLayers<3>>,
}

/// Composites the messages of the parts into the picture.
pub struct Compositor {
    size: [u32; 2],
    mode: Mode,
    transfer: Transfer,
    fold: Fold,
    image: Channels<Received<1>, Received<3>>,
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
        let shader = Shader::new(settings, &camera, region);
        let fold = settings.fold(camera.samples())?;
        let mode = settings.mode;
        let layers = i64::from(region.bricks()[2]);
        let cut = |k: u32| i64::from(k) * layers / i64::from(parts) * EDGE as i64;
        let cuts = [cut(part), cut(part + 1)];
        // A block extends out of the part by its own length at most.
        let along = region.region_from_world().matrix3.row(2).length();
        let reach = (f64::from(fold.arity) * camera.step_mm() * along + MARGIN).ceil() as i64;
        let [mut low, mut high] = region.bounds();
        low[2] = low[2].max(region.first()[2] + cuts[0] - reach);
        high[2] = high[2].min(region.first()[2] + cuts[1] + reach);
        let image = match shader.is_grey() {
            true => Channels::Grey(PartLayers::new(&camera, region, settings, fold, cuts)),
            false => Channels::Colour(PartLayers::new(&camera, region, settings, fold, cuts)),
        };
        Ok(Self {
            width: settings.size[0],
            marks: Marks::new(&camera, mode.reach()),
            shader,
            snapshot: VoxelSnapshot::new(region),
            fold,
            simd: settings.simd,
            region: [low, high],
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
        let edge = EDGE as i64;
        let [low, high] = [self.region[0][2].div_euclid(edge), self.region[1][2].div_euclid(edge)];
        let needed: Vec<BrickIndex> =
            bricks.iter().filter(|b| (low..=high).contains(&i64::from(b[2]))).copied().collect();
        let mut message = Message::default();
        message.work.bricks_read = needed.len() as u64;
        let (mut changed, mut dirty) = (Vec::new(), Vec::new());
        self.snapshot.read(volume, &needed, self.simd, Sharing::Alone, &mut changed);
        message.work.bricks_changed = changed.len() as u64;
        if changed.is_empty() {
            return message;
        }
        let voxels = self.snapshot.dilated(&changed);
        let (snapshot, shader, simd) = (&self.snapshot, &self.shader, self.simd);
        message.work.voxels_shaded = channels!(&mut self.image, layers => {
            layers.voxels.update(snapshot, &voxels, shader, simd, Sharing::Alone, &mut dirty)
        });
        self.marks.set(&dirty, None);
        let width = self.width;
        channels!(&mut self.image, layers => layers.cast(&self.marks, shader, width, self.fold, simd, &mut message));
        message
    }
}

/// Data of a part for a number of channels.
struct PartLayers<const C: usize> {
    voxels: Voxels<C>,
    rows: Vec<Row<C>>,
    /// Blocks of each row as last sent to the compositor.
    sent: Vec<Vec<Accumulated<C>>>,
}

impl<const C: usize> PartLayers<C> {
    fn new(
        camera: &Camera,
        region: &RenderRegion,
        settings: &RenderSettings,
        fold: Fold,
        [low, high]: [i64; 2],
    ) -> Self {
        let own = |line: &Line| own_samples(line, fold, [low as f32, high as f32]);
        let rows: Vec<Row<C>> = (0..camera.size()[1])
            .map(|j| {
                let mut row = Row::new(camera, region, j);
                row.restrict(own);
                row.keep(Cache::OneLevel, fold);
                row
            })
            .collect();
        let sent = rows.iter().map(|row| vec![Accumulated::CLEAR; row.kept().len()]).collect();
        Self { voxels: Voxels::new(region, settings), rows, sent }
    }

    fn cast(&mut self, marks: &Marks, shader: &Shader<f32>, width: u32, fold: Fold, simd: Simd, message: &mut Message) {
        let sampler = Sampler::new(&self.voxels, shader);
        for ((j, row), sent) in (0..).zip(&mut self.rows).zip(&mut self.sent) {
            row.work = RenderWork::default();
            let [first, end] = row.mark(j, marks, simd);
            for at in first..end {
                row.cast(at, sampler, fold, simd);
                let (number, range) = row.blocks_of(at, fold);
                let mut all = Accumulated::CLEAR;
                for ((number, block), sent) in (number..).zip(&row.kept()[range.clone()]).zip(&mut sent[range]) {
                    if !block.same_bits(sent) {
                        *sent = *block;
                        put(&mut message.bytes, j * width + at as u32, number, block);
                    }
                    // Blocks behind this one are hidden within this part already. They are not
                    // up to date and need not be.
                    if all.ends_behind(block, fold, &mut RenderWork::default()) {
                        break;
                    }
                }
            }
            message.work += row.work;
        }
    }
}

/// Returns the samples of a line that belong to blocks whose first sample lies in the voxel
/// layers from `low` up to `high`.
fn own_samples(line: &Line, fold: Fold, [low, high]: [f32; 2]) -> [u32; 2] {
    let mut own: Option<[u32; 2]> = None;
    let mut k = line.first;
    while k < line.end {
        let end = fold.block_end(k).min(line.end);
        let [.., z] = line.at(k);
        if z >= low && z < high {
            own = Some([own.map_or(k, |[first, _]| first), end]);
        }
        k = end;
    }
    own.unwrap_or([line.first, line.first])
}

/// Appends a block to a message.
fn put<const C: usize>(bytes: &mut Vec<u8>, pixel: u32, number: u32, block: &Accumulated<C>) {
    bytes.extend(pixel.to_le_bytes());
    // Fewer than 2¹⁶ samples have fewer blocks.
    bytes.extend((number as u16).to_le_bytes());
    block.colour.iter().chain([&block.transmittance]).for_each(|x| bytes.extend(x.to_le_bytes()));
}

impl Compositor {
    /// Creates a picture without any message yet: all transparent.
    ///
    /// # Errors
    /// [`RenderError`] for invalid settings.
    pub fn new(settings: &RenderSettings, region: &RenderRegion) -> Result<Self, RenderError> {
        let camera = Camera::new(&settings.view, settings.size, settings.step, region)?;
        let fold = settings.fold(camera.samples())?;
        let (mode, transfer) = (settings.mode, settings.transfer.clone());
        let image = match mode.is_grey(&transfer) {
            true => Channels::Grey(Received::new(&camera, fold)),
            false => Channels::Colour(Received::new(&camera, fold)),
        };
        Ok(Self { size: settings.size, mode, transfer, fold, image })
    }

    /// Takes a part's message and composites the pixels concerned; returns their number.
    ///
    /// # Errors
    /// [`RenderError::Message`] for bytes that no part of this picture sends; the picture then
    /// stays unchanged.
    pub fn receive(&mut self, bytes: &[u8]) -> Result<u64, RenderError> {
        channels!(&mut self.image, received => received.receive(bytes, self.fold))
    }

    /// Returns the current picture.
    pub fn picture(&self) -> Picture {
        let pixel = |colour, transmittance| self.mode.pixel(colour, transmittance, &self.transfer);
        let pixels = match &self.image {
            Channels::Grey(folded) => folded.pixels.iter().map(|p| pixel([p.colour[0]; 3], p.transmittance)).collect(),
            Channels::Colour(folded) => folded.pixels.iter().map(|p| pixel(p.colour, p.transmittance)).collect(),
        };
        Picture { size: self.size, pixels }
    }
}

/// The blocks of all rays, equally many a ray, nearest first; and the composited pixels.
struct Received<const C: usize> {
    each: usize,
    blocks: Vec<Accumulated<C>>,
    pixels: Vec<Accumulated<C>>,
}

impl<const C: usize> Received<C> {
    /// Bytes of a block.
    const BYTES: usize = 4 + 2 + 4 * (C + 1);

    fn new(camera: &Camera, fold: Fold) -> Self {
        let [width, height] = camera.size().map(|s| s as usize);
        let each = camera.samples().div_ceil(fold.arity) as usize;
        Self {
            each,
            blocks: vec![Accumulated::CLEAR; width * height * each],
            pixels: vec![Accumulated::CLEAR; width * height],
        }
    }

    fn receive(&mut self, bytes: &[u8], fold: Fold) -> Result<u64, RenderError> {
        let mut received = Vec::with_capacity(bytes.len() / Self::BYTES);
        for chunk in bytes.chunks(Self::BYTES) {
            let block =
                Self::read(chunk).filter(|(pixel, number, _)| *pixel < self.pixels.len() && *number < self.each);
            received.push(block.ok_or(RenderError::Message { bytes: bytes.len() })?);
        }
        let mut folded = 0;
        let mut last = None;
        for (pixel, number, block) in &received {
            self.blocks[pixel * self.each + number] = *block;
        }
        for (pixel, ..) in received {
            // A pixel's blocks are consecutive.
            if last.replace(pixel) == Some(pixel) {
                continue;
            }
            let mut all = Accumulated::CLEAR;
            let mut work = RenderWork::default();
            for block in &self.blocks[pixel * self.each..][..self.each] {
                if all.ends_behind(block, fold, &mut work) {
                    break;
                }
            }
            self.pixels[pixel] = all;
            folded += 1;
        }
        Ok(folded)
    }

    /// Returns the pixel, the number of the block, and the block.
    fn read(bytes: &[u8]) -> Option<(usize, usize, Accumulated<C>)> {
        let (pixel, rest) = bytes.split_first_chunk::<4>()?;
        let (number, rest) = rest.split_first_chunk::<2>()?;
        let mut values = rest.chunks(4).map(|x| x.try_into().ok().map(f32::from_le_bytes));
        let mut block = Accumulated::CLEAR;
        for colour in &mut block.colour {
            *colour = values.next()??;
        }
        block.transmittance = values.next()??;
        Some((u32::from_le_bytes(*pixel) as usize, usize::from(u16::from_le_bytes(*number)), block))
    }
}

#[cfg(test)]
mod tests {
    use glam::DMat3;

    use super::super::Renderer;
    use super::super::tests::modes::ways;
    use super::super::tests::{all_settings, sweep};
    use super::*;
    use phantom::Motion;
    use reconstruct::PathReconstructor;

    #[test]
    fn any_number_of_parts_gives_same_picture() {
        let turned = DMat3::from_rotation_z(0.4) * DMat3::from_rotation_x(0.3);
        for (base, motion) in all_settings().into_iter().zip([
            Motion::Freehand,
            Motion::Crossing,
            Motion::Jittered,
            Motion::Freehand,
            Motion::Parallel,
        ]) {
            let (scan, reconstruction, region) = sweep(16, motion, turned);
            for parts in [1, 2, 3, 8] {
                let mut reconstructor =
                    PathReconstructor::general(reconstruction.clone(), scan.mask().clone()).unwrap();
                let mut renderer = Renderer::new(&base, region).unwrap();
                let mut compositor = Compositor::new(&base, &region).unwrap();
                let mut workers: Vec<Part> = (0..parts).map(|k| Part::new(&base, &region, k, parts).unwrap()).collect();
                let (mut sent, mut most) = (0, 0);
                for frame in 0..scan.frames() {
                    let touched = reconstructor.insert(&scan.slice(frame)).unwrap();
                    renderer.update(reconstructor.volume(), &touched.bricks);
                    for worker in &mut workers {
                        let message = worker.update(
                            &Within { volume: reconstructor.volume(), region: worker.region() },
                            &touched.bricks,
                        );
                        compositor.receive(&message.bytes).unwrap();
                        sent += message.bytes.len();
                        most = most.max(message.bytes.len());
                    }
                    let (a, b) = (compositor.picture(), renderer.picture());
                    let same = a.pixels.iter().zip(&b.pixels).all(|(a, b)| a.map(f32::to_bits) == b.map(f32::to_bits));
                    assert!(same, "{parts} parts, frame {frame}: {:?} off {:?}", base.view, a.difference(&b));
                }
                // All the voxels that slices changed would be several times as much.
                assert!(sent > 0 && most < 300_000, "{sent} {most}");
                // Unchanged bricks cause no work.
                let all: Vec<BrickIndex> = reconstructor.volume().bricks().collect();
                for worker in &mut workers {
                    let message =
                        worker.update(&Within { volume: reconstructor.volume(), region: worker.region() }, &all);
                    let idle = RenderWork { bricks_read: message.work.bricks_read, ..RenderWork::default() };
                    assert!(message.bytes.is_empty() && message.work == idle, "{:?}", message.work);
                }
            }
        }
    }

    #[test]
    fn parts_give_same_picture_in_every_mode() {
        for base in ways() {
            let (scan, reconstruction, region) = sweep(12, Motion::Freehand, DMat3::from_rotation_x(0.3));
            let mut reconstructor = PathReconstructor::general(reconstruction, scan.mask().clone()).unwrap();
            let mut compositor = Compositor::new(&base, &region).unwrap();
            let mut workers: Vec<Part> = (0..3).map(|k| Part::new(&base, &region, k, 3).unwrap()).collect();
            for frame in 0..scan.frames() {
                let touched = reconstructor.insert(&scan.slice(frame)).unwrap();
                for worker in &mut workers {
                    let region = Within { volume: reconstructor.volume(), region: worker.region() };
                    compositor.receive(&worker.update(&region, &touched.bricks).bytes).unwrap();
                }
            }
            let mut renderer = Renderer::new(&base, region).unwrap();
            renderer.update_all(reconstructor.volume());
            let (a, b) = (compositor.picture(), renderer.picture());
            assert!(a == b, "{:?}: off by {:?}", base.mode, a.difference(&b));
        }
    }

    /// A volume that holds only a region.
    struct Within<'a, V: ?Sized> {
        volume: &'a V,
        region: [[i64; 3]; 2],
    }

    impl<V: Values + ?Sized> Values for Within<'_, V> {
        fn values(&self, start: [i64; 3], value: &mut [f32], weight: &mut [f32]) {
            self.volume.values(start, value, weight);
            let [low, high] = self.region;
            for (x, (value, weight)) in value.iter_mut().zip(weight).enumerate() {
                let at = [start[0] + x as i64, start[1], start[2]];
                if (0..3).any(|a| !(low[a]..=high[a]).contains(&at[a])) {
                    (*value, *weight) = (f32::NAN, 1.0);
                }
            }
        }

        fn bricks(&self) -> Box<dyn Iterator<Item = BrickIndex> + '_> {
            self.volume.bricks()
        }
    }

    #[test]
    fn invalid_parts_and_messages_are_refused() {
        let (_, _, region) = sweep(2, Motion::Freehand, DMat3::IDENTITY);
        let base = &all_settings()[0];
        let refused =
            |part, parts| Part::new(base, &region, part, parts).err().map(|e| e.to_string()).unwrap_or_default();
        assert!(refused(2, 2).contains("part 2 of 2") && refused(0, 0).contains("counted from 0"));
        assert!(refused(0, 1000).contains("one a layer"));
        let mut compositor = Compositor::new(base, &region).unwrap();
        let before = compositor.picture();
        for bytes in [&[1, 2, 3][..], &[255; 14][..]] {
            assert!(compositor.receive(bytes).is_err_and(|e| e.to_string().contains("message")));
        }
        assert_eq!(compositor.receive(&[]), Ok(0));
        assert_eq!(compositor.picture(), before);
    }
}
