//! The light that reaches the places of a volume, on a lattice of half its resolution.

use crate::real::{Field, Real};

/// Light from the source in red, green and blue, and light from all sides, as shares of what
/// reaches open places. Cell i along an axis has its middle at region coordinate 2i + 0.5.
pub struct LightField {
    size: [usize; 3],
    cells: Vec<[f32; 4]>,
}

impl LightField {
    /// Creates the light of so many cells along each axis, x fastest.
    pub(crate) fn new(size: [usize; 3], cells: Vec<[f32; 4]>) -> Self {
        debug_assert_eq!(size.iter().product::<usize>(), cells.len());
        Self { size, cells }
    }

    /// Bytes held.
    pub(crate) fn bytes(&self) -> u64 {
        size_of_val(&*self.cells) as u64
    }
}

impl Field for LightField {
    /// Returns the light at a region position, interpolated between cells.
    #[inline(always)]
    fn at<T: Real>(&self, at: [T; 3]) -> [T; 4] {
        let half = T::from_f64(0.5);
        let (mut index, mut part) = ([[0; 2]; 3], [T::ZERO; 3]);
        for a in 0..3 {
            let last = (self.size[a] - 1) as f64;
            let place = ((at[a] - half) * half).max(T::ZERO).min(T::from_f64(last));
            let floor = place.whole();
            index[a] = [floor, (floor + 1).min(self.size[a] - 1)];
            part[a] = place - T::from_f64(floor as f64);
        }
        let mut sum = [T::ZERO; 4];
        for corner in 0..8_usize {
            let (mut share, mut cell) = (T::ONE, 0);
            for a in (0..3).rev() {
                let upper = corner >> a & 1;
                share = share * if upper == 1 { part[a] } else { T::ONE - part[a] };
                cell = cell * self.size[a] + index[a][upper];
            }
            for (sum, of) in sum.iter_mut().zip(self.cells[cell]) {
                *sum = T::from_f64(f64::from(of)).mul_add(share, *sum);
            }
        }
        sum
    }
}
