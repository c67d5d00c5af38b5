//! What pictures show of the target.

use glam::{DAffine3, DVec2};

use crate::latency::line::Line;
use crate::probe::track::{Poses, Track};

/// What is seen of the target.
#[derive(Debug, Clone, Default, PartialEq)]
pub enum Seen {
    /// Nothing.
    #[default]
    Nothing,
    /// Spots of which one may be the point, pixels; the one that stands out most first.
    Dots(Vec<DVec2>),
    /// Two points of the plane's line whose errors are independent, pixels.
    Line([DVec2; 2]),
}

impl Seen {
    /// A line in a part of the picture that begins at a pixel. Of a line through equally good columns the errors of two points are independent that lie on either side of its middle by its
    /// length over √12.
    pub fn line(line: &Line, from_px: DVec2) -> Self {
        let aside = (line.columns[1] - line.columns[0]) / 12.0_f64.sqrt();
        let along = line.direction * (aside / line.direction.x);
        Self::Line([-1.0, 1.0].map(|side| from_px + line.point_px + along * side))
    }
}

/// A picture and its poses, as observed.
#[derive(Debug, Clone, PartialEq)]
pub struct Observation {
    /// Which picture.
    pub frame: usize,
    /// When, s, by the clock of the poses.
    pub time_s: f64,
    /// What it shows.
    pub seen: Seen,
    /// Where the sensors were; `None` where the tracker did not vouch for them.
    pub poses: Option<Poses>,
}

/// What a recording's pictures are.
#[derive(Debug, Clone, Copy)]
pub struct Recording<'a> {
    /// In the order in which they were taken.
    pub observations: &'a [Observation],
    /// Where the sensors were at all times, by the tracker's own samples; `None` where no more is known than the pictures' poses.
    pub track: Option<&'a Track>,
    /// Pixels along u and v.
    pub size_px: [u32; 2],
    /// Whether its times are times, not numbers that stand for them.
    pub timed: bool,
}

/// A picture that shows something, and has poses.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Glimpse {
    pub(super) frame: usize,
    pub(super) time_s: f64,
    /// Spots of which one may be the point; empty of a plane.
    pub(super) candidates: Vec<DVec2>,
    /// Pixels that are on the target: the point's dot, or two of the line's.
    pub(super) marks: Vec<DVec2>,
}

impl Glimpse {
    /// From the probe to the reference, by poses that come so much later than pictures.
    pub(super) fn reference_from_probe(&self, track: &Track, lag_s: f64) -> Option<DAffine3> {
        Some(track.at(self.time_s + lag_s)?.reference_from_probe().affine())
    }

    /// Takes the candidate for the point that is nearest by some measure. Changes nothing of a plane's.
    pub(super) fn choose(&mut self, off: impl Fn(DVec2) -> f64) {
        if let Some(nearest) = self.candidates.iter().min_by(|a, b| off(**a).total_cmp(&off(**b))) {
            self.marks = vec![*nearest];
        }
    }
}

impl Recording<'_> {
    /// The pictures that show the target, with poses; a line says nothing of a point, nor a dot of a plane.
    pub(super) fn glimpses(&self, is_plane: bool) -> Vec<Glimpse> {
        let glimpse = |observation: &Observation| {
            observation.poses?;
            let (candidates, marks) = match &observation.seen {
                Seen::Dots(dots) if !is_plane => (dots.clone(), vec![*dots.first()?]),
                Seen::Line(points) if is_plane => (Vec::new(), points.to_vec()),
                _ => return None,
            };
            Some(Glimpse { frame: observation.frame, time_s: observation.time_s, candidates, marks })
        };
        self.observations.iter().filter_map(glimpse).collect()
    }

    /// Where the sensors were.
    pub(super) fn poses(&self) -> Track {
        let of_pictures = || Track::new(self.observations.iter().filter_map(|observation| observation.poses).collect());
        self.track.cloned().unwrap_or_else(of_pictures)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_s_points_lie_on_it_about_its_middle() {
        let direction = DVec2::new(3.0, 1.0).normalize();
        let line = Line { point_px: DVec2::new(60.0, 40.0), direction, columns: [0.0, 120.0], scatter_px: 0.3 };
        let Seen::Line([a, b]) = Seen::line(&line, DVec2::new(100.0, 7.0)) else { panic!("no line") };
        assert!((0.5 * (a + b)).distance(DVec2::new(160.0, 47.0)) < 1e-12);
        let apart = b - a;
        assert!((apart.x - 120.0 / 3.0_f64.sqrt()).abs() < 1e-12 && (apart.y - apart.x / 3.0).abs() < 1e-12);
    }
}
