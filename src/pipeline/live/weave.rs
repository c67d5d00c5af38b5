//! The weaving thread: slices into the volume, in the order in which they were posed.

use std::collections::VecDeque;
use std::num::NonZeroU64;
use std::time::Duration;

use super::decision::Common;
use super::fabric::{Fabric, News, Shared};
use super::pulse::Stage;
use crate::pipeline::loom::Fates;
use crate::pipeline::{PipelineError, Woven};
use crate::refusal::{Reason, Refusal};
use crate::slice::Slice;
use crossbeam_channel::{Receiver, RecvTimeoutError};

/// The longest that the thread waits before it takes a turn, as one that lives does.
const TURN: Duration = Duration::from_millis(100);

/// A slice, and when what it is made of was here.
pub(super) struct Posed {
    /// Its frame's number.
    pub(super) item: u64,
    pub(super) slice: Slice,
    /// `None` of a recording, whose times are over.
    pub(super) times: Option<Times>,
}

/// What weaving is given, in order.
#[allow(clippy::large_enum_variant, reason = "nearly all values are the large ones, moved twice")]
pub(super) enum Onto {
    /// A slice.
    Slice(Posed),
    /// What follows goes into an empty volume.
    Cleared,
}

/// Host ns.
#[derive(Debug, Clone, Copy)]
pub(super) struct Times {
    /// When the frame was captured.
    pub(super) captured_ns: i64,
    /// When the reading came that made its pose known.
    pub(super) known_ns: i64,
}

/// Tells what became of slices, some of which have waited for the mask.
struct Teller<'a> {
    common: Common<'a>,
    waiting: &'a mut VecDeque<(u64, Option<Times>)>,
    news: &'a mut News,
}

impl Teller<'_> {
    /// It is decided upon: when it was captured.
    fn leaves(&mut self, item: u64) -> Option<Option<Times>> {
        let place = self.waiting.iter().position(|(waiting, _)| *waiting == item)?;
        self.waiting.remove(place).map(|(_, times)| times)
    }
}

impl Fates for Teller<'_> {
    fn woven(&mut self, woven: &Woven<'_>) -> Result<(), PipelineError> {
        let Some(times) = self.leaves(woven.item) else { return Ok(()) };
        let Common { clock, board, .. } = self.common;
        self.news.note(woven, times.map(|times| times.captured_ns));
        let mut account = board.lock();
        account.volume = self.news.bulk();
        account.ledger.used();
        if let Some(times) = times {
            let now_ns = clock.now_ns();
            account.first_slice_ns.get_or_insert(now_ns);
            account.capture_to_volume.add_ns(now_ns - times.captured_ns);
            account.pose_to_volume.add_ns(now_ns - times.known_ns);
        }
        drop(account);
        self.common.used(woven.item);
        Ok(())
    }

    fn refused(&mut self, refusal: &Refusal) {
        self.leaves(refusal.item);
        self.common.refuse(refusal);
    }
}

/// Empties the volume, when what waits for the mask has gone into it.
fn clear(
    shared: &Shared,
    common: Common<'_>,
    waiting: &mut VecDeque<(u64, Option<Times>)>,
) -> Result<(), PipelineError> {
    let mut fabric = shared.lock();
    let Fabric { loom, news, .. } = &mut *fabric;
    loom.clear(&mut Teller { common, waiting, news })?;
    news.clear();
    common.board.lock().volume = None;
    drop(fabric);
    shared.tell();
    Ok(())
}

/// Weaves until no slice follows. Where that is the volume's end, slices that wait for the mask go on. Where one of so many slices is to be pictured, that picture is waited
/// for; where the mask made some wait, that of the last of them.
///
/// # Errors
/// What no slice could be woven with. A full volume is none: its slices are refused.
pub(super) fn run(
    shared: &Shared,
    from: &Receiver<Onto>,
    common: Common<'_>,
    ends: bool,
    pictured: Option<NonZeroU64>,
) -> Result<(), PipelineError> {
    let mut waiting = VecDeque::new();
    let mut result = Ok(());
    let beat = common.board.pulse.of(Stage::Weaving);
    loop {
        beat.turn();
        let Posed { item, slice, times } = match from.recv_timeout(TURN) {
            Ok(Onto::Slice(posed)) => posed,
            Ok(Onto::Cleared) => {
                result = clear(shared, common, &mut waiting);
                match result {
                    Ok(()) => continue,
                    Err(_) => break,
                }
            }
            Err(RecvTimeoutError::Timeout) => continue,
            Err(RecvTimeoutError::Disconnected) => break,
        };
        waiting.push_back((item, times));
        let mut fabric = shared.lock();
        let Fabric { loom, news, .. } = &mut *fabric;
        let before = news.woven;
        let mut teller = Teller { common, waiting: &mut waiting, news };
        let taken = loom.take(item, slice, &mut teller);
        match taken {
            Ok(()) => {}
            Err(PipelineError::Memory { item, source }) => {
                teller.refused(&Refusal::new(item, Reason::VolumeFull, source.to_string()));
            }
            Err(error) => {
                result = Err(error);
                break;
            }
        }
        let woven = news.woven;
        drop(fabric);
        shared.tell();
        if pictured.is_some_and(|every| woven / every > before / every) {
            shared.await_picture();
        }
    }
    let mut fabric = shared.lock();
    let Fabric { loom, news, ended, .. } = &mut *fabric;
    if result.is_ok() && ends {
        let mut teller = Teller { common, waiting: &mut waiting, news };
        result = loom.end(&mut teller);
    }
    *ended = true;
    drop(fabric);
    shared.tell();
    result
}
