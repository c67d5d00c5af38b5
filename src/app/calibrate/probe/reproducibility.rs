//! Reproducibility: the change of a result when parts of its recording are left out.

use glam::DVec2;
use serde::Serialize;

use calibration::probe::plane::ImagePlane;

/// Parts of a recording that are left out in turn.
const PARTS: usize = 5;

/// Distances of pixel positions between calibrations from parts of a recording.
#[derive(Debug, Clone, Copy, Serialize)]
pub(crate) struct Reproducibility {
    /// Calibrations, each with another part left out.
    subsets: usize,
    /// Largest distance of the image's centre from that of the whole recording's calibration.
    centre: f64,
    /// The same of the corners.
    corner: f64,
}

impl Reproducibility {
    /// Formats the numbers for people.
    pub(crate) fn words(&self) -> String {
        let Self { subsets, centre, corner } = self;
        format!(
            "Reproducibility: in {subsets} calibrations, each without another part of the frames, the image's centre moves by at most {centre:.2} mm, its corners by {corner:.2} mm."
        )
    }
}

/// Calibrates with each part of the observations left out in turn. Shows how far the result
/// depends on the choice of images. Returns `None` if every part leaves too few.
pub(crate) fn reproducibility<O: Clone>(
    all: &[O],
    size_px: [u32; 2],
    found: &ImagePlane,
    calibrated: impl Fn(&[O]) -> Option<ImagePlane>,
) -> Option<Reproducibility> {
    let [u, v] = size_px.map(|n| f64::from(n) - 1.0);
    let places = [[0.5 * u, 0.5 * v], [0.0, 0.0], [u, 0.0], [0.0, v], [u, v]].map(DVec2::from_array);
    let mut moved = Vec::new();
    for part in 0..PARTS {
        let [from, to] = [part, part + 1].map(|n| n * all.len() / PARTS);
        let kept: Vec<O> = [&all[..from], &all[to..]].concat();
        let Some(other) = calibrated(&kept) else { continue };
        moved.push(places.map(|px| other.point(px).distance(found.point(px))));
    }
    let most = |all: &mut dyn Iterator<Item = f64>| all.fold(0.0, f64::max);
    (moved.len() > 1).then(|| Reproducibility {
        subsets: moved.len(),
        centre: most(&mut moved.iter().map(|of| of[0])),
        corner: most(&mut moved.iter().flat_map(|of| of[1..].iter().copied())),
    })
}
