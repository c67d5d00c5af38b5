//! Client of a server, for example PLUS: sends requests and converts messages to readings.
//!
//! - IMAGE of one slice becomes a [`Frame`]. Its placement is ignored, because poses and
//!   calibration place the frames. Volumes and parts of images are skipped.
//! - TRANSFORM, POSITION and each tool of a TDATA become a [`NamedTransform`], whose frames come
//!   from its name: `ProbeToTracker`.
//! - The message time is in microseconds of the server's clock ([`Stamp::ticks`]). Messages
//!   without a time only have the time of receipt.
//! - Metadata (protocol version 3) add to this: a `Status` other than `OK` marks a reading as
//!   doubtful. `FrameNumber` numbers the frames, so that missing ones are counted.
//!
//! The client reconnects to a server that sends nothing useful, and after an invalid stream.

use std::borrow::Cow;
use std::collections::VecDeque;
use std::sync::Arc;

use sonoweave_core::clock::SECOND;
use sonoweave_core::reading::{Frame, NamedTransform, Reading, Stamp, Status, split_transform_name};
use sonoweave_core::{Description, Ticks, Timing};

use super::fixed::Fixed;
use super::header::TimeStamp;
use super::image::Image;
use super::message::{Content, Message};
use super::query::{Pace, Subject};
use super::stream::{Decoder, Event, Limits};
use crate::Error;
use crate::connection::{Lost, Protocol, SetupEvent, SetupStep};

/// Time without useful data after which a server counts as silent, ns.
const PATIENCE: i64 = 5 * SECOND;
/// Ticks per second: counted in microseconds, 2⁵³ is reached in 285 years.
const TICK_HZ: f64 = 1e6;
/// Maximum number of frames missing between two; a larger step belongs to another count.
const MOST_LOST: u64 = 1000;

/// Settings of a client: the data to receive.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct RemoteSettings {
    /// Address of the server, `HOST:PORT`.
    pub address: String,
    /// Frames to receive, if any.
    pub pictures: Option<RemotePictures>,
    /// Transforms to receive, if any.
    pub transforms: Option<RemoteTransforms>,
}

/// Selection of the frames.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct RemotePictures {
    /// Device name of the image, such as `Image_Reference`; without it, the first that arrives.
    pub device: Option<String>,
    /// Directions in which the first and second axis grow, as a code of the files (`MF`); empty
    /// if unknown.
    pub orientation: &'static str,
}

/// Selection of the transforms.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct RemoteTransforms {
    /// Names, such as `ProbeToTracker`; all if empty.
    pub names: Vec<String>,
    /// Minimum time between two requested TDATA messages, ms.
    pub interval_ms: u32,
}

/// The client's state on a connection.
pub struct Client {
    settings: RemoteSettings,
    decoder: Decoder,
    broken: Option<String>,
    /// Device name of the received image, once known.
    image: Option<Fixed<20>>,
    last_number: Option<u64>,
    lost: Lost,
    trouble: String,
    description: Description,
    farewell: Vec<u8>,
}

impl Client {
    /// Creates a client with these settings.
    ///
    /// # Errors
    /// [`Error::Setting`] for an invalid address, for names that do not fit a message, and if
    /// nothing is to be received.
    pub fn new(settings: RemoteSettings) -> Result<Self, Error> {
        let refused = |setting, problem: String| Error::setting("remote", setting, problem);
        let address = &settings.address;
        let port = address.rsplit_once(':').filter(|(host, _)| !host.is_empty());
        if port.is_none_or(|(_, port)| port.parse::<u16>().is_err()) {
            let problem = format!("\"{address}\" is not an address; give HOST:PORT, such as \"127.0.0.1:18944\"");
            return Err(refused("address", problem));
        }
        if settings.pictures.is_none() && settings.transforms.is_none() {
            let problem = "neither pictures nor transforms are requested; request one of them";
            return Err(refused("address", problem.into()));
        }
        let image = settings.pictures.as_ref().and_then(|pictures| pictures.device.as_deref());
        let image = image.map(Fixed::new).transpose().map_err(|unfit| refused("image", unfit.to_string()))?;
        for name in settings.transforms.iter().flat_map(|transforms| &transforms.names) {
            Fixed::<20>::new(name).map_err(|unfit| refused("transforms", unfit.to_string()))?;
        }
        let name = settings.address.clone();
        let farewell = match settings.transforms {
            Some(_) => question(Content::Stop(Subject::of("TDATA"))),
            None => Vec::new(),
        };
        let timing = Timing { ticks: Ticks::Time, tick_hz: Some(TICK_HZ), ..Timing::default() };
        let fields = vec![("Protocol".into(), "OpenIGTLink".into())];
        Ok(Self {
            settings,
            decoder: Decoder::new(Limits::default()),
            broken: None,
            image,
            last_number: None,
            lost: Lost::default(),
            trouble: String::new(),
            description: Description { name, fields, timing, ..Description::default() },
            farewell,
        })
    }

