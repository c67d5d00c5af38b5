//! The devices of a session: kinds, ports and settings.

use std::path::PathBuf;

use calibration::tracker::noise::TrackerNoise;
use drivers::OpenSettings;
use drivers::arm::microscribe::Family;
use drivers::arm::{self, ArmSettings};
use drivers::grabber::GrabberSettings;
use drivers::grabber::pixels::Colour;
use drivers::tracker::polhemus::{self, Model, Port, TrackerSettings};
use sync::graph::Names;

use super::reader::Reader;
use super::remote::{self, Remote};
use super::schema::{self, values::TextOr};
use crate::{Error, values};

pub use super::schema::devices::ArmKind;

/// Value in place of a port or a node for a device of the virtual bedside.
pub const VIRTUAL: &str = "virtual";
/// Frame of the tracker's transmitter, or of the arm's base.
pub const TRACKER_FRAME: &str = "Tracker";
/// Frame of the sensor on the transducer, or of the arm's last link.
pub const PROBE_FRAME: &str = "Probe";
/// Frame of the sensor on the patient.
pub const REFERENCE_FRAME: &str = "Reference";
/// Frame of the stylus.
pub const STYLUS_FRAME: &str = "Stylus";

/// The device that carries or locates the probe.
#[derive(Debug, Clone, PartialEq)]
pub enum Tracking {
    /// A tracker with a sensor on the probe.
    Tracker(Tracker),
    /// An arm that holds the probe.
    Arm(Arm),
    /// A server that sends the probe's poses.
    Remote(Remote),
}

impl Tracking {
    /// Returns the latency of its times beyond the delay that its driver knows, ns.
    pub fn latency_ns(&self) -> i64 {
        match self {
            Self::Tracker(tracker) => tracker.latency_ns,
            Self::Arm(arm) => arm.latency_ns,
            Self::Remote(remote) => remote.latency_ns,
        }
    }

    pub(super) fn set_latency_ns(&mut self, ns: i64) {
        match self {
            Self::Tracker(tracker) => tracker.latency_ns = ns,
            Self::Arm(arm) => arm.latency_ns = ns,
            Self::Remote(remote) => remote.latency_ns = ns,
        }
    }

    /// Whether it belongs to the virtual bedside.
    pub fn is_virtual(&self) -> bool {
        match self {
            Self::Tracker(tracker) => tracker.port.is_none(),
            Self::Arm(arm) => arm.ports.is_none(),
            Self::Remote(_) => false,
        }
    }

    /// Whether a second sensor, on the patient, carries the world.
    pub fn has_reference(&self) -> bool {
        self.names().iter().any(|(from, _)| from == REFERENCE_FRAME)
    }

    /// Returns the frames of its transforms, the source frame first.
    pub fn names(&self) -> Vec<Names> {
        let to_tracker = |frame: &str| (frame.to_owned(), TRACKER_FRAME.to_owned());
        match self {
            Self::Tracker(tracker) => tracker.roles.all().map(|(_, frame)| to_tracker(frame)).collect(),
            Self::Arm(_) => vec![to_tracker(PROBE_FRAME)],
            Self::Remote(remote) => remote.transforms.iter().map(|(_, frame)| to_tracker(frame)).collect(),
        }
    }
}

/// Roles of stations.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Roles {
    /// On the transducer.
    pub probe: u8,
    /// On the patient.
    pub reference: Option<u8>,
    /// The stylus.
    pub stylus: Option<u8>,
}

impl Roles {
    /// Returns the stations and the frames of their sensors.
    pub fn all(self) -> impl Iterator<Item = (u8, &'static str)> {
        let others = [(self.reference, REFERENCE_FRAME), (self.stylus, STYLUS_FRAME)];
        let others = others.into_iter().filter_map(|(station, frame)| Some((station?, frame)));
        std::iter::once((self.probe, PROBE_FRAME)).chain(others)
    }

    /// Returns the frame of a station's sensor.
    pub fn frame(self, station: u8) -> Option<&'static str> {
        self.all().find(|(own, _)| *own == station).map(|(_, frame)| frame)
    }
}

/// A tracker.
#[derive(Debug, Clone, PartialEq)]
pub struct Tracker {
    /// Its model.
    pub model: Model,
    /// Its port; `None` for a virtual one.
    pub port: Option<Port>,
    /// Its device settings.
    pub settings: polhemus::Settings,
    /// Roles of its stations.
    pub roles: Roles,
    /// Noise of a sensor's pose, if the configuration gives it.
    pub noise: Option<TrackerNoise>,
    /// Latency of its times beyond the delay that the driver knows, ns.
    pub latency_ns: i64,
}

impl Tracker {
    /// Returns the settings to open it at a port: its own, or its twin's.
    pub fn open_settings(&self, port: Port, keeps_raw: bool) -> OpenSettings {
        let settings = self.settings.clone();
        OpenSettings::Tracker(TrackerSettings { model: self.model, port, settings, keeps_raw })
    }

