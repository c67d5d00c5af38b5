//! Writes a reconstructed volume and the other outputs, and prints the report.

use std::path::Path;
use std::time::Instant;

use serde::Serialize;

use config::Settings as Config;
use export::dicom::volume::VolumeImage;
use export::fill::{FILLED, Filled};
use export::planes::{PlanesOptions, VoxelValue, Window, planes};
use export::volume::{DenseBox, Encoding, write_values, write_weights};
use mask::MaskSettings;
use pipeline::Outcome;
use reconstruct::Path as Way;
use statistics::{FillNumbers, Source, Statistics};
use volume::Voxels;
use volume::brick_volume::SEEN;

use super::beside::Beside;
use super::filling::{self, advised};
use super::flags::Flags;
use super::sweep::Sweep;
use crate::cli::dicom::flags::is_dicom;
use crate::cli::provenance::Made;
use crate::cli::{Failure, input};

/// A reconstruction command, with its inputs and outputs.
pub(in crate::cli) struct Request<'a> {
    pub(in crate::cli) sequence: &'a Path,
    pub(in crate::cli) output: Option<&'a Path>,
    pub(in crate::cli) flags: &'a Flags,
    beside: Beside,
    began: Instant,
    config: Config,
    mask: MaskSettings,
    frames: Option<[u64; 2]>,
}

impl<'a> Request<'a> {
    /// Begins a command with its outputs. Checks the outputs before the work.
    ///
    /// # Errors
    /// [`Failure`] when flags contradict each other or files are out of reach.
    pub(in crate::cli) fn new(
        sequence: &'a Path,
        output: Option<&'a Path>,
        flags: &'a Flags,
        beside: Beside,
    ) -> Result<(Self, Sweep), Failure> {
        let began = Instant::now();
        let sweep = flags.sweep(sequence)?;
        flags.check_outputs(sequence, output, &beside)?;
        flags
            .filling
            .check(&sweep.session.settings, output.is_some() || beside.weights.is_some() || beside.planes.is_some())?;
        let frames = (sweep.frames != (0..u64::MAX)).then_some([sweep.frames.start, sweep.frames.end]);
        let (config, mask) = (sweep.config.clone(), sweep.session.mask);
        Ok((Self { sequence, output, flags, beside, began, config, mask, frames }, sweep))
    }

    /// Writes the requested files, prints a report, and returns the statistics; `picture` holds
    /// the statistics of a simultaneous rendering.
    ///
    /// # Errors
    /// [`Failure`]: the file that failed does not exist.
    pub(in crate::cli) fn finish(
        &self,
        mut outcome: Outcome,
        picture: Option<&impl Serialize>,
    ) -> Result<Statistics, Failure> {
        let (flags, beside) = (self.flags, &self.beside);
        outcome.notes.extend(flags.weighing.note());
        let writes = self.output.is_some() || beside.weights.is_some();
        let encoding = if writes { Some(flags.encoding(outcome.pixels)?) } else { None };
        let space = flags.dense_box(&outcome)?;

        let hash = input::hash(self.sequence)?;
        let volume = outcome.reconstructor.volume();
        let filled = flags.filling.fill(volume, &space, outcome.reconstructor.settings())?;
        if let Some(encoding) = &encoding {
            let mut fields = self.provenance(&outcome, &space, encoding, &hash)?;
            fields.extend(filled.iter().flat_map(filling::fields));
            let volume = filled.as_ref().map_or(volume, |filled| filled as &dyn Voxels);
            if let Some(path) = self.output {
                if is_dicom(path) {
                    self.write_dicom(volume, &space, path, encoding, (&hash, &outcome.world))?;
                } else {
                    write_values(volume, &space, path, encoding, &fields).map_err(advised)?;
                }
            }
            if let Some(path) = &beside.weights {
                write_weights(volume, &space, path, &fields).map_err(advised)?;
            }
        }
        if let Some(path) = &beside.planes {
            draw(filled.as_ref().map_or(volume, |filled| filled as &dyn Voxels), &space, path)?;
        }
        let scalar = encoding.map(|e| e.scalar.name());
        let mut statistics = Statistics::new(&outcome, &space, scalar, self.began.elapsed());
        statistics.fill = filled.as_ref().map(FillNumbers::of);
        if let Some(path) = &beside.stats {
            let source = Source {
                input: self.sequence,
                sha256: &hash,
                frames: self.frames,
                mask: &self.mask,
                config: &self.config,
            };
            statistics.write(path, &source, picture)?;
        }
        self.report(&outcome, &statistics, filled.as_ref());
        Ok(statistics)
    }

