//! Where to begin: the image plane in the probe's frame from all dots at once, by linear least squares.
//!
//! That a pixel lies on a wire is linear in the plane's nine numbers, whatever the pose ([`super::plane`]). Dots that were taken for a wire's and are not, and pictures whose pose is wrong, are given less weight
//! from solution to solution, down to none (Tukey's loss by iterated weights, from Huber's, which has one minimum).

use glam::DVec2;

use super::layout::Layout;
use super::plane::{ImagePlane, PlaneSum, Unit};
use super::sighting::{Sighting, off_wire};
use crate::frames::{Phantom, Probe, Transform};
use crate::least_squares::Loss;
use crate::least_squares::loss::spread;

/// Solutions by each loss: weights change by less than a per cent well before.
const ROUNDS: usize = 15;

/// The plane from all dots, and how far each lies from its wire.
#[derive(Debug, Clone)]
pub struct Start {
    /// In the probe's frame.
    pub plane: ImagePlane,
    /// Each dot's distance from its wire, mm; picture by picture.
    pub off_mm: Vec<Vec<f64>>,
    /// Each dot's weight, 0 to 1.
    pub weights: Vec<Vec<f64>>,
    /// Standard deviation of the distances, along one direction, by their median, mm.
    pub spread_mm: f64,
}

/// Begins. Pictures without a pose are left out; `None` where the others' dots leave the plane open.
pub fn start(
    layout: &Layout,
    sightings: &[Sighting],
    probe_from_phantom: impl Fn(&Sighting) -> Option<Transform<Probe, Phantom>>,
    size_px: [u32; 2],
) -> Option<Start> {
    let wires = layout.geometry().wires();
    let (sightings, maps): (Vec<_>, Vec<_>) =
        sightings.iter().filter_map(|sighting| Some((sighting, probe_from_phantom(sighting)?))).unzip();
    let mut weights: Vec<Vec<f64>> = sightings.iter().map(|s| vec![1.0; s.marks.len()]).collect();
    let mut found = None;
    for round in 0..2 * ROUNDS {
        let mut sum = PlaneSum::new(Unit::of(size_px));
        for ((sighting, map), weights) in sightings.iter().zip(&maps).zip(&weights) {
            for (mark, weight) in sighting.marks.iter().zip(weights) {
                sum.add_dot(mark.at_px, &wires[mark.wire], &map.affine(), *weight);
            }
        }
        let plane = sum.solve(false)?;
        let off_mm: Vec<Vec<f64>> = sightings
            .iter()
            .zip(&maps)
            .map(|(sighting, map)| {
                let back = map.inverse();
                let off = |px: DVec2, wire: usize| off_wire(&wires[wire], back.point(plane.point(px)));
                sighting.marks.iter().map(|mark| DVec2::from_array(off(mark.at_px, mark.wire)).length()).collect()
            })
            .collect();
        let lengths: Vec<(usize, f64)> = off_mm.iter().flatten().map(|&off| (2, off)).collect();
        let spread_mm = spread(&lengths).max(LEAST_SPREAD_MM);
        let law = if round < ROUNDS { Loss::Huber } else { Loss::Tukey }.of(2);
        weights = off_mm.iter().map(|off| off.iter().map(|off| law.weight(off / spread_mm)).collect()).collect();
        found = Some(Start { plane, off_mm, weights: weights.clone(), spread_mm });
    }
    found
}

/// Rounding is no spread, mm.
const LEAST_SPREAD_MM: f64 = 1e-9;