    pub(super) fn read(mut keys: Reader<'_, '_>, latency_ms: f64) -> Result<Self, Error> {
        let given: schema::devices::Tracker = keys.read()?;
        let model = keys.need("model", given.model)?.0;
        let (port, baud) = (keys.need("port", given.port)?, given.baud);
        let port = match (port.as_str(), port.strip_prefix("usb:")) {
            (VIRTUAL, _) => None,
            ("usb", _) => Some(Port::Usb(None)),
            (_, Some(which)) => Some(Port::Usb(Some(which.to_owned()))),
            (path, _) if path.starts_with('/') => Some(Port::Serial { path: path.into(), baud }),
            (text, _) => {
                let problem = format!(
                    "\"{text}\" is not a port: give a serial line's path, such as \"/dev/ttyUSB0\", or \"usb\", \
                    \"usb:SERIAL\" or \"virtual\"; `sonoweave devices` lists ports"
                );
                return Err(keys.error("port", problem));
            }
        };
        if baud.is_some() && !matches!(port, Some(Port::Serial { .. })) {
            return Err(keys.error("baud", "applies to serial lines only; leave it out"));
        }
        let (probe, reference, stylus) = (given.probe_station, given.reference_station, given.stylus_station);
        let mut stations = vec![probe];
        for (key, other) in [("reference_station", reference), ("stylus_station", stylus)] {
            let Some(other) = other else { continue };
            if stations.contains(&other) {
                return Err(keys.error(
                    key,
                    format!("station {other} belongs to another sensor; give each sensor its own station"),
                ));
            }
            stations.push(other);
        }
        stations.sort_unstable();
        let hemisphere = match given.hemisphere {
            TextOr::Text(text) if text == "follow" => [0.0; 3],
            TextOr::Text(text) => {
                let problem = format!("\"{text}\" is not a direction; give [x, y, z] or \"follow\"");
                return Err(keys.error("hemisphere", problem));
            }
            TextOr::Other(direction) => direction,
        };
        let settings = polhemus::Settings {
            stations,
            hemisphere,
            binary: given.binary,
            stylus,
            rate_hz: given.rate_hz,
            may_reset: given.may_reset,
        };
        let roles = Roles { probe, reference, stylus };
        let latency_ns = keys.latency_ns(given.latency_ms, latency_ms);
        let noise = keys.noise(given.noise)?;
        let tracker = Self { model, port, settings, roles, noise, latency_ns };
        let port = tracker.port.clone().unwrap_or(Port::Serial { path: VIRTUAL.into(), baud: None });
        drivers::open(&tracker.open_settings(port, false)).map_err(|error| keys.refused(&error))?;
        Ok(tracker)
    }
}

/// An arm. Its joints are in the calibration file.
#[derive(Debug, Clone, PartialEq)]
pub struct Arm {
    /// Its kind.
    pub kind: ArmKind,
    /// Its lines, base first: three for [`ArmKind::Qsb`], else one; `None` for a virtual one.
    pub ports: Option<Vec<PathBuf>>,
    /// Its device settings.
    pub settings: arm::Settings,
    /// Latency of its times beyond the delay that the driver knows, ns.
    pub latency_ns: i64,
}

impl Arm {
    /// Returns the number of its lines.
    pub fn lines(&self) -> usize {
        if self.kind == ArmKind::Qsb { 3 } else { 1 }
    }

    /// Returns the counts a turn of its twin's encoders: the configured number, else the default
    /// of such arms.
    pub fn twin_counts_per_turn(&self) -> u32 {
        match self.kind {
            ArmKind::MicroScribe(..) => 1 << 14,
            _ => self.settings.counts_per_turn.into_iter().find(|counts| *counts > 0).unwrap_or(40_000),
        }
    }

    /// Returns the settings to open it at its lines: its own, or its twin's. Missing lines have
    /// an empty name.
    pub fn open_settings(&self, ports: &[PathBuf], keeps_raw: bool) -> OpenSettings {
        let line = |n: usize| ports.get(n).cloned().unwrap_or_default();
        let model = match self.kind {
            ArmKind::Ea1(format) => arm::Model::Ea1 { path: line(0), format },
            ArmKind::Qsb => arm::Model::Qsb { paths: [line(0), line(1), line(2)] },
            ArmKind::MicroScribe(family, encoders) => arm::Model::MicroScribe { path: line(0), family, encoders },
        };
        OpenSettings::Arm(ArmSettings { model, settings: self.settings.clone(), keeps_raw })
    }

