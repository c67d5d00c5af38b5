//! Flags for a recording that is made now.

use std::path::PathBuf;

use clap::Args;

use config::values;

use crate::app::live::session::check_duration;
use crate::failure::Failure;

/// Flags for a recording that is made now.
#[derive(Debug, Clone, Default, Args)]
pub struct Gathering {
    /// Write the recording of --live to this folder [default: the configuration's, else the
    /// current one]
    #[arg(long, value_name = "DIR")]
    pub(super) record: Option<PathBuf>,
    /// End --live after so many seconds, enough or not [default: when it is enough, or by
    /// Ctrl-C]
    #[arg(long, value_name = "S", value_parser = values::positive)]
    pub(super) duration: Option<f64>,
}

impl Gathering {
    /// Returns the session configuration whose devices are to be recorded, if requested.
    ///
    /// # Errors
    /// [`Failure`] for flags without a recording, and for a duration that no session lasts. The
    /// parser cannot report the former: an argument excluded by --live satisfies its
    /// requirement.
    pub fn of<'a>(&self, live: Option<&'a PathBuf>) -> Result<Option<&'a PathBuf>, Failure> {
        let needless = [("--record", self.record.is_some()), ("--duration", self.duration.is_some())];
        if let Some((flag, _)) = needless.into_iter().find(|(_, is_given)| live.is_none() && *is_given) {
            fail!("{flag}: applies to --live BEDSIDE.toml only; give it, too");
        }
        check_duration(self.duration)?;
        Ok(live)
    }
}
