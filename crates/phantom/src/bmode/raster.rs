//! The raster: echoes by beam and range.

use super::Layout;

/// Complex amplitudes, a row for each range, a column for each beam.
#[derive(Debug, Clone)]
pub(super) struct Raster {
    re: Vec<f32>,
    im: Vec<f32>,
    columns: usize,
}

impl Raster {
    pub(super) fn new(layout: &Layout) -> Self {
        let none = vec![0.0; layout.rows * layout.columns];
        Self { re: none.clone(), im: none, columns: layout.columns }
    }

    pub(super) fn clear(&mut self) {
        self.re.fill(0.0);
        self.im.fill(0.0);
    }

    /// Returns the real and the imaginary parts.
    pub(super) fn both(&mut self) -> [&mut [f32]; 2] {
        [&mut self.re, &mut self.im]
    }

    /// Adds an echo between four nodes, in proportion to its nearness to each. `column` and
    /// `row` must not be the last ones.
    #[inline(always)]
    pub(super) fn put(
        &mut self,
        [column, row]: [usize; 2],
        [right, down]: [f32; 2],
        [re, im]: [f32; 2],
        strength: f32,
    ) {
        let [upper, lower] = [strength * (1.0 - down), strength * down];
        let i = row * self.columns + column;
        for (i, part) in [(i, upper), (i + self.columns, lower)] {
            let [left, right] = [part * (1.0 - right), part * right];
            self.re[i] += left * re;
            self.im[i] += left * im;
            self.re[i + 1] += right * re;
            self.im[i + 1] += right * im;
        }
    }

    /// Adds an echo of one beam between two rows.
    pub(super) fn put_in_column(&mut self, column: usize, row: usize, down: f32, [re, im]: [f32; 2], strength: f32) {
        for (row, part) in [(row, strength * (1.0 - down)), (row + 1, strength * down)] {
            let i = row * self.columns + column;
            self.re[i] += part * re;
            self.im[i] += part * im;
        }
    }
}
