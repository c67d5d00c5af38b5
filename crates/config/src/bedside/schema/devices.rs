//! Sections of devices: how each is reached, and its settings.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use smart_default::SmartDefault;

use drivers::arm::Settings as ArmSettings;
use drivers::arm::ea1::SampleFormat::{self, BareNumbers, Lines};
use drivers::arm::microscribe::Family;
use drivers::grabber::pixels::{Colour, Matrix, PixelFormat, Range};
use drivers::grabber::{GrabberSettings, Interlace, Standard};
use drivers::tracker::polhemus::{Model, Settings as TrackerSettings};

use super::values::{LatencyMs, Name, Notation, TextOr, named};

/// The Polhemus tracker, if one locates the probe
#[derive(Debug, SmartDefault, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub(crate) struct Tracker {
    /// Model of the tracker
    #[schemars(extend("x-required" = true))]
    pub(crate) model: Option<Name<Model>>,
    /// Port of the tracker; `sonoweave devices` lists the connected ones
    #[schemars(extend(
        "x-takes" = "a serial line's path, \"usb\", \"usb:SERIAL\" or \"virtual\"",
        "x-required" = true
    ))]
    pub(crate) port: Option<String>,
    /// Rate of a serial line, bits a second; default: all rates of the model are tried
    #[schemars(range(min = 1200, max = 10_000_000))]
    pub(crate) baud: Option<u32>,
    /// Station of the sensor on the transducer
    #[schemars(range(min = 1, max = 16))]
    #[default(1)]
    pub(crate) probe_station: u8,
    /// Station of the sensor on the patient; the volume is then in this sensor's coordinate frame;
    /// default: none
    #[schemars(range(min = 1, max = 16))]
    pub(crate) reference_station: Option<u8>,
    /// Station of the stylus, whose button is read; default: none
    #[schemars(range(min = 1, max = 16))]
    pub(crate) stylus_station: Option<u8>,
    /// Zenith of the half space that contains all sensors, in the transmitter's frame; x is in
    /// front of the transmitter
    #[schemars(extend("x-takes" = "[x, y, z] or \"follow\""))]
    #[default(TextOr::Other(TrackerSettings::default().hemisphere))]
    pub(crate) hemisphere: TextOr<[f32; 3]>,
    /// Largest rate of each station, in readings a second
    #[schemars(range(min = 1, max = 10_000))]
    #[default(TrackerSettings::default().rate_hz)]
    pub(crate) rate_hz: f64,
    /// True for numbers in binary, which are shorter and more exact; false for numbers as text
    #[default(TrackerSettings::default().binary)]
    pub(crate) binary: bool,
    /// Permission to restart a unit that does not answer, which takes 10 to 20 s
    #[default(TrackerSettings::default().may_reset)]
    pub(crate) may_reset: bool,
    /// Noise of a sensor along and about each axis, as standard deviations, for the error of
    /// measurements; default: the calibration file's
    #[schemars(extend("x-takes" = "{ mm, deg }"))]
    pub(crate) noise: Option<Noise>,
    pub(crate) latency_ms: Option<LatencyMs>,
}

named! {
    Model: Model::ALL.map(|model| (model.name(), model));
}

/// Noise of a sensor's position and rotation.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct Noise {
    #[schemars(range(min = 0, max = 10))]
    pub(crate) mm: f64,
    #[schemars(range(min = 0, max = 10))]
    pub(crate) deg: f64,
}

/// The encoder arm, if one carries the probe
#[derive(Debug, SmartDefault, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub(crate) struct Arm {
    /// Kind of the arm: EA1 (docs/ea1.md), lines of three bare numbers, three QSBs, a MicroScribe
    /// or an Immersion box
    #[schemars(extend("x-required" = true))]
    pub(crate) kind: Option<Name<ArmKind>>,
    /// Port of the arm; with three lines, the base joint's comes first
    #[schemars(extend(
        "x-takes" = "a serial line's path, a list of three for qsb, or \"virtual\"",
        "x-required" = true
    ))]
    pub(crate) port: Option<TextOr<Vec<String>>>,
    /// Rate of its lines, bits a second; default: the usual rate of the kind
    #[schemars(range(min = 1200, max = 10_000_000))]
    pub(crate) baud: Option<u32>,
    /// For ea1 only: true for samples as blocks instead of lines
    pub(crate) blocks: bool,
    /// Number of encoders to read; default: 5 for microscribe, 4 for immersion
    #[schemars(
        range(min = 2, max = 6),
        extend("x-takes" = "5 or 6 of microscribe, 2, 4 or 6 of immersion")
    )]
    pub(crate) encoders: Option<u8>,
    /// Readings a second
    #[schemars(range(min = 1, max = 10_000))]
    #[default(ArmSettings::default().rate_hz)]
    pub(crate) rate_hz: u32,
    /// Speed that no joint reaches: a faster count means a reset or lost steps; default: 400000,
    /// for encoders of 14 bits 20000
    #[schemars(range(min = 100))]
    pub(crate) fastest_counts_per_s: Option<u32>,
    /// Counts a revolution, or a metre, that the arm must report, base joint first; 0 if unknown
    #[schemars(extend("x-takes" = "[n, n, n]"))]
    #[default(ArmSettings::default().counts_per_turn)]
    pub(crate) counts_per_turn: [u32; 3],
    pub(crate) latency_ms: Option<LatencyMs>,
}

/// Kind of an arm.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ArmKind {
    /// One with protocol EA1, or lines of bare numbers.
    Ea1(SampleFormat),
    /// Three QSBs.
    Qsb,
    /// A MicroScribe or an Immersion box with this number of encoders.
    MicroScribe(Family, u8),
}

