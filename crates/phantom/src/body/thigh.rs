//! A thigh, scanned from the front in planes nearly along it: x leads towards the hip, y
//! backwards, z from the inner to the outer side.
//!
//! The skin yields to a curvilinear transducer: skin, fat and fascia follow its arc.

use glam::{DAffine3, DVec3};

use super::{Body, Landmark, Material, Shape, Solid};

/// Length of a sweep across the femur and the vessels, mm.
pub const SWEEP_MM: f64 = 66.0;

/// Ends of the femur's axis, mm.
pub const FEMUR: [[f64; 3]; 2] = [[-130.0, 44.0, -10.0], [150.0, 77.0, 38.0]];
/// Outer radius of the femur's shaft, mm.
pub const FEMUR_RADIUS_MM: f64 = 13.5;
/// Ends of the femoral artery's axis, mm.
pub const ARTERY: [[f64; 3]; 2] = [[-90.0, 101.0, -20.0], [150.0, 70.0, 12.0]];
/// Outer and inner radius of the artery, mm.
pub const ARTERY_RADII_MM: [f64; 2] = [5.2, 3.7];

const SEPTUM: u8 = 1;
const RECTUS: u8 = 2;
const FAT: u8 = 3;
const SKIN: u8 = 4;
const GEL: u8 = 5;
const BONE: u8 = 6;
const MARROW: u8 = 7;
const WALL: u8 = 8;
const BLOOD: u8 = 9;
const DEEP: u8 = 10;

/// Returns a thigh under a transducer of the given radius (mm).
pub fn thigh(face_radius_mm: f64) -> Body {
    let point = DVec3::new;
    let mut solids = Vec::new();
    let mut add = |material, shape| solids.push(Solid { shape, material });
    let egg = |x, y, z, r: [f64; 3]| Shape::ellipsoid(point(x, y, z), DVec3::from_array(r));
    let tube = |[from, to]: [[f64; 3]; 2], radius| Shape::Capsule { from: from.into(), to: to.into(), radius };
    // Muscle bellies in their sheaths.
    for (material, [x, y, z], [a, b, c]) in [
        (RECTUS, [10.0, 20.0, 2.0], [150.0, 12.5, 26.0]),
        (RECTUS, [-10.0, 62.0, -42.0], [160.0, 26.0, 20.0]),
        (DEEP, [0.0, 112.0, 10.0], [170.0, 22.0, 48.0]),
    ] {
        add(SEPTUM, egg(x, y, z, [a + 1.0, b + 1.0, c + 1.0]));
        add(material, egg(x, y, z, [a, b, c]));
    }
    // Layers around the transducer's arc, the nearer over the deeper.
    let arc = [[0.0, -face_radius_mm, -400.0], [0.0, -face_radius_mm, 400.0]];
    for (material, depth) in [(SEPTUM, 10.2), (FAT, 9.4), (SKIN, 2.4), (GEL, -0.6)] {
        add(material, tube(arc, face_radius_mm + depth));
    }
    // Vessels and bone over the muscles.
    let vein = ARTERY.map(|[x, y, z]| [x, y + 11.5, z + 3.0]);
    let [wall, lumen] = ARTERY_RADII_MM;
    for (material, axis, radius) in [
        (WALL, vein, 5.0),
        (BLOOD, vein, 4.2),
        (WALL, ARTERY, wall),
        (BLOOD, ARTERY, lumen),
        (BONE, FEMUR, FEMUR_RADIUS_MM),
        (MARROW, FEMUR, 8.0),
    ] {
        add(material, tube(axis, radius));
    }
    let across = |x: f64, y: f64, z: f64| DVec3::new(x, y, z).normalize();
    let femur = FEMUR.map(DVec3::from_array);
    Body {
        name: "thigh",
        materials: vec![
            Material::muscle("vastus", across(0.22, 1.0, 0.1)),
            Material { attenuation: 0.8, ..Material::dense("septum", 5.0) },
            Material {
                backscatter_db: Some(-8.0),
                impedance: 1.68,
                ..Material::muscle("rectus", across(-0.12, 1.0, 0.05))
            },
            Material::fat("fat"),
            Material::dense("skin", 7.0),
            Material { attenuation: 0.05, impedance: 1.5, ..Material::water("gel") },
            Material::bone("bone"),
            Material { backscatter_db: Some(-8.0), ..Material::fat("marrow") },
            Material { impedance: 1.9, lobe_deg: 30.0, diffuse: 0.15, ..Material::dense("wall", 12.0) },
            Material::blood("blood"),
            Material { backscatter_db: Some(-5.0), ..Material::muscle("hamstrings", across(0.3, 1.0, -0.2)) },
        ],
        solids,
        wires: Vec::new(),
        landmarks: vec![Landmark { name: "femur's middle", point: 0.5 * (femur[0] + femur[1]) }],
        world_from_body: DAffine3::IDENTITY,
    }
}
