//! A recorded session as what comes in: the same readings in the same order, at the times at which they came.

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

use crossbeam_channel::{Receiver, Sender};
use drivers::clock::MS;
use drivers::recording::session::SessionReplay;
use drivers::{Device, Error, Next, Reading};

use super::Instrument;
use super::decision::Common;
use super::intake::{
    CLEARED, Delivery, LATENCY, Latency, NO_DEVICE, PAUSED, Paused, SET_UP, SetUp, UNPAIRED, Unpaired, Word,
};
use super::pairing::{Came, Feed};
use super::precedent::{Precedent, of_json};
use crate::ledger::Queue;

/// The longest that the recording is waited for before it is looked whether to end, ns.
const TURN: i64 = 50 * MS;

/// A recorded session, and how to understand it.
pub struct Recorded {
    /// The recording, stopped; all of it, paced as wanted.
    pub replay: SessionReplay,
    /// What was decided.
    pub precedent: Precedent,
    /// Its devices, by the names that they have in it.
    pub instruments: Vec<Instrument>,
}

/// What the replay's thread delivers.
pub(super) struct FromRecording(pub(super) Receiver<Delivery>);

impl Feed for FromRecording {
    fn next(&mut self) -> Option<Came> {
        self.0.recv().ok().map(Came::Delivery)
    }
}

/// Delivers a recording until its end, or until it is told to end.
///
/// # Errors
/// The recording's: damage before its end, notes that no version of this program wrote.
pub(super) fn run(
    mut replay: SessionReplay,
    names: &[String],
    common: Common<'_>,
    ends: &AtomicBool,
    onward: &Sender<Delivery>,
) -> Result<(), Error> {
    let path = replay.settings().path.clone();
    let drops = common.precedent.is_some_and(Precedent::drops);
    let mut unpaired = None;
    replay.start()?;
    while !ends.load(Ordering::Relaxed) {
        let reading = match replay.next(common.clock.now_ns() + TURN)? {
            Next::Reading(reading) => reading,
            Next::Pending => continue,
            Next::End => break,
        };
        let at_ns = replay.handed_over_ns();
        let (source, word) = match reading {
            Reading::Raw(_) => continue,
            Reading::Recorded(note) => match note.topic.as_str() {
                SET_UP => {
                    let SetUp { device } = of_json(&path, SET_UP, &note.text)?;
                    let source = place(names, &device, &path)?;
                    let about = replay.devices().iter().find(|about| about.name == device);
                    let timing = about.map(|about| about.description.timing).unwrap_or_default();
                    (source, Word::SetUp(timing))
                }
                LATENCY => {
                    let Latency { device, latency_ns } = of_json(&path, LATENCY, &note.text)?;
                    (place(names, &device, &path)?, Word::Latency(latency_ns))
                }
                PAUSED => (NO_DEVICE, Word::Paused(of_json::<Paused>(&path, PAUSED, &note.text)?.paused)),
                CLEARED => (NO_DEVICE, Word::Cleared),
                UNPAIRED => {
                    unpaired = Some(of_json::<Unpaired>(&path, UNPAIRED, &note.text)?);
                    continue;
                }
                _ => continue,
            },
            reading => {
                let Some(name) = replay.source() else { continue };
                let source = place(names, name, &path)?;
                common.board.arrived(source);
                let was = unpaired.take_if(|was| was.device == *name && was.item == reading.stamp().item);
                if was.is_some() && drops {
                    common.board.dropped(source, Queue::Pairing);
                    continue;
                }
                common.in_flight.enter();
                (source, Word::Reading(reading))
            }
        };
        if onward.send(Delivery { source, at_ns, word }).is_err() {
            break;
        }
    }
    let why = replay.health().why.clone();
    if !why.is_empty() {
        common.board.note(why);
    }
    replay.stop()
}

fn place(names: &[String], device: &str, path: &Path) -> Result<usize, Error> {
    names.iter().position(|name| name == device).ok_or_else(|| Error::Session {
        path: path.to_owned(),
        offset: 0,
        problem: format!("{device:?} is no device of its configuration, which has {}", names.join(" and ")),
    })
}
