//! Effect of each decay rule on a static or moving object: its shown shape and position, by the
//! equations in f64, and by the reconstructor.

use std::error::Error;
use std::path::Path;

use sonoweave_figures::{Axis, Figure, Ink, Panel, Series, SeriesStyle, order};

use reconstruct::kernel::AxisKernel;

use crate::decay::{RATE_HZ, Rule, SPEED, Sample, Voxels, kernel, long_wait, shift, sweep};
use crate::decay_reconstructed::{self, ReconstructedLine};
use crate::report::Report;

/// Decay rate of the profiles, 1/s.
const SHOWN_RATE: f64 = 1.0;
/// Decay rates at which the reconstructor is measured, 1/s.
const MEASURED: [f64; 9] = [0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0];
/// Permitted difference between reconstructor and equations: shifts and centres, σ; and
/// profiles, of an object of height 1.
const TOLERANCE: f64 = 0.01;
pub(crate) type Style = (&'static str, SeriesStyle, Ink);
pub(crate) const NONE: Style = ("none", SeriesStyle::Dashed, Ink::Grey);
pub(crate) const EXPONENTIAL: Style = ("exponential", SeriesStyle::Line, Ink::Vermilion);
pub(crate) const DEAD_TIME: Style = ("exponential after a wait of 2d/v", SeriesStyle::Line, Ink::Blue);
pub(crate) const PRINTED: Style = ("as printed, exponential", SeriesStyle::Dashed, Ink::Purple);
pub(crate) const PRINTED_WAIT: Style = ("as printed, after the wait", SeriesStyle::Dotted, Ink::Green);

/// Returns all rules at a rate.
pub(crate) fn rules(rate: f64, wait: f64) -> [(Style, Rule); 5] {
    [
        (EXPONENTIAL, Rule::Exponential { rate }),
        (DEAD_TIME, Rule::DeadTime { rate, wait }),
        // Drawn over the previous one, which it equals unless a wait is longer.
        (NONE, Rule::None),
        (PRINTED, Rule::Printed { rate, wait: 0.0 }),
        (PRINTED_WAIT, Rule::Printed { rate, wait }),
    ]
}

pub(crate) fn series((name, view_settings, ink): Style, points: Vec<[f64; 2]>) -> Series {
    Series::new(name, view_settings, ink, points)
}

/// Returns the reconstructor's points beside those of [`series`].
fn crosses((name, _, ink): Style, points: Vec<[f64; 2]>) -> Series {
    Series::new(format!("{name}, by the reconstructor"), SeriesStyle::Crosses, ink, points).unlisted()
}

/// Returns the legend entry of all crosses.
fn crosses_entry() -> Series {
    Series::new("crosses: by the reconstructor", SeriesStyle::Crosses, Ink::Black, Vec::new())
}

/// An object of height 1 around a position.
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
    curves.push(Series::new("a·σ²/v", SeriesStyle::Dotted, Ink::Black, within(&|a| a / SPEED)));
    curves.push(Series::new("a·σ_eff²/v", SeriesStyle::Dashed, Ink::Black, within(&|a| a * variance / SPEED)));

    // The reconstructor at fewer rates.
    let (mut worst, mut dead) = (0.0_f64, 0.0_f64);
    let mut measured: [Vec<[f64; 2]>; 5] = Default::default();
    for rate in MEASURED {
        for ((_, rule), points) in rules(rate, wait).into_iter().zip(&mut measured) {
            let [reconstructed, model] = [decay_reconstructed::shift(rule)?, shift(rule, kernel)];
            points.push([rate, reconstructed]);
            worst = worst.max((reconstructed - model).abs());
            if let Rule::DeadTime { .. } = rule {
                dead = dead.max(reconstructed.abs());
            }
        }
    }
    curves.push(crosses_entry());
    for ((style, _), points) in rules(1.0, wait).into_iter().zip(measured) {
        curves.push(crosses(style, points));
    }
    report.check(
        worst < TOLERANCE,
        format!("shifts by the reconstructor are up to {worst} σ from the equations', more than {TOLERANCE}"),
    );
    report.check(dead < 0.02, format!("the reconstructor's wait of 2d/v shifts by {dead} σ"));
    let exponential = |rate| decay_reconstructed::shift(Rule::Exponential { rate });
    for rate in [1.0, 3.0, 10.0] {
        let expected = rate * variance / SPEED;
        report.near(&format!("shift of exponential decay at a rate of {rate}/s"), exponential(rate)?, expected, 0.2);
    }
    let printed = |rate, wait| decay_reconstructed::shift(Rule::Printed { rate, wait });
    let [slow, fast, waiting] = [printed(0.01, 0.0)?, printed(1.0, 0.0)?, printed(1.0, wait)?];
    report.check((-2.3..-1.9).contains(&slow), format!("the printed formula shifts by {slow}"));
    report.check((-2.3..-1.9).contains(&waiting), format!("the printed formula with a wait shifts by {waiting}"));
    report.claim(
        ["C8", "r = d·r + (1 − d)·S fades old data; exp(−at), or wait and then exp", "“except for the decay factor, these are the same”"],
        format!(
            "measured on the reconstructor (within {worst:.4} σ of the equations): as printed, a sweep of {SPEED} σ/s shows what lies {:.2} σ earlier \
             (a = .01/s), {:.2} σ (1/s), and {:.2} σ with the wait; d·r + S shows {:.2} and {:.2} σ later at 3 and 10/s, and at most {} σ at every rate with a \
             wait of 2d/v",
            -slow,
            -fast,
            -waiting,
            exponential(3.0)?,
            exponential(10.0)?,
            order(dead)
        ),
        slow.abs() < 0.02,
        ["holds", "does not hold as printed: a sample weighs 1 − d, so the first tail wins; d·r + S with a wait does what is meant"],
    );

    // After one sweep over two static objects.
    let still = |x: f64| blob(x, 10.0) + 0.7 * blob(x, 18.0);
    let places = || (0..=560).map(|i| f64::from(i) * 0.05);
    let mut profiles =
        vec![Series::new("truth", SeriesStyle::Line, Ink::Black, places().map(|x| [x, still(x)]).collect())];
    for (style, rule) in rules(SHOWN_RATE, wait) {
        let mut pair = Pair::new(places().collect(), kernel, rule)?;
        for sample in sweep(-4.0, 32.0, 0.0, |at, _| still(at)) {
            pair.insert(sample, rule)?;
        }
        pair.check(report, "after a sweep", style);
        profiles.push(series(style, pair.profile()));
        profiles.push(crosses(style, pair.reconstructed_profile()));
    }
    let figure = Figure {
        id: "decay-shift",
        title: "Decay during a sweep: each voxel shows another place".into(),
        caption: format!(
            "A sweep over still objects: slices 0.75 σ apart, {RATE_HZ} a second, v = {SPEED} σ/s, cut kernel, d = 2.576 σ. Positive is later in the sweep. \
             Exponential decay prefers the newest slices, which lie ahead, by a·σ²/v with the kernel's effective width. The printed formula gives a slice \
             that follows at once next to no weight: what first touched a voxel, from 2 σ before it, stays. A wait longer than the kernel needs to pass \
             (2d/v = {wait:.2} s) shifts nothing. Crosses: the reconstructor on the same slices, \
             in three dimensions; its shifts are within {worst:.4} σ of the equations'."
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

/// A line of voxels by the equations, and the same by the reconstructor.
struct Pair {
    model: Voxels,
    reconstructed: ReconstructedLine,
}

impl Pair {
    fn new(at: Vec<f64>, kernel: AxisKernel, rule: Rule) -> Result<Self, Box<dyn Error>> {
        Ok(Self { reconstructed: ReconstructedLine::new(&at, rule)?, model: Voxels::new(at, kernel) })
    }

    fn insert(&mut self, sample: Sample, rule: Rule) -> Result<(), Box<dyn Error>> {
        self.model.insert(sample, rule);
        self.reconstructed.insert(sample)
    }

    fn profile(&self) -> Vec<[f64; 2]> {
        points(&self.model.at, &self.model.values())
    }

    /// Returns every 20th voxel, since crosses have a size.
    fn reconstructed_profile(&self) -> Vec<[f64; 2]> {
        points(&self.model.at, &self.reconstructed.values()).into_iter().step_by(20).collect()
    }

    /// Returns the centres of what both show.
    fn centres(&self) -> [f64; 2] {
        [self.model.values(), self.reconstructed.values()].map(|values| centre(&self.model.at, &values))
    }

    fn check(&self, report: &mut Report, when: &str, (name, ..): Style) {
        let [model, reconstructed] = [self.model.values(), self.reconstructed.values()];
        // A slice's reach ends at a voxel or just before it: there a rounding error decides.
        // Such voxels are few.
        let off = |(m, w): (&Option<f64>, &Option<f64>)| match (m, w) {
            (Some(m), Some(w)) => (m - w).abs() > TOLERANCE,
            (m, w) => m.is_some() != w.is_some(),
        };
        let count = model.iter().zip(&reconstructed).filter(|pair| off(*pair)).count();
        report.check(
            100 * count <= model.len(),
            format!(
                "{name}, {when}: {count} of {} voxels by the reconstructor are more than {TOLERANCE} from the equations",
                model.len()
            ),
        );
    }
}

fn points(at: &[f64], values: &[Option<f64>]) -> Vec<[f64; 2]> {
    at.iter().zip(values).map(|(x, v)| [*x, v.unwrap_or(f64::NAN)]).collect()
}

/// Returns the centre of mass of the values on a line.
fn centre(at: &[f64], values: &[Option<f64>]) -> f64 {
    let (mut mass, mut moment) = (0.0, 0.0);
    for (x, value) in at.iter().zip(values) {
        let value = value.unwrap_or(0.0);
        mass += value;
        moment += value * x;
    }
    moment / mass
}

/// The probe moves to and fro; the object rests during each pass and moves between passes.
fn moving(report: &mut Report, folder: &Path, kernel: AxisKernel) -> Result<(), Box<dyn Error>> {
    const PASSES: u32 = 12;
    const RATE: f64 = 1.0;
    const PAUSE: f64 = 0.5;
    let wait = long_wait(&kernel);
    let ends = [0.0, 28.5];
    let period = (ends[1] - ends[0]) / SPEED + PAUSE;
    let truth = |pass: u32| 14.0 + 6.0 * (f64::from(pass) * std::f64::consts::TAU / 5.0).cos();
    let mut profiles = vec![crosses_entry()];
    let mut centres = vec![Series::new(
        "truth",
        SeriesStyle::Discs,
        Ink::Black,
        (0..PASSES).map(|p| [f64::from(p + 1), truth(p)]).collect(),
    )];
    let (mut lags, mut apart) = (Vec::new(), 0.0_f64);
    for (style, rule) in rules(RATE, wait) {
        let mut pair = Pair::new((0..=570).map(|i| f64::from(i) * 0.05).collect(), kernel, rule)?;
        let ([mut shown, mut reconstructed], mut squares) = ([Vec::new(), Vec::new()], 0.0);
        for pass in 0..PASSES {
            let [from, to] = if pass % 2 == 0 { ends } else { [ends[1], ends[0]] };
            for sample in sweep(from, to, f64::from(pass) * period, |at, _| blob(at, truth(pass))) {
                pair.insert(sample, rule)?;
            }
            if pass == 1 {
                profiles.push(series(style, pair.profile()));
                profiles.push(crosses(style, pair.reconstructed_profile()));
            }
            let centres = pair.centres();
            shown.push([f64::from(pass + 1), centres[0]]);
            reconstructed.push([f64::from(pass + 1), centres[1]]);
            if pass > 0 {
                squares += (centres[1] - truth(pass)).powi(2);
            }
            apart = apart.max((centres[0] - centres[1]).abs());
        }
        pair.check(report, "after all passes", style);
        lags.push((squares / f64::from(PASSES - 1)).sqrt());
        centres.push(series(style, shown));
        centres.push(crosses(style, reconstructed));
    }
    report.check(apart < TOLERANCE, format!("centres by the reconstructor are up to {apart} σ from the equations'"));
    let before = |pass: u32| (0..=570).map(|i| f64::from(i) * 0.05).map(|x| [x, blob(x, truth(pass))]).collect();
    profiles.insert(0, Series::new("the object, second pass", SeriesStyle::Line, Ink::Black, before(1)));
    profiles.insert(0, Series::new("the object, first pass", SeriesStyle::Dotted, Ink::Black, before(0)));
    let [exponential, dead, none, printed, printed_wait] = lags[..] else { return Err("five rules".into()) };
    // The caption states this: a wait delays the response, the printed formula with the wait
    // even more.
    report.check(exponential < dead && dead < printed_wait, format!("distances from the object: {lags:?}"));
    report.check(dead < 0.5 * none, format!("a wait does not follow the object: {dead} against {none} without decay"));
    let figure = Figure {
        id: "decay-motion",
        title: "An object that moves between passes, and what each rule still shows of it".into(),
        caption: format!(
            "The probe goes to and fro over the object, {period:.2} s a pass of which it rests {PAUSE} s; the object moves between passes; a = {RATE}/s. Rms \
             distance of the centre that the reconstructor shows from the object, σ: none {none:.2}, exponential {exponential:.2}, after a wait {dead:.2}, as printed \
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
                Axis::linear("pass").from_to(0.6, 12.4),
                Axis::linear("position, σ").from_to(6.0, 24.0),
                centres,
            ),
        ],
    };
    report.figure(figure, folder)
}
