//! The side file of a sweep in a BIDS-style folder: what an archive asks about a recording.

use std::path::Path;

use serde::Serialize;
use serde_json::{Map, Value, json};

use config::Settings as Config;
use formats::whole::write_whole;

use super::sequence::SequenceReport;
use crate::app::input;
use crate::app::json::document;
use crate::app::provenance::program;
use crate::cli::Failure;

/// Writes the side file of a sequence. It names no file, as names often identify a person.
///
/// # Errors
/// [`Failure`] when a file cannot be read or written.
pub(super) fn write(to: &Path, report: &SequenceReport, config: Option<(&Path, &Config)>) -> Result<(), Failure> {
    let content = Sidecar {
        generated_by: json!({ "Name": "sonoweave", "Version": program() }),
        recording: report.recording(),
        calibration: config.map(|(path, config)| calibration(path, config)).transpose()?,
    };
    let text = document(&content)?;
    write_whole(to, |file| file.write_all(text.as_bytes())).map_err(|e| Failure::io(to, "writing", &e))
}

#[derive(Serialize)]
#[serde(rename_all = "PascalCase")]
struct Sidecar {
    generated_by: Value,
    #[serde(flatten)]
    recording: Map<String, Value>,
    /// Absent without a calibration file.
    #[serde(skip_serializing_if = "Option::is_none")]
    calibration: Option<Value>,
}

/// Returns the calibration's hash, depth and error, and the devices' latencies.
fn calibration(path: &Path, config: &Config) -> Result<Value, Failure> {
    let mut found = json!({ "Sha256": input::hash(path)? });
    let mut put = |name: &str, value: Option<Value>| {
        if let Some(value) = value {
            found[name] = value;
        }
    };
    put("Preset", config.preset.as_ref().map(|preset| json!(preset.name)));
    put("Made", config.record.origin.made.map(|day| json!(day.to_string())));
    put(
        "Latency",
        config.latency.map(|latency| json!({ "VideoMs": latency.video_ms, "TrackerMs": latency.tracker_ms })),
    );
    put(
        "Error",
        config.record.quality.map(|quality| {
            let [mean, deviation] = quality.error_mm;
            json!({
                "Frames": quality.frames,
                "MeanMm": mean,
                "StandardDeviationMm": deviation,
                "CentreMm": quality.centre_mm,
                "CornerMm": quality.corner_mm,
            })
        }),
    );
    Ok(found)
}
