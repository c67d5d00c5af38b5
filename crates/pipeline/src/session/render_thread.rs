//! The render thread: renders the present volume after each slice, or once for all slices that
//! arrived during the last rendering.
//!
//! Insertion waits only while the volume is read. Querying settings, making renderers and
//! rendering run concurrently, on a thread of low priority ([`Background`]). A thread of normal
//! priority reads the volume; otherwise insertion would have to wait, on a busy machine, for
//! everything that the low-priority thread yields to.

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

use super::every::Every;
use super::pacing::Pacing;
use super::priority::Background;
use super::reach::Reach;
use super::shared_volume::{FirstSlice, PendingChanges, Shared, SharedVolume};
use super::timing::Spread;
use crate::trace::STAGE;

/// Longest wait before the thread checks whether it is to end.
const TURN: Duration = Duration::from_millis(100);
/// Bricks that are read while insertion waits: some 0.4 ms.
const PART: usize = 256;
/// Number of such parts that are read one by one; then the remainder is read at once.
const MOST_PARTS: u32 = 2048;
/// Pause between two parts, in which a thread that waits for the volume gets it.
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
    fn settings(&self, first: &First) -> Result<RenderSettings, Box<dyn std::error::Error + Send + Sync>>;

    /// Returns a number that changes whenever [`Self::restyle`] has a different effect; 0 if it
    /// has none. Queried before each picture, and every [turn](Self::turn).
    fn style_revision(&self) -> u64 {
        0
    }

    /// Applies a viewer's changes to the result of [`Self::settings`]. The last picture uses the
    /// unchanged settings.
    fn restyle(&self, _settings: &mut RenderSettings) {}

    /// Receives a rendered picture. The next picture waits for this call; slices do not.
    fn shown(&self, _drawn: &Drawn) {}

    /// Answers questions about the picture that was shown last, while its thread is idle; `None`
    /// if the volume is empty. Called after each picture, and every [turn](Self::turn) while
    /// none is due.
    fn answer(&self, _shown: Option<&Renderer>) {}

    /// In a replay: the slices after which a picture is rendered, besides the last one. Insertion
    /// waits for it. `None` renders as fast as both threads allow, as in a live session.
    fn every(&self) -> Option<Every> {
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

    /// Returns the highest picture rate, Hz, by default unlimited; the last picture ignores it.
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
    /// Time of the last one, ns, on the stream's clock.
    pub time_ns: i64,
    /// Capture time of that frame, host ns; `None` in a replay.
    pub captured_ns: Option<i64>,
    /// Whether the view is new, so that the picture is still coarse.
    pub refining: bool,
    /// Pictures rendered.
    pub pictures: u64,
    /// Those of them for which only rays through the slab of the last slice were cast again.
    pub by_slab: u64,
    /// Those of them that were drawn in parts of the volume, each by itself.
    pub in_parts: u64,
    /// Slices that arrived during a rendering and were rendered with the next picture.
    pub skipped: u64,
    /// Renderers made: for the first slice, for other settings, and after the volume was cleared.
    pub renderers: u64,
    /// Times that slices left the box of a renderer, which then took a wider one.
    pub widened: u64,
    /// Time from the frame's capture to its picture, ms.
    pub capture_to_picture: Spread,
    /// Time from reading the volume to its picture, ms.
    pub draw: Spread,
    /// Time for which insertion waited while the volume was read, ms.
    pub held: Spread,
}

/// The view settings, which may change during the session.
pub(super) struct SharedViewClient {
    client: Arc<dyn ViewClient>,
    /// Number of changes of its settings.
    changes: AtomicU64,
}

impl SharedViewClient {
    pub(super) fn new(client: Arc<dyn ViewClient>) -> Self {
        Self { client, changes: AtomicU64::new(0) }
    }

    /// Asks the view client for its settings again, from the next picture on.
    pub(super) fn changed(&self) {
        self.changes.fetch_add(1, Ordering::Relaxed);
    }

    pub(super) fn client(&self) -> &dyn ViewClient {
        &*self.client
    }
}

