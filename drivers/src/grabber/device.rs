//! A grabber that recovers: it is opened, set up and read, and again when it disappears, breaks,
//! falls silent or gets another source.
//!
//! Every fault has the same remedy: the stream ends, the node is closed, and both start again, at
//! once the first time and then every 200 ms. A buffer is returned only after its frame was
//! copied, and no call waits longer than its deadline.

use std::borrow::Cow;
use std::collections::VecDeque;
use std::path::Path;
use std::sync::Arc;

use sonoweave_core::clock::{Clock, MS, SECOND};
use sonoweave_core::health::{Health, State};
use sonoweave_core::pool::Pool;
use sonoweave_core::reading::{Frame, PixelType, Reading, Stamp, Status};
use sonoweave_core::{Description, Device, Error, Next, Ticks, Timing};

use super::interlace::{self, Order};
use super::list::{find, is_gone, unfit, why_not_opened};
use super::pixels::{Converter, Refusal, Rows};
use super::timing::{FrameClock, Sequence, frame_time};
use super::v4l2::buffers::{Filled, Stream};
use super::v4l2::setup::{Setup, set_up};
use super::v4l2::setup_error::SetupError;
use super::v4l2::system_calls::{Node, number};
use super::{GrabberSettings, Interlace};
use crate::transport::holder;

/// Pause between two attempts to open a device, ns: a newly connected one is found within it.
const RETRY: i64 = 200 * MS;
/// Time without a frame after which a device is set up again, ns, but at least three frames:
/// longer than a driver takes to lock.
const PATIENCE: i64 = 1500 * MS;
/// Interval of asking an input for its signal, ns: noise can look like images.
const SIGNAL: i64 = 250 * MS;

/// Warning that a driver's stamps are not used.
const RESTAMPED: &str =
    "the driver's stamps are not of the host's monotonic clock; frames have the time at which they were handed over";

/// Frames that the driver flagged, or that arrived without a signal.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Doubtful {
    /// Frames that the driver flagged as damaged; delivered with that status.
    pub damaged: u64,
    /// Frames that arrived while the input had no signal; delivered with that status.
    pub without_signal: u64,
    /// Frames stamped at their handover, because the driver's stamps are of another clock.
    pub restamped: u64,
}

/// A video device.
pub struct Grabber {
    settings: GrabberSettings,
    clock: Arc<dyn Clock>,
    stage: Stage,
    description: Description,
    health: Health,
    doubtful: Doubtful,
    sequence: Sequence,
    /// Frames delivered.
    items: u64,
    /// Converted frames that wait for the next call: the newer field.
    ready: VecDeque<Reading>,
    /// Time of the last start.
    begun_ns: i64,
}

enum Stage {
    Stopped,
    Absent { retry_ns: i64 },
    Running(Box<Running>),
}

struct Running {
    node: Arc<Node>,
    stream: Stream,
    setup: Setup,
    makers: Vec<Maker>,
    /// Time of the last frame, or of the start.
    received_ns: i64,
    signal_ns: i64,
    signal: Signal,
}

/// Converts some rows of a buffer to frames.
struct Maker {
    rows: Rows,
    converter: Converter,
    pool: Pool,
}

/// Signal of an input, as the device reports it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Signal {
    /// A signal is present, or the device cannot report it.
    Fine,
    None,
    NotLocked,
    NoPower,
}

impl Signal {
    const fn of(status: u32) -> Self {
        if status & number::INPUT_NO_POWER != 0 {
            Self::NoPower
        } else if status & number::INPUT_NO_SIGNAL != 0 {
            Self::None
        } else if status & number::INPUT_NO_LOCK != 0 {
            Self::NotLocked
        } else {
            Self::Fine
        }
    }

    const fn why(self) -> &'static str {
        match self {
            Self::Fine => "",
            Self::None => "has no signal at its input; check the cable and that the scanner's output is on",
            Self::NotLocked => "cannot lock to the signal at its input; check the cable and the video standard",
            Self::NoPower => "has an input without power; check its supply",
        }
    }
}

impl Grabber {
    /// Creates a stopped grabber without touching a device.
    ///
    /// # Errors
    /// [`crate::Error::Setting`] if no device is named or the number of buffers is invalid.
    pub fn new(settings: GrabberSettings, clock: Arc<dyn Clock>) -> Result<Self, crate::Error> {
        let refused = |setting, problem: &str| Err(crate::Error::setting("grabber", setting, problem));
        if settings.device.is_empty() {
            return refused("device", "the name is empty; give a device, such as /dev/video0");
        }
        if !(2..=32).contains(&settings.buffers) {
            return refused("buffers", "a stream must have 2 to 32");
        }
        let description = Description { name: settings.device.clone(), ..Description::default() };
        Ok(Self {
            settings,
            clock,
            stage: Stage::Stopped,
            description,
            health: Health::default(),
            doubtful: Doubtful::default(),
            sequence: Sequence::default(),
            items: 0,
            ready: VecDeque::with_capacity(2),
            begun_ns: 0,
        })
    }

