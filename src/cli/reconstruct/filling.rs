//! Flags for filling holes in the written files.

use clap::{Args, ValueEnum};

use export::ExportError;
use export::fill::{FillMethod, Filled, Filling};
use export::volume::DenseBox;
use reconstruct::Settings;
use volume::Voxels;
use volume::dense::{FILL_FIELD, FILLED_FIELD};

use crate::cli::Failure;

/// Default filling radius, mm: three voxels of the default spacing.
const RADIUS_MM: f64 = 1.5;

/// Selects whether and how holes are filled.
#[derive(Debug, Clone, Default, Args)]
pub(in crate::cli) struct FillFlags {
    /// Fill unseen voxels from seen ones nearby, only in the written files. They have weight −1
    /// there, and programs that ask for seen voxels do not receive them [default: not filled]
    #[arg(long, value_enum, value_name = "LAW")]
    fill: Option<FillName>,
    /// Radius of the filling, mm; at most 32 voxels [default: 1.5]
    #[arg(long, value_name = "MM", requires = "fill", allow_hyphen_values = true)]
    fill_radius: Option<f64>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum FillName {
    /// The value of the nearest seen voxel
    Nearest,
    /// The mean of the seen voxels within the radius, weighted by a Gaussian of half of it
    Gaussian,
}

impl FillFlags {
    fn filling(&self) -> Option<Filling> {
        let law = match self.fill? {
            FillName::Nearest => FillMethod::Nearest,
            FillName::Gaussian => FillMethod::Gaussian,
        };
        Some(Filling { method: law, radius_mm: self.fill_radius.unwrap_or(RADIUS_MM) })
    }

    /// Refuses, before the work, a filling that is impossible on such a lattice, or without
    /// written files.
    ///
    /// # Errors
    /// [`Failure`] with the flag to change.
    pub(in crate::cli) fn check(&self, settings: &Settings, is_written: bool) -> Result<(), Failure> {
        let Some(filling) = self.filling() else { return Ok(()) };
        if !is_written {
            fail!("--fill: applies to written files, and none is written; give a volume, --weights or --planes");
        }
        filling.check(settings.spacing_mm).map_err(|e| Failure(format!("--fill-radius: {e}")))
    }

    /// Returns the volume to write; `None` if holes are not filled.
    ///
    /// # Errors
    /// [`Failure`] when memory or threads do not suffice.
    pub(in crate::cli) fn fill<'a>(
        &self,
        volume: &'a dyn Voxels,
        space: &DenseBox,
        settings: &Settings,
    ) -> Result<Option<Filled<'a>>, Failure> {
        let Some(filling) = self.filling() else { return Ok(None) };
        let filled = filling.fill(volume, space, settings.threads, settings.memory_bytes);
        Ok(Some(filled.map_err(advised)?))
    }
}

/// Adds the flags that help to the error of a volume's export.
pub(in crate::cli) fn advised(error: ExportError) -> Failure {
    let flags = match error {
        ExportError::VolumeTooLarge { .. } | ExportError::DicomTooLarge { .. } | ExportError::DicomTooLong { .. } => {
            "--origin and --size, or --spacing"
        }
        ExportError::Memory { .. } => "--fill-radius, --size or --max-memory",
        ExportError::FloatingPoint => "--type u8 or u16, and --window LO,HI",
        _ => return error.into(),
    };
    Failure(format!("{error}: {flags}"))
}

/// Returns the header fields of a filled volume.
pub(in crate::cli) fn fields(filled: &Filled<'_>) -> [(String, String); 2] {
    [(FILL_FIELD.into(), filled.filling().to_string()), (FILLED_FIELD.into(), filled.work().filled.to_string())]
}

/// Describes the filling, in a line.
pub(in crate::cli) fn sentence(filled: &Filled<'_>) -> String {
    format!(
        "filled: {} of {} unseen voxels near seen ones, {}",
        filled.work().filled,
        filled.work().holes,
        filled.filling()
    )
}
