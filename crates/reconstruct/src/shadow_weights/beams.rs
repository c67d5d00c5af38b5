//! The beams of a picture: places of their samples among the pixels, and of nodes among the beams.

use std::ops::Range;

use mask::Mask;

use super::{BEAMS, ShadowWeights};
use crate::nodes::Nodes;

/// Samples in a tail: at the usual length, a millimetre apart. Speckle is hardly finer, so that
/// more would repeat the same grey levels.
const SAMPLES: f64 = 50.0;
/// Part of the tail that the last pixels of a beam have at least.
const LEAST_PART: usize = 4;

/// Beams of a picture, sampled at equal distances. Samples are arranged beam by beam, from the
/// transducer on.
#[derive(Clone)]
pub(super) struct Beams {
    pub(super) count: usize,
    /// Samples along each.
    pub(super) depths: usize,
    /// The pixel of each sample; `None` outside of the data.
    pub(super) pixels: Vec<Option<u32>>,
    /// Samples in a tail, and in the shortest one, at a beam's end.
    windows: Vec<[usize; 2]>,
    /// Sample after the last on data, of a beam or those beside it.
    ends: Vec<usize>,
    /// Beams beside a beam that count for it, on either side.
    beside: usize,
    /// 1/number of samples in each sample's tail; 0 without any.
    pub(super) shares: Vec<f32>,
    /// Place of each node: the sample at or before it on the beam at or before it. Then the parts
    /// of the way to the next beam, and to the next sample.
    pub(super) places: Vec<(u32, [f32; 2])>,
}

/// Lines along which the beams run.
#[derive(Clone, Copy)]
enum Lines {
    /// From a column on, of this width in all; from a row on.
    Columns { left: f64, width: f64, top: f64 },
    /// From a point; radians from down, the first and the range; from a radius on.
    Rays { apex: [f64; 2], first: f64, range: f64, radius: f64 },
}

impl Lines {
    /// Returns the lines of a mask, and their length in pixels.
    fn of(mask: &Mask) -> Option<(Self, f64)> {
        let bounds = mask.bounds()?;
        let Some(apex) = mask.apex_px() else {
            let lines =
                Self::Columns { left: f64::from(bounds.x), width: f64::from(bounds.width), top: f64::from(bounds.y) };
            return Some((lines, f64::from(bounds.height)));
        };
        let (mut angles, mut radii) = ([f64::INFINITY, f64::NEG_INFINITY], [f64::INFINITY, f64::NEG_INFINITY]);
        for v in 0..mask.height() {
            for span in mask.row(v) {
                let [left, right] = [span.start, span.end - 1].map(f64::from);
                // Angles are extreme at a span's ends, and the radius at the apex's column.
                for u in [left, right, apex[0].clamp(left, right)] {
                    let [x, y] = [u - apex[0], f64::from(v) - apex[1]];
                    let (angle, radius) = (libm::atan2(x, y), libm::hypot(x, y));
                    angles = [angles[0].min(angle), angles[1].max(angle)];
                    radii = [radii[0].min(radius), radii[1].max(radius)];
                }
            }
        }
        // A mask of one pixel has no range.
        let range = (angles[1] - angles[0]).max(1e-6);
        Some((Self::Rays { apex, first: angles[0], range, radius: radii[0] }, radii[1] - radii[0] + 1.0))
    }

    /// Returns the direction of a beam, counted from 0.
    fn direction(self, beam: f64, count: f64) -> [f64; 2] {
        match self {
            Self::Columns { .. } => [0.0, 1.0],
            Self::Rays { first, range, .. } => {
                let angle = first + (beam + 0.5) / count * range;
                [libm::sin(angle), libm::cos(angle)]
            }
        }
    }

    /// Returns the point on a beam, pixels, at a distance from its beginning.
    fn point(self, beam: f64, count: f64, distance: f64) -> [f64; 2] {
        match self {
            Self::Columns { left, width, top } => [left - 0.5 + (beam + 0.5) / count * width, top + distance],
            Self::Rays { apex, radius, .. } => {
                let direction = self.direction(beam, count);
                [0, 1].map(|a| apex[a] + direction[a] * (radius + distance))
            }
        }
    }

