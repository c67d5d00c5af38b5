//! The devices of a session: kinds, ports and settings.

use std::path::PathBuf;

use serde::Serialize;

use drivers::OpenSettings;
use drivers::arm::microscribe::Family;
use drivers::arm::{self, ArmSettings};
use drivers::grabber::pixels::{Colour, Matrix, PixelFormat, Range};
use drivers::grabber::{GrabberSettings, Interlace, Standard};
use drivers::tracker::polhemus::{self, Model, Port, TrackerSettings};
use sonoweave_core::keys::{Entry, FileError};
use sync::graph::Names;

use super::reader::Reader;
use super::remote::{self, Remote};
use crate::values;

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

/// The eight orientations of stored images.
const ORIENTATIONS: [(&str, &str); 8] =
    [("MF", "MF"), ("MN", "MN"), ("UF", "UF"), ("UN", "UN"), ("FM", "FM"), ("NM", "NM"), ("FU", "FU"), ("NU", "NU")];

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
    /// Latency of its times beyond the delay that the driver knows, ns.
    pub latency_ns: i64,
}

impl Tracker {
    /// Returns the settings to open it at a port: its own, or its twin's.
    pub fn open_settings(&self, port: Port, keeps_raw: bool) -> OpenSettings {
        let settings = self.settings.clone();
        OpenSettings::Tracker(TrackerSettings { model: self.model, port, settings, keeps_raw })
    }

    pub(super) fn read(mut keys: Reader<'_, '_>, latency_ms: f64) -> Result<Self, FileError> {
        let models = Model::ALL.map(|model| (model.name(), model));
        let Some(model) = keys.choice_if("model", &models)? else {
            return Err(keys.error("model", "is missing: give isotrak, fastrak, liberty, patriot or viper"));
        };
        let baud = keys.whole_if("baud", 1200..=10_000_000)?;
        let port = keys.value_if("port", |entry| {
            let text = entry.text()?;
            if text != VIRTUAL && text != "usb" && !text.starts_with("usb:") && !text.starts_with('/') {
                return Err(entry.error(format!(
                    "\"{text}\" is not a port: give a serial line's path, such as \"/dev/ttyUSB0\", or \"usb\", \
                    \"usb:SERIAL\" or \"virtual\"; `sonoweave devices` lists ports"
                )));
            }
            Ok(text.to_owned())
        })?;
        let port = match port.as_deref() {
            None => {
                return Err(keys.error(
                    "port",
                    "is missing: give the tracker's port; `sonoweave devices` lists the connected ones",
                ));
            }
            Some(VIRTUAL) => None,
            Some("usb") => Some(Port::Usb(None)),
            Some(text) => Some(match text.strip_prefix("usb:") {
                Some(which) => Port::Usb(Some(which.to_owned())),
                None => Port::Serial { path: text.into(), baud },
            }),
        };
        if baud.is_some() && !matches!(port, Some(Port::Serial { .. })) {
            return Err(keys.error("baud", "applies to serial lines only; leave it out"));
        }
        let station = |n: u32| u8::try_from(n).unwrap_or(u8::MAX);
        let probe = keys.whole("probe_station", 1, 1..=16).map(station)?;
        let reference = keys.whole_if("reference_station", 1..=16)?.map(station);
        let stylus = keys.whole_if("stylus_station", 1..=16)?.map(station);
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
        let usual = polhemus::Settings::default();
        let hemisphere = keys.value("hemisphere", usual.hemisphere, |entry| match entry.as_text() {
            Some("follow") => Ok([0.0; 3]),
            Some(text) => Err(entry.error(format!("\"{text}\" is not a direction; give [x, y, z] or \"follow\""))),
            None => Ok(entry.numbers::<3>()?.map(|x| x as f32)),
        })?;
        let settings = polhemus::Settings {
            stations,
            hemisphere,
            binary: keys.truth("binary", usual.binary)?,
            stylus,
            rate_hz: keys.number("rate_hz", usual.rate_hz, 1.0..=10_000.0)?,
            may_reset: keys.truth("may_reset", usual.may_reset)?,
        };
        let roles = Roles { probe, reference, stylus };
        let tracker = Self { model, port, settings, roles, latency_ns: latency(&mut keys, latency_ms)? };
        let port = tracker.port.clone().unwrap_or(Port::Serial { path: VIRTUAL.into(), baud: None });
        drivers::open(&tracker.open_settings(port, false)).map_err(|error| misuse(&keys, &error))?;
        Ok(tracker)
    }
}