/// State of the render thread.
struct RenderState<'a> {
    shared_client: &'a SharedViewClient,
    /// Change numbers of the view settings and of the style that the renderer uses.
    changes: [u64; 2],
    first: Option<FirstSlice>,
    reach: Option<Reach>,
    /// Whether the renderer has read nothing of the volume yet.
    is_unread: bool,
    /// The view of the settings, and the present view.
    home: View,
    view: View,
    drawn: Option<Drawn>,
}

impl RenderState<'_> {
    /// Makes an empty renderer for a box; the last one uses the home view.
    fn begin(
        &mut self,
        first: &FirstSlice,
        reach: Reach,
        is_last: bool,
    ) -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
        let known = First { slice_axes: first.slice_axes, grey_levels: first.pixels.grey_levels() };
        let client = self.shared_client.client();
        let mut settings = client.settings(&known)?;
        if !is_last {
            client.restyle(&mut settings);
        }
        self.home = settings.view;
        self.view = if is_last { self.home } else { client.view(self.home) };
        settings.view = self.view;
        let [low, high] = reach.voxels();
        let stage = RenderRegion::new(first.lattice.world_from_lattice, low, high)?;
        let renderer = Renderer::new(&settings, stage)?;
        match &mut self.drawn {
            Some(drawn) => {
                drawn.renderer = renderer;
                drawn.renderers += 1;
            }
            None => {
                self.drawn = Some(Drawn {
                    renderer,
                    slices: 0,
                    item: 0,
                    time_ns: 0,
                    captured_ns: None,
                    refining: false,
                    pictures: 0,
                    by_slab: 0,
                    in_parts: 0,
                    skipped: 0,
                    renderers: 1,
                    widened: 0,
                    capture_to_picture: Spread::default(),
                    draw: Spread::default(),
                    held: Spread::default(),
                });
            }
        }
        (self.first, self.reach, self.is_unread) = (Some(*first), Some(reach), true);
        Ok(())
    }

    /// Gives a wider box to the renderer, which keeps what it has read and casts its rays again;
    /// returns whether it could.
    ///
    /// # Errors
    /// Those of the box and the renderer.
    fn widen(&mut self, first: &FirstSlice, reach: Reach) -> Result<bool, Box<dyn std::error::Error + Send + Sync>> {
        // After a clearing, the next slice defines another box.
        let Some(drawn) = self.drawn.as_mut().filter(|_| self.reach.is_some()) else { return Ok(false) };
        let [low, high] = reach.voxels();
        if !drawn.renderer.widen(RenderRegion::new(first.lattice.world_from_lattice, low, high)?)? {
            return Ok(false);
        }
        drawn.widened += 1;
        // The picture after a slice depends on no earlier one: it is not coarse.
        drawn.refining &= !drawn.renderer.refine(Duration::MAX).finished;
        self.reach = Some(reach);
        Ok(true)
    }

    /// Handles a cleared volume; returns whether there is a picture to be replaced by an empty
    /// one. The next slice defines the next box.
    ///
    /// # Errors
    /// Same as [`Self::begin`].
    fn clear(&mut self) -> Result<bool, Box<dyn std::error::Error + Send + Sync>> {
        let (Some(first), Some(reach)) = (self.first.take(), self.reach.take()) else { return Ok(false) };
        self.begin(&first, reach, false)?;
        self.reach = None;
        let Some(drawn) = &mut self.drawn else { return Ok(false) };
        drawn.renderer.draw();
        drawn.refining = false;
        drawn.captured_ns = None;
        drawn.pictures += 1;
        Ok(true)
    }

    /// Returns the requested view.
    fn requested_view(&self, is_last: bool) -> View {
        if is_last { self.home } else { self.shared_client.client().view(self.home) }
    }

    /// Returns whether a view is to be refined or changed.
    fn is_due(&self, is_last: bool) -> bool {
        let is_refining = self.drawn.as_ref().is_some_and(|drawn| drawn.refining);
        !self.is_unread && (is_refining || self.requested_view(is_last) != self.view)
    }

    /// Refines the requested view for a time that delays nobody; returns whether there is a new
    /// picture to show. The last picture is finished, from the home view.
    fn turn(&mut self, is_last: bool) -> bool {
        let view = self.requested_view(is_last);
        let Some(drawn) = self.drawn.as_mut().filter(|_| !self.is_unread) else { return false };
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
    fn answer(&self, client: &dyn ViewClient) {
        client.answer(self.drawn.as_ref().filter(|_| !self.is_unread).map(|drawn| &drawn.renderer));
    }
}

