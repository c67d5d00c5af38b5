//! The kernel's end: the paper's figure 5, the relation of half width and σ, the value left at
//! the end, and the resulting effective width.

use std::error::Error;
use std::f64::consts::PI;
use std::path::Path;

use sonoweave_figures::{Axis, Figure, Ink, Panel, Series, SeriesStyle, order};

use reconstruct::kernel::{AxisKernel, Method, Support, sigma_from_hwhm};

use crate::report::Report;

const ERROR: f64 = 0.01;

pub(crate) fn draw(report: &mut Report, folder: &Path) -> Result<(), Box<dyn Error>> {
    criteria(report, folder)?;
    half_width(report, folder)?;
    end_of_support(report, folder)?;
    effective_width(report, folder)
}

/// Returns the half width of the support over σ, if it exists.
fn curve(support: Support, sigmas: impl Iterator<Item = f64>) -> Vec<[f64; 2]> {
    sigmas.map(|sigma| [sigma, support.half_width_mm(sigma).unwrap_or(f64::NAN)]).collect()
}

/// Returns the highest point of a curve that has gaps.
fn highest(points: &[[f64; 2]]) -> [f64; 2] {
    points
        .iter()
        .copied()
        .filter(|p| p[1].is_finite())
        .fold([f64::NAN, f64::NEG_INFINITY], |a, b| if b[1] > a[1] { b } else { a })
}

/// Returns the largest deviation from the straight line through the origin and the last point,
/// relative to that line's height.
fn bend(points: &[[f64; 2]]) -> f64 {
    let Some([x, y]) = points.iter().rev().find(|p| p[1].is_finite()) else { return f64::NAN };
    points.iter().filter(|p| p[1].is_finite()).map(|p| (p[1] - p[0] * y / x).abs() / y).fold(0.0, f64::max)
}

fn criteria(report: &mut Report, folder: &Path) -> Result<(), Box<dyn Error>> {
    let kinds = [
        ("energy outside d_e: erfc(d/√2σ) = 0.01", Support::Energy(ERROR), SeriesStyle::Line, Ink::Blue),
        ("amplitude at the end d_a: Gauss(d) = 0.01", Support::Amplitude(ERROR), SeriesStyle::Dashed, Ink::Vermilion),
        ("slope at the end d_g: |DGauss(d)| = 0.01", Support::Gradient(ERROR), SeriesStyle::Dotted, Ink::Green),
    ];
    let series = |low: f64, high: f64| -> Vec<Series> {
        let sigmas = move || (0..=1200).map(move |i| low + (high - low) * f64::from(i) / 1200.0);
        kinds
            .iter()
            .map(|(name, support, view_settings, ink)| {
                Series::new(*name, *view_settings, *ink, curve(*support, sigmas()))
            })
            .collect()
    };
    // Closed forms: the amplitude's support is longest at a zero of its derivative over σ. The
    // slope's support ends where the inflection has the same slope.
    let root = (2.0 * PI).sqrt();
    let longest = (-0.5_f64).exp() / (ERROR * root);
    let last = longest.sqrt();
    let wide = series(0.3, 45.0);
    let found_longest = highest(&wide[1].points)[0];
    let found_last = falls_silent(Support::Gradient(ERROR), 1.0, 10.0);
    report.near("σ with the longest d_a", found_longest, longest, 2e-3);
    report.near("largest σ with a d_g", found_last, last, 1e-6);
    let near = series(0.3, 6.0);
    let [energy, amplitude] = [bend(&wide[0].points), bend(&near[1].points)];
    report.check(energy < 1e-12, format!("d_e is not linear in σ: bend of {energy}"));
    report.check(amplitude > 0.05, format!("d_a is nearly linear in σ: bend of {amplitude}"));
    // The printed slope and the correct one, both at x = μ + σ.
    let (mean, x) = (5.0_f64, 6.0_f64);
    let density = (-0.5 * (x - mean).powi(2)).exp() / root;
    let (printed, meant) = (-(mean + x) * density, -(x - mean) * density);
    let h = 1e-5;
    let slope = ((-0.5 * (x + h - mean).powi(2)).exp() - (-0.5 * (x - h - mean).powi(2)).exp()) / root / (2.0 * h);
    report.near("the slope that DGauss means", slope, meant, 1e-6);
    report.claim(
        ["C6", "E_a and E_e give a support linear in σ; E_g “is not so simple”", "“the first two become linear functions of σ”"],
        format!(
            "d_e is linear (bend {}); d_a bends by {:.0} % of its height up to σ = 6, is longest at σ = {found_longest:.1} and ends at {:.1}; \
             d_g has no solution above σ = {found_last:.3}; DGauss as printed, with μ + x, is {:.0} times the slope at x = μ + σ for μ = 5 σ, and has the other sign \
             than a positive E_g",
            order(energy),
            100.0 * amplitude,
            falls_silent(Support::Amplitude(ERROR), 1.0, 100.0),
            printed / slope
        ),
        energy < 1e-12 && amplitude < 0.01,
        ["holds", "holds for E_e only; DGauss is misprinted"],
    );
    let sigma = "standard deviation σ, mm";
    let figure = Figure {
        id: "figure-5-criteria",
        title: "Figure 5: where the kernel ends, by three criteria at 0.01".into(),
        caption: format!(
            "Left, as in the paper. Right, the same curves further: only the energy criterion is linear in σ. The amplitude criterion is in 1/mm, so a wide \
             kernel is low everywhere: its support is longest at σ = {found_longest:.1} (e^(−1/2)/(E√2π) = {longest:.1}) and then shrinks to nothing. The slope \
             criterion has no solution above σ = {found_last:.3}; the kernel is nowhere that steep."
        ),
        columns: 2,
        height: 270.0,
        panels: vec![
            Panel::new(
                "The range of a scanner's kernels",
                Axis::linear(sigma).from_to(0.0, 6.0),
                Axis::linear("half width of the support d, mm").from_to(0.0, 16.0),
                near,
            ),
            Panel::new(
                "Further: not linear, and not always there",
                Axis::linear(sigma).from_to(0.0, 45.0),
                Axis::linear("half width of the support d, mm").from_to(0.0, 60.0),
                wide,
            ),
        ],
    };
    report.figure(figure, folder)
}

