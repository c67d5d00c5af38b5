//! A recorded session's samples by themselves, without a volume.

use std::path::Path;

use drivers::replay::{SessionReplay, SessionSettings};
use sonoweave_core::reading::{Frame, PixelType};
use sonoweave_core::{Device, Error, NO_DEADLINE, Next, Reading};
use sync::ingest::live::{Live, LiveIngest};

use super::device::DeviceRole;
use super::event::{ADVANCE_EVERY_NS, LATENCY, Latency, SET_UP, SetUp};
use super::recorded_decisions::of_json;

/// The latencies that are subtracted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Latencies {
    /// The roles', throughout; the latencies of the session itself are ignored.
    Given,
    /// The devices' at first, then those that the session received while it ran. Clocks are
    /// advanced as they were then, so that the times equal those of its replay.
    AsRecorded,
}

/// Visits every sample of a session. Each has its device's index among the roles and its
/// clock's time less the latency. Without `images`, a frame is one black pixel.
///
/// # Errors
/// The recording's: damage before its end, or notes that no version of this program wrote.
pub fn walk(
    session: &Path,
    images: bool,
    roles: Vec<DeviceRole>,
    latencies: Latencies,
    mut take: impl FnMut(usize, Live),
) -> Result<(), Error> {
    let mut replay = SessionReplay::open(&SessionSettings { images, ..SessionSettings::new(session) })?;
    let names: Vec<String> = roles.iter().map(|role| role.name.clone()).collect();
    let mut ingests: Vec<LiveIngest> = roles
        .into_iter()
        .map(|DeviceRole { gives, latency_ns, name, .. }| {
            let about = replay.devices().iter().find(|about| about.name == name);
            let timing = about.map(|about| about.description.timing).unwrap_or_default();
            LiveIngest::new(gives, timing, latency_ns)
        })
        .collect();
    let mut advanced_ns = i64::MIN;
    replay.start()?;
    loop {
        let reading = match replay.next(NO_DEADLINE)? {
            Next::Reading(reading) => reading,
            Next::Pending => continue,
            Next::End => break,
        };
        let at_ns = replay.handed_over_ns();
        if latencies == Latencies::AsRecorded && at_ns.saturating_sub(advanced_ns) >= ADVANCE_EVERY_NS {
            advanced_ns = at_ns;
            ingests.iter_mut().for_each(|ingest| ingest.advance(at_ns));
        }
        match reading {
            Reading::Recorded(note) if note.topic == SET_UP => {
                let SetUp { device } = of_json(session, SET_UP, &note.text)?;
                let about = replay.devices().iter().find(|about| about.name == device);
                let timing = about.map(|about| about.description.timing).unwrap_or_default();
                if let Some(place) = names.iter().position(|name| *name == device) {
                    ingests[place].set_up(timing);
                }
            }
            Reading::Recorded(note) if note.topic == LATENCY && latencies == Latencies::AsRecorded => {
                let Latency { device, latency_ns } = of_json(session, LATENCY, &note.text)?;
                if let Some(place) = names.iter().position(|name| *name == device) {
                    ingests[place].set_latency(latency_ns);
                }
            }
            Reading::Recorded(_) | Reading::Raw(_) => {}
            reading => {
                let place = replay.source().and_then(|source| names.iter().position(|name| name == source));
                let Some(place) = place else { continue };
                let reading = match reading {
                    Reading::Frame(frame) if !images => Reading::Frame(blank(frame)),
                    reading => reading,
                };
                take(place, ingests[place].take(reading));
            }
        }
    }
    replay.stop()
}

/// Replaces unread pixels of a frame whose time is needed: a frame without pixels is refused.
fn blank(frame: Frame) -> Frame {
    Frame { size: [1, 1], pixel: PixelType::U8, channels: 1, pixels: vec![0].into(), ..frame }
}
