//! What each rule of decay shows of an object, still or moving, and where.

use std::error::Error;
use std::path::Path;

use sonoweave::reconstruct::kernel::AxisKernel;
use sonoweave_figures::{Axis, Figure, Ink, Look, Panel, Series};

use crate::decay::{RATE_HZ, Rule, SPEED, Voxels, kernel, long_wait, shift, sweep};
use crate::report::Report;

/// Rate of decay of the profiles, 1/s.
const SHOWN_RATE: f64 = 1.0;
const NONE: (&str, Look, Ink) = ("none", Look::Dashed, Ink::Grey);
const EXPONENTIAL: (&str, Look, Ink) = ("exponential", Look::Line, Ink::Vermilion);
const DEAD_TIME: (&str, Look, Ink) = ("exponential after a wait of 2d/v", Look::Line, Ink::Blue);
const PRINTED: (&str, Look, Ink) = ("as printed, exponential", Look::Dashed, Ink::Purple);
const PRINTED_WAIT: (&str, Look, Ink) = ("as printed, after the wait", Look::Dotted, Ink::Green);

/// All rules at a rate.
fn rules(rate: f64, wait: f64) -> [((&'static str, Look, Ink), Rule); 5] {
    [
        (EXPONENTIAL, Rule::Exponential { rate }),
        (DEAD_TIME, Rule::DeadTime { rate, wait }),
        // On top of the former, which it equals as long as nothing waits longer.
        (NONE, Rule::None),
        (PRINTED, Rule::Printed { rate, wait: 0.0 }),
        (PRINTED_WAIT, Rule::Printed { rate, wait }),
    ]
}

fn series((name, look, ink): (&'static str, Look, Ink), points: Vec<[f64; 2]>) -> Series {
    Series::new(name, look, ink, points)
}

/// An object of height 1 around a place.
fn blob(x: f64, centre: f64) -> f64 {
    (-0.5 * ((x - centre) / 1.5).powi(2)).exp()
}

pub(crate) fn draw(report: &mut Report, folder: &Path) -> Result<(), Box<dyn Error>> {
    let kernel = kernel()?;
    shifts(report, folder, kernel)?;
    moving(report, folder, kernel)
}

fn shifts(report: &mut Report, folder: &Path, kernel: AxisKernel) -> Result<(), Box<dyn Error>> {
    let wait = long_wait(&kernel);
    let variance = kernel.sigma_effective_mm().powi(2);
    let rates: Vec<f64> = (-20..=24).map(|i| 10_f64.powf(f64::from(i) / 10.0)).collect();
    let over = |f: &dyn Fn(f64) -> f64| rates.iter().map(|a| [*a, f(*a)]).collect::<Vec<_>>();
    let mut curves: Vec<Series> = rules(1.0, wait)
        .iter()
        .enumerate()
        .map(|(i, (style, _))| series(*style, over(&|rate| shift(rules(rate, wait)[i].1, kernel))))
        .collect();
    let within = |f: &dyn Fn(f64) -> f64| over(f).into_iter().filter(|p| p[1] < 3.0).collect::<Vec<_>>();
    curves.push(Series::new("a·σ²/v", Look::Dotted, Ink::Black, within(&|a| a / SPEED)));
    curves.push(Series::new("a·σ_eff²/v", Look::Dashed, Ink::Black, within(&|a| a * variance / SPEED)));

    let exponential = |rate| shift(Rule::Exponential { rate }, kernel);
    for rate in [1.0, 3.0, 10.0] {
        let expected = rate * variance / SPEED;
        report.near(&format!("shift of exponential decay at a rate of {rate}/s"), exponential(rate), expected, 0.2);
    }
    let dead = [1.0, 10.0, 100.0]
        .map(|rate| shift(Rule::DeadTime { rate, wait }, kernel).abs())
        .into_iter()
        .fold(0.0, f64::max);
    report.check(dead < 0.02, format!("a wait of 2d/v shifts by {dead} σ"));
    let printed = |rate, wait| shift(Rule::Printed { rate, wait }, kernel);
    report.check(printed(0.01, 0.0) < -1.9, format!("the printed formula shifts by {}", printed(0.01, 0.0)));
    report.check(
        printed(1.0, wait) <= printed(0.01, 0.0) + 0.05,
        format!("the printed formula with a wait shifts by {}", printed(1.0, wait)),
    );
    report.claim(
        ["C8", "r = d·r + (1 − d)·S fades old data; exp(−at), or wait and then exp", "“except for the decay factor, these are the same”"],
        format!(
            "as printed, a sweep of {SPEED} σ/s shows what lies {:.2} σ earlier (a = .01/s), {:.2} σ (1/s), and {:.2} σ with the wait; d·r + S shows {:.2} and \
             {:.2} σ later at 3 and 10/s, and {dead:.3} σ at every rate with a wait of 2d/v",
            -printed(0.01, 0.0),
            -printed(1.0, 0.0),
            -printed(1.0, wait),
            exponential(3.0),
            exponential(10.0)
        ),
        printed(0.01, 0.0).abs() < 0.02,
        ["holds", "does not hold as printed: a sample weighs 1 − d, so the first tail wins; d·r + S with a wait does what is meant"],
    );

    // After one sweep over two still objects.
    let still = |x: f64| blob(x, 10.0) + 0.7 * blob(x, 18.0);
    let places = || (0..=560).map(|i| f64::from(i) * 0.05);
    let mut profiles = vec![Series::new("truth", Look::Line, Ink::Black, places().map(|x| [x, still(x)]).collect())];
    for (style, rule) in rules(SHOWN_RATE, wait) {
        let mut line = Voxels::new(places().collect(), kernel);
        sweep(-4.0, 32.0, 0.0, |at, _| still(at)).into_iter().for_each(|sample| line.insert(sample, rule));
        profiles.push(series(style, profile(&line)));
    }
    let figure = Figure {
        id: "decay-shift",
        title: "Decay during a sweep: each voxel shows another place".into(),
        caption: format!(
            "A sweep over still objects: slices 0.75 σ apart, {RATE_HZ} a second, v = {SPEED} σ/s, cut kernel, d = 2.576 σ. Positive is later in the sweep. \
             Exponential decay prefers the newest slices, which lie ahead, by a·σ²/v with the kernel's effective width. The printed formula gives a slice \
             that follows at once next to no weight: what first touched a voxel, from 2 σ before it, stays. A wait longer than the kernel needs to pass \
             (2d/v = {wait:.2} s) shifts nothing."
        ),
        columns: 2,
        height: 290.0,
        panels: vec![
            Panel::new(
                "Where the things lie that a voxel shows",
                Axis::log("rate of decay a, 1/s").from_to(0.01, 250.0),
                Axis::linear("shift along the sweep, σ").from_to(-3.0, 3.0),
                curves,
            ),
            Panel::new(
                format!("Still objects after a sweep, a = {SHOWN_RATE}/s"),
                Axis::linear("position, σ").from_to(2.0, 26.0),
                Axis::linear("value").from_to(0.0, 1.05),
                profiles,
            ),
        ],
    };
    report.figure(figure, folder)
}

fn profile(line: &Voxels) -> Vec<[f64; 2]> {
    line.at.iter().zip(line.values()).map(|(x, v)| [*x, v.unwrap_or(f64::NAN)]).collect()
}

/// Centre of what a line shows.
fn centre(line: &Voxels) -> f64 {
    let (mut mass, mut moment) = (0.0, 0.0);
    for (x, value) in line.at.iter().zip(line.values()) {
        let value = value.unwrap_or(0.0);
        mass += value;
        moment += value * x;
    }
    moment / mass
}

/// The probe goes to and fro; the object rests during each pass and has moved before the next.
fn moving(report: &mut Report, folder: &Path, kernel: AxisKernel) -> Result<(), Box<dyn Error>> {
    const PASSES: u32 = 12;
    const RATE: f64 = 1.0;
    const PAUSE: f64 = 0.5;
    let wait = long_wait(&kernel);
    let ends = [0.0, 28.5];
    let period = (ends[1] - ends[0]) / SPEED + PAUSE;
    let truth = |pass: u32| 14.0 + 6.0 * (f64::from(pass) * std::f64::consts::TAU / 5.0).cos();
    let mut profiles = vec![];
    let mut centres =
        vec![Series::new("truth", Look::Discs, Ink::Black, (0..PASSES).map(|p| [f64::from(p), truth(p)]).collect())];
    let mut lags = Vec::new();
    for (style, rule) in rules(RATE, wait) {
        let mut line = Voxels::new((0..=570).map(|i| f64::from(i) * 0.05).collect(), kernel);
        let mut shown = Vec::new();
        for pass in 0..PASSES {
            let [from, to] = if pass % 2 == 0 { ends } else { [ends[1], ends[0]] };
            for sample in sweep(from, to, f64::from(pass) * period, |at, _| blob(at, truth(pass))) {
                line.insert(sample, rule);
            }
            if pass == 1 {
                profiles.push(series(style, profile(&line)));
            }
            shown.push([f64::from(pass), centre(&line)]);
        }
        let squares = shown.iter().skip(1).map(|p| (p[1] - truth(p[0] as u32)).powi(2)).sum::<f64>();
        lags.push((squares / f64::from(PASSES - 1)).sqrt());
        centres.push(series(style, shown));
    }
    let before = |pass: u32| (0..=570).map(|i| f64::from(i) * 0.05).map(|x| [x, blob(x, truth(pass))]).collect();
    profiles.insert(0, Series::new("the object, second pass", Look::Line, Ink::Black, before(1)));
    profiles.insert(0, Series::new("the object, first pass", Look::Dotted, Ink::Black, before(0)));
    let [exponential, dead, none, printed, printed_wait] = lags[..] else { return Err("five rules".into()) };
    report.check(dead < 0.5 * none, format!("a wait does not follow the object: {dead} against {none} without decay"));
    let figure = Figure {
        id: "decay-motion",
        title: "An object that moves between passes, and what each rule still shows of it".into(),
        caption: format!(
            "The probe goes to and fro over the object, {period:.2} s a pass of which it rests {PAUSE} s; the object moves between passes; a = {RATE}/s. Rms \
             distance of the shown centre from the object, σ: none {none:.2}, exponential {exponential:.2}, after a wait {dead:.2}, as printed \
             {printed:.2}, as printed after the wait {printed_wait:.2}. Without decay the past stays and the mean of all passes is shown. Decay removes what is \
             old only where a slice passes again, and a wait is time in which nothing fades: to follow as closely, it needs a faster rate, which it bears \
             without shifting anything."
        ),
        columns: 2,
        height: 290.0,
        panels: vec![
            Panel::new(
                "After the second pass, which goes left",
                Axis::linear("position, σ").from_to(4.0, 28.0),
                Axis::linear("value").from_to(0.0, 1.05),
                profiles,
            ),
            Panel::new(
                "Centre of what is shown after each pass",
                Axis::linear("pass").from_to(-0.4, 11.4),
                Axis::linear("position, σ").from_to(6.0, 24.0),
                centres,
            ),
        ],
    };
    report.figure(figure, folder)
}
