//! Start of the fit: the image plane in the probe's frame from all dots at once, by linear
//! least squares.
//!
//! A pixel on a wire gives equations that are linear in the plane's nine numbers, for any pose
//! ([`super::plane`]). Dots of a wrong wire, and images with a wrong pose, lose weight from
//! solution to solution, down to none. The loss is Tukey's, by iterated weights, starting from
//! Huber's, which has one minimum. Images that are wrong as a whole are left out beforehand.

use glam::DVec2;

use sonoweave_core::frames::{Phantom, Probe, Transform};

use super::layout::Layout;
use super::plane::{ImagePlane, PlaneSum, Unit};
use super::sighting::{Sighting, off_wire};
use crate::least_squares::Loss;
use crate::least_squares::loss::spread;
use crate::phantom::Wire;
use crate::statistics::median;

/// Number of solutions per loss: weights change by less than a per cent well before.
const ROUNDS: usize = 15;

/// The plane from all dots, and each dot's distance from its wire.
#[derive(Debug, Clone)]
pub struct Start {
    /// The plane in the probe's frame.
    pub plane: ImagePlane,
    /// Each dot's distance from its wire, mm; by image, empty for an image without a pose.
    pub off_mm: Vec<Vec<f64>>,
    /// Each dot's weight, 0 to 1.
    pub weights: Vec<Vec<f64>>,
    /// Standard deviation of the distances along one direction, from their median, mm.
    pub spread_mm: f64,
}

/// Computes a start. Images without a pose are left out; `None` if the others' dots leave the
/// plane open.
pub fn start(
    layout: &Layout,
    sightings: &[Sighting],
    probe_from_phantom: impl Fn(&Sighting) -> Option<Transform<Probe, Phantom>>,
    size_px: [u32; 2],
) -> Option<Start> {
    let wires = layout.geometry().wires();
    let all: Vec<Posed<'_>> =
        sightings.iter().filter_map(|sighting| Some(Posed { sighting, map: probe_from_phantom(sighting)? })).collect();
    let has_pose: Vec<bool> = sightings.iter().map(|sighting| probe_from_phantom(sighting).is_some()).collect();
    let agrees = agreeing(wires, &all, size_px);
    let mut weights: Vec<Vec<f64>> = all
        .iter()
        .zip(&agrees)
        .map(|(posed, agrees)| vec![f64::from(u8::from(*agrees)); posed.sighting.marks.len()])
        .collect();
    let mut found = None;
    for round in 0..2 * ROUNDS {
        let plane = solved(wires, all.iter().zip(&weights), size_px)?;
        let off_mm: Vec<Vec<f64>> = all.iter().map(|posed| posed.off_mm(wires, &plane)).collect();
        // The first rounds use the images that agree with most others; the later rounds use
        // all.
        let is_used = |posed: usize| round >= ROUNDS || agrees[posed];
        let used = off_mm.iter().enumerate().filter(|(posed, _)| is_used(*posed));
        let lengths: Vec<(usize, f64)> = used.flat_map(|(_, off)| off).map(|&off| (2, off)).collect();
        let spread_mm = spread(&lengths).max(LEAST_SPREAD_MM);
        let loss = if round < ROUNDS { Loss::Huber } else { Loss::Tukey }.of(2);
        let weight = |(posed, off): (usize, &Vec<f64>)| {
            off.iter().map(|off| if is_used(posed) { loss.weight(off / spread_mm) } else { 0.0 }).collect()
        };
        weights = off_mm.iter().enumerate().map(weight).collect();
        found = Some(Start { plane, off_mm, weights: weights.clone(), spread_mm });
    }
    // Returns to one entry per sighting.
    let mut start = found?;
    for numbers in [&mut start.off_mm, &mut start.weights] {
        let mut of_posed = std::mem::take(numbers).into_iter();
        *numbers = has_pose
            .iter()
            .map(|has_pose| if *has_pose { of_posed.next().unwrap_or_default() } else { Vec::new() })
            .collect();
    }
    Some(start)
}

