//! Plane viewer: plane images of the growing volume, in a thread of its own.
//!
//! Insertion waits only while new bricks that meet the planes are read, a few at a time.
//! Sampling, colouring and display run concurrently. Without a viewer, nothing is noted or kept.
//! A plane is sampled when it has moved or a slice has changed a brick that it meets. It is
//! shown when that changed its image or its style has changed.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use rustix::time::{ClockId, clock_gettime};

use render::section::{Box3, Planar, Sampled, Section};
use volume::brick::{BrickIndex, EDGE};
use volume::lattice::Shifted;
use volume::read::Values as _;

use super::brick_subset::{BrickCopy, BrickSubset, Known, PlaneFootprint};
use super::changes::Changes;
use super::shared_volume::{Begun, Shared, SharedVolume};

/// Interval at which the thread checks for a viewer.
const IDLE: Duration = Duration::from_millis(50);
/// Interval at which requested planes and changes are checked: at most 12 images of each plane a
/// second.
const PERIOD: Duration = Duration::from_millis(80);
/// Rest after work, as a multiple of its duration: a machine of two cores has a session to run.
/// Waiting for the volume is not work.
const RESTS: u32 = 2;
/// Bricks that are read while insertion waits: about 0.5 ms.
const PART: usize = 512;
/// Pause between two reads, during which insertion can continue.
const PAUSE: Duration = Duration::from_micros(200);
/// Most bricks that are kept, 4 KiB each.
const MOST_BRICKS: usize = 1 << 15;
/// Granularity of the planes' box, bricks, so that it grows seldom.
const STEP: i64 = 2;

/// Viewer of planes through the growing volume.
pub trait PlaneViewer: Send + Sync {
    /// Returns whether any plane is viewed.
    fn is_watched(&self) -> bool;

    /// Returns the requested planes, for a volume of this extent.
    fn wants(&self, extent: &Extent) -> Vec<PlaneRequest>;

    /// Receives a plane's present image.
    fn cut(&self, cut: &PlaneImage<'_>);

    /// Receives the reason why there is no plane to show. Called once per reason.
    fn nothing(&self, why: &str);
}

/// Position of a volume.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Extent {
    /// The box of the seen voxels, and a little more.
    pub place: Box3,
    /// Smallest voxel spacing, mm.
    pub voxel_mm: f64,
    /// Grey values of black and white in the scanner's frames.
    pub grey_levels: [f32; 2],
}

/// A requested plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlaneRequest {
    /// The viewer's number of this plane.
    pub number: usize,
    /// Its pixels.
    pub section: Section,
    /// Style number, for instance of a grey-value window. If it changes, the plane is shown
    /// again without other changes.
    pub look: u64,
}

/// A plane's present image. Slices that arrived while it was read may be in parts of it; then it
/// is read again.
#[derive(Debug, Clone, Copy)]
pub struct PlaneImage<'a> {
    /// The request.
    pub wanted: PlaneRequest,
    /// Extent of the volume.
    pub extent: Extent,
    /// Its pixels, row by row.
    pub sampled: &'a [Sampled],
    /// Slices in the volume.
    pub slices: u64,
    /// Number of the last one's frame.
    pub item: u64,
    /// Capture time of that frame, host ns; `None` in a replay.
    pub captured_ns: Option<i64>,
    /// Work done for planes so far.
    pub work: CutWork,
}

/// Work done for planes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct CutWork {
    /// Bricks read while insertion waited.
    pub bricks: u64,
    /// Planes sampled.
    pub planes: u64,
    /// Planes shown.
    pub shown: u64,
}

/// First and last brick of a box, both inclusive.
type Span = [[i64; 3]; 2];

/// A plane that was shown.
struct Shown {
    wanted: PlaneRequest,
    sampled: Vec<Sampled>,
}

/// State of the thread: its knowledge of the volume.
#[derive(Default)]
struct Table {
    /// The lattice of all this; `None` if nothing is known.
    begun: Option<Begun>,
    /// Box of the seen bricks.
    span: Option<Span>,
    known: Known,
    swatch: BrickSubset,
    shown: BTreeMap<usize, Shown>,
    /// The last reported reason why there is nothing to show.
    nothing: String,
    work: CutWork,
}

/// Shows planes until no slice follows; then their final state, if there is a viewer.
pub(super) fn run(shared: &Shared, cutter: &dyn PlaneViewer) {
    let mut table: Option<Table> = None;
    let mut work = CutWork::default();
    loop {
        let (began, spent) = (Instant::now(), spent());
        if cutter.is_watched() {
            let table = table.get_or_insert_with(|| Table { work, ..Table::default() });
            let ended = table.turn(shared, cutter);
            work = table.work;
            if ended {
                return;
            }
            let busy = self::spent().saturating_sub(spent);
            shared.rest((busy * RESTS).max(PERIOD.saturating_sub(began.elapsed())));
            continue;
        }
        let mut fabric = shared.lock();
        fabric.news.aside = None;
        let ended = fabric.ended;
        drop(fabric);
        table = None;
        if ended {
            return;
        }
        shared.rest(IDLE);
    }
}

