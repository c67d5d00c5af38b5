//! A session's description of itself: begin, devices, losses.

use sonoweave_core::clock::{Clock as _, Monotonic, wall_now_ns};
use sonoweave_core::{Description, Ticks, Timing};

use crate::session::names::{name_of, named_text, pixel_of, texts};
use crate::session::proto::{Fields, Malformed, Reader};
use crate::session::schema::{OWN, VERSION};

/// Protocol and settings of a device's lines.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct LineProtocol {
    /// `ea1`, `qsb`, `microscribe`, `isotrak`, `fastrak`, `liberty`, `patriot` or `viper`.
    pub protocol: String,
    /// Settings requested from the device: their names and values.
    pub settings: Vec<(String, String)>,
}

/// Both clocks at one instant, and the program that wrote the session.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct About {
    /// CLOCK_MONOTONIC, ns: the time base of the session.
    pub monotonic_ns: i64,
    /// The same instant by CLOCK_REALTIME, ns since 1970.
    pub realtime_ns: i64,
    /// The program that wrote the session, with its version.
    pub program: String,
}

impl About {
    /// Reads both clocks now.
    pub fn now(program: &str) -> Self {
        Self { monotonic_ns: Monotonic.now_ns(), realtime_ns: wall_now_ns(), program: program.to_owned() }
    }

    /// Returns the offset from session time to time since 1970, ns.
    pub fn offset_ns(&self) -> i64 {
        self.realtime_ns.saturating_sub(self.monotonic_ns)
    }

    /// Returns date and time, UTC: `2026-11-21 21:30:00`.
    pub fn utc(&self) -> String {
        let [year, month, day, hour, minute, second] = crate::session::place::utc(self.realtime_ns);
        format!("{year:04}-{month:02}-{day:02} {hour:02}:{minute:02}:{second:02}")
    }

    pub(super) fn write(&self, to: &mut Vec<u8>) {
        let mut out = Fields::to(to);
        out.fixed(1, self.monotonic_ns);
        out.fixed(2, self.realtime_ns);
        out.text(3, &self.program);
        out.uint(OWN, VERSION);
    }

    pub(super) fn read(message: &[u8]) -> Result<Self, Malformed> {
        let mut about = Self::default();
        for field in Reader(message) {
            match field? {
                (1, value) => about.monotonic_ns = value.fixed()?,
                (2, value) => about.realtime_ns = value.fixed()?,
                (3, value) => value.text()?.clone_into(&mut about.program),
                _ => {}
            }
        }
        Ok(about)
    }
}

/// A device of a session.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct RecordedDevice {
    /// Name of the device: the first part of its topics.
    pub name: String,
    /// Protocol of its lines, if their bytes are recorded.
    pub line_protocol: Option<LineProtocol>,
    /// The device's description of itself.
    pub description: Description,
}

const TICKS: [(Ticks, &str); 3] = [(Ticks::None, "none"), (Ticks::Time, "time"), (Ticks::Measurements, "measurements")];

impl RecordedDevice {
    pub(super) fn write(&self, to: &mut Vec<u8>) {
        let mut out = Fields::to(to);
        out.text(1, &self.name);
        if let Some(line_protocol) = &self.line_protocol {
            out.text(2, &line_protocol.protocol);
            texts(&mut out, 3, &line_protocol.settings);
        }
        let Description { name, items, image_size, pixel, fields, timing } = &self.description;
        out.text(4, name);
        if let Some(items) = items {
            out.uint(5, *items);
        }
        for side in image_size.iter().flatten() {
            out.uint(6, (*side).into());
        }
        if let Some((pixel, channels)) = pixel {
            out.text(7, name_of(*pixel));
            out.uint(8, (*channels).into());
        }
        texts(&mut out, 9, fields);
        let ticks = TICKS.iter().find(|(ticks, _)| *ticks == timing.ticks);
        out.text(10, ticks.map_or("", |(_, name)| name));
        if let Some(tick_hz) = timing.tick_hz {
            out.double(11, tick_hz);
        }
        if let Some(wraps_at) = timing.wraps_at {
            out.uint(12, wraps_at);
        }
        if let Some(rate_hz) = timing.rate_hz {
            out.double(13, rate_hz);
        }
        out.sint(14, timing.sampling_ns);
        out.sint(15, timing.wire_ns);
        out.uint(OWN, VERSION);
    }

