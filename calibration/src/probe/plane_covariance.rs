//! Covariance of an image plane's numbers: checked, as independent components, and as the error
//! of a pixel's position.

use glam::DVec2;
use nalgebra::{SMatrix, SymmetricEigen};

use super::plane::{ImagePlane, NUMBERS, PLANE};
use crate::error::CovarianceError;

/// The first numbers, rotations and position, which every calibration finds.
const POSE: usize = 6;
/// Largest standard deviation of each number: rad, mm, relative. The plane's error is linear in
/// its numbers only below.
const MOST: [f64; NUMBERS] = [0.3, 0.3, 0.3, 30.0, 30.0, 30.0, 0.3, 0.3, 0.3];
/// Rounding that is no contradiction, relative to the standard deviations.
const ROUNDING: f64 = 1e-6;

/// The covariance of the numbers of [`PLANE`]; 0 for numbers that were not fitted.
#[derive(Debug, Clone, PartialEq)]
pub struct PlaneCovariance {
    pivot_px: DVec2,
    entries: [[f64; NUMBERS]; NUMBERS],
}

impl PlaneCovariance {
    /// Checks a covariance of these numbers, one row for each. Rotations are about `pivot_px`,
    /// whose position the plane's place is.
    ///
    /// # Errors
    /// [`CovarianceError`]: unknown, repeated or missing numbers, or rows that are not the
    /// covariance of any.
    pub fn new(pivot_px: [f64; 2], parameters: &[String], rows: &[Vec<f64>]) -> Result<Self, CovarianceError> {
        let mut places = Vec::with_capacity(parameters.len());
        for name in parameters {
            let Some(place) = PLANE.iter().position(|known| known == name) else {
                return Err(CovarianceError::Unknown { name: name.clone() });
            };
            if places.contains(&place) {
                return Err(CovarianceError::Repeated { name: PLANE[place] });
            }
            places.push(place);
        }
        if let Some(missing) = (0..POSE).find(|place| !places.contains(place)) {
            return Err(CovarianceError::Missing { name: PLANE[missing] });
        }
        if rows.len() != places.len() || rows.iter().any(|row| row.len() != places.len()) {
            return Err(CovarianceError::Shape { count: places.len() });
        }
        let mut entries = [[0.0; NUMBERS]; NUMBERS];
        for (row, i) in rows.iter().zip(&places) {
            row.iter().zip(&places).for_each(|(entry, j)| entries[*i][*j] = *entry);
        }
        Self::of_fit(DVec2::from_array(pivot_px), entries)
    }

    /// Checks the covariance of a fit, in the order of [`PLANE`].
    ///
    /// # Errors
    /// [`CovarianceError`] for entries that are not a covariance, or too large.
    pub fn of_fit(pivot_px: DVec2, entries: [[f64; NUMBERS]; NUMBERS]) -> Result<Self, CovarianceError> {
        if !pivot_px.is_finite() || entries.iter().flatten().any(|entry| !entry.is_finite()) {
            return Err(CovarianceError::NotFinite);
        }
        for (place, most) in MOST.into_iter().enumerate() {
            let variance = entries[place][place];
            if variance < 0.0 {
                return Err(CovarianceError::NotPositive);
            }
            if variance > most * most {
                return Err(CovarianceError::Large { name: PLANE[place], sd: variance.sqrt(), most });
            }
        }
        let sds = std::array::from_fn::<_, NUMBERS, _>(|i| entries[i][i].sqrt());
        for (i, j) in (0..NUMBERS).flat_map(|i| (0..i).map(move |j| (i, j))) {
            if (entries[i][j] - entries[j][i]).abs() > ROUNDING * sds[i] * sds[j] {
                return Err(CovarianceError::Asymmetric { row: PLANE[i], column: PLANE[j] });
            }
        }
        let covariance = Self { pivot_px, entries };
        let (eigen, _) = covariance.correlations();
        if eigen.eigenvalues.iter().any(|value| *value < -ROUNDING) {
            return Err(CovarianceError::NotPositive);
        }
        Ok(covariance)
    }

