//! The picture's thread: after each slice, or after as many as came while the last picture was drawn, the picture of what there is.
//!
//! Weaving waits while the volume is read, and for nothing else: settings are asked for, renderers made and pictures drawn while it goes on, by a thread that gives way to it
//! ([`Background`]). The volume is read by one that does not, or weaving would on a busy machine have to wait for whatever that gives way to.

use std::num::NonZeroU64;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use drivers::clock::Clock;
use tracing::trace_span;

use super::fabric::{Begun, Fabric, News, Shared};
use super::priority::Background;
use super::reach::Reach;
use super::timing::Spread;
use crate::render::camera::View;
use crate::render::{RenderSettings, Renderer, Stage};
use crate::trace::STAGE;
use crate::volume::brick::BrickIndex;
use crate::volume::lattice::Shifted;
use crate::volume::read::Values as _;

/// The longest that the thread waits before it looks whether it is to end.
const TURN: Duration = Duration::from_millis(100);
/// Bricks that are read while weaving waits: about a millisecond's.
const PART: usize = 256;
/// So many of such parts are read one by one; then all that is left is.
const MOST_PARTS: u32 = 2048;
/// For how long weaving does not wait between two of them.
const PAUSE: Duration = Duration::from_micros(100);
/// For how long a view is refined before slices and other views are looked after.
const REFINED: Duration = Duration::from_millis(15);
/// Pictures a second that there are at least while slices come, whatever is asked for.
const LEAST_HZ: f64 = 0.01;

/// How a picture is to be looked at; the first slice settles the rest.
pub trait Looks: Send + Sync {
    /// Settings of the renderer, by the grey levels' range and the first slice's directions.
    ///
    /// # Errors
    /// A sentence, when they make no picture.
    fn settings(&self, begun: &First) -> Result<RenderSettings, Box<dyn std::error::Error + Send + Sync>>;

    /// A number that is another one whenever [`Self::dress`] does something else; 0 where it does nothing. Asked before each picture, and every [turn](Self::turn).
    fn dressing(&self) -> u64 {
        0
    }

    /// Changes what was asked for by [`Self::settings`], as somebody who looks wants it. The last picture has the settings themselves whatever this does.
    fn dress(&self, _settings: &mut RenderSettings) {}

    /// A picture is drawn. The next one waits for whoever looks at this one; slices do not.
    fn shown(&self, _drawn: &Drawn) {}

    /// The picture is as it was shown last, and its thread has a moment: whoever has a question about it is answered now. `None` where the volume is empty. Called after each
    /// picture, and every [turn](Self::turn) while none is due.
    fn answer(&self, _shown: Option<&Renderer>) {}

    /// Of a recording: the slices of which there is a picture each, one of so many; weaving waits for it then, and of others none is drawn but the last. `None` leaves it to
    /// how fast both are, as live.
    fn every(&self) -> Option<NonZeroU64> {
        None
    }

    /// From where it is looked at now; `home` is what the settings say. Asked before each picture, and every [turn](Self::turn) while none is due. The last picture is from
    /// home whatever this says.
    fn view(&self, home: View) -> View {
        home
    }

    /// Whether anybody looks. While nobody does, nothing is read, shaded or cast.
    fn is_watched(&self) -> bool {
        true
    }

    /// Whether there is to be a picture of all slices in the end.
    fn keeps_last(&self) -> bool {
        true
    }

    /// For how long nobody needs to be asked anything while no slice comes.
    fn turn(&self) -> Duration {
        TURN
    }

    /// Pictures a second at most; asked before each. As many as there is time for, unless it is said. The last one is drawn at once.
    fn most_hz(&self) -> f64 {
        f64::INFINITY
    }
}

/// What is known of a scan after its first slice.
#[derive(Debug, Clone, Copy)]
pub struct First {
    /// Directions of u and v in the world.
    pub slice_axes: Option<[glam::DVec3; 2]>,
    /// Black and white of its pictures.
    pub grey_levels: [f32; 2],
}

