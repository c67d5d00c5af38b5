//! A session configuration for the devices of this machine, from a few answers.

use std::fmt::Write as _;

use config::bedside::{ArmKind, VIRTUAL};
use drivers::Listing;
use drivers::tracker::polhemus::Model;

/// Returns the models of trackers, as configurations name them.
pub(crate) fn trackers() -> [&'static str; 5] {
    Model::ALL.map(Model::name)
}

/// Returns the kinds of arms, as configurations name them.
pub(crate) fn arms() -> [&'static str; 5] {
    ArmKind::NAMED.map(|(name, _)| name)
}

/// Devices that are plugged in.
#[derive(Debug, Default)]
pub(crate) struct Found {
    /// Serial lines, and trackers on USB.
    pub(crate) ports: Vec<Listing>,
    pub(crate) grabbers: Vec<Listing>,
}

impl Found {
    /// Lists the devices of this machine.
    pub(crate) fn now() -> Self {
        let mut found = Self::default();
        for (driver, listings) in drivers::list() {
            let into = if driver == GRABBER { &mut found.grabbers } else { &mut found.ports };
            for listing in listings {
                if into.iter().all(|known| known.id != listing.id) {
                    into.push(listing);
                }
            }
        }
        found
    }

    /// Returns the model of the only tracker that names itself; serial lines do not.
    pub(crate) fn model(&self) -> Option<&'static str> {
        let named = |model: &&str| self.ports.iter().any(|port| port.description.to_lowercase().contains(*model));
        let mut models = trackers().into_iter().filter(named);
        models.next().filter(|_| models.next().is_none())
    }
}

/// Driver of the grabbers, as lists name it.
const GRABBER: &str = "grabber";

/// The choices that a configuration is written from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Answers {
    /// Model of the tracker or kind of the arm.
    pub(crate) tracker: String,
    /// Its line; three of an arm with a line for each joint.
    pub(crate) ports: Vec<String>,
    /// Station of the sensor on the patient.
    pub(crate) reference_station: Option<u8>,
    pub(crate) grabber: String,
    /// File of the calibration, if there is one.
    pub(crate) calibration: Option<String>,
    /// Folder of the recordings, if sessions are recorded.
    pub(crate) record: Option<String>,
}

impl Answers {
    /// Returns the configuration, with comments.
    pub(crate) fn text(&self) -> String {
        let mut text = String::from(
            "# Session configuration of this bedside, written by `sonoweave init`.\n#\n\
             #   sonoweave live --config FILE --check   tries all devices\n\
             #   sonoweave live --keys                  every key, its values and default\n#\n\
             # Keys behind a # are optional.\n\nformat = \"sonoweave-bedside\"\nversion = 1\n\n[calibration]\n",
        );
        match &self.calibration {
            Some(file) => line(&mut text, "file", &quoted(file), "relative to this file's folder"),
            None => line(&mut text, "#file", "\"probe.toml\"", "`sonoweave calibrate probe --live` writes it"),
        }
        self.tracking(&mut text);
        text += "\n[grabber]\n";
        line(&mut text, "device", &quoted(&self.grabber), "as `sonoweave devices` lists it");
        if self.grabber == VIRTUAL {
            line(&mut text, "size", "\"640x480\"", "of the simulated scanner's frames");
        } else {
            line(&mut text, "#size", "\"720x576\"", "by default the largest at a fluent rate");
        }
        line(&mut text, "latency_ms", "40.0", "scanner and grabber; `sonoweave calibrate latency` measures it");
        text += "\n[volume]\n";
        line(&mut text, "spacing_mm", "0.5", "distance between voxels");
        text += "\n[record]\n";
        match &self.record {
            Some(folder) => line(&mut text, "folder", &quoted(folder), "sessions are patients' data"),
            None => line(&mut text, "#folder", "\"sessions\"", "records every session there"),
        }
        text += "\n[status]\n";
        line(&mut text, "listen", "\"127.0.0.1:9110\"", "the page for a browser on this machine");
        text
    }

    fn tracking(&self, text: &mut String) {
        let ports: Vec<String> = self.ports.iter().map(|port| quoted(port)).collect();
        let port = if ports.len() == 1 { ports.concat() } else { format!("[{}]", ports.join(", ")) };
        if arms().contains(&self.tracker.as_str()) {
            text.push_str("\n[arm]\n");
            line(text, "kind", &quoted(&self.tracker), arms().join(", ").as_str());
            line(text, "port", &port, "as `sonoweave devices` lists it");
            line(text, "latency_ms", "0.0", "as `sonoweave calibrate latency` measures it");
            return;
        }
        text.push_str("\n[tracker]\n");
        line(text, "model", &quoted(&self.tracker), trackers().join(", ").as_str());
        line(text, "port", &port, "as `sonoweave devices` lists it");
        line(text, "probe_station", "1", "the sensor on the transducer");
        let (key, station) = self.reference_station.map_or(("#reference_station", 2), |n| ("reference_station", n));
        line(text, key, &station.to_string(), "the sensor on the patient");
        line(text, "latency_ms", "0.0", "as `sonoweave calibrate latency` measures it");
    }
}

/// Adds a key with its comment.
fn line(text: &mut String, key: &str, value: &str, comment: &str) {
    // Writing to a string does not fail.
    let _ = writeln!(text, "{:<32}  # {comment}", format!("{key} = {value}"));
}

/// Returns text as TOML writes it.
fn quoted(text: &str) -> String {
    toml::Value::String(text.to_owned()).to_string()
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use config::bedside::{Bedside, Tracking};

    use super::*;

    fn answers() -> Answers {
        Answers {
            tracker: "fastrak".into(),
            ports: vec!["/dev/ttyUSB \"0\"".into()],
            reference_station: Some(2),
            grabber: "/dev/video0".into(),
            calibration: None,
            record: Some("sessions".into()),
        }
    }

    #[test]
    fn every_model_and_kind_is_a_valid_configuration() {
        for model in trackers().into_iter().chain(arms()) {
            let ports =
                if model == "qsb" { vec!["/dev/a".into(), "/dev/b".into(), "/dev/c".into()] } else { answers().ports };
            let text = Answers { tracker: model.into(), ports, ..answers() }.text();
            let bedside = Bedside::parse(Path::new("b.toml"), &text).unwrap_or_else(|e| panic!("{model}: {e}\n{text}"));
            assert_eq!(matches!(bedside.tracking, Tracking::Arm(_)), arms().contains(&model), "{model}");
            assert!(bedside.record.folder.is_some() && bedside.status.listen.is_some());
        }
    }

    #[test]
    fn commented_keys_are_valid_without_their_mark() {
        let text = Answers { reference_station: None, record: None, ..answers() }.text();
        let marked = ["#reference_station", "#folder", "#size"];
        assert!(marked.iter().all(|key| text.contains(&format!("\n{key} = "))), "{text}");
        let all = marked.iter().fold(text, |text, key| text.replace(key, &key[1..]));
        assert!(Bedside::parse(Path::new("b.toml"), &all).is_ok(), "{all}");
    }

    #[test]
    fn model_is_known_only_if_one_tracker_names_itself() {
        let port = |text: &str| Listing { id: text.into(), description: text.into(), unavailable: None };
        let model =
            |ports: &[&str]| Found { ports: ports.iter().map(|p| port(p)).collect(), ..Found::default() }.model();
        assert_eq!(model(&["Polhemus LIBERTY", "a serial line"]), Some("liberty"));
        assert_eq!(model(&["a serial line"]), None);
        assert_eq!(model(&["Polhemus LIBERTY", "Polhemus PATRIOT"]), None);
    }
}