/// Returns the σ above which a criterion has no solution, by bisection.
fn falls_silent(support: Support, mut low: f64, mut high: f64) -> f64 {
    for _ in 0..200 {
        let middle = 0.5 * (low + high);
        if support.half_width_mm(middle).is_ok() { low = middle } else { high = middle }
    }
    low
}

fn half_width(report: &mut Report, folder: &Path) -> Result<(), Box<dyn Error>> {
    let natural = sigma_from_hwhm(1.0);
    let decimal = 1.0 / 4.0_f64.log10().sqrt();
    let gauss = |x: f64, sigma: f64| (-0.5 * (x / sigma).powi(2)).exp();
    let [right, wrong] = [natural, decimal].map(|sigma| gauss(1.0, sigma));
    report.near("the Gaussian at its half width, natural logarithm", right, 0.5, 1e-12);
    report.check(wrong > 0.7, format!("the decimal logarithm gives {wrong} at the half width"));
    report.near("the paper's constant", natural, 0.849_322, 1e-6);
    report.claim(
        ["C4", "σ = h/√log(4) ≈ 0.849322·h", "0.849322"],
        format!("natural logarithm: {natural:.6}, G(h)/G(0) = {right:.6}; decimal logarithm: {decimal:.4}, G(h)/G(0) = {wrong:.3}"),
        (natural - 0.849_322).abs() < 1e-6 && (right - 0.5).abs() < 1e-12,
        ["holds, with the natural logarithm", "does not hold"],
    );
    let xs = || (0..=400).map(|i| f64::from(i) * 0.01 - 2.0);
    let points = |sigma: f64| xs().map(|x| [x, gauss(x, sigma)]).collect();
    let figure = Figure {
        id: "half-width",
        title: "Resolution and σ: the logarithm is the natural one".into(),
        caption: format!(
            "A scanner's resolution is given as half width at half maximum h. With the natural logarithm σ = h/√(ln 4) = {natural:.6} h, and the Gaussian \
             crosses one half at h. Read as the decimal logarithm, the paper's formula gives {decimal:.4} h, and the Gaussian is still at {wrong:.2} there: a \
             kernel half again as wide."
        ),
        columns: 1,
        height: 250.0,
        panels: vec![Panel::new(
            "",
            Axis::linear("distance, in half widths h"),
            Axis::linear("kernel, of its peak").from_to(0.0, 1.05),
            vec![
                Series::new("half of the peak", SeriesStyle::Dotted, Ink::Grey, vec![[-2.0, 0.5], [2.0, 0.5]]),
                Series::new(
                    format!("natural logarithm, σ = {natural:.4} h"),
                    SeriesStyle::Line,
                    Ink::Blue,
                    points(natural),
                ),
                Series::new(
                    format!("decimal logarithm, σ = {decimal:.4} h"),
                    SeriesStyle::Dashed,
                    Ink::Vermilion,
                    points(decimal),
                ),
                Series::new(
                    "half width at half maximum",
                    SeriesStyle::Discs,
                    Ink::Black,
                    vec![[-1.0, 0.5], [1.0, 0.5]],
                ),
            ],
        )],
    };
    report.figure(figure, folder)
}