impl ArmKind {
    /// All kinds, with their names in configurations.
    pub const NAMED: [(&str, Self); 5] = [
        ("ea1", Self::Ea1(Lines)),
        ("lines", Self::Ea1(BareNumbers)),
        ("qsb", Self::Qsb),
        ("microscribe", Self::MicroScribe(Family::MicroScribe, 5)),
        ("immersion", Self::MicroScribe(Family::Box, 4)),
    ];
}

named! {
    ArmKind: ArmKind::NAMED;
}

/// The OpenIGTLink server that sends the probe's poses, such as PLUS's, instead of a tracker
#[derive(Debug, SmartDefault, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub(crate) struct Remote {
    /// Address of the server; the usual port is 18944
    #[schemars(extend("x-takes" = "\"HOST:PORT\"", "x-required" = true))]
    pub(crate) address: Option<String>,
    /// Transform from the probe to the tracker
    #[schemars(extend("x-takes" = "a transform's name"))]
    #[default = "ProbeToTracker"]
    pub(crate) probe: String,
    /// Transform from the sensor on the patient; the volume is then in this sensor's coordinate
    /// frame; default: none
    #[schemars(extend("x-takes" = "a transform's name"))]
    pub(crate) reference: Option<String>,
    /// Transform from the stylus; default: none
    #[schemars(extend("x-takes" = "a transform's name"))]
    pub(crate) stylus: Option<String>,
    /// Shortest time between two messages, as requested from the server
    #[schemars(range(max = 1000))]
    #[default(5)]
    pub(crate) interval_ms: u32,
    /// Noise of a sensor along and about each axis, as standard deviations, for the error of
    /// measurements; default: the calibration file's
    #[schemars(extend("x-takes" = "{ mm, deg }"))]
    pub(crate) noise: Option<Noise>,
    pub(crate) latency_ms: Option<LatencyMs>,
}

/// The frame grabber at the scanner's video output
#[derive(Debug, SmartDefault, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub(crate) struct Grabber {
    /// The grabber; its name stays the same when it is plugged in again. An OpenIGTLink server
    /// supplies IMAGE messages; of the keys below, only input, orientation and latency_ms then
    /// apply
    #[schemars(extend(
        "x-takes" = "a video node, a grabber's name or place as listed, \"openigtlink:HOST:PORT\", or \"virtual\"",
        "x-required" = true
    ))]
    pub(crate) device: Option<String>,
    /// Input of a grabber with several; default: the selected one. For a server: the name of its
    /// image; default: the first slice that arrives
    #[schemars(extend("x-takes" = "a name or a number"))]
    pub(crate) input: Option<TextOr<u32>>,
    /// Analogue standard; default: the one that the grabber detects
    pub(crate) standard: Option<Name<Standard>>,
    /// Format of the video; default: the one with the lowest cost
    #[schemars(extend("x-takes" = "a V4L2 name such as YUYV"))]
    pub(crate) format: Option<Format>,
    /// Size of the video in pixels; default: the largest at full rate, for a virtual grabber
    /// 640x480
    #[schemars(extend("x-takes" = "\"WxH\" or [width, height]"))]
    pub(crate) size: Option<Notation>,
    /// Frames a second; default: the highest rate, for a virtual grabber 30
    #[schemars(range(min = 0.1, max = 1000))]
    pub(crate) rate_hz: Option<f64>,
    /// Colour of the frames; only grey frames can be inserted into a volume
    #[default(Name(Colour::Grey))]
    pub(crate) colour: Name<Colour>,
    /// Range of luma values from black to white, if the driver reports it wrongly
    pub(crate) range: Option<Name<Range>>,
    /// Matrix that luma was made with, if the driver reports it wrongly
    pub(crate) matrix: Option<Name<Matrix>>,
    /// Treatment of interlaced video
    #[default(Name(Interlace::OneField))]
    pub(crate) interlace: Name<Interlace>,
    /// Directions of the video's first and second axis: M marked side, U unmarked side, F far from
    /// the probe, N near to it
    #[default(Name(Orientation("MF")))]
    pub(crate) orientation: Name<Orientation>,
    /// Number of frames that the kernel buffers
    #[schemars(range(min = 2, max = 32))]
    #[default(GrabberSettings::new("").buffers)]
    pub(crate) buffers: u32,
    pub(crate) latency_ms: Option<LatencyMs>,
}

/// An orientation of stored images, by its two letters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Orientation(pub(crate) &'static str);

named! {
    Standard: [("ntsc", Standard::Ntsc), ("pal", Standard::Pal), ("secam", Standard::Secam)];
    Colour: [("grey", Colour::Grey), ("rgb", Colour::Rgb)];
    Range: [("limited", Range::Limited), ("full", Range::Full)];
    Matrix: [("bt601", Matrix::Bt601), ("bt709", Matrix::Bt709)];
    Interlace:
        [("one-field", Interlace::OneField), ("both-fields", Interlace::BothFields), ("whole", Interlace::Whole)];
    Orientation: ["MF", "MN", "UF", "UN", "FM", "NM", "FU", "NU"].map(|letters| (letters, Orientation(letters)));
}

/// A video format by its V4L2 name.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(try_from = "String", into = "String")]
pub(crate) struct Format(#[schemars(with = "String")] pub(crate) PixelFormat);

impl From<Format> for String {
    fn from(format: Format) -> Self {
        format.0.to_string()
    }
}

impl TryFrom<String> for Format {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        let found = PixelFormat::ALL.into_iter().find(|format| format.to_string().eq_ignore_ascii_case(&text));
        found.map(Self).ok_or_else(|| {
            let all: Vec<String> = PixelFormat::ALL.iter().map(ToString::to_string).collect();
            format!("the format \"{text}\" cannot be read; give one of {}", all.join(", "))
        })
    }
}
