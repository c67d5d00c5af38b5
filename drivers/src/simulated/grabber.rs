//! A virtual frame grabber: given images in process, with V4L2's metadata, and its faults on
//! request.
//!
//! | clock | tick | wrap | what a stamp marks |
//! |---|---|---|---|
//! | the given one, as the kernel's monotonic clock | a frame, lost ones included | 2³² | the instant of the image, later by the latency and jitter of the faults |

use std::borrow::Cow;
use std::sync::{Arc, Mutex, PoisonError};

use sonoweave_core::clock::{Clock, MS, SECOND};
use sonoweave_core::health::{Health, State};
use sonoweave_core::pool::Pool;
use sonoweave_core::reading::{Frame, PixelType, Reading, Stamp, Status};
use sonoweave_core::{Description, Device, Error, Next, Ticks, Timing};

use super::Faults;

/// Paints the image of a time (host ns) as width × height grey values, the first axis fastest.
pub type Pictures = Box<dyn FnMut(i64, &mut [u8]) + Send>;

/// Frames buffered for a late host; further ones are lost.
const BUFFERS: i64 = 6;
/// Pause between two checks of an unplugged device, ns.
const RETRY: i64 = 200 * MS;
/// Time without a frame after which it counts as silent, ns.
const PATIENCE: i64 = 500 * MS;

/// External changes to a running grabber.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Controls {
    /// It is plugged in.
    pub plugged: bool,
    /// Its input has a signal; without one, frames continue with that status.
    pub signal: bool,
    /// It is present but delivers nothing.
    pub hung: bool,
}

impl Default for Controls {
    fn default() -> Self {
        Self { plugged: true, signal: true, hung: false }
    }
}

/// The virtual grabber.
pub struct Grabber {
    pictures: Pictures,
    size: [u32; 2],
    rate_hz: f64,
    /// Orientation of its frames that it reports; none by default.
    pub orientation: &'static str,
    /// Memory of tables, and of frames that were rendered beforehand, bytes; 0 by default.
    pub prepared_bytes: u64,
    faults: Faults,
    random: fastrand::Rng,
    clock: Arc<dyn Clock>,
    controls: Arc<Mutex<Controls>>,
    pool: Pool,
    /// Start of the stream (host ns) and number of the next frame; `None` without a stream.
    stream: Option<[i64; 2]>,
    /// Arrival time of the next frame, host ns.
    due_ns: i64,
    received_ns: i64,
    running: bool,
    items: u64,
    description: Description,
    health: Health,
}

impl Grabber {
    /// Creates a grabber of images of `size`, at `rate_hz`.
    ///
    /// # Errors
    /// [`crate::Error::Setting`] for a size or a rate that no grabber has.
    pub fn new(
        pictures: Pictures,
        size: [u32; 2],
        rate_hz: f64,
        faults: Faults,
        clock: Arc<dyn Clock>,
    ) -> Result<Self, crate::Error> {
        let refused = |setting, problem: String| Err(crate::Error::setting("grabber", setting, problem));
        if size.iter().any(|side| !(1..=16_384).contains(side)) {
            return refused(
                "size",
                format!("{}×{} pixels are not possible; give sides of 1 to 16384", size[0], size[1]),
            );
        }
        if !(0.1..=1000.0).contains(&rate_hz) {
            return refused("rate_hz", format!("{rate_hz} frames a second are not possible; give 0.1 to 1000"));
        }
        let timing = Timing {
            ticks: Ticks::Measurements,
            tick_hz: Some(rate_hz),
            wraps_at: Some(1 << 32),
            rate_hz: Some(rate_hz),
            ..Timing::default()
        };
        let description = Description {
            name: "a virtual grabber".into(),
            image_size: Some(size),
            pixel: Some((PixelType::U8, 1)),
            timing,
            ..Description::default()
        };
        Ok(Self {
            pictures,
            size,
            rate_hz,
            orientation: "",
            prepared_bytes: 0,
            faults,
            random: fastrand::Rng::with_seed(faults.seed),
            clock,
            controls: Arc::default(),
            pool: Pool::new(size[0] as usize * size[1] as usize),
            stream: None,
            due_ns: 0,
            received_ns: 0,
            running: false,
            items: 0,
            description,
            health: Health::default(),
        })
    }

    /// Returns the external controls, which may be changed at any time.
    pub fn controls(&self) -> Arc<Mutex<Controls>> {
        Arc::clone(&self.controls)
    }

    /// Returns the time of a frame's image, by its number since the stream began.
    fn time_of(&self, began_ns: i64, number: i64) -> i64 {
        let second = SECOND as f64 / (1.0 + self.faults.drift_ppm * 1e-6);
        began_ns + (number as f64 / self.rate_hz * second) as i64
    }

    /// Returns the arrival time of a frame: after the latency and a random jitter. Frames stay in
    /// order.
    fn arrival(&mut self, seen_ns: i64) -> i64 {
        let jitter = if self.faults.jitter_ns > 0 { self.random.i64(0..=self.faults.jitter_ns) } else { 0 };
        (seen_ns + self.faults.latency_ns + jitter).max(self.due_ns)
    }