    /// Returns the counts of unreliable frames.
    pub const fn doubtful(&self) -> Doubtful {
        self.doubtful
    }

    fn open(&mut self, now_ns: i64) -> Result<Running, SetupError> {
        let path =
            find(&self.settings.device).ok_or_else(|| SetupError::Unusable("is not there; plug it in".into()))?;
        let unopened = |error| SetupError::Unusable(why_not_opened(&error));
        let node = Arc::new(Node::open(&path).map_err(unopened)?);
        self.health.received.opened += 1;
        let identity = node.identity().map_err(unopened)?;
        if let Some(why) = unfit(&identity) {
            return Err(SetupError::Unusable(format!("cannot be used: {why}")));
        }
        let setup = set_up(&node, &self.settings).map_err(|trouble| match trouble {
            SetupError::Refused { source, .. } if is_gone(&source) => unopened(source),
            SetupError::Refused { doing, source } if source.kind() == std::io::ErrorKind::ResourceBusy => {
                SetupError::Unusable(format!("{} ({doing}: {source})", in_use(&path)))
            }
            other => other,
        })?;
        if let Some(input) = setup.input {
            // Few drivers support this; the others fall silent and are then set up again.
            let _ = node.subscribe_source_change(input);
        }
        let mut makers = Vec::with_capacity(4);
        for order in [setup.order(setup.field), Order::Progressive] {
            let (parts, count) = interlace::parts(order, self.settings.interlace, false);
            for part in &parts[..count] {
                maker(&mut makers, &setup, part.rows, &self.settings)?;
            }
        }
        let stream = Stream::start(Arc::clone(&node), self.settings.buffers).map_err(|error| match error.kind() {
            std::io::ErrorKind::ResourceBusy => SetupError::Unusable(in_use(&path)),
            _ => SetupError::Unusable(format!("does not stream: {error}")),
        })?;
        self.health.received.set_up += 1;
        self.sequence.restart();
        self.describe_setup(&identity.card, &identity.driver, &setup, &makers);
        Ok(Running { node, stream, setup, makers, received_ns: now_ns, signal_ns: i64::MIN, signal: Signal::Fine })
    }

    fn describe_setup(&mut self, card: &str, driver: &str, setup: &Setup, makers: &[Maker]) {
        let layout = setup.layout;
        let [width, height] = layout.size;
        let converter = makers.first().map(|maker| &maker.converter);
        let channels = if converter.is_some_and(|c| c.colour().channels() == 3) { 3 } else { 1 };
        let order = setup.order(setup.field);
        // Both fields of a frame are delivered as frames; so is each single field.
        let pictures = match (order, self.settings.interlace) {
            (Order::Frame { .. }, Interlace::BothFields) => 2.0,
            _ => 1.0,
        };
        let mut fields = vec![
            ("Card".into(), card.to_owned()),
            ("Driver".into(), driver.to_owned()),
            ("VideoFormat".into(), layout.format.to_string()),
            ("VideoSize".into(), format!("{width}×{height}")),
            ("VideoRange".into(), format!("{:?}", layout.range).to_lowercase()),
            ("VideoMatrix".into(), format!("{:?}", layout.matrix).to_lowercase()),
        ];
        if self.doubtful.restamped > 0 {
            fields.push(("FrameClock".into(), RESTAMPED.into()));
        }
        if order != Order::Progressive {
            fields.push(("Interlaced".into(), format!("{:?}", self.settings.interlace).to_lowercase()));
        }
        self.description = Description {
            name: self.settings.device.clone(),
            items: None,
            image_size: converter.map(Converter::size),
            pixel: Some((PixelType::U8, channels)),
            fields,
            timing: Timing {
                ticks: Ticks::Measurements,
                tick_hz: setup.rate_hz,
                wraps_at: Some(1 << 32),
                rate_hz: setup.rate_hz.map(|rate| rate * pictures),
                sampling_ns: 0,
                wire_ns: 0,
            },
        };
    }

    /// Closes the device and schedules a new start: at once if it had run for a while, else after
    /// a pause.
    fn again(&mut self, state: State, why: &str, now_ns: i64) {
        self.stage = Stage::Stopped;
        let retry_ns = if now_ns - self.begun_ns > RETRY && state != State::Absent { now_ns } else { now_ns + RETRY };
        self.stage = Stage::Absent { retry_ns };
        self.note(state, why, now_ns);
    }

