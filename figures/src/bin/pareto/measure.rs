//! Measures contestants over one scan: each runs once untimed and is judged, then all are timed
//! in turns.

use std::error::Error;

use glam::DVec3;

use phantom::Errors;
use reconstruct::Work;
use reconstruct::kernel::Method;
use reconstruct::planar::reference;
use sonoweave_figures::gaps::widest_gap;
use volume::Grid;

use crate::baselines::{Drop, Splat, plain};
use crate::check::{Deviation, against_equations, against_sums};
use crate::contestant::{Contestant, Input, Path, Reconstructed, default_kernels, on_lattice};
use crate::field::Field;
use crate::limits;
use crate::report::Report;
use crate::stage::{Probes, Stage};
use crate::timing::{Contestant as Turn, Times, interleaved};

/// A whole scan that takes longer than this, ms, gets fewer rounds.
const DEAR_MS: f64 = 150.0;
/// Difference in coverage, as a share of all positions, above which results are not comparable.
const SAME_COVERAGE: f64 = 0.002;
/// Margin around the slices for every support and for the tracker's errors, mm.
const MARGIN_MM: f64 = 5.0;
/// Rounding in f32 at a pixel's border decides which of two pixels is nearest, and they differ
/// by noise: permitted root mean square and maximum.
const AT_BORDERS: [f64; 2] = [1.0, 60.0];
/// Permitted deviation of the planar path from its sums in f64, relative to the range of grey
/// levels: root mean square and maximum.
const COLUMNS: [f64; 2] = [2e-6, 1e-5];
/// Permitted deviation of splats in f32 from splats in f64, root mean square and maximum.
const SPLAT_BOUNDS: [f64; 2] = [0.001, 0.01];

/// Permitted error of a correction of poses, in that without it.
const NO_HARM: f64 = 1.01;

/// Number of timed rounds.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Rounds {
    pub(crate) cheap: usize,
    pub(crate) dear: usize,
}

/// Errors of one result, grey levels.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Score {
    /// Inside, against the scene.
    pub(crate) truth: Errors,
    /// Inside, against the scene under the default's effective width.
    pub(crate) blurred: Errors,
    /// Inside, against the default's equations in f64 at the same positions.
    pub(crate) oracle: Errors,
    /// Gradient inside, root mean square of the difference's length, grey levels per mm.
    pub(crate) slope: f64,
    /// At positions where the default's weight is low, against the blurred scene.
    pub(crate) boundary: Errors,
}

impl Score {
    fn of(field: &Field, stage: &Stage) -> Self {
        let against = |probes: &Probes, reference: &[f32]| {
            Errors::over(reference, |i| field.sample(probes.places[i]).map(|v| v as f32), |_| true)
        };
        let inside = &stage.inside;
        let (mut squares, mut count) = (0.0, 0.0);
        for (place, expected) in inside.places.iter().zip(&inside.slope) {
            if let Some(slope) = field.slope(*place) {
                squares += (slope - *expected).length_squared();
                count += 1.0;
            }
        }
        Self {
            truth: against(inside, &inside.truth),
            blurred: against(inside, &inside.blurred),
            oracle: against(inside, &inside.oracle),
            slope: f64::sqrt(squares / count),
            boundary: against(&stage.boundary, &stage.boundary.blurred),
        }
    }

    /// Returns the share of the inside positions that have a value.
    pub(crate) fn coverage(&self) -> f64 {
        self.truth.voxels as f64 / (self.truth.voxels + self.truth.unseen) as f64
    }
}

