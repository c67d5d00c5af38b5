//! Detects the moments at which an arm's joints rest. These are touches, with the tip held to
//! something.

use glam::DVec3;

use super::{Arm, JOINTS, Kind};
use crate::rest;

/// An interval in which the joints rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rest {
    /// Mean counts, base first, without readings that jump away and back.
    pub counts: [f64; JOINTS],
    /// Start and end, s.
    pub time_s: [f64; 2],
    /// Standard deviation of the joints about the mean, scaled to the tip's motion, mm.
    pub spread_mm: f64,
}

/// Finds the rests among readings (time in s, counts, in the order of time). A rest lasts at
/// least `least_s`. In it the joints move the tip by at most `still_mm` from their mean, plus
/// one count each.
pub fn find(arm: &Arm, readings: &[(f64, [f64; JOINTS])], still_mm: f64, least_s: f64) -> Vec<Rest> {
    let scales = mm_per_count(arm);
    let place = |counts: &[f64; JOINTS]| DVec3::from_array(*counts) * scales;
    let places: Vec<(f64, DVec3)> = readings.iter().map(|(time_s, counts)| (*time_s, place(counts))).collect();
    // An encoder at the edge between two counts shows either.
    let radius_mm = still_mm + scales.length();
    let rests = rest::find(&places, radius_mm, least_s);
    let of = |rest: &rest::Rest| Rest {
        counts: (rest.at / scales).to_array(),
        time_s: rest.time_s,
        spread_mm: rest.spread_mm,
    };
    rests.iter().map(of).collect()
}

/// Returns the largest motion of the tip per count of each joint, mm.
fn mm_per_count(arm: &Arm) -> DVec3 {
    let mut reach_mm = 0.0;
    let mut scales = [0.0; JOINTS];
    for (scale, joint) in scales.iter_mut().zip(arm.joints()).rev() {
        reach_mm += joint.length_mm.abs();
        let lever = if joint.kind == Kind::Revolute { reach_mm.max(1.0) } else { 1.0 };
        *scale = lever * joint.value_per_count().abs();
    }
    DVec3::from_array(scales)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arm::Joint;

    /// Simulates 100 readings a second: the arm moves to each place within half a second and
    /// rests there for the given seconds.
    fn readings(places: &[([f64; JOINTS], f64)]) -> Vec<(f64, [f64; JOINTS])> {
        let mut all: Vec<(f64, [f64; JOINTS])> = Vec::new();
        let mut from = [0.0; JOINTS];
        for (to, rest_s) in places {
            for step in 0..50 {
                let share = f64::from(step) / 50.0;
                all.push((
                    all.len() as f64 * 0.01,
                    std::array::from_fn(|i| (from[i] + share * (to[i] - from[i])).round()),
                ));
            }
            for reading in 0..(rest_s * 100.0) as usize {
                // The last encoder is at the edge between two counts.
                let shown = [to[0], to[1], to[2] + (reading % 2) as f64];
                all.push((all.len() as f64 * 0.01, shown));
            }
            from = *to;
        }
        all
    }

    #[test]
    fn rests_are_found_and_jumps_are_ignored() {
        let arm = Arm::new([Joint::revolute(250.0, 4e4), Joint::revolute(220.0, 4e4), Joint::revolute(60.0, 1000.0)])
            .unwrap();
        let places = [[4000.0, -9000.0, 100.0], [9000.0, 3000.0, -40.0], [9000.0, 3000.0, 250.0]];
        let mut all = readings(&places.map(|place| (place, 1.5)));
        all[100].1[1] += 20_000.0;
        let found = find(&arm, &all, 2.0, 1.0);
        assert_eq!(found.len(), 3, "{found:?}");
        for (rest, place) in found.iter().zip(places) {
            let off: Vec<f64> = rest.counts.iter().zip(place).map(|(a, b)| a - b).collect();
            assert!(off[0].abs() < 10.0 && off[1].abs() < 20.0 && (off[2] - 0.5).abs() < 1.0, "{off:?}");
            assert!(rest.time_s[1] - rest.time_s[0] > 1.4, "{rest:?}");
        }
        assert!(find(&arm, &all, 2.0, 1.8).is_empty());
        assert!(find(&arm, &readings(&[([9000.0, 9000.0, 900.0], 0.2)]), 2.0, 1.0).is_empty());
    }
}
