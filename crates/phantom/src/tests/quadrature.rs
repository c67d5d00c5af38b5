//! Blur by brute force, a reference for tests of closed forms and sums.

use glam::{DMat3, DVec3};

use crate::Scene;

/// Convolves the scene with a Gaussian by the midpoint rule over ±6 σ along the Gaussian's
/// `axes`, with `steps` points on each.
pub(crate) fn brute(scene: &Scene, world: DVec3, axes: DMat3, sigma: DVec3, steps: i32) -> f64 {
    let nodes: Vec<(f64, f64)> = (0..steps)
        .map(|k| {
            let t = (f64::from(k) + 0.5) / f64::from(steps) * 12.0 - 6.0;
            (t, (-0.5 * t * t).exp())
        })
        .collect();
    let (mut sum, mut weights) = (0.0, 0.0);
    for (x, wx) in &nodes {
        for (y, wy) in &nodes {
            for (z, wz) in &nodes {
                let weight = wx * wy * wz;
                sum += weight * scene.value(world + axes * (DVec3::new(*x, *y, *z) * sigma));
                weights += weight;
            }
        }
    }
    sum / weights
}
