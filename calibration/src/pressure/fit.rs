//! The compression of one slice, from the displacements of its windows.

use super::compression::Compression;
use super::monotone::falling;
use super::window::Found;

/// Correlation of a window that tells a displacement.
pub(super) const ALIKE: f64 = 0.6;
/// Share of a slice's windows that do, and their least number.
const LEAST_SHARE: f64 = 0.5;
const LEAST_WINDOWS: usize = 3;
/// Noise of a window's displacement, mm.
const NOISE_MM: f64 = 0.3;
/// Depth below the first window over which displacement is taken to change evenly, mm: two windows,
/// so that the noise of one is not doubled at the skin.
const LEVER_MM: f64 = 4.5;
/// Least part of a window that differs by noise: the weight is not infinite at a correlation of 1.
const LEAST_NOISE: f64 = 0.02;

/// Whether a window tells a displacement.
pub(super) fn is_alike(window: &Found) -> bool {
    window.peak >= ALIKE && !window.at_end
}

/// Whether tissue would fold: that of a window lies above that of the window before, by more than
/// noise.
pub(super) fn folds(windows: &[Found]) -> bool {
    let shown: Vec<f64> = windows.iter().filter(|w| is_alike(w)).map(|w| w.depth_mm + w.shift_mm).collect();
    shown.windows(2).any(|pair| pair[1] < pair[0] - NOISE_MM)
}

/// Returns the compression of a slice: the displacement that falls from the skin to 0 at a depth,
/// nearest to those of the windows. `None` if too few windows tell one, or if tissue would fold.
pub(super) fn compression(windows: &[Found], bottom_mm: f64) -> Option<Compression> {
    let mut alike: Vec<Found> = windows.iter().filter(|window| is_alike(window)).copied().collect();
    if folds(windows) || alike.len() < LEAST_WINDOWS || (alike.len() as f64) < LEAST_SHARE * windows.len() as f64 {
        return None;
    }
    alike.sort_by(|a, b| a.depth_mm.total_cmp(&b.depth_mm));
    let weights: Vec<f64> = alike.iter().map(|w| w.peak * w.peak / (1.0 - w.peak * w.peak).max(LEAST_NOISE)).collect();
    // The probe may press more than in the light sweep, or less.
    let [more, less] = [1.0, -1.0].map(|sign| {
        let shifts: Vec<f64> = alike.iter().map(|window| sign * window.shift_mm).collect();
        let fit = falling(&shifts, &weights);
        let cost: f64 = fit.iter().zip(&shifts).zip(&weights).map(|((x, shift), w)| w * (x - shift).powi(2)).sum();
        (cost, fit.into_iter().map(|x| sign * x).collect::<Vec<f64>>())
    });
    let (_, fit) = if less.0 < more.0 { less } else { more };
    let mut knots: Vec<[f64; 2]> = alike.iter().zip(fit).map(|(window, d)| [window.depth_mm, d]).collect();
    // From the first window to the skin, displacement goes on as from a deeper one to the first.
    let [v, d] = knots[0];
    let deeper = knots.iter().find(|[w, _]| w - v >= LEVER_MM);
    if let Some([w, e]) = deeper.filter(|_| v > 0.0) {
        let skin_mm = d + (d - e) * v / (w - v);
        knots.insert(0, [0.0, skin_mm]);
    }
    if knots[knots.len() - 1][0] < bottom_mm {
        knots.push([bottom_mm, 0.0]);
    }
    Compression::new(knots).ok()
}