/// C2 and C5: the value left at the end of the support.
fn end_of_support(report: &mut Report, folder: &Path) -> Result<(), Box<dyn Error>> {
    let cut = AxisKernel::new(Method::GaussianTruncated, 1.0, Support::Energy(ERROR))?;
    let lowered = AxisKernel::new(Method::Gaussian, 1.0, Support::Energy(ERROR))?;
    let end = cut.weight(cut.support_mm) / cut.peak();
    let lowered_end = lowered.weight(lowered.support_mm).abs() / lowered.peak();
    let h = 1e-6;
    let slope = |k: &AxisKernel| (k.weight(k.support_mm - h) - k.weight(k.support_mm - 2.0 * h)).abs() / h / k.peak();
    let (cut_slope, lowered_slope) = (slope(&cut), slope(&lowered));
    report.near("the cut kernel's end", end, 0.0362, 2e-3);
    report.near("the cut kernel's slope at its end", cut_slope, 0.0934, 2e-3);
    report.check(lowered_end < 1e-15, format!("the pedestal leaves a step of {lowered_end}"));
    report.claim(
        ["C2", "the support is finite, and value and gradient are about zero at its end", "“(approximately) zero”, “must also be zero”"],
        format!(
            "at E_e = .01 the cut kernel ends at {:.2} % of its peak with a slope of {:.2} % of peak/σ; less its pedestal it ends at {lowered_end} with \
             a slope of {:.2} %",
            100.0 * end,
            100.0 * cut_slope,
            100.0 * lowered_slope
        ),
        end < 0.001 && cut_slope < 0.001,
        ["holds", "does not hold for the cut kernel; the pedestal removes the step, not the slope"],
    );
    let d: Vec<f64> =
        [0.1, 0.01, 0.001, 1e-4].iter().map(|e| Support::Energy(*e).half_width_mm(1.0)).collect::<Result<_, _>>()?;
    for (found, expected) in d.iter().zip([1.644_854, 2.575_83, 3.290_53, 3.890_592]) {
        report.near("d/σ by leaked energy", *found, expected, 3e-6);
    }
    let printed = (d[1] - 2.57583).abs() < 5e-6 && (d[2] - 3.29053).abs() < 5e-6;
    report.claim(
        ["C5", "E_e = .01 ends at 2.57583 σ, .001 at 3.29053 σ", "2.57583; 3.29053"],
        format!("{:.5}; {:.5} (and .1 at {:.5}, .0001 at {:.5})", d[1], d[2], d[0], d[3]),
        printed,
        ["holds", "does not hold"],
    );
    let at = || (0..=640).map(|i| f64::from(i) * 0.005);
    let over = |f: &dyn Fn(f64) -> f64| at().map(|x| [x, f(x)]).collect::<Vec<_>>();
    // Taken from below, so that the step at the end is not included.
    let slope = |k: &AxisKernel, x: f64| if x <= k.support_mm { (k.weight(x) - k.weight(x - h)) / h } else { 0.0 };
    let kinds = |f: &dyn Fn(&AxisKernel, f64) -> f64| {
        vec![
            Series::new(
                "cut, as in the paper",
                SeriesStyle::Dashed,
                Ink::Vermilion,
                over(&|x| f(&cut, x) / cut.peak()),
            ),
            Series::new("less its pedestal", SeriesStyle::Line, Ink::Blue, over(&|x| f(&lowered, x) / lowered.peak())),
        ]
    };
    let x = || Axis::linear("distance x/σ").from_to(0.0, 3.2);
    let figure = Figure {
        id: "kernel-end",
        title: "The kernel's end: neither value nor slope is zero".into(),
        caption: format!(
            "The paper wants both to vanish at the end of the support. At E_e = .01 (d = 2.576 σ) the cut kernel ends at {:.2} % of its peak with a slope of \
             {:.2} % of peak/σ. Less its pedestal it ends at zero at the same support; a slope of {:.2} % remains, a kink in the place of a step.",
            100.0 * end,
            100.0 * cut_slope,
            100.0 * lowered_slope
        ),
        columns: 2,
        height: 220.0,
        panels: vec![
            Panel::new("Kernel", x(), Axis::log("value, of its peak").from_to(0.001, 1.5), kinds(&AxisKernel::weight)),
            Panel::new("Its slope", x(), Axis::linear("slope, peak/σ").from_to(-0.7, 0.1), kinds(&slope)),
        ],
    };
    report.figure(figure, folder)
}

