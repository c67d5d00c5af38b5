//! Construction of a phantom: two parallel plates with holes, and wires between them.
//!
//! Directions follow the scan that the phantom's file assumes ([`Geometry::wires`]): right and
//! up as seen with the probe above and its marked side at the right. The plate nearer to this
//! viewer is the front one. The wires' ends lie at the plates' inner faces; landmarks lie from
//! there outwards.

use glam::{DVec2, DVec3};

use super::{Geometry, Landmark, Wire};
use crate::error::{CalibrationError, GeometryError};

/// Largest distance of a wire's end from its plate, mm: the accuracy of drilling.
const OFF_MM: f64 = 0.1;
/// Ends nearer to each other than this share a hole, mm.
const SAME_HOLE_MM: f64 = 0.01;
/// Largest thickness of a plate, mm: landmarks farther out are on something else.
const THICKEST_MM: f64 = 25.0;

/// Two plates and the wires between them. Positions on a plate are to the right and up from the
/// phantom's own origin, mm.
#[derive(Debug, Clone, PartialEq)]
pub struct Plates {
    /// Distance of the inner faces, mm.
    pub apart_mm: f64,
    /// The front plate and the back plate.
    pub plates: [Plate; 2],
    /// Holes of each wire in the front and the back plate.
    pub wires: Vec<[usize; 2]>,
    /// Indices of the landmarks that are on neither plate.
    pub elsewhere: Vec<usize>,
}

/// A plate.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Plate {
    /// Centres of holes, in the order of the wires through them.
    pub holes: Vec<DVec2>,
    /// Its landmarks.
    pub divots: Vec<Divot>,
}

/// A landmark on a plate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Divot {
    /// Index among the phantom's landmarks.
    pub landmark: usize,
    /// Position on the plate, mm.
    pub at: DVec2,
    /// Distance outwards from the plate's inner face, mm: the plate's thickness, if it is on
    /// the outer face.
    pub out_mm: f64,
}

impl Plates {
    /// Computes the plates of a phantom.
    ///
    /// # Errors
    /// [`GeometryError`]: its wires are arranged otherwise.
    pub fn of(geometry: &Geometry) -> Result<Self, CalibrationError> {
        let view = View::of(geometry)?;
        let wires = geometry.wires();
        let first = &wires[geometry.nwires()[0].outer[0]];
        let levels = view.levels(first);
        let mut found = Self {
            apart_mm: levels[1] - levels[0],
            plates: [Plate::default(), Plate::default()],
            wires: Vec::new(),
            elsewhere: Vec::new(),
        };
        for wire in wires {
            let ends = view.front_first(wire);
            let off = view.levels(wire).into_iter().zip(levels).map(|(end, level)| (end - level).abs());
            let off_mm = off.fold(0.0, f64::max);
            if off_mm > OFF_MM {
                return Err(
                    GeometryError::Off { wire: wire.name.clone(), mm: off_mm, first: first.name.clone() }.into()
                );
            }
            let holes = [0, 1].map(|plate| found.plates[plate].hole(view.across(ends[plate])));
            found.wires.push(holes);
        }
        for (landmark, Landmark { position_mm, .. }) in geometry.landmarks().iter().enumerate() {
            let level = position_mm.dot(view.away);
            let out = [levels[0] - level, level - levels[1]];
            match out.iter().position(|out_mm| (-OFF_MM..=THICKEST_MM).contains(out_mm)) {
                Some(plate) => {
                    let at = view.across(*position_mm);
                    found.plates[plate].divots.push(Divot { landmark, at, out_mm: out[plate].max(0.0) });
                }
                None => found.elsewhere.push(landmark),
            }
        }
        Ok(found)
    }

    /// Returns the plates' thickness, mm, if all landmarks are equally far out.
    pub fn thickness_mm(&self) -> Option<f64> {
        let mut out = self.plates.iter().flat_map(|plate| &plate.divots).map(|divot| divot.out_mm);
        let first = out.next()?;
        (first > OFF_MM && out.all(|out_mm| (out_mm - first).abs() <= OFF_MM)).then_some(first)
    }

    /// Returns the lower left and the upper right corner of everything on either plate.
    pub fn bounds(&self) -> [DVec2; 2] {
        let on = |plate: &Plate| -> Vec<DVec2> {
            plate.holes.iter().copied().chain(plate.divots.iter().map(|divot| divot.at)).collect()
        };
        let all: Vec<DVec2> = self.plates.iter().flat_map(on).collect();
        let by = |corner: fn(DVec2, DVec2) -> DVec2| all.iter().copied().reduce(corner).unwrap_or_default();
        [by(DVec2::min), by(DVec2::max)]
    }
}

impl Plate {
    /// Returns the index of the hole at this place; adds it if new.
    fn hole(&mut self, at: DVec2) -> usize {
        let known = self.holes.iter().position(|hole| hole.distance(at) < SAME_HOLE_MM);
        known.unwrap_or_else(|| {
            self.holes.push(at);
            self.holes.len() - 1
        })
    }
}

/// The viewing directions: unit vectors.
struct View {
    right: DVec3,
    up: DVec3,
    away: DVec3,
}

impl View {
    fn of(geometry: &Geometry) -> Result<Self, GeometryError> {
        let ns = geometry.nwires();
        let (Some(first), Some(last)) = (ns.first(), ns.last()) else { return Err(GeometryError::NoN) };
        let wires = geometry.wires();
        let middle = |wire: usize| 0.5 * (wires[wire].ends_mm[0] + wires[wire].ends_mm[1]);
        let along = wires[first.outer[0]].direction();
        let rightwards: DVec3 = ns.iter().map(|n| middle(n.outer[0]) - middle(n.outer[1])).sum();
        let right = rightwards.reject_from(along).normalize_or_zero();
        let upwards: DVec3 = [first, last]
            .map(|n| middle(n.outer[0]) + middle(n.outer[1]))
            .into_iter()
            .reduce(|a, b| a - b)
            .unwrap_or_default();
        let up = upwards.reject_from(along).reject_from_normalized(right).try_normalize().ok_or(GeometryError::Flat)?;
        Ok(Self { right, up, away: up.cross(right) })
    }