    pub(super) fn read(mut keys: Reader<'_, '_>, latency_ms: f64) -> Result<Self, Error> {
        use arm::ea1::SampleFormat::{Blocks, Lines};
        let given: schema::devices::Arm = keys.read()?;
        let mut kind = keys.need("kind", given.kind)?.0;
        if given.blocks {
            if kind != ArmKind::Ea1(Lines) {
                return Err(keys.error("blocks", "applies to kind = \"ea1\" only; leave it out"));
            }
            kind = ArmKind::Ea1(Blocks);
        }
        match (&mut kind, given.encoders) {
            (ArmKind::MicroScribe(_, own), Some(asked)) => *own = asked,
            (_, Some(_)) => {
                return Err(
                    keys.error("encoders", "applies to kind = \"microscribe\" and \"immersion\" only; leave it out")
                );
            }
            (_, None) => {}
        }
        let ports = match keys.need("port", given.port)? {
            TextOr::Text(one) => vec![one],
            TextOr::Other(all) => all,
        };
        check_paths(&keys, &ports, if kind == ArmKind::Qsb { 3 } else { 1 })?;
        let usual = match kind {
            ArmKind::MicroScribe(..) => arm::Settings::of_14_bits(),
            ArmKind::Ea1(_) | ArmKind::Qsb => arm::Settings::default(),
        };
        let fastest = given.fastest_counts_per_s.unwrap_or(usual.fastest);
        keys.note("fastest_counts_per_s", &fastest);
        let (rate_hz, counts_per_turn, baud) = (given.rate_hz, given.counts_per_turn, given.baud);
        let settings = arm::Settings { rate_hz, fastest, counts_per_turn, baud };
        if ports == [VIRTUAL] && matches!(kind, ArmKind::MicroScribe(Family::Box, _)) {
            return Err(keys.error("port", "there is no virtual Immersion box; choose another kind"));
        }
        let ports = (ports != [VIRTUAL]).then(|| ports.into_iter().map(PathBuf::from).collect());
        let arm = Self { kind, ports, settings, latency_ns: keys.latency_ns(given.latency_ms, latency_ms) };
        let named = arm.ports.clone().unwrap_or_default();
        drivers::open(&arm.open_settings(&named, false)).map_err(|error| keys.refused(&error))?;
        Ok(arm)
    }
}

/// Checks the paths of an arm's lines; `virtual` must be the only one.
fn check_paths(keys: &Reader<'_, '_>, all: &[String], lines: usize) -> Result<(), Error> {
    if all == [VIRTUAL] {
        return Ok(());
    }
    if let Some(n) = all.iter().position(|path| !path.starts_with('/')) {
        let key = if all.len() > 1 { format!("port[{n}]") } else { "port".into() };
        return Err(keys.error(
            &key,
            format!(
                "\"{}\" is not a serial line's path; give one, such as \"/dev/ttyUSB0\", or \"virtual\"; \
                `sonoweave devices` lists ports",
                all[n]
            ),
        ));
    }
    match all.len() == lines {
        true => Ok(()),
        false if lines == 1 => Err(keys.error("port", format!("this arm has one line, not {}", all.len()))),
        false => Err(keys.error(
            "port",
            format!("this arm has {lines} lines, base first, not {}; give a list of their paths", all.len()),
        )),
    }
}

/// A frame grabber.
#[derive(Debug, Clone, PartialEq)]
pub struct Grabber {
    /// It belongs to the virtual bedside. Only its size, rate and orientation matter then.
    pub is_virtual: bool,
    /// Its device settings.
    pub settings: GrabberSettings,
    /// Latency of its times behind its images, ns.
    pub latency_ns: i64,
}

impl Grabber {
    /// Converts an image size between storage and MF orientation, in either direction.
    pub fn turned(&self, [width, height]: [u32; 2]) -> [u32; 2] {
        if self.settings.orientation.starts_with(['F', 'N']) { [height, width] } else { [width, height] }
    }

    /// Returns the settings to open it, if it is not virtual.
    pub fn open_settings(&self) -> OpenSettings {
        remote::pictures(&self.settings).unwrap_or_else(|| OpenSettings::Grabber(self.settings.clone()))
    }

    pub(super) fn read(mut keys: Reader<'_, '_>, latency_ms: f64) -> Result<Self, Error> {
        let given: schema::devices::Grabber = keys.read()?;
        let device = keys.need("device", given.device.filter(|device| !device.is_empty()))?;
        let is_virtual = device == VIRTUAL;
        let settings = GrabberSettings {
            input: given.input.map(|input| match input {
                TextOr::Text(name) => name,
                TextOr::Other(number) => number.to_string(),
            }),
            standard: given.standard.map(|standard| standard.0),
            format: given.format.map(|format| format.0),
            size: given.size.map(|size| keys.parsed("size", size, "x", values::picture_size)).transpose()?,
            rate_hz: given.rate_hz,
            colour: given.colour.0,
            range: given.range.map(|range| range.0),
            matrix: given.matrix.map(|matrix| matrix.0),
            interlace: given.interlace.0,
            buffers: given.buffers,
            orientation: given.orientation.0.0,
            ..GrabberSettings::new(device)
        };
        if is_virtual && settings.colour == Colour::Rgb {
            return Err(keys.error("colour", "a virtual grabber makes grey frames only; leave it out"));
        }
        let grabber = Self { is_virtual, settings, latency_ns: keys.latency_ns(given.latency_ms, latency_ms) };
        drivers::open(&grabber.open_settings()).map_err(|error| keys.refused(&error))?;
        Ok(grabber)
    }
}