/// One contestant over one scan.
#[derive(Debug, Clone)]
pub(crate) struct Row {
    pub(crate) stage: &'static str,
    pub(crate) title: &'static str,
    pub(crate) contestant: Contestant,
    pub(crate) rounds: usize,
    /// Quartiles of the time per slice, ms.
    pub(crate) ms: [f64; 3],
    /// Quartiles, over rounds, of the time relative to the default on one thread in the same
    /// round.
    pub(crate) over_default: [f64; 3],
    /// Mean number of voxels that a slice updates, if the path counts them.
    pub(crate) updated: Option<f64>,
    /// Spacing of the filtered image's nodes along u, pixels, if there are any.
    pub(crate) node_px: Option<f64>,
    pub(crate) score: Score,
    /// Deviation from its own equations in f64: root mean square, maximum.
    pub(crate) deviation: Option<[f64; 2]>,
    /// Whether its coverage equals the default's.
    pub(crate) comparable: bool,
}

/// Judges and times all contestants; the first must be the default on one thread.
///
/// # Errors
/// If a contestant refuses a slice.
pub(crate) fn measure(
    stage: &Stage,
    contestants: &[Contestant],
    rounds: Rounds,
    report: &mut Report,
) -> Result<Vec<Row>, Box<dyn Error>> {
    let grid = |spacing: f64| -> Result<Grid, Box<dyn Error>> {
        Ok(on_lattice(stage.scan.grid(DVec3::splat(spacing), MARGIN_MM)?))
    };
    let pixel_mm = stage.scan.settings().pixel_mm;
    let input = Input {
        slices: &stage.slices,
        mask: stage.scan.mask(),
        pixel_mm,
        effective_mm: default_kernels(pixel_mm, None)?.map(|k| k.sigma_effective_mm()),
        sigma_n_mm: None,
        gap_mm: widest_gap(&stage.slices)?,
        noise: stage.plan.noise(),
        grid: &grid,
    };
    let mut rows = Vec::new();
    let mut dear = Vec::new();
    let mut default: Option<Field> = None;
    for contestant in contestants {
        let (times, reconstructed) = contestant.reconstruct(&input)?;
        dear.push(times.iter().sum::<f64>() > DEAR_MS);
        let what = format!("{}, {}", stage.plan.title, contestant.name());
        let deviation = deviation(contestant, &input, &reconstructed, &what, report)?;
        let each_slice = |work: Work| Some(work.voxels_updated as f64 / work.slices as f64);
        let (updated, node_px) = match &reconstructed {
            Reconstructed::Bricks(r) => (each_slice(r.work()), r.decimation().map(|(step, _)| step[0])),
            Reconstructed::Columns(r) => (each_slice(r.work()), None),
            Reconstructed::Exact(_) | Reconstructed::Dense(_) => (None, None),
        };
        let field = reconstructed.field();
        if contestant.is_default() && contestant.threads > 1 {
            let one = default.as_ref().ok_or("the default on one thread comes first")?;
            report.findings.check(one.same_bits(&field), format!("{what}: other bits than on one thread"));
        }
        let score = Score::of(&field, stage);
        default.get_or_insert(field);
        let nothing = [f64::NAN; 3];
        let (ms, over_default) = (nothing, nothing);
        let (stage, title) = (stage.plan.id, stage.plan.title);
        let contestant = *contestant;
        rows.push(Row {
            stage,
            title,
            contestant,
            rounds: 0,
            ms,
            over_default,
            updated,
            node_px,
            score,
            deviation,
            comparable: true,
        });
    }
    drop(default);
    let covered = rows.first().map_or(f64::NAN, |row| row.score.coverage());
    report
        .findings
        .check(covered == 1.0, format!("{}: the default covers {covered} of the places inside", stage.plan.title));
    let default_rmse = rows.first().map_or(f64::NAN, |row| row.score.blurred.rmse);
    for row in &mut rows {
        row.comparable = (row.score.coverage() - covered).abs() <= SAME_COVERAGE;
        if let Path::Corrected(_) = row.contestant.path {
            // Other poses are other equations. A correction must do no harm.
            let (rmse, name) = (row.score.blurred.rmse, row.contestant.name());
            let what = format!("{}, {name}: {rmse} rms, {default_rmse} without the correction", row.title);
            report.findings.check(rmse <= NO_HARM * default_rmse, what);
            continue;
        }
        let limit = limits::from_default(row.stage, &row.contestant)?;
        // A NaN lies in no range.
        let sane = (0.0..=limit).contains(&row.score.oracle.rmse) && row.score.slope.is_finite();
        let what = format!("{}, {}: more than {limit} rms: {:?}", row.title, row.contestant.name(), row.score);
        report.findings.check(sane || !row.comparable, what);
    }
    for (is_dear, rounds) in [(false, rounds.cheap), (true, rounds.dear)] {
        // The default takes part in both groups, as the reference of the ratios.
        let members: Vec<usize> = (0..rows.len()).filter(|i| *i == 0 || dear[*i] == is_dear).collect();
        let mut turns: Vec<Turn<'_>> = members
            .iter()
            .map(|i| {
                let (contestant, input) = (contestants[*i], &input);
                Box::new(move || contestant.reconstruct(input).map(|(times, _)| times)) as Turn<'_>
            })
            .collect();
        let times = interleaved(rounds, &mut turns)?;
        for (i, t) in members.iter().zip(&times).filter(|(i, _)| dear[**i] == is_dear) {
            let row = &mut rows[*i];
            (row.rounds, row.ms) = (rounds, quartiles(t));
            row.over_default = t.over(&times[0]);
        }
    }
    Ok(rows)
}