    /// Writes the volume for a picture archive.
    fn write_dicom(
        &self,
        volume: &dyn Voxels,
        space: &DenseBox,
        path: &Path,
        encoding: &Encoding,
        (recording, world): (&str, &str),
    ) -> Result<(), Failure> {
        let identifiers = &self.flags.dicom.identifiers()?;
        let Encoding { scalar, unseen, .. } = *encoding;
        let image = VolumeImage { grid: &space.grid, scalar, unseen, recording, world, identifiers };
        let mut weights = vec![0.0; usize::try_from(space.grid.size[0]).unwrap_or(0)];
        image.check().map_err(advised)?;
        let written = image.write(path, |y, z, row| {
            let [x0, y0, z0] = space.first;
            volume.row([x0, y0 + y as i64, z0 + z as i64], row, &mut weights);
            row.iter_mut().zip(&weights).for_each(|(value, weight)| *value = encoding.written(*value, *weight));
        });
        written.map_err(advised)
    }

    /// Returns the volume's provenance, for its header.
    fn provenance(
        &self,
        outcome: &Outcome,
        space: &DenseBox,
        encoding: &Encoding,
        hash: &str,
    ) -> Result<Vec<(String, String)>, Failure> {
        let flags = self.flags;
        let name = self.sequence.file_name().unwrap_or(self.sequence.as_os_str());
        let calibration = match &flags.config {
            Some(path) => {
                let name = path.file_name().unwrap_or(path.as_os_str());
                format!("{} sha256 {}", name.to_string_lossy(), input::hash(path)?)
            }
            None if flags.image_to_probe.is_some() => "command line".into(),
            None => "in the sequence".into(),
        };
        let input = format!("{} sha256 {hash}", name.to_string_lossy());
        Ok(Made { outcome, space, encoding, input, calibration, cropped: flags.size.is_some() }.fields())
    }

    /// Prints a short report to stdout, and notes for the user to stderr.
    #[allow(clippy::print_stdout, clippy::print_stderr, reason = "the command's output")]
    fn report(&self, outcome: &Outcome, statistics: &Statistics, filled: Option<&Filled<'_>>) {
        for note in &outcome.notes {
            eprintln!("sonoweave: note: {note}");
        }
        if outcome.ledger.refused_total() > 0 || outcome.ledger.untimed > 0 {
            eprintln!("sonoweave: {}", outcome.ledger);
        }
        let grid = &statistics.grid;
        let [nx, ny, nz] = grid.size;
        let name = self.output.map_or_else(|| "the volume".into(), |path| path.display().to_string());
        println!(
            "{name}: {nx}×{ny}×{nz} voxels of {} mm in {}, from {} of {} frames",
            grid.spacing.map(|s| s.to_string()).join("×"),
            outcome.world,
            outcome.ledger.frames.used,
            outcome.ledger.frames.total,
        );
        if let Some(ms) = &statistics.insert_ms {
            println!(
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
        let [su, sv, sn] = statistics.sigma_mm;
        let [eu, ev, en] = statistics.sigma_effective_mm;
        println!("kernel σ {su:.3}, {sv:.3}, {sn:.3} mm along u, v, n; effective {eu:.3}, {ev:.3}, {en:.3}");
        if let Some(filled) = filled {
            println!("{}", filling::sentence(filled));
        }
        if let Some(path) = &self.beside.weights {
            println!("weights: {}", path.display());
        }
        if let Some(path) = &self.beside.planes {
            println!("middle planes: {}", path.display());
        }
    }
}

fn draw(volume: &dyn Voxels, space: &DenseBox, path: &Path) -> Result<(), Failure> {
    let shown = |voxel: [u64; 3]| {
        let at: [i64; 3] = std::array::from_fn(|a| space.first[a] + voxel[a] as i64);
        match volume.voxel(at) {
            (r, w) if w > SEEN => Some(VoxelValue::Seen(r / w)),
            (r, w) if w == FILLED => Some(VoxelValue::Filled(r / w)),
            _ => None,
        }
    };
    let options = PlanesOptions { window: Window::Percentiles, ..PlanesOptions::default() };
    Ok(planes(&space.grid, shown, &options)?.write_png(path)?)
}
