//! Replays a session: the readings of its devices, in the same order, with the same stamps.

use std::collections::{HashMap, VecDeque};
use std::path::Path;

use formats::session::Maker;
use formats::session::about::RecordedDevice;
use formats::session::reader::{Ending, Event, SessionReader};
use formats::session::schema;
use formats::session::walk::Damage;
use formats::{Error as FileError, Unreadable};
use sonoweave_core::health::{Health, State};
use sonoweave_core::reading::Reading;
use sonoweave_core::{Description, Device, Error, Next};

use crate::replay::decode::Lines;
use crate::replay::{Pacer, SessionSettings};

/// A session as a device: the whole session, or one of its devices.
///
/// The whole session is delivered in recorded order; [`Self::source`] gives the device of the
/// last reading. Notes are [`Reading::Recorded`] and have no device. The replay of one device
/// delivers only its readings. Several paced replays of one session keep their relative times,
/// because each counts from the session's beginning.
///
/// Messages lost during recording are counted as lost once the end is reached. An interrupted
/// file ends at its last data, which the health reports. Damage before the end is an error: the
/// user must learn about losses before using the data.
pub struct SessionReplay {
    settings: SessionSettings,
    reader: Option<SessionReader>,
    maker: Maker,
    pacer: Pacer,
    /// Devices found so far, by number.
    devices: Vec<RecordedDevice>,
    /// Decoders of the devices whose bytes are decoded again.
    lines: HashMap<usize, Lines>,
    /// Readings of the last message, and the number of their device.
    found: VecDeque<Reading>,
    source: Option<usize>,
    /// Time at which they are due.
    due_ns: i64,
    is_due: bool,
    description: Description,
    health: Health,
}

impl SessionReplay {
    /// Opens the file, and reads the device descriptions that precede the first reading.
    ///
    /// # Errors
    /// [`FileError::Io`] when the file cannot be read, [`FileError::NoSession`] when it is no
    /// session, [`FileError::Damaged`] when it begins with damage. [`crate::Error::NoDevice`] when
    /// the requested device is not among the first descriptions.
    pub fn open(settings: &SessionSettings) -> Result<Self, crate::Error> {
        let mut replay = Self {
            maker: Maker::new(settings.images, settings.limits.frame_bytes),
            pacer: Pacer::new(settings.pace),
            settings: settings.clone(),
            reader: None,
            devices: Vec::new(),
            lines: HashMap::new(),
            found: VecDeque::new(),
            source: None,
            due_ns: 0,
            is_due: false,
            description: Description::default(),
            health: Health::default(),
        };
        replay.survey()?;
        Ok(replay)
    }

    /// Paces the replay by the given clock.
    pub fn set_clock(&mut self, clock: std::sync::Arc<dyn sonoweave_core::clock::Clock>) {
        self.pacer = Pacer::by(self.settings.pace, clock);
    }

    /// Returns the device of the last reading; `None` for a note of the session.
    pub fn source(&self) -> Option<&str> {
        self.source.map(|at| self.devices[at].name.as_str())
    }

    /// Returns the devices found so far; those announced before the first reading are present
    /// from the start.
    pub fn devices(&self) -> &[RecordedDevice] {
        &self.devices
    }

    /// Returns the time at which the last reading was handed to the writer, host ns of the
    /// recording.
    pub fn handed_over_ns(&self) -> i64 {
        self.due_ns
    }

    /// Returns the settings that the replay was opened with.
    pub fn settings(&self) -> &SessionSettings {
        &self.settings
    }

    fn path(&self) -> &Path {
        &self.settings.path
    }

    /// Reads the device descriptions before the first reading.
    fn survey(&mut self) -> Result<(), crate::Error> {
        let mut reader = SessionReader::open(&self.settings.path, &self.settings.limits)?;
        loop {
            match reader.next_event()? {
                Some(Event::Message(message)) => {
                    let schema = message.channel.schema.as_str();
                    if schema == schema::DEVICE.name {
                        let device = message.device().ok_or(Unreadable::Malformed);
                        self.meet(device.map_err(|why| unreadable(&self.settings.path, why))?);
                    } else if schema != schema::SESSION.name && schema != schema::NOTE.name {
                        break;
                    }
                }
                Some(Event::Damage(damage)) if damage.is_loss => {
                    return Err(damaged(&self.settings.path, damage).into());
                }
                Some(Event::Damage(_)) => {}
                None => break,
            }
        }
        if let Some(requested) = &self.settings.device
            && !self.devices.iter().any(|device| device.name == *requested)
        {
            let known = self.devices.iter().map(|device| device.name.clone()).collect();
            return Err(crate::Error::NoDevice { path: self.path().to_owned(), requested: requested.clone(), known });
        }
        Ok(())
    }

    /// Stores a device's description.
    fn meet(&mut self, device: RecordedDevice) {
        match self.devices.iter_mut().find(|known| known.name == device.name) {
            Some(known) => *known = device,
            None => self.devices.push(device),
        }
        self.describe_all();
    }

    fn describe_all(&mut self) {
        let one = match &self.settings.device {
            Some(requested) => self.devices.iter().find(|device| device.name == *requested),
            // The description of the whole session is that of the device with images.
            None => self.devices.iter().find(|device| device.description.image_size.is_some()),
        };
        self.description = one.map(|device| device.description.clone()).unwrap_or_default();
        if self.settings.device.is_none() {
            self.description.name = self.settings.path.display().to_string();
        }
    }

