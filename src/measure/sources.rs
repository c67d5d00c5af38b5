//! The slices that a place of the volume was made of.

use std::collections::VecDeque;
use std::sync::{Mutex, MutexGuard, PoisonError};

use calibration::frames::{Image, Transform, World};
use glam::DVec3;
use serde::Serialize;

use crate::pipeline::live::Witness;
use crate::reconstruct::kernel::AxisKernel;
use crate::slice::Slice;

/// Slices whose places are kept: at 60 a second those of nearly two hours. They take some 60 MB.
const MOST: usize = 400_000;
/// Slices of a place that are told, those that count most.
const TOLD: usize = 64;

/// Where a slice lay.
#[derive(Debug, Clone, Copy)]
struct Placed {
    item: u64,
    time_ns: i64,
    world_from_image: Transform<World, Image>,
    size: [u32; 2],
}

impl Placed {
    /// Around the picture, from its first pixel along u.
    fn corners(&self) -> [DVec3; 4] {
        let map = self.world_from_image.affine();
        let (u, v) = (map.matrix3.x_axis, map.matrix3.y_axis);
        let [right, low] = self.size.map(|n| f64::from(n) - 0.5);
        [[-0.5, -0.5], [right, -0.5], [right, low], [-0.5, low]].map(|[x, y]| map.translation + u * x + v * y)
    }
}

/// A slice that a place was made of.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Source {
    /// Its frame's number.
    pub frame: u64,
    /// When it was seen, s after the first that is kept.
    pub time_s: f64,
    /// How far the place lies off its plane, mm; above 0 where the picture's u × v points.
    pub off_mm: f64,
    /// Where in its picture the place is, pixels.
    pub pixel: [f64; 2],
    /// How much it counts among all that reach the place, 0 to 1, by its distance alone.
    pub share: f64,
    /// Corners of its picture in the world, mm, around it.
    pub corners: [[f64; 3]; 4],
}

/// What a place was made of.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Sources {
    /// Slices whose kernel reaches it.
    pub count: usize,
    /// Of these those that count most, the first the most.
    pub slices: Vec<Source>,
    /// Slices that are no longer known, as there were too many.
    pub forgotten: u64,
}

#[derive(Debug, Default)]
struct Log {
    /// The kernel across the plane, where it is known.
    across: Option<AxisKernel>,
    slices: VecDeque<Placed>,
    forgotten: u64,
    first_ns: Option<i64>,
}

/// Where all slices of a session lie.
#[derive(Debug, Default)]
pub struct Slices {
    log: Mutex<Log>,
}

impl Slices {
    /// Of a volume that is woven with this kernel across the plane.
    pub fn new(across: Option<AxisKernel>) -> Self {
        let slices = Self::default();
        slices.weave(across);
        slices
    }

    /// Of a volume that begins anew, with this kernel.
    pub fn weave(&self, across: Option<AxisKernel>) {
        *self.log() = Log { across, ..Log::default() };
    }

    /// Corners of the picture of a frame that was posed, world mm, around it.
    pub fn corners(&self, item: u64) -> Option<[DVec3; 4]> {
        let log = self.log();
        let slice = log.slices.iter().rev().find(|slice| slice.item == item)?;
        Some(slice.corners())
    }

    fn log(&self) -> MutexGuard<'_, Log> {
        self.log.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Slices that are kept.
    pub fn count(&self) -> usize {
        self.log().slices.len()
    }

    /// The slices that reach a place, by their planes and the kernel across them.
    ///
    /// # Errors
    /// A sentence for no place, and where the kernel is not known.
    pub fn of(&self, at: [f64; 3]) -> Result<Sources, String> {
        let log = self.log();
        let Some(across) = log.across else {
            return Err("how far slices reach is not known: the calibration says nothing of the pixels' size".into());
        };
        let at = DVec3::from_array(at);
        if !at.is_finite() {
            return Err("a place is three finite numbers of mm".into());
        }
        let first_ns = log.first_ns.unwrap_or_default();
        let mut found: Vec<(f64, Source)> = Vec::new();
        for slice in &log.slices {
            let Some(source) = reaching(slice, at, &across, first_ns) else { continue };
            found.push((across.weight(source.off_mm), source));
        }
        let forgotten = log.forgotten;
        drop(log);
        let all: f64 = found.iter().map(|(weight, _)| weight).sum();
        found.sort_by(|(a, one), (b, other)| b.total_cmp(a).then(one.frame.cmp(&other.frame)));
        let count = found.len();
        let told = found.into_iter().take(TOLD);
        let slices = told.map(|(weight, source)| Source { share: weight / all.max(f64::MIN_POSITIVE), ..source });
        Ok(Sources { count, slices: slices.collect(), forgotten })
    }
}

/// The slice, if its picture is above or below the place no further than the kernel reaches.
fn reaching(slice: &Placed, at: DVec3, across: &AxisKernel, first_ns: i64) -> Option<Source> {
    let map = slice.world_from_image.affine();
    let (u, v) = (map.matrix3.x_axis, map.matrix3.y_axis);
    let normal = u.cross(v).try_normalize()?;
    let from = at - map.translation;
    let off_mm = from.dot(normal);
    if off_mm.abs() > across.support_mm {
        return None;
    }
    // Coordinates along u and v, which need be neither of one length nor at right angles.
    let (uu, uv, vv) = (u.dot(u), u.dot(v), v.dot(v));
    let (fu, fv) = (from.dot(u), from.dot(v));
    let determinant = uu * vv - uv * uv;
    let pixel = [(fu * vv - fv * uv) / determinant, (fv * uu - fu * uv) / determinant];
    let inside = pixel.iter().zip(slice.size).all(|(x, n)| (-0.5..=f64::from(n) - 0.5).contains(x));
    inside.then(|| Source {
        frame: slice.item,
        time_s: (slice.time_ns - first_ns) as f64 * 1e-9,
        off_mm,
        pixel,
        share: 0.0,
        corners: slice.corners().map(|corner| corner.to_array()),
    })
}

impl Witness for Slices {
    fn cleared(&self) {
        let mut log = self.log();
        *log = Log { across: log.across.take(), ..Log::default() };
    }

    fn slice(&self, _world: &str, item: u64, slice: &Slice) {
        let Slice { image, time_ns, world_from_image } = slice;
        let mut log = self.log();
        log.first_ns.get_or_insert(*time_ns);
        if log.slices.len() >= MOST {
            log.slices.pop_front();
            log.forgotten += 1;
        }
        let size = [image.width(), image.height()];
        log.slices.push_back(Placed { item, time_ns: *time_ns, world_from_image: *world_from_image, size });
    }
}
