//! The slices that contributed to a place of the volume.

use std::sync::{Mutex, MutexGuard, PoisonError};

use glam::{DAffine3, DVec2, DVec3};
use serde::Serialize;

use pipeline::Observer;
use reconstruct::kernel::AxisKernel;
use sonoweave_core::slice::Slice;

use super::MeasureError;
use super::place::MOST_MM;
use super::positions::{Placed, Positions};

/// Largest number of reported slices of a place, those with the largest weights.
const MOST_LISTED: usize = 64;
/// Distance within which a neighbouring slice counts, in reaches of the kernel.
const BEYOND: f64 = 2.0;
/// Number of successive slices that are skipped together.
const GROUP: usize = 32;

impl Placed {
    /// Returns a ball around the image.
    fn ball(&self) -> Ball {
        let [first, _, last, _] = self.corners();
        let centre = 0.5 * (first + last);
        Ball { centre, radius: self.corners().map(|corner| corner.distance(centre)).into_iter().fold(0.0, f64::max) }
    }

    /// Returns a place's distance from the image's plane, positive in the direction u × v, and its
    /// position in the image; `None` beyond `most_mm` and beside the image.
    fn foot(&self, at: DVec3, most_mm: f64) -> Option<(f64, [f64; 2])> {
        let map = self.world_from_image.affine();
        let (u, v) = (map.matrix3.x_axis, map.matrix3.y_axis);
        let normal = u.cross(v).try_normalize()?;
        let from = at - map.translation;
        let off_mm = from.dot(normal);
        if off_mm.abs() > most_mm {
            return None;
        }
        // Coordinates along u and v, which may differ in length and need not be orthogonal.
        let (uu, uv, vv) = (u.dot(u), u.dot(v), v.dot(v));
        let (fu, fv) = (from.dot(u), from.dot(v));
        let determinant = uu * vv - uv * uv;
        let pixel = [(fu * vv - fv * uv) / determinant, (fv * uu - fu * uv) / determinant];
        let inside = pixel.iter().zip(self.size).all(|(x, n)| (-0.5..=f64::from(n) - 0.5).contains(x));
        inside.then_some((off_mm, pixel))
    }

    /// Returns the corners of the image, in order from its first pixel along u.
    fn corners(&self) -> [DVec3; 4] {
        let map = self.world_from_image.affine();
        let (u, v) = (map.matrix3.x_axis, map.matrix3.y_axis);
        let [right, low] = self.size.map(|n| f64::from(n) - 0.5);
        [[-0.5, -0.5], [right, -0.5], [right, low], [-0.5, low]].map(|[x, y]| map.translation + u * x + v * y)
    }
}

/// A ball that encloses something, mm.
#[derive(Debug, Clone, Copy)]
struct Ball {
    centre: DVec3,
    radius: f64,
}

impl Ball {
    /// Returns a ball around others.
    fn around(balls: impl Iterator<Item = Self> + Clone) -> Self {
        let (sum, count) = balls.clone().fold((DVec3::ZERO, 0), |(sum, n), ball| (sum + ball.centre, n + 1));
        let centre = sum / f64::from(count.max(1));
        Self { centre, radius: balls.map(|ball| ball.centre.distance(centre) + ball.radius).fold(0.0, f64::max) }
    }
}

/// A slice's part in a place.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Contribution {
    /// Number of the slice among those near the places.
    pub(crate) slice: usize,
    /// Its share of the weight, 0 to 1.
    pub(crate) share: f64,
    /// Position of the place in its image, pixels.
    pub(crate) pixel: DVec2,
    /// Position of its image in the world.
    pub(crate) world_from_image: DAffine3,
}

/// The slices that reach a place.
#[derive(Debug, Clone, Default)]
pub(crate) struct Reach {
    /// Those within the kernel, the largest share first.
    pub(crate) contributions: Vec<Contribution>,
    /// Distance between the neighbouring slices on either side, mm; 0 if a side has none within
    /// twice the kernel's reach.
    pub(crate) gap_mm: f64,
}

/// A slice that contributed to a place.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Source {
    /// Its frame number.
    pub frame: u64,
    /// Its acquisition time, s after the first stored slice.
    pub time_s: f64,
    /// Distance of the place from its plane, mm; positive in the direction u × v of the image.
    pub off_mm: f64,
    /// Position of the place in its image, pixels.
    pub pixel: [f64; 2],
    /// Its share of the weight of all slices that reach the place, 0 to 1, by its distance
    /// alone.
    pub share: f64,
    /// Corners of its image in the world, mm, in order.
    pub corners: [[f64; 3]; 4],
}

/// The slices of a place.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Sources {
    /// Slices whose kernel reaches it.
    pub count: usize,
    /// The slices with the largest weights, largest first.
    pub slices: Vec<Source>,
    /// Slices no longer stored, because there were too many.
    pub forgotten: u64,
}

#[derive(Debug, Default)]
struct Log {
    /// The kernel across the plane, if known.
    across: Option<AxisKernel>,
    slices: Positions,
    first_ns: Option<i64>,
}

/// Positions of all slices of a session.
#[derive(Debug, Default)]
pub struct Slices {
    log: Mutex<Log>,
}

impl Slices {
    /// Creates a log for a volume reconstructed with this kernel across the plane.
    pub fn new(across: Option<AxisKernel>) -> Self {
        let slices = Self::default();
        slices.restart(across);
        slices
    }

    /// Restarts the log for a new volume, with this kernel.
    pub fn restart(&self, across: Option<AxisKernel>) {
        *self.log() = Log { across, ..Log::default() };
    }