    fn note(&mut self, state: State, why: &str, now_ns: i64) {
        if why.is_empty() {
            self.health.enter(state, "", now_ns);
        } else {
            let sentence = format!("{} {why}", self.settings.device);
            if self.health.why != sentence {
                tracing::warn!("{sentence}");
            }
            self.health.enter(state, &sentence, now_ns);
        }
    }

    /// Waits for the next event of a running device, and handles it.
    fn run(&mut self, now_ns: i64, deadline_ns: i64) {
        let Stage::Running(running) = &mut self.stage else { return };
        let three_frames = running.setup.rate_hz.map_or(0, |rate| (3.0 * SECOND as f64 / rate) as i64);
        let silent_ns = running.received_ns + PATIENCE.max(three_frames);
        if now_ns >= silent_ns {
            let signal = running.check_signal(now_ns);
            let why = if signal == Signal::Fine { "delivers no frames; it is set up again" } else { signal.why() };
            return self.again(State::Silent, why, now_ns);
        }
        let ready = match running.node.wait(silent_ns.min(deadline_ns) - now_ns) {
            Ok(ready) => ready,
            Err(error) => return self.again(State::Absent, &why_not_opened(&error), now_ns),
        };
        if ready.event && matches!(running.node.event(), Ok(true)) {
            return self.again(State::Starting, "has changed its video source; it is set up again", now_ns);
        }
        if ready.buffer || ready.trouble {
            self.read_frame(ready.trouble);
        }
    }

    fn read_frame(&mut self, trouble: bool) {
        let now_ns = self.clock.now_ns();
        let Stage::Running(running) = &mut self.stage else { return };
        let signal = running.check_signal(now_ns);
        let restamped = self.doubtful.restamped;
        let Running { stream, setup, makers, .. } = &mut **running;
        let mut pictures = Pictures {
            settings: &self.settings,
            setup,
            makers,
            signal,
            now_ns,
            sequence: &mut self.sequence,
            items: &mut self.items,
            ready: &mut self.ready,
            health: &mut self.health,
            doubtful: &mut self.doubtful,
        };
        match stream.read(|filled, bytes| pictures.make(filled, bytes)) {
            Ok(Some(outcome)) => {
                running.received_ns = now_ns;
                if restamped == 0 && self.doubtful.restamped > 0 {
                    tracing::warn!("{}: {RESTAMPED}", self.settings.device);
                    self.description.fields.push(("FrameClock".into(), RESTAMPED.into()));
                }
                match outcome {
                    Ok(()) => self.note(State::Running, signal.why(), now_ns),
                    Err(refusal) => self.note(State::Running, &format!("sent an invalid frame: {refusal}"), now_ns),
                }
            }
            // Waiting again would return at once, forever.
            Ok(None) if trouble => self.again(State::Starting, "ended its stream; it is restarted", now_ns),
            Ok(None) => {}
            Err(error) if is_gone(&error) => self.again(State::Absent, "was unplugged; plug it in", now_ns),
            Err(error) => {
                self.again(State::Starting, &format!("ended its stream ({error}); it is restarted"), now_ns);
            }
        }
    }
}

/// Returns the error text for a node that another program uses.
fn in_use(path: &Path) -> String {
    match holder(path) {
        Some(who) => format!("is in use by another program, {who}; close that program"),
        None => "is in use by another program; close that program".into(),
    }
}

fn maker<'a>(
    makers: &'a mut Vec<Maker>,
    setup: &Setup,
    rows: Rows,
    settings: &GrabberSettings,
) -> Result<&'a mut Maker, Refusal> {
    let at = match makers.iter().position(|maker| maker.rows == rows) {
        Some(at) => at,
        None => {
            let converter = Converter::new(setup.layout, rows, settings.colour)?;
            let pool = Pool::new(converter.picture_bytes());
            makers.push(Maker { rows, converter, pool });
            makers.len() - 1
        }
    };
    Ok(&mut makers[at])
}

impl Running {
    /// Asks the input for its signal, unless it was asked recently.
    fn check_signal(&mut self, now_ns: i64) -> Signal {
        if let Some(input) = self.setup.input
            && now_ns.saturating_sub(self.signal_ns) >= SIGNAL
        {
            self.signal_ns = now_ns;
            self.signal = self.node.input_status(input).map_or(Signal::Fine, Signal::of);
        }
        self.signal
    }
}

/// Converts a buffer to readings, with the parts of the grabber that this needs.
struct Pictures<'a> {
    settings: &'a GrabberSettings,
    setup: &'a Setup,
    makers: &'a mut Vec<Maker>,
    signal: Signal,
    now_ns: i64,
    sequence: &'a mut Sequence,
    items: &'a mut u64,
    ready: &'a mut VecDeque<Reading>,
    health: &'a mut Health,
    doubtful: &'a mut Doubtful,
}

