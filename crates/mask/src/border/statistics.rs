//! Each pixel's mean and variance over the first frames.

use sonoweave_core::slice::{Image, Pixels};

use super::plane::Plane;

/// Sums over frames, per pixel.
#[derive(Debug)]
pub(crate) struct FrameSums {
    sums: Vec<f32>,
    squares: Vec<f32>,
    frames: u16,
    /// Least and largest value of frames that have not 8 bits.
    range: Option<[f32; 2]>,
}

/// Mean and variance over the frames, in levels of 8-bit frames.
pub(super) struct Moments {
    pub(super) mean: Plane,
    /// `None` of a single frame.
    pub(super) variance: Option<Plane>,
}

impl FrameSums {
    /// Returns sums for frames of so many pixels.
    pub(crate) fn new(pixels: usize) -> Self {
        Self { sums: vec![0.0; pixels], squares: vec![0.0; pixels], frames: 0, range: None }
    }

    /// Adds a frame.
    pub(crate) fn push(&mut self, image: &Image) {
        self.frames += 1;
        match image.pixels() {
            Pixels::U8(pixels) => self.add(pixels.iter().map(|&p| f32::from(p))),
            Pixels::U16(pixels) => self.add_ranged(pixels.iter().map(|&p| f32::from(p))),
            Pixels::F32(pixels) => self.add_ranged(pixels.iter().map(|&p| if p.is_finite() { p } else { 0.0 })),
        }
    }

    fn add(&mut self, pixels: impl Iterator<Item = f32>) {
        for ((sum, square), p) in self.sums.iter_mut().zip(&mut self.squares).zip(pixels) {
            *sum += p;
            *square += p * p;
        }
    }

    fn add_ranged(&mut self, pixels: impl Iterator<Item = f32> + Clone) {
        let [low, high] = self.range.unwrap_or([f32::INFINITY, f32::NEG_INFINITY]);
        let range = pixels.clone().fold([low, high], |[low, high], p| [low.min(p), high.max(p)]);
        self.range = Some(range);
        self.add(pixels);
    }

    /// Removes all frames.
    pub(crate) fn clear(&mut self) {
        self.sums.fill(0.0);
        self.squares.fill(0.0);
        (self.frames, self.range) = (0, None);
    }

    /// Returns the moments of a part of the frames, which are `width` pixels wide: columns
    /// `x..x + size[0]`, rows `y..y + size[1]`.
    pub(super) fn moments(&self, width: usize, [x, y]: [usize; 2], size: [usize; 2]) -> Moments {
        let part = |values: &[f32]| -> Vec<f32> {
            (y..y + size[1]).flat_map(|row| &values[row * width + x..][..size[0]]).copied().collect()
        };
        let (low, scale) = match self.range {
            Some([low, high]) if high > low => (low, 255.0 / (high - low)),
            Some([low, _]) => (low, 1.0),
            None => (0.0, 1.0),
        };
        let count = f32::from(self.frames.max(1));
        let (sums, mut squares) = (part(&self.sums), part(&self.squares));
        for (square, sum) in squares.iter_mut().zip(&sums) {
            let variance = (*square - sum * sum / count) / (count - 1.0).max(1.0);
            *square = variance.max(0.0) * scale * scale;
        }
        let mean = sums.into_iter().map(|sum| (sum / count - low) * scale).collect();
        let plane = |values| Plane { width: size[0], height: size[1], values };
        Moments { mean: plane(mean), variance: (self.frames > 1).then(|| plane(squares)) }
    }
}
