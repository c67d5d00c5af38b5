//! Planes through the volume while it grows, in a thread of its own.
//!
//! Weaving waits while the bricks are read that the planes meet and that are new, a few at a time; sampled, coloured and shown they are while it goes on. While nobody looks
//! nothing is noted and nothing kept. A plane is sampled when it lies elsewhere or a slice has changed a brick that it meets, and shown when that made another picture of it, or
//! it is to look otherwise.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use rustix::time::{ClockId, clock_gettime};

use super::changes::Changes;
use super::fabric::{Begun, Fabric, Shared};
use super::swatch::{Known, Leaf, Sheet, Swatch};
use crate::render::section::{Box3, Planar, Sampled, Section};
use crate::volume::brick::{BrickIndex, EDGE};
use crate::volume::lattice::Shifted;
use crate::volume::read::Values as _;

/// Between two looks at whether somebody looks.
const IDLE: Duration = Duration::from_millis(50);
/// Between two looks at what planes are wanted and what has changed: 12 pictures a second of each at most.
const PERIOD: Duration = Duration::from_millis(80);
/// After some work, so many times as long is rested: a machine of two cores has a session to run. Waiting for the volume is no work.
const RESTS: u32 = 2;
/// Bricks that are read while weaving waits: about half a millisecond's.
const PART: usize = 512;
/// For how long weaving does not wait between two of them.
const PAUSE: Duration = Duration::from_micros(200);
/// Bricks that may be kept, 4 KiB each.
const MOST_BRICKS: usize = 1 << 15;
/// The box that planes are of ends at every so many bricks, so that it grows seldom.
const STEP: i64 = 2;

/// Who looks at planes through the volume while it grows.
pub trait Cutter: Send + Sync {
    /// Whether anybody looks at any plane.
    fn is_watched(&self) -> bool;

    /// The planes that are looked at, through a volume that lies there.
    fn wants(&self, extent: &Extent) -> Vec<Wanted>;

    /// A plane as it is now.
    fn cut(&self, cut: &Cut<'_>);

    /// There is no plane to be shown, and why. Said once.
    fn nothing(&self, why: &str);
}

/// Where a volume lies.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Extent {
    /// The box of what was seen, and a little more.
    pub place: Box3,
    /// The smallest distance of neighbouring voxels, mm.
    pub voxel_mm: f64,
    /// Black and white of the scanner's pictures.
    pub grey_levels: [f32; 2],
}

/// A plane that is looked at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wanted {
    /// Which one it is to whom who wants it.
    pub number: usize,
    /// Its pixels.
    pub section: Section,
    /// Of another look, as of another window, it is shown again though nothing else has changed.
    pub look: u64,
}

/// A plane as it is now. Slices that came while it was read may be in parts of it; then it is read again.
#[derive(Debug, Clone, Copy)]
pub struct Cut<'a> {
    /// As it was wanted.
    pub wanted: Wanted,
    /// The volume that it is of.
    pub extent: Extent,
    /// Its pixels, row by row.
    pub sampled: &'a [Sampled],
    /// Slices in it, and the frame of the last.
    pub slices: u64,
    /// That frame's number.
    pub item: u64,
    /// When that was captured, host ns; `None` of a recording.
    pub captured_ns: Option<i64>,
    /// What was done for planes up to now.
    pub work: CutWork,
}

/// What was done for planes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct CutWork {
    /// Bricks read while weaving waited.
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
    wanted: Wanted,
    sampled: Vec<Sampled>,
}

/// The thread's state: what it knows of the volume.
#[derive(Default)]
struct Table {
    /// The lattice that all of this is on; `None` knows nothing.
    begun: Option<Begun>,
    /// Of what was seen.
    span: Option<Span>,
    known: Known,
    swatch: Swatch,
    shown: BTreeMap<usize, Shown>,
    /// What was said of why there is nothing.
    nothing: String,
    work: CutWork,
}

