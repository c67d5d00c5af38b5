//! A recorded session's samples by themselves, for who wants no volume of them.

use std::path::Path;

use drivers::recording::session::{SessionReplay, SessionSettings};
use drivers::{Device, Error, NO_DEADLINE, Next, Reading};

use super::Instrument;
use super::intake::{SET_UP, SetUp};
use super::precedent::of_json;
use crate::ingest::live::{Live, LiveIngest};

/// Walks through a session: every sample with its device's place among the instruments, at the times that its clock gives less the instrument's latency. Latencies that the
/// session itself had, or took over while it ran, do not count.
///
/// # Errors
/// The recording's: damage before its end, notes that no version of this program wrote.
pub fn walk(
    session: &Path,
    images: bool,
    instruments: Vec<Instrument>,
    mut take: impl FnMut(usize, Live),
) -> Result<(), Error> {
    let mut replay = SessionReplay::open(&SessionSettings { images, ..SessionSettings::new(session) })?;
    let names: Vec<String> = instruments.iter().map(|instrument| instrument.name.clone()).collect();
    let mut ingests: Vec<LiveIngest> = instruments
        .into_iter()
        .map(|Instrument { gives, latency_ns, name, .. }| {
            let about = replay.devices().iter().find(|about| about.name == name);
            let timing = about.map(|about| about.description.timing).unwrap_or_default();
            LiveIngest::new(gives, timing, latency_ns)
        })
        .collect();
    replay.start()?;
    loop {
        let reading = match replay.next(NO_DEADLINE)? {
            Next::Reading(reading) => reading,
            Next::Pending => continue,
            Next::End => break,
        };
        match reading {
            Reading::Recorded(note) if note.topic == SET_UP => {
                let SetUp { device } = of_json(session, SET_UP, &note.text)?;
                let about = replay.devices().iter().find(|about| about.name == device);
                let timing = about.map(|about| about.description.timing).unwrap_or_default();
                if let Some(place) = names.iter().position(|name| *name == device) {
                    ingests[place].set_up(timing);
                }
            }
            Reading::Recorded(_) | Reading::Raw(_) => {}
            reading => {
                let place = replay.source().and_then(|source| names.iter().position(|name| name == source));
                let Some(place) = place else { continue };
                take(place, ingests[place].take(reading));
            }
        }
    }
    replay.stop()
}
