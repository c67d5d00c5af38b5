//! Slices whose images are blurred, by a kernel of fourth order.
//!
//! Each slice is blurred within its own plane. After a Gaussian, two slices differ along their
//! line by half its variance times a difference of curvatures: those of the body across the line,
//! in one plane and in the other. Less half the variance times the Laplacian, the kernel has no
//! second moment, and that difference is gone.

use std::ops::Range;

use crate::slices::Slices;

/// Variance of the smoothing that slices have already, square pixels.
const SMOOTHED: f64 = 1.0;
/// Smallest standard deviation, pixels. Interpolation averages noise between pixels but not at
/// them: in images blurred by less, slices agree best when their lines fall between pixels, which
/// falsifies the scale.
const LEAST_PX: f64 = 1.6;
/// Where the kernel ends, standard deviations.
const REACH: f64 = 3.0;

/// Returns the images, blurred by about a factor times a standard deviation.
pub(super) fn blurred(slices: &Slices, sigma_mm: f64, factor: f64) -> Vec<Vec<u16>> {
    let sigma_px = factor * width_px(slices, sigma_mm);
    let variance = sigma_px * sigma_px - SMOOTHED;
    let images = gaussian(slices, variance);
    images.iter().map(|image| sharpened(slices, image, SMOOTHED + variance)).collect()
}

/// Returns the images, smoothed by a Gaussian of about this standard deviation in all.
pub(crate) fn smoothed(slices: &Slices, sigma_mm: f64) -> Vec<Vec<u16>> {
    gaussian(slices, width_px(slices, sigma_mm).powi(2) - SMOOTHED)
}

fn width_px(slices: &Slices, sigma_mm: f64) -> f64 {
    (sigma_mm / slices.pixel_mm()).max(LEAST_PX)
}

/// Returns images less half a variance times their Laplacian.
fn sharpened(slices: &Slices, image: &[u16], variance: f64) -> Vec<u16> {
    let width = slices.width;
    let sharp = |at: usize| {
        let around = [at.wrapping_sub(width), at.wrapping_sub(1), at + 1, at + width];
        // The data do not touch the border of the reduced image.
        if !slices.is_data[at] || !around.iter().all(|place| slices.is_data.get(*place) == Some(&true)) {
            return image[at];
        }
        let grey = f64::from(image[at]);
        let laplacian = around.iter().map(|place| f64::from(image[*place]) - grey).sum::<f64>();
        (grey - 0.5 * variance * laplacian).round().clamp(0.0, f64::from(u16::MAX)) as u16
    };
    (0..image.len()).map(sharp).collect()
}

/// Returns the images, blurred by a variance in square pixels. Pixels without data count for
/// nothing.
fn gaussian(slices: &Slices, variance: f64) -> Vec<Vec<u16>> {
    let reach = (REACH * variance.sqrt()).ceil() as i64;
    let kernel: Vec<f32> = (-reach..=reach).map(|k| (-0.5 * (k * k) as f64 / variance).exp() as f32).collect();
    let width = slices.width;
    let both = |values: &[f32]| {
        let mut rows = vec![0.0; values.len()];
        let mut sums = vec![0.0; values.len()];
        for (row, out) in values.chunks_exact(width).zip(rows.chunks_exact_mut(width)) {
            each_tap(&kernel, width, |weight, [from, to]| {
                out[to].iter_mut().zip(&row[from]).for_each(|(sum, value)| *sum += weight * value);
            });
        }
        each_tap(&kernel, slices.height, |weight, of| {
            let [from, to] = of.map(|rows| rows.start * width..rows.end * width);
            sums[to].iter_mut().zip(&rows[from]).for_each(|(sum, value)| *sum += weight * value);
        });
        sums
    };
    let data: Vec<f32> = slices.is_data.iter().map(|is| f32::from(u8::from(*is))).collect();
    let weights = both(&data);
    let blur = |pixels: &Vec<u16>| {
        let values: Vec<f32> = pixels.iter().zip(&data).map(|(grey, is)| f32::from(*grey) * is).collect();
        let grey = |(sum, weight): (&f32, &f32)| if *weight > 0.0 { (sum / weight).round() as u16 } else { 0 };
        both(&values).iter().zip(&weights).map(grey).collect()
    };
    slices.pixels.iter().map(|(_, pixels)| blur(pixels)).collect()
}

/// Passes the weights of a kernel, each with the range of `size` values that it multiplies and the
/// range of the sums that it adds to.
fn each_tap(kernel: &[f32], size: usize, mut add: impl FnMut(f32, [Range<usize>; 2])) {
    let reach = kernel.len() / 2;
    for (tap, weight) in kernel.iter().enumerate() {
        let [back, ahead] = [reach.saturating_sub(tap), tap.saturating_sub(reach)].map(|by| by.min(size));
        add(*weight, [ahead..size - back, back..size - ahead]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn taps_meet_values_within_reach_only() {
        let (kernel, values) = ([1.0, 2.0, 4.0, 8.0, 16.0], [1.0, 10.0, 100.0_f32]);
        let mut sums = [0.0; 3];
        each_tap(&kernel, 3, |weight, [from, to]| {
            sums[to].iter_mut().zip(&values[from]).for_each(|(sum, value)| *sum += weight * value);
        });
        assert_eq!(sums, [4.0 + 80.0 + 1600.0, 2.0 + 40.0 + 800.0, 1.0 + 20.0 + 400.0]);
        // A kernel longer than the image.
        let mut sum = [0.0; 1];
        each_tap(&kernel, 1, |weight, [from, to]| {
            sum[to].iter_mut().zip(&values[from]).for_each(|(sum, value)| *sum += weight * value);
        });
        assert_eq!(sum, [4.0]);
    }
}
