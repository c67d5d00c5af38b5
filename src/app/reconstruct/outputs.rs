//! Writes a reconstructed volume and the other outputs.

use std::path::{Path, PathBuf};
use std::time::Instant;

use glam::DMat3;
use serde::Serialize;

use config::Settings as Config;
use export::dicom::Identifiers;
use export::dicom::volume::VolumeImage;
use export::fill::{FILLED, Filling};
use export::planes::{PlanesOptions, VoxelValue, Window, planes};
use export::volume::{DenseBox, Encoding, MOST_VOXELS, Scalar, write_values, write_weights};
use mask::MaskSettings;
use ome_zarr::OmeZarrWriter;
use pipeline::{Outcome, PixelKind};
use reconstruct::path_choice::PathChoice;
use statistics::{FillNumbers, Source, Statistics};
use volume::Voxels;
use volume::brick_volume::SEEN;

use super::beside::Beside;
use super::filling::{self, advised};
use super::first_moment;
use super::origin::Origin;
use super::standard_error::{self, ErrorFile};
use super::sweep::Sweep;
use super::zarr::{Description, Target, is_ome_zarr};
use crate::app::convert::identity;
use crate::app::input;
use crate::app::json::document;
use crate::app::provenance::Made;
use crate::failure::{Failure, FailureKind};

/// Settings of the outputs of a reconstruction.
#[derive(Debug)]
pub(crate) struct OutputOptions {
    /// The volume's file; `None` if it is not written.
    pub(crate) volume: Option<PathBuf>,
    pub(crate) beside: Beside,
    /// Whether the first moment of the values is corrected.
    pub(crate) first_moment: bool,
    /// Filling of holes; `None` for none.
    pub(crate) filling: Option<Filling>,
    /// Scalar type; `None` for the input's.
    pub(crate) scalar: Option<Scalar>,
    /// Grey values that become black and white.
    pub(crate) window: Option<[f32; 2]>,
    /// Value of unseen voxels.
    pub(crate) unseen: f32,
    /// Whether an OME-Zarr volume has the label of seen voxels.
    pub(crate) label: bool,
    /// Whether the position of the volume's first voxel was given.
    pub(crate) has_origin: bool,
    /// Size of the volume, voxels; `None` for all that slices reached.
    pub(crate) size: Option<[u64; 3]>,
    pub(crate) identifiers: Identifiers,
    /// File of the calibration.
    pub(crate) config: Option<PathBuf>,
    /// Whether the command line holds the calibration.
    pub(crate) has_calibration: bool,
    /// Note for the user.
    pub(crate) note: Option<String>,
}

impl OutputOptions {
    /// Checks that the folders of all outputs exist, and that no output is the input.
    ///
    /// # Errors
    /// [`Failure`] with the first violation.
    fn check(&self, origin: &Origin) -> Result<(), Failure> {
        let (volume, beside) = (self.volume.as_deref(), &self.beside);
        let volumes = [volume, beside.weights.as_deref(), beside.errors.as_deref()];
        let others = [beside.planes.as_deref(), beside.json.as_deref()];
        for path in volumes.into_iter().chain(others).flatten() {
            input::check_folder(path)?;
            origin.check_is_not(path)?;
        }
        if !volume.is_some_and(input::is_dicom) {
            self.identifiers.check()?;
            if !self.identifiers.is_empty() {
                return Err(Failure::usage(
                    "patient, study and series apply to DICOM files only: give -o VOL.dcm, or leave them out",
                ));
            }
        }
        if self.label && self.ome_zarr().is_none() {
            fail_usage!("--seen-label: applies to OME-Zarr volumes only; give -o NAME.ome.zarr, or leave it out");
        }
        let voxels = |size: [u64; 3]| size.into_iter().try_fold(1_u64, u64::checked_mul);
        if let Some(size) = self.size.filter(|size| voxels(*size).is_none_or(|all| all > MOST_VOXELS)) {
            let [x, y, z] = size;
            fail_usage!(
                "--size {x},{y},{z}: is more than {MOST_VOXELS} voxels, the most of a file; give a smaller size"
            );
        }
        for path in volumes.into_iter().flatten() {
            if volume == Some(path) && (input::is_dicom(path) || is_ome_zarr(path)) {
                continue;
            }
            input::check_volume(path)?;
        }
        Ok(())
    }

    /// Returns the encoding of the written values.
    ///
    /// # Errors
    /// [`Failure`] when the scalar type cannot hold them.
    pub(super) fn encoding(&self, pixels: PixelKind) -> Result<Encoding, Failure> {
        let input = match pixels {
            PixelKind::U8 => Scalar::U8,
            PixelKind::U16 => Scalar::U16,
            PixelKind::F32 => Scalar::F32,
        };
        let scalar = self.scalar.unwrap_or(input);
        let bits = |s: Scalar| s as u8;
        if bits(scalar) < bits(input) && self.window.is_none() {
            return Err(Failure::usage(
                format!(
                    "--type {0:?}: the input is {input:?}; give --window LO,HI for the grey values of black and white",
                    scalar
                )
                .to_lowercase()
                .replace("lo,hi", "LO,HI"),
            ));
        }
        let representable = match scalar {
            Scalar::U8 => (0.0..=255.0).contains(&self.unseen) && self.unseen.fract() == 0.0,
            Scalar::U16 => (0.0..=65535.0).contains(&self.unseen) && self.unseen.fract() == 0.0,
            Scalar::F32 => true,
        };
        if !representable {
            fail_usage!(
                "--unseen {}: is not a value of type {}; give one, or another --type",
                self.unseen,
                scalar.name()
            );
        }
        Ok(Encoding { scalar, window: self.window, unseen: self.unseen })
    }

