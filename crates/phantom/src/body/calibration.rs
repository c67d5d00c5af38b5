//! Phantoms for calibration: wires, a plane, a stylus, in water. The truth is in closed form:
//! [`Wire::crossing`], a solid's plane, a landmark.

use glam::{DAffine3, DVec2, DVec3};

use super::{Body, Landmark, Material, Shape, Solid, Wire};

/// Layers of three wires in the shape of an N, each layer at its own depth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NWires {
    /// Number of layers.
    pub layers: u32,
    /// Depth of the first layer, mm.
    pub depth_mm: f64,
    /// Distance of layers, mm.
    pub distance_mm: f64,
    /// Distance of the side wires, mm.
    pub width_mm: f64,
    /// Length along z, mm.
    pub length_mm: f64,
    /// Diameter of the wires, mm.
    pub diameter_mm: f64,
}

impl Default for NWires {
    /// Three layers from 22 mm on, 9 mm apart, 26 mm wide and 40 mm long, of wires of 0.35 mm.
    fn default() -> Self {
        Self { layers: 3, depth_mm: 22.0, distance_mm: 9.0, width_mm: 26.0, length_mm: 40.0, diameter_mm: 0.35 }
    }
}

/// Returns the N-wire phantom. Wire `1a` is the first layer's side wire at −x, `1b` its oblique
/// one, `1c` the other side's. Oblique wires of odd layers lead from −x at −z to +x at +z,
/// those of even layers the other way. The landmarks `#1` to `#5` are holes on the outside of
/// its box, for a stylus.
pub fn n_wires(shape: &NWires) -> Body {
    let (x, z) = (0.5 * shape.width_mm, 0.5 * shape.length_mm);
    let wires = (0..shape.layers).flat_map(|layer| {
        let y = shape.depth_mm + f64::from(layer) * shape.distance_mm;
        let side = if layer % 2 == 0 { -x } else { x };
        [("a", [-x, -x]), ("b", [side, -side]), ("c", [x, x])].map(|(name, [near, far])| Wire {
            diameter_mm: shape.diameter_mm,
            ..Wire::nylon(format!("{}{name}", layer + 1), [near, y, -z], [far, y, z])
        })
    });
    // No two distances are equal, so that any order of touches is recognised.
    let (far, out) = (x + 5.0, z + 4.0);
    let holes = [[-far, -out, -4.0], [far, -out, 0.0], [far - 7.0, -out, 26.0], [-far, out, 2.0], [far, out, 21.0]];
    let holes = ["#1", "#2", "#3", "#4", "#5"].into_iter().zip(holes);
    let landmark = |(name, [x, z, y]): (_, [f64; 3])| Landmark { name, point: DVec3::new(x, shape.depth_mm + y, z) };
    Body { name: "n-wire", wires: wires.collect(), landmarks: holes.map(landmark).collect(), ..water() }
}

/// Returns two wires that cross at one point, `depth_mm` below the face: the landmark
/// `crossing`.
pub fn cross_wire(depth_mm: f64) -> Body {
    let (x, z) = (18.0, 18.0);
    Body {
        name: "cross-wire",
        wires: vec![
            Wire::nylon("a", [-x, depth_mm, -z], [x, depth_mm, z]),
            Wire::nylon("b", [-x, depth_mm, z], [x, depth_mm, -z]),
        ],
        landmarks: vec![Landmark { name: "crossing", point: DVec3::new(0.0, depth_mm, 0.0) }],
        ..water()
    }
}

/// Returns a tank's floor at a depth below the face's middle, with a slope along x and z (rise
/// over run). The landmark `floor` marks that point.
pub fn floor(depth_mm: f64, slope: DVec2) -> Body {
    let normal = DVec3::new(slope.x, -1.0, slope.y).normalize();
    let point = DVec3::new(0.0, depth_mm, 0.0);
    Body {
        name: "tank-floor",
        materials: vec![Material::water("water"), Material::acrylic("floor")],
        solids: vec![Solid { shape: Shape::HalfSpace { point, normal }, material: 1 }],
        landmarks: vec![Landmark { name: "floor", point }],
        ..water()
    }
}

/// Returns a pointed steel rod of 3 mm that ends in the landmark `tip`.
pub fn stylus(tip: DVec3, along: DVec3) -> Body {
    let along = along.normalize();
    let at = |distance: f64| tip + along * distance;
    Body {
        name: "stylus",
        materials: vec![
            Material::water("water"),
            Material { lobe_deg: 40.0, diffuse: 0.15, ..Material::steel("steel") },
        ],
        solids: vec![
            Solid { shape: Shape::spindle(tip, at(24.0), 1.5), material: 1 },
            Solid { shape: Shape::Capsule { from: at(12.0), to: at(120.0), radius: 1.5 }, material: 1 },
        ],
        landmarks: vec![Landmark { name: "tip", point: tip }],
        ..water()
    }
}

fn water() -> Body {
    Body {
        name: "water",
        materials: vec![Material::water("water")],
        solids: Vec::new(),
        wires: Vec::new(),
        landmarks: Vec::new(),
        world_from_body: DAffine3::IDENTITY,
    }
}