/// Reports the end of the render thread, whatever ended it, to those who wait for a picture.
struct EndReport<'a>(&'a Shared);

impl Drop for EndReport<'_> {
    fn drop(&mut self) {
        self.0.picture_ended();
    }
}

/// Renders until no slice follows. If `certain`, renders only certain slices, for which
/// insertion waits. Returns `None` if no slice ever arrived.
///
/// # Errors
/// Settings that cannot produce a picture; insertion continues.
pub(super) fn run(
    shared: &Shared,
    shared_client: &SharedViewClient,
    certain: bool,
    clock: &dyn Clock,
    mut shown: impl FnMut(&Drawn) + Send,
) -> Result<Option<Drawn>, Box<dyn std::error::Error + Send + Sync>> {
    let _gone = EndReport(shared);
    let background = Background::new("draw")?;
    let (home, view) = <(View, View)>::default();
    let (first, reach, changes) = (None, None, [0; 2]);
    let mut rendering = RenderState { shared_client, changes, first, reach, is_unread: true, home, view, drawn: None };
    // Slices that are rendered, and those known to be inserted.
    let (mut seen, mut known) = (0, 0);
    // Those of the latter that were inserted before the last clearing.
    let mut cleared = 0;
    let mut pacing = Pacing::new(Instant::now());
    loop {
        let client = shared_client.client();
        let is_watched = client.is_watched();
        let is_refining = rendering.drawn.as_ref().is_some_and(|drawn| drawn.refining);
        let volume = match is_watched {
            true => shared.wait(seen, certain, if is_refining { Duration::ZERO } else { client.turn() }),
            false => shared.wait(known, certain, TURN),
        };
        let is_last = volume.ended;
        let changes =
            [shared_client.changes.load(Ordering::Relaxed), if is_last { 0 } else { client.style_revision() }];
        if is_last && !client.keeps_last() {
            return Ok(None);
        }
        known = volume.pending.inserted;
        if is_last && volume.pending.slices() == 0 {
            return Ok(None);
        }
        if !is_last && !is_watched {
            continue;
        }
        if volume.pending.cleared != cleared {
            cleared = volume.pending.cleared;
            seen = cleared;
            drop(volume);
            // If only certain slices are rendered, an empty volume is not shown.
            background.run(|| {
                if rendering.clear()? && !certain {
                    present(&rendering, &mut shown);
                }
                Ok::<_, Box<dyn std::error::Error + Send + Sync>>(())
            })?;
            continue;
        }
        // Changed view settings are rendered even if no slice has arrived since.
        let is_shown = changes == rendering.changes && !rendering.is_unread;
        if volume.pending.inserted == seen && (is_shown || seen == cleared) {
            drop(volume);
            // The background thread is woken only if there is work.
            if rendering.is_due(is_last) {
                background.run(|| {
                    if rendering.turn(is_last) {
                        present(&rendering, &mut shown);
                    }
                });
            }
            rendering.answer(client);
            if is_last {
                return Ok(rendering.drawn);
            }
            continue;
        }
        if certain && !volume.awaited && !volume.ended {
            continue;
        }
        let early = pacing.wait(Instant::now());
        if !volume.ended && !volume.awaited && !early.is_zero() {
            drop(volume);
            if !rendering.is_unread {
                rendering.answer(client);
            }
            drop(shared.wait(known, false, early.min(TURN)));
            continue;
        }
        let (Some(first), Some(reach)) = (volume.pending.first, volume.pending.reach) else {
            // None of the slices touched the volume.
            seen = volume.pending.inserted;
            drop(volume);
            shared.shown(seen);
            continue;
        };
        if rendering.reach != Some(reach) || rendering.changes != changes {
            // Insertion continues meanwhile, and may leave this box too.
            drop(volume);
            let is_same = rendering.changes == changes;
            rendering.changes = changes;
            background.run(|| match is_same && rendering.widen(&first, reach)? {
                true => Ok(()),
                false => rendering.begin(&first, reach, is_last),
            })?;
            continue;
        }
        let Some(drawn) = &mut rendering.drawn else { continue };
        let (frame, slices) = (volume.pending.item, volume.pending.inserted);
        let _span = trace_span!(target: STAGE, "draw", frame, slices).entered();
        let began = Instant::now();
        let mut volume = catch_up(shared, volume, drawn, &first, rendering.is_unread);
        if volume.pending.reach != rendering.reach {
            // Insertion has left the box meanwhile, and what it changed outside was not read.
            rendering.is_unread = true;
            continue;
        }
        let PendingChanges { inserted, item, time_ns, captured_ns, .. } = volume.pending;
        let slab = volume.pending.changes.shown().filter(|_| !rendering.is_unread);
        rendering.is_unread = false;
        // From here on, insertion continues.
        drop(volume);
        drawn.by_slab += u64::from(slab.is_some());
        drawn.in_parts += u64::from(drawn.renderer.count_of_parts() > 1);
        background.run(|| drawn.renderer.draw_within(slab.as_ref()));
        (drawn.slices, drawn.item, drawn.time_ns, drawn.captured_ns) = (inserted, item, time_ns, captured_ns);
        drawn.pictures += 1;
        drawn.skipped += (inserted - seen).saturating_sub(1);
        drawn.draw.add_ns(ns(began.elapsed()));
        if let Some(captured_ns) = captured_ns {
            drawn.capture_to_picture.add_ns(clock.now_ns() - captured_ns);
        }
        seen = inserted;
        pacing.began(began, Duration::from_secs_f64(client.most_hz().max(LEAST_HZ).recip()));
        // Slices do not delay a viewer who turns the view meanwhile, nor does the viewer delay
        // slices.
        background.run(|| {
            rendering.turn(is_last);
            present(&rendering, &mut shown);
        });
        shared.shown(inserted);
        rendering.answer(client);
    }
}