    /// Returns the OME-Zarr volume to write, if it is one.
    pub(super) fn ome_zarr(&self) -> Option<&Path> {
        self.volume.as_deref().filter(|path| is_ome_zarr(path))
    }

    /// Returns the box of voxels to write.
    ///
    /// # Errors
    /// [`Failure`] when no voxel was seen.
    pub(crate) fn dense_box(&self, outcome: &Outcome) -> Result<DenseBox, Failure> {
        let reconstructor = &outcome.reconstructor;
        let settings = reconstructor.settings();
        let Some((low, high)) = reconstructor.volume().seen_bounds() else {
            return Err(Failure::new(
                "no voxel was seen, because the slices' kernel fell between the voxels; give a finer --spacing",
            )
            .of(FailureKind::NoFrame));
        };
        let world = reconstructor.world_from_lattice();
        Ok(match (self.has_origin, self.size) {
            // The lattice begins at the given origin.
            (true, Some(size)) => DenseBox::new([0; 3], size, world, settings),
            (false, Some(size)) => DenseBox::new(low, size, world, settings),
            (_, None) => DenseBox::around([low, high], world, settings),
        })
    }
}

/// A reconstruction, with its inputs and outputs.
pub(crate) struct Request {
    pub(super) origin: Origin,
    pub(super) options: OutputOptions,
    pub(super) began: Instant,
    config: Config,
    mask: MaskSettings,
    frames: Option<[u64; 2]>,
}

/// A finished reconstruction.
pub(crate) struct Reconstructed {
    pub(crate) outcome: Outcome,
    pub(crate) written: Written,
}

/// The numbers of a reconstruction whose files are written.
pub(crate) struct Written {
    pub(crate) statistics: Statistics,
    /// The report, as a JSON document.
    pub(crate) document: String,
    /// Description of the filling, if there was one.
    pub(crate) filled: Option<String>,
}

impl Request {
    /// Begins a reconstruction with its outputs. Checks the outputs before the work.
    ///
    /// # Errors
    /// [`Failure`] when flags contradict each other or files are out of reach.
    pub(crate) fn new(origin: Origin, sweep: &Sweep, options: OutputOptions, began: Instant) -> Result<Self, Failure> {
        options.check(&origin)?;
        let OutputOptions { volume, beside, filling, .. } = &options;
        let is_written = volume.is_some() || beside.weights.is_some() || beside.planes.is_some();
        filling::check(filling.as_ref(), &sweep.session.settings, is_written)?;
        first_moment::check(
            options.first_moment,
            &sweep.session.settings,
            volume.is_some() || beside.planes.is_some(),
        )?;
        standard_error::check(beside.errors.is_some(), &sweep.session.settings)?;
        if beside.errors.is_some() && sweep.session.path == PathChoice::Planar {
            fail_usage!("--error: the planar path keeps no sums for it; leave it out, or give --path general");
        }
        let frames = (sweep.frames != (0..u64::MAX)).then_some([sweep.frames.start, sweep.frames.end]);
        let (config, mask) = (sweep.config.clone(), sweep.session.mask);
        Ok(Self { origin, options, began, config, mask, frames })
    }

    /// Returns the outputs.
    pub(crate) fn options(&self) -> &OutputOptions {
        &self.options
    }

    /// Writes the requested files but the report, and returns the latter; `picture` holds the
    /// statistics of a simultaneous rendering.
    ///
    /// # Errors
    /// [`Failure`]: the file that failed does not exist.
    pub(crate) fn finish(
        &self,
        mut outcome: Outcome,
        picture: Option<&impl Serialize>,
    ) -> Result<Reconstructed, Failure> {
        let written = self.write(&mut outcome, picture)?;
        Ok(Reconstructed { outcome, written })
    }

