//! Report on a session: its devices, their message rates, and losses with their reasons.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::Serialize;

use formats::Limits;
use formats::session::{About, Damage, Ending, Event, Maker, Message, RecordedDevice, SessionReader};
use sonoweave_core::Reading;

use super::super::Failure;
use super::histograms::{StreamReport, Streams};
use super::text::{Text, bytes, count, short, times};

/// Notes on a session's settings and software, shown with their text.
const SHOWN: [&str; 3] = ["version", "settings", "calibration"];
/// Characters of a note's text that are shown; the JSON form has all.
const SHOWN_CHARACTERS: usize = 2000;

/// A session's content.
#[derive(Debug, Default, Serialize)]
pub(in crate::cli) struct SessionReport {
    path: PathBuf,
    bytes: u64,
    /// The program that wrote it.
    program: String,
    /// Its start, UTC; empty if its beginning is lost.
    began: String,
    /// Offset to add to the session's times for time since 1970, ns.
    realtime_offset_ns: i64,
    /// From its first message to its last, s.
    duration_s: f64,
    /// Whether it was ended regularly.
    finished: bool,
    devices: Vec<DeviceReport>,
    topics: Vec<Topic>,
    /// Histograms of the sweep, one entry for each stream of frames and each sensor.
    histograms: Vec<StreamReport>,
    /// The daemon's notes, counted by kind.
    notes: BTreeMap<String, u64>,
    /// Notes on its settings and software: kind and text, the last of each.
    shown: BTreeMap<String, String>,
    losses: Vec<LossReport>,
    damage: Vec<DamageReport>,
}

#[derive(Debug, Serialize)]
struct DeviceReport {
    name: String,
    /// Name of the source, as the device gives it.
    source: String,
    /// Protocol of its lines.
    protocol: Option<String>,
    settings: Vec<(String, String)>,
    fields: Vec<(String, String)>,
    /// Size of its images, pixels.
    image_size: Option<[u32; 2]>,
}

#[derive(Debug, Default, Serialize)]
struct Topic {
    topic: String,
    schema: String,
    messages: u64,
    /// Messages that were written or lost, by their numbers, and are not there.
    missing: u64,
    bytes: u64,
    /// Messages a second, by their own stamps; `None` without a duration.
    rate_hz: Option<f64>,
    /// Longest time between two of them, s.
    longest_gap_s: f64,
    #[serde(skip)]
    span_ns: Option<[i64; 2]>,
    #[serde(skip)]
    gap_ns: i64,
}

impl Topic {
    fn add(&mut self, message: &Message<'_>) {
        self.bytes += message.bytes.len() as u64;
        let at_ns = message.stamp_ns();
        let [first_ns, last_ns] = self.span_ns.unwrap_or([at_ns; 2]);
        self.gap_ns = self.gap_ns.max(at_ns.saturating_sub(last_ns));
        self.span_ns = Some([first_ns.min(at_ns), last_ns.max(at_ns)]);
    }

    fn finish(&mut self) {
        let duration_s = self.span_ns.map_or(0.0, |[first, last]| seconds(last.saturating_sub(first)));
        let intervals = self.messages.saturating_sub(1);
        self.rate_hz = (duration_s > 0.0 && intervals > 0).then(|| intervals as f64 / duration_s);
        self.longest_gap_s = seconds(self.gap_ns);
    }
}

#[derive(Debug, Serialize)]
struct LossReport {
    /// Since the session began, s.
    from_s: f64,
    until_s: f64,
    why: String,
    messages: u64,
}

#[derive(Debug, Serialize)]
struct DamageReport {
    from_byte: u64,
    until_byte: u64,
    what: &'static str,
    /// Whether messages may be missing because of it.
    is_loss: bool,
}

impl From<&Damage> for DamageReport {
    fn from(damage: &Damage) -> Self {
        let Damage { from, until, what, is_loss } = *damage;
        Self { from_byte: from, until_byte: until, what, is_loss }
    }
}

fn seconds(ns: i64) -> f64 {
    ns as f64 * 1e-9
}

impl SessionReport {
    /// Reads a session to its end.
    pub(in crate::cli) fn read(path: &Path) -> Result<Self, Failure> {
        let limits = Limits::default();
        let mut reader = SessionReader::open(path, &limits)?;
        let mut maker = Maker::new(false, limits.frame_bytes);
        let mut report = Self {
            path: path.to_owned(),
            bytes: std::fs::metadata(path).map_or(0, |file| file.len()),
            ..Self::default()
        };
        let mut topics: BTreeMap<String, Topic> = BTreeMap::new();
        let (mut span_ns, mut losses, mut streams) = (None, Vec::new(), Streams::default());
        while let Some(event) = reader.next_event()? {
            match event {
                Event::Damage(damage) => report.damage.push(DamageReport::from(&damage)),
                Event::Message(message) => {
                    let at_ns = message.log_ns();
                    span_ns = Some([span_ns.map_or(at_ns, |[first, _]: [i64; 2]| first), at_ns]);
                    losses.extend(message.loss());
                    if let Some(device) = message.device() {
                        report.add_device(device);
                    }
                    match topics.get_mut(&message.channel.topic) {
                        Some(topic) => topic.add(&message),
                        None => topics.entry(message.channel.topic.clone()).or_default().add(&message),
                    }
                    if message.is_frame() {
                        streams.frame(&message.channel.topic, message.stamp_ns());
                        continue;
                    }
                    match maker.read(&message) {
                        Ok(Some(Reading::Recorded(note))) => {
                            *report.notes.entry(note.topic.clone()).or_default() += 1;
                            if SHOWN.contains(&note.topic.as_str()) {
                                report.shown.insert(note.topic, note.text);
                            }
                        }
                        Ok(Some(reading)) => streams.reading(&message.channel.topic, message.stamp_ns(), &reading),
                        Ok(None) | Err(_) => {}
                    }
                }
            }
        }
        report.histograms = streams.finish();
        report.finished = reader.ending() == Some(Ending::Finished);
        report.begin(reader.about());
        for channel in reader.channels() {
            let mut topic = topics.remove(&channel.topic).unwrap_or_default();
            (topic.topic, topic.schema) = (channel.topic.clone(), channel.schema.clone());
            (topic.messages, topic.missing) = (channel.messages, channel.missing);
            topic.finish();
            report.topics.push(topic);
        }
        let [first_ns, last_ns] = span_ns.unwrap_or_default();
        report.duration_s = seconds(last_ns.saturating_sub(first_ns));
        let since = |ns: i64| seconds(ns.saturating_sub(first_ns));
        report.losses = losses
            .iter()
            .map(|loss| LossReport {
                from_s: since(loss.from_ns),
                until_s: since(loss.until_ns),
                why: loss.why.clone(),
                messages: loss.messages(),
            })
            .collect();
        Ok(report)
    }