    /// Returns the covariance of numbers that are exactly known.
    pub fn exact() -> Self {
        Self { pivot_px: DVec2::ZERO, entries: [[0.0; NUMBERS]; NUMBERS] }
    }

    /// Returns the pixel about which rotations turn.
    pub fn pivot_px(&self) -> DVec2 {
        self.pivot_px
    }

    /// Returns names of the numbers that a file lists, and their rows: those of the pose, and the
    /// others that were fitted.
    pub fn listed(&self) -> (Vec<&'static str>, Vec<Vec<f64>>) {
        let places: Vec<usize> =
            (0..NUMBERS).filter(|place| *place < POSE || self.entries[*place][*place] > 0.0).collect();
        let row = |i: &usize| places.iter().map(|j| self.entries[*i][*j]).collect();
        (places.iter().map(|place| PLANE[*place]).collect(), places.iter().map(row).collect())
    }

    /// Returns the entries in the order of [`PLANE`].
    pub fn entries(&self) -> &[[f64; NUMBERS]; NUMBERS] {
        &self.entries
    }

    /// Returns independent errors of the numbers, each of one standard deviation: the sum of
    /// their outer products is the covariance.
    pub fn components(&self) -> Vec<[f64; NUMBERS]> {
        let (eigen, sds) = self.correlations();
        let columns = eigen.eigenvectors.column_iter().zip(eigen.eigenvalues.iter()).filter(|(_, value)| **value > 0.0);
        columns.map(|(axis, value)| std::array::from_fn(|i| axis[i] * value.sqrt() * sds[i])).collect()
    }

    /// Returns the standard deviation of a pixel's position: the root of the sum of the three
    /// axes' variances, mm.
    pub fn sd_mm(&self, plane: &ImagePlane, px: DVec2) -> f64 {
        let changes = plane.changes(self.pivot_px, px);
        let pairs = (0..NUMBERS).flat_map(|i| (0..NUMBERS).map(move |j| (i, j)));
        pairs.map(|(i, j)| self.entries[i][j] * changes[i].dot(changes[j])).sum::<f64>().max(0.0).sqrt()
    }

    /// Returns [`sd_mm`](Self::sd_mm) at the centre of an image of this size, and the largest at
    /// its corners.
    pub fn ends_mm(&self, plane: &ImagePlane, size_px: [u32; 2]) -> [f64; 2] {
        let [u, v] = size_px.map(|n| f64::from(n) - 1.0);
        let corners = [[0.0, 0.0], [u, 0.0], [0.0, v], [u, v]].map(|px| self.sd_mm(plane, DVec2::from_array(px)));
        [self.sd_mm(plane, DVec2::new(0.5 * u, 0.5 * v)), corners.into_iter().fold(0.0, f64::max)]
    }

