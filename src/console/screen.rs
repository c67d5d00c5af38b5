//! What browsers see, between the stages that make it and those who look: the newest picture of each kind, and who looks at it.
//!
//! A stage leaves its newest picture here and goes on; no browser is waited for, and of a picture at which nobody looks nothing is made.

use std::collections::BTreeSet;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use drivers::clock::wall_ns;
use glam::DVec3;
use tokio::sync::{oneshot, watch};

use super::dress::{Choice, Dress, Ground};
use super::marks::Marks;
use super::pick::{Answer, Picks};
use super::planes::{self, Move, Planes};
use super::sight::{Sight, Steer};
use crate::coach::Coach;
use crate::pipeline::live::{Cut, Cutter, Drawn, Extent, Glimpsed, Wanted, Witness};
use crate::render::camera::View;
use crate::render::{RenderSettings, Renderer};
use crate::slice::{Image, Pixels};

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
    /// The plane through the volume across its z axis,
    AcrossZ = 3,
    /// across its y axis,
    AcrossY = 4,
    /// across its x axis,
    AcrossX = 5,
    /// and the one that is turned freely.
    Free = 6,
}

impl Kind {
    /// All, in the order of their numbers.
    pub(super) const ALL: [Self; KINDS] =
        [Self::Slice, Self::View, Self::AcrossZ, Self::AcrossY, Self::AcrossX, Self::Free];
}

/// Kinds of pictures.
pub(super) const KINDS: usize = 6;

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
    /// What is told before it.
    pub words: Option<serde_json::Value>,
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
    shots: [watch::Sender<Option<Arc<Shot>>>; KINDS],
    looked_at: [AtomicU32; KINDS],
    made: [AtomicU32; KINDS],
    sight: Mutex<Sight>,
    picks: Picks,
    planes: Mutex<Planes>,
    dress: Mutex<Dress>,
    /// Changes whenever the volume's picture looks otherwise.
    dressed: watch::Sender<u64>,
    audience: Mutex<Audience>,
    /// Who knows what is to be marked in the view,
    coach: Mutex<Option<Arc<Coach>>>,
    /// and the corners of a slice that is pointed out in the place of the present one.
    pointed: Mutex<Option<[DVec3; 4]>>,
    marked: AtomicU32,
    /// Changes whenever somebody else steers.
    turns: watch::Sender<u64>,
}

