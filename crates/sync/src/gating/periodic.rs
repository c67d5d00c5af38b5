//! The period of a signal, and how far it exceeds chance.

/// Shortest and longest period of breathing, s.
pub(super) const PERIODS_S: [f64; 2] = [1.7, 8.0];
/// Share of the largest correlation that a shorter lag must have to be the period: a signal also
/// correlates at two periods.
const OF_LARGEST: f64 = 0.85;
/// Lengths of recordings, s, and a correlation that the wander of a body at rest reaches in less
/// than one of 100. The tests' bodies reach 0.1 less; slower wander reaches these.
const BY_CHANCE: [(f64, f64); 5] = [(10.0, 0.95), (20.0, 0.80), (30.0, 0.70), (40.0, 0.62), (60.0, 0.50)];

/// Returns the period, s, of a signal at even times, and the correlation with itself one later.
pub(super) fn period(band: &[f64], step_s: f64) -> (f64, f64) {
    let [first, last] = PERIODS_S.map(|seconds| (seconds / step_s).round() as usize);
    let last = last.min(band.len() / 2);
    let correlations: Vec<f64> =
        (first..=last).map(|lag| correlation(&band[..band.len() - lag], &band[lag..])).collect();
    let is_peak = |at: &usize| {
        let own = correlations[*at];
        *at > 0 && *at + 1 < correlations.len() && own >= correlations[at - 1] && own >= correlations[at + 1]
    };
    let peaks: Vec<usize> = (0..correlations.len()).filter(is_peak).collect();
    let largest = peaks.iter().map(|at| correlations[*at]).fold(0.0, f64::max);
    let shortest = peaks.iter().find(|at| correlations[**at] >= OF_LARGEST * largest);
    shortest.map_or((0.0, 0.0), |at| ((first + at) as f64 * step_s, correlations[*at]))
}

/// Returns the correlation of two signals whose means are zero.
fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let scale = (product(a, a) * product(b, b)).sqrt();
    if scale > 0.0 { product(a, b) / scale } else { 0.0 }
}

/// Returns the correlation that a body at rest reaches in one of 100 recordings of a length, s.
pub(super) fn by_chance(seconds: f64) -> f64 {
    let after = BY_CHANCE.iter().position(|(length, _)| *length > seconds);
    match after {
        Some(0) => BY_CHANCE[0].1,
        None => BY_CHANCE[BY_CHANCE.len() - 1].1,
        Some(at) => {
            let [(from, low), (to, high)] = [BY_CHANCE[at - 1], BY_CHANCE[at]];
            low + (high - low) * (seconds - from) / (to - from)
        }
    }
}

/// Returns the distance between the first and the last decile.
pub(super) fn size(band: &[f64]) -> f64 {
    let sorted = sorted(band);
    let at = |share: f64| sorted.get((share * sorted.len() as f64) as usize).copied().unwrap_or(0.0);
    at(0.9) - at(0.1)
}

/// Returns the sign by which a signal is smallest where it rests longest: its values' mean lies on
/// the side of the shorter end.
pub(super) fn rest_side(band: &[f64]) -> f64 {
    let sorted = sorted(band);
    let median = sorted.get(sorted.len() / 2).copied().unwrap_or(0.0);
    let mean = band.iter().sum::<f64>() / band.len().max(1) as f64;
    if mean >= median { 1.0 } else { -1.0 }
}

pub(super) fn sorted(band: &[f64]) -> Vec<f64> {
    let mut sorted = band.to_vec();
    sorted.sort_unstable_by(f64::total_cmp);
    sorted
}