/// A sighting with the phantom's pose.
struct Posed<'a> {
    sighting: &'a Sighting,
    map: Transform<Probe, Phantom>,
}

impl Start {
    /// Returns the images with at least half of their dots without weight: all others
    /// contradict them as a whole.
    pub(super) fn contradicted(&self) -> Vec<bool> {
        let has_none = |weights: &Vec<f64>| 2 * weights.iter().filter(|weight| **weight == 0.0).count();
        self.weights.iter().map(|weights| !weights.is_empty() && has_none(weights) >= weights.len()).collect()
    }
}

impl Posed<'_> {
    /// Returns each dot's distance from its wire, mm.
    fn off_mm(&self, wires: &[Wire], plane: &ImagePlane) -> Vec<f64> {
        let back = self.map.inverse();
        let off = |px: DVec2, wire: usize| off_wire(&wires[wire], back.point(plane.point(px)));
        self.sighting.marks.iter().map(|mark| DVec2::from_array(off(mark.at_px, mark.wire)).length()).collect()
    }
}

/// Fits the plane to weighted dots. `None` if they leave it open.
fn solved<'a>(
    wires: &[Wire],
    all: impl Iterator<Item = (&'a Posed<'a>, &'a Vec<f64>)>,
    size_px: [u32; 2],
) -> Option<ImagePlane> {
    let mut sum = PlaneSum::new(Unit::of(size_px));
    for (Posed { sighting, map }, weights) in all {
        for (mark, weight) in sighting.marks.iter().zip(weights) {
            sum.add_dot(mark.at_px, &wires[mark.wire], &map.affine(), *weight);
        }
    }
    sum.solve(false)
}

/// Returns which sightings agree with most others. Similar layers make it easy to assign all of
/// an image's dots to the layer below, and such images also agree with each other. The chosen
/// guess, computed from three sightings, is the one that half of all sightings fit best (least
/// median; Rousseeuw, J. Am. Stat. Assoc. 79, 1984).
fn agreeing(wires: &[Wire], all: &[Posed<'_>], size_px: [u32; 2]) -> Vec<bool> {
    let mut best: Option<(f64, Vec<f64>)> = None;
    for guess in 0..GUESSES {
        // Numbers that fill a cube evenly, the same each time (like Roberts' sequence of the
        // plastic number).
        let place = |step: f64| ((0.5 + f64::from(guess) * step).fract() * all.len() as f64) as usize;
        let three = [0.819_172_513_396_164_4, 0.671_043_606_703_789_3, 0.549_700_477_901_960_6].map(place);
        if all.len() < 3 || three[0] == three[1] || three[1] == three[2] || three[2] == three[0] {
            continue;
        }
        let whole: Vec<Vec<f64>> = three.iter().map(|place| vec![1.0; all[*place].sighting.marks.len()]).collect();
        let Some(plane) = solved(wires, three.iter().map(|place| &all[*place]).zip(&whole), size_px) else { continue };
        let off: Vec<f64> = all.iter().map(|posed| median(&mut posed.off_mm(wires, &plane))).collect();
        let score = median(&mut off.clone());
        if best.as_ref().is_none_or(|(least, _)| score < *least) {
            best = Some((score, off));
        }
    }
    match best {
        Some((score, off)) => off.iter().map(|off| *off <= AGREES * score.max(LEAST_SPREAD_MM)).collect(),
        None => vec![true; all.len()],
    }
}

/// Number of guesses. With two of three sightings good, all guesses contain a bad one once in
/// 10⁹ times; with half good, once in 3000.
const GUESSES: u32 = 60;
/// Sightings agree if their median distance is less than this multiple of the median over all.
const AGREES: f64 = 5.0;
/// Least spread, mm; smaller values are rounding errors.
const LEAST_SPREAD_MM: f64 = 1e-9;
