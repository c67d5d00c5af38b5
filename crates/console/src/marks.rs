//! Marks in the picture of the volume: the present slice, and the regions that the scan has
//! missed.

use glam::DVec3;
use serde_json::{Value, json};

use guidance::outlines::{Outlines, PlaneRect};
use render::section::Section;

use super::encoded_frame::Kind;
use super::orbit_camera::OrbitCamera;

/// Corners in a picture, in pixels from its upper left corner.
type Corners = [[f64; 2]; 4];

/// The marks of one picture.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Marks {
    /// Sequence number of the picture.
    sequence: u32,
    size: [u32; 2],
    present: Option<Corners>,
    holes: Vec<Corners>,
    planes: Vec<InPlane>,
}

/// Ends in a plane image, in pixels from the centre of its first pixel.
type Segment = [[f64; 2]; 2];

/// Intersections of a displayed plane with the present slice and the holes.
#[derive(Debug, Clone, PartialEq)]
struct InPlane {
    kind: Kind,
    present: Option<Segment>,
    holes: Vec<Segment>,
}

impl InPlane {
    fn of(outlines: &Outlines, (kind, section): &(Kind, Section)) -> Self {
        let mm = section.mm_per_px();
        let [right, down] = [section.right / mm, section.down / mm];
        let size = section.size.map(|pixels| f64::from(pixels) * mm);
        let plane = PlaneRect { origin: section.first - (section.right + section.down) / 2.0, right, down, size };
        let pixels = |segment: Segment| segment.map(|end| end.map(|at| tenths(at / mm - 0.5)));
        let present = outlines.present_in(&plane).map(pixels);
        Self { kind: *kind, present, holes: outlines.in_plane(&plane).into_iter().map(pixels).collect() }
    }

    fn to_json(&self) -> Value {
        json!({ "kind": self.kind as u8, "present": self.present, "holes": self.holes })
    }
}

/// Rounds to tenths of a pixel; finer differences are invisible.
fn tenths(pixels: f64) -> f64 {
    (10.0 * pixels).round() / 10.0
}

impl Marks {
    /// Projects the outlines into the last picture, which has this number, and into the planes.
    /// `None` before the first picture.
    pub(super) fn of(
        outlines: &Outlines,
        camera: &OrbitCamera,
        sequence: u32,
        planes: &[(Kind, Section)],
    ) -> Option<Self> {
        let size = camera.size()?;
        let corners = |quad: [DVec3; 4]| -> Option<Corners> {
            let mut corners = [[0.0; 2]; 4];
            for (corner, at) in corners.iter_mut().zip(quad) {
                // Pixel coordinates refer to pixel centres.
                *corner = camera.project(at)?.map(|place| tenths(place + 0.5));
            }
            Some(corners)
        };
        let present = outlines.present.and_then(corners);
        let holes = outlines.quads().filter_map(corners).collect();
        let planes = planes.iter().map(|plane| InPlane::of(outlines, plane)).collect();
        Some(Self { sequence, size, present, holes, planes })
    }

    /// Whether the marks differ visibly. The picture's number alone does not count.
    pub(super) fn differ(&self, other: &Self) -> bool {
        (self.size, self.present, &self.holes, &self.planes) != (other.size, other.present, &other.holes, &other.planes)
    }

    /// The marks as JSON, for pages.
    pub(super) fn to_json(&self) -> Value {
        let Self { sequence, size, present, holes, planes } = self;
        let planes: Vec<Value> = planes.iter().map(InPlane::to_json).collect();
        json!({ "marks": { "sequence": sequence, "size": size, "present": present, "holes": holes, "planes": planes } })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn plane_marks_slice_and_hole_intersections() {
        let quad = |z: f64| [[0.0, 0.0], [10.0, 0.0], [10.0, 8.0], [0.0, 8.0]].map(|[x, y]| DVec3::new(x, y, z));
        let outlines = Outlines { present: Some(quad(5.0)), holes: vec![[quad(6.0), quad(9.0)]] };
        // A section across y with pixels of 0.5 mm.
        let section =
            Section { first: DVec3::new(0.0, 4.0, 0.0), right: DVec3::X / 2.0, down: DVec3::Z / 2.0, size: [40; 2] };
        let marked = InPlane::of(&outlines, &(Kind::AcrossY, section));
        let mut ends = marked.present.unwrap();
        ends.sort_by(|a, b| a[0].total_cmp(&b[0]));
        assert_eq!(ends, [[0.0, 10.0], [20.0, 10.0]]);
        let corners = |at: f64| marked.holes.iter().flatten().filter(|end| end[1] == at).count();
        assert_eq!(
            (marked.holes.len(), corners(12.0), corners(18.0)),
            (4, 4, 4),
            "around the hole: {:?}",
            marked.holes
        );
        let beside = Section { first: DVec3::new(0.0, 40.0, 0.0), ..section };
        let none = InPlane::of(&outlines, &(Kind::AcrossY, beside));
        assert!(none.present.is_none() && none.holes.is_empty());
        assert_eq!(none.to_json(), json!({ "kind": Kind::AcrossY as u8, "present": null, "holes": [] }));
    }
}
