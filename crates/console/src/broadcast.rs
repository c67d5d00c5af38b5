//! The newest picture of each kind, the subscriptions of the pages, and who has control. It
//! connects the stages that render pictures to the pages that view them.
//!
//! A stage leaves its newest picture here and goes on; it never waits for a browser. Pictures
//! without subscription are not rendered.

use std::collections::BTreeSet;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use glam::DVec3;
use tokio::sync::{oneshot, watch};

use guidance::ScanGuidance;
use measure::Edge;
use pipeline::session::{BrickCopy, BrickViewer, Drawn, Extent, PlaneImage, PlaneRequest, PlaneViewer};
use pipeline::{CapturedFrame, Observer};
use render::camera::View;
use render::{Crop, OpaquePixels, RenderSettings, Renderer};
use sonoweave_core::slice::{Image, Pixels};
use volume::brick::BrickIndex;

use super::bricks::{BrickPages, Drawing};
use super::encoded_frame::{EncodedFrame, KINDS, Kind, Pixmap, unix_ms};
use super::marks::Marks;
use super::orbit_camera::{OrbitCamera, Steer};
use super::pick::{Answer, Picks};
use super::plane_colours;
use super::planes::{self, Move, Planes};
use super::questions::Questions;
use super::request_error::RequestError;
use super::style::{Choice, ConfiguredStyle, PresentStyle};

/// Interval at which the render thread polls for a new view while a page views it. A user
/// turning the view does not notice a shorter one.
const POLL_VIEWED: Duration = Duration::from_millis(8);
/// The same interval without viewers.
const POLL_IDLE: Duration = Duration::from_millis(100);

/// The viewers, and which of them has control.
#[derive(Debug, Default)]
struct Audience {
    next: u64,
    present: BTreeSet<u64>,
    steering: Option<u64>,
}

/// The newest pictures and their subscriptions.
#[derive(Debug)]
pub struct FrameBroadcaster {
    shots: [watch::Sender<Option<Arc<EncodedFrame>>>; KINDS],
    viewers: [AtomicU32; KINDS],
    made: [AtomicU32; KINDS],
    camera: Mutex<OrbitCamera>,
    picks: Picks,
    /// Questions for the edges at places, world mm.
    edges: Questions<Vec<DVec3>, Vec<Option<Edge>>>,
    planes: Mutex<Planes>,
    style: Mutex<PresentStyle>,
    /// Changes with the style of the volume's picture.
    style_changes: watch::Sender<u64>,
    audience: Mutex<Audience>,
    /// Source of the marks in the view.
    guidance: Mutex<Option<Arc<ScanGuidance>>>,
    /// Corners of a highlighted slice, marked instead of the present one.
    highlighted: Mutex<Option<[DVec3; 4]>>,
    marked: AtomicU32,
    /// Changes when control passes to another page.
    turns: watch::Sender<u64>,
    /// The pages that draw the volume themselves, and what they must know for that.
    brick_pages: BrickPages,
    drawing: watch::Sender<Option<Arc<Drawing>>>,
    views: watch::Sender<View>,
}

impl Default for FrameBroadcaster {
    fn default() -> Self {
        Self {
            shots: Kind::ALL.map(|_| watch::Sender::new(None)),
            viewers: Default::default(),
            made: Default::default(),
            camera: Mutex::default(),
            picks: Picks::default(),
            edges: Questions::default(),
            planes: Mutex::default(),
            style: Mutex::default(),
            style_changes: watch::Sender::new(0),
            audience: Mutex::default(),
            guidance: Mutex::default(),
            highlighted: Mutex::default(),
            marked: AtomicU32::new(0),
            turns: watch::Sender::new(0),
            brick_pages: BrickPages::default(),
            drawing: watch::Sender::new(None),
            views: watch::Sender::default(),
        }
    }
}

/// Returns the array index of a kind.
fn place(kind: Kind) -> usize {
    kind as usize - 1
}

impl FrameBroadcaster {
    /// Whether any page views the volume, also one that draws it.
    pub fn is_watched(&self) -> bool {
        self.is_viewed(Kind::View) || self.brick_pages.is_watched()
    }

    /// Returns the interval at which the render thread polls for a new view.
    pub fn turn(&self) -> Duration {
        if self.is_watched() { POLL_VIEWED } else { POLL_IDLE }
    }

    /// Returns the requested view; `home` is the configured one.
    pub fn view(&self, home: View) -> View {
        self.camera().view(home)
    }

