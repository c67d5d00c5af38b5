//! A recorded session as a feed: the same readings in the same order, with their arrival times.

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

use crossbeam_channel::{Receiver, Sender};

use drivers::replay::SessionReplay;
use sonoweave_core::clock::MS;
use sonoweave_core::ledger::Queue;
use sonoweave_core::{Device, Error, Next, Reading};

use super::common::{Common, DROPPED};
use super::device::DeviceRole;
use super::event::{
    CLEAR, CLEAR_BEFORE, Delivery, FREEZE, FREEZE_BEFORE, Feed, FeedEvent, Freeze, LATENCY, Latency, MASK, Masked,
    NO_DEVICE, SET_UP, SessionEvent, SetUp, UNPAIRED, Unpaired,
};
use super::recorded_decisions::{RecordedDecisions, of_json};

/// Longest wait for the recording before `ends` is checked, ns.
const TURN: i64 = 50 * MS;

/// A recorded session, and the data needed to interpret it.
pub struct Recorded {
    /// The complete recording, stopped, with the desired pacing.
    pub replay: SessionReplay,
    /// The recorded decisions.
    pub decisions: RecordedDecisions,
    /// Its devices, by their names in the recording.
    pub roles: Vec<DeviceRole>,
}

/// The feed of the replay's thread.
pub(super) struct FromRecording(pub(super) Receiver<Delivery>);

impl Feed for FromRecording {
    fn next(&mut self) -> Option<FeedEvent> {
        self.0.recv().ok().map(FeedEvent::Delivery)
    }
}

/// Delivers a recording until its end, or until `ends` is set.
///
/// # Errors
/// The recording's: damage before its end, or notes that no version of this program wrote.
pub(super) fn run(
    mut replay: SessionReplay,
    names: &[String],
    common: Common<'_>,
    ends: &AtomicBool,
    sender: &Sender<Delivery>,
) -> Result<(), Error> {
    let path = replay.settings().path.clone();
    let drops = common.decisions.is_some_and(RecordedDecisions::drops);
    let mut unpaired = None;
    replay.start()?;
    while !ends.load(Ordering::Relaxed) {
        let reading = match replay.next(common.clock.now_ns() + TURN)? {
            Next::Reading(reading) => reading,
            Next::Pending => continue,
            Next::End => break,
        };
        let at_ns = replay.handed_over_ns();
        let (source, event) = match reading {
            Reading::Raw(_) => continue,
            Reading::Recorded(note) => match note.topic.as_str() {
                SET_UP => {
                    let SetUp { device } = of_json(&path, SET_UP, &note.text)?;
                    let source = place(names, &device, &path)?;
                    let about = replay.devices().iter().find(|about| about.name == device);
                    let timing = about.map(|about| about.description.timing).unwrap_or_default();
                    (source, SessionEvent::SetUp(timing))
                }
                LATENCY => {
                    let Latency { device, latency_ns } = of_json(&path, LATENCY, &note.text)?;
                    (place(names, &device, &path)?, SessionEvent::Latency(latency_ns))
                }
                kind @ (FREEZE | FREEZE_BEFORE) => {
                    let Freeze { on } = of_json(&path, kind, &note.text)?;
                    (NO_DEVICE, SessionEvent::Freeze(on))
                }
                CLEAR | CLEAR_BEFORE => (NO_DEVICE, SessionEvent::Clear),
                MASK => {
                    let Masked { change } = of_json(&path, MASK, &note.text)?;
                    (NO_DEVICE, SessionEvent::Mask(change))
                }
                UNPAIRED => {
                    unpaired = Some(of_json::<Unpaired>(&path, UNPAIRED, &note.text)?);
                    continue;
                }
                _ => continue,
            },
            reading => {
                let Some(name) = replay.source() else { continue };
                let source = place(names, name, &path)?;
                common.status.arrived(source);
                let was = unpaired.take_if(|was| was.device == *name && was.item == reading.stamp().item);
                if was.is_some() && drops {
                    common.status.dropped(source, Queue::Pairing);
                    if matches!(reading, Reading::Frame(_)) {
                        common.lost(reading.stamp().item, DROPPED);
                    }
                    continue;
                }
                common.in_flight.enter();
                (source, SessionEvent::Reading(reading))
            }
        };
        if sender.send(Delivery { source, at_ns, event }).is_err() {
            break;
        }
    }
    let why = replay.health().why.clone();
    if !why.is_empty() {
        common.status.note(why);
    }
    replay.stop()
}

fn place(names: &[String], device: &str, path: &Path) -> Result<usize, Error> {
    names.iter().position(|name| name == device).ok_or_else(|| {
        let problem = format!("has messages of {device:?}, but its configuration has {} only", names.join(" and "));
        formats::Error::Session { path: path.to_owned(), problem }.into()
    })
}