/// Kind of an arm.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ArmKind {
    /// One with protocol EA1, or lines of bare numbers.
    Ea1(arm::ea1::Speech),
    /// Three QSBs.
    Qsb,
    /// A MicroScribe or an Immersion box with this number of encoders.
    MicroScribe(Family, u8),
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
            ArmKind::Ea1(speech) => arm::Model::Ea1 { path: line(0), speech },
            ArmKind::Qsb => arm::Model::Qsb { paths: [line(0), line(1), line(2)] },
            ArmKind::MicroScribe(family, encoders) => arm::Model::MicroScribe { path: line(0), family, encoders },
        };
        OpenSettings::Arm(ArmSettings { model, settings: self.settings.clone(), keeps_raw })
    }

    pub(super) fn read(mut keys: Reader<'_, '_>, latency_ms: f64) -> Result<Self, FileError> {
        use arm::ea1::Speech::{BareNumbers, Blocks, Lines};
        let kinds = [
            ("ea1", ArmKind::Ea1(Lines)),
            ("lines", ArmKind::Ea1(BareNumbers)),
            ("qsb", ArmKind::Qsb),
            ("microscribe", ArmKind::MicroScribe(Family::MicroScribe, 5)),
            ("immersion", ArmKind::MicroScribe(Family::Box, 4)),
        ];
        let Some(mut kind) = keys.choice_if("kind", &kinds)? else {
            return Err(keys.error("kind", "is missing: give ea1, lines, qsb, microscribe or immersion"));
        };
        if keys.truth("blocks", false)? {
            if kind != ArmKind::Ea1(Lines) {
                return Err(keys.error("blocks", "applies to kind = \"ea1\" only; leave it out"));
            }
            kind = ArmKind::Ea1(Blocks);
        }
        let encoders = keys.whole_if("encoders", 2..=6)?;
        match (&mut kind, encoders.and_then(|n| u8::try_from(n).ok())) {
            (ArmKind::MicroScribe(_, own), Some(asked)) => *own = asked,
            (_, Some(_)) => {
                return Err(
                    keys.error("encoders", "applies to kind = \"microscribe\" and \"immersion\" only; leave it out")
                );
            }
            (_, None) => {}
        }
        let ports = keys.value_if("port", |entry| paths(entry, if kind == ArmKind::Qsb { 3 } else { 1 }))?;
        let Some(ports) = ports else {
            return Err(
                keys.error("port", "is missing: give the arm's port; `sonoweave devices` lists the connected ones")
            );
        };
        let usual = match kind {
            ArmKind::MicroScribe(..) => arm::Settings::of_14_bits(),
            ArmKind::Ea1(_) | ArmKind::Qsb => arm::Settings::default(),
        };
        let settings = arm::Settings {
            rate_hz: keys.whole("rate_hz", usual.rate_hz, 1..=10_000)?,
            fastest: keys.whole("fastest_counts_per_s", usual.fastest, 100..=u32::MAX)?,
            counts_per_turn: keys.value("counts_per_turn", usual.counts_per_turn, |entry| {
                let items = entry.items("a list of 3 whole numbers")?;
                let counts = items.iter().map(Entry::whole).collect::<Result<Vec<_>, _>>()?;
                <[u32; 3]>::try_from(counts)
                    .map_err(|all| entry.error(format!("must hold 3 whole numbers, not {}", all.len())))
            })?,
            baud: keys.whole_if("baud", 1200..=10_000_000)?,
        };
        if ports == [VIRTUAL] && matches!(kind, ArmKind::MicroScribe(Family::Box, _)) {
            return Err(keys.error("port", "there is no virtual Immersion box; choose another kind"));
        }
        let ports = (ports != [VIRTUAL]).then(|| ports.into_iter().map(PathBuf::from).collect());
        let arm = Self { kind, ports, settings, latency_ns: latency(&mut keys, latency_ms)? };
        let named = arm.ports.clone().unwrap_or_default();
        drivers::open(&arm.open_settings(&named, false)).map_err(|error| misuse(&keys, &error))?;
        Ok(arm)
    }
}

