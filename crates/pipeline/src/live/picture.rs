//! The render thread: renders the present volume after each slice, or once for all slices that
//! arrived during the last rendering.
//!
//! Insertion waits only while the volume is read. Querying settings, making renderers and
//! rendering run concurrently, on a thread of low priority ([`Background`]). A thread of normal
//! priority reads the volume; otherwise insertion would have to wait, on a busy machine, for
//! everything that the low-priority thread yields to.

use std::num::NonZeroU64;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, MutexGuard};
use std::time::{Duration, Instant};

use tracing::trace_span;

use render::camera::View;
use render::{RenderRegion, RenderSettings, Renderer};
use sonoweave_core::clock::Clock;
use volume::brick::BrickIndex;
use volume::lattice::Shifted;
use volume::read::Values as _;

use super::priority::Background;
use super::reach::Reach;
use super::shared_volume::{Begun, PendingChanges, Shared, SharedVolume};
use super::timing::Spread;
use crate::trace::STAGE;

/// Longest wait before the thread checks whether it is to end.
const TURN: Duration = Duration::from_millis(100);
/// Bricks that are read while insertion waits: about 1 ms.
const PART: usize = 256;
/// Number of such parts that are read one by one; then the remainder is read at once.
const MOST_PARTS: u32 = 2048;
/// Pause between two parts, during which insertion can continue.
const PAUSE: Duration = Duration::from_micros(100);
/// Time for which a view is refined before slices and other views are handled.
const REFINED: Duration = Duration::from_millis(15);
/// Lowest picture rate while slices arrive, whatever is requested, Hz.
const LEAST_HZ: f64 = 0.01;

/// View settings of the picture; the first slice determines the rest.
pub trait ViewClient: Send + Sync {
    /// Returns the renderer's settings for the range of grey values and the first slice's
    /// directions.
    ///
    /// # Errors
    /// A sentence, if the settings cannot produce a picture.
    fn settings(&self, begun: &First) -> Result<RenderSettings, Box<dyn std::error::Error + Send + Sync>>;

    /// Returns a number that changes whenever [`Self::dress`] has a different effect; 0 if it
    /// has none. Queried before each picture, and every [turn](Self::turn).
    fn dressing(&self) -> u64 {
        0
    }

    /// Applies a viewer's changes to the result of [`Self::settings`]. The last picture uses the
    /// unchanged settings.
    fn dress(&self, _settings: &mut RenderSettings) {}

    /// Receives a rendered picture. The next picture waits for this call; slices do not.
    fn shown(&self, _drawn: &Drawn) {}

    /// Answers questions about the picture that was shown last, while its thread is idle; `None`
    /// if the volume is empty. Called after each picture, and every [turn](Self::turn) while
    /// none is due.
    fn answer(&self, _shown: Option<&Renderer>) {}

    /// In a replay: every how many slices a picture is rendered. Insertion then waits for it,
    /// and besides these only the last picture is rendered. `None` renders as fast as both
    /// threads allow, as in a live session.
    fn every(&self) -> Option<NonZeroU64> {
        None
    }

    /// Returns the present view; `home` is the view of the settings. Queried before each
    /// picture, and every [turn](Self::turn) while none is due. The last picture always uses
    /// `home`.
    fn view(&self, home: View) -> View {
        home
    }

    /// Returns whether there is a viewer. Without one, nothing is read, shaded or cast.
    fn is_watched(&self) -> bool {
        true
    }

    /// Returns whether a final picture of all slices is rendered.
    fn keeps_last(&self) -> bool {
        true
    }

    /// Returns how long the thread may sleep without a query while no slice arrives.
    fn turn(&self) -> Duration {
        TURN
    }

    /// Returns the highest picture rate, Hz; queried before each picture. Unlimited by default.
    /// The last picture is rendered at once.
    fn most_hz(&self) -> f64 {
        f64::INFINITY
    }
}

impl ViewClient for config::bedside::Picture {
    fn settings(&self, first: &First) -> Result<RenderSettings, Box<dyn std::error::Error + Send + Sync>> {
        config::bedside::Picture::settings(self, first.slice_axes).map_err(|error| format!("picture: {error}").into())
    }

    fn most_hz(&self) -> f64 {
        self.most_hz
    }
}

/// Properties of a scan that are known after its first slice.
#[derive(Debug, Clone, Copy)]
pub struct First {
    /// Directions of u and v in the world.
    pub slice_axes: Option<[glam::DVec3; 2]>,
    /// Grey values of black and white in its frames.
    pub grey_levels: [f32; 2],
}

