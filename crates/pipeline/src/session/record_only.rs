//! A session that only records. Its devices are recorded, and a listener receives every sample
//! at once; before a calibration, slices have no pose.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Instant;

use crossbeam_channel::{RecvTimeoutError, bounded};

use mask::MaskSettings;
use sonoweave_core::clock::Clock;
use sonoweave_core::{Reading, Timing};
use sync::ingest::live::{Live, LiveIngest};

use super::capture_thread::{Parts, captured, capturing, frame_bytes, parts};
use super::common::{Common, InFlight};
use super::device::{DeviceRole, SessionDevice};
use super::event::SessionEvent;
use super::losses::Losses;
use super::priority::SchedulingPolicy;
use super::recorder::{self, Record, Recording};
use super::run::{FRAME_BYTES, READINGS, TURN};
use super::sequencer::EventSequencer;
use super::spawn::{EndOnPanic, joined};
use super::status::{SessionStatus, StatusCollector};
use crate::PipelineError;

/// Recorded events, as passed to the listener.
#[allow(clippy::large_enum_variant, reason = "nearly all values are the large ones, moved once")]
pub enum RecordEvent<'a> {
    /// A sample of the device with this index.
    Sample(usize, Live),
    /// Some time has passed; this is the present status.
    Turn(&'a SessionStatus),
}

/// Records until `ends` is set or the devices have ended. Returns the recording and the final
/// status.
///
/// A slow listener delays no device: the samples that wait for it are in the recording already.
/// If more samples arrive than may wait, the listener misses some, which the status counts as
/// dropped.
///
/// # Errors
/// [`PipelineError`] if there is no recording, or it cannot be begun. Absent devices are not an
/// error.
pub fn record_only(
    devices: Vec<SessionDevice>,
    record: Option<Record>,
    policy: &SchedulingPolicy,
    mask: MaskSettings,
    clock: &dyn Clock,
    ends: &AtomicBool,
    mut handle: impl FnMut(RecordEvent<'_>),
) -> Result<(Option<Recording>, SessionStatus), PipelineError> {
    let Parts { devices, roles, protocols } = parts(devices);
    let status = StatusCollector::new(&roles, i64::MAX);
    status.granted(policy.granted());
    let in_flight = InFlight::new(FRAME_BYTES / frame_bytes(&devices).max(1));
    let keep_free = Arc::new(AtomicU64::new(record.as_ref().map_or(0, |record| record.keep_free_bytes)));
    let opened = roles.iter().zip(&devices).zip(protocols);
    let described = opened.map(|((role, device), protocol)| (&*role.name, protocol, device.describe()));
    let writing = record.map(|record| recorder::open(record, described, mask, &keep_free, clock)).transpose()?;
    let (recorder, writing) = match writing {
        Some((recorder, writing)) => (recorder, Some(writing)),
        None => (recorder::Recorder::nowhere(), None),
    };
    let names: Vec<String> = roles.iter().map(|role| role.name.clone()).collect();
    let (deliver, delivered) = bounded(READINGS);
    let common =
        Common { clock, status: &status, recorder: &recorder, in_flight: &in_flight, decisions: None, observers: &[] };
    recorder.note_rules(clock.now_ns());
    let sequencer = EventSequencer::new(common, names.clone(), deliver);
    let ingest = |DeviceRole { gives, latency_ns, .. }| LiveIngest::new(gives, Timing::default(), latency_ns);
    let mut ingests: Vec<LiveIngest> = roles.into_iter().map(ingest).collect();
    let mut losses = Losses::default();
    let (status, sequencer) = (&status, &sequencer);
    let recording = std::thread::scope(|scope| {
        let _end = EndOnPanic(|| {
            ends.store(true, Ordering::Relaxed);
            sequencer.close();
            common.recorder.close();
        });
        let writer = writing.map(|writing| {
            recorder::start(scope, policy, writing, clock, move |recording| status.recording(recording))
        });
        let captures = capturing(scope, devices, &names, policy, common, ends, sequencer);
        let mut turned = Instant::now();
        loop {
            // A device that is told to end may still give a reading.
            let ended = captures.iter().all(|capture| capture.is_finished());
            match delivered.recv_timeout(TURN) {
                Ok(delivery) => {
                    let source = delivery.source;
                    let live =
                        ingests.get_mut(source).and_then(|ingest| sample(ingest, delivery.event, source, common));
                    if let Some(live) = live {
                        handle(RecordEvent::Sample(source, live));
                    }
                }
                Err(RecvTimeoutError::Timeout) if ended => break,
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => break,
            }
            if turned.elapsed() >= TURN {
                turned = Instant::now();
                let status = status.snapshot();
                losses.log(&status, turned, false);
                handle(RecordEvent::Turn(&status));
            }
        }
        captured(captures, &names, status);
        sequencer.close();
        common.recorder.close();
        writer.map(joined)
    });
    let status = status.snapshot();
    losses.log(&status, Instant::now(), true);
    Ok((recording, status))
}

/// Converts a delivery to a sample, and counts it.
fn sample(ingest: &mut LiveIngest, event: SessionEvent, source: usize, common: Common<'_>) -> Option<Live> {
    let reading = match event {
        SessionEvent::SetUp(timing) => {
            ingest.set_up(timing);
            return None;
        }
        SessionEvent::Latency(latency_ns) => {
            ingest.set_latency(latency_ns);
            return None;
        }
        // There is no volume that could be frozen, cleared or masked.
        SessionEvent::Freeze(_) | SessionEvent::Clear | SessionEvent::Mask(_) => return None,
        SessionEvent::Reading(reading) => reading,
    };
    let is_frame = matches!(reading, Reading::Frame(_));
    let live = ingest.take(reading);
    if is_frame {
        common.in_flight.leave();
    }
    match &live {
        Live::Picture { .. } => common.status.lock().ledger.used(),
        Live::Pose { sample, .. } => {
            common.status.sampled(source, sample.invalid.is_some().then_some("not valid, by the device's word"));
        }
        Live::Waits(_) => common.status.sampled(source, None),
        Live::Refused(refusal) if is_frame => common.status.refused(refusal),
        Live::Refused(refusal) => common.status.sampled(source, Some(refusal.reason.name())),
        Live::Unused(kind) => common.status.sampled(source, Some(kind)),
    }
    Some(live)
}
