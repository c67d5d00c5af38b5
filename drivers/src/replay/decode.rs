//! Protocol of a device's lines, as stored in a session: its name and settings, from which each
//! line's decoder is created again.
//!
//! A session has the bytes of lines and the readings that the driver made of them. A replay
//! delivers the readings. They are exact whatever happened during recording (a reopened line,
//! an arm's home position set by the host), and stay the same when a decoder is improved.
//! Decoding again serves the development of decoders. It gives the same readings for a device
//! that was set up once, before the session began. Decisions of the host are not in the bytes:
//! the zeros of QSBs, a homing that an EA1 never answered, the rate used to detect a LIBERTY's
//! lost frames.

use std::collections::VecDeque;
use std::str::FromStr;

use formats::session::LineProtocol;
use sonoweave_core::reading::{Raw, Reading};

use crate::arm::microscribe::{self, Family};
use crate::arm::{self, ea1, qsb};
use crate::connection::{Protocol, number};
use crate::tracker::polhemus::{self, Line, Port, fastrak, isotrak, liberty, viper};
use crate::{Error, OpenSettings};

fn joined<T: ToString>(values: &[T]) -> String {
    values.iter().map(T::to_string).collect::<Vec<_>>().join(" ")
}

fn optional<T: ToString>(value: Option<T>) -> String {
    value.map_or_else(String::new, |value| value.to_string())
}

/// Returns the protocol for these settings; `None` for devices without lines.
pub fn line_protocol(settings: &OpenSettings) -> Option<LineProtocol> {
    match settings {
        OpenSettings::Arm(arm) => Some(arm_protocol(&arm.model, &arm.settings)),
        OpenSettings::Tracker(tracker) => {
            let (name, settings) = (tracker.model.name(), &tracker.settings);
            let line = match &tracker.port {
                Port::Serial { baud, .. } => Line::Serial(*baud),
                Port::Usb(_) => Line::Usb,
            };
            Some(tracker_protocol(name, settings, line))
        }
        _ => None,
    }
}

/// Returns the protocol of a tracker by its model name, for any way of opening it.
pub fn tracker_protocol(protocol: &str, settings: &polhemus::Settings, line: Line) -> LineProtocol {
    let polhemus::Settings { stations, hemisphere, binary, stylus, rate_hz, may_reset } = settings;
    let (line, baud) = match line {
        Line::Serial(baud) => ("serial", optional(baud)),
        Line::Usb => ("usb", String::new()),
    };
    with(
        protocol,
        [
            ("line", line.to_owned()),
            ("baud", baud),
            ("stations", joined(stations)),
            ("hemisphere", joined(hemisphere)),
            ("binary", binary.to_string()),
            ("stylus", optional(*stylus)),
            ("rate_hz", rate_hz.to_string()),
            ("may_reset", may_reset.to_string()),
        ],
    )
}

/// Returns the protocol of an arm, for any way of opening it.
pub fn arm_protocol(model: &arm::Model, settings: &arm::Settings) -> LineProtocol {
    let arm::Settings { rate_hz, fastest, counts_per_turn, baud } = settings;
    let mut all = vec![
        ("rate_hz", rate_hz.to_string()),
        ("fastest", fastest.to_string()),
        ("counts_per_turn", joined(counts_per_turn)),
        ("baud", optional(*baud)),
    ];
    let protocol = match model {
        arm::Model::Ea1 { format, .. } => {
            let format = SAMPLE_FORMATS.iter().find(|(one, _)| one == format).map_or("", |(_, name)| name);
            all.push(("speech", format.to_owned()));
            "ea1"
        }
        arm::Model::Qsb { .. } => "qsb",
        arm::Model::MicroScribe { family, encoders, .. } => {
            let family = FAMILIES.iter().find(|(one, _)| one == family).map_or("", |(_, name)| name);
            all.extend([("family", family.to_owned()), ("encoders", encoders.to_string())]);
            "microscribe"
        }
    };
    with(protocol, all)
}

