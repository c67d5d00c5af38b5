//! A recorded sequence through all stages, synchronously: on one thread, except the
//! reconstructor's own.

use std::ops::Range;

use glam::DVec3;

use config::Settings as Config;
use drivers::{OpenSettings, open};
use mask::{Mask, MaskSettings};
use reconstruct::path_choice::{Chosen, PathChoice};
use reconstruct::planar::PlanarSettings;
use reconstruct::{PathReconstructor, Settings};
use sonoweave_core::Next;
use sonoweave_core::ledger::Ledger;
use sonoweave_core::refusal::Refusal;
use sync::graph::Route;
use sync::ingest::{Ingest, Sample};
use sync::survey;
use sync::survey::gap;
use sync::{FramePose, StampedPairing};

use super::inserter::{OutcomeSink, Plan, VolumeInserter};
use super::observer::{CapturedFrame, InsertedSlice, Observer};
use super::{OffPlane, PipelineError, PixelKind};

/// A reconstruction's inputs and settings.
#[derive(Debug, Clone)]
pub struct Job {
    /// The recording.
    pub input: OpenSettings,
    /// The same, without pixels, for the survey.
    pub survey: OpenSettings,
    /// Constant transforms and the image's coordinate frame.
    pub config: Config,
    /// Name of the frame for the volume; takes precedence over the configuration's.
    pub world: Option<String>,
    /// The frame's data region.
    pub mask: MaskSettings,
    /// The reconstructor's settings.
    pub settings: Settings,
    /// Off-plane σ.
    pub off_plane: OffPlane,
    /// The choice of insertion path.
    pub path: PathChoice,
    /// The planar path's settings.
    pub planar: PlanarSettings,
    /// Frames to use, by their number in the recording.
    pub frames: Range<u64>,
}

/// Result of a run.
pub struct Outcome {
    /// The volume and its settings.
    pub reconstructor: PathReconstructor,
    /// The initially chosen path, and the reason; [`PathReconstructor::path`] is the final one.
    pub chosen: Chosen,
    /// The frame ledger.
    pub ledger: Ledger,
    /// Name of the frame in which the volume lies.
    pub world: String,
    /// Description of the transforms from the image to the world.
    pub route: String,
    /// The frames' data region.
    pub mask: Mask,
    /// First and last voxel that the slices' data and kernels reach, by the poses known before
    /// the first insertion.
    pub reached: Option<[[i64; 3]; 2]>,
    /// The slices' mean directions of u and v in the world, if they exist.
    pub slice_axes: Option<[DVec3; 2]>,
    /// Insertion time of each slice, ms, including in-plane filtering.
    pub insert_ms: Vec<f64>,
    /// Voxels that gained weight, summed over slices.
    pub voxels_updated: u64,
    /// Whether the frames had 8 bits, 16 bits, or floating point.
    pub pixels: PixelKind,
    /// Notes for the user, as sentences.
    pub notes: Vec<String>,
}

/// Progress of a run.
#[derive(Debug, Clone, Copy)]
pub struct Progress {
    /// Frames handled.
    pub done: u64,
    /// Frames in all.
    pub total: u64,
}

