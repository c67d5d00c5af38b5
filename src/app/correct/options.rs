//! Settings of a gate.

use clap::ValueEnum;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use config::bedside::SettingsOverride;

use crate::failure::Failure;

/// The signal of a gate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum GateSignal {
    /// The position of the Reference sensor, which lies on the body
    Reference,
    /// The tissue's shift in depth from image to image
    Images,
}

/// Settings of a gate.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct Settings {
    /// Share of the frames that is used.
    pub(crate) share: f64,
    /// The signal; `None` for the Reference sensor if there is one, and the images otherwise.
    pub(crate) signal: Option<GateSignal>,
}

impl Settings {
    /// Reads those of a stored correction.
    pub(super) fn of(stored: &SettingsOverride) -> Result<Self, Failure> {
        let values: Map<String, Value> = stored.clone().into_iter().collect();
        Ok(serde_json::from_value(Value::Object(values))?)
    }
}
