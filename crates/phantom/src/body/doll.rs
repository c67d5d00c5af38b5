//! A rubber doll in a water tank.
//!
//! It lies on its back below the transducer, 160 mm long along z, head towards +z. Slices
//! across z run from foot to head. A view along +y with z upwards shows the face from the
//! front.

use glam::{DAffine3, DVec3};

use super::{Body, Landmark, Material, Shape, Solid};

/// Depth of the tank's floor, mm.
pub const FLOOR_MM: f64 = 98.0;
/// Length of a sweep from feet to head, mm.
pub const SWEEP_MM: f64 = 170.0;

const RUBBER: u8 = 1;
const FLOOR: u8 = 2;
const EYES: u8 = 3;

/// Returns the doll in its tank.
pub fn doll() -> Body {
    let point = DVec3::new;
    let mut solids = vec![Solid {
        shape: Shape::HalfSpace { point: point(0.0, FLOOR_MM, 0.0), normal: DVec3::NEG_Y },
        material: FLOOR,
    }];
    let mut add = |material, shape| solids.push(Solid { shape, material });
    let ball = |x, y, z, r| Shape::sphere(point(x, y, z), r);
    let egg = |x, y, z, r: [f64; 3]| Shape::ellipsoid(point(x, y, z), DVec3::from_array(r));
    let limb = |a: [f64; 3], b: [f64; 3], radius| Shape::Capsule { from: a.into(), to: b.into(), radius };
    // Head, face, neck.
    add(RUBBER, egg(0.0, 47.0, 58.0, [19.0, 20.0, 22.0]));
    add(RUBBER, egg(0.0, 26.5, 55.5, [2.8, 4.0, 3.6]));
    add(RUBBER, egg(0.0, 30.5, 45.5, [6.5, 3.0, 1.9]));
    add(RUBBER, ball(0.0, 36.0, 39.5, 5.5));
    for side in [-1.0, 1.0] {
        add(RUBBER, ball(9.5 * side, 35.5, 50.0, 7.2));
        add(RUBBER, egg(19.5 * side, 48.0, 57.0, [3.2, 4.5, 5.5]));
        add(EYES, ball(7.2 * side, 31.0, 61.5, 3.4));
        add(RUBBER, egg(7.2 * side, 30.2, 67.0, [4.6, 2.6, 1.5]));
    }
    add(RUBBER, limb([0.0, 49.0, 30.0], [0.0, 49.0, 42.0], 7.5));
    // Trunk.
    add(RUBBER, egg(0.0, 48.0, 12.0, [21.0, 16.0, 26.0]));
    add(RUBBER, ball(0.0, 43.0, 4.0, 14.5));
    add(RUBBER, egg(0.0, 49.0, -14.0, [19.0, 14.5, 14.0]));
    for side in [-1.0, 1.0] {
        // Arms to the sides, hands up.
        add(RUBBER, limb([20.0 * side, 48.0, 26.0], [33.0 * side, 46.0, 8.0], 6.6));
        add(RUBBER, limb([33.0 * side, 46.0, 8.0], [37.0 * side, 37.0, -10.0], 5.6));
        add(RUBBER, egg(37.5 * side, 34.5, -15.0, [4.0, 5.5, 6.5]));
        add(RUBBER, limb([34.5 * side, 32.5, -12.0], [32.0 * side, 29.0, -14.5], 1.9));
        // Legs, feet upright.
        add(RUBBER, limb([9.5 * side, 49.0, -20.0], [13.5 * side, 45.0, -45.0], 9.2));
        add(RUBBER, limb([13.5 * side, 45.0, -45.0], [14.5 * side, 49.0, -70.0], 7.4));
        add(RUBBER, limb([14.5 * side, 49.0, -73.0], [17.0 * side, 33.5, -76.0], 5.8));
    }
    // The navel is a hole filled with water.
    add(0, egg(0.0, 28.6, 0.0, [2.0, 2.4, 2.0]));
    Body {
        name: "doll",
        materials: vec![
            Material::water("water"),
            Material::rubber("rubber"),
            Material::acrylic("floor"),
            Material { backscatter_db: Some(8.0), impedance: 2.6, ..Material::rubber("eyes") },
        ],
        solids,
        wires: Vec::new(),
        landmarks: vec![Landmark { name: "nose", point: point(0.0, 22.5, 55.5) }],
        world_from_body: DAffine3::IDENTITY,
    }
}