    /// Returns the beam through a point, and its distance from the beam's beginning.
    fn at(self, [u, v]: [f64; 2], count: f64) -> [f64; 2] {
        match self {
            Self::Columns { left, width, top } => [(u - left + 0.5) / width * count - 0.5, v - top],
            Self::Rays { apex, first, range, radius } => {
                let [x, y] = [u - apex[0], v - apex[1]];
                [(libm::atan2(x, y) - first) / range * count - 0.5, libm::hypot(x, y) - radius]
            }
        }
    }
}

impl Beams {
    /// Returns the beams of a mask with data, and the places of nodes that lie `step_px` apart.
    pub(super) fn new(
        settings: &ShadowWeights,
        mask: &Mask,
        pixel_mm: [f64; 2],
        nodes: &Nodes,
        step_px: [f64; 2],
    ) -> Option<Self> {
        let (lines, length) = Lines::of(mask)?;
        let count = BEAMS.min(mask.bounds()?.width as usize);
        let beams = count as f64;
        let step = (settings.tail_mm / SAMPLES / pixel_mm[1]).max(1.0);
        let depths = (length / step).ceil().max(1.0) as usize;
        let sample = |at: usize| -> Option<u32> {
            let distance = ((at % depths) as f64 + 0.5) * step - 0.5;
            let [u, v] = lines.point((at / depths) as f64, beams, distance).map(f64::round);
            let inside = u >= 0.0 && v >= 0.0 && mask.contains(u as u32, v as u32);
            inside.then(|| v as u32 * mask.width() + u as u32)
        };
        let pixels: Vec<Option<u32>> = (0..count * depths).map(sample).collect();
        let window = |beam: usize| {
            let [u, v] = lines.direction(beam as f64, beams);
            let step_mm = step * libm::hypot(u * pixel_mm[0], v * pixel_mm[1]);
            let samples = (settings.tail_mm / step_mm).round().max(1.0) as usize;
            [samples, (samples / LEAST_PART).max(1)]
        };
        let mut made = Self {
            count,
            depths,
            windows: (0..count).map(window).collect(),
            ends: Vec::new(),
            beside: settings.beams as usize / 2,
            shares: Vec::new(),
            places: Vec::new(),
            pixels,
        };
        let end = |beam: usize| {
            let ends = made.beside(beam).map(|beam| made.of(beam).rposition(|pixel| pixel.is_some()));
            ends.flatten().max().map_or(0, |last| last + 1)
        };
        made.ends = (0..count).map(end).collect();
        let share = |at: usize| {
            let (beam, tail) = (at / depths, made.tail(at / depths, at % depths));
            let samples = made.beside(beam).map(|beam| made.of(beam).skip(tail.start).take(tail.len()));
            let samples = samples.flatten().filter(|pixel| pixel.is_some()).count();
            if samples > 0 { 1.0 / samples as f32 } else { 0.0 }
        };
        made.shares = (0..count * depths).map(share).collect();
        let place = |node: usize| {
            let [column, row] = [node % nodes.stride, node / nodes.stride];
            let node = [nodes.first[0] + column as i64, nodes.first[1] + row as i64];
            let [beam, distance] = lines.at([0, 1].map(|a| node[a] as f64 * step_px[a]), beams);
            let [beam, depth] = [(beam, count), ((distance + 0.5) / step - 0.5, depths)]
                .map(|(at, number)| at.clamp(0.0, (number - 1) as f64));
            ((beam as usize * depths + depth as usize) as u32, [beam, depth].map(|at| at.fract() as f32))
        };
        made.places = (0..nodes.rows * nodes.stride).map(place).collect();
        Some(made)
    }

    /// Returns the beams that count for a beam.
    pub(super) fn beside(&self, beam: usize) -> Range<usize> {
        beam.saturating_sub(self.beside)..(beam + self.beside + 1).min(self.count)
    }

    /// Returns the samples of a beam that are a sample's tail.
    pub(super) fn tail(&self, beam: usize, depth: usize) -> Range<usize> {
        let ([samples, least], end) = (self.windows[beam], self.ends[beam]);
        let first = depth.min(end.saturating_sub(least));
        first..(first + samples).min(end).max(first)
    }

    fn of(&self, beam: usize) -> impl DoubleEndedIterator<Item = &Option<u32>> + ExactSizeIterator {
        self.pixels[beam * self.depths..(beam + 1) * self.depths].iter()
    }
}
