//! Flags of `calibrate arm`.

use std::path::PathBuf;

use clap::{ArgGroup, Args};
use glam::DVec2;

use calibration::arm::JOINTS;

use super::super::guide::Gathering;
use super::super::outputs::Outputs;
use super::touched::{TouchedDivots, Which};
use crate::cli::values;

/// Flags of `calibrate arm`.
#[derive(Debug, Args)]
#[command(group(ArgGroup::new("from_arm").required(true).args(["session", "live"])), after_help = "\
Record a session with the arm (--live, or `live --record`), and set its tip down for two seconds each time. Every \
moment at which the joints rest counts as a touch.
--plate: touch the divots of a plate in any position, in the file's order, for several rounds; bend the arm \
differently in each round.
--point: touch one divot from all sides, with the elbow to the left and to the right. One point determines no size, \
so the longest link keeps its length.
--distances: touch both ends of a bar; then lay the bar elsewhere, and repeat.
The zero of the first joint defines the direction of the base's x axis, and is not changed. Give --skip for rests \
that were no touches.

--check compares an arm in use with its calibration. Touch as above. Only the report is written; the exit code is 0 \
only if the arm still agrees with its calibration.

Examples: sonoweave calibrate arm --live bedside.toml --plate plate.toml -o arm-probe.toml
          sonoweave calibrate arm --session SESSION.mcap --plate plate.toml -o arm-probe.toml --report arm.json
          sonoweave calibrate arm --session SESSION.mcap --plate plate.toml --check")]
pub struct Arguments {
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
    pub(super) check: bool,
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
    pub(super) tip_sd_mm: f64,
    /// Refuse an arm whose touches are off by more, mm (root mean square)
    #[arg(long, value_name = "MM", default_value_t = 1.0, value_parser = values::positive)]
    pub(super) limit: f64,
    #[command(flatten)]
    pub(super) outputs: Outputs,
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
