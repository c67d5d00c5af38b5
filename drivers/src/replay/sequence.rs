//! Replays a sequence file: for each item its transforms, then its frame, all with the same
//! stamp.

use std::fs::File;
use std::io::{BufReader, Seek, SeekFrom};
use std::path::PathBuf;
use std::sync::Arc;

use formats::Error as FileError;
use formats::image;
use formats::image::layout::{Layout, ListAxis};
use formats::image::sequence::{Item, Sequence};
use formats::image::stream::PixelStream;
use sonoweave_core::health::{Health, State as Well};
use sonoweave_core::pool::Pool;
use sonoweave_core::reading::{Frame, NamedTransform, Reading, Stamp};
use sonoweave_core::{Description, Device, Error, Next, Timing};

use crate::replay::{Pacer, Progress, SequenceSettings};

/// A sequence file as a device. Without a pace it delivers on demand: `next` never waits and
/// never returns [`Next::Pending`].
///
/// Memory: the header, and one frame for each that the consumer holds (at least one).
pub struct Replay {
    /// File of the pixels, which may differ from the header's.
    data_path: PathBuf,
    images: bool,
    only: Option<Arc<[u64]>>,
    progress: Progress,
    /// Kept open, so that a file replaced during replay does not combine its pixels with the
    /// old header.
    file: File,
    layout: Layout,
    sequence: Sequence,
    description: Description,
    pool: Pool,
    state: State,
    pacer: Pacer,
    health: Health,
}

/// Source of the frames' pixels.
enum Pixels {
    /// Not requested, or not present.
    None,
    Stream(Box<PixelStream<BufReader<File>>>),
    /// All frames in memory, because none is complete before the last byte is read.
    Held(Vec<u8>),
}

enum State {
    Stopped,
    Running {
        item: u64,
        /// Number of transforms of the item already delivered.
        given: usize,
        pixels: Pixels,
    },
    Ended,
    Failed,
}

impl Replay {
    /// Opens the file and reads its whole header, so that header errors appear before the first
    /// reading.
    ///
    /// # Errors
    /// The errors of [`image::open_sequence`].
    pub fn open(settings: &SequenceSettings) -> Result<Self, crate::Error> {
        let path = settings.path.clone();
        let image::Opened { reader, data_path, header: sequence, layout } =
            image::open_sequence(&path, &settings.limits)?;
        let description = Description {
            name: path.display().to_string(),
            items: Some(layout.layers),
            image_size: layout.has_images().then_some(layout.size),
            pixel: layout.has_images().then_some((layout.pixel, layout.channels)),
            fields: sequence.fields.clone(),
            timing: Timing::default(),
        };
        Ok(Self {
            data_path,
            images: settings.images,
            only: settings.only.clone(),
            progress: settings.progress.clone(),
            file: reader.into_inner(),
            pool: Pool::new(layout.layer_bytes),
            layout,
            sequence,
            description,
            state: State::Stopped,
            pacer: Pacer::new(settings.pace),
            health: Health::default(),
        })
    }

    fn begin(&mut self) -> Result<(), Error> {
        let mut pixels = Pixels::None;
        if self.images && self.layout.has_images() {
            let path = &self.data_path;
            let failed = |source| FileError::Io { path: path.clone(), doing: "going to the first frame", source };
            let mut file = self.file.try_clone().map_err(failed)?;
            file.seek(SeekFrom::Start(self.layout.data_at)).map_err(failed)?;
            let reader = BufReader::with_capacity(image::BUFFER, file);
            pixels = match self.layout.list {
                ListAxis::Last => Pixels::Stream(Box::new(PixelStream::new(reader, path, &self.layout))),
                ListAxis::First => {
                    Pixels::Held(image::transposed::frames(reader, path, &self.layout, self.progress.0.as_ref())?)
                }
            };
        }
        self.state = State::Running { item: 0, given: 0, pixels };
        Ok(())
    }

