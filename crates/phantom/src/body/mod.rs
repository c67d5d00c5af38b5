//! Bodies: the objects that a simulated scanner images. They consist of nested solids of
//! materials, and of wires.
//!
//! A body defines positions and acoustic properties; [`bmode`](super::bmode) simulates the
//! scanner. When used as a [`Scene`](super::Scene), its grey levels are the mean echo of each
//! material under the scanner's default display, without speckle, surfaces or shadow.
//!
//! - [`shape`]: convex solids.
//! - [`wire`]: wires, and their crossings with an image plane.
//! - [`doll`], [`thigh`], [`calibration`]: the available bodies.

use glam::{DAffine3, DMat3, DVec3};

pub mod calibration;
pub mod doll;
pub mod material;
pub mod shape;
pub mod thigh;
pub mod wire;

pub use material::{Fibres, Material};
pub use shape::Shape;
pub use wire::Wire;

/// A solid and its material.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Solid {
    /// Its shape and position.
    pub shape: Shape,
    /// Index into the body's materials.
    pub material: u8,
}

/// A named point of a body: a tip, a crossing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Landmark {
    /// Its name.
    pub name: &'static str,
    /// Its position in the body's axes, mm.
    pub point: DVec3,
}

/// Solids in surroundings, and wires. Later solids replace earlier ones in overlaps.
#[derive(Debug, Clone, PartialEq)]
pub struct Body {
    /// Its name.
    pub name: &'static str,
    /// The materials; the first one surrounds all solids.
    pub materials: Vec<Material>,
    /// The solids, the later over the earlier; at most 65 535.
    pub solids: Vec<Solid>,
    /// The wires.
    pub wires: Vec<Wire>,
    /// Named points.
    pub landmarks: Vec<Landmark>,
    /// The body's pose: a rotation and a translation in mm. An untransformed body is scanned
    /// from y = 0 towards +y, with the sweep along z.
    pub world_from_body: DAffine3,
}

/// A point of a line at which the material changes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Passage {
    /// Distance along the line, mm.
    pub at: f64,
    /// Index of the material before it.
    pub from: u8,
    /// Index of the material behind it.
    pub to: u8,
    /// The solid with this surface.
    pub solid: u16,
}

/// Solids hit by a line; reused between lines so that tracing allocates nothing.
#[derive(Debug, Clone, Default)]
pub struct Met {
    spans: Vec<([f64; 2], u16)>,
    ends: Vec<(f64, u16)>,
}

impl Met {
    /// Reserves space for all solids of a body.
    pub fn with_room_for(body: &Body) -> Self {
        let n = body.solids.len();
        Self { spans: Vec::with_capacity(n), ends: Vec::with_capacity(2 * n) }
    }
}

/// Candidates near a place: solids with a surface there, over a material that fills the rest.
#[derive(Debug, Clone, Default)]
pub struct Nearby {
    /// The material outside all candidate solids.
    ground: u8,
    /// The solids with a surface nearby, the last of the body first.
    solids: Vec<u16>,
}

impl Nearby {
    /// Reserves space for all solids of a body.
    pub fn with_room_for(body: &Body) -> Self {
        Self { ground: 0, solids: Vec::with_capacity(body.solids.len()) }
    }

    /// Returns the only material there; `None` if there are surfaces.
    pub fn only(&self) -> Option<u8> {
        self.solids.is_empty().then_some(self.ground)
    }

    /// Whether no candidate material scatters.
    pub fn is_silent(&self, body: &Body) -> bool {
        let silent = |material: u8| body.materials[usize::from(material)].backscatter_db.is_none();
        silent(self.ground) && self.solids.iter().all(|s| silent(body.solids[usize::from(*s)].material))
    }

    /// Returns the material at a point near the place.
    pub fn material_at(&self, body: &Body, p: DVec3) -> u8 {
        let found = self.solids.iter().map(|s| &body.solids[usize::from(*s)]).find(|solid| solid.shape.contains(p));
        found.map_or(self.ground, |solid| solid.material)
    }
}

impl Body {
    /// Moves the body so that its y = 0 lies at the world's `y`, the position of a scanner's
    /// face.
    pub fn placed_at(mut self, y: f64) -> Self {
        self.world_from_body = DAffine3 { matrix3: DMat3::IDENTITY, translation: DVec3::new(0.0, y, 0.0) };
        self
    }

    /// Returns the material at a point of the body: an index into its materials.
    pub fn material_at(&self, p: DVec3) -> u8 {
        self.solids.iter().rev().find(|solid| solid.shape.contains(p)).map_or(0, |solid| solid.material)
    }

    /// Returns the mean echo at a point of the world under the scanner's default display, grey
    /// levels.
    pub fn grey(&self, world: DVec3) -> f64 {
        let p = self.world_from_body.inverse().transform_point3(world);
        let echo = self.materials[usize::from(self.material_at(p))].backscatter_db;
        echo.map_or(0.0, super::bmode::default_grey)
    }