impl Default for Screen {
    fn default() -> Self {
        Self {
            shots: Kind::ALL.map(|_| watch::Sender::new(None)),
            looked_at: Default::default(),
            made: Default::default(),
            sight: Mutex::default(),
            picks: Picks::default(),
            planes: Mutex::default(),
            dress: Mutex::default(),
            dressed: watch::Sender::new(0),
            audience: Mutex::default(),
            coach: Mutex::default(),
            pointed: Mutex::default(),
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
        let words = serde_json::json!({ "sight": { "projection": drawn.renderer.camera().projection() } });
        self.show(Kind::View, picture.size, pixels, (item, captured_ns.map(unix_ms)), refining, |_| Some(words));
    }

    /// Whoever points at places of the volume's picture is answered by the one that is shown; `None` is that of an empty volume.
    pub fn answer(&self, shown: Option<&Renderer>) {
        self.picks.answer(shown);
    }

    /// Asks for the place that is seen at a place of the volume's picture, by shares of its width and height.
    ///
    /// # Errors
    /// A sentence for what is no place of a picture.
    pub(super) fn pick(&self, at: [f64; 2]) -> Result<oneshot::Receiver<Answer>, String> {
        self.picks.ask(at)
    }

    /// Rays that were cast for whoever points at places.
    pub fn picked(&self) -> u64 {
        self.picks.cast()
    }

    /// The configuration's look.
    pub fn ground(&self, ground: Ground) {
        self.planes().usual(ground.range);
        if self.dress().ground(ground) {
            self.dressed.send_modify(|changes| *changes += 1);
        }
    }

    /// A number that is another one whenever pictures of the volume are to look otherwise; 0 as configured.
    pub fn dressing(&self) -> u64 {
        self.dress().number()
    }

    /// Lets pictures of the volume look as somebody who steers wants them to.
    pub fn put_on(&self, settings: &mut RenderSettings) {
        self.dress().put_on(settings);
    }

    /// How pictures of the volume look, to a page.
    pub(super) fn told_dress(&self) -> serde_json::Value {
        self.dress().told()
    }

    /// Marks in the view from now on what this coach knows.
    pub fn follow(&self, coach: &Arc<Coach>) {
        *self.coach.lock().unwrap_or_else(PoisonError::into_inner) = Some(Arc::clone(coach));
    }

    /// Marks a slice with these corners in the place of the present one, world mm; or that one again.
    pub fn point_out(&self, corners: Option<[DVec3; 4]>) {
        *self.pointed() = corners;
    }

    fn pointed(&self) -> MutexGuard<'_, Option<[DVec3; 4]>> {
        self.pointed.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A picture of a recording, by its frame's number: when it was captured is long past.
    pub fn recorded(&self, item: u64, image: &Image) {
        self.glimpse(item, None, image);
    }

    fn glimpse(&self, item: u64, captured_ms: Option<f64>, image: &Image) {
        if !self.is_looked_at(Kind::Slice) {
            return;
        }
        let grey = match image.pixels() {
            Pixels::U8(grey) => Arc::clone(grey),
            Pixels::U16(grey) => grey.iter().map(|value| (value >> 8) as u8).collect(),
            Pixels::F32(grey) => grey.iter().map(|value| value.round().clamp(0.0, 255.0) as u8).collect(),
        };
        let size = [image.width(), image.height()];
        self.show(Kind::Slice, size, Pixmap::Grey(grey), (item, captured_ms), false, |_| None);
    }

    /// What is to be marked in the view's last picture; `None` without a picture, and where nobody looks or knows.
    pub(super) fn marks(&self, now_ns: i64) -> Option<Marks> {
        let coach = self.coach.lock().unwrap_or_else(PoisonError::into_inner).clone();
        let coach = coach.filter(|_| self.is_watched())?;
        let sequence = self.made(Kind::View);
        if sequence == 0 {
            return None;
        }
        self.marked.fetch_add(1, Ordering::Relaxed);
        let mut outlines = coach.outlines(now_ns);
        if let Some(corners) = *self.pointed() {
            outlines.present = Some(corners);
        }
        let planes = self.planes().shown(|kind| self.is_looked_at(kind));
        Marks::of(&outlines, &self.sight(), sequence, &planes)
    }

    /// Times that it was worked out what is to be marked.
    pub fn marked(&self) -> u32 {
        self.marked.load(Ordering::Relaxed)
    }

    /// Pictures of a kind that were made for browsers.
    pub fn made(&self, kind: Kind) -> u32 {
        self.made[place(kind)].load(Ordering::Relaxed)
    }

    /// Steers.
    ///
    /// # Errors
    /// A sentence for what cannot be; the view stays.
    pub(super) fn steer(&self, steer: Steer) -> Result<(), String> {
        self.sight().steer(steer)
    }

    /// Moves planes, or changes how they look.
    ///
    /// # Errors
    /// A sentence for what cannot be; planes stay.
    pub(super) fn move_planes(&self, what: Move) -> Result<(), String> {
        self.planes().steer(what)
    }

    /// Changes how pictures of the volume look.
    ///
    /// # Errors
    /// A sentence for what cannot be; they look as before.
    pub(super) fn choose(&self, choice: Choice) -> Result<(), String> {
        self.dress().choose(choice)?;
        self.dressed.send_modify(|changes| *changes += 1);
        Ok(())
    }

    /// The newest picture of a kind, if there is one.
    pub(super) fn newest(&self, kind: Kind) -> Option<Arc<Shot>> {
        self.shots[place(kind)].borrow().clone()
    }

    /// Looks at a kind of picture without a seat, until it is dropped.
    pub(super) fn glance(self: &Arc<Self>, kind: Kind) -> Glance {
        self.looked_at[place(kind)].fetch_add(1, Ordering::Relaxed);
        Glance { screen: Arc::clone(self), kind, pictures: self.shots[place(kind)].subscribe() }
    }

    pub(super) fn is_looked_at(&self, kind: Kind) -> bool {
        self.looked_at[place(kind)].load(Ordering::Relaxed) > 0
    }

    fn show(
        &self,
        kind: Kind,
        size: [u32; 2],
        pixels: Pixmap,
        (item, captured_ms): (u64, Option<f64>),
        refining: bool,
        words: impl FnOnce(u32) -> Option<serde_json::Value>,
    ) {
        let sequence = self.made[place(kind)].fetch_add(1, Ordering::Relaxed).wrapping_add(1);
        let shot = Shot { kind, sequence, size, pixels, item, captured_ms, refining, words: words(sequence) };
        self.shots[place(kind)].send_replace(Some(Arc::new(shot)));
    }

    fn sight(&self) -> MutexGuard<'_, Sight> {
        self.sight.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn planes(&self) -> MutexGuard<'_, Planes> {
        self.planes.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn dress(&self) -> MutexGuard<'_, Dress> {
        self.dress.lock().unwrap_or_else(PoisonError::into_inner)
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
        Seat { screen: Arc::clone(self), number, looks: [false; KINDS] }
    }
}