/// Reads one path or several; `virtual` must be the only one.
fn paths(entry: &Entry<'_>, lines: usize) -> Result<Vec<String>, FileError> {
    let path = |entry: &Entry<'_>| {
        let text = entry.text()?;
        match text.starts_with('/') {
            true => Ok(text.to_owned()),
            false => Err(entry.error(format!(
                "\"{text}\" is not a serial line's path; give one, such as \"/dev/ttyUSB0\", or \"virtual\"; \
                `sonoweave devices` lists ports"
            ))),
        }
    };
    if entry.as_text() == Some(VIRTUAL) {
        return Ok(vec![VIRTUAL.to_owned()]);
    }
    let all = match entry.is_list() {
        true => entry.items("a list of paths")?.iter().map(path).collect::<Result<Vec<_>, _>>()?,
        false => vec![path(entry)?],
    };
    match all.len() == lines {
        true => Ok(all),
        false if lines == 1 => Err(entry.error(format!("this arm has one line, not {}", all.len()))),
        false => Err(entry
            .error(format!("this arm has {lines} lines, base first, not {}; give a list of their paths", all.len()))),
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

    pub(super) fn read(mut keys: Reader<'_, '_>, latency_ms: f64) -> Result<Self, FileError> {
        let Some(device) = keys.text_if("device")?.filter(|device| !device.is_empty()) else {
            return Err(
                keys.error("device", "is missing: give the grabber; `sonoweave devices` lists the connected ones")
            );
        };
        let is_virtual = device == VIRTUAL;
        let usual = GrabberSettings::new(device);
        let standards = [("ntsc", Standard::Ntsc), ("pal", Standard::Pal), ("secam", Standard::Secam)];
        let interlaces =
            [("one-field", Interlace::OneField), ("both-fields", Interlace::BothFields), ("whole", Interlace::Whole)];
        let input = keys.value_if("input", |entry| match entry.as_text() {
            Some(name) => Ok(name.to_owned()),
            None => entry.whole().map(|number| number.to_string()),
        })?;
        let settings = GrabberSettings {
            input,
            standard: keys.choice_if("standard", &standards)?,
            format: keys.value_if("format", format)?.map(|format| format.0),
            size: keys.parsed_if("size", "x", values::picture_size)?,
            rate_hz: keys.number_if("rate_hz", 0.1..=1000.0)?,
            colour: keys.choice("colour", "grey", &[("grey", Colour::Grey), ("rgb", Colour::Rgb)])?,
            range: keys.choice_if("range", &[("limited", Range::Limited), ("full", Range::Full)])?,
            matrix: keys.choice_if("matrix", &[("bt601", Matrix::Bt601), ("bt709", Matrix::Bt709)])?,
            interlace: keys.choice("interlace", "one-field", &interlaces)?,
            buffers: keys.whole("buffers", usual.buffers, 2..=32)?,
            orientation: keys.choice("orientation", "MF", &ORIENTATIONS)?,
            ..usual
        };
        if is_virtual && settings.colour == Colour::Rgb {
            return Err(keys.error("colour", "a virtual grabber makes grey frames only; leave it out"));
        }
        let grabber = Self { is_virtual, settings, latency_ns: latency(&mut keys, latency_ms)? };
        drivers::open(&grabber.open_settings()).map_err(|error| misuse(&keys, &error))?;
        Ok(grabber)
    }
}

/// A video format by its V4L2 name; serialises as that.
struct Format(PixelFormat);

impl Serialize for Format {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(&self.0)
    }
}

fn format(entry: &Entry<'_>) -> Result<Format, FileError> {
    let text = entry.text()?;
    let found = PixelFormat::ALL.into_iter().find(|format| format.to_string().eq_ignore_ascii_case(text));
    found.map(Format).ok_or_else(|| {
        let all: Vec<String> = PixelFormat::ALL.iter().map(ToString::to_string).collect();
        entry.error(format!("the format \"{text}\" cannot be read; give one of {}", all.join(", ")))
    })
}

/// Reads the file's latency, or else the calibration's.
pub(super) fn latency(keys: &mut Reader<'_, '_>, calibrated_ms: f64) -> Result<i64, FileError> {
    keys.ms("latency_ms", calibrated_ms, -1000.0..=1000.0)
}

/// Converts a driver's complaint about settings to an error at the right key.
pub(super) fn misuse(keys: &Reader<'_, '_>, error: &drivers::Error) -> FileError {
    match error {
        drivers::Error::Setting { setting, problem, .. } => match *setting {
            "stations" => keys.error("probe_station", problem),
            "stylus" => keys.error("stylus_station", problem),
            "fastest" => keys.error("fastest_counts_per_s", problem),
            // For a server's settings: names of transforms, and of the image.
            "transforms" => keys.error("probe", problem),
            "image" => keys.error("input", problem),
            setting if keys.knows(setting) => keys.error(setting, problem),
            _ => keys.error(if keys.knows("port") { "port" } else { "device" }, error.to_string()),
        },
        _ => keys.error(if keys.knows("port") { "port" } else { "device" }, error.to_string()),
    }
}
