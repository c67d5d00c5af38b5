//! A recorded sequence through all stages, synchronously: on one thread but for the reconstructor's own.

use std::ops::Range;

use drivers::{Next, OpenSettings, open};
use glam::DVec3;

use super::loom::{Fates, Loom, Plan};
use super::onlooker::{Onlooker, Woven};
use super::{OffPlane, PipelineError, PixelKind};
use crate::config::Settings as Config;
use crate::ingest::{Ingest, Sample};
use crate::ledger::Ledger;
use crate::mask::{Mask, MaskSettings};
use crate::path::{Chosen, PathChoice};
use crate::reconstruct::planar::PlanarSettings;
use crate::reconstruct::{Settings, Weaver};
use crate::refusal::Refusal;
use crate::sync::survey::gap;
use crate::sync::{FramePose, Pairing, PairingOptions, survey};

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
        chosen,
        off_plane: job.off_plane,
        poses: used,
    };
    let mut run = Run {
        ingest: Ingest::new(),
        pairing: Pairing::with_names(options, &survey.names)?,
        frames: job.frames.clone(),
        loom: Loom::new(plan, mask)?,
        account: Account { ledger: Ledger::default(), insert_ms: Vec::new(), onlooker },
        seen: 0,
    };

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

/// What became of the slices, and who sees them.
struct Account<'a, O> {
    ledger: Ledger,
    insert_ms: Vec<f64>,
    onlooker: &'a mut O,
}

impl<O: Onlooker> Fates for Account<'_, O> {
    fn woven(&mut self, woven: &Woven<'_>) -> Result<(), PipelineError> {
        self.ledger.used();
        self.insert_ms.push(woven.insert.as_secs_f64() * 1e3);
        self.onlooker.woven(woven).map_err(PipelineError::Onlooker)
    }

    fn refused(&mut self, refusal: &Refusal) {
        self.ledger.refused(refusal);
    }
}

/// A run under way.
struct Run<'a, O> {
    ingest: Ingest,
    pairing: Pairing,
    frames: Range<u64>,
    loom: Loom,
    account: Account<'a, O>,
    seen: u64,
}

impl<O: Onlooker> Run<'_, O> {
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
                match self.pairing.frame(picture) {
                    Ok(paired) => {
                        ledger.projected(paired.pose.projected, paired.pose.deviation);
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
