//! `sonoweave compare`: how far two volumes are from each other, where, and which settings differ.

mod report;

use std::io::{ErrorKind, Write as _};
use std::path::{Path, PathBuf};

use clap::Args;

use super::{Failure, input};
use crate::export::planes::{PlanesOptions, Shades, Window, planes};
use crate::volume::DenseVolume;
use crate::volume::difference::{Apart, Difference};
use report::Report;

/// Part of all differences that the picture's colours tell apart; the rest has the last colour.
const SHOWN: f64 = 0.995;

/// Flags of `compare`.
#[derive(Debug, Args)]
#[command(after_help = "\
What counts is what both volumes saw: by their weights where they are given, else what has not the unseen value that `reconstruct` noted in the header, else all. \
Filled holes were not seen.

Volumes on one lattice are compared voxel by voxel, however their boxes lie on it. Of others, the second is interpolated at the first one's voxels if --resample says so: \
trilinear, which smooths, and only where all neighbours of a place were seen.

The exit code is 0 whatever the difference, unless --limit is given.

Examples:
  sonoweave compare volume.mha truth.mha --weights weights.mha -o difference.png
  sonoweave compare a.mha b.mha --json --limit 1.5")]
pub struct Arguments {
    /// The first volume (.mha), which the second is subtracted from
    first: PathBuf,
    /// The second volume (.mha)
    second: PathBuf,
    /// The first volume's weights, as `reconstruct --weights` wrote them
    #[arg(long, value_name = "FILE.mha")]
    weights: Option<PathBuf>,
    /// The second volume's weights
    #[arg(long, value_name = "FILE.mha")]
    other_weights: Option<PathBuf>,
    /// Interpolate the second volume at the first one's voxels where they have not one lattice
    #[arg(long)]
    resample: bool,
    /// Draw the difference in the first volume's three middle planes: blue where the first is lower, orange where it is higher
    #[arg(short, long, value_name = "DIFF.png")]
    output: Option<PathBuf>,
    /// Fail, with exit code 1, where the root mean square of the difference is more than this
    #[arg(long, value_name = "RMSE", allow_hyphen_values = true)]
    limit: Option<f64>,
    /// Write JSON, for programs
    #[arg(long)]
    json: bool,
    /// Memory that the volumes and their difference may take, GiB
    #[arg(long, value_name = "GIB", default_value_t = 8.0)]
    max_memory: f64,
}

/// Runs the command.
///
/// # Errors
/// [`Failure`] when a volume cannot be read, they cannot be compared, or they are farther apart than the limit; what was found is said then.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    arguments.check()?;
    let Arguments { first, second, weights, other_weights, .. } = arguments;
    let most = arguments.most_bytes()?;
    let a = DenseVolume::open(first, weights.as_deref(), most)?;
    let left = most.saturating_sub(a.bytes()).saturating_sub(Difference::bytes(a.header()));
    let b = DenseVolume::open(second, other_weights.as_deref(), left)?;
    let refused =
        |why: String| Failure(format!("{} and {} cannot be compared: {why}", first.display(), second.display()));
    let difference = Difference::of(&a, &b, arguments.resample).map_err(|apart| {
        let hint = if matches!(apart, Apart::Lattices(_)) {
            "; or give --resample, which interpolates the second"
        } else {
            ""
        };
        refused(format!("{apart}{hint}"))
    })?;
    if difference.sums.n == 0 {
        return Err(refused("no voxel was seen in both".into()));
    }
    if let Some(path) = &arguments.output {
        draw(&difference, path)?;
    }
    let report = Report::new(arguments, [&a, &b], &difference);
    for (volume, path) in [(&a, first), (&b, second)] {
        say(volume, path);
    }
    print(&if arguments.json { serde_json::to_string_pretty(&report)? + "\n" } else { report.text() })?;
    let rmse = difference.sums.rmse();
    match arguments.limit {
        Some(limit) if rmse > limit || rmse.is_nan() => Err(Failure(format!(
            "{} and {} are {rmse} apart (RMSE), more than --limit {limit}",
            first.display(),
            second.display()
        ))),
        _ => Ok(()),
    }
}

impl Arguments {
    /// Refuses what cannot be done, before the work.
    fn check(&self) -> Result<(), Failure> {
        if let Some(limit) = self.limit.filter(|limit| !(limit.is_finite() && *limit >= 0.0)) {
            return Err(Failure(format!("--limit {limit}: must be a number that is not negative")));
        }
        let Some(path) = &self.output else { return Ok(()) };
        super::render::check_png(path)?;
        input::check_output(path)?;
        [Some(&self.first), Some(&self.second), self.weights.as_ref(), self.other_weights.as_ref()]
            .into_iter()
            .flatten()
            .try_for_each(|input| input::check_is_not(path, input))
    }

    fn most_bytes(&self) -> Result<u64, Failure> {
        let most = self.max_memory * f64::from(1 << 30);
        if !(most > 0.0 && most.is_finite()) {
            return Err(Failure(format!("--max-memory {}: must be a positive number of GiB", self.max_memory)));
        }
        Ok(most as u64)
    }
}

/// What the user should know of a volume.
#[allow(clippy::print_stderr, reason = "the command's output")]
fn say(volume: &DenseVolume, path: &Path) {
    for note in volume.notes() {
        eprintln!("sonoweave: note: {}: {note}", path.display());
    }
}

fn print(text: &str) -> Result<(), Failure> {
    match std::io::stdout().write_all(text.as_bytes()) {
        // Who reads no further (`| head`) has read enough.
        Err(e) if e.kind() == ErrorKind::BrokenPipe => Ok(()),
        Err(e) => Err(Failure(format!("writing to stdout failed: {e}"))),
        Ok(()) => Ok(()),
    }
}

fn draw(difference: &Difference, path: &Path) -> Result<(), Failure> {
    let mut sizes: Vec<f32> = difference.values.iter().filter(|d| !d.is_nan()).map(|d| d.abs()).collect();
    let rank = ((sizes.len() - 1) as f64 * SHOWN).round() as usize;
    let (_, most, _) = sizes.select_nth_unstable_by(rank, f32::total_cmp);
    let end = super::histogram::round_up(f64::from(*most)) as f32;
    let options = PlanesOptions {
        window: Window::Range { low: -end, high: end },
        shades: Shades::Diverging,
        ..PlanesOptions::default()
    };
    Ok(planes(&difference.grid, |voxel| difference.at(voxel), &options)?.write_png(path)?)
}