    /// Finds the candidates within `radius` of a point of the body.
    pub fn nearby(&self, centre: DVec3, radius: f64, nearby: &mut Nearby) {
        nearby.solids.clear();
        nearby.ground = 0;
        for (i, solid) in self.solids.iter().enumerate().rev() {
            if solid.shape.clearance(centre) <= radius {
                nearby.solids.push(i as u16);
            } else if solid.shape.contains(centre) {
                nearby.ground = solid.material;
                break;
            }
        }
        // Surfaces between equal materials do not count.
        if nearby.solids.iter().all(|s| self.solids[usize::from(*s)].material == nearby.ground) {
            nearby.solids.clear();
        }
    }

    /// Finds all material changes of a line from `origin` along a unit vector up to `length`
    /// mm, in order. Returns the material at its beginning.
    pub fn trace(
        &self,
        origin: DVec3,
        direction: DVec3,
        length: f64,
        met: &mut Met,
        passages: &mut Vec<Passage>,
    ) -> u8 {
        passages.clear();
        met.spans.clear();
        met.ends.clear();
        for (solid, i) in self.solids.iter().zip(0..) {
            if let Some([first, last]) = solid.shape.span(origin, direction)
                && last > 0.0
                && first < length
            {
                met.spans.push(([first, last], i));
                met.ends.extend([first, last].into_iter().filter(|t| *t > 0.0 && *t < length).map(|t| (t, i)));
            }
        }
        // The list is short and nearly in order. The sort is in place, because a stable sort
        // may allocate.
        met.ends.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let top = |t: f64| {
            let found = met.spans.iter().rev().find(|([first, last], _)| *first <= t && t < *last);
            found.map_or(0, |(_, solid)| self.solids[usize::from(*solid)].material)
        };
        let first = top(0.0);
        let mut material = first;
        for (k, (at, solid)) in met.ends.iter().enumerate() {
            let next = met.ends.get(k + 1).map_or(length, |end| end.0);
            let behind = top(0.5 * (at + next));
            if behind != material {
                passages.push(Passage { at: *at, from: material, to: behind, solid: *solid });
                material = behind;
            }
        }
        first
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A ball with a smaller one off its middle, in a half space, in water.
    fn nested() -> Body {
        let material = |name, db| Material { backscatter_db: Some(db), ..Material::water(name) };
        Body {
            name: "nested",
            materials: vec![
                Material::water("water"),
                material("wall", -10.0),
                material("ball", 0.0),
                material("core", 5.0),
            ],
            solids: vec![
                Solid {
                    shape: Shape::HalfSpace { point: DVec3::new(0.0, 30.0, 0.0), normal: DVec3::NEG_Y },
                    material: 1,
                },
                Solid { shape: Shape::sphere(DVec3::new(0.0, 15.0, 0.0), 10.0), material: 2 },
                Solid { shape: Shape::sphere(DVec3::new(0.0, 17.0, 0.0), 4.0), material: 3 },
                // A ball of the same material overlapping the first: no surface inside.
                Solid { shape: Shape::sphere(DVec3::new(8.0, 15.0, 0.0), 6.0), material: 2 },
            ],
            wires: Vec::new(),
            landmarks: Vec::new(),
            world_from_body: DAffine3::IDENTITY,
        }
    }

    #[test]
    fn line_crosses_material_changes_in_order() {
        let body = nested();
        let (mut met, mut passages) = (Met::with_room_for(&body), Vec::new());
        let first = body.trace(DVec3::ZERO, DVec3::Y, 50.0, &mut met, &mut passages);
        assert_eq!(first, 0);
        let found: Vec<_> = passages.iter().map(|p| (p.at.round(), p.from, p.to)).collect();
        assert_eq!(found, [(5.0, 0, 2), (13.0, 2, 3), (21.0, 3, 2), (25.0, 2, 0), (30.0, 0, 1)]);
        // Sideways through both balls of one material: in once, out once.
        body.trace(DVec3::new(-20.0, 11.0, 0.0), DVec3::X, 50.0, &mut met, &mut passages);
        assert_eq!(passages.iter().map(|p| (p.from, p.to)).collect::<Vec<_>>(), [(0, 2), (2, 0)]);
    }

    #[test]
    fn traced_and_nearby_materials_match_points() {
        let body = nested();
        let (mut met, mut passages, mut nearby) = (Met::with_room_for(&body), Vec::new(), Nearby::with_room_for(&body));
        for k in 0..200 {
            let origin = DVec3::new(f64::from(k % 20) - 10.0, -3.0, f64::from(k / 20) - 5.0);
            let direction = DVec3::new(0.01 * f64::from(k) - 1.0, 2.0, 0.3).normalize();
            let mut material = body.trace(origin, direction, 60.0, &mut met, &mut passages);
            let mut passages = passages.iter().peekable();
            for step in 0..600 {
                let t = 0.1 * f64::from(step) + 0.05;
                while let Some(passage) = passages.next_if(|p| p.at <= t) {
                    material = passage.to;
                }
                let p = origin + direction * t;
                assert_eq!(body.material_at(p), material, "{p}");
                body.nearby(p + 0.4, 1.0, &mut nearby);
                assert_eq!(nearby.material_at(&body, p), material, "{p}");
                assert!(nearby.only().is_none_or(|m| m == material));
            }
        }
    }
}
