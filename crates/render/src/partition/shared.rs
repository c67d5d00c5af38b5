//! Parts whose threads share memory. Their blocks stay where they are, and every row of the
//! picture is composited from them in view order.

use simd::sharing::Sharing;
use volume::brick::BrickIndex;
use volume::{Prism, Values};

use super::{Part, PartLayers, own_samples};
use crate::RenderError;
use crate::camera::Camera;
use crate::crop::LatticeCrop;
use crate::layers::{Channels, Image, channels};
use crate::rays::composite::{Accumulated, Fold};
use crate::rays::line::Line;
use crate::rays::rows::Row;
use crate::region::RenderRegion;
use crate::settings::RenderSettings;
use crate::snapshot::VoxelSnapshot;
use crate::voxels::Sampler;
use crate::work::RenderWork;

/// All parts of one picture, from the first layer of voxels to the last; none if it is rendered
/// without parts.
#[derive(Default)]
pub(crate) struct Parts(Vec<Part>);

/// A part's data for a number of channels, those of its picture.
pub(crate) trait Of<const C: usize> {
    fn layers(&self) -> Option<&PartLayers<C>>;
}

impl Of<1> for Part {
    fn layers(&self) -> Option<&PartLayers<1>> {
        if let Channels::Grey(layers) = &self.image { Some(layers) } else { None }
    }
}

impl Of<3> for Part {
    fn layers(&self) -> Option<&PartLayers<3>> {
        if let Channels::Colour(layers) = &self.image { Some(layers) } else { None }
    }
}

impl Parts {
    /// Creates so many parts of a picture's rays, of an empty volume; threads share the work.
    ///
    /// # Errors
    /// Those of [`Part::new`].
    pub(crate) fn new(
        settings: &RenderSettings,
        region: &RenderRegion,
        (camera, image): (&Camera, &Image),
        parts: u32,
        sharing: Sharing,
    ) -> Result<Self, RenderError> {
        let mut made: Vec<Option<Result<Part, RenderError>>> = (0..parts).map(|_| None).collect();
        sharing.chunks(&mut made, 1, |part, made| {
            made[0] = Some(Part::of(settings, region, camera, image, part as u32, parts));
        });
        made.into_iter().flatten().collect::<Result<_, _>>().map(Self)
    }

    /// Returns the number of parts; 1 if the picture is rendered without.
    pub(crate) fn count(&self) -> u32 {
        self.0.len().max(1) as u32
    }

    pub(crate) fn is_none(&self) -> bool {
        self.0.is_empty()
    }

    /// Reads some bricks of a volume, each into the parts that need it.
    pub(crate) fn read(&mut self, volume: &(impl Values + ?Sized), bricks: &[BrickIndex], sharing: Sharing) {
        sharing.chunks(&mut self.0, 1, |_, parts| {
            parts[0].read(volume, bricks, Sharing::Alone);
        });
    }

    /// Returns whether changes were read that are not drawn yet.
    pub(crate) fn has_changed(&self) -> bool {
        self.0.iter().any(|part| !part.changed.is_empty())
    }

    /// Draws what was read: each part by itself, then the rows of the picture from them. All
    /// changed voxels lie in the slab, if one is given; region coordinates.
    pub(crate) fn draw(&mut self, slab: Option<&Prism>, image: &mut Image, fold: Fold, sharing: Sharing) -> RenderWork {
        let mut works = vec![RenderWork::default(); self.0.len()];
        sharing.chunks_beside(&mut self.0, 1, &mut works, |work, _, parts| {
            *work = parts[0].draw(slab, Sharing::Alone);
        });
        let mut work = RenderWork::default();
        works.into_iter().for_each(|of| work += of);
        // A part's own pixels are only its share of the picture's.
        work.pixels_changed = 0;
        work += channels!(image, layers => self.composite(&mut layers.rows, fold, sharing));
        work
    }

    /// Composites again the pixels of which any part has cast rays.
    fn composite<const C: usize>(&self, rows: &mut [Row<C>], fold: Fold, sharing: Sharing) -> RenderWork
    where
        Part: Of<C>,
    {
        let parts: Vec<&PartLayers<C>> = self.0.iter().filter_map(Part::layers).collect();
        sharing.chunks(rows, 1, |j, rows| {
            let row = &mut rows[0];
            row.work = RenderWork::default();
            let first = parts.iter().map(|part| part.cast[j][0]).min().unwrap_or(0);
            let end = parts.iter().map(|part| part.cast[j][1]).max().unwrap_or(0);
            for at in first..end {
                let mut all = Accumulated::CLEAR;
                let mut work = RenderWork::default();
                in_view_order(&parts, &row.lines()[at])
                    .flat_map(|part| &part.rows[j].kept()[part.rows[j].blocks_of(at, fold).1])
                    .any(|block| all.ends_behind(block, fold, &mut work));
                row.work += work;
                row.set(at, all);
            }
        });
        let mut work = RenderWork::default();
        rows.iter().for_each(|row| work += row.work);
        work
    }

    /// Returns the samples of a line, part by part in view order, with the samplers of their
    /// voxels; without parts, all of them with that of the picture's own voxels.
    pub(crate) fn along<'a, const C: usize>(
        &'a self,
        whole: Sampler<'a, C>,
        line: &Line,
        fold: Fold,
    ) -> Vec<(Sampler<'a, C>, Line)>
    where
        Part: Of<C>,
    {
        if self.is_none() {
            return vec![(whole, *line)];
        }
        in_view_order(&self.0, line)
            .filter_map(|part| {
                let [first, end] = own_samples(line, fold, &part.layers);
                Some((Sampler::new(&part.layers()?.voxels, &part.shader), Line { first, end, ..*line }))
            })
            .collect()
    }

    /// Hides other parts of the volume, from the next reading on.
    pub(crate) fn set_crop(&mut self, crop: impl Fn() -> LatticeCrop) {
        self.0.iter_mut().for_each(|part| part.crop = crop());
    }

    /// Moves the voxels of all parts together, each from the part that owns it. The picture is
    /// rendered without parts from then on; the caches of the parts' rays are dropped.
    pub(crate) fn unite(&mut self, snapshot: &mut VoxelSnapshot, image: &mut Image) {
        for Part { snapshot: own, layers, image: of_part, .. } in self.0.drain(..) {
            snapshot.adopt(own, &layers);
            match (&mut *image, of_part) {
                (Channels::Grey(whole), Channels::Grey(part)) => whole.voxels.adopt(part.voxels, &layers),
                (Channels::Colour(whole), Channels::Colour(part)) => whole.voxels.adopt(part.voxels, &layers),
                // All have the channels of their settings.
                _ => {}
            }
        }
    }

    /// Returns the bytes of voxels and of rays.
    pub(crate) fn bytes(&self) -> [u64; 2] {
        let memories = self.0.iter().map(Part::memory);
        memories.fold([0; 2], |[voxels, rays], of| [voxels + of.voxels, rays + of.rays])
    }

    /// Returns the bricks that hold anything, each once.
    pub(crate) fn bricks(&self) -> usize {
        self.0.iter().map(|part| part.snapshot.len_within(&part.layers)).sum()
    }
}

/// Returns parts in the order in which a line meets them.
fn in_view_order<'a, T>(parts: &'a [T], line: &Line) -> impl Iterator<Item = &'a T> + use<'a, T> {
    let backwards = line.step[2] < 0.0;
    (0..parts.len()).map(move |n| &parts[if backwards { parts.len() - 1 - n } else { n }])
}
