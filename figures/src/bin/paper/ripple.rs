//! Slices at equal distances: ripple of the sum of weights, and the distance at which gaps
//! appear.

use std::error::Error;
use std::f64::consts::PI;
use std::path::Path;

use sonoweave_figures::{Axis, Figure, Ink, Panel, Series, SeriesStyle, order};

use reconstruct::kernel::{AxisKernel, Method};

use crate::report::Report;
use crate::signal::kernel;

/// Returns half the difference of the largest and smallest sum of weights, relative to the mean;
/// samples are at all multiples of `gap`.
pub(crate) fn measured(kernel: &AxisKernel, gap: f64) -> f64 {
    // A multiple of four, so that the formula's extremes are among the positions.
    const PLACES: u32 = 400;
    let reach = (kernel.support_mm / gap).ceil() as i64 + 1;
    let sums: Vec<f64> = (0..PLACES)
        .map(|i| gap * f64::from(i) / f64::from(PLACES))
        .map(|x| (-reach..=reach).map(|j| kernel.weight(x - gap * j as f64)).sum())
        .collect();
    let (low, high) = sums.iter().fold((f64::INFINITY, 0.0_f64), |(l, h), s| (l.min(*s), h.max(*s)));
    0.5 * (high - low) / (sums.iter().sum::<f64>() / f64::from(PLACES))
}

/// Returns the first term of Poisson's sum: twice the Gaussian's spectrum at the sampling
/// frequency.
pub(crate) fn formula(gap: f64) -> f64 {
    2.0 * (-2.0 * PI * PI / (gap * gap)).exp()
}

/// Draws the ripple. `reconstructed` holds slice distances and the truncated kernel's ripple by the
/// reconstructor's weights.
pub(crate) fn draw(report: &mut Report, folder: &Path, reconstructed: &[[f64; 2]]) -> Result<(), Box<dyn Error>> {
    let whole = kernel(Method::GaussianTruncated, None)?;
    let cut = kernel(Method::GaussianTruncated, Some(0.01))?;
    let lowered = kernel(Method::Gaussian, Some(0.01))?;
    for gap in [1.0, 1.5, 2.0, 2.5, 3.0] {
        report.near(&format!("ripple at gaps of {gap} σ"), measured(&whole, gap), formula(gap), 0.01);
    }
    for [gap, found] in reconstructed {
        report.near(&format!("the reconstructor's ripple at gaps of {gap} σ"), *found, measured(&cut, *gap), 0.1);
    }
    let gaps = || (80..=620).map(|i| f64::from(i) * 0.01);
    let over = |f: &dyn Fn(f64) -> f64| gaps().map(|g| [g, f(g)]).collect::<Vec<_>>();
    // Contribution of one entering sample to a sum of √2π/gap.
    let step = |gap: f64| gap / (2.0 * PI).sqrt() * cut.weight(cut.support_mm);
    let below = gaps().find(|gap| measured(&cut, *gap) < 0.49 * step(*gap));
    report.check(below.is_none(), format!("the cut kernel ripples less than its step at gaps of {below:?} σ"));
    let marks = [1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.15].map(|g| [g, measured(&whole, g)]);
    let figure = Figure {
        id: "ripple",
        title: "Slices at equal distances: the ripple of the weights".into(),
        caption: format!(
            "Half of peak to peak of Σ weight, of its mean. The whole Gaussian follows 2 exp(−2π²σ²/s²) to a part of {} at s = 2 σ, where it is {:.2} %: twofold \
             undersampling costs little. A cut kernel never falls below half the step of one sample entering, s/σ·φ(d/σ); less its pedestal it \
             has no step but a kink, which ripples less. Beyond s = 2d = {:.2} σ there are places that no slice reaches.",
            order((measured(&whole, 2.0) / formula(2.0) - 1.0).abs()),
            100.0 * measured(&whole, 2.0),
            2.0 * cut.support_mm
        ),
        columns: 1,
        height: 280.0,
        panels: vec![Panel::new(
            "",
            Axis::linear("distance of slices, s/σ").from_to(0.8, 6.2),
            Axis::log("ripple of the weight, of its mean").from_to(1e-9, 10.0),
            vec![
                Series::new("2 exp(−2π²σ²/s²)", SeriesStyle::Line, Ink::Black, over(&formula)),
                Series::new("whole Gaussian, measured", SeriesStyle::Discs, Ink::Black, marks.to_vec()),
                Series::new(
                    "cut at E_e = .01, measured",
                    SeriesStyle::Dashed,
                    Ink::Vermilion,
                    over(&|g| measured(&cut, g)),
                ),
                Series::new(
                    "cut, by the reconstructor in 3D",
                    SeriesStyle::Squares,
                    Ink::Vermilion,
                    reconstructed.to_vec(),
                ),
                Series::new("half of one sample's step", SeriesStyle::Dotted, Ink::Vermilion, over(&|g| 0.5 * step(g))),
                Series::new(
                    "less its pedestal, measured",
                    SeriesStyle::Line,
                    Ink::Blue,
                    over(&|g| measured(&lowered, g)),
                ),
                Series::new(
                    "s = 2d",
                    SeriesStyle::Dotted,
                    Ink::Grey,
                    vec![[2.0 * cut.support_mm, 1e-9], [2.0 * cut.support_mm, 10.0]],
                ),
            ],
        )],
    };
    report.figure(figure, folder)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn untruncated_gaussian_ripple_matches_poisson_sum() {
        let whole = kernel(Method::GaussianTruncated, None).unwrap();
        for gap in [1.0, 2.0, 3.0] {
            assert!((measured(&whole, gap) / formula(gap) - 1.0).abs() < 1e-2, "{gap}: {}", measured(&whole, gap));
        }
    }
}