    /// Publishes a rendered picture of the volume, on a background.
    pub fn drawn(&self, drawn: &Drawn, background: [f32; 3]) {
        self.camera().drawn(&drawn.renderer);
        let drawing = Drawing::of(&drawn.renderer, background, self.style().range(), self.brick_pages.is_too_large());
        self.drawing.send_if_modified(|present| {
            let is_other = present.as_deref() != Some(&drawing);
            if is_other {
                *present = Some(Arc::new(drawing));
            }
            is_other
        });
        self.turned();
        if !self.is_watched() {
            return;
        }
        let Drawn { ref renderer, item, captured_ns, refining, .. } = *drawn;
        let pixels = match renderer.opaque_pixels(background) {
            OpaquePixels::Grey(pixels) => Pixmap::Grey(pixels.into()),
            OpaquePixels::Colour(pixels) => Pixmap::Colour(pixels.into()),
        };
        let (camera, frame) = (renderer.camera(), (item, captured_ns.map(unix_ms)));
        let words = serde_json::json!({ "sight": { "projection": camera.projection() } });
        self.show(Kind::View, camera.size(), pixels, frame, refining, |_| Some(words));
    }

    /// Answers waiting picks from the displayed picture; `None` if the volume is empty.
    pub fn answer(&self, shown: Option<&Renderer>) {
        self.picks.answer(shown);
    }

    /// Asks for the place visible at a point of the volume's picture: fractions of width and
    /// height.
    ///
    /// # Errors
    /// [`RequestError`] for a point outside the picture.
    pub(super) fn pick(&self, at: [f64; 2]) -> Result<oneshot::Receiver<Answer>, RequestError> {
        self.picks.request(at)
    }

    /// Asks for the edges in the volume at places, world mm. The channel closes without an answer
    /// if there are too many requests.
    pub(super) fn edges(&self, places: Vec<DVec3>) -> oneshot::Receiver<Vec<Option<Edge>>> {
        self.edges.ask(places)
    }

    /// Returns the number of rays cast for picks.
    pub fn picked(&self) -> u64 {
        self.picks.cast()
    }

    /// Sets the configured style.
    pub fn configure(&self, configured: ConfiguredStyle) {
        self.planes().usual(configured.range);
        if self.style().configure(configured) {
            self.style_changes.send_modify(|changes| *changes += 1);
        }
    }

    /// Returns a number that changes with the style of the volume's picture; 0 for the
    /// configured style.
    pub fn style_number(&self) -> u64 {
        self.style().number()
    }

    /// Applies the chosen style to the render settings.
    pub fn apply_style(&self, settings: &mut RenderSettings) {
        self.style().apply(settings);
    }

    /// Returns the style of the volume's picture as JSON, for pages.
    pub(super) fn style_json(&self) -> serde_json::Value {
        self.style().to_json()
    }

    /// Takes the marks in the view from this scan guidance from now on.
    pub fn follow(&self, guidance: &Arc<ScanGuidance>) {
        *self.guidance.lock().unwrap_or_else(PoisonError::into_inner) = Some(Arc::clone(guidance));
    }

    /// Highlights a slice with these corners, world mm, instead of the present one; `None` ends
    /// that.
    pub fn highlight(&self, corners: Option<[DVec3; 4]>) {
        *self.highlighted() = corners;
    }

    fn highlighted(&self) -> MutexGuard<'_, Option<[DVec3; 4]>> {
        self.highlighted.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Publishes a recorded frame by its number, without a capture time, which is long past.
    pub fn recorded(&self, item: u64, image: &Image) {
        self.glimpse(item, None, image);
    }