impl Witness for Screen {
    fn glimpsed(&self, glimpsed: &Glimpsed<'_>) {
        let Glimpsed { item, captured_ns, image } = *glimpsed;
        self.glimpse(item, Some(unix_ms(captured_ns)), image);
    }
}

impl Cutter for Screen {
    fn is_watched(&self) -> bool {
        planes::KINDS.into_iter().any(|kind| self.is_looked_at(kind))
    }

    fn wants(&self, extent: &Extent) -> Vec<Wanted> {
        self.planes().wanted(extent, |kind| self.is_looked_at(kind))
    }

    fn cut(&self, cut: &Cut<'_>) {
        let (kind, size) = (planes::KINDS[cut.wanted.number], cut.wanted.section.size);
        let window = {
            let mut planes = self.planes();
            planes.show(&cut.wanted);
            planes.window()
        };
        let pixels = planes::coloured(cut.sampled, size[0], window);
        let times = (cut.item, cut.captured_ns.map(unix_ms));
        self.show(kind, size, pixels, times, false, |sequence| Some(self.planes().told(cut, sequence)));
    }

    fn nothing(&self, why: &str) {
        self.planes().without();
        for kind in planes::KINDS.into_iter().filter(|kind| self.is_looked_at(*kind)) {
            let pixel = Pixmap::Colour(planes::unseen(0, 0).into());
            let words =
                |sequence| serde_json::json!({ "plane": { "kind": kind as u8, "sequence": sequence, "none": why } });
            self.show(kind, [1, 1], pixel, (0, None), false, |sequence| Some(words(sequence)));
        }
    }
}

/// Somebody who looks at a kind of picture for a moment.
#[derive(Debug)]
pub(super) struct Glance {
    screen: Arc<Screen>,
    kind: Kind,
    pub(super) pictures: watch::Receiver<Option<Arc<Shot>>>,
}

impl Drop for Glance {
    fn drop(&mut self) {
        self.screen.looked_at[place(self.kind)].fetch_sub(1, Ordering::Relaxed);
    }
}

/// One who looks; gone when dropped.
#[derive(Debug)]
pub(super) struct Seat {
    screen: Arc<Screen>,
    number: u64,
    looks: [bool; KINDS],
}

impl Seat {
    /// What is looked at from now on.
    pub(super) fn look(&mut self, kind: Kind, looks: bool) {
        let was = std::mem::replace(&mut self.looks[place(kind)], looks);
        let count = &self.screen.looked_at[place(kind)];
        match (was, looks) {
            (false, true) => drop(count.fetch_add(1, Ordering::Relaxed)),
            (true, false) => {
                let others = count.fetch_sub(1, Ordering::Relaxed) - 1;
                // Who comes next sees a plane as it is then, not as it was.
                if others == 0 && planes::KINDS.contains(&kind) {
                    self.screen.shots[place(kind)].send_replace(None);
                }
            }
            _ => {}
        }
    }

    /// The newest picture of a kind, from now on.
    pub(super) fn pictures(&self, kind: Kind) -> watch::Receiver<Option<Arc<Shot>>> {
        self.screen.shots[place(kind)].subscribe()
    }

    /// Tells whenever the volume's picture looks otherwise.
    pub(super) fn dressed(&self) -> watch::Receiver<u64> {
        self.screen.dressed.subscribe()
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
}

impl Drop for Seat {
    fn drop(&mut self) {
        Kind::ALL.into_iter().for_each(|kind| self.look(kind, false));
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
pub(super) fn unix_ms(host_ns: i64) -> f64 {
    wall_ns(host_ns) as f64 / 1e6
}
