//! Plane viewer: plane images of the growing volume, in a thread of its own.
//!
//! Insertion waits only while new bricks that meet the planes are read, a few at a time.
//! Sampling, colouring and display run concurrently. Without a viewer, nothing is noted or kept.
//! A plane is sampled when it has moved or a slice has changed a brick that it meets. It is
//! shown when that changed its image or its style has changed.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use glam::DVec3;
use rustix::time::{ClockId, clock_gettime};

use reconstruct::standard_error::Edge;
use render::section::{Box3, Planar, Sampled, Section};
use volume::brick::{BrickIndex, EDGE};
use volume::lattice::Shifted;
use volume::read::Values as _;

use super::brick_subset::{BrickCopy, BrickSubset, Known, PlaneFootprint};
use super::changes::Changes;
use super::plane_errors::{PlaneErrors, Readout, VolumeReadout};
use super::shared_volume::{FirstSlice, Shared, SharedVolume};
use super::status::StatusCollector;

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
    fn requested(&self, extent: &Extent) -> Vec<PlaneRequest>;

    /// Returns whether planes are shown with the standard errors of their voxels.
    fn shows_errors(&self) -> bool;

    /// Returns whether planes are shown with the places seen weakly, in shadows only.
    fn shows_weakly_seen(&self) -> bool;

    /// Returns the place whose voxel is read out, world mm, in a volume of this extent.
    fn readout_at(&self, extent: &Extent) -> DVec3;

    /// Answers waiting questions for the edges at places, world mm, by this function. It is called
    /// at least every 0.1 s or so, whether planes are viewed or not.
    fn answer_edges(&self, edges: &mut dyn FnMut(&[DVec3]) -> Vec<Option<Edge>>);

    /// Receives a plane's present image.
    fn show_plane(&self, image: &PlaneImage<'_>);

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
    pub style: u64,
}

/// A plane's present image. Slices that arrived while it was read may be in parts of it; then it
/// is read again.
#[derive(Debug, Clone, Copy)]
pub struct PlaneImage<'a> {
    /// The request.
    pub request: PlaneRequest,
    /// Extent of the volume.
    pub extent: Extent,
    /// Its pixels, row by row.
    pub sampled: &'a [Sampled],
    /// Standard errors of the pixels as values, row by row; empty unless they are shown.
    pub errors: &'a [Sampled],
    /// Whether the volume keeps standard errors.
    pub keeps_errors: bool,
    /// Whether the volume weighs pixels by the shadows that they lie in.
    pub weighs_shadows: bool,
    /// Weight below which a pixel was seen weakly; 0 unless that is shown.
    pub weak: f32,
    /// The voxel at the place that is read out; `None` if it is unseen.
    pub readout: Option<Readout>,
    /// Slices in the volume.
    pub slices: u64,
    /// Number of the last one's frame.
    pub item: u64,
    /// Capture time of that frame, host ns; `None` in a replay.
    pub captured_ns: Option<i64>,
    /// Work done for planes so far.
    pub work: PlaneWork,
}

/// Work done for planes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct PlaneWork {
    /// Bricks read while insertion waited.
    pub bricks: u64,
    /// Planes sampled.
    pub planes: u64,
    /// Planes shown.
    pub shown: u64,
}

/// Weight below which a place was seen weakly, as a share of the median in the planes' bricks.
const WEAK: f32 = 0.05;

/// First and last brick of a box, both inclusive.
type Span = [[i64; 3]; 2];

/// A plane that was shown.
struct LastPlane {
    plane: PlaneRequest,
    sampled: Vec<Sampled>,
    errors: Vec<Sampled>,
}

/// State of the thread: its knowledge of the volume.
#[derive(Default)]
struct Planes {
    /// The lattice of all this; `None` if nothing is known.
    first_slice: Option<FirstSlice>,
    /// Box of the seen bricks.
    span: Option<Span>,
    known: Known,
    subset: BrickSubset,
    errors: PlaneErrors,
    shown: BTreeMap<usize, LastPlane>,
    /// The last reported reason why there is nothing to show.
    nothing: String,
    work: PlaneWork,
}

