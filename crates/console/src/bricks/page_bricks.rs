//! A page's bricks: its dirty set, and its messages on their way.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use tokio::sync::Notify;

use pipeline::session::BrickCopy;
use render::RenderRegion;
use sonoweave_core::clock::{Clock as _, Monotonic};
use volume::brick::BrickIndex;

use super::dirty_set::DirtySet;
use super::drawing::Drawing;
use super::message::{MOST, Message, fits, is_empty};
use crate::encoded_frame::unix_ms;

/// Largest number of unanswered messages of a page.
const ON_THEIR_WAY: u32 = 2;
/// A page's messages count as lost if it answers none of them for this long.
const FORGIVEN: Duration = Duration::from_secs(2);

/// Reads bricks, in the order of the list.
pub(super) type Read<'a> = &'a mut dyn FnMut(&[BrickIndex]) -> Vec<Box<BrickCopy>>;

/// The bricks of a page that draws the volume.
#[derive(Debug)]
pub(crate) struct PageBricks {
    state: Mutex<State>,
    ready: Notify,
}

/// A message to be sent.
#[derive(Debug)]
struct Encoded {
    bytes: Vec<u8>,
    /// Its bricks, and whether nothing of each was seen.
    bricks: Vec<(BrickIndex, bool)>,
}

#[derive(Debug)]
struct State {
    set: DirtySet,
    /// The last word to the page: the box that its bricks must lie in, and their grey values.
    told: Option<(RenderRegion, [f32; 2])>,
    message: Option<Encoded>,
    unanswered: u32,
    sequence: u32,
    since: Instant,
    /// Whether the page knows that it misses nothing.
    is_complete: bool,
}

impl PageBricks {
    /// Creates the bricks of a page that has none, for a volume of these.
    pub(super) fn new(bricks: impl IntoIterator<Item = BrickIndex>, now: Instant) -> Arc<Self> {
        let mut set = DirtySet::default();
        set.note_all(bricks, now);
        let (told, message, unanswered, sequence, is_complete) = Default::default();
        let state = State { set, told, message, unanswered, sequence, since: now, is_complete };
        Arc::new(Self { state: Mutex::new(state), ready: Notify::new() })
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Notes changed bricks, or that any brick may have changed and `bricks` are all.
    pub(super) fn note(&self, bricks: impl IntoIterator<Item = BrickIndex>, all: bool, now: Instant) {
        let set = &mut self.state().set;
        if all { set.note_all(bricks, now) } else { set.note(bricks, now) }
    }

    /// Notes that the page is told this before the next message. It then forgets bricks outside of
    /// the region, and all if their grey values are others.
    pub(crate) fn tell(&self, drawing: &Drawing) {
        let state = &mut *self.state();
        let told = (drawing.region, drawing.window);
        if let Some(Encoded { bricks, .. }) = state.message.take() {
            // It may hold bricks outside of the region.
            state.set.note(bricks.into_iter().map(|(brick, _)| brick), Instant::now());
        }
        state.set.keep(|brick| drawing.region.holds(brick), Instant::now());
        if state.told.is_some_and(|(_, window)| window != drawing.window) {
            state.set.note_all([], Instant::now());
        }
        state.told = drawing.is_possible().then_some(told);
        state.is_complete = false;
    }

    /// Reads and encodes the most urgent bricks, if the page has room for a message.
    pub(super) fn serve(&self, read: Read, is_in_view: impl Fn(BrickIndex) -> bool, now: Instant) {
        let mut guard = self.state();
        let state = &mut *guard;
        let told = state.told;
        let Some((region, window)) = told else { return };
        if state.unanswered > 0 && now.saturating_duration_since(state.since) >= FORGIVEN {
            state.unanswered = 0;
        }
        if state.message.is_some() || state.unanswered >= ON_THEIR_WAY {
            return;
        }
        let is_told = |brick: BrickIndex| fits(brick) && region.holds(brick);
        let bricks = state.set.take(MOST, now, is_told, is_in_view);
        if bricks.is_empty() && (state.is_complete || state.set.missing(is_told) > 0) {
            return;
        }
        // Reading waits for the volume, and the page's connection must not.
        drop(guard);
        let copies = if bricks.is_empty() { Vec::new() } else { read(&bricks) };
        let state = &mut *self.state();
        if state.told != told {
            state.set.note(bricks, now);
            return;
        }
        let mut message = Message::new();
        let mut sent = Vec::with_capacity(bricks.len());
        for (brick, copy) in bricks.into_iter().zip(&copies) {
            let is_empty = is_empty(copy);
            // The page knows that it has no brick there.
            if !is_empty || state.set.holds(brick) {
                message.add(brick, copy, window);
            }
            sent.push((brick, is_empty));
        }
        let missing = state.set.missing(is_told);
        state.is_complete = missing == 0;
        state.sequence = state.sequence.wrapping_add(1);
        let bytes = message.finish(missing, state.sequence, unix_ms(Monotonic.now_ns()));
        state.message = Some(Encoded { bytes, bricks: sent });
        self.ready.notify_one();
    }

    /// Returns the next message, once there is one.
    pub(crate) async fn next(&self) -> Vec<u8> {
        loop {
            {
                let state = &mut *self.state();
                if let Some(Encoded { bytes, bricks }) = state.message.take() {
                    bricks.into_iter().for_each(|(brick, is_empty)| state.set.sent(brick, is_empty));
                    state.unanswered += 1;
                    state.since = Instant::now();
                    return bytes;
                }
            }
            self.ready.notified().await;
        }
    }

    /// Notes that the page has answered a message.
    pub(crate) fn answered(&self, sequence: u32) {
        let state = &mut *self.state();
        if sequence <= state.sequence {
            state.unanswered = state.unanswered.saturating_sub(1);
        }
    }
}