fn quartiles(times: &Times) -> [f64; 3] {
    [0.25, 0.5, 0.75].map(|q| times.quantile(q))
}

/// Returns a contestant's deviation from its own equations in f64; reports wrong answers.
fn deviation(
    contestant: &Contestant,
    input: &Input<'_>,
    reconstructed: &Reconstructed,
    what: &str,
    report: &mut Report,
) -> Result<Option<[f64; 2]>, Box<dyn Error>> {
    let deviation = match (contestant.path, reconstructed) {
        (Path::Corrected(_), _) => return Ok(None),
        (path, Reconstructed::Bricks(bricks)) => {
            let mut deviation = against_equations(bricks, input.slices, input.mask)?;
            if let Path::Kernel(Method::Nearest, _) = path {
                deviation.bounds = AT_BORDERS;
            }
            deviation
        }
        (_, Reconstructed::Columns(columns)) => {
            let kernels = columns.kernels().ok_or("nothing was inserted")?;
            let lattice = columns.world_from_lattice();
            let pairs = against_sums(columns.volume(), columns.settings(), lattice, 0.0, |sums| {
                input.slices.iter().for_each(|slice| reference::insert(sums, slice, input.mask, kernels));
            });
            Deviation::over(pairs, COLUMNS.map(|part| part * 255.0))
        }
        (Path::Splat(how), _) => splat_deviation(how, contestant, input)?,
        _ => return Ok(None),
    };
    report.findings.counted();
    deviation.note(what, report);
    Ok(Some([deviation.rms, deviation.max]))
}

/// Compares splats before holes are filled.
fn splat_deviation(how: Drop, contestant: &Contestant, input: &Input<'_>) -> Result<Deviation, Box<dyn Error>> {
    // A sample on a voxel's border in fixed point may be on the other side in f64; smaller
    // weights would show mainly this.
    const FIRM: f64 = 0.05;
    let grid = (input.grid)(contestant.voxel_mm)?;
    let mut splat = Splat::new(how, &grid)?;
    for slice in input.slices {
        splat.insert(slice, input.mask)?;
    }
    let expected = plain(how, &grid, input.slices, input.mask)?;
    let pairs = expected
        .iter()
        .enumerate()
        .map(|(i, [sum, weight])| (splat.value(i, FIRM as f32).map(f64::from), (*weight > FIRM).then(|| sum / weight)));
    Ok(Deviation::over(pairs, SPLAT_BOUNDS))
}