fn with(protocol: &str, settings: impl IntoIterator<Item = (&'static str, String)>) -> LineProtocol {
    let settings = settings.into_iter().map(|(name, value)| (name.to_owned(), value)).collect();
    LineProtocol { protocol: protocol.to_owned(), settings }
}

/// Decoders created from a recorded protocol.
struct Decoders<'a>(&'a LineProtocol);

impl Decoders<'_> {
    fn text(&self, name: &str) -> &str {
        self.0.settings.iter().find(|(one, _)| one == name).map_or("", |(_, value)| value)
    }

    fn value<T: FromStr>(&self, name: &str) -> Result<T, Error> {
        self.text(name).trim().parse().map_err(|_| self.refused(name))
    }

    fn perhaps<T: FromStr>(&self, name: &str) -> Result<Option<T>, Error> {
        if self.text(name).is_empty() { Ok(None) } else { self.value(name).map(Some) }
    }

    fn values<T: FromStr>(&self, name: &str) -> Result<Vec<T>, Error> {
        self.text(name).split_whitespace().map(|value| value.parse().map_err(|_| self.refused(name))).collect()
    }

    fn few<T: FromStr, const N: usize>(&self, name: &str) -> Result<[T; N], Error> {
        self.values(name)?.try_into().map_err(|_| self.refused(name))
    }

    fn one_of<T: Copy>(&self, name: &str, all: &[(T, &str)]) -> Result<T, Error> {
        let text = self.text(name);
        all.iter().find(|(_, one)| *one == text).map(|(value, _)| *value).ok_or_else(|| self.refused(name))
    }

    fn refused(&self, name: &str) -> Error {
        let (setting, value) = (name.to_owned(), self.text(name).to_owned());
        Error::Recorded { protocol: self.0.protocol.clone(), setting, value }
    }

    /// Creates a decoder for each line.
    fn protocols(&self, name: &str) -> Result<Vec<Box<dyn Protocol>>, Error> {
        let tracker = || {
            Ok::<_, Error>(polhemus::Settings {
                stations: self.values("stations")?,
                hemisphere: self.few("hemisphere")?,
                binary: self.value("binary")?,
                stylus: self.perhaps("stylus")?,
                rate_hz: self.value("rate_hz")?,
                may_reset: self.value("may_reset")?,
            })
        };
        let line = || {
            Ok::<_, Error>(match self.text("line") {
                "usb" => Line::Usb,
                _ => Line::Serial(self.perhaps("baud")?),
            })
        };
        let arm = || {
            Ok::<_, Error>(arm::Settings {
                rate_hz: self.value("rate_hz")?,
                fastest: self.value("fastest")?,
                counts_per_turn: self.few("counts_per_turn")?,
                baud: self.perhaps("baud")?,
            })
        };
        fn one<P: Protocol + 'static>(protocol: P) -> Vec<Box<dyn Protocol>> {
            vec![Box::new(protocol)]
        }
        Ok(match self.0.protocol.as_str() {
            "ea1" => one(ea1::Unit::new(name, arm()?, self.one_of("speech", &SAMPLE_FORMATS)?)?),
            "qsb" => {
                let unit = |axis| Ok(Box::new(qsb::Unit::new(name, arm()?, axis, 3)?) as Box<dyn Protocol>);
                (0..3).map(unit).collect::<Result<_, Error>>()?
            }
            "microscribe" => {
                let family = self.one_of("family", &FAMILIES)?;
                one(microscribe::Unit::new(name, arm()?, family, self.value("encoders")?)?)
            }
            "isotrak" => one(isotrak::Unit::new(name, tracker()?, line()?)?),
            "fastrak" => one(fastrak::Unit::new(name, tracker()?, line()?)?),
            "liberty" | "patriot" => one(liberty::Unit::new(name, tracker()?, line()?)?),
            "viper" => one(viper::Unit::new(name, tracker()?, line()?)?),
            other => {
                let (protocol, setting) = (name.to_owned(), "protocol".to_owned());
                return Err(Error::Recorded { protocol, setting, value: other.to_owned() });
            }
        })
    }
}

