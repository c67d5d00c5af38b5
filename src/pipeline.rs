//! The stages in flow order: device → ingest → pairing → mask → reconstruction.
//!
//! A recording runs through them synchronously, on one thread but for the reconstructor's own.

mod onlooker;

use std::ops::Range;
use std::time::Instant;

use drivers::{Next, OpenSettings, open};
use glam::DVec3;

pub use onlooker::{Onlooker, Woven};

use crate::config::Settings as Config;
use crate::ingest::{Ingest, Sample};
use crate::ledger::Ledger;
use crate::mask::{AutoMask, Found, Mask, MaskPlan, MaskSettings};
use crate::path::{Chosen, NotPlanar, PathChoice};
use crate::reconstruct::planar::PlanarSettings;
use crate::reconstruct::settings::IN_PLANE_SIGMA;
use crate::reconstruct::{Path, Refused, Settings, SettingsError, Weaver};
use crate::refusal::{Reason, Refusal};
use crate::slice::{Pixels, Slice};
use crate::sync::extent::{mean_axes, reached};
use crate::sync::survey::{SurveyError, gap};
use crate::sync::{FramePose, NoPath, Pairing, PairingOptions, Survey, survey};

/// Pictures that wait for the mask may hold this much; of larger ones, fewer are looked at.
const MOST_WAITING_BYTES: usize = 64 << 20;

/// Off-plane σ.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum OffPlane {
    /// As the settings have it.
    Settings,
    /// Half the 90th-percentile gap between neighbouring slices, from all poses of the recording.
    Auto,
}

/// What to reconstruct, and how.
#[derive(Debug, Clone)]
pub struct Job {
    /// The recording.
    pub input: OpenSettings,
    /// The same, without pixels, for the survey.
    pub survey: OpenSettings,
    /// Constant transforms and the picture's frame.
    pub config: Config,
    /// Name of the frame where the volume shall live, before the configuration's.
    pub world: Option<String>,
    /// What of the picture is data.
    pub mask: MaskSettings,
    /// The reconstructor's settings.
    pub settings: Settings,
    /// Off-plane σ.
    pub off_plane: OffPlane,
    /// Who says which path slices go.
    pub path: PathChoice,
    /// The planar path's settings.
    pub planar: PlanarSettings,
    /// Frames to use, by their number in the recording.
    pub frames: Range<u64>,
}

/// What a run did.
pub struct Outcome {
    /// The volume and how it was made.
    pub reconstructor: Weaver,
    /// The path that was chosen, and why; [`Weaver::path`] is where it ended.
    pub chosen: Chosen,
    /// What became of every frame.
    pub ledger: Ledger,
    /// Name of the frame where the volume lives, and the transforms that lead there.
    pub world: String,
    /// The transforms from the image to the world, in words.
    pub route: String,
    /// What of the picture was data.
    pub mask: Mask,
    /// First and last voxel that the slices' data and kernels reach, by the poses known before the first was woven.
    pub reached: Option<[[i64; 3]; 2]>,
    /// The slices' mean directions of u and v in the world, where there are such.
    pub slice_axes: Option<[DVec3; 2]>,
    /// Milliseconds that each slice took to enter the volume, in-plane filtering included.
    pub insert_ms: Vec<f64>,
    /// Voxels that gained weight, summed over slices.
    pub voxels_updated: u64,
    /// Whether the pictures were of 8 bits, of 16, or of floating point.
    pub pixels: PixelKind,
    /// What the user should know: sentences.
    pub notes: Vec<String>,
}

/// Scalar type of the pictures as they reach the reconstructor.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PixelKind {
    /// 8 bit unsigned.
    U8,
    /// 16 bit unsigned.
    U16,
    /// Single precision.
    F32,
}

impl PixelKind {
    /// Black and white. Of floating point they are as in pictures of 8 bits: that is how grey levels are converted.
    pub fn grey_levels(self) -> [f32; 2] {
        match self {
            Self::U8 | Self::F32 => [0.0, 255.0],
            Self::U16 => [0.0, 65_535.0],
        }
    }
}

