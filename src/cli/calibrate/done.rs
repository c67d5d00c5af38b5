//! The work of a calibration, whoever asks for it, and its outlets.

use clap::Args;

use super::advice::AdviceDisplay;
use crate::app::calibrate::guide::Advisor;
use crate::app::reporter::Steps;
use crate::cli::print::print;
use crate::cli::progress::steps;
use crate::failure::Failure;

/// Outlets of a calibration while it works.
pub(super) struct Outlets<'a> {
    /// The operator of a recording that is made now.
    pub(super) advisor: &'a mut dyn Advisor,
    pub(super) steps: Steps<'a>,
    /// Whether the report is wanted, even if no file of it is.
    pub(super) wants_report: bool,
}

/// A finished calibration, whose files are written.
pub(super) struct Done {
    /// Text for people.
    pub(super) text: String,
    /// The report, as a JSON document.
    pub(super) report: String,
    /// Failure of a command whose finding is one: an arm that does not agree any more.
    pub(super) failure: Option<Failure>,
}

impl Done {
    pub(super) fn new(text: String, report: String) -> Self {
        Self { text, report, failure: None }
    }
}

/// Flags of a calibration.
pub(super) trait Calibrate: Args {
    /// Calibrates, and writes the requested files.
    ///
    /// # Errors
    /// [`Failure`] when the recording does not determine the result, or it is not good enough;
    /// nothing is written then.
    fn calibrate(&self, outlets: Outlets<'_>) -> Result<Done, Failure>;
}

/// Calibrates by flags, and prints the result.
///
/// # Errors
/// As of [`Calibrate::calibrate`].
pub(super) fn by_flags(flags: &impl Calibrate) -> Result<(), Failure> {
    let outlets = Outlets { advisor: &mut AdviceDisplay::default(), steps: &steps, wants_report: false };
    let Done { text, failure, .. } = flags.calibrate(outlets)?;
    print(&text)?;
    failure.map_or(Ok(()), Err)
}
