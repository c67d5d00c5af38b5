//! Displacement of tissue over depth in one image, and an image without it.

use serde::{Deserialize, Serialize};

use crate::error::PressureError;

/// Displacement of tissue along v by the probe's pressure, over depth, in one image.
///
/// Tissue that lies at depth v without pressure is shown at v + d(v). Between knots, d is linear;
/// beyond them, it is that of the last one. Depth increases from one knot to the next, and so does
/// v + d(v): tissue does not fold.
///
/// In the image of a curved probe, columns are not beams. Displacement along v is then an
/// approximation, best in the middle of the fan.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Vec<[f64; 2]>", into = "Vec<[f64; 2]>")]
pub struct Compression {
    knots_mm: Vec<[f64; 2]>,
}

/// An image in which tissue lies where light contact shows it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Undone {
    /// Grey values, u fastest; without data, those of the image before.
    pub pixels: Vec<u8>,
    /// Marks pixels with data: those whose tissue the image shows.
    pub is_data: Vec<bool>,
}

impl TryFrom<Vec<[f64; 2]>> for Compression {
    type Error = PressureError;

    fn try_from(knots_mm: Vec<[f64; 2]>) -> Result<Self, PressureError> {
        Self::new(knots_mm)
    }
}

impl From<Compression> for Vec<[f64; 2]> {
    fn from(compression: Compression) -> Self {
        compression.knots_mm
    }
}

impl Compression {
    /// Makes one of knots: depth below the image's first row with data, and displacement d towards
    /// greater depth, mm.
    ///
    /// # Errors
    /// [`PressureError::Knots`] without knots, or unless depth and v + d(v) are finite and increase
    /// from each knot to the next.
    pub fn new(knots_mm: Vec<[f64; 2]>) -> Result<Self, PressureError> {
        let is_finite = knots_mm.iter().flatten().all(|mm| mm.is_finite());
        let rises = |of: fn(&[f64; 2]) -> f64| knots_mm.windows(2).all(|pair| of(&pair[0]) < of(&pair[1]));
        if !is_finite || knots_mm.is_empty() || !rises(|[v, _]| *v) || !rises(|[v, d]| v + d) {
            return Err(PressureError::Knots { knots: knots_mm.len() });
        }
        Ok(Self { knots_mm })
    }

    /// Returns the knots: depth below the image's first row with data, and displacement, mm.
    pub fn knots_mm(&self) -> &[[f64; 2]] {
        &self.knots_mm
    }

    /// Returns the displacement of tissue at a depth, mm.
    pub fn displacement_mm(&self, depth_mm: f64) -> f64 {
        let knots = &self.knots_mm;
        let next = knots.partition_point(|[v, _]| *v <= depth_mm);
        match (next.checked_sub(1).map(|last| knots[last]), knots.get(next)) {
            (Some([v, d]), Some([w, e])) => d + (e - d) * (depth_mm - v) / (w - v),
            (Some([_, d]), None) | (None, Some(&[_, d])) => d,
            (None, None) => 0.0,
        }
    }

    /// Returns the depth at which the image shows tissue of a depth, mm.
    pub fn shown_mm(&self, depth_mm: f64) -> f64 {
        depth_mm + self.displacement_mm(depth_mm)
    }

    /// Returns the compression that undoes this one.
    #[must_use]
    pub fn inverse(&self) -> Self {
        Self { knots_mm: self.knots_mm.iter().map(|[v, d]| [v + d, -d]).collect() }
    }

