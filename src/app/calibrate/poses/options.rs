//! Flags that name the recording of a stylus, and the names of its frames.

use std::path::{Path, PathBuf};

use clap::Args;

use config::values;
use sonoweave_core::frames::{Reference, Stylus, Transform};

use super::super::guide::Gathering;
use super::samples::Taken;
use crate::failure::Failure;

/// A recording, of one kind or the other.
#[derive(Debug, Clone, Default, Args)]
#[group(required = true, multiple = false)]
pub struct Source {
    /// Tracked sequence (.mha, .mhd, .nrrd, .nhdr), with or without images
    #[arg(long, value_name = "SEQUENCE")]
    pub sequence: Option<PathBuf>,
    /// Session of a tracker with a stylus, recorded by `live --record`
    #[arg(long, value_name = "SESSION.mcap")]
    pub session: Option<PathBuf>,
    /// Session configuration: record its devices now, show instructions, and end when there is
    /// enough
    #[arg(long, value_name = "BEDSIDE.toml")]
    pub live: Option<PathBuf>,
}

/// A recording, and the names of its frames.
#[derive(Debug, Clone, Args)]
pub struct Recording {
    /// Source of the recording
    #[command(flatten)]
    pub source: Source,
    /// Flags for a recording that is made now
    #[command(flatten)]
    pub gathering: Gathering,
    /// Name of the frame of the stylus's sensor
    #[arg(long, value_name = "NAME", default_value = "Stylus")]
    pub stylus: String,
    /// Name of the frame in which its poses are taken [default: Reference if the recording has
    /// one, else Tracker]
    #[arg(long, value_name = "NAME")]
    pub reference: Option<String>,
    /// Leave out everything recorded before: seconds from the recording's beginning
    #[arg(long, value_name = "S", value_parser = values::number)]
    pub from: Option<f64>,
    /// Leave out everything recorded after: seconds from the recording's beginning
    #[arg(long, value_name = "S", value_parser = values::number)]
    pub to: Option<f64>,
    /// Flags of `stylus` and `reference`, for messages
    #[arg(skip = ["--stylus", "--reference"])]
    pub flags: [&'static str; 2],
}

impl Recording {
    /// Returns the file; the session configuration if the recording is still to be made.
    pub fn path(&self) -> &Path {
        let Source { sequence, session, live, .. } = &self.source;
        // The command line guarantees that one of them is present.
        sequence.as_ref().or(session.as_ref()).or(live.as_ref()).map_or(Path::new(""), PathBuf::as_path)
    }

    /// Returns an empty collection of its poses.
    pub(super) fn taken(&self) -> Result<Taken<Transform<Reference, Stylus>>, Failure> {
        Taken::new(&format!("poses of {}", self.stylus), self.from, self.to)
    }
}