/// Why a run failed as a whole.
#[derive(Debug, thiserror::Error)]
pub enum PipelineError {
    /// The device.
    #[error(transparent)]
    Device(#[from] drivers::Error),
    /// The image cannot be placed in the world.
    #[error(transparent)]
    NoPath(#[from] NoPath),
    /// The mask leaves nothing.
    #[error(transparent)]
    Mask(#[from] calibration::region::BadRegion),
    /// The reconstructor's settings do not fit the pictures.
    #[error(transparent)]
    Settings(#[from] SettingsError),
    /// The planar path was asked for, and the poses are none for it.
    #[error("--path planar: {0}")]
    NotPlanar(#[from] NotPlanar),
    /// The volume does not fit the memory it may take.
    #[error("frame {item}: {source}")]
    Memory {
        /// Number of the frame in the recording.
        item: u64,
        /// How much is missing.
        #[source]
        source: Refused,
    },
    /// No frame was used.
    #[error("no frame could be used: {0}")]
    NothingUsed(Box<Ledger>),
    /// The frames asked for are not in the recording, or none of them has a usable pose.
    #[error(
        "--frames {start}..{end} holds no frame that can be used: the recording has frames 0 to {last}",
        start = frames.start,
        end = if frames.end == u64::MAX { String::new() } else { frames.end.to_string() },
        last = total.saturating_sub(1)
    )]
    NoSuchFrames {
        /// The frames asked for.
        frames: Range<u64>,
        /// Frames of the recording.
        total: u64,
    },
    /// There are too few slices to tell the gap between them.
    #[error("--sigma auto needs at least two slices with poses in different places; give --sigma or --resolution")]
    NoGap,
    /// Who looked on could not go on.
    #[error(transparent)]
    Onlooker(Box<dyn std::error::Error + Send + Sync>),
}

impl From<SurveyError> for PipelineError {
    fn from(error: SurveyError) -> Self {
        match error {
            SurveyError::Device(e) => Self::Device(e),
            SurveyError::NoPath(e) => Self::NoPath(e),
        }
    }
}

/// How far a run has come.
#[derive(Debug, Clone, Copy)]
pub struct Progress {
    /// Frames behind.
    pub done: u64,
    /// Frames in all.
    pub total: u64,
}

/// Runs a recording through all stages; the onlooker sees the volume after each slice.
///
/// # Errors
/// [`PipelineError`] when the run as a whole cannot give a volume. Single frames that cannot be used are in the ledger instead.
pub fn reconstruct(
    mut job: Job,
    onlooker: &mut impl Onlooker,
    mut progress: impl FnMut(Progress),
) -> Result<Outcome, PipelineError> {
    let options = PairingOptions::new(&job.config, job.world.as_deref());
    let survey = survey(open(&job.survey)?.as_mut(), &options)?;
    let used: Vec<FramePose> = survey.poses.iter().filter(|p| job.frames.contains(&p.item)).copied().collect();
    let Some(first) = used.first() else {
        return Err(match survey.poses.is_empty() {
            true => PipelineError::NothingUsed(Box::new(survey.ledger)),
            false => PipelineError::NoSuchFrames { frames: job.frames, total: survey.ledger.frames.total },
        });
    };
    let [width, height] = first.size;
    let plan = job.mask.plan(width, height)?;
    job.settings.sigma_mm[2] = match job.off_plane {
        OffPlane::Settings => job.settings.sigma_mm[2],
        OffPlane::Auto => Some(0.5 * gap(&used).ok_or(PipelineError::NoGap)?),
    };
    let chosen = Chosen::by_poses(job.path, &job.settings, &job.planar, &used)?;
    let mut run = Run::new(&job, chosen, plan, &survey, options, used, onlooker)?;

    let mut device = open(&job.input)?;
    let total = device.describe().items.unwrap_or(0);
    device.start()?;
    loop {
        match device.next(drivers::NO_DEADLINE)? {
            Next::Reading(reading) => {
                let sample = run.ingest.take(reading);
                run.take(sample)?;
                progress(Progress { done: run.seen, total });
            }
            Next::Pending => {}
            Next::End => break,
        }
    }
    device.stop()?;
    run.finish()
}

/// What to say of kernels that are narrower than the lattice can hold: along which axes, and what to do. A σ across the plane that was taken from
/// the slices' own gaps is as wide as it need be, as is one that reaches half a voxel whatever its σ; and methods that go from pixel to pixel have
/// no other width in the plane.
fn narrow(weaver: &Weaver, off_plane: OffPlane) -> Option<String> {
    let settings = weaver.settings();
    let spacing = settings.spacing_mm.max_element();
    // The default in the plane is this very σ; rounding must not make it narrow.
    let least = IN_PLANE_SIGMA * spacing * (1.0 - 1e-9);
    let in_plane = !settings.method.interpolates();
    let across = off_plane == OffPlane::Settings && !settings.compounding.selects();
    let axes = [("u", in_plane), ("v", in_plane), ("the normal", across)];
    let narrow: Vec<String> = axes
        .iter()
        .zip(weaver.kernels()?)
        .filter(|((_, counts), kernel)| *counts && kernel.sigma_mm < least)
        .map(|((axis, _), kernel)| format!("{:.3} mm along {axis}", kernel.sigma_mm))
        .collect();
    (!narrow.is_empty()).then(|| {
        format!(
            "the kernel's σ is below {IN_PLANE_SIGMA} voxel ({}, voxels of {spacing} mm): what lies between voxels is lost, and slices \
             far apart leave holes; choose a finer --spacing or a larger --sigma",
            narrow.join(", ")
        )
    })
}

/// The mask stage: slices wait until the picture's border is known.
enum Masking {
    Searching { search: AutoMask, waiting: Vec<(u64, Slice)>, bytes: usize },
    Known(Box<Weaver>),
}

/// What it takes to weave, but for the mask.
struct Weaving {
    choice: PathChoice,
    settings: Settings,
    planar: PlanarSettings,
    chosen: Chosen,
}

impl Weaving {
    /// The mask is known, and with it the path.
    fn begin(&mut self, mask: &Mask, notes: &mut Vec<String>) -> Result<Masking, SettingsError> {
        let weaver = self.chosen.weaver(self.choice, &self.settings, &self.planar, mask)?;
        tracing::info!(path = weaver.path().name(), why = self.chosen.why, "slices go this path");
        if self.choice == PathChoice::Auto && weaver.path() == Path::Planar {
            notes.push(format!(
                "woven by the planar path, for {}: the volume's axes are the scan's, as its header says; --path general keeps to the world's",
                self.chosen.why
            ));
        }
        if let Some(departure) = weaver.upgraded() {
            notes.push(format!("{departure}; the general path weaves all frames"));
        }
        Ok(Masking::Known(Box::new(weaver)))
    }
}

/// A run under way.
struct Run<'a, O> {
    ingest: Ingest,
    pairing: Pairing,
    ledger: Ledger,
    weaving: Weaving,
    off_plane: OffPlane,
    frames: Range<u64>,
    poses: Vec<FramePose>,
    reached: Option<[[i64; 3]; 2]>,
    slice_axes: Option<[DVec3; 2]>,
    onlooker: &'a mut O,
    stage: Masking,
    mask: Option<Mask>,
    notes: Vec<String>,
    insert_ms: Vec<f64>,
    pixels: PixelKind,
    seen: u64,
}

impl<'a, O: Onlooker> Run<'a, O> {
    fn new(
        job: &Job,
        chosen: Chosen,
        plan: MaskPlan,
        survey: &Survey,
        options: PairingOptions,
        poses: Vec<FramePose>,
        onlooker: &'a mut O,
    ) -> Result<Self, PipelineError> {
        let pairing = Pairing::with_names(options, &survey.names)?;
        let mut weaving = Weaving { choice: job.path, settings: job.settings.clone(), planar: job.planar, chosen };
        let mut notes = Vec::new();
        let (stage, mask) = match plan {
            MaskPlan::Auto(search) => (Masking::Searching { search, waiting: Vec::new(), bytes: 0 }, None),
            MaskPlan::Fixed(mask) => (weaving.begin(&mask, &mut notes)?, Some(mask)),
        };
        Ok(Self {
            ingest: Ingest::new(),
            pairing,
            ledger: Ledger::default(),
            weaving,
            off_plane: job.off_plane,
            frames: job.frames.clone(),
            poses,
            reached: None,
            slice_axes: None,
            onlooker,
            stage,
            mask,
            notes,
            insert_ms: Vec::new(),
            pixels: PixelKind::U8,
            seen: 0,
        })
    }

    /// The border was found: what has waited for it goes on.
    fn found(&mut self, found: Found) -> Result<(), PipelineError> {
        self.notes.extend(found.notes);
        let known = self.weaving.begin(&found.mask, &mut self.notes)?;
        self.mask = Some(found.mask);
        if let Masking::Searching { waiting, .. } = std::mem::replace(&mut self.stage, known) {
            for (item, slice) in waiting {
                self.insert(item, &slice)?;
            }
        }
        Ok(())
    }

    fn take(&mut self, sample: Sample) -> Result<(), PipelineError> {
        match sample {
            Sample::Transform(transform) => self.pairing.transform(transform),
            Sample::Unused(kind) => self.ledger.unused(kind),
            Sample::Refused(refusal) => {
                self.seen += 1;
                if self.frames.contains(&refusal.item) {
                    self.ledger.arrived();
                    self.ledger.refused(&refusal);
                }
            }
            Sample::Picture(picture) => {
                self.seen += 1;
                let head = picture.head;
                let item = head.stamp.item;
                if !self.frames.contains(&item) {
                    return Ok(());
                }
                self.ledger.arrived();
                self.ledger.untimed += u64::from(head.untimed);
                match self.pairing.frame(picture) {
                    Ok(paired) => {
                        self.ledger.projected(paired.pose.projected, paired.pose.deviation);
                        self.slice(item, paired.slice)?;
                    }
                    Err(refusal) => self.ledger.refused(&refusal),
                }
            }
        }
        Ok(())
    }

    fn slice(&mut self, item: u64, slice: Slice) -> Result<(), PipelineError> {
        let found = match &mut self.stage {
            Masking::Known(_) => return self.insert(item, &slice),
            Masking::Searching { search, waiting, bytes } => {
                let found = search.push(&slice.image);
                *bytes += slice.image.pixels().bytes();
                waiting.push((item, slice));
                found.or_else(|| (*bytes > MOST_WAITING_BYTES).then(|| search.finish()))
            }
        };
        found.map_or(Ok(()), |found| self.found(found))
    }

    fn insert(&mut self, item: u64, slice: &Slice) -> Result<(), PipelineError> {
        let Masking::Known(weaver) = &mut self.stage else { return Ok(()) };
        let (began, before) = (Instant::now(), weaver.path());
        let result = weaver.insert(slice);
        let took = began.elapsed();
        if weaver.path() != before
            && let Some(departure) = weaver.upgraded()
        {
            tracing::warn!(item, %departure, "the general path takes over");
            self.notes.push(format!(
                "frame {item}: {departure}; the general path has taken over from there, on the same lattice"
            ));
        }
        let reason = match result {
            Ok(touched) => {
                // The lattice and the kernels are known from the first slice on.
                if let (None, Some(kernels), Some(data)) =
                    (self.reached, weaver.kernels(), self.mask.as_ref().and_then(Mask::bounds))
                {
                    let supports_mm = kernels.each_ref().map(|k| k.support_mm);
                    self.reached = reached(&self.poses, data, supports_mm, weaver.world_from_lattice());
                    self.slice_axes = mean_axes(&self.poses);
                }
                self.ledger.used();
                self.insert_ms.push(took.as_secs_f64() * 1e3);
                self.pixels = match slice.image.pixels() {
                    Pixels::U8(_) => PixelKind::U8,
                    Pixels::U16(_) => PixelKind::U16,
                    Pixels::F32(_) => PixelKind::F32,
                };
                let Some(mask) = &self.mask else { return Ok(()) };
                let woven = Woven {
                    item,
                    slice,
                    mask,
                    weaver,
                    touched: &touched.bricks,
                    slab: touched.slab,
                    upgraded: weaver.path() != before,
                    insert: took,
                    reached: self.reached,
                    slice_axes: self.slice_axes,
                    pixels: self.pixels,
                };
                return self.onlooker.woven(&woven).map_err(PipelineError::Onlooker);
            }
            Err(source @ Refused::Memory { .. }) => return Err(PipelineError::Memory { item, source }),
            // Before the first slice the settings are at fault, later the pose.
            Err(Refused::Settings(error)) if self.ledger.frames.used == 0 => return Err(error.into()),
            Err(Refused::Settings(error)) => (Reason::PixelSize, error.to_string()),
            Err(e @ Refused::Repeated) => (Reason::Repeated, e.to_string()),
            Err(e @ Refused::Size { .. }) => (Reason::SizeChanged, e.to_string()),
            Err(e @ Refused::Degenerate) => (Reason::PoseSingular, e.to_string()),
            Err(e @ Refused::OutOfTime) => (Reason::OutOfTime, e.to_string()),
            Err(e @ Refused::OutOfRange) => (Reason::OutOfRange, e.to_string()),
            Err(e @ Refused::Departure(_)) => (Reason::OutOfPlane, e.to_string()),
        };
        self.ledger.refused(&Refusal::new(item, reason.0, reason.1));
        Ok(())
    }

    fn finish(mut self) -> Result<Outcome, PipelineError> {
        let found = match &mut self.stage {
            Masking::Searching { search, .. } => Some(search.finish()),
            Masking::Known(_) => None,
        };
        if let Some(found) = found {
            self.found(found)?;
        }
        let (Masking::Known(weaver), Some(mask)) = (self.stage, self.mask) else {
            return Err(PipelineError::NothingUsed(Box::new(self.ledger)));
        };
        if self.ledger.frames.used == 0 {
            return Err(PipelineError::NothingUsed(Box::new(self.ledger)));
        }
        let route = self.pairing.route();
        let mut notes = self.ingest.notes().to_vec();
        notes.extend_from_slice(self.pairing.notes());
        notes.append(&mut self.notes);
        notes.extend(narrow(&weaver, self.off_plane));
        Ok(Outcome {
            world: route.map(|r| r.world().to_owned()).unwrap_or_default(),
            route: route.map(|r| r.describe()).unwrap_or_default(),
            voxels_updated: weaver.work().voxels_updated,
            reconstructor: *weaver,
            chosen: self.weaving.chosen,
            ledger: self.ledger,
            mask,
            reached: self.reached,
            slice_axes: self.slice_axes,
            insert_ms: self.insert_ms,
            pixels: self.pixels,
            notes,
        })
    }
}