    /// Reads until there are readings, or the end.
    fn read(&mut self) -> Result<bool, Error> {
        loop {
            let Some(reader) = &mut self.reader else {
                return Err(Error::Stopped(self.path().display().to_string()));
            };
            let message = match reader.next_event()? {
                Some(Event::Message(message)) => message,
                Some(Event::Damage(damage)) => {
                    if damage.is_loss && !reaches_the_end(&self.settings.path, &damage) {
                        return Err(damaged(&self.settings.path, damage).into());
                    }
                    continue;
                }
                None => return Ok(false),
            };
            let (log_ns, channel) = (message.log_ns(), message.channel);
            let refused = |why| unreadable(&self.settings.path, why);
            if channel.schema == schema::DEVICE.name {
                let device = message.device().ok_or(Unreadable::Malformed).map_err(refused)?;
                if self.settings.device.as_ref().is_none_or(|requested| *requested == device.name) {
                    self.meet(device);
                }
                continue;
            }
            let Some(schema) = channel.known else {
                let (topic, schema) = (channel.topic.clone(), channel.schema.clone());
                return Err(FileError::UnknownMessages { path: self.settings.path.clone(), topic, schema }.into());
            };
            let name = channel.device();
            if self.settings.device.is_some() && name != self.settings.device.as_deref() {
                continue;
            }
            let source = name.and_then(|name| self.devices.iter().position(|device| device.name == name));
            let decodes = self.settings.decode && source.is_some_and(|at| self.devices[at].line_protocol.is_some());
            let is_made_of_bytes =
                [&schema::POSE_OF_STATION, &schema::COUNTS].iter().any(|one| one.name == schema.name);
            if decodes && is_made_of_bytes {
                continue;
            }
            let Some(reading) = self.maker.read(&message).map_err(refused)? else { continue };
            (self.source, self.due_ns, self.is_due) = (source, log_ns, false);
            self.decode(source.filter(|_| decodes), reading)?;
            return Ok(true);
        }
    }

    /// Delivers a reading; for raw bytes, if requested, also the readings decoded from them.
    fn decode(&mut self, source: Option<usize>, reading: Reading) -> Result<(), Error> {
        let (Some(at), Reading::Raw(raw)) = (source, &reading) else {
            self.found.push_back(reading);
            return Ok(());
        };
        let raw = raw.clone();
        self.found.push_back(reading);
        let RecordedDevice { name, line_protocol: speech, .. } = &self.devices[at];
        if let (None, Some(speech)) = (self.lines.get(&at), speech) {
            self.lines.insert(at, Lines::new(speech, name)?);
        }
        if let Some(lines) = self.lines.get_mut(&at) {
            lines.decode(&raw, &mut self.found);
        }
        Ok(())
    }

    fn end(&mut self) {
        let Some(reader) = &self.reader else { return };
        let requested = self.settings.device.as_deref();
        let channels = reader.channels();
        let own = channels.iter().filter(|channel| requested.is_none() || channel.device() == requested);
        self.health.received.lost = own.map(|channel| channel.missing).sum();
        let why = match reader.ending() {
            Some(Ending::BrokenOff) => {
                "the session was broken off while it was recorded: what was not on the disk then is missing"
            }
            _ => "",
        };
        self.health.enter(State::Ended, why, 0);
    }
}

/// Returns whether the damage extends to the end of the file: the recording was interrupted
/// there.
fn reaches_the_end(path: &Path, damage: &Damage) -> bool {
    std::fs::metadata(path).is_ok_and(|file| damage.until >= file.len())
}

fn damaged(path: &Path, damage: Damage) -> FileError {
    FileError::Damaged { path: path.to_owned(), damage }
}

fn unreadable(path: &Path, source: Unreadable) -> FileError {
    FileError::Message { path: path.to_owned(), source }
}

impl Device for SessionReplay {
    fn start(&mut self) -> Result<(), Error> {
        if self.reader.is_some() {
            return Err(Error::Running(self.path().display().to_string()));
        }
        let reader = SessionReader::open(&self.settings.path, &self.settings.limits)?;
        self.pacer.rewind();
        // Times count from the beginning of the session, for every device.
        self.pacer.is_due(Some(reader.about().monotonic_ns).filter(|ns| *ns != 0), i64::MAX);
        self.reader = Some(reader);
        self.lines.clear();
        self.found.clear();
        self.health = Health::default();
        self.health.enter(State::Running, "", 0);
        Ok(())
    }

    fn next(&mut self, deadline_ns: i64) -> Result<Next, Error> {
        if self.found.is_empty() {
            if self.reader.is_none() && self.health.state == State::Ended {
                return Err(Error::Failed(self.path().display().to_string()));
            }
            match self.read() {
                Ok(true) => {}
                Ok(false) => {
                    self.end();
                    return Ok(Next::End);
                }
                Err(error) => {
                    self.reader = None;
                    self.health.enter(State::Ended, &error.to_string(), 0);
                    return Err(error);
                }
            }
        }
        if !self.is_due && !self.pacer.is_due(Some(self.due_ns), deadline_ns) {
            return Ok(Next::Pending);
        }
        self.is_due = true;
        let Some(reading) = self.found.pop_front() else { return Ok(Next::Pending) };
        let received = &mut self.health.received;
        match &reading {
            Reading::Raw(raw) => received.bytes += raw.bytes.len() as u64,
            Reading::Frame(frame) => {
                received.readings += 1;
                received.bytes += frame.pixels.len() as u64;
            }
            _ => received.readings += 1,
        }
        Ok(Next::Reading(reading))
    }

    fn stop(&mut self) -> Result<(), Error> {
        self.reader = None;
        self.found.clear();
        self.health.enter(State::Stopped, "", 0);
        Ok(())
    }

    fn describe(&self) -> &Description {
        &self.description
    }

    fn health(&self) -> &Health {
        &self.health
    }
}
