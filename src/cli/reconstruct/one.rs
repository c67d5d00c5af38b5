//! Reconstructs one recording, and reports the result.

use std::path::Path;

use pipeline::PipelineError;
use reconstruct::Path as Way;
use statistics::Statistics;

use super::flags::Flags;
use crate::app::reconstruct::beside::Beside;
use crate::app::reconstruct::outputs::{OutputOptions, Reconstructed, Written};
use crate::app::reconstruct::{first_moment, standard_error};
use crate::cli::Failure;
use crate::cli::progress::{say, steps};
use crate::cli::smoothing::sentences;

/// Reconstructs a recorded sweep into a volume and its other outputs but the report. Returns the
/// numbers and the report. An OME-Zarr volume is reconstructed in regions if that is asked for, or
/// memory does not suffice.
pub(super) fn reconstruct(
    sequence: &Path,
    output: &Path,
    flags: &Flags,
    beside: Beside,
    is_out_of_core: bool,
) -> Result<(Statistics, String), Failure> {
    let (request, sweep) = flags.request(sequence, Some(output), beside.clone())?;
    let done = if is_out_of_core {
        request.check_regions()?;
        request.finish_in_regions(sweep.plan(&steps)?, &steps)?
    } else {
        match sweep.reconstruct("reconstructing", &steps) {
            Err(error @ PipelineError::Memory { .. }) if request.check_regions().is_ok() => {
                say(&format!("note: {error}; the volume is reconstructed in regions instead"));
                let (request, sweep) = flags.request(sequence, Some(output), beside)?;
                request.finish_in_regions(sweep.plan(&steps)?, &steps)?
            }
            outcome => request.finish(outcome?, None::<&()>)?,
        }
    };
    report(request.options(), &done);
    Ok((done.written.statistics, done.written.document))
}

/// Prints a short report to stdout, and notes for the user to stderr.
pub(in crate::cli) fn report(options: &OutputOptions, done: &Reconstructed) {
    let Reconstructed { outcome, written: Written { statistics, filled, .. } } = done;

    for note in &outcome.notes {
        say(&format!("note: {note}"));
    }
    if outcome.ledger.refused_total() > 0 || outcome.ledger.untimed > 0 {
        say(&outcome.ledger.to_string());
    }
    if let Some(smoothing) = &outcome.smoothing {
        print_line!("{}", sentences(smoothing));
    }
    let grid = &statistics.grid;
    let [nx, ny, nz] = grid.size;
    let name = options.volume.as_ref().map_or_else(|| "the volume".into(), |path| path.display().to_string());
    print_line!(
        "{name}: {nx}×{ny}×{nz} voxels of {} mm in {}, from {} of {} frames",
        grid.spacing.map(|s| s.to_string()).join("×"),
        outcome.world,
        outcome.ledger.frames.used,
        outcome.ledger.frames.total,
    );
    if let Some(ms) = &statistics.insert_ms {
        print_line!(
            "{:.2} ms a slice (median; p99 {:.2}) by the {} path, {} voxels updated, {:.0} MB of {}, {} thread{}, {}",
            ms.median,
            ms.p99,
            statistics.path,
            statistics.voxels_updated,
            statistics.bytes as f64 / 1e6,
            match outcome.reconstructor.path() {
                Way::General => "bricks",
                Way::Planar => "columns",
            },
            statistics.threads,
            if statistics.threads == 1 { "" } else { "s" },
            statistics.simd,
        );
    }
    if let Some(regions) = &statistics.regions {
        let kept =
            if regions.kept > 0 { format!(", {} of them kept from before", regions.kept) } else { String::new() };
        print_line!(
            "{} region{}{kept}; a slice meets {:.1} (mean), {:.0} MB of bricks in the largest, {} voxels updated",
            regions.count,
            if regions.count == 1 { "" } else { "s" },
            regions.meetings as f64 / outcome.ledger.frames.used.max(1) as f64,
            statistics.bytes as f64 / 1e6,
            statistics.voxels_updated,
        );
    }
    let [su, sv, sn] = statistics.sigma_mm;
    let [eu, ev, en] = statistics.sigma_effective_mm;
    print_line!("kernel σ {su:.3}, {sv:.3}, {sn:.3} mm along u, v, n; effective {eu:.3}, {ev:.3}, {en:.3}");
    if let Some(numbers) = &statistics.first_moment {
        print_line!("{}", first_moment::sentence(numbers));
    }
    if let Some(filled) = filled {
        print_line!("{filled}");
    }
    if let Some(path) = &options.beside.weights {
        print_line!("weights: {}", path.display());
    }
    if let (Some(path), Some(errors)) = (&options.beside.errors, &statistics.standard_error) {
        print_line!("{}", standard_error::sentence(path, errors));
    }
    if let Some(path) = &options.beside.planes {
        print_line!("middle planes: {}", path.display());
    }
}
