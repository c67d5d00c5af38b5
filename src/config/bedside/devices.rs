//! The devices of a bedside: which they are, where, and how they are to be set up.

use std::path::PathBuf;

use calibration::keys::{Entry, FileError};
use drivers::arm::microscribe::Family;
use drivers::arm::{self, ArmSettings};
use drivers::grabber::pixels::{Colour, Matrix, PixelFormat, Range};
use drivers::grabber::{GrabberSettings, Interlace, Standard};
use drivers::polhemus::{self, Model, Port, TrackerSettings};
use drivers::{Error, OpenSettings};
use serde::Serialize;

use super::reader::Reader;
use super::remote::{self, Remote};
use crate::config::values;
use crate::sync::graph::Names;

/// What stands in the place of a port or a node for a device of the virtual bedside.
pub const VIRTUAL: &str = "virtual";
/// Frame of the tracker's transmitter, or of the arm's base.
pub const TRACKER_FRAME: &str = "Tracker";
/// Frame of the sensor on the transducer, or of the arm's last link.
pub const PROBE_FRAME: &str = "Probe";
/// Frame of the sensor on the patient.
pub const REFERENCE_FRAME: &str = "Reference";
/// Frame of the stylus.
pub const STYLUS_FRAME: &str = "Stylus";

/// The eight ways that a picture can be stored.
const ORIENTATIONS: [(&str, &str); 8] =
    [("MF", "MF"), ("MN", "MN"), ("UF", "UF"), ("UN", "UN"), ("FM", "FM"), ("NM", "NM"), ("FU", "FU"), ("NU", "NU")];

/// What carries the probe.
#[derive(Debug, Clone, PartialEq)]
pub enum Tracking {
    /// A tracker's sensor is on it.
    Tracker(Tracker),
    /// An arm holds it.
    Arm(Arm),
    /// A server knows where it is.
    Remote(Remote),
}

impl Tracking {
    /// What its times lie behind its measurements beyond what its driver knows, ns.
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

    /// Whether it is one of the virtual bedside.
    pub fn is_virtual(&self) -> bool {
        match self {
            Self::Tracker(tracker) => tracker.port.is_none(),
            Self::Arm(arm) => arm.ports.is_none(),
            Self::Remote(_) => false,
        }
    }

    /// The frames between which it delivers transforms, those that it maps from first.
    pub fn names(&self) -> Vec<Names> {
        let to_tracker = |frame: &str| (frame.to_owned(), TRACKER_FRAME.to_owned());
        match self {
            Self::Tracker(tracker) => tracker.roles.all().map(|(_, frame)| to_tracker(frame)).collect(),
            Self::Arm(_) => vec![to_tracker(PROBE_FRAME)],
            Self::Remote(remote) => remote.transforms.iter().map(|(_, frame)| to_tracker(frame)).collect(),
        }
    }
}

/// Which station is what.
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
    /// The stations and the frames of their sensors.
    pub fn all(self) -> impl Iterator<Item = (u8, &'static str)> {
        let others = [(self.reference, REFERENCE_FRAME), (self.stylus, STYLUS_FRAME)];
        let others = others.into_iter().filter_map(|(station, frame)| Some((station?, frame)));
        std::iter::once((self.probe, PROBE_FRAME)).chain(others)
    }

    /// The frame of a station's sensor.
    pub fn frame(self, station: u8) -> Option<&'static str> {
        self.all().find(|(own, _)| *own == station).map(|(_, frame)| frame)
    }
}

/// A tracker.
#[derive(Debug, Clone, PartialEq)]
pub struct Tracker {
    /// Which it is.
    pub model: Model,
    /// Where; `None` for a virtual one.
    pub port: Option<Port>,
    /// How it is to be set up.
    pub settings: polhemus::Settings,
    /// What its stations are.
    pub roles: Roles,
    /// What its times lie behind its measurements beyond what the driver knows, ns.
    pub latency_ns: i64,
}

