//! Geometry of a phantom: its wires and landmarks, and checks of their numbers.

use glam::DVec3;

use crate::error::{CalibrationError, GeometryError};

use super::find_nwires::Nwire;
use super::wire::Wire;

/// Shortest plausible wire, mm; a shorter one is an error in the numbers.
const SHORTEST_WIRE_MM: f64 = 1.0;
/// Range of the longest side of the box around all wires and landmarks, mm: from less than an
/// image shows to more than a tank. Beyond it the numbers are in other units.
const SIZE_MM: [f64; 2] = [8.0, 1000.0];

/// A point to be touched with a stylus.
#[derive(Debug, Clone, PartialEq)]
pub struct Landmark {
    /// Its name, unique in the phantom.
    pub name: String,
    /// Its position, mm.
    pub position_mm: DVec3,
}

/// The wires and landmarks of a phantom; at least one of either.
#[derive(Debug, Clone, PartialEq)]
pub struct Geometry {
    name: String,
    wires: Vec<Wire>,
    /// Index in `wires` where each pattern begins.
    starts: Vec<usize>,
    landmarks: Vec<Landmark>,
}

impl Geometry {
    /// Builds a phantom of patterns and landmarks. A pattern is a group of wires, such as the
    /// three of an N. Patterns go from top to bottom in the image, the wires of each from right
    /// to left; see [`Self::wires`].
    ///
    /// # Errors
    /// [`GeometryError`]: an empty phantom, a duplicate name, a number that is not finite, a wire
    /// without length, or an implausible size.
    pub fn new(
        name: impl Into<String>,
        patterns: Vec<Vec<Wire>>,
        landmarks: Vec<Landmark>,
    ) -> Result<Self, CalibrationError> {
        let starts = patterns.iter().scan(0, |at, pattern| Some(std::mem::replace(at, *at + pattern.len()))).collect();
        let geometry = Self { name: name.into(), wires: patterns.into_iter().flatten().collect(), starts, landmarks };
        geometry.check()?;
        Ok(geometry)
    }

    fn check(&self) -> Result<(), GeometryError> {
        let mut names: Vec<_> = self.wires.iter().map(|wire| ("wires", &wire.name)).collect();
        names.extend(self.landmarks.iter().map(|landmark| ("landmarks", &landmark.name)));
        names.sort_unstable();
        if let Some(two) = names.windows(2).find(|two| two[0] == two[1]) {
            return Err(GeometryError::Twice { what: two[0].0, name: two[0].1.clone() });
        }
        for wire in &self.wires {
            if wire.ends_mm.iter().any(|end| !end.is_finite()) {
                return Err(GeometryError::NotFinite { name: wire.name.clone() });
            }
            if wire.length_mm() < SHORTEST_WIRE_MM {
                return Err(GeometryError::Short { name: wire.name.clone(), mm: wire.length_mm() });
            }
        }
        if let Some(landmark) = self.landmarks.iter().find(|landmark| !landmark.position_mm.is_finite()) {
            return Err(GeometryError::NotFinite { name: landmark.name.clone() });
        }
        let points = self.wires.iter().flat_map(|wire| wire.ends_mm);
        let points = points.chain(self.landmarks.iter().map(|landmark| landmark.position_mm));
        let mut bounds = None;
        for point in points {
            let (low, high) = bounds.unwrap_or((point, point));
            bounds = Some((point.min(low), point.max(high)));
        }
        let (low, high) = bounds.ok_or(GeometryError::Empty)?;
        let size = (high - low).max_element();
        if !(SIZE_MM[0]..=SIZE_MM[1]).contains(&size) {
            return Err(GeometryError::Size { mm: size });
        }
        Ok(())
    }

    /// Returns its name; may be empty.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Returns all wires, pattern by pattern. The rest of the crate refers to wires by their
    /// index in this list.
    ///
    /// Their order tells the direction of scanning. The image is in MF orientation, with the
    /// probe's marked side as intended. Then the first pattern is uppermost, and the first wire
    /// of each is at the right. PLUS's phantom definitions have the same order (the dots of a
    /// line from right to left, lines from top to bottom), and so have ours.
    pub fn wires(&self) -> &[Wire] {
        &self.wires
    }

    /// Returns the patterns, as ranges of [`Self::wires`].
    pub fn patterns(&self) -> impl Iterator<Item = std::ops::Range<usize>> {
        let ends = self.starts.iter().skip(1).copied().chain([self.wires.len()]);
        self.starts.iter().zip(ends).map(|(&start, end)| start..end)
    }

    /// Returns the landmarks, in the file's order.
    pub fn landmarks(&self) -> &[Landmark] {
        &self.landmarks
    }