    /// Like [`Self::finish`], for an outcome that is used again.
    ///
    /// # Errors
    /// [`Failure`]: the file that failed does not exist.
    pub(crate) fn write(&self, outcome: &mut Outcome, picture: Option<&impl Serialize>) -> Result<Written, Failure> {
        let (options, beside) = (&self.options, &self.options.beside);
        outcome.notes.extend(options.note.clone());
        let direction = outcome.reconstructor.settings().lattice_direction;
        if let Some(path) = options.ome_zarr().filter(|_| direction != DMat3::IDENTITY) {
            outcome.notes.push(format!(
                "{}: OME-Zarr 0.5 has no direction of axes, so that other programs show the volume turned; --path \
                general gives axes along the world's",
                path.display()
            ));
        }
        let writes = options.volume.is_some() || beside.weights.is_some();
        let encoding = if writes { Some(options.encoding(outcome.pixels)?) } else { None };
        let outcome = &*outcome;
        let mut space = options.dense_box(outcome)?;
        let volume_folder = match (options.ome_zarr(), encoding) {
            (Some(path), Some(encoding)) => {
                let bounds = match (options.size, outcome.reached) {
                    (None, Some(reached)) => reached,
                    _ => space.ends(),
                };
                let description =
                    Description::of(outcome, bounds, encoding, options.size.is_some()).with_label(options.label);
                // All files have one grid.
                space = description.space();
                Some((path, description))
            }
            _ => None,
        };

        let hash = self.origin.hash(outcome)?;
        let corrected = first_moment::correct(options.first_moment, &outcome.reconstructor);
        let volume = corrected.as_ref().map_or(outcome.reconstructor.volume(), |(corrected, _)| corrected as _);
        let errors = beside.errors.as_ref().map(|path| ErrorFile::new(path, outcome)).transpose()?;
        let filled = filling::fill(options.filling.as_ref(), volume, &space, outcome.reconstructor.settings())?;
        if let Some(encoding) = &encoding {
            let mut fields = self.provenance(outcome, &space, encoding, &hash)?;
            fields.extend(corrected.iter().map(|(_, numbers)| first_moment::field(numbers)));
            fields.extend(filled.iter().flat_map(filling::fields));
            let volume = filled.as_ref().map_or(volume, |filled| filled as &dyn Voxels);
            if let Some(path) = &options.volume {
                if let Some((path, description)) = &volume_folder {
                    let described = description.described(fields.clone(), self.origin.data_hash()?.as_deref());
                    let target = Target::new(&described, outcome.reconstructor.settings().threads)?;
                    let (writer, _) = OmeZarrWriter::create(path, &described.meta)?;
                    target.write(writer.shards(), volume, None)?;
                    target.finish(writer)?;
                } else if input::is_dicom(path) {
                    self.write_dicom(volume, &space, path, encoding, (&hash, &outcome.world, &fields))?;
                } else {
                    write_values(volume, &space, path, encoding, &fields).map_err(advised)?;
                }
            }
            if let Some(path) = &beside.weights {
                write_weights(volume, &space, path, &fields).map_err(advised)?;
            }
        }
        let of_errors =
            |file: ErrorFile| file.write(&space, self.provenance(outcome, &space, &ErrorFile::encoding(), &hash)?);
        let errors = errors.map(of_errors).transpose()?;
        if let Some(path) = &beside.planes {
            draw(filled.as_ref().map_or(volume, |filled| filled as &dyn Voxels), &space, path)?;
        }
        let scalar = encoding.map(|e| e.scalar.name());
        let mut statistics = Statistics::new(outcome, &space, scalar, self.began.elapsed());
        statistics.first_moment = corrected.as_ref().map(|(_, numbers)| numbers.clone());
        statistics.fill = filled.as_ref().map(FillNumbers::of);
        statistics.standard_error = errors;
        let document = self.document(&statistics, &hash, picture)?;
        let filled = filled.as_ref().map(filling::sentence);
        Ok(Written { statistics, document, filled })
    }

    /// Returns the report, as a JSON document.
    pub(super) fn document(
        &self,
        statistics: &Statistics,
        sha256: &str,
        picture: Option<&impl Serialize>,
    ) -> Result<String, Failure> {
        let Self { frames, mask, config, .. } = self;
        let input = self.origin.path();
        let source = Source { input, sha256, frames: *frames, mask, config };
        document(&statistics.report(&source, picture))
    }

    /// Writes the volume for a picture archive.
    fn write_dicom(
        &self,
        volume: &dyn Voxels,
        space: &DenseBox,
        path: &Path,
        encoding: &Encoding,
        (recording, world, fields): (&str, &str, &[(String, String)]),
    ) -> Result<(), Failure> {
        let identifiers = &self.options.identifiers;
        identifiers.check()?;
        let Encoding { scalar, unseen, .. } = *encoding;
        let fields = &identity::numeric(fields);
        let image = VolumeImage { grid: &space.grid, scalar, unseen, recording, world, fields, identifiers };
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
    pub(super) fn provenance(
        &self,
        outcome: &Outcome,
        space: &DenseBox,
        encoding: &Encoding,
        hash: &str,
    ) -> Result<Vec<(String, String)>, Failure> {
        let options = &self.options;
        let calibration = match &options.config {
            Some(path) => {
                let name = path.file_name().unwrap_or(path.as_os_str());
                format!("{} sha256 {}", name.to_string_lossy(), input::hash(path)?)
            }
            None if options.has_calibration => "command line".into(),
            None if matches!(self.origin, Origin::Session(_)) => "in the configuration".into(),
            None => "in the sequence".into(),
        };
        let input = format!("{} sha256 {hash}", self.origin.name());
        Ok(Made { outcome, space, encoding, input, calibration, cropped: options.size.is_some() }.fields())
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
