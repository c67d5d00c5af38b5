//! What browsers see, between the stages that make it and those who look: the newest picture of each kind, and who looks at it.
//!
//! A stage leaves its newest picture here and goes on; no browser is waited for, and of a picture at which nobody looks nothing is made.

use std::collections::BTreeSet;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::{Duration, SystemTime};

use rustix::time::{ClockId, clock_gettime};
use tokio::sync::watch;

use super::marks::Marks;
use super::sight::{Sight, Steer};
use crate::coach::Coach;
use crate::pipeline::live::{Drawn, Glimpsed, Witness};
use crate::render::camera::View;
use crate::slice::Pixels;

/// Between two questions of who draws, while somebody looks: a hand that turns what it sees notices no more.
const ASKED: Duration = Duration::from_millis(8);
/// The same while nobody does.
const IDLE: Duration = Duration::from_millis(100);

/// What a picture is of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Kind {
    /// The scanner's picture.
    Slice = 1,
    /// The volume.
    View = 2,
}

/// Grey or colour, 8 bits.
#[derive(Debug, Clone)]
pub enum Pixmap {
    /// One byte a pixel.
    Grey(Arc<[u8]>),
    /// Red, green, blue.
    Colour(Arc<[u8]>),
}

/// A picture for browsers.
#[derive(Debug, Clone)]
pub struct Shot {
    /// What it is of.
    pub kind: Kind,
    /// Its number among those of its kind, from 1.
    pub sequence: u32,
    /// Pixels to the right and down.
    pub size: [u32; 2],
    /// The pixels.
    pub pixels: Pixmap,
    /// The frame, or the last one that is in it.
    pub item: u64,
    /// When that was captured, ms since the UNIX epoch; `None` of a recording.
    pub captured_ms: Option<f64>,
    /// Whether a finer one follows.
    pub refining: bool,
}

/// Who looks, and who steers.
#[derive(Debug, Default)]
struct Audience {
    next: u64,
    present: BTreeSet<u64>,
    steering: Option<u64>,
}

/// The newest pictures.
#[derive(Debug)]
pub struct Screen {
    shots: [watch::Sender<Option<Arc<Shot>>>; 2],
    looked_at: [AtomicU32; 2],
    made: [AtomicU32; 2],
    sight: Mutex<Sight>,
    audience: Mutex<Audience>,
    /// Who knows what is to be marked in the view.
    coach: OnceLock<Arc<Coach>>,
    marked: AtomicU32,
    /// Changes whenever somebody else steers.
    turns: watch::Sender<u64>,
}

impl Default for Screen {
    fn default() -> Self {
        let shot = || watch::Sender::new(None);
        Self {
            shots: [shot(), shot()],
            looked_at: Default::default(),
            made: Default::default(),
            sight: Mutex::default(),
            audience: Mutex::default(),
            coach: OnceLock::new(),
            marked: AtomicU32::new(0),
            turns: watch::Sender::new(0),
        }
    }
}

/// Places of a kind's picture.
fn place(kind: Kind) -> usize {
    kind as usize - 1
}

impl Screen {
    /// Whether anybody looks at the volume.
    pub fn is_watched(&self) -> bool {
        self.is_looked_at(Kind::View)
    }

    /// For how long who draws need not ask whether the view is another one.
    pub fn turn(&self) -> Duration {
        if self.is_watched() { ASKED } else { IDLE }
    }

    /// The view, where the settings have this one.
    pub fn view(&self, home: View) -> View {
        self.sight().view(home)
    }

    /// A picture of the volume was drawn, on a background.
    pub fn drawn(&self, drawn: &Drawn, background: [f32; 3]) {
        self.sight().drawn(&drawn.renderer);
        if !self.is_watched() {
            return;
        }
        let picture = drawn.renderer.picture();
        let pixels = Pixmap::Colour(picture.over(background).into());
        let Drawn { item, captured_ns, refining, .. } = *drawn;
        self.show(Kind::View, picture.size, pixels, item, captured_ns.map(unix_ms), refining);
    }

    /// Marks in the view from now on what this coach knows. The first one stays.
    pub fn follow(&self, coach: &Arc<Coach>) {
        self.coach.get_or_init(|| Arc::clone(coach));
    }

    /// What is to be marked in the view's last picture; `None` without a picture, and where nobody looks or knows.
    pub(super) fn marks(&self, now_ns: i64) -> Option<Marks> {
        let coach = self.coach.get().filter(|_| self.is_watched())?;
        let sequence = self.made(Kind::View);
        if sequence == 0 {
            return None;
        }
        self.marked.fetch_add(1, Ordering::Relaxed);
        let outlines = coach.outlines(now_ns);
        Marks::of(&outlines, &self.sight(), sequence)
    }

    /// Times that it was worked out what is to be marked.
    pub fn marked(&self) -> u32 {
        self.marked.load(Ordering::Relaxed)
    }

