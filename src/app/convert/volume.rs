//! Converts a volume: values and weights to files or to an OME-Zarr folder, its holes filled on
//! request.

use std::path::Path;

use export::fill::Filling;
use formats::image::{VolumeHeader, VolumeSlices};
use volume::dense::checked_grid;

use super::anonymous::Subject;
use super::holes::Holes;
use super::{Changes, identity, write, zarr};
use crate::app::input;
use crate::app::reconstruct::filling;
use crate::app::reconstruct::zarr::is_ome_zarr;
use crate::app::volume_input::{VolumeInput, holds_weights};
use crate::failure::Failure;

/// A conversion of a volume.
pub(crate) struct VolumeRequest<'a> {
    pub(crate) input: &'a Path,
    /// Weights of the input, if it does not hold them itself.
    pub(crate) weights: Option<&'a Path>,
    pub(crate) output: &'a Path,
    /// Weights of the output, if it does not hold them itself.
    pub(crate) written_weights: Option<&'a Path>,
    /// Filling of holes; `None` for none.
    pub(crate) filling: Option<Filling>,
    /// Whether an OME-Zarr output has the label of seen voxels.
    pub(crate) label: bool,
    /// Memory limit for filling, bytes.
    pub(crate) memory_bytes: u64,
    pub(crate) changes: &'a Changes,
}

/// A converted volume.
#[derive(Default)]
pub(crate) struct Converted {
    /// Fields that were left out.
    pub(crate) removed: Vec<String>,
    /// Description of the filling, if there was one.
    pub(crate) filled: Option<String>,
    /// Notes for the user.
    pub(crate) notes: Vec<String>,
}

impl VolumeRequest<'_> {
    /// Converts the volume.
    ///
    /// # Errors
    /// [`Failure`] when the files do not fit, or cannot be read or written; no output is left then,
    /// except shards that another run goes on with.
    pub(crate) fn run(&self) -> Result<Converted, Failure> {
        self.check()?;
        let mut source = VolumeInput::open_with(self.input, self.weights)?;
        let header = source.values.header();
        if !header.placed {
            fail!(
                "{}: has no position in space (neither sform nor qform), which other formats require; add one",
                self.input.display()
            );
        }
        let weights = source.weights.as_ref().map(|weights| (self.weights.unwrap_or(self.input), weights.header()));
        // Files of other programs may hold several channels, which are copied.
        let is_copied = weights.is_none() && self.filling.is_none() && !is_ome_zarr(self.output);
        let grid = if is_copied { None } else { Some(checked_grid((self.input, header), weights)?) };
        let mut converted = Converted::default();
        if let (Some(filling), Some(grid)) = (&self.filling, grid) {
            filling.check(grid.spacing).map_err(|e| Failure::usage(format!("--fill-radius: {e}")))?;
            let threads = input::threads(None);
            let holes = Holes::open(self.input, self.weights, self.memory_bytes)?;
            let seen = holes.seen();
            let filled = filling.fill(&seen, &holes.space(grid), threads, self.memory_bytes);
            let filled = filled.map_err(filling::advised)?;
            holes.check()?;
            converted.filled = Some(filling::sentence(&filled));
            let [mut values, mut weights] = holes.slices(&filled, header);
            self.write(&mut values, Some(&mut weights), &mut converted)?;
        } else {
            let VolumeInput { values, weights } = &mut source;
            let weights = weights.as_mut().map(|weights| &mut **weights as &mut dyn VolumeSlices);
            self.write(&mut **values, weights, &mut converted)?;
        }
        Ok(converted)
    }

    fn check(&self) -> Result<(), Failure> {
        if is_ome_zarr(self.output) {
            input::check_folder(self.output)?;
            if let Some(weights) = self.written_weights {
                return Err(holds_weights(self.output, weights));
            }
        } else {
            input::check_volume(self.output)?;
            input::check_output(self.output)?;
            if self.label {
                fail_usage!("--seen-label: applies to OME-Zarr volumes only; give -o NAME.ome.zarr, or leave it out");
            }
        }
        if let Some(weights) = self.written_weights {
            input::check_volume(weights)?;
            input::check_output(weights)?;
            for path in [Some(self.input), self.weights, Some(self.output)].into_iter().flatten() {
                input::check_is_not(weights, path)?;
            }
        }
        self.weights.map_or(Ok(()), |weights| input::check_is_not(self.output, weights))
    }

    /// Writes the values, and the weights if they are asked for.
    fn write(
        &self,
        values: &mut dyn VolumeSlices,
        mut weights: Option<&mut dyn VolumeSlices>,
        converted: &mut Converted,
    ) -> Result<(), Failure> {
        let mut header = values.header().clone();
        if self.changes.anonymize {
            identity::leave_out(&mut header.fields, &mut converted.removed);
            header.fields.extend(self.changes.subject.iter().flat_map(Subject::fields));
        }
        header.compressed = self.changes.compressed;
        if is_ome_zarr(self.output) {
            let target = zarr::Target { path: self.output, header: &header, label: self.label };
            let key = self.content_key(&header)?;
            converted.notes.extend(target.note());
            return target.write(values, weights, &key);
        }
        if let (Some(path), Some(weights)) = (self.written_weights, &mut weights) {
            let header = VolumeHeader { pixel: weights.header().pixel, ..header.clone() };
            write::volume(&mut **weights, &header, path)?;
        } else if self.written_weights.is_some() {
            fail!("{}: has no weights to write; leave out --write-weights, or give --weights", self.input.display());
        } else if weights.is_some() {
            converted.notes.push("the weights are not written; --write-weights FILE.mha writes them".into());
        }
        let written = write::volume(values, &header, self.output);
        if let (Err(_), Some(weights)) = (&written, self.written_weights) {
            // The values' error is what counts.
            let _ = std::fs::remove_file(weights);
        }
        Ok(written?)
    }

    /// Returns what the output follows from: the SHA-256 of its header, the input's voxels and the
    /// settings, and the least and the greatest value. Fields that are left out have no part in it:
    /// whoever has the voxels could find them by trying.
    fn content_key(&self, header: &VolumeHeader) -> Result<zarr::Key, Failure> {
        let VolumeInput { mut values, mut weights } = VolumeInput::open_with(self.input, self.weights)?;
        let settings = format!("{:?} {} {header:?}", self.filling, self.label);
        let weights = weights.as_mut().map(|weights| &mut **weights as &mut dyn VolumeSlices);
        zarr::Key::of(self.input, &mut *values, weights, &settings)
    }
}
