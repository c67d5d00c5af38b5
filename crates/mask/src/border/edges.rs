//! The place of an edge between border and picture, to a fraction of a pixel.

use super::level::BorderLevel;
use super::plane::{Plane, median};

/// Pixels of an edge that share a measurement.
pub(super) const SEGMENT: usize = 24;
/// Samples of a pixel across the edge.
const STEPS: usize = 2;
/// Farthest place of an edge that still counts as the shape's, pixels.
pub(super) const NEAR: f64 = 1.5;
/// Median of the absolute value of normal noise with a standard deviation of 1.
const MEDIAN: f32 = 0.674;

/// A part of a shape's outline: points, and the unit normals out of the shape.
#[derive(Debug, Clone)]
pub(super) struct Segment {
    /// The edge that it is part of.
    pub(super) edge: usize,
    pub(super) points: Vec<[f64; 2]>,
    pub(super) normals: Vec<[f64; 2]>,
}

/// Result of a measurement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Place {
    /// The segment lies at the frame's border or beyond.
    OffFrame,
    /// There is no plain edge nearby.
    Unseen,
    /// Its distance outwards from the segment, pixels.
    At(f64),
}

/// Measures edges in the mean of the frames.
pub(super) struct EdgeFinder<'a> {
    mean: &'a Plane,
    level: f32,
    /// Median distance from the level in the border, and the distance that is picture.
    quiet: f32,
    loud: f32,
}

impl<'a> EdgeFinder<'a> {
    pub(super) fn new(mean: &'a Plane, border: &BorderLevel) -> Self {
        let quiet = MEDIAN * border.pixel_spread;
        Self { mean, level: border.level, quiet, loud: quiet + (1.3 * border.pixel_spread).max(1.2) }
    }

    /// Returns the place of the edge within `reach` pixels of a segment. Medians along it pass
    /// over ticks and letters.
    pub(super) fn locate(&self, segment: &Segment, reach: usize) -> Place {
        let far = (reach * STEPS) as i64;
        let mut profile = Vec::new();
        let mut line = Vec::with_capacity(segment.points.len());
        // From the outside inwards, three pixels beyond the farthest edge.
        for step in -far..=far + 3 * STEPS as i64 {
            let away = -step as f64 / STEPS as f64;
            line.clear();
            for (point, normal) in segment.points.iter().zip(&segment.normals) {
                let value = self.mean.sample(point[0] + away * normal[0], point[1] + away * normal[1]);
                line.extend(value.map(|value| (value - self.level).abs()));
            }
            // Half of the segment must lie in the frame.
            profile.push((2 * line.len() > segment.points.len()).then(|| median(&mut line)));
        }
        let begin = profile.iter().position(Option::is_some).unwrap_or(profile.len());
        let profile: Vec<f32> = profile[begin..].iter().map_while(|value| *value).collect();
        // Outside of the segment there must be something to see.
        if begin as i64 > far - STEPS as i64 {
            return Place::OffFrame;
        }
        let away = |at: f64| (far as f64 - begin as f64 - at) / STEPS as f64;
        let last = (2 * far) as usize - begin;
        let mut at = 0;
        while let Some(quiet) = profile[at..].iter().position(|value| *value <= self.loud).map(|next| at + next) {
            let Some(loud) = profile[quiet..].iter().position(|value| *value > self.loud).map(|next| quiet + next)
            else {
                return Place::Unseen;
            };
            if loud > last {
                return Place::Unseen;
            }
            let inside = &profile[(loud + STEPS).min(profile.len())..(loud + 4 * STEPS).min(profile.len())];
            let plateau = median(&mut inside.to_vec());
            // A picture that fades out rises slowly here, and its end is not its edge.
            if plateau - self.quiet >= 2.0 * (self.loud - self.quiet) {
                let half = self.quiet + 0.5 * (plateau - self.quiet);
                let Some(above) = profile[loud..].iter().position(|value| *value >= half) else { return Place::Unseen };
                let above = loud + above;
                let [low, high] = [profile[above - 1], profile[above]];
                let part = if high > low { ((half - low) / (high - low)).clamp(0.0, 1.0) } else { 1.0 };
                return Place::At(away(above as f64 - 1.0 + f64::from(part)));
            }
            at = loud;
        }
        Place::Unseen
    }
}

/// Divides a line of points, a pixel apart, into segments of an edge.
pub(super) fn segments(edge: usize, points: &[([f64; 2], [f64; 2])]) -> Vec<Segment> {
    let count = (points.len() / SEGMENT).max(1);
    let part = points.len().div_ceil(count).max(1);
    let segment = |part: &[([f64; 2], [f64; 2])]| Segment {
        edge,
        points: part.iter().map(|sample| sample.0).collect(),
        normals: part.iter().map(|sample| sample.1).collect(),
    };
    points.chunks(part).map(segment).collect()
}
