//! Figures 6 and 7 with ours beside them: the effect of truncation on a result and its slope,
//! and the benefit of subtracting the pedestal.

use std::error::Error;
use std::path::Path;

use sonoweave_figures::{Axis, Figure, Ink, Panel, Series, SeriesStyle};

use reconstruct::kernel::Method;

use crate::report::Report;
use crate::signal::{Errors, SAMPLES, SHOWN, SLOPE_OVER, SampledSignal, kernel, median, over_draws, positions, signal};

/// Seed of the draw that is shown.
const SEED: u64 = 1992;
const ENERGIES: [f64; 7] = [0.3, 0.1, 0.03, 0.01, 0.003, 0.001, 0.0001];

pub(crate) fn draw(report: &mut Report, folder: &Path, draws: u64) -> Result<(), Box<dyn Error>> {
    figure_6(report, folder)?;
    figure_7(report, folder)?;
    truncation(report, folder, draws)
}

fn figure_6(report: &mut Report, folder: &Path) -> Result<(), Box<dyn Error>> {
    let at = positions(SEED);
    let shown = &at[SHOWN];
    let [low, high] = [shown[0], shown[shown.len() - 1]];
    let curve = (0..=800).map(|i| low + (high - low) * f64::from(i) / 800.0).map(|x| [x, signal(x, 0.0)]).collect();
    let number = |i: usize| SHOWN.start as f64 + i as f64 + 1.0;
    let figure = Figure {
        id: "figure-6-samples",
        title: "Figure 6: a signal, sampled as by a hand".into(),
        caption: format!(
            "A sum of Gaussians and samples of it at distances of σ(1 + random)/2, which lie between half a σ and one; {SAMPLES} were drawn, of which the {} in \
             the middle are shown. Right, where each sample lies. The paper does not print its signal; this is one of the same kind.",
            shown.len()
        ),
        columns: 2,
        height: 240.0,
        panels: vec![
            Panel::new(
                "The signal and its samples",
                Axis::linear("position, σ"),
                Axis::linear("value, arbitrary unit").from_to(0.0, 1.2),
                vec![
                    Series::new("signal", SeriesStyle::Line, Ink::Black, curve),
                    Series::new(
                        "samples",
                        SeriesStyle::Discs,
                        Ink::Blue,
                        shown.iter().map(|x| [*x, signal(*x, 0.0)]).collect(),
                    ),
                ],
            ),
            Panel::new(
                "Where the samples lie",
                Axis::linear("number of the sample").from_to(SHOWN.start as f64, SHOWN.end as f64 + 1.0),
                Axis::linear("position, σ"),
                vec![Series::new(
                    "samples",
                    SeriesStyle::Discs,
                    Ink::Blue,
                    shown.iter().enumerate().map(|(i, x)| [number(i), *x]).collect(),
                )],
            ),
        ],
    };
    report.figure(figure, folder)
}

fn figure_7(report: &mut Report, folder: &Path) -> Result<(), Box<dyn Error>> {
    let rows = [
        (Method::GaussianTruncated, 0.1, "E_e = .1, cut"),
        (Method::GaussianTruncated, 0.01, "E_e = .01, cut"),
        (Method::GaussianTruncated, 0.001, "E_e = .001, cut"),
        (Method::Gaussian, 0.01, "E_e = .01, less its pedestal"),
    ];
    let mut panels = Vec::new();
    for (method, energy, name) in rows {
        let sampled = SampledSignal { at: positions(SEED), kernel: kernel(method, Some(energy))? };
        let [low, high] = sampled.stretch();
        let ink = if method == Method::Gaussian { Ink::Blue } else { Ink::Vermilion };
        let over = |f: &dyn Fn(f64) -> f64| -> Vec<[f64; 2]> {
            (0..=800).map(|i| low + (high - low) * f64::from(i) / 800.0).map(|x| [x, f(x)]).collect()
        };
        let x = || Axis::linear("position, σ").from_to(low.floor(), high.ceil());
        let blur = sampled.kernel.sigma_effective_mm();
        let errors = sampled.errors();
        let slope = |x: f64| (signal(x + 0.01, blur) - signal(x - 0.01, blur)) / 0.02;
        panels.push(Panel::new(
            format!("{name}: sums"),
            x(),
            Axis::linear("sum").from_to(0.0, 4.0),
            vec![
                Series::new("Σ weight", SeriesStyle::Dashed, Ink::Grey, over(&|x| sampled.sums(x)[1])),
                Series::new("Σ weight·value", SeriesStyle::Line, Ink::Purple, over(&|x| sampled.sums(x)[0])),
            ],
        ));
        panels.push(Panel::new(
            if errors.step < 1e-12 {
                "result (no step)".into()
            } else {
                format!("result (largest step {:.3})", errors.step)
            },
            x(),
            Axis::linear("value").from_to(0.0, 1.0),
            vec![
                Series::new("the blurred signal", SeriesStyle::Line, Ink::Black, over(&|x| signal(x, blur))),
                Series::new(
                    if method == Method::Gaussian { "reconstructed, less its pedestal" } else { "reconstructed, cut" },
                    SeriesStyle::Line,
                    ink,
                    over(&|x| sampled.value(x)),
                ),
            ],
        ));
        panels.push(Panel::new(
            format!("slope (rms error {:.3})", errors.slope),
            x(),
            Axis::linear("slope, 1/σ").from_to(-1.0, 1.0),
            vec![
                Series::new(
                    if method == Method::Gaussian { "reconstructed, less its pedestal" } else { "reconstructed, cut" },
                    SeriesStyle::Line,
                    ink,
                    over(&|x| sampled.slope(x)),
                ),
                Series::new("the blurred signal", SeriesStyle::Line, Ink::Black, over(&slope)),
            ],
        ));
    }
    let figure = Figure {
        id: "figure-7-reconstructed",
        title: "Figure 7: the signal reconstructed, by how much energy the support leaves out".into(),
        caption: format!(
            "Columns as in the paper, whose rows are the first two: the two sums, their quotient, its slope (over {SLOPE_OVER} σ; spikes reach beyond the axis). Black is the signal under the \
             kernel's effective width. The steps of a cut kernel vanish from the sums' quotient only as its end does; subtracting the end's height from the \
             kernel removes them at the same support."
        ),
        columns: 3,
        height: 112.0,
        panels,
    };
    report.figure(figure, folder)
}