fn effective_width(report: &mut Report, folder: &Path) -> Result<(), Box<dyn Error>> {
    // d/σ expressed as lost energy, so that one kernel type serves formula and integral.
    let kernel = |method: Method, z: f64| AxisKernel::new(method, 1.0, Support::Energy(libm::erfc(z / 2.0_f64.sqrt())));
    let kinds = [
        (Method::GaussianTruncated, "cut", Ink::Vermilion, SeriesStyle::Dashed),
        (Method::Gaussian, "less its pedestal", Ink::Blue, SeriesStyle::Line),
    ];
    let mut series = Vec::new();
    let mut worst = 0.0_f64;
    for (method, name, ink, view_settings) in kinds {
        let formula = (10..=450).map(|i| f64::from(i) * 0.01).map(|z| Ok([z, kernel(method, z)?.sigma_effective_mm()]));
        series.push(Series::new(
            format!("{name}: formula"),
            view_settings,
            ink,
            formula.collect::<Result<_, Box<dyn Error>>>()?,
        ));
        let mut integrated = Vec::new();
        for z in (1..=9).map(|i| 0.5 * f64::from(i)) {
            let kernel = kernel(method, z)?;
            let width = integrated_width(&kernel);
            worst = worst.max((width / kernel.sigma_effective_mm() - 1.0).abs());
            integrated.push([z, width]);
        }
        let marks = if method == Method::Gaussian { SeriesStyle::Discs } else { SeriesStyle::Squares };
        series.push(Series::new(format!("{name}: integrated"), marks, ink, integrated));
    }
    report.check(worst < 1e-5, format!("effective widths differ from their integrals by a part of {worst}"));
    let at = |method| kernel(method, 2.575_829).map(|k| k.sigma_effective_mm());
    let (cut, lowered) = (at(Method::GaussianTruncated)?, at(Method::Gaussian)?);
    report.near("effective width, cut at E_e = .01", cut, 0.9617, 1e-4);
    report.near("effective width, pedestal at E_e = .01", lowered, 0.9056, 1e-4);
    let figure = Figure {
        id: "effective-width",
        title: "A kernel that ends is narrower than its σ".into(),
        caption: format!(
            "Standard deviation of the kernel as it is, by formula and by numerical integration (they agree to a part of {}). At the paper's E_e = .01, \
             d = 2.576 σ, cutting alone narrows the kernel to {cut:.4} σ and the pedestal to {lowered:.4} σ. Kernels are to be compared at equal effective width.",
            order(worst)
        ),
        columns: 1,
        height: 250.0,
        panels: vec![Panel::new(
            "",
            Axis::linear("half width of the support, d/σ").from_to(0.0, 4.6),
            Axis::linear("effective width, σ_eff/σ").from_to(0.0, 1.05),
            series,
        )],
    };
    report.figure(figure, folder)
}

/// Returns the standard deviation of a kernel by the trapezoidal rule.
fn integrated_width(kernel: &AxisKernel) -> f64 {
    const STEPS: u32 = 20_000;
    let (mut mass, mut moment) = (0.0, 0.0);
    for i in 0..=STEPS {
        let x = kernel.support_mm * f64::from(i) / f64::from(STEPS);
        let share = if i == 0 || i == STEPS { 0.5 } else { 1.0 };
        mass += share * kernel.weight(x);
        moment += share * kernel.weight(x) * x * x;
    }
    (moment / mass).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn straight_line_has_no_bend_and_square_root_has() {
        let line: Vec<[f64; 2]> = (1..9).map(|i| [f64::from(i), 3.0 * f64::from(i)]).collect();
        let root: Vec<[f64; 2]> = (1..9).map(|i| [f64::from(i), f64::from(i).sqrt()]).collect();
        assert!(bend(&line) < 1e-15 && bend(&root) > 0.2);
        assert_eq!(highest(&[[1.0, 2.0], [2.0, 5.0], [3.0, f64::NAN], [4.0, 1.0]]), [2.0, 5.0]);
    }

    #[test]
    fn amplitude_criterion_ends_at_its_closed_form() {
        let end = falls_silent(Support::Amplitude(0.01), 1.0, 100.0);
        assert!((end - 100.0 / (2.0 * PI).sqrt()).abs() < 1e-9, "{end}");
    }
}
