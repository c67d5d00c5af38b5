//! Flags for the touches of an arm, and for its fit.

use std::path::PathBuf;

use clap::Args;
use glam::DVec2;

use calibration::arm::JOINTS;
use config::values;

use super::super::guide::Gathering;

/// The touches, and what is to be found from them.
#[derive(Debug, Args)]
pub(crate) struct Options {
    /// Session of an arm, recorded by `live --record`
    #[arg(long, value_name = "SESSION.mcap")]
    pub(super) session: Option<PathBuf>,
    /// Session configuration: record its arm now, show instructions, and end when there is
    /// enough
    #[arg(long, value_name = "BEDSIDE.toml")]
    pub(super) live: Option<PathBuf>,
    #[command(flatten)]
    pub(super) gathering: Gathering,
    /// Goal for --live: end when the tip is known to this in all of its reach, mm (one standard
    /// deviation)
    #[arg(long, value_name = "MM", default_value_t = 0.3, value_parser = values::positive)]
    pub(super) goal: f64,
    #[command(flatten)]
    pub(super) places: TouchedDivots,
    #[command(flatten)]
    pub(super) which: Which,
    /// Calibration file whose [[arm.joint]] replaces the session's: lengths right to a tenth,
    /// zeros to some degrees
    #[arg(long, value_name = "CAL.toml")]
    pub(super) arm: Option<PathBuf>,
    /// Check the arm against its fit instead of fitting it anew, and name the encoder that has
    /// slipped
    #[arg(long, conflicts_with_all = ["output", "keep", "counts", "limit"])]
    pub(crate) check: bool,
    /// Tip in the last link's frame (its origin at the link's end, x along it), mm: X,Y. A tip
    /// elsewhere is found as the last link's length and zero
    #[arg(long, value_name = "X,Y", default_value = "0,0", value_parser = tip, allow_hyphen_values = true)]
    pub(super) tip: DVec2,
    /// Numbers that stay fixed, such as length1 or zero3: the joint's number, from 1 at the base
    #[arg(long, value_name = "NUMBER", value_delimiter = ',', value_parser = kept)]
    pub(super) keep: Vec<Kept>,
    /// Find counts per turn or per mm, too; an encoder's disc is mostly known better than it can
    /// be measured
    #[arg(long)]
    pub(super) counts: bool,
    /// Repeatability of the tip in a divot, mm, one standard deviation along each axis
    #[arg(long = "seat", value_name = "MM", default_value_t = 0.1, value_parser = values::positive)]
    pub(crate) tip_sd_mm: f64,
    /// Refuse an arm whose touches are off by more, mm (root mean square)
    #[arg(long, value_name = "MM", default_value_t = 1.0, value_parser = values::positive)]
    pub(crate) limit: f64,
}

/// Known geometry of the touched places.
#[derive(Debug, Args)]
#[group(required = true, multiple = false)]
pub(super) struct TouchedDivots {
    /// Plate with divots (TOML): format = "sonoweave-plate", version = 1, divots_mm = [[x, y],
    /// …]
    #[arg(long, value_name = "PLATE.toml")]
    pub(super) plate: Option<PathBuf>,
    /// All touches are of one place, wherever it is
    #[arg(long)]
    pub(super) point: bool,
    /// Distance between two successive touches, mm: one distance for all, or one for each two
    #[arg(long, value_name = "MM", value_delimiter = ',', value_parser = values::positive)]
    pub(super) distances: Vec<f64>,
}

/// Selects the rests that are touches, and their places.
#[derive(Debug, Args)]
pub(super) struct Which {
    /// Divot of each touch, by its place in the plate's file, from 1: one number a touch
    /// [default: 1, 2, 3 … in rounds]
    #[arg(long, value_name = "N", value_delimiter = ',', requires = "plate")]
    pub(super) order: Vec<usize>,
    /// Rests that were no touches, by their numbers in the order of time, from 1
    #[arg(long, value_name = "N", value_delimiter = ',')]
    pub(super) skip: Vec<usize>,
    /// Shortest rest of the joints while the tip is set down, s
    #[arg(long, value_name = "S", default_value_t = 1.0, value_parser = values::positive)]
    pub(super) rest: f64,
    /// Largest movement of the tip during a rest of the joints, mm
    #[arg(long, value_name = "MM", default_value_t = 2.0, value_parser = values::positive)]
    pub(super) still: f64,
    /// Leave out everything recorded before: seconds from the recording's beginning
    #[arg(long, value_name = "S", value_parser = values::number)]
    pub(super) from: Option<f64>,
    /// Leave out everything recorded after: seconds from the recording's beginning
    #[arg(long, value_name = "S", value_parser = values::number)]
    pub(super) to: Option<f64>,
}

/// A joint's number that is not fitted.
#[derive(Debug, Clone, Copy)]
pub(super) enum Kept {
    Length(usize),
    Zero(usize),
    Direction(usize),
}

/// Makes a [`Kept`] from a joint's index, from 0.
type OfJoint = fn(usize) -> Kept;

fn kept(text: &str) -> Result<Kept, String> {
    let kinds = [("length", Kept::Length as OfJoint), ("zero", Kept::Zero), ("direction", Kept::Direction)];
    let of = |(name, of): (&str, OfJoint)| {
        let joint: usize = text.trim().strip_prefix(name)?.parse().ok()?;
        (1..=JOINTS).contains(&joint).then(|| of(joint - 1))
    };
    kinds.into_iter().find_map(of).ok_or_else(|| {
        format!("must be length, zero or direction, followed by the joint's number 1 to {JOINTS}, such as length1")
    })
}

fn tip(text: &str) -> Result<DVec2, String> {
    Ok(DVec2::from_array(sonoweave_core::keys::numbers::<2>(text)?))
}