    fn chance(&mut self, share: f64) -> bool {
        share > 0.0 && self.random.f64() < share
    }

    /// Returns the frame that is due, or `None` if it was lost.
    fn frame(&mut self, began_ns: i64, number: i64, signal: bool) -> Option<Frame> {
        let seen_ns = self.time_of(began_ns, number);
        if self.chance(self.faults.dropout) {
            self.health.received.lost += 1;
            return None;
        }
        let status = match (signal, self.chance(self.faults.noise)) {
            (false, _) => Status::Other(Cow::Borrowed("no signal at the input")),
            (true, true) => Status::Other(Cow::Borrowed("flagged as damaged by the driver")),
            (true, false) => Status::Ok,
        };
        let Self { pictures, pool, .. } = self;
        let pixels = pool.fill(|pixels| {
            if signal {
                pictures(seen_ns, pixels)
            } else {
                pixels.fill(0)
            }
            Ok::<(), std::convert::Infallible>(())
        });
        let pixels = match pixels {
            Ok(pixels) => pixels,
            Err(never) => match never {},
        };
        // Not negative, and wraps like V4L2's number.
        let sequence = u64::from(number as u32);
        let stamp = Stamp { item: self.items, host_ns: Some(self.due_ns), ticks: Some(sequence), ..Stamp::default() };
        self.items += 1;
        self.health.received.readings += 1;
        self.health.received.bytes += pixels.len() as u64;
        Some(Frame {
            stamp,
            frame_number: Some(sequence),
            status,
            size: self.size,
            channels: 1,
            pixel: PixelType::U8,
            orientation: Cow::Borrowed(self.orientation),
            image_type: String::new(),
            pixels,
            fields: Vec::new(),
        })
    }
}

impl Device for Grabber {
    fn start(&mut self) -> Result<(), Error> {
        if self.running {
            return Err(Error::Running(self.description.name.clone()));
        }
        self.running = true;
        self.health.enter(State::Absent, "not opened yet", self.clock.now_ns());
        Ok(())
    }

    fn next(&mut self, deadline_ns: i64) -> Result<Next, Error> {
        if !self.running {
            return Err(Error::Stopped(self.description.name.clone()));
        }
        loop {
            let now_ns = self.clock.now_ns();
            let controls = *self.controls.lock().unwrap_or_else(PoisonError::into_inner);
            if !controls.plugged || controls.hung {
                self.stream = None;
                match controls.plugged {
                    false => self.health.enter(State::Absent, "the virtual grabber is unplugged; plug it in", now_ns),
                    true if now_ns >= self.received_ns + PATIENCE => {
                        self.health.enter(State::Silent, "the virtual grabber is there and delivers nothing", now_ns);
                    }
                    true => {}
                }
                if now_ns >= deadline_ns {
                    return Ok(Next::Pending);
                }
                self.clock.wait_until(deadline_ns.min(now_ns + RETRY));
                continue;
            }
            let [began_ns, number] = match self.stream {
                Some(stream) => stream,
                None => {
                    self.health.received.opened += 1;
                    self.health.received.set_up += 1;
                    self.due_ns = self.arrival(now_ns);
                    *self.stream.insert([now_ns, 0])
                }
            };
            // Only this many frames wait for a host that reads late.
            let late = ((now_ns - self.due_ns) as f64 * self.rate_hz / SECOND as f64) as i64 - BUFFERS;
            if late > 0 {
                self.health.received.lost += late.cast_unsigned();
                let seen_ns = self.time_of(began_ns, number + late);
                self.due_ns = self.arrival(seen_ns);
                self.stream = Some([began_ns, number + late]);
                continue;
            }
            if self.due_ns > deadline_ns {
                self.clock.wait_until(deadline_ns);
                return Ok(Next::Pending);
            }
            self.clock.wait_until(self.due_ns);
            let frame = self.frame(began_ns, number, controls.signal);
            self.received_ns = self.due_ns;
            let seen_ns = self.time_of(began_ns, number + 1);
            self.due_ns = self.arrival(seen_ns);
            self.stream = Some([began_ns, number + 1]);
            if let Some(frame) = frame {
                let why =
                    if controls.signal { "" } else { "the virtual grabber's input has no signal; check its cable" };
                self.health.enter(State::Running, why, self.received_ns);
                return Ok(Next::Reading(Reading::Frame(frame)));
            }
        }
    }

    fn stop(&mut self) -> Result<(), Error> {
        (self.running, self.stream) = (false, None);
        self.health.enter(State::Stopped, "", self.clock.now_ns());
        Ok(())
    }

    fn describe(&self) -> &Description {
        &self.description
    }

    fn prepared_bytes(&self) -> u64 {
        self.prepared_bytes
    }

