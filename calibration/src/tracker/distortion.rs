//! Maps the distortion of a tracker's field by metal, with two sensors on one rigid piece.

use std::collections::BTreeMap;

use glam::{DAffine3, DQuat, DVec3};

use super::noise::{mean, mean_rotation};
use crate::error::{CalibrationError, TrackerError};
use crate::statistics::Spread;

/// Minimum number of pairs of poses for a map.
pub const LEAST: usize = 30;
/// Minimum number of pairs in a cell; cells with fewer are not listed.
const LEAST_IN_CELL: usize = 5;
/// Number of reweighting rounds that reduce the influence of outlying pairs on the piece's
/// transform.
const ROUNDS: usize = 20;

/// Poses of two sensors on one piece at one time, in the tracker's frame, mm.
#[derive(Debug, Clone, Copy)]
pub struct Pair {
    /// Pose of the first sensor.
    pub one: DAffine3,
    /// Pose of the second sensor.
    pub other: DAffine3,
}

/// Options of the map.
#[derive(Debug, Clone, Copy)]
pub struct Options {
    /// Edge of its cells, mm.
    pub cell_mm: f64,
    /// Warning limit, mm, for the error of the sensors' distance or of one's position relative
    /// to the other.
    pub limit_mm: f64,
}

impl Default for Options {
    /// Cells of 50 mm, and a warning from 1 mm on: the stated accuracy of such trackers is 0.8
    /// mm (FASTRAK's manual).
    fn default() -> Self {
        Self { cell_mm: 50.0, limit_mm: 1.0 }
    }
}

/// A cell of the map.
#[derive(Debug, Clone, PartialEq)]
pub struct Cell {
    /// Its corner with the smallest coordinates, mm; it contains the midpoint between the
    /// sensors.
    pub low_mm: DVec3,
    /// Number of pairs in it.
    pub pairs: usize,
    /// Root mean square of the error in it, mm.
    pub rms_mm: f64,
    /// Its largest error, mm.
    pub most_mm: f64,
    /// Root mean square of the rotation's error, degrees.
    pub rms_deg: f64,
}

/// The map, and the piece's transform.
#[derive(Debug, Clone, PartialEq)]
pub struct Map {
    /// Number of pairs used.
    pub pairs: usize,
    /// Distance between the sensors, mm.
    pub distance_mm: f64,
    /// The second sensor's pose in the first one's frame.
    pub one_from_other: DAffine3,
    /// Root mean square of the error over all pairs, mm.
    pub rms_mm: f64,
    /// The largest, mm.
    pub most_mm: f64,
    /// Root mean square of the rotation's error over all pairs, degrees.
    pub rms_deg: f64,
    /// Root mean square difference of the measured distances and [`Self::distance_mm`], mm;
    /// independent of the measured rotations.
    pub distance_rms_mm: f64,
    /// Edge of the cells, mm.
    pub cell_mm: f64,
    /// Cells with enough pairs, those with the smallest z first, then y, then x.
    pub cells: Vec<Cell>,
    /// Indices in [`Self::cells`] of those whose error is beyond the limit, worst first.
    pub zones: Vec<usize>,
}