    pub(super) fn read(message: &[u8]) -> Result<Self, Malformed> {
        let (mut recorded, mut line_protocol) = (Self::default(), LineProtocol::default());
        let (mut sides, mut pixel, mut timing) = (Vec::new(), (None, 0), Timing::default());
        for field in Reader(message) {
            let (number, value) = field?;
            let description = &mut recorded.description;
            match number {
                1 => value.text()?.clone_into(&mut recorded.name),
                2 => value.text()?.clone_into(&mut line_protocol.protocol),
                3 => line_protocol.settings.push(named_text(value)?),
                4 => value.text()?.clone_into(&mut description.name),
                5 => description.items = Some(value.uint()?),
                6 => sides.push(value.small()?),
                7 => pixel.0 = pixel_of(value.text()?),
                8 => pixel.1 = value.small()?,
                9 => description.fields.push(named_text(value)?),
                10 => {
                    let name = value.text()?;
                    timing.ticks = TICKS.iter().find(|(_, one)| *one == name).ok_or(Malformed)?.0;
                }
                11 => timing.tick_hz = Some(value.double()?),
                12 => timing.wraps_at = Some(value.uint()?),
                13 => timing.rate_hz = Some(value.double()?),
                14 => timing.sampling_ns = value.sint()?,
                15 => timing.wire_ns = value.sint()?,
                _ => {}
            }
        }
        recorded.line_protocol = (!line_protocol.protocol.is_empty()).then_some(line_protocol);
        let description = &mut recorded.description;
        description.image_size = <[u32; 2]>::try_from(sides).ok();
        description.pixel = pixel.0.map(|kind| (kind, pixel.1));
        description.timing = timing;
        Ok(recorded)
    }
}

/// Messages that could not be written, as recorded in the session.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Loss {
    /// Time of the first lost message, ns.
    pub from_ns: i64,
    /// Time of the last lost message, ns.
    pub until_ns: i64,
    /// Reason of the loss.
    pub why: String,
    /// Losses by topic: number of messages, and a lower bound of their bytes.
    pub lost: Vec<(String, u64, u64)>,
}

impl Loss {
    /// Returns the number of all lost messages.
    pub fn messages(&self) -> u64 {
        self.lost.iter().map(|(_, messages, _)| messages).sum()
    }

    pub(super) fn write(&self, to: &mut Vec<u8>) {
        let mut out = Fields::to(to);
        out.fixed(1, self.from_ns);
        out.fixed(2, self.until_ns);
        out.text(3, &self.why);
        for (topic, messages, bytes) in &self.lost {
            out.message(4, |out| {
                out.text(1, topic);
                out.uint(2, *messages);
                out.uint(3, *bytes);
            });
        }
        out.uint(OWN, VERSION);
    }

    pub(super) fn read(message: &[u8]) -> Result<Self, Malformed> {
        let mut loss = Self::default();
        for field in Reader(message) {
            match field? {
                (1, value) => loss.from_ns = value.fixed()?,
                (2, value) => loss.until_ns = value.fixed()?,
                (3, value) => value.text()?.clone_into(&mut loss.why),
                (4, value) => {
                    let mut lost = (String::new(), 0, 0);
                    for field in Reader(value.bytes()?) {
                        match field? {
                            (1, value) => value.text()?.clone_into(&mut lost.0),
                            (2, value) => lost.1 = value.uint()?,
                            (3, value) => lost.2 = value.uint()?,
                            _ => {}
                        }
                    }
                    loss.lost.push(lost);
                }
                _ => {}
            }
        }
        Ok(loss)
    }
}