    /// Resamples an image of any resolution along v, so that tissue lies where light contact shows
    /// it. `is_data` marks the pixels that hold data, of rows of `width` pixels that are
    /// `mm_per_row` apart. Pixels whose tissue lies outside of the data become no data.
    ///
    /// # Panics
    /// Panics if `pixels` and `is_data` are not whole rows of one image.
    pub fn undone(&self, pixels: &[u8], is_data: &[bool], width: usize, mm_per_row: f64) -> Undone {
        assert!(pixels.len() == is_data.len() && pixels.len().is_multiple_of(width), "flags and pixels of whole rows");
        let height = pixels.len() / width;
        let mut undone = Undone { pixels: pixels.to_vec(), is_data: vec![false; pixels.len()] };
        let top = is_data.iter().position(|is| *is).map_or(0, |at| at / width);
        for v in top..height {
            let source = v as f64 + self.displacement_mm((v - top) as f64 * mm_per_row) / mm_per_row;
            if !(source >= 0.0 && source <= (height - 1) as f64) {
                continue;
            }
            let (above, part) = (source as usize, source.fract());
            // A row on the image's last one has none below.
            let below = if part > 0.0 { above + 1 } else { above };
            for u in 0..width {
                let [at, a, b] = [v, above, below].map(|row| row * width + u);
                if is_data[a] && is_data[b] {
                    let grey = (1.0 - part) * f64::from(pixels[a]) + part * f64::from(pixels[b]);
                    undone.pixels[at] = grey.round() as u8;
                    undone.is_data[at] = true;
                }
            }
        }
        undone
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pressed() -> Compression {
        Compression::new(vec![[0.0, 1.5], [4.0, 1.1], [10.0, 0.4], [30.0, 0.0]]).unwrap()
    }

    #[test]
    fn knots_rise_in_depth_before_and_after() {
        let refused = |knots: &[[f64; 2]]| Compression::new(knots.to_vec()).is_err();
        assert!(refused(&[]) && refused(&[[0.0, f64::NAN]]) && refused(&[[f64::INFINITY, 0.0]]));
        assert!(refused(&[[1.0, 0.0], [1.0, 0.0]]) && refused(&[[2.0, 0.0], [1.0, 0.0]]));
        assert!(refused(&[[0.0, 2.0], [1.5, 0.5]]), "tissue would fold");
        assert!(!refused(&[[0.0, 2.0], [1.6, 0.5]]));
        let knots: Vec<[f64; 2]> = pressed().into();
        assert_eq!(Compression::try_from(knots), Ok(pressed()));
    }

    #[test]
    fn displacement_is_linear_between_knots() {
        let by = pressed();
        for (v, d) in
            [(-3.0, 1.5), (0.0, 1.5), (2.0, 1.3), (4.0, 1.1), (7.0, 0.75), (20.0, 0.2), (30.0, 0.0), (99.0, 0.0)]
        {
            assert!((by.displacement_mm(v) - d).abs() < 1e-12, "{v}");
        }
    }

    #[test]
    fn inverse_returns_tissue_to_its_depth() {
        let (by, back) = (pressed(), pressed().inverse());
        for v in (-20..400).map(|k| 0.1 * f64::from(k)) {
            assert!((back.shown_mm(by.shown_mm(v)) - v).abs() < 1e-12, "{v}");
        }
    }

    /// An image of a smooth pattern, 3 columns wide.
    fn image(of: impl Fn(f64) -> f64) -> Vec<u8> {
        (0..3 * 400).map(|at| of(0.1 * f64::from(at / 3)).round() as u8).collect()
    }

    #[test]
    fn undone_image_shows_tissue_at_its_depth() {
        let pattern = |v: f64| 128.0 + 100.0 * (0.9 * v).sin();
        let (by, back) = (pressed(), pressed().inverse());
        // Tissue of depth v is shown at v + d(v).
        let shown = image(|v| pattern(back.shown_mm(v)));
        let undone = by.undone(&shown, &[true; 1200], 3, 0.1);
        let off = |pixels: &[u8], row: usize| (f64::from(pixels[3 * row]) - pattern(0.1 * row as f64)).abs();
        assert!((0..400).all(|row| undone.is_data[3 * row] && off(&undone.pixels, row) < 1.5));
        assert!(off(&shown, 5) > 20.0, "the image before differs");
    }

    #[test]
    fn correction_and_its_inverse_return_the_image() {
        let before = image(|v| 128.0 + 100.0 * (0.9 * v).sin());
        let once = pressed().undone(&before, &[true; 1200], 3, 0.1);
        let twice = pressed().inverse().undone(&once.pixels, &once.is_data, 3, 0.1);
        // Rows above the depth to which the skin is pressed are not returned.
        let rows: Vec<usize> = (0..400).filter(|row| twice.is_data[3 * row]).collect();
        assert_eq!(rows, (15..400).collect::<Vec<_>>());
        let square: f64 =
            rows.iter().map(|row| (f64::from(twice.pixels[3 * row]) - f64::from(before[3 * row])).powi(2)).sum();
        let rms = (square / rows.len() as f64).sqrt();
        assert!(rms < 0.02 * 100.0, "{rms} of 100 grey levels");
    }

    #[test]
    fn pixels_from_beyond_data_become_no_data() {
        // Data begin in row 2, whose depth is 0; the last column has none.
        let pixels: Vec<u8> = (0..24).map(|at| 10 * (at / 3)).collect();
        let is_data: Vec<bool> = (0..24).map(|at| at / 3 >= 2 && at % 3 < 2).collect();
        let shift = |mm: f64| Compression::new(vec![[0.0, mm]]).unwrap().undone(&pixels, &is_data, 3, 0.5);
        let rows = |undone: &Undone| (0..8).filter(|row| undone.is_data[3 * row]).collect::<Vec<_>>();
        let deeper = shift(0.75);
        assert_eq!(rows(&deeper), [2, 3, 4, 5]);
        assert_eq!((2..6).map(|row| deeper.pixels[3 * row]).collect::<Vec<_>>(), [35, 45, 55, 65]);
        assert_eq!(deeper.pixels[21], 70, "without data, the grey value stays");
        assert_eq!(rows(&shift(-1.0)), [4, 5, 6, 7]);
        assert!((0..8).all(|row| !deeper.is_data[3 * row + 2]));
        let none = shift(0.0);
        assert_eq!((none.pixels, none.is_data), (pixels.clone(), is_data.clone()));
    }
}