impl Pictures<'_> {
    fn make(&mut self, filled: &Filled, bytes: &[u8]) -> Result<(), Refusal> {
        let received = &mut self.health.received;
        received.bytes += bytes.len() as u64;
        let order = self.setup.order(filled.field);
        let (number, lost) = self.sequence.count(filled.sequence, matches!(order, Order::Single(_)));
        received.lost += lost;
        let monotonic = filled.flags & number::FLAG_CLOCK == number::FLAG_CLOCK_MONOTONIC;
        let (time_ns, clock) = frame_time(filled.stamp_ns, monotonic, self.now_ns);
        self.doubtful.restamped += u64::from(clock == FrameClock::Handover);
        let status = if filled.flags & number::FLAG_ERROR != 0 {
            self.doubtful.damaged += 1;
            Status::Other("ERROR".into())
        } else if self.signal != Signal::Fine {
            self.doubtful.without_signal += 1;
            Status::Other("NO SIGNAL".into())
        } else {
            Status::Ok
        };
        let at_start = filled.flags & number::FLAG_INSTANT == number::FLAG_INSTANT_START;
        let (parts, count) = interlace::parts(order, self.settings.interlace, at_start);
        // If the driver does not report its rate, both fields have the frame's time.
        let quarter_ns = self.setup.rate_hz.map_or(0, |rate| (SECOND as f64 / (4.0 * rate)).round() as i64);
        for (nth, part) in (0_u64..).zip(&parts[..count]) {
            let made = maker(self.makers, self.setup, part.rows, self.settings).and_then(|maker| {
                let Maker { converter, pool, .. } = maker;
                let pixels = pool.fill(|out| converter.convert(bytes, out))?;
                Ok((pixels, converter.size(), converter.colour()))
            });
            let (pixels, size, colour) = made.inspect_err(|_| self.health.received.refused += 1)?;
            let stamp = Stamp {
                item: *self.items,
                host_ns: Some(time_ns + part.quarters * quarter_ns),
                ticks: Some(filled.sequence.into()),
                source_s: None,
                unfiltered_s: None,
            };
            *self.items += 1;
            self.ready.push_back(Reading::Frame(Frame {
                stamp,
                frame_number: Some(self.number(order, number, nth)),
                status: status.clone(),
                size,
                channels: if colour.channels() == 3 { 3 } else { 1 },
                pixel: PixelType::U8,
                orientation: Cow::Borrowed(self.settings.orientation),
                image_type: String::new(),
                pixels,
                fields: Vec::new(),
            }));
        }
        Ok(())
    }

    /// Returns the frame number; fields have their own numbers if both are delivered.
    const fn number(&self, order: Order, frame: u64, nth: u64) -> u64 {
        match (order, self.settings.interlace) {
            (Order::Frame { .. }, Interlace::BothFields) => 2 * frame + nth,
            _ => frame,
        }
    }
}

impl Device for Grabber {
    fn start(&mut self) -> Result<(), Error> {
        if !matches!(self.stage, Stage::Stopped) {
            return Err(Error::Running(self.settings.device.clone()));
        }
        let now_ns = self.clock.now_ns();
        self.stage = Stage::Absent { retry_ns: now_ns };
        self.health.enter(State::Absent, "not opened yet", now_ns);
        Ok(())
    }

    fn next(&mut self, deadline_ns: i64) -> Result<Next, Error> {
        loop {
            if let Some(reading) = self.ready.pop_front() {
                self.health.received.readings += 1;
                return Ok(Next::Reading(reading));
            }
            let now_ns = self.clock.now_ns();
            if now_ns >= deadline_ns {
                return Ok(Next::Pending);
            }
            match &self.stage {
                Stage::Stopped => return Err(Error::Stopped(self.settings.device.clone())),
                Stage::Absent { retry_ns } if now_ns < *retry_ns => {
                    self.clock.wait_until((*retry_ns).min(deadline_ns));
                }
                Stage::Absent { .. } => {
                    self.begun_ns = now_ns;
                    match self.open(now_ns) {
                        Ok(running) => {
                            self.stage = Stage::Running(Box::new(running));
                            // A silent device stays silent until its first frame.
                            if self.health.state != State::Silent {
                                self.note(State::Starting, "", now_ns);
                            }
                        }
                        Err(trouble) => self.again(State::Absent, &trouble.to_string(), now_ns),
                    }
                }
                Stage::Running(_) => self.run(now_ns, deadline_ns),
            }
        }
    }

    fn stop(&mut self) -> Result<(), Error> {
        self.stage = Stage::Stopped;
        self.ready.clear();
        self.health.enter(State::Stopped, "", self.clock.now_ns());
        Ok(())
    }

    fn describe(&self) -> &Description {
        &self.description
    }

    fn health(&self) -> &Health {
        &self.health
    }
}
