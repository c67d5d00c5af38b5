//! Appearance of the target in images.

use glam::{DAffine3, DVec2};

use crate::latency::line::Line;
use crate::probe::recording::{Observation, Recording};
use crate::probe::track::Track;

/// The visible part of the target.
#[derive(Debug, Clone, Default, PartialEq)]
pub enum Seen {
    /// Nothing.
    #[default]
    Nothing,
    /// Candidate spots for the point, pixels; the most prominent first.
    Dots(Vec<DVec2>),
    /// Two points of the plane's line whose errors are independent, pixels.
    Line([DVec2; 2]),
}

impl Seen {
    /// Converts a line found in a part of the image that begins at `from_px`. The two points
    /// lie on either side of the line's middle, at its length over √12. Their errors are
    /// independent if the line was fitted through equally accurate columns.
    pub fn line(line: &Line, from_px: DVec2) -> Self {
        let aside = (line.columns[1] - line.columns[0]) / 12.0_f64.sqrt();
        let along = line.direction * (aside / line.direction.x);
        Self::Line([-1.0, 1.0].map(|side| from_px + line.point_px + along * side))
    }
}

/// An image that shows something and has poses.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Detection {
    pub(super) frame: usize,
    pub(super) time_s: f64,
    /// Candidate spots for the point; empty for a plane.
    pub(super) candidates: Vec<DVec2>,
    /// Pixels on the target: the point's dot, or two of the line's.
    pub(super) marks: Vec<DVec2>,
}

impl Detection {
    /// Returns the map from the probe to the reference, for poses that lag images by `lag_s`.
    pub(super) fn reference_from_probe(&self, track: &Track, lag_s: f64) -> Option<DAffine3> {
        Some(track.at(self.time_s + lag_s)?.reference_from_probe().affine())
    }

    /// Selects the candidate with the smallest distance; does nothing for a plane.
    pub(super) fn choose(&mut self, off: impl Fn(DVec2) -> f64) {
        if let Some(nearest) = self.candidates.iter().min_by(|a, b| off(**a).total_cmp(&off(**b))) {
            self.marks = vec![*nearest];
        }
    }
}

impl Recording<'_, Seen> {
    /// Returns the images that show the target, with poses. Lines are ignored for a point, and
    /// dots for a plane.
    pub(super) fn detections(&self, is_plane: bool) -> Vec<Detection> {
        let detection = |observation: &Observation<Seen>| {
            observation.poses?;
            let (candidates, marks) = match &observation.seen {
                Seen::Dots(dots) if !is_plane => (dots.clone(), vec![*dots.first()?]),
                Seen::Line(points) if is_plane => (Vec::new(), points.to_vec()),
                _ => return None,
            };
            Some(Detection { frame: observation.frame, time_s: observation.time_s, candidates, marks })
        };
        self.observations.iter().filter_map(detection).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn line_points_lie_about_its_middle() {
        let direction = DVec2::new(3.0, 1.0).normalize();
        let line = Line { point_px: DVec2::new(60.0, 40.0), direction, columns: [0.0, 120.0], scatter_px: 0.3 };
        let Seen::Line([a, b]) = Seen::line(&line, DVec2::new(100.0, 7.0)) else { panic!("no line") };
        assert!((0.5 * (a + b)).distance(DVec2::new(160.0, 47.0)) < 1e-12);
        let apart = b - a;
        assert!((apart.x - 120.0 / 3.0_f64.sqrt()).abs() < 1e-12 && (apart.y - apart.x / 3.0).abs() < 1e-12);
    }
}
