//! Observed images of a scan, with the sensors' poses.

use super::dots::Dot;
use super::matching::Reading;
use super::track::{Poses, Track};

/// An observed image and its poses.
#[derive(Debug, Clone, PartialEq)]
pub struct Observation<S = Dots> {
    /// Number of the frame.
    pub frame: usize,
    /// Time, s, by the clock of the poses.
    pub time_s: f64,
    /// Its view of the phantom or target.
    pub seen: S,
    /// Poses of the sensors at that time; `None` if the tracker reported them invalid.
    pub poses: Option<Poses>,
}

/// View of a wire phantom.
#[derive(Debug, Clone, PartialEq)]
pub struct Dots {
    /// Spots in the image.
    pub dots: Vec<Dot>,
    /// The recognised wires.
    pub reading: Option<Reading>,
}

/// The images of a recording.
#[derive(Debug)]
pub struct Recording<'a, S = Dots> {
    /// In the order of acquisition.
    pub observations: &'a [Observation<S>],
    /// Poses of the sensors at all times, from the tracker's own samples; `None` if only the
    /// images' poses are known.
    pub track: Option<&'a Track>,
    /// Pixels along u and v.
    pub size_px: [u32; 2],
    /// Whether its times are real times and not frame numbers.
    pub timed: bool,
}

// Derived, both would require them of S.
impl<S> Clone for Recording<'_, S> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<S> Copy for Recording<'_, S> {}

impl<S> Recording<'_, S> {
    /// Returns the poses of the sensors.
    pub(super) fn poses(&self) -> Track {
        let of_pictures = || Track::new(self.observations.iter().filter_map(|observation| observation.poses).collect());
        self.track.cloned().unwrap_or_else(of_pictures)
    }
}
