//! Distortion zones: the cells of a distortion map that are beyond its limit.

use std::fmt;

use glam::DVec3;

use sonoweave_core::date::Date;

use super::distortion::Map;

/// Tolerance of a cell's corner on the lattice, in cells.
const LATTICE: f64 = 1e-6;

/// A cell in which the sensor's poses are unreliable.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Zone {
    /// Its corner with the smallest coordinates, mm in the tracker's frame.
    pub low_mm: DVec3,
    /// Root mean square of the error in it, mm.
    pub rms_mm: f64,
}

impl Zone {
    /// Returns whether it is a cell of the lattice with this edge and a corner at the tracker's
    /// origin.
    pub fn is_cell(&self, cell_mm: f64) -> bool {
        let cells = self.low_mm / cell_mm;
        cells.is_finite() && (cells - cells.round()).abs().max_element() <= LATTICE
    }

    fn place(&self, cell_mm: f64) -> [i64; 3] {
        whole((self.low_mm / cell_mm).round())
    }
}

/// All zones, with their limit.
#[derive(Debug, Clone, PartialEq)]
pub struct Zones {
    cell_mm: f64,
    limit_mm: f64,
    measured: Option<Date>,
    /// Sorted by lattice position.
    zones: Vec<([i64; 3], Zone)>,
}

impl Zones {
    /// Takes cells with this edge (mm), each a [cell](Zone::is_cell) of the lattice; of
    /// duplicates the first is kept.
    pub fn new(cell_mm: f64, limit_mm: f64, measured: Option<Date>, zones: Vec<Zone>) -> Self {
        let mut zones: Vec<([i64; 3], Zone)> = zones.into_iter().map(|zone| (zone.place(cell_mm), zone)).collect();
        zones.sort_by_key(|(place, _)| *place);
        zones.dedup_by_key(|(place, _)| *place);
        Self { cell_mm, limit_mm, measured, zones }
    }

    /// Takes the zones of a map.
    pub fn of(map: &Map, limit_mm: f64, measured: Date) -> Self {
        let cell = |index: &usize| Zone { low_mm: map.cells[*index].low_mm, rms_mm: map.cells[*index].rms_mm };
        Self::new(map.cell_mm, limit_mm, Some(measured), map.zones.iter().map(cell).collect())
    }

    /// Returns the edge of the cells, mm.
    pub fn cell_mm(&self) -> f64 {
        self.cell_mm
    }

    /// Returns the error limit beyond which a cell is a zone, mm.
    pub fn limit_mm(&self) -> f64 {
        self.limit_mm
    }

    /// Returns the date of the map.
    pub fn measured(&self) -> Option<Date> {
        self.measured
    }

    /// Returns the number of zones.
    pub fn count(&self) -> usize {
        self.zones.len()
    }

    /// Returns all zones, by position.
    pub fn all(&self) -> impl Iterator<Item = &Zone> {
        self.zones.iter().map(|(_, zone)| zone)
    }

    /// Returns the zone that contains a position in the tracker's frame (mm). Lower faces
    /// belong to a cell.
    pub fn at(&self, place_mm: DVec3) -> Option<&Zone> {
        let place = whole((place_mm / self.cell_mm).floor());
        let found = self.zones.binary_search_by_key(&place, |(place, _)| *place).ok()?;
        Some(&self.zones[found].1)
    }
}

impl fmt::Display for Zones {
    /// Describes the zones for people: their number, cell size and limit.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.count() {
            0 => write!(f, "no cell of {} mm where the tracker errs by more than {} mm", self.cell_mm, self.limit_mm)?,
            1 => write!(f, "1 cell of {} mm where the tracker errs by more than {} mm", self.cell_mm, self.limit_mm)?,
            n => {
                write!(f, "{n} cells of {} mm where the tracker errs by more than {} mm", self.cell_mm, self.limit_mm)?
            }
        }
        self.measured.map_or(Ok(()), |day| write!(f, ", by the map of {day}"))
    }
}

/// Values beyond the range of whole numbers saturate, outside of all zones.
fn whole(cells: DVec3) -> [i64; 3] {
    cells.to_array().map(|x| x as i64)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn zones(lows: &[[f64; 3]]) -> Zones {
        let zone = |low: &[f64; 3]| Zone { low_mm: DVec3::from_array(*low), rms_mm: 2.0 };
        Zones::new(50.0, 1.0, None, lows.iter().map(zone).collect())
    }

    #[test]
    fn position_is_in_zone_of_its_cell() {
        let all = zones(&[[100.0, -50.0, 0.0], [-50.0, 0.0, 250.0], [100.0, -50.0, 50.0], [100.0, -50.0, 0.0]]);
        assert_eq!(all.count(), 3, "one was given twice");
        let at = |x, y, z| all.at(DVec3::new(x, y, z)).map(|zone| zone.low_mm.to_array());
        assert_eq!(at(100.0, -50.0, 0.0), Some([100.0, -50.0, 0.0]));
        assert_eq!(at(149.9, -0.1, 49.9), Some([100.0, -50.0, 0.0]));
        assert_eq!(at(149.9, -0.1, 50.0), Some([100.0, -50.0, 50.0]));
        assert_eq!(at(-0.001, 49.0, 299.0), Some([-50.0, 0.0, 250.0]));
        for beside in [[150.0, -1.0, 1.0], [120.0, 0.0, 1.0], [120.0, -1.0, -0.1], [0.0, 1.0, 251.0]] {
            assert_eq!(all.at(DVec3::from_array(beside)), None, "{beside:?}");
        }
        assert_eq!([at(f64::NAN, 0.0, 0.0), at(1e300, 0.0, 0.0)], [None, None]);
        // An edge that has no exact binary representation.
        let lows = (-40..40).map(|k| Zone { low_mm: DVec3::splat(f64::from(k) * 0.7), rms_mm: 2.0 }).collect();
        let fine = Zones::new(0.7, 1.0, None, lows);
        assert_eq!(fine.count(), 80);
        for k in -40..40 {
            let middle = DVec3::splat((f64::from(k) + 0.5) * 0.7);
            assert_eq!(fine.at(middle).unwrap().low_mm, DVec3::splat(f64::from(k) * 0.7));
        }
    }
}