    /// Returns the N's among its patterns.
    pub fn nwires(&self) -> Vec<Nwire> {
        self.patterns().filter_map(|pattern| Nwire::of(&self.wires, pattern)).collect()
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// Returns three N's one above the other, 10 mm apart, as in many phantoms.
    pub(crate) fn three_ns() -> Geometry {
        let wire = |name: &str, from: [f64; 3], to: [f64; 3]| Wire {
            name: name.into(),
            ends_mm: [from, to].map(DVec3::from_array),
        };
        let n = |number: usize, z: f64, x: [f64; 2], slant: [f64; 2]| {
            vec![
                wire(&format!("{number}a"), [x[0], 0.0, z], [x[0], 40.0, z]),
                wire(&format!("{number}b"), [slant[0], 0.0, z], [slant[1], 40.0, z]),
                wire(&format!("{number}c"), [x[1], 0.0, z], [x[1], 40.0, z]),
            ]
        };
        let patterns = vec![
            n(1, 10.0, [20.0, 45.0], [40.0, 25.0]),
            n(2, 5.0, [20.0, 50.0], [25.0, 45.0]),
            n(3, 0.0, [20.0, 50.0], [45.0, 25.0]),
        ];
        let landmark = |name: &str, at: [f64; 3]| Landmark { name: name.into(), position_mm: DVec3::from_array(at) };
        let landmarks = vec![landmark("#1", [95.0, 5.0, 15.0]), landmark("#2", [-25.0, 40.0, 0.0])];
        Geometry::new("three N's", patterns, landmarks).unwrap()
    }

    #[test]
    fn patterns_are_ranges_of_all_wires() {
        let phantom = three_ns();
        assert_eq!(phantom.patterns().collect::<Vec<_>>(), [0..3, 3..6, 6..9]);
        assert_eq!(phantom.wires()[4].name, "2b");
        let bare = Geometry::new("", Vec::new(), phantom.landmarks().to_vec()).unwrap();
        assert_eq!(bare.patterns().count() + bare.nwires().len(), 0);
    }

    #[test]
    fn nearest_point_on_wire_is_perpendicular() {
        let wire = three_ns().wires()[1].clone();
        let [first, second] = wire.across();
        for (a, b) in [(first, second), (first, wire.direction()), (second, wire.direction())] {
            assert!(a.dot(b).abs() < 1e-15 && (a.length() - 1.0).abs() < 1e-15);
        }
        let point = wire.ends_mm[0] + 0.25 * (wire.ends_mm[1] - wire.ends_mm[0]) + 3.0 * first - 4.0 * second;
        let (distance, share) = wire.nearest(point);
        assert!((distance - 5.0).abs() < 1e-12 && (share - 0.25).abs() < 1e-12);
    }

    #[test]
    fn invalid_phantom_is_refused_by_name() {
        let whole = three_ns();
        let refusal = |change: fn(&mut Vec<Wire>, &mut Vec<Landmark>)| {
            let (mut wires, mut landmarks) = (whole.wires().to_vec(), whole.landmarks().to_vec());
            change(&mut wires, &mut landmarks);
            Geometry::new("", vec![wires], landmarks)
        };
        let twice = |what, name: &str| Err(GeometryError::Twice { what, name: name.into() }.into());
        let not_finite = |name: &str| Err(GeometryError::NotFinite { name: name.into() }.into());
        assert_eq!(refusal(|w, _| w[3].name = "1a".into()), twice("wires", "1a"));
        assert_eq!(refusal(|_, l| l[1].name = "#1".into()), twice("landmarks", "#1"));
        assert_eq!(refusal(|w, _| w[2].ends_mm[0].y = f64::NAN), not_finite("1c"));
        assert_eq!(refusal(|_, l| l[0].position_mm.x = f64::INFINITY), not_finite("#1"));
        let short = GeometryError::Short { name: "1c".into(), mm: 0.0 };
        assert_eq!(refusal(|w, _| w[2].ends_mm[1] = w[2].ends_mm[0]), Err(short.into()));
        let scaled = |w: &mut Vec<Wire>, l: &mut Vec<Landmark>, factor: f64| {
            w.iter_mut().for_each(|wire| wire.ends_mm = wire.ends_mm.map(|end| end * factor));
            l.iter_mut().for_each(|landmark| landmark.position_mm *= factor);
        };
        let (mut wires, mut landmarks) = (whole.wires().to_vec(), whole.landmarks().to_vec());
        scaled(&mut wires, &mut landmarks, 0.05);
        let error = Geometry::new("", vec![wires], landmarks).unwrap_err();
        assert!(matches!(error, CalibrationError::Geometry(GeometryError::Size { mm: 5.5..6.5 })), "{error}");
        assert_eq!(Geometry::new("", Vec::new(), Vec::new()), Err(GeometryError::Empty.into()));
    }
}
