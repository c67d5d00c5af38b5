//! Planes through a volume during its reconstruction, or through its slices.

use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use serde::Serialize;

use export::picture::write_rgb;
use export::sections::{Sheet, SheetPanel};
use pipeline::{InsertedSlice, Outcome};
use reconstruct::PathReconstructor;
use render::section::{Box3, NearestSlices, NearestWork, Planar, PlanarWork, Sampled};
use render::settings::team;
use simd::team::Team;
use statistics::Milliseconds;
use volume::lattice::{Shifted, canonical};

use super::follow::Follow;
use super::series::Series;
use crate::app::render::look::Look;
use crate::app::render::planar::SheetNumbers;
use crate::failure::Failure;

/// Source of the planes' values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Source {
    /// The volume.
    Volume,
    /// The nearest slice's own image, within a slice's reach across its plane.
    Raw,
}

/// Draws planes. The volume is sampled only when a picture is due.
pub(crate) struct Planes {
    look: Look,
    window: Option<[f32; 2]>,
    threads: usize,
    series: Option<Series>,
    source: Source,
    first: Option<FirstSlice>,
    slices: u64,
    to_planes_ms: Vec<f64>,
    work: PlanarWork,
}

/// State that the first slice determines.
struct FirstSlice {
    sheet: Sheet,
    place: Box3,
    /// Offset of voxel indices from the inserter's lattice to the canonical one.
    offset: [i64; 3],
    window: [f32; 2],
    /// Reach of a slice across its plane, mm.
    reach_mm: f64,
    nearest: Vec<NearestSlices>,
    team: Option<Arc<Team>>,
}

/// Statistics of pictures of planes.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct PlanesStatistics {
    /// Time from a slice's arrival until the planes of slices contain it. For planes of the
    /// volume it is the insertion time; they are sampled when a picture is due.
    slice_to_planes_ms: Option<Milliseconds>,
    /// `volume` or `raw`.
    pub(crate) from: &'static str,
    /// Reach of a slice across its plane, mm; for planes of slices.
    reach_mm: Option<f64>,
    pub(crate) picture: SheetNumbers,
    planar_work: Option<PlanarWork>,
    nearest_work: Option<NearestWork>,
}

impl Planes {
    pub(crate) fn new(
        look: &Look,
        window: Option<[f32; 2]>,
        threads: usize,
        series: Option<Series>,
        source: Source,
    ) -> Self {
        Self {
            look: look.clone(),
            window,
            threads,
            series,
            source,
            first: None,
            slices: 0,
            to_planes_ms: Vec::new(),
            work: PlanarWork::default(),
        }
    }

    /// Begins at the first slice, when the lattice and the extent of all slices are known.
    fn begin(&self, inserted: &InsertedSlice) -> Result<FirstSlice, Failure> {
        let lattice = canonical(inserted.reconstructor.world_from_lattice());
        let (Some(reached), Some(kernels)) = (inserted.reached, inserted.reconstructor.kernels()) else {
            fail!("no slice has a pose; check the transforms");
        };
        let place = Box3::new(lattice.world_from_lattice, reached.map(|voxel| lattice.index(voxel)));
        let sheet = self.look.planar.sheet(&place, self.look.view.image_size)?;
        let nearest = match self.source {
            Source::Volume => Vec::new(),
            Source::Raw => sheet.panels.iter().map(|panel| NearestSlices::new(panel.section)).collect(),
        };
        Ok(FirstSlice {
            sheet,
            place,
            offset: lattice.offset,
            window: self.window.unwrap_or_else(|| inserted.pixels.grey_levels()),
            reach_mm: kernels[2].support_mm,
            nearest,
            team: team(self.threads)?,
        })
    }

    fn write(&self, sampled: &[Vec<Sampled>], path: &Path) -> Result<(), Failure> {
        let Some(first) = &self.first else { return Ok(()) };
        Ok(write_rgb(&first.sheet.draw(sampled, first.window, self.look.planar.wash)?, path)?)
    }

    /// Writes the last picture. Returns `None` if there was no slice.
    ///
    /// # Errors
    /// [`Failure`] when it cannot be written.
    pub(crate) fn finish(
        &mut self,
        path: Option<&Path>,
        outcome: &Outcome,
    ) -> Result<Option<PlanesStatistics>, Failure> {
        let Some(first) = &self.first else { return Ok(None) };
        let (sampled, work) = first.sampled(&outcome.reconstructor);
        self.work += work;
        if let Some(path) = path {
            self.write(&sampled, path)?;
        }
        let raw = self.source == Source::Raw;
        let mut nearest_work = NearestWork::default();
        first.nearest.iter().for_each(|nearest| nearest_work += nearest.work());
        Ok(Some(PlanesStatistics {
            slice_to_planes_ms: Milliseconds::of(&self.to_planes_ms),
            from: if raw { "raw" } else { "volume" },
            reach_mm: raw.then_some(first.reach_mm),
            picture: self.look.planar.numbers(&first.sheet, &sampled),
            planar_work: (!raw).then_some(self.work),
            nearest_work: raw.then_some(nearest_work),
        }))
    }
}

impl Follow for Planes {
    fn follow(&mut self, inserted: &InsertedSlice<'_>) -> Result<(), Failure> {
        if self.first.is_none() {
            self.first = Some(self.begin(inserted)?);
        }
        let Some(first) = &mut self.first else { return Ok(()) };
        let began = Instant::now();
        for nearest in &mut first.nearest {
            nearest.insert(inserted.item, inserted.slice, inserted.mask, first.reach_mm);
        }
        self.to_planes_ms.push((inserted.insert + began.elapsed()).as_secs_f64() * 1e3);
        self.slices += 1;
        if let Some(path) =
            self.series.as_ref().and_then(|series| series.path(self.slices - 1, self.slices, inserted.item))
        {
            let (sampled, work) = first.sampled(inserted.reconstructor);
            self.work += work;
            self.write(&sampled, &path)?;
        }
        Ok(())
    }
}

impl FirstSlice {
    fn sampled(&self, reconstructor: &PathReconstructor) -> (Vec<Vec<Sampled>>, PlanarWork) {
        let mut work = PlanarWork::default();
        if !self.nearest.is_empty() {
            return (self.nearest.iter().map(NearestSlices::sampled).collect(), work);
        }
        let volume = Shifted::new(reconstructor.volume(), self.offset);
        let planar = Planar { volume: &volume, place: self.place, team: self.team.as_deref() };
        let sample = |panel: &SheetPanel| {
            let (pixels, done) = planar.sample(&panel.section);
            work += done;
            pixels
        };
        (self.sheet.panels.iter().map(sample).collect(), work)
    }
}