/// Shows planes until no slice follows; then once more as they are in the end, if somebody looks.
pub(super) fn run(shared: &Shared, cutter: &dyn Cutter) {
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

/// What this thread has worked since it began.
fn spent() -> Duration {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    // Neither is ever below 0, nor is there a second of nanoseconds.
    Duration::new(time.tv_sec as u64, time.tv_nsec as u32)
}

/// What a look under the lock has brought.
struct Glance {
    begun: Option<Begun>,
    changes: Changes,
    /// All bricks, where all may have changed, and those between which something was seen.
    all: Option<(Vec<BrickIndex>, Option<Span>)>,
    slices: u64,
    item: u64,
    captured_ns: Option<i64>,
    ended: bool,
}

fn glance(shared: &Shared) -> Glance {
    let mut fabric = shared.lock();
    let Fabric { loom, news, ended, .. } = &mut *fabric;
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
    Glance { begun: news.begun, changes, all, slices, item, captured_ns, ended: *ended }
}

impl Table {
    /// Shows what there is to be shown; whether no slice follows.
    fn turn(&mut self, shared: &Shared, cutter: &dyn Cutter) -> bool {
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

    /// Takes in what a look has brought, and shows what changed by it.
    ///
    /// # Errors
    /// Why there is nothing to be shown.
    fn look(&mut self, shared: &Shared, cutter: &dyn Cutter, glance: Glance) -> Result<(), String> {
        let is_known = self.begun.map(|known| known.lattice) == glance.begun.map(|begun| begun.lattice);
        self.begun = glance.begun;
        let Some(begun) = glance.begun else { return Err("no voxel was seen yet".into()) };
        let Glance { mut changes, .. } = glance;
        match glance.all {
            Some((bricks, span)) => {
                self.known = bricks.into_iter().collect();
                self.span = span;
                self.swatch.clear();
            }
            // Another volume is there: all of it is asked for.
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
        let sheets: Vec<Sheet> = wanted.iter().map(|wanted| Sheet::new(&wanted.section, &extent.place)).collect();
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
                let Glance { slices, item, captured_ns, .. } = glance;
                cutter.cut(&Cut { wanted, extent, sampled, slices, item, captured_ns, work: self.work });
            }
        }
        Ok(())
    }

    /// Whether a plane lies elsewhere than it was shown.
    fn is_moved(&self, wanted: &Wanted) -> bool {
        self.shown.get(&wanted.number).is_none_or(|shown| shown.wanted.section != wanted.section)
    }

    /// The bricks that are to be read, each once.
    fn fresh(&self, changes: &Changes, sheets: &[Sheet], moved: &[bool]) -> Vec<BrickIndex> {
        let missing =
            |brick: &&BrickIndex| !self.swatch.has(**brick) && sheets.iter().any(|sheet| sheet.meets(**brick));
        match moved.contains(&true) {
            true => self.known.iter().filter(missing).copied().collect(),
            false => changes.bricks.iter().filter(missing).copied().collect(),
        }
    }

    /// Reads bricks, so many at a time: between them weaving goes on. What it changes meanwhile is told at the next look.
    fn read(&mut self, shared: &Shared, begun: &Begun, bricks: &[BrickIndex]) {
        for part in bricks.chunks(PART) {
            let fabric = shared.lock();
            // The volume has become another one: the next look finds that all has changed.
            let Some(weaver) = fabric.loom.weaver() else { return };
            let volume = Shifted::new(weaver.volume(), begun.lattice.offset);
            for brick in part {
                self.swatch.put(*brick, Leaf::of(&volume, *brick));
            }
            drop(fabric);
            self.work.bricks += part.len() as u64;
            // Who has waited for the volume gets it before it is asked for again.
            std::thread::sleep(PAUSE);
        }
    }

    /// Samples a plane that lies elsewhere; whether that is another picture than was shown.
    fn sample(&mut self, wanted: Wanted, extent: &Extent) -> bool {
        self.work.planes += 1;
        let planar = Planar { volume: &self.swatch, place: extent.place, pool: None };
        let (sampled, _) = planar.sample(&wanted.section);
        let before = self.shown.insert(wanted.number, Shown { wanted, sampled });
        let now = self.shown.get(&wanted.number);
        before.zip(now).is_none_or(|(before, now)| before.wanted != wanted || before.sampled != now.sampled)
    }

    /// Samples again what has changed of one that lies where it lay; whether that is another picture than was shown.
    fn renew(&mut self, wanted: Wanted, extent: &Extent, hit: &[[[u32; 2]; 2]]) -> bool {
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

/// The box about some bricks, which ends at every so many of them.
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
