//! The kernel's width in the plane by leave-one-out: some slices are predicted from all others.
//!
//! A volume is the sums of all its slices. Without a slice's own part, the sums around its plane
//! predict its picture. The picture is filtered by a fixed width, which is no candidate's.
//!
//! The width across the plane is half the gap between slices. Leave-one-out would not tell it: a
//! slice that is left out doubles the gap, which asks for wider kernels than the whole sweep does.

use std::fmt;
use std::sync::{Arc, Mutex, PoisonError};

use pipeline::{Observer, OffPlane, Outcome};
use reconstruct::kernel::Method;
use reconstruct::path_choice::PathChoice;
use reconstruct::settings::IN_PLANE_SIGMA;
use reconstruct::{Compounding, Reconstructor, Settings};
use sonoweave_core::slice::Slice;
use volume::Voxels;
use volume::brick::{EDGE, VOXELS};
use volume::read::Values as _;

use super::sweep::Sweep;
use crate::app::reporter::Steps;
use crate::failure::Failure;

/// Candidates, as multiples of the default width. A narrower one falls below the voxels.
const CANDIDATES: [f64; 9] = [1.0, 1.19, 1.41, 1.68, 2.0, 2.38, 2.83, 3.36, 4.0];
/// Slices that are predicted, at most twice as many.
const SLICES: usize = 20;
/// Least number of predicted slices.
const LEAST_SLICES: usize = 5;
/// Voxels that are predicted, at most.
const PREDICTED: usize = 50_000;
/// Least weight that predicts a voxel, as a part of a slice's at its peak.
const LEAST_WEIGHT: f32 = 0.02;
/// Least weight of a voxel of the picture itself.
const LEAST_OWN: f32 = 0.05;
/// Share of the voxels that must be predicted.
const LEAST_PREDICTED: f64 = 0.5;
/// Wider candidates are left out once one is so much worse than the best.
const WORSE: f64 = 1.005;
/// Width of the picture's filter, in pixels; and across the plane, in voxels.
const PICTURE: [f64; 2] = [0.75, 0.2];

/// A width that was tried.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Tried {
    /// σ along u, v and the normal, mm.
    sigma_mm: [f64; 3],
    /// Root mean square error of the predicted voxels, grey levels.
    rms: f64,
}

/// The chosen widths.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Choice {
    /// σ along u, v and the normal, mm.
    pub(crate) sigma_mm: [f64; 3],
    /// The tried widths, in that order.
    tried: Vec<Tried>,
    slices: usize,
    voxels: usize,
}

impl fmt::Display for Choice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "leave-one-out of {} slices, {} voxels:", self.slices, self.voxels)?;
        for Tried { sigma_mm: [u, v, n], rms } in &self.tried {
            write!(f, "\n  σ {u:.3}, {v:.3}, {n:.3} mm: {rms:.3} grey levels (rms)")?;
        }
        Ok(())
    }
}

impl Choice {
    /// Returns the candidate with the least error, the narrowest of equal ones.
    fn best(&self) -> Option<&Tried> {
        self.tried.iter().min_by(|a, b| a.rms.total_cmp(&b.rms))
    }

    /// Returns whether the last candidate is worse than the best one.
    fn is_worse(&self) -> bool {
        self.tried.last().zip(self.best()).is_some_and(|(last, best)| last.rms > WORSE * best.rms)
    }

    /// Returns a note for the report.
    pub(crate) fn sentence(&self) -> String {
        let [u, v, n] = self.sigma_mm;
        format!("σ {u:.3}, {v:.3}, {n:.3} mm by leave-one-out of {} slices", self.slices)
    }
}

/// A slice that is predicted: places in the volume, and the picture's values there.
struct Target {
    slice: Slice,
    voxels: Vec<([i64; 3], f32)>,
}

/// Keeps slices spread over the sweep.
#[derive(Default)]
struct Spread(Mutex<(u64, u64, Vec<Slice>)>);

impl Observer for Spread {
    fn slice(&self, _world: &str, _item: u64, slice: &Slice) {
        let mut state = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let (count, shift, kept) = &mut *state;
        if u64::from(count.trailing_zeros()) >= *shift {
            kept.push(slice.clone());
            if kept.len() > 2 * SLICES {
                *kept = kept.iter().step_by(2).cloned().collect();
                *shift += 1;
            }
        }
        *count += 1;
    }
}