    fn advance(&mut self, deadline_ns: i64) -> Result<Next, Error> {
        let State::Running { item: index, given, pixels } = &mut self.state else {
            return match self.state {
                State::Ended => Ok(Next::End),
                State::Failed => Err(Error::Failed(self.description.name.clone())),
                _ => Err(Error::Stopped(self.description.name.clone())),
            };
        };
        if let Some(only) = self.only.as_ref().filter(|_| *given == 0) {
            let next = only.get(only.partition_point(|item| item < index)).copied();
            let next = next.filter(|next| *next < self.layout.layers);
            if let (Some(next), Pixels::Stream(stream)) = (next, &mut *pixels) {
                stream.skip(next - *index, self.layout.layer_bytes)?;
            }
            *index = next.unwrap_or(self.layout.layers);
        }
        if *index == self.layout.layers {
            self.state = State::Ended;
            return Ok(Next::End);
        }
        let item = self.sequence.item(*index);
        if *given == 0 && !self.pacer.is_due(item.source_s.map(|s| (s * 1e9) as i64), deadline_ns) {
            return Ok(Next::Pending);
        }
        let stamp = Stamp {
            item: *index,
            host_ns: None,
            ticks: None,
            source_s: item.source_s,
            unfiltered_s: item.unfiltered_s,
        };
        if let Some(transform) = item.transforms.get(*given) {
            *given += 1;
            let (from, to) = &self.sequence.transforms[transform.name as usize];
            return Ok(Next::Reading(Reading::NamedTransform(NamedTransform {
                stamp,
                from: from.clone(),
                to: to.clone(),
                matrix: transform.matrix,
                status: transform.status.clone(),
            })));
        }
        let pixels = match pixels {
            Pixels::None => Arc::default(),
            Pixels::Stream(stream) => self.pool.fill(|pixels| stream.read(pixels))?,
            Pixels::Held(all) => {
                let bytes = self.layout.layer_bytes;
                Arc::from(&all[*index as usize * bytes..][..bytes])
            }
        };
        (*index, *given) = (*index + 1, 0);
        Ok(Next::Reading(Reading::Frame(frame(&self.sequence, &self.layout, item, stamp, pixels))))
    }
}

fn frame(sequence: &Sequence, layout: &Layout, item: &Item, stamp: Stamp, pixels: Arc<[u8]>) -> Frame {
    let named = |(name, text): &(u32, Box<str>)| (sequence.names[*name as usize].to_string(), text.to_string());
    Frame {
        stamp,
        frame_number: item.frame_number,
        status: item.image.clone(),
        size: layout.size,
        channels: layout.channels,
        pixel: layout.pixel,
        orientation: sequence.orientation.clone().into(),
        image_type: sequence.image_type.clone(),
        pixels,
        fields: item.fields.iter().map(named).collect(),
    }
}

impl Device for Replay {
    fn start(&mut self) -> Result<(), Error> {
        if matches!(self.state, State::Running { .. }) {
            return Err(Error::Running(self.description.name.clone()));
        }
        self.begin()?;
        self.pacer.rewind();
        self.health.enter(Well::Running, "", 0);
        Ok(())
    }

    fn next(&mut self, deadline_ns: i64) -> Result<Next, Error> {
        let next = self.advance(deadline_ns);
        match &next {
            Ok(Next::Reading(reading)) => {
                self.health.received.readings += 1;
                if let Reading::Frame(frame) = reading {
                    self.health.received.bytes += frame.pixels.len() as u64;
                }
            }
            Ok(Next::Pending) => {}
            Ok(Next::End) => self.health.enter(Well::Ended, "", 0),
            Err(error) if matches!(self.state, State::Running { .. }) => {
                self.health.enter(Well::Ended, &error.to_string(), 0);
                self.state = State::Failed;
            }
            Err(_) => {}
        }
        next
    }

    fn stop(&mut self) -> Result<(), Error> {
        self.state = State::Stopped;
        self.health.enter(Well::Stopped, "", 0);
        Ok(())
    }

    fn describe(&self) -> &Description {
        &self.description
    }

    fn health(&self) -> &Health {
        &self.health
    }
}
