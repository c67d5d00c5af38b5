//! A recorded sequence as a source of slices: each frame has its transforms beside it, so that its
//! pose is known at once.

use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};

use crossbeam_channel::Sender;

use sonoweave_core::{NO_DEADLINE, Next};
use sync::graph::Route;
use sync::ingest::live::Gives;
use sync::ingest::{Ingest, Sample};
use sync::smoothing::Smoothing;
use sync::survey::Survey;
use sync::{FramePose, PairingOptions, StampedPairing, survey};

use super::common::Common;
use super::device::DeviceRole;
use super::insertion_thread::{InsertMessage, Posed};
use super::sequence_input::SequenceInput;
use super::turns::Stage;
use crate::smoothing::{SensorNoise, SmoothingStatus};
use crate::{CapturedFrame, OffPlane, PipelineError};

/// A recorded sequence, and all poses in it.
pub struct Sequence {
    input: SequenceInput,
    frames: Range<u64>,
    pub(super) off_plane: OffPlane,
    survey: Survey,
    /// Poses of the frames to use.
    pub(super) used: Vec<FramePose>,
}

impl Sequence {
    /// Reads the transforms of a sequence, and smooths its poses if that is asked for. `frames` are
    /// those to use, by their number in it.
    ///
    /// # Errors
    /// [`PipelineError`] if the file is unreadable, has no route to the world, or none of the
    /// frames to use has a pose.
    pub fn open(
        input: impl Into<SequenceInput>,
        frames: Range<u64>,
        off_plane: OffPlane,
        options: &PairingOptions,
        smoothing: Option<Smoothing>,
    ) -> Result<Self, PipelineError> {
        let input = input.into();
        let survey = survey(&mut *input.open(false)?, options, smoothing)?;
        let used: Vec<FramePose> = survey.poses.iter().filter(|pose| frames.contains(&pose.item)).copied().collect();
        if survey.poses.is_empty() {
            return Err(PipelineError::NothingUsed(Box::new(survey.ledger)));
        }
        if used.is_empty() {
            return Err(PipelineError::NoSuchFrames { frames, total: survey.ledger.frames.total });
        }
        Ok(Self { input, frames, off_plane, survey, used })
    }

    /// Returns the number of frames to use.
    pub fn count(&self) -> u64 {
        let total = self.survey.ledger.frames.total;
        self.frames.end.min(total).saturating_sub(self.frames.start)
    }

    /// Returns the recording.
    pub fn input(&self) -> &SequenceInput {
        &self.input
    }

    /// Returns the poses, the refusals and the route to the world, without the range of frames.
    pub fn survey(&self) -> &Survey {
        &self.survey
    }

    /// Returns the role of the only device.
    pub(super) fn role(&self) -> DeviceRole {
        DeviceRole { name: self.input.name(), gives: Gives::Pictures, frames: Vec::new(), latency_ns: 0 }
    }
}

/// Reads a sequence to its end, or until `ends` is set, and sends its slices. Returns notes for
/// the user.
///
/// # Errors
/// [`PipelineError`] if the file is damaged before its end.
pub(super) fn run(
    sequence: Sequence,
    options: PairingOptions,
    common: Common<'_>,
    ends: &AtomicBool,
    slices: &Sender<InsertMessage>,
) -> Result<Vec<String>, PipelineError> {
    let Sequence { input, frames, survey, .. } = sequence;
    let mut ingest = Ingest::new();
    let mut pairing = StampedPairing::with_names(options, &survey.names)?.with_smoothed(survey.smoothed.clone());
    let status = common.status;
    if let Some(smoothed) = &survey.smoothed {
        let mut account = SmoothingStatus::new(smoothed.settings());
        account.sensors = smoothed.noise().filter_map(|(names, found)| SensorNoise::of(names, found)).collect();
        status.lock().smoothing = Some(account);
    }
    pairing.route().iter().for_each(|route| status.route(route));
    let turns = status.turns.begin(Stage::Pairing);
    let mut device = input.open(true)?;
    device.start()?;
    while !ends.load(Ordering::Relaxed) {
        turns.turn();
        let reading = match device.next(NO_DEADLINE)? {
            Next::Reading(reading) => reading,
            Next::Pending => continue,
            Next::End => break,
        };
        let item = reading.stamp().item;
        let image = match ingest.take(reading) {
            Sample::Transform(transform) => {
                pairing.transform(transform);
                continue;
            }
            Sample::Unused(kind) => {
                status.lock().ledger.unused(kind);
                continue;
            }
            _ if !frames.contains(&item) => continue,
            Sample::Refused(refusal) => Err(refusal),
            Sample::Picture(image) => Ok(image),
        };
        status.arrived(0);
        common.in_flight.enter();
        let paired = image.and_then(|image| {
            status.lock().ledger.untimed += u64::from(image.head.untimed);
            let frame = CapturedFrame { item, captured_ns: image.head.time_ns, image: &image.image };
            common.observers.iter().for_each(|observer| observer.captured(&frame));
            pairing.frame(image)
        });
        match paired {
            Ok(paired) => {
                status.lock().ledger.projected(paired.pose.projected, paired.pose.deviation);
                if let (Some(effect), Some(account)) = (&paired.pose.smoothing, &mut status.lock().smoothing) {
                    account.count(effect);
                }
                let (world, slice) = (pairing.route().map_or("", Route::world), paired.slice);
                common.observers.iter().for_each(|observer| observer.slice(world, item, &slice));
                // Insertion has ended if its queue is closed, and reports the reason.
                if slices.send(InsertMessage::Slice(Posed { item, slice, times: None })).is_err() {
                    break;
                }
            }
            Err(refusal) => common.refuse(&refusal),
        }
    }
    device.stop()?;
    Ok(ingest.notes().iter().chain(pairing.notes()).cloned().collect())
}