    fn message(&mut self, message: Message, at_ns: i64, found: &mut VecDeque<Reading>) {
        let Message { device, time, ref metadata, .. } = message;
        let micros = time.unix_ns().map(|ns| ns / 1000);
        let stamp = Stamp {
            host_ns: Some(at_ns),
            ticks: micros,
            source_s: time.unix_ns().map(|ns| ns as f64 * 1e-9),
            ..Stamp::default()
        };
        let status = match message.metadatum("Status") {
            None => Status::Ok,
            Some(word) if word == "OK" => Status::Ok,
            Some(word) => Status::Other(word.into_owned().into()),
        };
        match message.content {
            Content::Transform(matrix) => self.transform(&device, matrix.rows(), stamp, status, found),
            Content::Position(position) => self.transform(&device, position.rows(), stamp, status, found),
            Content::Tools(tools) => {
                for tool in tools {
                    self.transform(&tool.name, tool.matrix.rows(), stamp, status.clone(), found);
                }
            }
            Content::Image(ref image) => {
                let number = message.metadatum("FrameNumber").and_then(|text| text.trim().parse().ok());
                let fields = || metadata.iter().map(|datum| (datum.key.clone(), datum.value.as_text().into_owned()));
                if let Some(frame) = self.picture(device, image, stamp, status, number) {
                    found.push_back(Reading::Frame(Frame { fields: fields().collect(), ..frame }));
                }
            }
            _ => {}
        }
    }

    fn transform(
        &self,
        name: &Fixed<20>,
        matrix: [f64; 16],
        stamp: Stamp,
        status: Status,
        found: &mut VecDeque<Reading>,
    ) {
        let Some(requested) = &self.settings.transforms else { return };
        if !requested.names.is_empty() && !requested.names.iter().any(|requested| name == requested.as_str()) {
            return;
        }
        let (from, to) = split_transform_name(name.as_str());
        found.push_back(Reading::NamedTransform(NamedTransform { stamp, from, to, matrix, status }));
    }

    fn picture(
        &mut self,
        device: Fixed<20>,
        image: &Image,
        stamp: Stamp,
        status: Status,
        frame_number: Option<u64>,
    ) -> Option<Frame> {
        let requested = self.settings.pictures.as_ref()?;
        let [width, height, depth] = image.size;
        let is_picture = depth == 1 && image.is_whole();
        if self.image.is_none() && is_picture {
            self.image = Some(device);
        }
        if self.image != Some(device) {
            return None;
        }
        if !is_picture {
            let Image { size, part, .. } = image;
            self.trouble =
                format!("{device} is a part of {part:?} of {size:?} voxels, not a whole slice; choose another image");
            return None;
        }
        if let (Some(last), Some(number)) = (self.last_number, frame_number) {
            let left_out = number.saturating_sub(last).saturating_sub(1);
            if left_out < MOST_LOST {
                self.lost.readings += left_out;
            }
        }
        self.last_number = frame_number;
        let (size, channels) = ([width.into(), height.into()], image.channels.into());
        (self.description.image_size, self.description.pixel) = (Some(size), Some((image.pixel, channels)));
        Some(Frame {
            stamp,
            frame_number,
            status,
            size,
            channels,
            pixel: image.pixel,
            orientation: Cow::Borrowed(requested.orientation),
            image_type: String::new(),
            pixels: Arc::clone(&image.native()),
            fields: Vec::new(),
        })
    }
}

/// Returns a request to a server, which always fits.
fn question(content: Content) -> Vec<u8> {
    Message::new(Fixed::EMPTY, TimeStamp::default(), content).bytes().unwrap_or_default()
}

impl Protocol for Client {
    fn reset(&mut self) {
        self.decoder = Decoder::new(Limits::default());
        self.broken = None;
        self.lost = Lost::default();
        self.last_number = None;
        self.trouble.clear();
        let named = self.settings.pictures.as_ref().and_then(|pictures| pictures.device.as_deref());
        self.image = named.and_then(|name| Fixed::new(name).ok());
    }

    fn resume(&mut self) {}

    /// Requests transforms; unrequested data are accepted too, as PLUS sends images without a
    /// request.
    fn next_step(&mut self, event: SetupEvent<'_>) -> SetupStep {
        match (event, &self.settings.transforms) {
            (SetupEvent::Begin, Some(RemoteTransforms { interval_ms, .. })) => {
                let pace = Pace { interval_ms: *interval_ms, frame: Fixed::EMPTY };
                SetupStep::Send(question(Content::Start(Subject::of("TDATA"), Some(pace))))
            }
            _ => SetupStep::Finish { keep: false },
        }
    }

    fn decode(&mut self, bytes: &[u8], at_ns: i64, found: &mut VecDeque<Reading>) {
        let mut events = Vec::new();
        let outcome = self.decoder.feed(bytes, &mut |event| events.push(event));
        for event in events {
            match event {
                Event::Message(message, _) => self.message(*message, at_ns, found),
                Event::Refused(why) => tracing::debug!("{}: {why}", self.settings.address),
            }
        }
        (self.lost.refused, self.lost.skipped) = (self.decoder.refused(), self.decoder.skipped());
        self.broken = outcome.err().map(|why| format!("does not send OpenIGTLink: {why}"));
    }

    fn patience_ns(&self) -> i64 {
        PATIENCE
    }

    fn broken(&self) -> Option<String> {
        self.broken.clone()
    }

    fn begins_by_opening(&self) -> bool {
        true
    }

    fn buffer_bytes(&self) -> usize {
        1 << 16
    }

    fn trouble(&self) -> &str {
        &self.trouble
    }

    fn farewell(&self) -> &[u8] {
        &self.farewell
    }

    fn lost(&self) -> Lost {
        self.lost
    }

    fn describe(&self) -> &Description {
        &self.description
    }
}