/// The picture, with its statistics.
pub struct Drawn {
    /// The renderer, holding the picture of all slices.
    pub renderer: Renderer,
    /// Slices inserted until then: those shown, and those before the volume was cleared.
    pub slices: u64,
    /// Number of the last one's frame.
    pub item: u64,
    /// Capture time of that frame, host ns; `None` in a replay.
    pub captured_ns: Option<i64>,
    /// Whether the view is new, so that the picture is still coarse.
    pub refining: bool,
    /// Pictures rendered.
    pub pictures: u64,
    /// Those of them for which only rays through the slab of the last slice were cast again.
    pub by_slab: u64,
    /// Slices that arrived during a rendering and were rendered with the next picture.
    pub skipped: u64,
    /// Time from the frame's capture to its picture, ms.
    pub capture_to_picture: Spread,
    /// Time from reading the volume to its picture, ms.
    pub draw: Spread,
    /// Time for which insertion waited while the volume was read, ms.
    pub held: Spread,
}

/// The view settings, which may change during the session.
pub(super) struct SharedViewClient {
    looks: Arc<dyn ViewClient>,
    /// Number of changes of its settings.
    changes: AtomicU64,
}

impl SharedViewClient {
    pub(super) fn new(looks: Arc<dyn ViewClient>) -> Self {
        Self { looks, changes: AtomicU64::new(0) }
    }

    /// Asks the view client for its settings again, from the next picture on.
    pub(super) fn changed(&self) {
        self.changes.fetch_add(1, Ordering::Relaxed);
    }

    pub(super) fn looks(&self) -> &dyn ViewClient {
        &*self.looks
    }
}

/// State of the render thread.
struct RenderState<'a> {
    wall: &'a SharedViewClient,
    /// Change numbers of the view settings and of the style that the renderer uses.
    changes: [u64; 2],
    begun: Option<Begun>,
    reach: Option<Reach>,
    /// Whether the renderer has read nothing of the volume yet.
    blank: bool,
    /// The view of the settings, and the present view.
    home: View,
    view: View,
    drawn: Option<Drawn>,
}

impl RenderState<'_> {
    /// Makes an empty renderer for a box; the last one uses the home view.
    fn stretch(
        &mut self,
        begun: &Begun,
        reach: Reach,
        is_last: bool,
    ) -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
        let first = First { slice_axes: begun.slice_axes, grey_levels: begun.pixels.grey_levels() };
        let looks = self.wall.looks();
        let mut settings = looks.settings(&first)?;
        if !is_last {
            looks.dress(&mut settings);
        }
        self.home = settings.view;
        self.view = if is_last { self.home } else { looks.view(self.home) };
        settings.view = self.view;
        let [low, high] = reach.voxels();
        let stage = RenderRegion::new(begun.lattice.world_from_lattice, low, high)?;
        let renderer = Renderer::new(&settings, stage)?;
        match &mut self.drawn {
            Some(drawn) => drawn.renderer = renderer,
            None => {
                self.drawn = Some(Drawn {
                    renderer,
                    slices: 0,
                    item: 0,
                    captured_ns: None,
                    refining: false,
                    pictures: 0,
                    by_slab: 0,
                    skipped: 0,
                    capture_to_picture: Spread::default(),
                    draw: Spread::default(),
                    held: Spread::default(),
                });
            }
        }
        (self.begun, self.reach, self.blank) = (Some(*begun), Some(reach), true);
        Ok(())
    }

    /// Handles a cleared volume; returns whether there is a picture to be replaced by an empty
    /// one. The next slice defines the next box.
    ///
    /// # Errors
    /// Same as [`Self::stretch`].
    fn wipe(&mut self) -> Result<bool, Box<dyn std::error::Error + Send + Sync>> {
        let (Some(begun), Some(reach)) = (self.begun.take(), self.reach.take()) else { return Ok(false) };
        self.stretch(&begun, reach, false)?;
        self.reach = None;
        let Some(drawn) = &mut self.drawn else { return Ok(false) };
        drawn.renderer.draw();
        drawn.refining = false;
        drawn.captured_ns = None;
        drawn.pictures += 1;
        Ok(true)
    }

    /// Returns the requested view.
    fn wanted(&self, is_last: bool) -> View {
        if is_last { self.home } else { self.wall.looks().view(self.home) }
    }

    /// Returns whether a view is to be refined or changed.
    fn is_due(&self, is_last: bool) -> bool {
        let is_refining = self.drawn.as_ref().is_some_and(|drawn| drawn.refining);
        !self.blank && (is_refining || self.wanted(is_last) != self.view)
    }

    /// Refines the requested view for a time that delays nobody; returns whether there is a new
    /// picture to show. The last picture is finished, from the home view.
    fn turn(&mut self, is_last: bool) -> bool {
        let view = self.wanted(is_last);
        let Some(drawn) = self.drawn.as_mut().filter(|_| !self.blank) else { return false };
        let is_new = view != self.view;
        if is_new {
            self.view = view;
            // An invalid view leaves the previous one unchanged.
            drawn.refining |= drawn.renderer.set_view(view).is_ok();
        }
        if !drawn.refining {
            return false;
        }
        // The first coarse picture of a view is shown at once.
        if !is_new || is_last {
            let time = if is_last { Duration::MAX } else { REFINED };
            drawn.refining = !drawn.renderer.refine(time).finished;
        }
        drawn.pictures += 1;
        true
    }

    /// Answers viewers' questions about the picture.
    fn answer(&self, looks: &dyn ViewClient) {
        looks.answer(self.drawn.as_ref().filter(|_| !self.blank).map(|drawn| &drawn.renderer));
    }
}