/// Returns the CPU time of this thread.
fn spent() -> Duration {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    // Seconds are never negative, and nanoseconds are below 10⁹.
    Duration::new(time.tv_sec as u64, time.tv_nsec as u32)
}

/// State read under the lock.
struct VolumeState {
    begun: Option<Begun>,
    changes: Changes,
    /// All bricks and the box of the seen ones, if any brick may have changed.
    all: Option<(Vec<BrickIndex>, Option<Span>)>,
    slices: u64,
    item: u64,
    captured_ns: Option<i64>,
    ended: bool,
}

fn glance(shared: &Shared) -> VolumeState {
    let mut fabric = shared.lock();
    let SharedVolume { loom, news, ended, .. } = &mut *fabric;
    let changes = news.aside.replace(Changes::default()).unwrap_or_else(Changes::unknown);
    let all = match (loom.weaver(), news.begun) {
        (Some(weaver), Some(begun)) if changes.all => {
            let bricks = Shifted::new(weaver.volume(), begun.lattice.offset).bricks().collect();
            let bounds = weaver.volume().seen_bounds().map(|(low, high)| {
                [low, high].map(|voxel| begun.lattice.index(voxel).map(|x| x.div_euclid(EDGE as i64)))
            });
            Some((bricks, bounds))
        }
        _ => None,
    };
    let (slices, item, captured_ns) = (news.woven, news.item, news.captured_ns);
    VolumeState { begun: news.begun, changes, all, slices, item, captured_ns, ended: *ended }
}

impl Table {
    /// Shows the planes that are due; returns whether no slice follows.
    fn turn(&mut self, shared: &Shared, cutter: &dyn PlaneViewer) -> bool {
        let glance = glance(shared);
        let ended = glance.ended;
        if let Err(why) = self.look(shared, cutter, glance) {
            self.shown.clear();
            self.swatch.clear();
            if self.nothing != why {
                cutter.nothing(&why);
                self.nothing = why;
            }
        }
        ended
    }

    /// Applies the state read under the lock, and shows the planes that it changed.
    ///
    /// # Errors
    /// The reason why there is nothing to show.
    fn look(&mut self, shared: &Shared, cutter: &dyn PlaneViewer, glance: VolumeState) -> Result<(), String> {
        let is_known = self.begun.map(|known| known.lattice) == glance.begun.map(|begun| begun.lattice);
        self.begun = glance.begun;
        let Some(begun) = glance.begun else { return Err("no voxel was seen yet".into()) };
        let VolumeState { mut changes, .. } = glance;
        match glance.all {
            Some((bricks, span)) => {
                self.known = bricks.into_iter().collect();
                self.span = span;
                self.swatch.clear();
            }
            // The volume was replaced: all of it is requested.
            None if !is_known => {
                shared.lock().news.aside = None;
                return Ok(());
            }
            None => {
                changes.bricks.sort_unstable();
                changes.bricks.dedup();
                for brick in &changes.bricks {
                    self.known.insert(*brick);
                    self.swatch.remove(*brick);
                    self.span = Some(widened(self.span, brick.map(i64::from)));
                }
            }
        }
        let Some(span) = self.span else { return Err("no voxel was seen yet".into()) };
        let extent = extent(&begun, span);
        let wanted = cutter.wants(&extent);
        let sheets: Vec<PlaneFootprint> =
            wanted.iter().map(|wanted| PlaneFootprint::new(&wanted.section, &extent.place)).collect();
        let moved: Vec<bool> = wanted.iter().map(|wanted| self.is_moved(wanted) || changes.all).collect();
        self.shown.retain(|number, _| wanted.iter().any(|wanted| wanted.number == *number));
        if moved.contains(&true) {
            self.swatch.keep(&sheets);
        }
        let fresh = self.fresh(&changes, &sheets, &moved);
        if self.swatch.len() + fresh.len() > MOST_BRICKS {
            return Err(format!(
                "these planes meet more than {MOST_BRICKS} bricks of the volume; choose a coarser volume.spacing_mm"
            ));
        }
        self.read(shared, &begun, &fresh);
        self.nothing.clear();
        for ((wanted, sheet), moved) in wanted.into_iter().zip(sheets).zip(moved) {
            let hit: Vec<_> = match moved {
                true => Vec::new(),
                false => changes
                    .bricks
                    .iter()
                    .filter(|brick| sheet.meets(**brick))
                    .filter_map(|brick| sheet.pixels(*brick))
                    .collect(),
            };
            let is_other = if moved { self.sample(wanted, &extent) } else { self.renew(wanted, &extent, &hit) };
            if is_other {
                self.work.shown += 1;
                let Some(Shown { sampled, .. }) = self.shown.get(&wanted.number) else { continue };
                let VolumeState { slices, item, captured_ns, .. } = glance;
                cutter.cut(&PlaneImage { wanted, extent, sampled, slices, item, captured_ns, work: self.work });
            }
        }
        Ok(())
    }

