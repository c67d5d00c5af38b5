//! The shift of tissue in depth from one image to the next.
//!
//! An image I that is shifted by d along v changes by −d ∂I/∂v, so that the least-squares shift is
//! −Σ ∂I/∂v ΔI / Σ (∂I/∂v)², over all pixels. Images are reduced before, so that the shift is less
//! than a pixel, and speckle is averaged out.

/// Size of a reduced pixel, mm.
const PIXEL_MM: f64 = 1.6;

/// The images of a recording, one after the other.
#[derive(Debug, Clone)]
pub struct DepthShift {
    /// Size of a pixel, mm.
    pixel_mm: [f64; 2],
    last: Option<Reduced>,
}

#[derive(Debug, Clone)]
struct Reduced {
    size: [usize; 2],
    values: Vec<f64>,
}

impl DepthShift {
    /// Begins with images whose pixels have this size along u and v, mm.
    pub fn new(pixel_mm: [f64; 2]) -> Self {
        Self { pixel_mm, last: None }
    }

    /// Adds an image of grey values. Returns the shift since the last one, mm, away from the
    /// transducer; 0 for the first, for one of another size, and where nothing tells a shift.
    pub fn add(&mut self, pixels: &[u8], width: usize) -> f64 {
        let new = self.reduced(pixels, width);
        let last = self.last.replace(new);
        let (Some(last), Some(new)) = (&last, &self.last) else { return 0.0 };
        if last.size != new.size {
            return 0.0;
        }
        let [columns, rows] = new.size;
        let [mut slope_change, mut slope_squares] = [0.0; 2];
        for v in 1..rows.saturating_sub(1) {
            for u in 0..columns {
                let at = |v: usize| 0.5 * (last.values[v * columns + u] + new.values[v * columns + u]);
                let slope = 0.5 * (at(v + 1) - at(v - 1));
                slope_change += slope * (new.values[v * columns + u] - last.values[v * columns + u]);
                slope_squares += slope * slope;
            }
        }
        if slope_squares > 0.0 { -slope_change / slope_squares * self.reduced_mm() } else { 0.0 }
    }

    fn block(&self) -> [usize; 2] {
        self.pixel_mm.map(|mm| ((PIXEL_MM / mm).round() as usize).max(1))
    }

    /// Returns the size of a reduced pixel along v, mm.
    fn reduced_mm(&self) -> f64 {
        self.block()[1] as f64 * self.pixel_mm[1]
    }

    /// Returns the means of blocks of pixels.
    fn reduced(&self, pixels: &[u8], width: usize) -> Reduced {
        let [block_u, block_v] = self.block();
        let height = pixels.len().checked_div(width).unwrap_or(0);
        let size = [width / block_u, height / block_v];
        let mean = |u: usize, v: usize| {
            let rows = (v * block_v..(v + 1) * block_v).flat_map(|row| {
                let begin = row * width + u * block_u;
                &pixels[begin..begin + block_u]
            });
            rows.map(|grey| f64::from(*grey)).sum::<f64>() / (block_u * block_v) as f64
        };
        let values = (0..size[1]).flat_map(|v| (0..size[0]).map(move |u| (u, v))).map(|(u, v)| mean(u, v));
        Reduced { size, values: values.collect() }
    }
}