/// Passes the present picture to all its receivers.
fn present(rendering: &RenderState<'_>, shown: &mut impl FnMut(&Drawn)) {
    if let Some(drawn) = &rendering.drawn {
        shown(drawn);
        rendering.shared_client.client().shown(drawn);
    }
}

/// Reads the changed bricks, or all of them, in parts. Insertion continues between the parts,
/// and its changes are read last, so that the renderer is up to date when this returns.
fn catch_up<'a>(
    shared: &'a Shared,
    mut volume: MutexGuard<'a, SharedVolume>,
    drawn: &mut Drawn,
    first: &FirstSlice,
    mut all: bool,
) -> MutexGuard<'a, SharedVolume> {
    let mut waits: Vec<BrickIndex> = Vec::new();
    for round in 0_u32.. {
        let began = Instant::now();
        let SharedVolume { inserter, pending, .. } = &mut *volume;
        let Some(reconstructor) = inserter.reconstructor() else { return volume };
        let bricks = Shifted::new(reconstructor.volume(), first.lattice.offset);
        all |= std::mem::take(&mut pending.changes.all);
        if std::mem::take(&mut all) {
            waits = bricks.bricks().collect();
            pending.changes.bricks.clear();
        } else {
            waits.append(&mut pending.changes.bricks);
        }
        // If insertion were faster than reading, no picture would ever be rendered otherwise.
        let most = if round < MOST_PARTS { PART } else { usize::MAX };
        let part = waits.split_off(waits.len().saturating_sub(most));
        drawn.renderer.read(&bricks, &part);
        drawn.held.add_ns(ns(began.elapsed()));
        if waits.is_empty() {
            return volume;
        }
        drop(volume);
        // Threads that wait for the volume get it before it is locked again.
        if shared.is_wanted() {
            std::thread::sleep(PAUSE);
        }
        volume = shared.lock();
    }
    volume
}

fn ns(time: Duration) -> i64 {
    i64::try_from(time.as_nanos()).unwrap_or(i64::MAX)
}