/// Maps the apparent changes of the transform between two sensors on a rigid piece.
///
/// The piece's own transform is a robust mean with weights 1 / error, so that distorted parts
/// of the room have little influence. The error of a pair is the distance of the second sensor
/// from its place by the first sensor and the piece.
///
/// # Errors
/// [`TrackerError`]: too few pairs, all in one place, or no rigid piece.
pub fn map(pairs: &[Pair], options: &Options) -> Result<Map, CalibrationError> {
    if pairs.len() < LEAST {
        return Err(TrackerError::FewPairs { pairs: pairs.len(), least: LEAST }.into());
    }
    let middle = |pair: &Pair| (pair.one.translation + pair.other.translation) * 0.5;
    let (low, high) = pairs
        .iter()
        .map(middle)
        .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), at| (low.min(at), high.max(at)));
    let mm = (high - low).max_element();
    if mm < options.cell_mm {
        return Err(TrackerError::Still { mm, cell_mm: options.cell_mm }.into());
    }
    let mut distances: Vec<f64> =
        pairs.iter().map(|pair| pair.one.translation.distance(pair.other.translation)).collect();
    distances.sort_by(f64::total_cmp);
    let [nearest_mm, distance_mm, farthest_mm] = [1, 5, 9].map(|tenth| distances[(distances.len() - 1) * tenth / 10]);
    // A stronger distortion cannot be mapped.
    if farthest_mm - nearest_mm > (0.25 * distance_mm).max(20.0 * options.limit_mm) {
        return Err(TrackerError::Loose { nearest_mm, farthest_mm }.into());
    }
    let relative: Vec<DAffine3> = pairs.iter().map(|pair| pair.one.inverse() * pair.other).collect();
    let one_from_other = piece(&relative);
    let errors: Vec<[f64; 2]> = relative.iter().map(|seen| error(&one_from_other, seen)).collect();

    let mut cells: BTreeMap<[i64; 3], Vec<usize>> = BTreeMap::new();
    for (index, pair) in pairs.iter().enumerate() {
        let [x, y, z] = (middle(pair) / options.cell_mm).floor().to_array();
        #[allow(clippy::cast_possible_truncation, reason = "a room's cells are few")]
        cells.entry([z as i64, y as i64, x as i64]).or_default().push(index);
    }
    let cells: Vec<Cell> = cells
        .into_iter()
        .filter(|(_, members)| members.len() >= LEAST_IN_CELL)
        .map(|([z, y, x], members)| {
            let own: Vec<[f64; 2]> = members.iter().map(|index| errors[*index]).collect();
            Cell {
                low_mm: DVec3::new(x as f64, y as f64, z as f64) * options.cell_mm,
                pairs: own.len(),
                rms_mm: rms(own.iter().map(|[mm, _]| *mm)),
                most_mm: own.iter().map(|[mm, _]| *mm).fold(0.0, f64::max),
                rms_deg: rms(own.iter().map(|[_, turn]| turn.to_degrees())),
            }
        })
        .collect();
    let mut zones: Vec<usize> = (0..cells.len()).filter(|cell| cells[*cell].rms_mm > options.limit_mm).collect();
    zones.sort_by(|a, b| cells[*b].rms_mm.total_cmp(&cells[*a].rms_mm));
    Ok(Map {
        pairs: pairs.len(),
        distance_mm,
        one_from_other,
        rms_mm: rms(errors.iter().map(|[mm, _]| *mm)),
        most_mm: errors.iter().map(|[mm, _]| *mm).fold(0.0, f64::max),
        rms_deg: rms(errors.iter().map(|[_, turn]| turn.to_degrees())),
        distance_rms_mm: rms(distances.iter().map(|distance| distance - distance_mm)),
        cell_mm: options.cell_mm,
        cells,
        zones,
    })
}

/// Returns the piece's transform by iteratively reweighted means, in mm and rad.
fn piece(relative: &[DAffine3]) -> DAffine3 {
    let mut found = DAffine3 {
        matrix3: mean_rotation(relative),
        translation: mean(relative.iter().map(|seen| seen.translation), relative.len() as f64),
    };
    for _ in 0..ROUNDS {
        let (mut shift, mut turn, mut weights) = (DVec3::ZERO, DVec3::ZERO, [0.0; 2]);
        for seen in relative {
            let [mm, rad] = error(&found, seen);
            // Errors below a thousandth have equal weight.
            let weight = [1.0 / mm.max(1e-3), 1.0 / rad.max(1e-5)];
            shift += (seen.translation - found.translation) * weight[0];
            turn += turned(&found, seen) * weight[1];
            weights = [weights[0] + weight[0], weights[1] + weight[1]];
        }
        let step = DQuat::from_scaled_axis(turn / weights[1]);
        found = DAffine3 {
            matrix3: glam::DMat3::from_quat(step) * found.matrix3,
            translation: found.translation + shift / weights[0],
        };
    }
    found
}

/// Returns the errors of the other sensor's position, mm, and rotation, rad.
fn error(piece: &DAffine3, seen: &DAffine3) -> [f64; 2] {
    [seen.translation.distance(piece.translation), turned(piece, seen).length()]
}

fn turned(piece: &DAffine3, seen: &DAffine3) -> DVec3 {
    DQuat::from_mat3(&(seen.matrix3 * piece.matrix3.transpose())).to_scaled_axis()
}

fn rms(all: impl Iterator<Item = f64>) -> f64 {
    Spread::of(all).rms
}

#[cfg(test)]
mod tests {
    use glam::DMat3;

    use super::*;
    use crate::tests::noise::Noise;