    fn begin(&mut self, about: &About) {
        if *about != About::default() {
            self.program.clone_from(&about.program);
            (self.began, self.realtime_offset_ns) = (about.utc(), about.offset_ns());
        }
    }

    /// Adds a device; its last description counts.
    fn add_device(&mut self, device: RecordedDevice) {
        let RecordedDevice { name, line_protocol, description } = device;
        let (protocol, settings) = line_protocol.map(|line| (line.protocol, line.settings)).unzip();
        let report = DeviceReport {
            name,
            source: description.name,
            protocol,
            settings: settings.unwrap_or_default(),
            fields: description.fields,
            image_size: description.image_size,
        };
        match self.devices.iter_mut().find(|known| known.name == report.name) {
            Some(known) => *known = report,
            None => self.devices.push(report),
        }
    }

    pub(in crate::cli) fn write(&self, text: &mut Text) {
        text.heading(&format!("{}: session", self.path.display()));
        if self.began.is_empty() {
            text.row("began", "not known, as its beginning is lost");
        } else {
            text.row("began", format!("{} UTC", self.began));
            text.row("written by", &self.program);
        }
        text.row("duration", format!("{} s", short(self.duration_s)));
        text.row("size", bytes(self.bytes));
        text.row(
            "end",
            if self.finished { "ended in order" } else { "broken off: all data that was not on the disk is missing" },
        );
        let notes = self.notes.iter().map(|(kind, n)| format!("{n} {kind}")).collect::<Vec<_>>().join(", ");
        if !notes.is_empty() {
            text.row("notes", notes);
        }
        for device in &self.devices {
            self.write_device(device, text);
        }
        self.histograms.iter().for_each(|stream| stream.write(text));
        if !self.losses.is_empty() || self.topics.iter().any(|topic| topic.missing > 0) || !self.damage.is_empty() {
            self.write_missing(text);
        }
        for (kind, note) in &self.shown {
            text.heading(kind);
            let (head, more) = match note.char_indices().nth(SHOWN_CHARACTERS) {
                Some((at, _)) => (&note[..at], " …"),
                None => (note.as_str(), ""),
            };
            text.row("", format!("{head}{more}"));
        }
    }

    fn write_device(&self, device: &DeviceReport, text: &mut Text) {
        text.heading(&format!("{}: {}", device.name, device.source));
        if let Some(size) = device.image_size {
            text.row("pictures", format!("{} pixels", times(size)));
        }
        if let Some(protocol) = &device.protocol {
            text.row("speaks", protocol);
        }
        let own = format!("/{}/", device.name);
        for topic in &self.topics {
            let Some(name) = topic.topic.strip_prefix(&own).filter(|name| *name != "about") else { continue };
            let rate = topic.rate_hz.map_or_else(String::new, |rate| format!(", {} Hz", short(rate)));
            let gap = if topic.longest_gap_s > 0.0 {
                format!(", {} s between two at most", short(topic.longest_gap_s))
            } else {
                String::new()
            };
            text.row(name, format!("{}{rate}{gap}; {}", topic.messages, bytes(topic.bytes)));
        }
        text.rows("fields", device.fields.iter().map(|(name, value)| format!("{name} = {value}")));
        text.rows("settings", device.settings.iter().map(|(name, value)| format!("{name} = {value}")));
    }

    fn write_missing(&self, text: &mut Text) {
        text.heading("missing");
        let missing = self.topics.iter().filter(|topic| topic.missing > 0);
        text.rows("messages", missing.map(|topic| format!("{} of {}", topic.missing, topic.topic)));
        text.rows(
            "lost",
            self.losses.iter().map(|loss| {
                let (from, until) = (short(loss.from_s), short(loss.until_s));
                format!("{} from {from} to {until} s: {}", count(loss.messages, "message"), loss.why)
            }),
        );
        text.rows(
            "damage",
            self.damage.iter().map(|part| format!("bytes {} to {}: {}", part.from_byte, part.until_byte, part.what)),
        );
        if !self.finished || self.damage.iter().any(|part| part.is_loss) {
            text.row("", "`sonoweave repair` writes a complete session from the remaining data");
        }
    }
}