impl Tracker {
    /// What to open at a port: its own, or that of its twin.
    pub fn open_settings(&self, port: Port, keeps_raw: bool) -> OpenSettings {
        let settings = self.settings.clone();
        OpenSettings::Tracker(TrackerSettings { model: self.model, port, settings, keeps_raw })
    }

    pub(super) fn read(mut keys: Reader<'_, '_>, latency_ms: f64) -> Result<Self, FileError> {
        let models = Model::ALL.map(|model| (model.name(), model));
        let Some(model) = keys.choice_if("model", &models)? else {
            return Err(
                keys.error("model", "is missing: which tracker is it? isotrak, fastrak, liberty, patriot or viper")
            );
        };
        let baud = keys.whole_if("baud", 1200..=10_000_000)?;
        let port = keys.value_if("port", |entry| {
            let text = entry.text()?;
            if text != VIRTUAL && text != "usb" && !text.starts_with("usb:") && !text.starts_with('/') {
                return Err(entry.error(format!(
                    "\"{text}\" is no port: give a serial line's path, such as \"/dev/ttyUSB0\", or \"usb\", \"usb:SERIAL\" or \"virtual\"; `sonoweave devices` lists them"
                )));
            }
            Ok(text.to_owned())
        })?;
        let port = match port.as_deref() {
            None => {
                return Err(
                    keys.error("port", "is missing: where is the tracker? `sonoweave devices` lists what there is")
                );
            }
            Some(VIRTUAL) => None,
            Some("usb") => Some(Port::Usb(None)),
            Some(text) => Some(match text.strip_prefix("usb:") {
                Some(which) => Port::Usb(Some(which.to_owned())),
                None => Port::Serial { path: text.into(), baud },
            }),
        };
        if baud.is_some() && !matches!(port, Some(Port::Serial { .. })) {
            return Err(keys.error("baud", "is of serial lines alone; leave it out"));
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
                    format!("station {other} is another sensor's already; each sensor has a station of its own"),
                ));
            }
            stations.push(other);
        }
        stations.sort_unstable();
        let usual = polhemus::Settings::default();
        let hemisphere = keys.value("hemisphere", usual.hemisphere, |entry| match entry.as_text() {
            Some("follow") => Ok([0.0; 3]),
            Some(text) => Err(entry.error(format!("\"{text}\" is no direction; give [x, y, z] or \"follow\""))),
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

/// A kind of arm.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ArmKind {
    /// One that speaks EA1, or lines of bare numbers.
    Ea1(arm::ea1::Speech),
    /// Three QSBs.
    Qsb,
    /// A MicroScribe or an Immersion box with so many encoders.
    MicroScribe(Family, u8),
}

/// An arm. Its joints are the calibration file's.
#[derive(Debug, Clone, PartialEq)]
pub struct Arm {
    /// Which it is.
    pub kind: ArmKind,
    /// Its lines, base first: three of [`ArmKind::Qsb`], else one; `None` for a virtual one.
    pub ports: Option<Vec<PathBuf>>,
    /// How it is to be set up.
    pub settings: arm::Settings,
    /// What its times lie behind its measurements beyond what the driver knows, ns.
    pub latency_ns: i64,
}

impl Arm {
    /// Lines that it has.
    pub fn lines(&self) -> usize {
        if self.kind == ArmKind::Qsb { 3 } else { 1 }
    }

    /// Counts a turn of the encoders of its twin: those that it has to say of itself, else what such arms have.
    pub fn twin_counts_per_turn(&self) -> u32 {
        match self.kind {
            ArmKind::MicroScribe(..) => 1 << 14,
            _ => self.settings.counts_per_turn.into_iter().find(|counts| *counts > 0).unwrap_or(40_000),
        }
    }

    /// What to open at its lines: its own, or those of its twin. Lines that are not given have no name.
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
            return Err(keys.error("kind", "is missing: which arm is it? ea1, lines, qsb, microscribe or immersion"));
        };
        if keys.truth("blocks", false)? {
            if kind != ArmKind::Ea1(Lines) {
                return Err(keys.error("blocks", "is of kind = \"ea1\" alone; leave it out"));
            }
            kind = ArmKind::Ea1(Blocks);
        }
        let encoders = keys.whole_if("encoders", 2..=6)?;
        match (&mut kind, encoders.and_then(|n| u8::try_from(n).ok())) {
            (ArmKind::MicroScribe(_, own), Some(asked)) => *own = asked,
            (_, Some(_)) => {
                return Err(
                    keys.error("encoders", "is of kind = \"microscribe\" and \"immersion\" alone; leave it out")
                );
            }
            (_, None) => {}
        }
        let ports = keys.value_if("port", |entry| paths(entry, if kind == ArmKind::Qsb { 3 } else { 1 }))?;
        let Some(ports) = ports else {
            return Err(keys.error("port", "is missing: where is the arm? `sonoweave devices` lists what there is"));
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

/// One path or several; `virtual` stands alone.
fn paths(entry: &Entry<'_>, lines: usize) -> Result<Vec<String>, FileError> {
    let path = |entry: &Entry<'_>| {
        let text = entry.text()?;
        match text.starts_with('/') {
            true => Ok(text.to_owned()),
            false => Err(entry.error(format!(
                "\"{text}\" is no serial line's path; give one, such as \"/dev/ttyUSB0\", or \"virtual\"; `sonoweave devices` lists them"
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
    /// It is one of the virtual bedside; of the settings its size, rate, orientation and nothing else matter then.
    pub is_virtual: bool,
    /// Which it is, and how it is to be set up.
    pub settings: GrabberSettings,
    /// What its times lie behind its pictures, ns.
    pub latency_ns: i64,
}

impl Grabber {
    /// The size of its pictures in MF orientation, of their size as they are stored; or the other way round.
    pub fn turned(&self, [width, height]: [u32; 2]) -> [u32; 2] {
        if self.settings.orientation.starts_with(['F', 'N']) { [height, width] } else { [width, height] }
    }

    /// What to open, where it is not virtual.
    pub fn open_settings(&self) -> OpenSettings {
        remote::pictures(&self.settings).unwrap_or_else(|| OpenSettings::Grabber(self.settings.clone()))
    }

    pub(super) fn read(mut keys: Reader<'_, '_>, latency_ms: f64) -> Result<Self, FileError> {
        let Some(device) = keys.text_if("device")?.filter(|device| !device.is_empty()) else {
            return Err(
                keys.error("device", "is missing: which grabber is it? `sonoweave devices` lists what there is")
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
            return Err(keys.error("colour", "a virtual grabber shows grey pictures; leave it out"));
        }
        let grabber = Self { is_virtual, settings, latency_ns: latency(&mut keys, latency_ms)? };
        drivers::open(&grabber.open_settings()).map_err(|error| misuse(&keys, &error))?;
        Ok(grabber)
    }
}

/// A format of video by its V4L2 name; serialises as that.
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
        entry.error(format!("\"{text}\" is no format that can be read; give one of {}", all.join(", ")))
    })
}

/// The file's, or the calibration's.
pub(super) fn latency(keys: &mut Reader<'_, '_>, calibrated_ms: f64) -> Result<i64, FileError> {
    keys.ms("latency_ms", calibrated_ms, -1000.0..=1000.0)
}

/// A driver's complaint about settings, at the key that it is about. Drivers name theirs `device.setting: what is wrong`.
pub(super) fn misuse(keys: &Reader<'_, '_>, error: &Error) -> FileError {
    let sentence = error.to_string();
    let split = sentence.split_once(": ").and_then(|(name, problem)| Some((name.split_once('.')?.1, problem)));
    match split {
        Some(("stations", problem)) => keys.error("probe_station", problem),
        Some(("stylus", problem)) => keys.error("stylus_station", problem),
        Some(("fastest", problem)) => keys.error("fastest_counts_per_s", problem),
        // Of a server's settings: names of transforms, and of the image.
        Some(("transforms", problem)) => keys.error("probe", problem),
        Some(("image", problem)) => keys.error("input", problem),
        Some((setting, problem)) if keys.knows(setting) => keys.error(setting, problem),
        _ => keys.error(if keys.knows("port") { "port" } else { "device" }, sentence),
    }
}