    /// Simulates a piece carried through a room; metal displaces measurements within about 80
    /// mm of it.
    fn carried(metal: Option<DVec3>) -> Vec<Pair> {
        let mut noise = Noise::new(3);
        let piece = DAffine3::from_rotation_translation(DQuat::from_rotation_y(0.6), DVec3::new(120.0, 15.0, -8.0));
        let mut pairs = Vec::new();
        for step in 0..4000 {
            let t = f64::from(step) / 4000.0;
            let at = DVec3::new(600.0 * t - 300.0, 200.0 * (37.0 * t).sin(), 250.0 + 150.0 * (91.0 * t).cos());
            let one = DAffine3::from_rotation_translation(
                DQuat::from_euler(glam::EulerRot::ZYX, 5.0 * t, 0.5 * (11.0 * t).sin(), 3.0 * t),
                at,
            );
            let measured = |pose: DAffine3, noise: &mut Noise| {
                let bent = metal.map_or(DVec3::ZERO, |metal| {
                    let away = pose.translation - metal;
                    away.normalize() * 6.0 * (-(away.length() / 80.0).powi(2)).exp()
                });
                let turn = DQuat::from_scaled_axis(noise.vector(5e-4));
                DAffine3 {
                    matrix3: DMat3::from_quat(turn) * pose.matrix3,
                    translation: pose.translation + bent + noise.vector(0.05),
                }
            };
            pairs.push(Pair { one: measured(one, &mut noise), other: measured(one * piece, &mut noise) });
        }
        pairs
    }

    #[test]
    fn clean_room_has_no_zones_and_sensor_noise() {
        let found = map(&carried(None), &Options::default()).unwrap();
        assert!(found.zones.is_empty() && found.cells.len() > 20, "{:?}", found.zones);
        assert!((found.one_from_other.translation - DVec3::new(120.0, 15.0, -8.0)).length() < 0.02);
        // Two positions of 0.05 mm along each axis, and 0.0005 rad about two axes at 121 mm.
        let expected = (3.0 * 2.0 * 0.05_f64.powi(2) + 2.0 * (5e-4 * 121.2_f64).powi(2)).sqrt();
        assert!((found.rms_mm / expected - 1.0).abs() < 0.05, "{} {expected}", found.rms_mm);
        assert!((found.distance_rms_mm / (2.0_f64.sqrt() * 0.05) - 1.0).abs() < 0.05, "{}", found.distance_rms_mm);
    }

    #[test]
    fn metal_is_located_without_biasing_piece() {
        let metal = DVec3::new(120.0, 0.0, 250.0);
        let found = map(&carried(Some(metal)), &Options::default()).unwrap();
        assert!(
            (found.one_from_other.translation - DVec3::new(120.0, 15.0, -8.0)).length() < 0.15,
            "{:?}",
            found.one_from_other
        );
        assert!(!found.zones.is_empty());
        for zone in &found.zones {
            let middle = found.cells[*zone].low_mm + DVec3::splat(25.0);
            // Either sensor may be in the distorted region, and they are 60 mm from their
            // midpoint.
            assert!(middle.distance(metal) < 60.0 + 2.0 * 80.0 + 45.0, "{middle}");
        }
        let far = |cell: &&Cell| (cell.low_mm + DVec3::splat(25.0)).distance(metal) > 300.0;
        assert!(found.cells.iter().filter(far).all(|cell| cell.rms_mm < 0.4));
        assert!(found.zones.windows(2).all(|pair| found.cells[pair[0]].rms_mm >= found.cells[pair[1]].rms_mm));
    }

    #[test]
    fn few_pairs_static_piece_or_loose_sensors_are_refused() {
        let pairs = carried(None);
        assert_eq!(
            map(&pairs[..20], &Options::default()),
            Err(TrackerError::FewPairs { pairs: 20, least: LEAST }.into())
        );
        let still = vec![pairs[0]; 40];
        let still = map(&still, &Options::default()).map(drop);
        assert!(matches!(still, Err(CalibrationError::Tracker(TrackerError::Still { mm: 0.0, .. }))), "{still:?}");
        let loose: Vec<Pair> =
            pairs.iter().zip(pairs.iter().rev()).map(|(a, b)| Pair { one: a.one, other: b.other }).collect();
        assert!(matches!(map(&loose, &Options::default()), Err(CalibrationError::Tracker(TrackerError::Loose { .. }))));
    }
}