    /// Returns the distances of the nearer and the farther end of a wire along the viewing
    /// direction.
    fn levels(&self, wire: &Wire) -> [f64; 2] {
        self.front_first(wire).map(|end| end.dot(self.away))
    }

    fn front_first(&self, wire: &Wire) -> [DVec3; 2] {
        let [from, to] = wire.ends_mm;
        if from.dot(self.away) <= to.dot(self.away) { [from, to] } else { [to, from] }
    }

    fn across(&self, at: DVec3) -> DVec2 {
        DVec2::new(at.dot(self.right), at.dot(self.up))
    }
}

#[cfg(test)]
mod tests {
    use glam::{DAffine3, DQuat};

    use super::super::geometry::tests::three_ns;
    use super::*;

    fn changed(map: DAffine3, change: impl Fn(&mut Vec<Wire>)) -> Result<Plates, CalibrationError> {
        let phantom = three_ns();
        let mut wires = phantom.wires().to_vec();
        change(&mut wires);
        wires.iter_mut().for_each(|wire| wire.ends_mm = wire.ends_mm.map(|end| map.transform_point3(end)));
        let mut landmarks = phantom.landmarks().to_vec();
        landmarks.push(Landmark { name: "front".into(), position_mm: DVec3::new(10.0, 45.0, 20.0) });
        landmarks.push(Landmark { name: "back".into(), position_mm: DVec3::new(60.0, -5.0, -5.0) });
        landmarks.iter_mut().for_each(|l| l.position_mm = map.transform_point3(l.position_mm));
        let patterns = phantom.patterns().map(|pattern| wires[pattern].to_vec()).collect();
        Plates::of(&Geometry::new("", patterns, landmarks).unwrap())
    }

    /// The first wire of each N is at the right, which is −x: the view is along −y.
    #[test]
    fn plates_are_seen_from_scan_direction() {
        let found = changed(DAffine3::IDENTITY, |_| ()).unwrap();
        assert!((found.apart_mm - 40.0).abs() < 1e-12);
        let [front, back] = &found.plates;
        // Wire 1b leads from x = 40 at y = 0, the back, to 25 at the front.
        let [at_front, at_back] = found.wires[1];
        assert!(front.holes[at_front].distance(DVec2::new(-25.0, 10.0)) < 1e-12, "{front:?}");
        assert!(back.holes[at_back].distance(DVec2::new(-40.0, 10.0)) < 1e-12, "{back:?}");
        assert_eq!((front.holes.len(), back.holes.len(), found.wires.len()), (9, 9, 9));
        let divot = |plate: &Plate| (plate.divots.len(), plate.divots.last().map(|d| (d.landmark, d.at)));
        assert_eq!(divot(front), (2, Some((2, DVec2::new(-10.0, 20.0)))));
        assert_eq!(divot(back), (1, Some((3, DVec2::new(-60.0, -5.0)))));
        // The second landmark is at the front plate's inner face, the first between the plates.
        assert_eq!((found.elsewhere.as_slice(), found.thickness_mm()), ([0].as_slice(), None));
        assert_eq!(found.bounds(), [DVec2::new(-60.0, -5.0), DVec2::new(25.0, 20.0)]);
    }

    #[test]
    fn plates_do_not_depend_on_frame_or_wire_direction() {
        let turn = DAffine3::from_rotation_translation(
            DQuat::from_scaled_axis(DVec3::new(0.4, -1.1, 2.0)),
            DVec3::new(5.0, 60.0, -7.0),
        );
        let reversed = |wires: &mut Vec<Wire>| wires[3].ends_mm.reverse();
        let (plain, turned) = (changed(DAffine3::IDENTITY, |_| ()).unwrap(), changed(turn, reversed).unwrap());
        assert!((plain.apart_mm - turned.apart_mm).abs() < 1e-9);
        let shift = turned.plates[0].holes[0] - plain.plates[0].holes[0];
        for (one, other) in plain.plates.iter().zip(&turned.plates) {
            for (a, b) in one.holes.iter().zip(&other.holes) {
                assert!((*b - *a).distance(shift) < 1e-9);
            }
        }
        assert_eq!((&plain.wires, &plain.elsewhere), (&turned.wires, &turned.elsewhere));
    }

    #[test]
    fn holes_are_shared_and_other_phantoms_refused() {
        let shared = changed(DAffine3::IDENTITY, |w| w[1].ends_mm[0].x = 45.0).unwrap();
        assert_eq!((shared.plates[0].holes.len(), shared.plates[1].holes.len()), (9, 8));
        let off = changed(DAffine3::IDENTITY, |w| w[5].ends_mm[1].y = 39.5).unwrap_err();
        let CalibrationError::Geometry(GeometryError::Off { wire, mm, first }) = off else { panic!("{off}") };
        assert_eq!((wire.as_str(), format!("{mm:.2}").as_str(), first.as_str()), ("2c", "0.50", "1a"));
        let flat =
            changed(DAffine3::IDENTITY, |w| w.iter_mut().for_each(|w| w.ends_mm.iter_mut().for_each(|e| e.z = 0.0)));
        assert_eq!(flat, Err(GeometryError::Flat.into()));
        let none = Geometry::new("", vec![three_ns().wires()[..2].to_vec()], Vec::new()).unwrap();
        assert_eq!(Plates::of(&none), Err(GeometryError::NoN.into()));
    }
}
