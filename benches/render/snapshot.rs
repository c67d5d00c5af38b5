//! A volume of bytes for two renderers: unseen voxels are 0, seen ones at least 1. A second
//! version has a few planes changed.

use render::RenderRegion;
use volume::brick::{BrickIndex, EDGE};
use volume::{Values, Voxels};

/// Number of changed planes: as many as VTK was given.
pub(crate) const PLANES: i64 = 4;

/// Voxels of the box of a render region, x fastest.
#[derive(Clone)]
pub(crate) struct Snapshot {
    low: [i64; 3],
    size: [usize; 3],
    bytes: Vec<u8>,
}

impl Snapshot {
    /// Copies a volume's values, rounded.
    pub(crate) fn new(volume: &dyn Voxels, region: &RenderRegion) -> Self {
        let [low, high] = region.bounds();
        let size: [usize; 3] = std::array::from_fn(|a| (high[a] - low[a] + 1) as usize);
        let mut bytes = vec![0; size.iter().product()];
        let (mut value, mut weight) = (vec![0.0; size[0]], vec![0.0; size[0]]);
        for (line, row) in bytes.chunks_exact_mut(size[0]).enumerate() {
            let start = [low[0], low[1] + (line % size[1]) as i64, low[2] + (line / size[1]) as i64];
            volume.values(start, &mut value, &mut weight);
            for (byte, (value, weight)) in row.iter_mut().zip(value.iter().zip(&weight)) {
                *byte = if *weight > 0.0 { value.round_ties_even().clamp(1.0, 255.0) as u8 } else { 0 };
            }
        }
        Self { low, size, bytes }
    }

    pub(crate) fn size(&self) -> [usize; 3] {
        self.size
    }

    pub(crate) fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    fn first_plane(&self, axis: usize) -> i64 {
        self.size[axis] as i64 / 2
    }

    /// Returns a copy in which the content of [`PLANES`] planes in the middle of an axis is
    /// shifted by a few voxels within them.
    pub(crate) fn with_planes_changed(&self, axis: usize) -> Self {
        const MOVED: usize = 3;
        let mut changed = self.clone();
        let across = (axis + 1) % 3;
        let planes = self.first_plane(axis) as usize..(self.first_plane(axis) + PLANES) as usize;
        for at in 0..self.bytes.len() {
            let mut place = [at % self.size[0], at / self.size[0] % self.size[1], at / (self.size[0] * self.size[1])];
            if planes.contains(&place[axis]) {
                place[across] = (place[across] + MOVED) % self.size[across];
                changed.bytes[at] = self.bytes[(place[2] * self.size[1] + place[1]) * self.size[0] + place[0]];
            }
        }
        changed
    }

    /// Returns the bricks that contain those planes.
    pub(crate) fn bricks_of_planes(&self, axis: usize) -> Vec<BrickIndex> {
        let first = self.low[axis] + self.first_plane(axis);
        let span = first.div_euclid(EDGE as i64)..=(first + PLANES - 1).div_euclid(EDGE as i64);
        self.bricks().filter(|brick| span.contains(&i64::from(brick[axis]))).collect()
    }
}

impl Values for Snapshot {
    fn values(&self, start: [i64; 3], value: &mut [f32], weight: &mut [f32]) {
        let [x0, y, z]: [i64; 3] = std::array::from_fn(|a| start[a] - self.low[a]);
        let inside = (0..self.size[1] as i64).contains(&y) && (0..self.size[2] as i64).contains(&z);
        let row = if inside {
            &self.bytes[(z as usize * self.size[1] + y as usize) * self.size[0]..][..self.size[0]]
        } else {
            &[]
        };
        for (x, (value, weight)) in (x0..).zip(value.iter_mut().zip(weight)) {
            let byte = usize::try_from(x).ok().and_then(|x| row.get(x)).copied().unwrap_or(0);
            (*value, *weight) = (f32::from(byte), f32::from(byte.min(1)));
        }
    }

    fn bricks(&self) -> Box<dyn Iterator<Item = BrickIndex> + '_> {
        let edge = EDGE as i64;
        let span = |a: usize| {
            let (low, high) = (self.low[a], self.low[a] + self.size[a] as i64 - 1);
            low.div_euclid(edge) as i32..=high.div_euclid(edge) as i32
        };
        let (x, y, z) = (span(0), span(1), span(2));
        Box::new(z.flat_map(move |z| {
            let x = x.clone();
            y.clone().flat_map(move |y| x.clone().map(move |x| [x, y, z]))
        }))
    }
}