/// Chooses the kernel's widths for a sweep.
///
/// # Errors
/// [`Failure`] for settings that have no parts of slices, and if the sweep cannot be reconstructed.
pub(crate) fn choose(sweep: &Sweep, steps: Steps<'_>) -> Result<Choice, Failure> {
    check(&sweep.session.settings)?;
    let spread = Arc::new(Spread::default());
    let first = run(sweep, None, vec![spread.clone() as Arc<dyn Observer>], steps)?;
    let settings = first.reconstructor.settings();
    let (Some(pixel_mm), [.., Some(across_mm)]) = (first.reconstructor.pixel_mm(), settings.sigma_mm) else {
        fail!("--sigma leave-one-out: no slice was inserted; give three numbers")
    };
    let [u, v] = pixel_mm.map(|pixel| IN_PLANE_SIGMA * settings.spacing_mm.max_element().max(pixel));
    let default = [u, v, across_mm];
    let kept = std::mem::take(&mut spread.0.lock().unwrap_or_else(PoisonError::into_inner).2);
    let targets = targets(&first, pixel_mm, kept)?;
    if targets.len() < LEAST_SLICES {
        fail!(
            "--sigma leave-one-out: {} slices are too few; give three numbers, or a recording of {} or more slices",
            targets.len() + 2,
            LEAST_SLICES + 2
        )
    }
    drop(first);
    let voxels = targets.iter().map(|target| target.voxels.len()).sum();
    let mut choice = Choice { sigma_mm: default, tried: Vec::new(), slices: targets.len(), voxels };
    for by in CANDIDATES {
        let sigma_mm = [by * u, by * v, across_mm];
        let errors = errors(&run(sweep, Some(sigma_mm), Vec::new(), steps)?, &targets)?;
        if (errors.len() as f64) < LEAST_PREDICTED * voxels as f64 || errors.is_empty() {
            fail!(
                "--sigma leave-one-out: slices are not predicted by their neighbours, which lie too far apart; sweep \
                 more slowly, or give three numbers"
            )
        }
        let squares: f64 = errors.iter().map(|error| error * error).sum();
        choice.tried.push(Tried { sigma_mm, rms: (squares / errors.len() as f64).sqrt() });
        if choice.is_worse() {
            break;
        }
    }
    choice.sigma_mm = choice.best().map_or(default, |tried| tried.sigma_mm);
    Ok(choice)
}

/// Refuses settings under which a slice's part cannot be taken out.
fn check(settings: &Settings) -> Result<(), Failure> {
    if settings.method.interpolates() {
        fail_usage!(
            "--sigma leave-one-out: the kernel {} has no width in the plane; choose the method gaussian-truncated, or \
             give three numbers",
            settings.method.name()
        );
    }
    let compounding = settings.compounding;
    if compounding != Compounding::Mean {
        fail_usage!(
            "--sigma leave-one-out: takes slices out of a mean; choose the compounding mean instead of {}, or give \
             three numbers",
            compounding.name()
        );
    }
    if settings.gap_weights || settings.shadow_weights.is_some() {
        fail_usage!(
            "--sigma leave-one-out: weights of gaps and shadows are not taken out; choose σ without them, and give it \
             as three numbers"
        );
    }
    Ok(())
}

/// Reconstructs the sweep with these widths, or with the default in the plane and half the gap
/// across it.
fn run(
    sweep: &Sweep,
    sigma_mm: Option<[f64; 3]>,
    observers: Vec<Arc<dyn Observer>>,
    steps: Steps<'_>,
) -> Result<Outcome, Failure> {
    let mut sweep = sweep.without_observers();
    sweep.session.path = PathChoice::General;
    sweep.session.observers = observers;
    sweep.session.settings.standard_error = false;
    match sigma_mm {
        Some(sigma_mm) => sweep.session.settings.sigma_mm = sigma_mm.map(Some),
        None => sweep.off_plane = OffPlane::Auto,
    }
    let outcome = sweep.reconstruct("choosing σ", steps)?;
    if outcome.reconstructor.work().weights_clamped > 0 {
        fail!("--sigma leave-one-out: the largest weight was reached; give a larger --max-weight")
    }
    Ok(outcome)
}