fn truncation(report: &mut Report, folder: &Path, draws: u64) -> Result<(), Box<dyn Error>> {
    let whole = over_draws(kernel(Method::GaussianTruncated, None)?, draws);
    let of = |method: Method| -> Result<Vec<Vec<Errors>>, Box<dyn Error>> {
        ENERGIES.iter().map(|e| Ok(over_draws(kernel(method, Some(*e))?, draws))).collect()
    };
    let (cut, lowered) = (of(Method::GaussianTruncated)?, of(Method::Gaussian)?);
    // Indices of .1, .01 and .001.
    let [tenth, hundredth, thousandth] = [&cut[1], &cut[3], &cut[5]];
    let every = |holds: &dyn Fn(usize) -> bool| (0..whole.len()).all(holds);
    report.check(
        every(&|i| tenth[i].step > hundredth[i].step && hundredth[i].step > thousandth[i].step),
        "C7: a draw whose largest step does not fall from E_e = .1 over .01 to .001",
    );
    report.check(
        every(&|i| tenth[i].slope > hundredth[i].slope && hundredth[i].slope > thousandth[i].slope),
        "C7: a draw whose slope's error does not fall from E_e = .1 over .01 to .001",
    );
    report.check(
        every(&|i| lowered[3][i].step < 1e-12 && lowered[3][i].slope < hundredth[i].slope),
        "C7: a draw in which the pedestal does not lower the slope's error at E_e = .01",
    );
    let [a, b, c, p, full] = [tenth, hundredth, thousandth, &lowered[3], &whole].map(|d| median(d, |e| e.slope));
    let [step_a, step_b, step_c] = [tenth, hundredth, thousandth].map(|d| median(d, |e| e.step));
    report.check(
        a > 5.0 * full && c < 1.5 * full,
        format!("C7: slope errors {a}, {c} against {full} of the whole Gaussian"),
    );
    report.claim(
        ["C7", "E_e = .1 is not enough, .01 and .001 look smooth", "“definitely not enough”, “look smooth”"],
        format!(
            "medians of {draws} draws: largest step {step_a:.3}, {step_b:.3}, {step_c:.4}; rms error of the slope {a:.3}, {b:.4}, {c:.4} (whole Gaussian \
             {full:.4}; .01 less its pedestal {p:.4})"
        ),
        b < 1.5 * full,
        ["holds", "holds for .1 and .001; .01 is smooth in value only, with the pedestal also in slope"],
    );
    let series = |of: fn(&Errors) -> f64, floor: bool| -> Vec<Series> {
        let points =
            |sets: &[Vec<Errors>]| ENERGIES.iter().zip(sets).map(|(e, d)| [*e, median(d, of)]).collect::<Vec<_>>();
        let reference = median(&whole, of);
        let mut all = vec![Series::new("cut, as in the paper", SeriesStyle::Dashed, Ink::Vermilion, points(&cut))];
        all.push(Series::new("", SeriesStyle::Squares, Ink::Vermilion, points(&cut)));
        if floor {
            all.push(Series::new("less its pedestal", SeriesStyle::Line, Ink::Blue, points(&lowered)));
            all.push(Series::new("", SeriesStyle::Discs, Ink::Blue, points(&lowered)));
            all.push(Series::new(
                "whole Gaussian",
                SeriesStyle::Dotted,
                Ink::Black,
                vec![[1e-4, reference], [0.3, reference]],
            ));
        }
        all
    };
    let x = || Axis::log("energy outside the support, E_e").from_to(0.7e-4, 0.45);
    let figure = Figure {
        id: "truncation-error",
        title: "What cutting the kernel costs".into(),
        caption: format!(
            "Medians over {draws} draws of the samples' positions; errors against the signal under each kernel's effective width, in units of the signal's height \
             of about 1. Less its pedestal the kernel makes no step at all, so it has no curve on the left. Slopes are taken over {SLOPE_OVER} σ: over longer \
             distances the steps weigh less."
        ),
        columns: 3,
        height: 230.0,
        panels: vec![
            Panel::new("Largest step", x(), Axis::log("step of the value"), series(|e| e.step, false)),
            Panel::new("Error of the slope", x(), Axis::log("rms, 1/σ"), series(|e| e.slope, true)),
            Panel::new("Error of the value", x(), Axis::log("rms").from_to(0.01, 0.05), series(|e| e.value, true)),
        ],
    };
    report.figure(figure, folder)
}
