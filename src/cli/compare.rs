//! `sonoweave compare`: the difference between two volumes, its places, and the settings that
//! differ.

mod arguments;
mod report;

use std::path::{Path, PathBuf};

use export::planes::{PlanesOptions, Shades, Window, planes};
use volume::DenseVolume;
use volume::difference::{Apart, Difference};

use super::Failure;
use super::print::print;
use super::progress::say;
use crate::app::histogram::round_up;
use crate::app::input;
use crate::app::volume_input::dense;
pub use arguments::Arguments;
use report::Report;

/// Share of all differences within the image's colour range; the rest has the last colour.
const SHOWN: f64 = 0.995;

/// Runs the command.
///
/// # Errors
/// [`Failure`] when a volume cannot be read, they cannot be compared, or their difference
/// exceeds the limit. In the last case the result is printed first.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    arguments.check()?;
    let Arguments { first, second, weights, other_weights, .. } = arguments;
    let most = arguments.most_bytes()?;
    let a = dense(first, weights.as_deref(), most)?;
    let left = most.saturating_sub(a.bytes()).saturating_sub(Difference::bytes(a.header()));
    let b = dense(second, other_weights.as_deref(), left)?;
    let refused =
        |why: String| Failure::new(format!("{} and {} cannot be compared: {why}", first.display(), second.display()));
    let difference = Difference::of(&a, &b, arguments.resample).map_err(|apart| {
        let hint = if matches!(apart, Apart::Lattices(_)) {
            "; or give --resample, which interpolates the second"
        } else {
            ""
        };
        refused(format!("{apart}{hint}"))
    })?;
    if difference.sums.n == 0 {
        return Err(refused("no voxel was seen in both; compare volumes of the same place".into()));
    }
    if let Some(path) = &arguments.output {
        draw(&difference, path)?;
    }
    let report = Report::new(arguments, [&a, &b], &difference);
    for (volume, path) in [(&a, first), (&b, second)] {
        print_notes(volume, path);
    }
    print(&report.text())?;
    arguments.json.write(&report)?;
    let rmse = difference.sums.rmse();
    match arguments.limit {
        Some(limit) if rmse > limit || rmse.is_nan() => Err(Failure::new(format!(
            "{} and {} are {rmse} apart (RMSE), more than --limit {limit}",
            first.display(),
            second.display()
        ))),
        _ => Ok(()),
    }
}

impl Arguments {
    /// Refuses impossible requests before the work.
    fn check(&self) -> Result<(), Failure> {
        if let Some(limit) = self.limit.filter(|limit| !(limit.is_finite() && *limit >= 0.0)) {
            fail_usage!("--limit {limit}: must be a number that is not negative");
        }
        let inputs = [Some(&self.first), Some(&self.second), self.weights.as_ref(), self.other_weights.as_ref()];
        let inputs = || inputs.into_iter().flatten().map(PathBuf::as_path);
        self.json.check(inputs())?;
        let Some(path) = &self.output else { return Ok(()) };
        input::check_png(path)?;
        input::check_output(path)?;
        inputs().try_for_each(|input| input::check_is_not(path, input))
    }

    fn most_bytes(&self) -> Result<u64, Failure> {
        let most = self.max_memory * f64::from(1 << 30);
        if !(most > 0.0 && most.is_finite()) {
            fail_usage!("--max-memory {}: must be a positive number of GiB", self.max_memory);
        }
        Ok(most as u64)
    }
}

/// Prints the notes on a volume.
fn print_notes(volume: &DenseVolume, path: &Path) {
    for note in volume.notes() {
        say(&format!("note: {}: {note}", path.display()));
    }
}

fn draw(difference: &Difference, path: &Path) -> Result<(), Failure> {
    let mut sizes: Vec<f32> = difference.values.iter().filter(|d| !d.is_nan()).map(|d| d.abs()).collect();
    let rank = ((sizes.len() - 1) as f64 * SHOWN).round() as usize;
    let (_, most, _) = sizes.select_nth_unstable_by(rank, f32::total_cmp);
    let end = round_up(f64::from(*most)) as f32;
    let options = PlanesOptions {
        window: Window::Range { low: -end, high: end },
        shades: Shades::Diverging,
        ..PlanesOptions::default()
    };
    Ok(planes(&difference.grid, |voxel| difference.at(voxel), &options)?.write_png(path)?)
}