    fn glimpse(&self, item: u64, captured_ms: Option<f64>, image: &Image) {
        if !self.is_viewed(Kind::Slice) {
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

    /// Returns the marks in the view's last picture; `None` without a picture, a viewer or scan
    /// guidance.
    pub(super) fn marks(&self, now_ns: i64) -> Option<Marks> {
        let guidance = self.guidance.lock().unwrap_or_else(PoisonError::into_inner).clone();
        let guidance = guidance.filter(|_| self.is_watched())?;
        let sequence = self.made(Kind::View);
        if sequence == 0 {
            return None;
        }
        self.marked.fetch_add(1, Ordering::Relaxed);
        let mut outlines = guidance.outlines(now_ns);
        if let Some(corners) = *self.highlighted() {
            outlines.present = Some(corners);
        }
        let planes = self.planes().shown(|kind| self.is_viewed(kind));
        Marks::of(&outlines, &self.camera(), sequence, &planes)
    }

    /// Returns how often marks were computed.
    pub fn marked(&self) -> u32 {
        self.marked.load(Ordering::Relaxed)
    }

    /// Returns the number of pictures of a kind made for browsers.
    pub fn made(&self, kind: Kind) -> u32 {
        self.made[place(kind)].load(Ordering::Relaxed)
    }

    /// Changes the view.
    ///
    /// # Errors
    /// [`RequestError`] for an invalid command; the view stays.
    pub(super) fn steer(&self, steer: Steer) -> Result<(), RequestError> {
        self.camera().steer(steer)?;
        self.turned();
        Ok(())
    }

    /// Tells pages that draw the volume of a changed view.
    fn turned(&self) {
        let view = self.camera().present();
        self.views.send_if_modified(|told| std::mem::replace(told, view) != view);
    }

    /// Returns the pages that draw the volume themselves.
    pub(super) fn brick_pages(&self) -> &BrickPages {
        &self.brick_pages
    }

    /// Moves planes, or changes their window.
    ///
    /// # Errors
    /// [`RequestError`] for an invalid command; the planes stay.
    pub(super) fn move_planes(&self, what: Move) -> Result<(), RequestError> {
        self.planes().steer(what)
    }

    /// Changes the style of the volume's picture.
    ///
    /// # Errors
    /// [`RequestError`] for an invalid choice; the style stays.
    pub(super) fn choose(&self, choice: Choice) -> Result<(), RequestError> {
        self.style().choose(choice)?;
        self.style_changes.send_modify(|changes| *changes += 1);
        Ok(())
    }

    /// Returns the newest picture of a kind, if there is one.
    pub(super) fn newest(&self, kind: Kind) -> Option<Arc<EncodedFrame>> {
        self.shots[place(kind)].borrow().clone()
    }

    /// Subscribes to a kind of picture without a viewer slot, until dropped.
    pub(super) fn subscribe_briefly(self: &Arc<Self>, kind: Kind) -> ShortSubscription {
        self.viewers[place(kind)].fetch_add(1, Ordering::Relaxed);
        ShortSubscription { broadcaster: Arc::clone(self), kind, pictures: self.shots[place(kind)].subscribe() }
    }

    pub(super) fn is_viewed(&self, kind: Kind) -> bool {
        self.viewers[place(kind)].load(Ordering::Relaxed) > 0
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
        let shot = EncodedFrame { kind, sequence, size, pixels, item, captured_ms, refining, words: words(sequence) };
        self.shots[place(kind)].send_replace(Some(Arc::new(shot)));
    }

    fn camera(&self) -> MutexGuard<'_, OrbitCamera> {
        self.camera.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn planes(&self) -> MutexGuard<'_, Planes> {
        self.planes.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn style(&self) -> MutexGuard<'_, PresentStyle> {
        self.style.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn audience(&self) -> MutexGuard<'_, Audience> {
        self.audience.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Adds a viewer; the first one gets control.
    pub(super) fn enter(self: &Arc<Self>) -> Subscription {
        let mut audience = self.audience();
        audience.next += 1;
        let number = audience.next;
        audience.present.insert(number);
        audience.steering.get_or_insert(number);
        Subscription { broadcaster: Arc::clone(self), number, viewed: [false; KINDS] }
    }
}

impl Observer for FrameBroadcaster {
    fn captured(&self, glimpsed: &CapturedFrame<'_>) {
        let CapturedFrame { item, captured_ns, image } = *glimpsed;
        self.glimpse(item, Some(unix_ms(captured_ns)), image);
    }
}

impl PlaneViewer for FrameBroadcaster {
    fn is_watched(&self) -> bool {
        planes::KINDS.into_iter().any(|kind| self.is_viewed(kind))
    }

    fn requested(&self, extent: &Extent) -> Vec<PlaneRequest> {
        self.planes().requests(extent, |kind| self.is_viewed(kind))
    }

    fn shows_errors(&self) -> bool {
        self.planes().shows_errors()
    }

    fn shows_weakly_seen(&self) -> bool {
        self.planes().shows_weakly_seen()
    }

    fn readout_at(&self, extent: &Extent) -> DVec3 {
        self.planes().cross(extent)
    }

    fn answer_edges(&self, edges: &mut dyn FnMut(&[DVec3]) -> Vec<Option<Edge>>) {
        self.edges.answer(|places| edges(&places));
    }

    fn show_plane(&self, image: &PlaneImage<'_>) {
        let (kind, size) = (planes::KINDS[image.request.number], image.request.section.size);
        let window = {
            let mut planes = self.planes();
            planes.show(&image.request);
            planes.window()
        };
        let pixels = plane_colours::coloured(image, window);
        let times = (image.item, image.captured_ns.map(unix_ms));
        self.show(kind, size, pixels, times, false, |sequence| Some(self.planes().to_json(image, sequence)));
    }

    fn nothing(&self, why: &str) {
        self.planes().without();
        for kind in planes::KINDS.into_iter().filter(|kind| self.is_viewed(*kind)) {
            let pixel = Pixmap::Colour(plane_colours::unseen(0, 0).into());
            let words =
                |sequence| serde_json::json!({ "plane": { "kind": kind as u8, "sequence": sequence, "none": why } });
            self.show(kind, [1, 1], pixel, (0, None), false, |sequence| Some(words(sequence)));
        }
    }
}

impl BrickViewer for FrameBroadcaster {
    fn is_watched(&self) -> bool {
        self.brick_pages.is_watched()
    }

    fn crop(&self) -> Crop {
        self.drawing.borrow().as_ref().map(|drawing| drawing.crop.clone()).unwrap_or_default()
    }

    fn changed(&self, bricks: &[BrickIndex], all: bool) {
        self.brick_pages.changed(bricks, all);
    }

    fn serve(&self, read: &mut dyn FnMut(&[BrickIndex]) -> Vec<Box<BrickCopy>>) {
        let is_in_view = self.camera().sees();
        self.brick_pages.serve(read, is_in_view, Instant::now());
    }
}

/// A short subscription to one kind of picture.
#[derive(Debug)]
pub(super) struct ShortSubscription {
    broadcaster: Arc<FrameBroadcaster>,
    kind: Kind,
    pub(super) pictures: watch::Receiver<Option<Arc<EncodedFrame>>>,
}

impl Drop for ShortSubscription {
    fn drop(&mut self) {
        self.broadcaster.viewers[place(self.kind)].fetch_sub(1, Ordering::Relaxed);
    }
}

/// A viewer; dropping it removes the viewer.
#[derive(Debug)]
pub(super) struct Subscription {
    broadcaster: Arc<FrameBroadcaster>,
    number: u64,
    viewed: [bool; KINDS],
}

impl Subscription {
    /// Sets whether this viewer subscribes to a kind.
    pub(super) fn subscribe(&mut self, kind: Kind, viewed: bool) {
        let was = std::mem::replace(&mut self.viewed[place(kind)], viewed);
        let count = &self.broadcaster.viewers[place(kind)];
        match (was, viewed) {
            (false, true) => drop(count.fetch_add(1, Ordering::Relaxed)),
            (true, false) => {
                let others = count.fetch_sub(1, Ordering::Relaxed) - 1;
                // The next viewer must not see an outdated plane.
                if others == 0 && planes::KINDS.contains(&kind) {
                    self.broadcaster.shots[place(kind)].send_replace(None);
                }
            }
            _ => {}
        }
    }

    /// Subscribes to the newest picture of a kind.
    pub(super) fn pictures(&self, kind: Kind) -> watch::Receiver<Option<Arc<EncodedFrame>>> {
        self.broadcaster.shots[place(kind)].subscribe()
    }

    /// Returns a channel that changes with the style of the volume's picture.
    pub(super) fn style_changes(&self) -> watch::Receiver<u64> {
        self.broadcaster.style_changes.subscribe()
    }

    /// Returns the settings of the volume's picture, once there is one.
    pub(super) fn drawings(&self) -> watch::Receiver<Option<Arc<Drawing>>> {
        self.broadcaster.drawing.subscribe()
    }

    /// Returns the requested view.
    pub(super) fn views(&self) -> watch::Receiver<View> {
        self.broadcaster.views.subscribe()
    }

    /// Returns a channel that changes when control passes to another page.
    pub(super) fn turns(&self) -> watch::Receiver<u64> {
        self.broadcaster.turns.subscribe()
    }

    /// Whether this viewer has control.
    pub(super) fn steers(&self) -> bool {
        self.broadcaster.audience().steering == Some(self.number)
    }

    /// Takes control.
    pub(super) fn take_over(&self) {
        self.broadcaster.audience().steering = Some(self.number);
        self.broadcaster.turns.send_modify(|turns| *turns += 1);
    }
}

impl Drop for Subscription {
    fn drop(&mut self) {
        Kind::ALL.into_iter().for_each(|kind| self.subscribe(kind, false));
        let mut audience = self.broadcaster.audience();
        audience.present.remove(&self.number);
        if audience.steering == Some(self.number) {
            audience.steering = audience.present.first().copied();
            drop(audience);
            self.broadcaster.turns.send_modify(|turns| *turns += 1);
        }
    }
}
