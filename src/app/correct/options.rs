//! Settings of a gate.

use clap::ValueEnum;
use serde::de::DeserializeOwned;
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
    /// The moments that an operator or a line marked
    Markers,
}

/// Settings of a gate.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct Settings {
    /// Share of the frames that is used.
    pub(crate) share: f64,
    /// The signal; `None` for markers if there are any, else the Reference sensor if there is one,
    /// and the images otherwise.
    pub(crate) signal: Option<GateSignal>,
    /// Phase around which frames are used, by markers: 0 at a marker, up to 1 at the next one.
    #[serde(default)]
    pub(crate) phase: f64,
}

/// Settings of a correction of pressure.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct PressureSettings {
    /// Number of the sweep with light contact, from 1.
    pub(super) light: usize,
    /// Largest distance of a frame from that sweep, at its middle, mm.
    pub(super) near_mm: f64,
}

/// Settings of a correction that are stored with it.
pub(super) trait Stored: Serialize + DeserializeOwned {
    /// Returns them as stored.
    ///
    /// # Errors
    /// [`Failure`] for a number that is not finite.
    fn stored(&self) -> Result<SettingsOverride, Failure> {
        Ok(serde_json::to_value(self)?.as_object().cloned().unwrap_or_default().into_iter().collect())
    }

    /// Reads those of a stored correction.
    ///
    /// # Errors
    /// [`Failure`] if one is missing or invalid.
    fn of(stored: &SettingsOverride) -> Result<Self, Failure> {
        let values: Map<String, Value> = stored.clone().into_iter().collect();
        Ok(serde_json::from_value(Value::Object(values))?)
    }
}

impl Stored for Settings {}
impl Stored for PressureSettings {}