/// The picture, and how it was kept.
pub struct Drawn {
    /// The renderer, with the picture of all slices.
    pub renderer: Renderer,
    /// Slices that were woven until then: those that it shows, and those before the volume was cleared.
    pub slices: u64,
    /// The frame of the last of them.
    pub item: u64,
    /// When it was captured, host ns; `None` of a recording.
    pub captured_ns: Option<i64>,
    /// Whether the view is new, so that the picture is coarser than it will be.
    pub refining: bool,
    /// Pictures drawn.
    pub pictures: u64,
    /// Slices that came while another picture was drawn, and were drawn with the next.
    pub skipped: u64,
    /// From the frame's capture to its picture, ms.
    pub capture_to_picture: Spread,
    /// From taking the volume to its picture, ms.
    pub draw: Spread,
    /// For how long weaving could not go on while the volume was read, ms.
    pub held: Spread,
}

/// How the volume is looked at, which may change while it is.
pub(super) struct Wall {
    looks: Mutex<Arc<dyn Looks>>,
    changes: AtomicU64,
}

impl Wall {
    pub(super) fn new(looks: Arc<dyn Looks>) -> Self {
        Self { looks: Mutex::new(looks), changes: AtomicU64::new(0) }
    }

    /// From the next picture on.
    pub(super) fn hang(&self, looks: &Arc<dyn Looks>) {
        *self.looks.lock().unwrap_or_else(PoisonError::into_inner) = Arc::clone(looks);
        self.changes.fetch_add(1, Ordering::Relaxed);
    }

    pub(super) fn looks(&self) -> Arc<dyn Looks> {
        Arc::clone(&self.looks.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

/// The thread's state.
struct Easel<'a> {
    wall: &'a Wall,
    /// Of the wall, and the dressing that the renderer wears.
    changes: [u64; 2],
    begun: Option<Begun>,
    reach: Option<Reach>,
    /// The renderer has seen nothing of the volume yet.
    blank: bool,
    /// What the settings look from, and what is looked from now.
    home: View,
    view: View,
    drawn: Option<Drawn>,
}

impl Easel<'_> {
    /// A renderer for a box, which has seen nothing; from home at last.
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
        let stage = Stage::new(begun.lattice.world_from_lattice, low, high)?;
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

    /// The volume was cleared: whether there is a picture that is to become one of nothing. The next slice says what the next one is of.
    ///
    /// # Errors
    /// As of [`Self::stretch`].
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

    /// The view that is wanted.
    fn wanted(&self, is_last: bool) -> View {
        if is_last { self.home } else { self.wall.looks().view(self.home) }
    }

    /// Whether there is anything to go on with.
    fn is_due(&self, is_last: bool) -> bool {
        let is_refining = self.drawn.as_ref().is_some_and(|drawn| drawn.refining);
        !self.blank && (is_refining || self.wanted(is_last) != self.view)
    }

    /// Goes on with the view that is wanted, for as long as nobody is kept waiting by it: whether there is another picture to be shown. At last it is finished, from home.
    fn turn(&mut self, is_last: bool) -> bool {
        let view = self.wanted(is_last);
        let Some(drawn) = self.drawn.as_mut().filter(|_| !self.blank) else { return false };
        let is_new = view != self.view;
        if is_new {
            self.view = view;
            // A view that is none leaves the one before.
            drawn.refining |= drawn.renderer.look(view).is_ok();
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

    /// Whoever points at the picture is answered.
    fn answer(&self, looks: &dyn Looks) {
        looks.answer(self.drawn.as_ref().filter(|_| !self.blank).map(|drawn| &drawn.renderer));
    }
}

/// Whoever waits for a picture is told when its thread is gone, whatever ended it.
struct Gone<'a>(&'a Shared);

impl Drop for Gone<'_> {
    fn drop(&mut self) {
        self.0.undrawn();
    }
}

/// Draws until no slice follows; of certain slices only, if so, for which weaving waits. `None` where none ever came.
///
/// # Errors
/// What makes no picture; the volume is woven on.
pub(super) fn run(
    shared: &Shared,
    wall: &Wall,
    certain: bool,
    clock: &dyn Clock,
    mut shown: impl FnMut(&Drawn) + Send,
) -> Result<Option<Drawn>, Box<dyn std::error::Error + Send + Sync>> {
    let _gone = Gone(shared);
    let background = Background::new("draw")?;
    let (home, view) = <(View, View)>::default();
    let (begun, reach, changes) = (None, None, [0; 2]);
    let mut easel = Easel { wall, changes, begun, reach, blank: true, home, view, drawn: None };
    // Slices that are drawn, and those of which is known that they came.
    let (mut seen, mut known) = (0, 0);
    // Of the latter, those before the volume was cleared last.
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
            // Pictures of certain slices only are none of nothing.
            background.run(|| {
                if easel.wipe()? && !certain {
                    present(&easel, &mut shown);
                }
                Ok::<_, Box<dyn std::error::Error + Send + Sync>>(())
            })?;
            continue;
        }
        // What is looked at otherwise is drawn again though no slice has come since.
        let is_shown = changes == easel.changes && !easel.blank;
        if fabric.news.woven == seen && (is_shown || seen == cleared) {
            drop(fabric);
            // Nobody is woken for nothing.
            if easel.is_due(is_last) {
                background.run(|| {
                    if easel.turn(is_last) {
                        present(&easel, &mut shown);
                    }
                });
            }
            easel.answer(&*looks);
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
                easel.answer(&*looks);
            }
            shared.rest(early.min(TURN));
            continue;
        }
        let (Some(begun), Some(reach)) = (fabric.news.begun, fabric.news.reach) else {
            // Slices of which nothing fell into the volume.
            seen = fabric.news.woven;
            drop(fabric);
            shared.shown(seen);
            continue;
        };
        if easel.reach != Some(reach) || easel.changes != changes {
            // Weaving goes on meanwhile; where it leaves this box, too, the next one is larger by half.
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
            // Weaving has left the box meanwhile.
            easel.blank = true;
            continue;
        }
        easel.blank = false;
        let News { woven, item, captured_ns, .. } = fabric.news;
        fabric.news.changes.bricks.clear();
        // From here on the volume is woven on.
        drop(fabric);
        background.run(|| drawn.renderer.draw());
        (drawn.slices, drawn.item, drawn.captured_ns) = (woven, item, captured_ns);
        drawn.pictures += 1;
        drawn.skipped += (woven - seen).saturating_sub(1);
        drawn.draw.add_ns(ns(began.elapsed()));
        if let Some(captured_ns) = captured_ns {
            drawn.capture_to_picture.add_ns(clock.now_ns() - captured_ns);
        }
        seen = woven;
        due = began + Duration::from_secs_f64(1.0 / wall.looks().most_hz().max(LEAST_HZ));
        // Whoever turns the view meanwhile is not kept waiting by slices, nor they by him.
        background.run(|| {
            easel.turn(is_last);
            present(&easel, &mut shown);
        });
        shared.shown(woven);
        easel.answer(&*looks);
    }
}