    /// Returns the axes of the correlations, and the standard deviations.
    fn correlations(&self) -> (SymmetricEigen<f64, nalgebra::Const<NUMBERS>>, [f64; NUMBERS]) {
        let sds = std::array::from_fn(|i| self.entries[i][i].max(0.0).sqrt());
        let correlation = |i: usize, j: usize| {
            // A number without an error has covariance 0; any other entry contradicts it.
            let size = if sds[i] > 0.0 && sds[j] > 0.0 { sds[i] * sds[j] } else { 1.0 };
            0.5 * (self.entries[i][j] + self.entries[j][i]) / size
        };
        (SymmetricEigen::new(SMatrix::<f64, NUMBERS, NUMBERS>::from_fn(correlation)), sds)
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::tests::noise::Noise;

    fn names(count: usize) -> Vec<String> {
        PLANE[..count].iter().map(|name| (*name).to_owned()).collect()
    }

    /// Returns a covariance with correlations, of sizes like a calibration's.
    fn rows(count: usize) -> Vec<Vec<f64>> {
        let mut random = Noise::new(3);
        let factor: Vec<Vec<f64>> = (0..count).map(|_| (0..count).map(|_| random.normal()).collect()).collect();
        let size = |i: usize| if (3..6).contains(&i) { 0.1 } else { 0.002 };
        let entry = |i: usize, j: usize| -> f64 {
            size(i) * size(j) * factor[i].iter().zip(&factor[j]).map(|(a, b)| a * b).sum::<f64>()
        };
        (0..count).map(|i| (0..count).map(|j| entry(i, j)).collect()).collect()
    }

    #[test]
    fn components_sum_to_covariance_and_rows_are_listed() {
        for count in [6, 8, 9] {
            let covariance = PlaneCovariance::new([410.0, 308.0], &names(count), &rows(count)).unwrap();
            let components = covariance.components();
            for (i, j) in (0..NUMBERS).flat_map(|i| (0..NUMBERS).map(move |j| (i, j))) {
                let sum: f64 = components.iter().map(|one| one[i] * one[j]).sum();
                let entry = covariance.entries()[i][j];
                assert!((sum - entry).abs() < 1e-12, "{count} {i} {j}: {sum} {entry}");
            }
            let (listed, same) = covariance.listed();
            assert_eq!((listed, same), (PLANE[..count].to_vec(), rows(count)));
        }
        let exact = PlaneCovariance::exact();
        assert_eq!((exact.components().len(), exact.listed().0.len()), (0, POSE));
    }

    #[test]
    fn position_error_matches_moved_planes() {
        let plane =
            ImagePlane { u: DVec3::X * 0.08, v: DVec3::new(0.0, 0.06, 0.04), origin: DVec3::new(5.0, 1.0, 2.0) };
        let covariance = PlaneCovariance::new([410.0, 308.0], &names(8), &rows(8)).unwrap();
        for px in [DVec2::ZERO, DVec2::new(410.0, 308.0), DVec2::new(819.0, 40.0)] {
            let changes = plane.changes(covariance.pivot_px(), px);
            let shift = |one: &[f64; NUMBERS]| one.iter().zip(changes).map(|(x, by)| by * *x).sum::<DVec3>();
            let square: f64 = covariance.components().iter().map(|one| shift(one).length_squared()).sum();
            assert!((covariance.sd_mm(&plane, px) - square.sqrt()).abs() < 1e-9);
        }
    }

    #[test]
    fn rows_that_are_no_covariance_are_refused() {
        let of = |names: &[String], rows: &[Vec<f64>]| PlaneCovariance::new([410.0, 308.0], names, rows).unwrap_err();
        let changed = |i: usize, j: usize, to: f64| {
            let mut rows = rows(8);
            rows[i][j] = to;
            of(&names(8), &rows)
        };
        let mut other = names(8);
        other[7] = "pixel along w".into();
        assert_eq!(of(&other, &rows(8)), CovarianceError::Unknown { name: "pixel along w".into() });
        other[7] = names(7)[6].clone();
        assert_eq!(of(&other, &rows(8)), CovarianceError::Repeated { name: PLANE[6] });
        assert_eq!(of(&names(5), &rows(5)), CovarianceError::Missing { name: PLANE[5] });
        assert_eq!(of(&names(8), &rows(7)), CovarianceError::Shape { count: 8 });
        let mut short = rows(8);
        short[3].pop();
        assert_eq!(of(&names(8), &short), CovarianceError::Shape { count: 8 });
        for bad in [f64::NAN, f64::INFINITY] {
            assert_eq!(changed(2, 3, bad), CovarianceError::NotFinite);
        }
        assert_eq!(changed(4, 1, 0.5), CovarianceError::Asymmetric { row: PLANE[4], column: PLANE[1] });
        assert_eq!(changed(0, 0, -1e-9), CovarianceError::NotPositive);
        // A variance far below what the covariances require.
        assert_eq!(changed(3, 3, 1e-6), CovarianceError::NotPositive);
        assert_eq!(changed(4, 4, 1e6), CovarianceError::Large { name: PLANE[4], sd: 1000.0, most: 30.0 });
        let nowhere = PlaneCovariance::new([f64::NAN, 0.0], &names(8), &rows(8));
        assert_eq!(nowhere, Err(CovarianceError::NotFinite));
    }
}