    /// Pictures of a kind that were made for browsers.
    pub fn made(&self, kind: Kind) -> u32 {
        self.made[place(kind)].load(Ordering::Relaxed)
    }

    fn is_looked_at(&self, kind: Kind) -> bool {
        self.looked_at[place(kind)].load(Ordering::Relaxed) > 0
    }

    fn show(&self, kind: Kind, size: [u32; 2], pixels: Pixmap, item: u64, captured_ms: Option<f64>, refining: bool) {
        let sequence = self.made[place(kind)].fetch_add(1, Ordering::Relaxed).wrapping_add(1);
        let shot = Shot { kind, sequence, size, pixels, item, captured_ms, refining };
        self.shots[place(kind)].send_replace(Some(Arc::new(shot)));
    }

    fn sight(&self) -> MutexGuard<'_, Sight> {
        self.sight.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn audience(&self) -> MutexGuard<'_, Audience> {
        self.audience.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Somebody comes; who comes first steers.
    pub(super) fn enter(self: &Arc<Self>) -> Seat {
        let mut audience = self.audience();
        audience.next += 1;
        let number = audience.next;
        audience.present.insert(number);
        audience.steering.get_or_insert(number);
        Seat { screen: Arc::clone(self), number, looks: [false; 2] }
    }
}

impl Witness for Screen {
    fn glimpsed(&self, glimpsed: &Glimpsed<'_>) {
        if !self.is_looked_at(Kind::Slice) {
            return;
        }
        let Glimpsed { item, captured_ns, image } = *glimpsed;
        let grey = match image.pixels() {
            Pixels::U8(grey) => Arc::clone(grey),
            Pixels::U16(grey) => grey.iter().map(|value| (value >> 8) as u8).collect(),
            Pixels::F32(grey) => grey.iter().map(|value| value.round().clamp(0.0, 255.0) as u8).collect(),
        };
        let size = [image.width(), image.height()];
        self.show(Kind::Slice, size, Pixmap::Grey(grey), item, Some(unix_ms(captured_ns)), false);
    }
}

/// One who looks; gone when dropped.
#[derive(Debug)]
pub(super) struct Seat {
    screen: Arc<Screen>,
    number: u64,
    looks: [bool; 2],
}

impl Seat {
    /// What is looked at from now on.
    pub(super) fn look(&mut self, kind: Kind, looks: bool) {
        let was = std::mem::replace(&mut self.looks[place(kind)], looks);
        let count = &self.screen.looked_at[place(kind)];
        match (was, looks) {
            (false, true) => drop(count.fetch_add(1, Ordering::Relaxed)),
            (true, false) => drop(count.fetch_sub(1, Ordering::Relaxed)),
            _ => {}
        }
    }

    /// The newest picture of a kind, from now on.
    pub(super) fn pictures(&self, kind: Kind) -> watch::Receiver<Option<Arc<Shot>>> {
        self.screen.shots[place(kind)].subscribe()
    }

    /// Tells whenever somebody else steers.
    pub(super) fn turns(&self) -> watch::Receiver<u64> {
        self.screen.turns.subscribe()
    }

    /// Whether it is this one who steers.
    pub(super) fn steers(&self) -> bool {
        self.screen.audience().steering == Some(self.number)
    }

    /// From now on it is.
    pub(super) fn take_over(&self) {
        self.screen.audience().steering = Some(self.number);
        self.screen.turns.send_modify(|turns| *turns += 1);
    }

    /// Steers.
    ///
    /// # Errors
    /// A sentence, for one who does not steer or for what cannot be.
    pub(super) fn steer(&self, steer: Steer) -> Result<(), String> {
        if !self.steers() {
            return Err("another page steers the view; take over control first".into());
        }
        self.screen.sight().steer(steer)
    }
}

impl Drop for Seat {
    fn drop(&mut self) {
        [Kind::Slice, Kind::View].into_iter().for_each(|kind| self.look(kind, false));
        let mut audience = self.screen.audience();
        audience.present.remove(&self.number);
        if audience.steering == Some(self.number) {
            audience.steering = audience.present.first().copied();
            drop(audience);
            self.screen.turns.send_modify(|turns| *turns += 1);
        }
    }
}

/// Host ns as ms since the UNIX epoch, which a browser's clock counts from.
fn unix_ms(host_ns: i64) -> f64 {
    let now = clock_gettime(ClockId::Monotonic);
    let now_ns = now.tv_sec.saturating_mul(1_000_000_000).saturating_add(now.tv_nsec);
    now_ms() - now_ns.saturating_sub(host_ns) as f64 / 1e6
}

/// The time, ms since the UNIX epoch.
pub(super) fn now_ms() -> f64 {
    SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).map_or(0.0, |since| since.as_secs_f64() * 1e3)
}
