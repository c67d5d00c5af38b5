//! Flags that say how holes are filled in what is written.

use clap::{Args, ValueEnum};

use crate::cli::Failure;
use crate::export::fill::{Filled, Filling, Law};
use crate::export::volume::DenseBox;
use crate::reconstruct::Settings;
use crate::volume::Voxels;
use crate::volume::dense::{FILL_FIELD, FILLED_FIELD};

/// From how far holes are filled, mm: three voxels of the default spacing.
const RADIUS_MM: f64 = 1.5;

/// Whether and how holes are filled.
#[derive(Debug, Clone, Default, Args)]
pub(in crate::cli) struct FillFlags {
    /// Fill voxels that were not seen, in the files that are written and nowhere else, from those seen nearby. They have weight −1 there, and no program that asks
    /// for seen voxels is given them [default: not filled]
    #[arg(long, value_enum, value_name = "LAW")]
    fill: Option<FillName>,
    /// From how far away, mm; at most 32 voxels [default: 1.5]
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
            FillName::Nearest => Law::Nearest,
            FillName::Gaussian => Law::Gaussian,
        };
        Some(Filling { law, radius_mm: self.fill_radius.unwrap_or(RADIUS_MM) })
    }

    /// Refuses, before the work, what cannot be filled on such a lattice, or is not written.
    ///
    /// # Errors
    /// [`Failure`] with the flag to change.
    pub(in crate::cli) fn check(&self, settings: &Settings, is_written: bool) -> Result<(), Failure> {
        let Some(filling) = self.filling() else { return Ok(()) };
        if !is_written {
            return Err(Failure(
                "--fill: only files are filled, and none is written: give a volume, --weights or --planes".into(),
            ));
        }
        filling.check(settings.spacing_mm).map_err(|e| Failure(format!("--fill-radius: {e}")))
    }

    /// The volume as it is written; `None` where holes stay holes.
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
        Ok(Some(filling.fill(volume, space, settings.threads, settings.memory_bytes)?))
    }
}

/// What a file's header says of it.
pub(in crate::cli) fn fields(filled: &Filled<'_>) -> [(String, String); 2] {
    [(FILL_FIELD.into(), filled.filling().to_string()), (FILLED_FIELD.into(), filled.work().filled.to_string())]
}

/// What was filled, in a line.
pub(in crate::cli) fn sentence(filled: &Filled<'_>) -> String {
    format!(
        "filled: {} of {} unseen voxels near seen ones, {}",
        filled.work().filled,
        filled.work().holes,
        filled.filling()
    )
}
