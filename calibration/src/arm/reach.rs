//! Accuracy of a fitted arm's tip over all that it reaches.

use serde::Serialize;

use super::fit::Fitted;
use super::{JOINTS, Values};
use crate::statistics::Spread;

/// Number of values per joint, from its least to its greatest among the touches.
const STEPS: usize = 9;
/// Number of rings about the base.
const RINGS: usize = 4;

/// Tip accuracy within a range of distances from the base.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Ring {
    /// Inner and outer radius, mm.
    pub mm: [f64; 2],
    /// Root mean square of the tip's standard deviation (root of the sum over axes), mm.
    pub rms_mm: f64,
    /// The largest, mm.
    pub most_mm: f64,
}

/// Tip accuracy over all poses within the joints' ranges of the touches.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Reach {
    /// Root mean square of the tip's standard deviation due to the fitted parameters, mm.
    pub rms_mm: f64,
    /// The largest, mm.
    pub most_mm: f64,
    /// Additional error from rounding to whole counts, mm: the largest root mean square over
    /// the poses.
    pub rounding_mm: f64,
    /// By distance from the base; empty rings are left out.
    pub rings: Vec<Ring>,
}

impl Reach {
    /// Evaluates a fitted arm over the values that its joints had.
    pub fn of(fitted: &Fitted) -> Self {
        let mut tips: Vec<(f64, f64)> = Vec::with_capacity(STEPS.pow(3));
        let mut rounding_mm = 0.0_f64;
        for step in 0..STEPS.pow(3) {
            let steps: [usize; JOINTS] = [step / (STEPS * STEPS), step / STEPS % STEPS, step % STEPS];
            let values: Values = std::array::from_fn(|joint| {
                let [least, most] = fitted.ranges[joint];
                least + (most - least) * steps[joint] as f64 / (STEPS - 1) as f64
            });
            let from_base_mm = fitted.arm.pose(&values).point(fitted.tip_mm).length();
            tips.push((from_base_mm, fitted.sd_at(&values)));
            rounding_mm = rounding_mm.max(fitted.arm.displacement(&values, fitted.tip_mm, 0.5).rms_mm);
        }
        let (least, most) =
            tips.iter().fold((f64::INFINITY, 0.0_f64), |(least, most), (mm, _)| (least.min(*mm), most.max(*mm)));
        let edge = |ring: usize| if ring == RINGS { most } else { least + (most - least) * ring as f64 / RINGS as f64 };
        let rings = (0..RINGS).filter_map(|ring| {
            let is_last = ring + 1 == RINGS;
            let own = tips.iter().filter(|(mm, _)| *mm >= edge(ring) && (*mm < edge(ring + 1) || is_last));
            let spread = Spread::of(own.map(|(_, sd)| *sd));
            (spread.count > 0).then_some(Ring {
                mm: [edge(ring), edge(ring + 1)],
                rms_mm: spread.rms,
                most_mm: spread.max,
            })
        });
        let all = Spread::of(tips.iter().map(|(_, sd)| *sd));
        Self { rms_mm: all.rms, most_mm: all.max, rounding_mm, rings: rings.collect() }
    }
}