/// Runs a recording through all stages; the observer receives the volume after each slice.
///
/// # Errors
/// [`PipelineError`] if the run as a whole cannot give a volume. Single unusable frames are
/// counted in the ledger instead.
pub fn reconstruct(
    mut job: Job,
    observer: &dyn Observer,
    mut progress: impl FnMut(Progress),
) -> Result<Outcome, PipelineError> {
    let options = job.config.pairing_options(job.world.as_deref());
    let survey = survey(open(&job.survey).map_err(sonoweave_core::Error::from)?.as_mut(), &options)?;
    let used: Vec<FramePose> = survey.poses.iter().filter(|p| job.frames.contains(&p.item)).copied().collect();
    let Some(first) = used.first() else {
        return Err(match survey.poses.is_empty() {
            true => PipelineError::NothingUsed(Box::new(survey.ledger)),
            false => PipelineError::NoSuchFrames { frames: job.frames, total: survey.ledger.frames.total },
        });
    };
    let [width, height] = first.size;
    let mask = job.mask.plan(width, height)?;
    job.settings.sigma_mm[2] = match job.off_plane {
        OffPlane::Settings => job.settings.sigma_mm[2],
        OffPlane::Auto => Some(0.5 * gap(&used).ok_or(PipelineError::NoGap)?),
    };
    let chosen = Chosen::by_poses(job.path, &job.settings, &job.planar, &used)?;
    let plan = Plan {
        choice: job.path,
        settings: job.settings.clone(),
        planar: job.planar,
        chosen: Some(chosen),
        reach: Vec::new(),
        off_plane: job.off_plane,
        poses: used,
    };
    let mut run = Run {
        ingest: Ingest::new(),
        pairing: StampedPairing::with_names(options, &survey.names)?,
        frames: job.frames.clone(),
        loom: VolumeInserter::new(plan, mask)?,
        account: Account { ledger: Ledger::default(), insert_ms: Vec::new(), observer },
        seen: 0,
    };

    let mut device = open(&job.input).map_err(sonoweave_core::Error::from)?;
    let total = device.describe().items.unwrap_or(0);
    device.start()?;
    loop {
        match device.next(sonoweave_core::NO_DEADLINE)? {
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

/// Counts the slices' outcomes, and calls the observer.
struct Account<'a> {
    ledger: Ledger,
    insert_ms: Vec<f64>,
    observer: &'a dyn Observer,
}

impl OutcomeSink for Account<'_> {
    fn woven(&mut self, woven: &InsertedSlice<'_>) -> Result<(), PipelineError> {
        self.ledger.used();
        self.insert_ms.push(woven.insert.as_secs_f64() * 1e3);
        self.observer.inserted(woven).map_err(PipelineError::Observer)
    }

    fn refused(&mut self, refusal: &Refusal) {
        self.ledger.refused(refusal);
    }
}

/// A run in progress.
struct Run<'a> {
    ingest: Ingest,
    pairing: StampedPairing,
    frames: Range<u64>,
    loom: VolumeInserter,
    account: Account<'a>,
    seen: u64,
}

impl Run<'_> {
    fn take(&mut self, sample: Sample) -> Result<(), PipelineError> {
        let ledger = &mut self.account.ledger;
        match sample {
            Sample::Transform(transform) => self.pairing.transform(transform),
            Sample::Unused(kind) => ledger.unused(kind),
            Sample::Refused(refusal) => {
                self.seen += 1;
                if self.frames.contains(&refusal.item) {
                    ledger.arrived();
                    ledger.refused(&refusal);
                }
            }
            Sample::Picture(picture) => {
                self.seen += 1;
                let head = picture.head;
                let item = head.stamp.item;
                if !self.frames.contains(&item) {
                    return Ok(());
                }
                ledger.arrived();
                ledger.untimed += u64::from(head.untimed);
                let frame = CapturedFrame { item, captured_ns: head.time_ns, image: &picture.image };
                self.account.observer.captured(&frame);
                let ledger = &mut self.account.ledger;
                match self.pairing.frame(picture) {
                    Ok(paired) => {
                        ledger.projected(paired.pose.projected, paired.pose.deviation);
                        let world = self.pairing.route().map_or("", Route::world);
                        self.account.observer.slice(world, item, &paired.slice);
                        self.loom.take(item, paired.slice, &mut self.account)?;
                    }
                    Err(refusal) => ledger.refused(&refusal),
                }
            }
        }
        Ok(())
    }

    fn finish(mut self) -> Result<Outcome, PipelineError> {
        self.loom.end(&mut self.account)?;
        let Some(cloth) = self.loom.finish() else {
            return Err(PipelineError::NothingUsed(Box::new(self.account.ledger)));
        };
        let route = self.pairing.route();
        let mut notes = self.ingest.notes().to_vec();
        notes.extend_from_slice(self.pairing.notes());
        notes.extend(cloth.notes);
        Ok(Outcome {
            world: route.map(|r| r.world().to_owned()).unwrap_or_default(),
            route: route.map(|r| r.describe()).unwrap_or_default(),
            voxels_updated: cloth.weaver.work().voxels_updated,
            reconstructor: cloth.weaver,
            chosen: cloth.chosen,
            ledger: self.account.ledger,
            mask: cloth.mask,
            reached: cloth.reached,
            slice_axes: cloth.slice_axes,
            insert_ms: self.account.insert_ms,
            pixels: cloth.pixels,
            notes,
        })
    }
}