/// The picture as it is, to all who are to have it.
fn present(easel: &Easel<'_>, shown: &mut impl FnMut(&Drawn)) {
    if let Some(drawn) = &easel.drawn {
        shown(drawn);
        easel.wall.looks().shown(drawn);
    }
}

/// Reads what has changed, or all there is, so many bricks at a time: between them weaving goes on, and what it changes is read at last, so that the renderer has the volume
/// as it is when this returns.
fn catch_up<'a>(
    shared: &'a Shared,
    mut fabric: MutexGuard<'a, Fabric>,
    drawn: &mut Drawn,
    begun: &Begun,
    mut all: bool,
) -> MutexGuard<'a, Fabric> {
    let mut waits: Vec<BrickIndex> = Vec::new();
    for round in 0_u32.. {
        let began = Instant::now();
        let Fabric { loom, news, .. } = &mut *fabric;
        let Some(weaver) = loom.weaver() else { return fabric };
        let volume = Shifted::new(weaver.volume(), begun.lattice.offset);
        all |= std::mem::take(&mut news.changes.all);
        if std::mem::take(&mut all) {
            waits = volume.bricks().collect();
            news.changes.bricks.clear();
        } else {
            waits.append(&mut news.changes.bricks);
        }
        // A machine that weaves faster than it reads would never come to draw.
        let most = if round < MOST_PARTS { PART } else { usize::MAX };
        let part = waits.split_off(waits.len().saturating_sub(most));
        drawn.renderer.read(&volume, &part);
        drawn.held.add_ns(ns(began.elapsed()));
        if waits.is_empty() {
            return fabric;
        }
        drop(fabric);
        // Who has waited for the volume gets it before it is asked for again.
        std::thread::sleep(PAUSE);
        fabric = shared.lock();
    }
    fabric
}

fn ns(time: Duration) -> i64 {
    i64::try_from(time.as_nanos()).unwrap_or(i64::MAX)
}