    fn health(&self) -> &Health {
        &self.health
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sonoweave_core::clock::Manual;

    /// Each image holds its time in its first eight bytes.
    fn grabber(faults: Faults, clock: &Manual) -> Grabber {
        let pictures: Pictures = Box::new(|ns, pixels| pixels[..8].copy_from_slice(&ns.to_le_bytes()));
        let mut grabber = Grabber::new(pictures, [4, 3], 25.0, faults, Arc::new(clock.clone())).unwrap();
        grabber.start().unwrap();
        grabber
    }

    fn frames(grabber: &mut Grabber, clock: &Manual, ns: i64) -> Vec<Frame> {
        let end = clock.now_ns() + ns;
        let mut frames = Vec::new();
        while clock.now_ns() < end {
            let deadline = (clock.now_ns() + 7 * MS).min(end);
            match grabber.next(deadline).unwrap() {
                Next::Reading(Reading::Frame(frame)) => frames.push(frame),
                Next::Pending => {}
                other => panic!("{other:?}"),
            }
            assert!(clock.now_ns() <= deadline);
        }
        frames
    }

    fn captured_ns(frame: &Frame) -> i64 {
        i64::from_le_bytes(frame.pixels[..8].try_into().unwrap())
    }

    #[test]
    fn frames_arrive_at_their_times_with_kernel_numbers() {
        let clock = Manual::at(3 * SECOND);
        let faults = Faults { latency_ns: 30 * MS, jitter_ns: 4 * MS, drift_ppm: 200.0, ..Faults::default() };
        let mut grabber = grabber(faults, &clock);
        let all = frames(&mut grabber, &clock, 100 * SECOND);
        assert!((2498..=2501).contains(&all.len()), "{}", all.len());
        for (n, frame) in all.iter().enumerate() {
            assert_eq!(
                (frame.stamp.item, frame.stamp.ticks, frame.frame_number),
                (n as u64, Some(n as u64), Some(n as u64))
            );
            assert!((30 * MS..=34 * MS).contains(&(frame.stamp.host_ns.unwrap() - captured_ns(frame))));
        }
        // 200 parts per million of 100 s are 20 ms.
        let drift = captured_ns(&all[2475]) - 3 * SECOND - 99 * SECOND;
        assert!((drift + 99 * MS / 5).abs() < MS / 100, "{drift}");
        assert_eq!((grabber.health().state, grabber.health().received.lost), (State::Running, 0));
    }

    #[test]
    fn lost_damaged_and_dark_frames_are_reported() {
        let clock = Manual::at(0);
        let mut grabber = grabber(Faults { dropout: 0.1, noise: 0.05, ..Faults::default() }, &clock);
        let all = frames(&mut grabber, &clock, 80 * SECOND);
        let gaps: u64 = all.windows(2).map(|two| two[1].stamp.ticks.unwrap() - two[0].stamp.ticks.unwrap() - 1).sum();
        let received = grabber.health().received;
        assert!((150..250).contains(&gaps) && received.lost.abs_diff(gaps) < 3, "{gaps} {received:?}");
        let damaged = all.iter().filter(|frame| frame.status != Status::Ok).count();
        assert!((60..120).contains(&damaged), "{damaged}");
        grabber.controls().lock().unwrap().signal = false;
        let dark = frames(&mut grabber, &clock, SECOND);
        assert!(
            dark.len() > 15
                && dark.iter().all(|frame| matches!(&frame.status, Status::Other(why) if why.contains("signal")))
        );
        assert!(grabber.health().why.contains("signal"));
    }

    #[test]
    fn late_host_loses_frames_and_unplugging_is_noticed() {
        let clock = Manual::at(0);
        let mut grabber = grabber(Faults::default(), &clock);
        frames(&mut grabber, &clock, SECOND);
        clock.pass(2 * SECOND);
        let after = frames(&mut grabber, &clock, SECOND);
        let lost = grabber.health().received.lost;
        assert!((43..=45).contains(&lost), "{lost} of 50 that came meanwhile, six waited");
        assert!(after.windows(2).all(|two| two[1].stamp.ticks == two[0].stamp.ticks.map(|n| n + 1)));
        grabber.controls().lock().unwrap().plugged = false;
        assert!(frames(&mut grabber, &clock, SECOND).is_empty());
        assert_eq!(grabber.health().state, State::Absent);
        *grabber.controls().lock().unwrap() = Controls { hung: true, ..Controls::default() };
        frames(&mut grabber, &clock, SECOND);
        assert_eq!(grabber.health().state, State::Silent);
        *grabber.controls().lock().unwrap() = Controls::default();
        assert!(frames(&mut grabber, &clock, SECOND).len() > 15);
        assert_eq!((grabber.health().state, grabber.health().received.opened), (State::Running, 2));
        grabber.stop().unwrap();
        assert!(grabber.next(0).is_err() && grabber.start().is_ok());
        let none = Grabber::new(Box::new(|_, _| {}), [0, 4], 25.0, Faults::default(), Arc::new(clock)).err().unwrap();
        assert!(matches!(none, crate::Error::Setting { setting: "size", .. }), "{none}");
    }
}