/// Reports the end of the render thread, whatever ended it, to those who wait for a picture.
struct Gone<'a>(&'a Shared);

impl Drop for Gone<'_> {
    fn drop(&mut self) {
        self.0.undrawn();
    }
}

/// Renders until no slice follows. If `certain`, renders only certain slices, for which
/// insertion waits. Returns `None` if no slice ever arrived.
///
/// # Errors
/// Settings that cannot produce a picture; insertion continues.
pub(super) fn run(
    shared: &Shared,
    wall: &SharedViewClient,
    certain: bool,
    clock: &dyn Clock,
    mut shown: impl FnMut(&Drawn) + Send,
) -> Result<Option<Drawn>, Box<dyn std::error::Error + Send + Sync>> {
    let _gone = Gone(shared);
    let background = Background::new("draw")?;
    let (home, view) = <(View, View)>::default();
    let (begun, reach, changes) = (None, None, [0; 2]);
    let mut easel = RenderState { wall, changes, begun, reach, blank: true, home, view, drawn: None };
    // Slices that are rendered, and those known to be inserted.
    let (mut seen, mut known) = (0, 0);
    // Those of the latter that were inserted before the last clearing.
    let mut cleared = 0;
    let mut due = Instant::now();
    loop {
        let looks = wall.looks();
        let is_watched = looks.is_watched();
        let is_refining = easel.drawn.as_ref().is_some_and(|drawn| drawn.refining);
        let fabric = match is_watched {
            true => shared.wait(seen, certain, if is_refining { Duration::ZERO } else { looks.turn() }),
            false => shared.wait(known, certain, TURN),
        };
        let is_last = fabric.ended;
        let changes = [wall.changes.load(Ordering::Relaxed), if is_last { 0 } else { looks.dressing() }];
        if is_last && !looks.keeps_last() {
            return Ok(None);
        }
        known = fabric.news.woven;
        if is_last && fabric.news.slices() == 0 {
            return Ok(None);
        }
        if !is_last && !is_watched {
            continue;
        }
        if fabric.news.cleared != cleared {
            cleared = fabric.news.cleared;
            seen = cleared;
            drop(fabric);
            // If only certain slices are rendered, an empty volume is not shown.
            background.run(|| {
                if easel.wipe()? && !certain {
                    present(&easel, &mut shown);
                }
                Ok::<_, Box<dyn std::error::Error + Send + Sync>>(())
            })?;
            continue;
        }
        // Changed view settings are rendered even if no slice has arrived since.
        let is_shown = changes == easel.changes && !easel.blank;
        if fabric.news.woven == seen && (is_shown || seen == cleared) {
            drop(fabric);
            // The background thread is woken only if there is work.
            if easel.is_due(is_last) {
                background.run(|| {
                    if easel.turn(is_last) {
                        present(&easel, &mut shown);
                    }
                });
            }
            easel.answer(looks);
            if is_last {
                return Ok(easel.drawn);
            }
            continue;
        }
        if certain && !fabric.awaited && !fabric.ended {
            continue;
        }
        let early = due.saturating_duration_since(Instant::now());
        if !fabric.ended && !fabric.awaited && !early.is_zero() {
            drop(fabric);
            if !easel.blank {
                easel.answer(looks);
            }
            shared.rest(early.min(TURN));
            continue;
        }
        let (Some(begun), Some(reach)) = (fabric.news.begun, fabric.news.reach) else {
            // None of the slices touched the volume.
            seen = fabric.news.woven;
            drop(fabric);
            shared.shown(seen);
            continue;
        };
        if easel.reach != Some(reach) || easel.changes != changes {
            // Insertion continues meanwhile; if it leaves this box too, the next one is half as
            // large again.
            drop(fabric);
            easel.changes = changes;
            background.run(|| easel.stretch(&begun, reach, is_last))?;
            continue;
        }
        let Some(drawn) = &mut easel.drawn else { continue };
        let (frame, slices) = (fabric.news.item, fabric.news.woven);
        let _span = trace_span!(target: STAGE, "draw", frame, slices).entered();
        let began = Instant::now();
        let mut fabric = catch_up(shared, fabric, drawn, &begun, easel.blank);
        if fabric.news.reach != easel.reach {
            // Insertion has left the box meanwhile.
            easel.blank = true;
            continue;
        }
        let PendingChanges { woven, item, captured_ns, .. } = fabric.news;
        let slab = fabric.news.changes.shown().filter(|_| !easel.blank);
        easel.blank = false;
        // From here on, insertion continues.
        drop(fabric);
        drawn.by_slab += u64::from(slab.is_some());
        background.run(|| drawn.renderer.draw_within(slab.as_ref()));
        (drawn.slices, drawn.item, drawn.captured_ns) = (woven, item, captured_ns);
        drawn.pictures += 1;
        drawn.skipped += (woven - seen).saturating_sub(1);
        drawn.draw.add_ns(ns(began.elapsed()));
        if let Some(captured_ns) = captured_ns {
            drawn.capture_to_picture.add_ns(clock.now_ns() - captured_ns);
        }
        seen = woven;
        due = began + Duration::from_secs_f64(1.0 / wall.looks().most_hz().max(LEAST_HZ));
        // Slices do not delay a viewer who turns the view meanwhile, nor does the viewer delay
        // slices.
        background.run(|| {
            easel.turn(is_last);
            present(&easel, &mut shown);
        });
        shared.shown(woven);
        easel.answer(looks);
    }
}