/// Shows planes until no slice follows; then their final state, if there is a viewer. `status`
/// receives the memory of their data.
pub(super) fn run(shared: &Shared, viewer: &dyn PlaneViewer, status: Option<&StatusCollector>) {
    let holds = |bytes: u64| {
        if let Some(status) = status {
            status.lock().memory.plane_bytes = bytes;
        }
    };
    let mut planes: Option<Planes> = None;
    let mut work = PlaneWork::default();
    let mut of_edges = PlaneErrors::default();
    loop {
        let (began, spent) = (Instant::now(), spent());
        viewer.answer_edges(&mut |places| of_edges.edges(shared, places));
        if viewer.is_watched() {
            let planes = planes.get_or_insert_with(|| Planes { work, ..Planes::default() });
            planes.errors.pose_mm(status);
            let ended = planes.turn(shared, viewer);
            work = planes.work;
            holds(planes.bytes());
            if ended {
                return;
            }
            let busy = self::spent().saturating_sub(spent);
            shared.rest((busy * RESTS).max(PERIOD.saturating_sub(began.elapsed())));
            continue;
        }
        let mut state = shared.lock();
        state.pending.aside = None;
        let ended = state.ended;
        drop(state);
        planes = None;
        holds(0);
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
    first_slice: Option<FirstSlice>,
    changes: Changes,
    /// All bricks and the box of the seen ones, if any brick may have changed.
    all: Option<(Vec<BrickIndex>, Option<Span>)>,
    slices: u64,
    item: u64,
    captured_ns: Option<i64>,
    ended: bool,
}

fn read_state(shared: &Shared) -> VolumeState {
    let mut volume = shared.lock();
    let SharedVolume { inserter, pending, ended, .. } = &mut *volume;
    let changes = pending.aside.replace(Changes::default()).unwrap_or_else(Changes::unknown);
    let all = match (inserter.reconstructor(), pending.first) {
        (Some(reconstructor), Some(first_slice)) if changes.all => {
            let bricks = Shifted::new(reconstructor.volume(), first_slice.lattice.offset).bricks().collect();
            let bounds = reconstructor.volume().seen_bounds().map(|(low, high)| {
                [low, high].map(|voxel| first_slice.lattice.index(voxel).map(|x| x.div_euclid(EDGE as i64)))
            });
            Some((bricks, bounds))
        }
        _ => None,
    };
    let (slices, item, captured_ns) = (pending.inserted, pending.item, pending.captured_ns);
    VolumeState { first_slice: pending.first, changes, all, slices, item, captured_ns, ended: *ended }
}

impl Planes {
    /// Returns the memory of the copied bricks and of the planes, bytes.
    fn bytes(&self) -> u64 {
        let sampled = |plane: &LastPlane| size_of_val(&*plane.sampled) + size_of_val(&*plane.errors);
        let shown: usize = self.shown.values().map(sampled).sum();
        self.subset.bytes() + self.errors.subset.bytes() + shown as u64
    }

    /// Shows the planes that are due; returns whether no slice follows.
    fn turn(&mut self, shared: &Shared, viewer: &dyn PlaneViewer) -> bool {
        let state = read_state(shared);
        let ended = state.ended;
        if let Err(why) = self.update(shared, viewer, state) {
            self.shown.clear();
            self.forget();
            if self.nothing != why {
                viewer.nothing(&why);
                self.nothing = why;
            }
        }
        ended
    }

    /// Applies the state read under the lock, and shows the planes that it changed.
    ///
    /// # Errors
    /// The reason why there is nothing to show.
    fn update(&mut self, shared: &Shared, viewer: &dyn PlaneViewer, state: VolumeState) -> Result<(), String> {
        let is_known =
            self.first_slice.map(|known| known.lattice) == state.first_slice.map(|first_slice| first_slice.lattice);
        self.first_slice = state.first_slice;
        let Some(first_slice) = state.first_slice else {
            return Err("no voxel was seen yet; wait for the first slices".into());
        };
        let VolumeState { mut changes, .. } = state;
        // Bricks are read again with their errors, or without.
        let is_toggled = self.errors.toggle(viewer.shows_errors());
        if is_toggled {
            self.forget();
        }
        match state.all {
            Some((bricks, span)) => {
                self.known = bricks.into_iter().collect();
                self.span = span;
                self.forget();
            }
            // The volume was replaced: all of it is requested.
            None if !is_known => {
                shared.lock().pending.aside = None;
                return Ok(());
            }
            None => {
                changes.bricks.sort_unstable();
                changes.bricks.dedup();
                for brick in &changes.bricks {
                    self.known.insert(*brick);
                    self.subset.remove(*brick);
                    self.errors.subset.remove(*brick);
                    self.span = Some(widened(self.span, brick.map(i64::from)));
                }
            }
        }
        let Some(span) = self.span else { return Err("no voxel was seen yet; wait for the first slices".into()) };
        let extent = extent(&first_slice, span);
        let requested = viewer.requested(&extent);
        let footprints: Vec<PlaneFootprint> =
            requested.iter().map(|plane| PlaneFootprint::new(&plane.section, &extent.place)).collect();
        let moved: Vec<bool> =
            requested.iter().map(|plane| self.is_moved(plane) || changes.all || is_toggled).collect();
        self.shown.retain(|number, _| requested.iter().any(|plane| plane.number == *number));
        if moved.contains(&true) {
            self.subset.keep(&footprints);
            self.errors.subset.keep(&footprints);
        }
        let fresh = self.fresh(&changes, &footprints, &moved);
        if self.subset.len() + fresh.len() > MOST_BRICKS {
            return Err(format!(
                "these planes meet more than {MOST_BRICKS} bricks of the volume; choose a coarser volume.spacing_mm"
            ));
        }
        self.read(shared, &first_slice, &fresh);
        let VolumeReadout { keeps_errors, weighs_shadows, voxel: readout } =
            self.errors.readout(shared, viewer.readout_at(&extent));
        let shows_weak = weighs_shadows && viewer.shows_weakly_seen();
        let weak = if shows_weak { WEAK * self.subset.median_weight() } else { 0.0 };
        self.nothing.clear();
        for ((plane, footprint), moved) in requested.into_iter().zip(footprints).zip(moved) {
            let hit: Vec<_> = match moved {
                true => Vec::new(),
                false => changes
                    .bricks
                    .iter()
                    .filter(|brick| footprint.meets(**brick))
                    .filter_map(|brick| footprint.pixels(*brick))
                    .collect(),
            };
            let is_other = if moved { self.sample(plane, &extent) } else { self.renew(plane, &extent, &hit) };
            if is_other {
                self.work.shown += 1;
                let Some(LastPlane { sampled, errors, .. }) = self.shown.get(&plane.number) else { continue };
                let VolumeState { slices, item, captured_ns, .. } = state;
                viewer.show_plane(&PlaneImage {
                    request: plane,
                    extent,
                    sampled,
                    errors,
                    keeps_errors,
                    weighs_shadows,
                    weak,
                    readout,
                    slices,
                    item,
                    captured_ns,
                    work: self.work,
                });
            }
        }
        Ok(())
    }

    /// Forgets the copied bricks.
    fn forget(&mut self) {
        self.subset.clear();
        self.errors.subset.clear();
    }

    /// Returns whether a plane has moved since it was shown.
    fn is_moved(&self, plane: &PlaneRequest) -> bool {
        self.shown.get(&plane.number).is_none_or(|shown| shown.plane.section != plane.section)
    }

    /// Returns the bricks that are to be read, each once.
    fn fresh(&self, changes: &Changes, footprints: &[PlaneFootprint], moved: &[bool]) -> Vec<BrickIndex> {
        let missing = |brick: &&BrickIndex| {
            !self.subset.has(**brick) && footprints.iter().any(|footprint| footprint.meets(**brick))
        };
        match moved.contains(&true) {
            true => self.known.iter().filter(missing).copied().collect(),
            false => changes.bricks.iter().filter(missing).copied().collect(),
        }
    }

    /// Reads bricks in parts; insertion continues in between. Changes made meanwhile are
    /// reported by the next read.
    fn read(&mut self, shared: &Shared, first_slice: &FirstSlice, bricks: &[BrickIndex]) {
        for part in bricks.chunks(self.errors.part(PART)) {
            let state = shared.lock();
            // The volume was replaced: the next read reports that all has changed.
            let Some(reconstructor) = state.inserter.reconstructor() else { return };
            let volume = Shifted::new(reconstructor.volume(), first_slice.lattice.offset);
            for brick in part {
                self.subset.put(*brick, BrickCopy::of(&volume, *brick));
            }
            self.errors.read(reconstructor, first_slice.lattice.offset, part);
            drop(state);
            self.work.bricks += part.len() as u64;
            // Threads that wait for the volume get it before it is locked again.
            std::thread::sleep(PAUSE);
        }
    }

    /// Samples a plane that has moved; returns whether its image has changed.
    fn sample(&mut self, plane: PlaneRequest, extent: &Extent) -> bool {
        self.work.planes += 1;
        let planar = Planar { volume: &self.subset, place: extent.place, team: None };
        let (sampled, _) = planar.sample(&plane.section);
        let errors = self.errors.sample(&plane.section, extent.place);
        let before = self.shown.insert(plane.number, LastPlane { plane, sampled, errors });
        let now = self.shown.get(&plane.number);
        before.zip(now).is_none_or(|(before, now)| {
            before.plane != plane || before.sampled != now.sampled || before.errors != now.errors
        })
    }

    /// Samples the changed parts of a plane that has not moved; returns whether its image has
    /// changed.
    fn renew(&mut self, plane: PlaneRequest, extent: &Extent, hit: &[[[u32; 2]; 2]]) -> bool {
        let area = |[low, high]: &[[u32; 2]; 2]| u64::from(high[0] - low[0] + 1) * u64::from(high[1] - low[1] + 1);
        if hit.iter().map(area).sum::<u64>() > plane.section.pixels() as u64 {
            return self.sample(plane, extent);
        }
        let Some(shown) = self.shown.get_mut(&plane.number) else { return false };
        let mut is_other = shown.plane.style != plane.style;
        shown.plane = plane;
        self.work.planes += u64::from(!hit.is_empty());
        let planar = Planar { volume: &self.subset, place: extent.place, team: None };
        for pixels in hit {
            is_other |= planar.sample_again(&plane.section, *pixels, &mut shown.sampled);
            is_other |= self.errors.sample_again(&plane.section, extent.place, *pixels, &mut shown.errors);
        }
        is_other
    }
}

fn widened(span: Option<Span>, brick: [i64; 3]) -> Span {
    let [low, high] = span.unwrap_or([brick; 2]);
    [0, 1].map(|end| std::array::from_fn(|a| if end == 0 { low[a].min(brick[a]) } else { high[a].max(brick[a]) }))
}

/// Returns the box around some bricks, rounded to a multiple of [`STEP`].
fn extent(first_slice: &FirstSlice, [low, high]: Span) -> Extent {
    let edge = EDGE as i64;
    let first = low.map(|low| low.div_euclid(STEP) * STEP * edge);
    let last = high.map(|high| (high.div_euclid(STEP) + 1) * STEP * edge - 1);
    let place = Box3::new(first_slice.lattice.world_from_lattice, [first, last]);
    let matrix = place.world_from_lattice.matrix3;
    let voxel_mm = [matrix.x_axis, matrix.y_axis, matrix.z_axis]
        .map(|axis| axis.length())
        .into_iter()
        .fold(f64::INFINITY, f64::min);
    Extent { place, voxel_mm, grey_levels: first_slice.pixels.grey_levels() }
}