/// Returns the slices with their pictures around their planes, without those at both ends.
fn targets(outcome: &Outcome, pixel_mm: [f64; 2], kept: Vec<Slice>) -> Result<Vec<Target>, Failure> {
    let settings = outcome.reconstructor.settings();
    let across = PICTURE[1] * settings.spacing_mm.min_element();
    let [u, v] = pixel_mm.map(|pixel| PICTURE[0] * pixel);
    let picture = Settings {
        method: Method::GaussianTruncated,
        sigma_mm: [u, v, across].map(Some),
        support: [None; 2],
        ..settings.clone()
    };
    let inner = kept.len().saturating_sub(2);
    let most = PREDICTED / inner.max(1);
    let slices = kept.into_iter().skip(1).take(inner);
    let target = |slice: Slice| {
        let own = alone(&picture, outcome, &slice)?;
        let [mut values, mut weights] = [[0.0; VOXELS]; 2];
        let mut voxels = Vec::new();
        let mut bricks: Vec<_> = own.volume().bricks().collect();
        bricks.sort_unstable();
        for brick in bricks {
            let volume: &dyn Voxels = own.volume();
            volume.brick(brick, &mut values, &mut weights);
            for (at, (value, weight)) in values.iter().zip(&weights).enumerate() {
                if *weight > LEAST_OWN {
                    let within = [at % EDGE, at / EDGE % EDGE, at / EDGE / EDGE];
                    voxels.push(([0, 1, 2].map(|a| i64::from(brick[a]) * EDGE as i64 + within[a] as i64), *value));
                }
            }
        }
        let step = voxels.len().div_ceil(most).max(1);
        Ok(Target { slice, voxels: voxels.into_iter().step_by(step).collect() })
    };
    slices.map(target).collect()
}

/// Reconstructs one slice alone.
fn alone(settings: &Settings, outcome: &Outcome, slice: &Slice) -> Result<Reconstructor, Failure> {
    let of_slice = |why: String| Failure::new(format!("--sigma leave-one-out: {why}"));
    let mut own =
        Reconstructor::new(settings.clone(), (*outcome.mask.mask).clone()).map_err(|why| of_slice(why.to_string()))?;
    own.insert(slice).map_err(|why| of_slice(why.to_string()))?;
    Ok(own)
}

/// Returns the errors of the values that all other slices predict, where they reach.
fn errors(outcome: &Outcome, targets: &[Target]) -> Result<Vec<f64>, Failure> {
    let mut errors = Vec::new();
    for Target { slice, voxels } in targets {
        let own = alone(outcome.reconstructor.settings(), outcome, slice)?;
        errors.extend(voxels.iter().filter_map(|(at, value)| {
            let ((r, w), (own_r, own_w)) = (outcome.reconstructor.volume().voxel(*at), own.volume().voxel(*at));
            let left = w - own_w;
            (left > LEAST_WEIGHT).then(|| f64::from((r - own_r) / left - value))
        }));
    }
    Ok(errors)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn candidates_end_once_one_is_worse_than_the_best() {
        let tried = |rms: f64| Tried { sigma_mm: [rms; 3], rms };
        let mut choice = Choice { sigma_mm: [0.0; 3], tried: Vec::new(), slices: 1, voxels: 1 };
        assert!(choice.best().is_none() && !choice.is_worse());
        for (rms, is_worse) in [(3.0, false), (1.0, false), (1.0, false), (1.004, false), (1.006, true)] {
            choice.tried.push(tried(rms));
            assert_eq!(choice.is_worse(), is_worse, "{rms}");
        }
        assert_eq!(choice.best(), Some(&tried(1.0)));
    }

    #[test]
    fn few_slices_spread_over_the_sweep_are_kept() {
        use sonoweave_core::frames::Transform;
        use sonoweave_core::slice::{Image, Pixels};

        let spread = Spread::default();
        for time_ns in 0..1000 {
            let image = Image::new(1, 1, Pixels::U8(vec![0].into()));
            spread.slice("World", 0, &Slice { image, time_ns, world_from_image: Transform::IDENTITY });
        }
        let times: Vec<i64> = spread.0.lock().unwrap().2.iter().map(|slice| slice.time_ns).collect();
        assert!((SLICES..=2 * SLICES).contains(&times.len()), "{times:?}");
        assert!(times.windows(2).all(|two| two[1] - two[0] == times[1] - times[0]), "{times:?}");
    }
}
