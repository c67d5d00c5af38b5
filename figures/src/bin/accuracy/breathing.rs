//! Gates by breathing: the motion that is left in the frames used, and gates of bodies at rest.

use std::error::Error;

use glam::DVec3;
use serde_json::{Map, Value, json};

use sync::gating::{Gate, Signal};

use crate::report::{Report, digits, markdown};
use crate::tracker::Draws;

/// Length of a recording, s, and rates of the sensor and of the video, Hz.
const SECONDS: f64 = 40.0;
const POSES_HZ: f64 = 120.0;
const FRAMES_HZ: f64 = 30.0;
/// Displacement by breathing, mm; the sensor's noise along each axis, mm.
const BREATH_MM: f64 = 6.0;
const NOISE_MM: f64 = 0.3;
/// Shares of the frames that gates use, and the most motion left, mm.
const SHARES: [(f64, f64); 3] = [(0.25, 0.2), (0.35, 0.2), (0.5, 0.6)];
/// Bodies at rest, and the largest share of them that may be gated.
const RESTING: u64 = 300;
const FALSE: f64 = 0.01;

/// The displacement of a body over time, mm: breaths of uneven length and depth, or none.
struct Body {
    /// Begins of breaths, s, and their depths, mm.
    breaths: Vec<(f64, f64)>,
    /// Wander, a knot a second, mm.
    wander: Vec<f64>,
}

impl Body {
    fn draw(breath_mm: f64, wander_mm: f64, draws: &mut Draws) -> Self {
        let period_s = 3.0 + 2.0 * draws.unit();
        let (mut begin, mut breaths) = (-draws.unit() * period_s, Vec::new());
        while begin < SECONDS + 2.0 * period_s {
            let [depth, length, _] = draws.vector().to_array();
            breaths.push((begin, breath_mm * (1.0 + 0.1 * depth)));
            begin += period_s * (1.0 + 0.08 * length).max(0.5);
        }
        let mut level = wander_mm * draws.vector().x;
        let wander = (0..SECONDS as usize + 3).map(|_| {
            level = 0.6 * level + 0.8 * wander_mm * draws.vector().x;
            level
        });
        let wander = wander.collect();
        Self { breaths, wander }
    }

    /// A body rests at the end of breathing out.
    fn breath_mm(&self, time_s: f64) -> f64 {
        let next = self.breaths.partition_point(|(begin, _)| *begin <= time_s);
        let ((begin, mm), (end, _)) = (self.breaths[next - 1], self.breaths[next]);
        mm * libm::pow(libm::sin(std::f64::consts::PI * (time_s - begin) / (end - begin)), 4.0)
    }

    fn wander_mm(&self, time_s: f64) -> f64 {
        let share = 0.5 - 0.5 * libm::cos(std::f64::consts::PI * time_s.fract());
        let [a, b] = [0, 1].map(|step| self.wander[time_s as usize + step]);
        a + (b - a) * share
    }

    /// Returns the signal of a sensor on it.
    fn signal(&self, draws: &mut Draws) -> Signal {
        let axis = DVec3::new(0.36, 0.48, 0.8);
        let sample = |at: usize| {
            let time_s = at as f64 / POSES_HZ;
            (time_s, axis * (self.breath_mm(time_s) + self.wander_mm(time_s)) + draws.vector() * NOISE_MM)
        };
        Signal::of_positions(&(0..(SECONDS * POSES_HZ) as usize).map(sample).collect::<Vec<_>>())
    }
}

/// Gates bodies that breathe, and bodies at rest.
///
/// # Errors
/// If a body that breathes is not gated.
pub(crate) fn compare(
    sweeps: u64,
    report: &mut Report,
    figures: &mut Map<String, Value>,
) -> Result<(), Box<dyn Error>> {
    let frames_s: Vec<f64> = (1..(SECONDS * FRAMES_HZ) as usize - 1).map(|at| at as f64 / FRAMES_HZ).collect();
    let mut lines = Vec::new();
    for (share, most) in SHARES {
        let (mut squares, mut before, mut worst, mut missing) = (0.0, 0.0, 0.0_f64, 0.0);
        let bodies = 4 * sweeps;
        for seed in 1..=bodies {
            let mut draws = Draws::new(seed);
            let body = Body::draw(BREATH_MM, 0.0, &mut draws);
            let gate = Gate::new(&body.signal(&mut draws), &frames_s, share).map_err(|why| why.to_string())?;
            let all: Vec<f64> = frames_s.iter().map(|time_s| body.breath_mm(*time_s)).collect();
            let used = all.iter().zip(&gate.accepted).filter(|(_, accepted)| **accepted).map(|(mm, _)| *mm);
            let left = variance(used).sqrt();
            squares += left * left;
            before += variance(all.iter().copied());
            worst = worst.max(left);
            missing += gate.missing_s[1];
        }
        let [left, all] = [squares, before].map(|sum: f64| (sum / bodies as f64).sqrt());
        let missing = missing / bodies as f64;
        report.findings.check(worst <= most, format!("gate of {share}: {worst:.3} mm left, {most} at most"));
        figures.insert(format!("breathing/{share}/left, mm"), json!(left));
        figures.insert(format!("breathing/{share}/worst, mm"), json!(worst));
        let percent = format!("{:.0} %", 100.0 * share);
        lines.push(vec![
            percent,
            digits(all, 3),
            digits(left, 3),
            digits(worst, 3),
            digits(missing, 3),
            digits(1.0 / missing, 2),
        ]);
    }
    let rest = RESTING.min(50 * sweeps);
    let gated = (0..rest).filter(|seed| {
        let mut draws = Draws::new(10_000 + seed);
        let body = Body::draw(0.0, 0.5 * (seed % 3) as f64, &mut draws);
        Gate::new(&body.signal(&mut draws), &frames_s, 0.35).is_ok()
    });
    let gated = gated.count();
    let holds = gated as f64 <= FALSE * rest as f64;
    report.findings.check(holds, format!("{gated} of {rest} bodies at rest are gated"));
    figures.insert("breathing/gated at rest".to_owned(), json!(gated as f64 / rest as f64));
    let columns = [
        "frames used",
        "motion, mm",
        "left, mm",
        "worst, mm",
        "longest time without a frame, s",
        "no holes below, mm/s",
    ];
    report.section(format!(
        "# Breathing\n\nStandard deviations of a body's displacement in {SECONDS:.0} s: breathing of {BREATH_MM:.0} mm, by \
         a sensor with noise of {NOISE_MM} mm. Of {rest} bodies at rest, some of which wander by 1 mm, {gated} are \
         gated.\n\n{}",
        markdown(&columns, &lines)
    ));
    println!("breathing");
    Ok(())
}

fn variance(values: impl Iterator<Item = f64> + Clone) -> f64 {
    let count = values.clone().count().max(1) as f64;
    let mean = values.clone().sum::<f64>() / count;
    values.map(|value| (value - mean).powi(2)).sum::<f64>() / count
}