    /// Returns whether a plane has moved since it was shown.
    fn is_moved(&self, wanted: &PlaneRequest) -> bool {
        self.shown.get(&wanted.number).is_none_or(|shown| shown.wanted.section != wanted.section)
    }

    /// Returns the bricks that are to be read, each once.
    fn fresh(&self, changes: &Changes, sheets: &[PlaneFootprint], moved: &[bool]) -> Vec<BrickIndex> {
        let missing =
            |brick: &&BrickIndex| !self.swatch.has(**brick) && sheets.iter().any(|sheet| sheet.meets(**brick));
        match moved.contains(&true) {
            true => self.known.iter().filter(missing).copied().collect(),
            false => changes.bricks.iter().filter(missing).copied().collect(),
        }
    }

    /// Reads bricks in parts; insertion continues in between. Changes made meanwhile are
    /// reported by the next glance.
    fn read(&mut self, shared: &Shared, begun: &Begun, bricks: &[BrickIndex]) {
        for part in bricks.chunks(PART) {
            let fabric = shared.lock();
            // The volume was replaced: the next glance reports that all has changed.
            let Some(weaver) = fabric.loom.weaver() else { return };
            let volume = Shifted::new(weaver.volume(), begun.lattice.offset);
            for brick in part {
                self.swatch.put(*brick, BrickCopy::of(&volume, *brick));
            }
            drop(fabric);
            self.work.bricks += part.len() as u64;
            // Threads that wait for the volume get it before it is locked again.
            std::thread::sleep(PAUSE);
        }
    }

    /// Samples a plane that has moved; returns whether its image has changed.
    fn sample(&mut self, wanted: PlaneRequest, extent: &Extent) -> bool {
        self.work.planes += 1;
        let planar = Planar { volume: &self.swatch, place: extent.place, pool: None };
        let (sampled, _) = planar.sample(&wanted.section);
        let before = self.shown.insert(wanted.number, Shown { wanted, sampled });
        let now = self.shown.get(&wanted.number);
        before.zip(now).is_none_or(|(before, now)| before.wanted != wanted || before.sampled != now.sampled)
    }

    /// Samples the changed parts of a plane that has not moved; returns whether its image has
    /// changed.
    fn renew(&mut self, wanted: PlaneRequest, extent: &Extent, hit: &[[[u32; 2]; 2]]) -> bool {
        let area = |[low, high]: &[[u32; 2]; 2]| u64::from(high[0] - low[0] + 1) * u64::from(high[1] - low[1] + 1);
        if hit.iter().map(area).sum::<u64>() > wanted.section.pixels() as u64 {
            return self.sample(wanted, extent);
        }
        let Some(shown) = self.shown.get_mut(&wanted.number) else { return false };
        let mut is_other = shown.wanted.look != wanted.look;
        shown.wanted = wanted;
        self.work.planes += u64::from(!hit.is_empty());
        let planar = Planar { volume: &self.swatch, place: extent.place, pool: None };
        for pixels in hit {
            is_other |= planar.sample_again(&wanted.section, *pixels, &mut shown.sampled);
        }
        is_other
    }
}

fn widened(span: Option<Span>, brick: [i64; 3]) -> Span {
    let [low, high] = span.unwrap_or([brick; 2]);
    [0, 1].map(|end| std::array::from_fn(|a| if end == 0 { low[a].min(brick[a]) } else { high[a].max(brick[a]) }))
}

/// Returns the box around some bricks, rounded to a multiple of [`STEP`].
fn extent(begun: &Begun, [low, high]: Span) -> Extent {
    let edge = EDGE as i64;
    let first = low.map(|low| low.div_euclid(STEP) * STEP * edge);
    let last = high.map(|high| (high.div_euclid(STEP) + 1) * STEP * edge - 1);
    let place = Box3::new(begun.lattice.world_from_lattice, [first, last]);
    let matrix = place.world_from_lattice.matrix3;
    let voxel_mm = [matrix.x_axis, matrix.y_axis, matrix.z_axis]
        .map(|axis| axis.length())
        .into_iter()
        .fold(f64::INFINITY, f64::min);
    Extent { place, voxel_mm, grey_levels: begun.pixels.grey_levels() }
}