const SAMPLE_FORMATS: [(ea1::SampleFormat, &str); 3] = [
    (ea1::SampleFormat::Lines, "lines"),
    (ea1::SampleFormat::Blocks, "blocks"),
    (ea1::SampleFormat::BareNumbers, "bare_numbers"),
];

const FAMILIES: [(Family, &str); 2] = [(Family::MicroScribe, "microscribe"), (Family::Box, "box")];

/// Decodes the recorded bytes of one device's lines again.
pub(super) struct Lines {
    lines: Vec<Box<dyn Protocol>>,
    /// Number of readings so far.
    items: u64,
}

impl Lines {
    pub(super) fn new(protocol: &LineProtocol, name: &str) -> Result<Self, Error> {
        let mut lines = Decoders(protocol).protocols(name)?;
        for line in &mut lines {
            line.reset();
            line.resume();
        }
        Ok(Self { lines, items: 0 })
    }

    /// Appends the readings that a piece completes.
    pub(super) fn decode(&mut self, raw: &Raw, found: &mut VecDeque<Reading>) {
        let Some(line) = self.lines.get_mut(usize::from(raw.line)) else { return };
        let before = found.len();
        line.decode(&raw.bytes, raw.stamp.host_ns.unwrap_or(0), found);
        number(found.iter_mut().skip(before), &mut self.items);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn protocol_keeps_settings_for_decoders() {
        let path = || std::path::PathBuf::from("/dev/x");
        let settings = arm::Settings { rate_hz: 60, fastest: 7_000, counts_per_turn: [1, 2, 3], baud: Some(9600) };
        for (model, lines) in [
            (arm::Model::Ea1 { path: path(), format: ea1::SampleFormat::Blocks }, 1),
            (arm::Model::Qsb { paths: [path(), path(), path()] }, 3),
            (arm::Model::MicroScribe { path: path(), family: Family::Box, encoders: 4 }, 1),
        ] {
            let arm = arm::ArmSettings { model, settings: settings.clone(), keeps_raw: true };
            let recorded = line_protocol(&OpenSettings::Arm(arm)).unwrap();
            let protocols = Decoders(&recorded).protocols("it").unwrap();
            assert_eq!(protocols.len(), lines);
            assert!(protocols[0].describe().name.contains("it"));
            for (name, _) in &recorded.settings {
                let mut wrong = recorded.clone();
                wrong.settings.retain(|(one, _)| one != name);
                wrong.settings.push((name.clone(), "nonsense".into()));
                let error = Decoders(&wrong).protocols("it").err().unwrap();
                assert!(matches!(&error, Error::Recorded { setting, .. } if setting == name), "{error}");
            }
        }
        let settings = polhemus::Settings { stations: vec![1, 2], stylus: Some(2), ..polhemus::Settings::default() };
        for model in polhemus::Model::ALL {
            let port = Port::Serial { path: path(), baud: Some(38_400) };
            let tracker = polhemus::TrackerSettings { model, port, settings: settings.clone(), keeps_raw: true };
            let recorded = line_protocol(&OpenSettings::Tracker(tracker)).unwrap();
            assert_eq!((recorded.protocol.as_str(), Decoders(&recorded).text("stations")), (model.name(), "1 2"));
            assert_eq!(Decoders(&recorded).protocols("it").unwrap().len(), 1);
        }
        assert!(line_protocol(&OpenSettings::sequence("x")).is_none());
        let unknown = LineProtocol { protocol: "telepathy".into(), settings: Vec::new() };
        let error = Decoders(&unknown).protocols("it").err().unwrap();
        assert!(matches!(error, Error::Recorded { value, .. } if value == "telepathy"));
    }
}
