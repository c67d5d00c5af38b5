//! Times inserts: the methods take turns, so that other load on the machine affects all of them.

use std::error::Error;
use std::hint::black_box;
use std::time::Instant;

use mask::Mask;
use reconstruct::{Reconstructor, Settings};
use simd::sharing::Sharing;
use simd::team::Team;
use sonoweave_core::slice::Slice;

/// Returns the quantile `q` of the samples, interpolated linearly; NaN without samples.
pub(crate) fn quantile(samples: &[f64], q: f64) -> f64 {
    let mut sorted = samples.to_vec();
    sorted.sort_by(f64::total_cmp);
    let Some(last) = sorted.len().checked_sub(1) else { return f64::NAN };
    let at = q * last as f64;
    let low = at.floor() as usize;
    sorted[low] + (sorted[(low + 1).min(last)] - sorted[low]) * at.fract()
}

/// Milliseconds per insert, run by run.
#[derive(Debug, Clone, Default)]
pub(crate) struct Times {
    runs: Vec<Vec<f64>>,
}

impl Times {
    fn all(&self) -> Vec<f64> {
        self.runs.concat()
    }

    /// Returns the quantile over all inserts of all runs.
    pub(crate) fn quantile(&self, q: f64) -> f64 {
        quantile(&self.all(), q)
    }

    pub(crate) fn median(&self) -> f64 {
        self.quantile(0.5)
    }

    /// Returns the quartiles over all inserts of all runs.
    pub(crate) fn quartiles(&self) -> [f64; 3] {
        [0.25, 0.5, 0.75].map(|q| self.quantile(q))
    }

    /// Returns the median of the first inserts, which include set-up that depends on the pixel
    /// size and most of the first bricks.
    pub(crate) fn first(&self) -> f64 {
        let firsts: Vec<f64> = self.runs.iter().filter_map(|run| run.first().copied()).collect();
        quantile(&firsts, 0.5)
    }

    /// Returns how many times slower this is than `other`: quartiles over rounds of the ratio of
    /// the two runs' medians.
    pub(crate) fn over(&self, other: &Self) -> [f64; 3] {
        self.over_at(0.5, other)
    }

    /// The same of another quantile than the median.
    pub(crate) fn over_at(&self, q: f64, other: &Self) -> [f64; 3] {
        let runs = self.runs.iter().zip(&other.runs);
        let ratios: Vec<f64> = runs.map(|(a, b)| quantile(a, q) / quantile(b, q)).collect();
        [0.25, 0.5, 0.75].map(|q| quantile(&ratios, q))
    }
}

/// A timed method: returns the milliseconds of each insert of one run.
pub(crate) type Contestant<'a> = Box<dyn FnMut() -> Result<Vec<f64>, Box<dyn Error>> + 'a>;

/// Runs all methods in every round, in alternating order.
pub(crate) fn interleaved(rounds: usize, contestants: &mut [Contestant<'_>]) -> Result<Vec<Times>, Box<dyn Error>> {
    let mut times = vec![Times::default(); contestants.len()];
    for round in 0..rounds {
        let mut order: Vec<usize> = (0..contestants.len()).collect();
        if round % 2 == 1 {
            order.reverse();
        }
        for c in order {
            times[c].runs.push(contestants[c]()?);
        }
    }
    Ok(times)
}

/// Times one call for each slice.
pub(crate) fn each<E: Into<Box<dyn Error>>>(
    slices: &[Slice],
    mut insert: impl FnMut(&Slice) -> Result<(), E>,
) -> Result<Vec<f64>, Box<dyn Error>> {
    slices
        .iter()
        .map(|slice| {
            let start = Instant::now();
            insert(slice).map_err(Into::into)?;
            Ok(start.elapsed().as_secs_f64() * 1e3)
        })
        .collect()
}

/// Times a new reconstructor for every run: its memory, its filter and the start of its threads
/// are part of a scan's cost. Creating it is not timed.
pub(crate) fn ours<'a>(settings: &'a Settings, mask: &'a Mask, slices: &'a [Slice]) -> Contestant<'a> {
    Box::new(move || {
        let mut reconstructor = Reconstructor::new(settings.clone(), mask.clone())?;
        each(slices, |slice| reconstructor.insert(slice).map(drop))
    })
}

/// Times arithmetic in registers, which is shared like a slice, takes as long, and keeps a core
/// busy. Two threads gain 2 by it. They gain nothing while their processors are threads of one
/// core, as those of a virtual machine may be from one moment to the next.
pub(crate) fn arithmetic<'a>(threads: usize) -> Contestant<'a> {
    Box::new(move || {
        let team = Team::new("arithmetic", threads)?;
        let sharing = Sharing::of(team.as_ref());
        let mut sums = [0.0; 64];
        let mut time = || {
            let start = Instant::now();
            sharing.chunks(&mut sums, 1, |_, sum| {
                let mut chains = black_box([1.0_f64; 24]);
                for _ in 0..1000 {
                    chains = chains.map(|x| x * 0.999 + 0.001);
                }
                sum[0] = chains.iter().sum();
            });
            start.elapsed().as_secs_f64() * 1e3
        };
        let times = (0..40).map(|_| time()).collect();
        black_box(sums);
        Ok(times)
    })
}

/// Inserts all slices into a new reconstructor, untimed: warms up, and gives the volume for
/// checking.
pub(crate) fn reconstructed(
    settings: &Settings,
    mask: &Mask,
    slices: &[Slice],
) -> Result<Reconstructor, Box<dyn Error>> {
    let mut reconstructor = Reconstructor::new(settings.clone(), mask.clone())?;
    for slice in slices {
        reconstructor.insert(slice)?;
    }
    Ok(reconstructor)
}
