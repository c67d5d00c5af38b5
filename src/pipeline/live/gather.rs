//! A session of which nothing is woven: devices are recorded, and whoever asked for it hears every sample at once. Before a calibration no slice has a place.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Instant;

use crossbeam_channel::{RecvTimeoutError, bounded};
use drivers::clock::Clock;
use drivers::{Reading, Timing};

use super::board::{Account, Board};
use super::capture::InFlight;
use super::decision::Common;
use super::intake::{Intake, Word};
use super::losses::Losses;
use super::priority::Role;
use super::recorder::{self, Recording};
use super::session::{Bed, Instrument};
use super::{FRAME_BYTES, Parts, READINGS, TURN, captured, capturing, frame_bytes, joined, parts, spawn};
use crate::ingest::live::{Live, LiveIngest};
use crate::mask::MaskSettings;
use crate::pipeline::PipelineError;

/// What there is to hear.
#[allow(clippy::large_enum_variant, reason = "nearly all values are the large ones, moved once")]
pub enum Heard<'a> {
    /// A sample of the device with this place.
    Sample(usize, Live),
    /// Some time has passed; this is how the session is.
    Turn(&'a Account),
}

/// Gathers until it is told to end, or its devices have ended. The recording, and how it all was.
///
/// A listener that takes long holds up no device: what waits for it is in the recording already. Where more comes than may wait it hears some less, which the account counts
/// as dropped.
///
/// # Errors
/// [`PipelineError`] where there is no recording, or it cannot be begun. Devices that are away end nothing.
pub fn gather(
    bed: Bed,
    mask: MaskSettings,
    clock: &dyn Clock,
    ends: &AtomicBool,
    mut hear: impl FnMut(Heard<'_>),
) -> Result<(Option<Recording>, Account), PipelineError> {
    let Bed { equipment, record, standing, .. } = bed;
    let Parts { devices, instruments, speeches } = parts(equipment);
    let board = Board::new(&instruments, i64::MAX);
    board.granted(standing.granted());
    let in_flight = InFlight::new(FRAME_BYTES / frame_bytes(&devices).max(1));
    let keep_free = Arc::new(AtomicU64::new(record.as_ref().map_or(0, |record| record.keep_free_bytes)));
    let speakers = instruments.iter().zip(&devices).zip(speeches);
    let told = speakers.map(|((instrument, device), speech)| (&*instrument.name, speech, device.describe()));
    let writing = record.map(|record| recorder::open(record, told, mask, &keep_free, clock)).transpose()?;
    let (recorder, writing) = match writing {
        Some((recorder, writing)) => (recorder, Some(writing)),
        None => (recorder::Recorder::nowhere(), None),
    };
    let names: Vec<String> = instruments.iter().map(|instrument| instrument.name.clone()).collect();
    let (deliver, delivered) = bounded(READINGS);
    let common = Common { clock, board: &board, recorder: &recorder, in_flight: &in_flight, precedent: None };
    let intake = Intake::new(common, names.clone(), deliver);
    let ingest = |Instrument { gives, latency_ns, .. }| LiveIngest::new(gives, Timing::default(), latency_ns);
    let mut ingests: Vec<LiveIngest> = instruments.into_iter().map(ingest).collect();
    let mut losses = Losses::default();
    let (board, intake) = (&board, &intake);
    let recording = std::thread::scope(|scope| {
        let writer = writing.map(|(queue, file)| {
            spawn(scope, "recorder", (&standing, Role::Usual), move || {
                recorder::run(&queue, file, clock, |recording| board.recording(recording))
            })
        });
        let captures = capturing(scope, devices, &names, &standing, common, ends, intake);
        let mut turned = Instant::now();
        loop {
            let ended = ends.load(Ordering::Relaxed) || captures.iter().all(|capture| capture.is_finished());
            match delivered.recv_timeout(TURN) {
                Ok(delivery) => {
                    let source = delivery.source;
                    let live = ingests.get_mut(source).and_then(|ingest| sample(ingest, delivery.word, source, common));
                    if let Some(live) = live {
                        hear(Heard::Sample(source, live));
                    }
                }
                Err(RecvTimeoutError::Timeout) if ended => break,
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => break,
            }
            if turned.elapsed() >= TURN {
                turned = Instant::now();
                let account = board.snapshot();
                losses.say(&account, turned, false);
                hear(Heard::Turn(&account));
            }
        }
        ends.store(true, Ordering::Relaxed);
        captured(captures, &names, board);
        intake.close();
        common.recorder.close();
        writer.map(joined)
    });
    let account = board.snapshot();
    losses.say(&account, Instant::now(), true);
    Ok((recording, account))
}

/// A delivery as a sample, counted.
fn sample(ingest: &mut LiveIngest, word: Word, source: usize, common: Common<'_>) -> Option<Live> {
    let reading = match word {
        Word::SetUp(timing) => {
            ingest.set_up(timing);
            return None;
        }
        Word::Latency(latency_ns) => {
            ingest.set_latency(latency_ns);
            return None;
        }
        // Nothing is woven that could be paused or cleared.
        Word::Paused(_) | Word::Cleared => return None,
        Word::Reading(reading) => reading,
    };
    let is_frame = matches!(reading, Reading::Frame(_));
    let live = ingest.take(reading);
    if is_frame {
        common.in_flight.leave();
    }
    match &live {
        Live::Picture { .. } => common.board.lock().ledger.used(),
        Live::Pose { sample, .. } => {
            common.board.sampled(source, sample.invalid.is_some().then_some("not valid, by the device's word"));
        }
        Live::Waits(_) => common.board.sampled(source, None),
        Live::Refused(refusal) if is_frame => common.board.refused(refusal),
        Live::Refused(refusal) => common.board.sampled(source, Some(refusal.reason.name())),
        Live::Unused(kind) => common.board.sampled(source, Some(kind)),
    }
    Some(live)
}