    /// Returns the corners of the image of a posed frame, world mm, in order.
    pub fn corners(&self, item: u64) -> Option<[DVec3; 4]> {
        let log = self.log();
        let slice = log.slices.iter().rev().find(|slice| slice.item == item)?;
        Some(slice.corners())
    }

    fn log(&self) -> MutexGuard<'_, Log> {
        self.log.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns the memory in use, bytes.
    pub fn bytes(&self) -> u64 {
        self.log().slices.bytes()
    }

    /// Returns the number of stored slices.
    pub fn count(&self) -> usize {
        self.log().slices.len()
    }

    /// Returns the slices that reach each of these places; none if the kernel is unknown.
    pub(crate) fn reaching_each(&self, points: &[DVec3]) -> Vec<Reach> {
        let Some((across, near)) = self.near(points) else { return vec![Reach::default(); points.len()] };
        // Successive slices are close to each other, so most groups are far from a place.
        let groups: Vec<(&[Placed], Ball)> =
            near.chunks(GROUP).map(|group| (group, Ball::around(group.iter().map(Placed::ball)))).collect();
        let most_mm = BEYOND * across.support_mm;
        let reach = |at: &DVec3| {
            let (mut contributions, mut all) = (Vec::new(), 0.0);
            let mut sides = [f64::INFINITY; 2];
            for (number, (group, ball)) in groups.iter().enumerate() {
                if ball.centre.distance(*at) > ball.radius + most_mm {
                    continue;
                }
                for (place, slice) in group.iter().enumerate() {
                    let Some((off_mm, pixel)) = slice.foot(*at, most_mm) else { continue };
                    let side = &mut sides[usize::from(off_mm > 0.0)];
                    *side = side.min(off_mm.abs());
                    let weight = across.weight(off_mm);
                    if off_mm.abs() <= across.support_mm && weight > 0.0 {
                        all += weight;
                        contributions.push(Contribution {
                            slice: number * GROUP + place,
                            share: weight,
                            pixel: DVec2::from_array(pixel),
                            world_from_image: slice.world_from_image.affine(),
                        });
                    }
                }
            }
            contributions.iter_mut().for_each(|one| one.share /= all);
            contributions.sort_by(|a, b| b.share.total_cmp(&a.share).then(a.slice.cmp(&b.slice)));
            let gap_mm = sides[0] + sides[1];
            Reach { contributions, gap_mm: if gap_mm.is_finite() { gap_mm } else { 0.0 } }
        };
        points.iter().map(reach).collect()
    }

    /// Copies the slices that are near any of these places, with the kernel.
    fn near(&self, points: &[DVec3]) -> Option<(AxisKernel, Vec<Placed>)> {
        let places = Ball::around(points.iter().map(|at| Ball { centre: *at, radius: 0.0 }));
        let log = self.log();
        let across = log.across?;
        let is_near = |slice: &&Placed| {
            let ball = slice.ball();
            ball.centre.distance(places.centre) <= ball.radius + places.radius + BEYOND * across.support_mm
        };
        Some((across, log.slices.iter().filter(is_near).copied().collect()))
    }

    /// Returns the slices that reach a place, by their planes and the kernel across them.
    ///
    /// # Errors
    /// [`MeasureError`] for an invalid place, and if the kernel is unknown.
    pub fn of(&self, at: [f64; 3]) -> Result<Sources, MeasureError> {
        let log = self.log();
        let Some(across) = log.across else { return Err(MeasureError::UnknownReach) };
        let at = DVec3::from_array(at);
        if !at.is_finite() {
            return Err(MeasureError::Outside { most_mm: MOST_MM });
        }
        let first_ns = log.first_ns.unwrap_or_default();
        let mut found: Vec<(f64, Source)> = Vec::new();
        for slice in log.slices.iter() {
            let Some(source) = reaching(slice, at, &across, first_ns) else { continue };
            found.push((across.weight(source.off_mm), source));
        }
        let forgotten = log.slices.forgotten();
        drop(log);
        let all: f64 = found.iter().map(|(weight, _)| weight).sum();
        found.sort_by(|(a, one), (b, other)| b.total_cmp(a).then(one.frame.cmp(&other.frame)));
        let count = found.len();
        let listed = found.into_iter().take(MOST_LISTED);
        let slices = listed.map(|(weight, source)| Source { share: weight / all.max(f64::MIN_POSITIVE), ..source });
        Ok(Sources { count, slices: slices.collect(), forgotten })
    }
}

/// Returns the slice if its image lies above or below the place within the kernel's reach.
fn reaching(slice: &Placed, at: DVec3, across: &AxisKernel, first_ns: i64) -> Option<Source> {
    let (off_mm, pixel) = slice.foot(at, across.support_mm)?;
    Some(Source {
        frame: slice.item,
        time_s: (slice.time_ns - first_ns) as f64 * 1e-9,
        off_mm,
        pixel,
        share: 0.0,
        corners: slice.corners().map(|corner| corner.to_array()),
    })
}

impl Observer for Slices {
    fn held_bytes(&self) -> u64 {
        self.bytes()
    }

    fn cleared(&self) {
        let mut log = self.log();
        *log = Log { across: log.across.take(), ..Log::default() };
    }

    fn slice(&self, _world: &str, item: u64, slice: &Slice) {
        let Slice { image, time_ns, world_from_image } = slice;
        let mut log = self.log();
        log.first_ns.get_or_insert(*time_ns);
        let size = [image.width(), image.height()];
        log.slices.push(Placed { item, time_ns: *time_ns, world_from_image: *world_from_image, size });
    }
}