/// Passes the present picture to all its receivers.
fn present(easel: &RenderState<'_>, shown: &mut impl FnMut(&Drawn)) {
    if let Some(drawn) = &easel.drawn {
        shown(drawn);
        easel.wall.looks().shown(drawn);
    }
}

/// Reads the changed bricks, or all of them, in parts. Insertion continues between the parts,
/// and its changes are read last, so that the renderer is up to date when this returns.
fn catch_up<'a>(
    shared: &'a Shared,
    mut fabric: MutexGuard<'a, SharedVolume>,
    drawn: &mut Drawn,
    begun: &Begun,
    mut all: bool,
) -> MutexGuard<'a, SharedVolume> {
    let mut waits: Vec<BrickIndex> = Vec::new();
    for round in 0_u32.. {
        let began = Instant::now();
        let SharedVolume { loom, news, .. } = &mut *fabric;
        let Some(weaver) = loom.weaver() else { return fabric };
        let volume = Shifted::new(weaver.volume(), begun.lattice.offset);
        all |= std::mem::take(&mut news.changes.all);
        if std::mem::take(&mut all) {
            waits = volume.bricks().collect();
            news.changes.bricks.clear();
        } else {
            waits.append(&mut news.changes.bricks);
        }
        // If insertion were faster than reading, no picture would ever be rendered otherwise.
        let most = if round < MOST_PARTS { PART } else { usize::MAX };
        let part = waits.split_off(waits.len().saturating_sub(most));
        drawn.renderer.read(&volume, &part);
        drawn.held.add_ns(ns(began.elapsed()));
        if waits.is_empty() {
            return fabric;
        }
        drop(fabric);
        // Threads that wait for the volume get it before it is locked again.
        std::thread::sleep(PAUSE);
        fabric = shared.lock();
    }
    fabric
}

fn ns(time: Duration) -> i64 {
    i64::try_from(time.as_nanos()).unwrap_or(i64::MAX)
}
