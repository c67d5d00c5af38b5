//! Flags for filling holes in the written files.

use clap::{Args, ValueEnum};

use export::fill::{FillMethod, Filling};

/// Default filling radius, mm: three voxels of the default spacing.
const RADIUS_MM: f64 = 1.5;

/// Selects whether and how holes are filled.
#[derive(Debug, Args)]
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
    /// Returns the filling; `None` if holes are not filled.
    pub(in crate::cli) fn filling(&self) -> Option<Filling> {
        let law = match self.fill? {
            FillName::Nearest => FillMethod::Nearest,
            FillName::Gaussian => FillMethod::Gaussian,
        };
        Some(Filling { method: law, radius_mm: self.fill_radius.unwrap_or(RADIUS_MM) })
    }
}
