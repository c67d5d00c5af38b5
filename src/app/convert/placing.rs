//! Pose of each sensor of a session at the time of each frame, by the clocks, latencies and
//! rules of its replay.
//!
//! A frame waits until every sensor has a pose at or after its time; the pose is interpolated
//! between two poses ([`sync::history`]). So the slices of a converted sequence have the
//! same poses as those of the session.

use std::collections::{BTreeMap, VecDeque};
use std::path::Path;

use drivers::replay::{SessionReplay, SessionSettings};
use pipeline::session::{DeviceRole, Latencies, walk};
use sonoweave_core::{Device, Error, NO_DEADLINE, Next, Reading};
use sync::clock::{TimeFlags, Timed};
use sync::history::{PoseHistory, PoseSample, Rigid, Unavailable};
use sync::ingest::live::{Gives, Live};

/// Number of poses kept per sensor: eight seconds at 240 Hz.
const KEPT: usize = 2048;

/// Deliveries of one device of a session.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Delivered {
    /// Its name in the session.
    pub device: String,
    /// Stations that have poses, in the order of their first pose.
    pub stations: Vec<u8>,
    /// Whether there are frames.
    pub pictures: bool,
}

/// Returns the deliveries of a session's devices, in the order of their first reading.
///
/// # Errors
/// Errors of the recording.
pub fn delivered(session: &Path) -> Result<Vec<Delivered>, Error> {
    let mut replay = SessionReplay::open(&SessionSettings { images: false, ..SessionSettings::new(session) })?;
    let mut all: Vec<Delivered> = Vec::new();
    replay.start()?;
    loop {
        let reading = match replay.next(NO_DEADLINE)? {
            Next::Reading(reading) => reading,
            Next::Pending => continue,
            Next::End => break,
        };
        let station = match reading {
            Reading::Pose(pose) => Some(pose.station),
            Reading::Frame(_) => None,
            _ => continue,
        };
        let Some(source) = replay.source() else { continue };
        let at = all.iter().position(|known| known.device == *source).unwrap_or_else(|| {
            all.push(Delivered { device: source.to_owned(), ..Delivered::default() });
            all.len() - 1
        });
        match station {
            Some(station) if !all[at].stations.contains(&station) => all[at].stations.push(station),
            Some(_) => {}
            None => all[at].pictures = true,
        }
    }
    replay.stop()?;
    Ok(all)
}

/// Rules for the poses of frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Rules {
    /// Longest wait for a sensor after a frame, ns.
    pub wait_ns: i64,
    /// Longest gap between poses that are interpolated, ns.
    pub longest_gap_ns: i64,
}

impl Default for Rules {
    /// Returns the default values of a session configuration.
    fn default() -> Self {
        Self { wait_ns: 500_000_000, longest_gap_ns: 100_000_000 }
    }
}

/// A frame's time, and each sensor's pose at that time.
#[derive(Debug, Clone, PartialEq)]
pub struct Sensed {
    /// Acquisition time, host ns; `None` if its clock was lost.
    pub time_ns: Option<i64>,
    /// For each sensor: its pose in the tracker's frame, or why there is none.
    pub poses: Vec<Result<Rigid, Unavailable>>,
}

/// Sensor poses of a session.
#[derive(Debug, Clone, Default)]
pub struct Placing {
    /// For each sensor, the coordinate frames between which its pose maps.
    pub sensors: Vec<[String; 2]>,
    pictures: BTreeMap<u64, Sensed>,
}

impl Placing {
    /// Reads a session.
    ///
    /// # Errors
    /// Errors of the recording.
    pub fn read(session: &Path, roles: Vec<DeviceRole>, rules: Rules) -> Result<Self, Error> {
        let mut first_sensors = Vec::new();
        let mut sensors = Vec::new();
        for role in &roles {
            first_sensors.push(sensors.len());
            sensors.extend(role.frames.iter().cloned());
        }
        let grabs: Vec<bool> = roles.iter().map(|one| matches!(one.gives, Gives::Pictures)).collect();
        let mut waiting = Waiting::new(sensors.len(), rules);
        walk(session, false, roles, Latencies::AsRecorded, |device, live| match live {
            Live::Pose { source, sample, .. } => waiting.feel(first_sensors[device] + source, sample),
            Live::Picture { picture, timed } => waiting.see(picture.head.stamp.item, &timed),
            Live::Refused(refusal) if grabs[device] => waiting.see_nothing(refusal.item),
            _ => {}
        })?;
        Ok(Self { sensors, pictures: waiting.end() })
    }

    /// Returns the time and the poses of a frame, by its number.
    pub fn of(&self, item: u64) -> Option<&Sensed> {
        self.pictures.get(&item)
    }
}

/// Frames that wait for poses.
struct Waiting {
    rules: Rules,
    histories: Vec<PoseHistory>,
    queue: VecDeque<(u64, i64)>,
    done: BTreeMap<u64, Sensed>,
}

impl Waiting {
    fn new(sensors: usize, rules: Rules) -> Self {
        let histories = (0..sensors).map(|_| PoseHistory::new(KEPT, rules.longest_gap_ns)).collect();
        Self { rules, histories, queue: VecDeque::new(), done: BTreeMap::new() }
    }

    fn feel(&mut self, sensor: usize, sample: PoseSample) {
        self.histories[sensor].insert(sample);
        self.settle();
    }

    fn see(&mut self, item: u64, timed: &Timed) {
        if timed.flags.has(TimeFlags::LOST) {
            return self.see_nothing(item);
        }
        self.queue.push_back((item, timed.time_ns));
        self.settle();
    }

    /// Adds a frame of unknown time.
    fn see_nothing(&mut self, item: u64) {
        let poses = self.histories.iter().map(|_| Err(Unavailable::Nothing)).collect();
        self.done.insert(item, Sensed { time_ns: None, poses });
    }

    /// Resolves the frames that need not wait any longer.
    fn settle(&mut self) {
        while let Some(&(_, time_ns)) = self.queue.front() {
            let newest = self.histories.iter().map(|history| history.newest_ns().unwrap_or(i64::MIN));
            let latest = self.queue.back().map_or(time_ns, |(_, time_ns)| *time_ns);
            let passed = newest.clone().fold(latest, i64::max);
            if newest.fold(i64::MAX, i64::min) < time_ns && passed.saturating_sub(time_ns) < self.rules.wait_ns {
                return;
            }
            self.answer();
        }
    }

    fn answer(&mut self) {
        let Some((item, time_ns)) = self.queue.pop_front() else { return };
        let poses = self.histories.iter().map(|history| history.at(time_ns).map(|found| found.pose())).collect();
        self.done.insert(item, Sensed { time_ns: Some(time_ns), poses });
    }

    fn end(mut self) -> BTreeMap<u64, Sensed> {
        while !self.queue.is_empty() {
            self.answer();
        }
        self.done
    }
}

#[cfg(test)]
mod tests {
    use formats::session::{About, SessionWriter, WriterOptions};
    use glam::DVec3;
    use sonoweave_core::reading::{Frame, PixelType, Pose, Stamp, Status};
    use sonoweave_core::{Description, Timing};

    use super::*;

    const MS: i64 = 1_000_000;

    /// A session without a configuration: a sensor that moves along x, 1 mm in 10 ms. It is
    /// sampled every 10 ms, except between 200 and 350 ms; a frame comes every 33 ms.
    fn session(folder: &Path) -> std::path::PathBuf {
        let begin = 1_000 * MS;
        let path = folder.join("s.mcap");
        let about = About { monotonic_ns: begin, realtime_ns: 0, program: "a test".into() };
        let store = Box::new(std::fs::File::create(&path).unwrap());
        let mut writer = SessionWriter::on(store, &path, about, WriterOptions::new("a test")).unwrap();
        let description =
            Description { timing: Timing { rate_hz: Some(100.0), ..Timing::default() }, ..Description::default() };
        let [tracker, grabber] =
            ["a tracker", "a grabber"].map(|name| writer.device(name, None, &description, None).unwrap());
        for ms in 0..800 {
            let stamp = |item: i64| Stamp { item: item as u64, host_ns: Some(begin + ms * MS), ..Stamp::default() };
            if ms % 10 == 0 && !(200..350).contains(&ms) {
                let pose = Pose {
                    stamp: stamp(ms / 10),
                    station: 7,
                    position_cm: [0.01 * ms as f64, 0.0, 0.0],
                    quaternion_wxyz: [1.0, 0.0, 0.0, 0.0],
                    buttons: 0,
                    distortion: None,
                    code: None,
                    status: if ms == 600 { Status::Other("OUT_OF_REACH".into()) } else { Status::Ok },
                };
                writer.write(tracker, &Reading::Pose(pose), begin + ms * MS).unwrap();
            }
            if ms % 33 == 0 {
                let frame = Frame {
                    stamp: stamp(ms / 33),
                    frame_number: None,
                    status: Status::Ok,
                    size: [2, 1],
                    channels: 1,
                    pixel: PixelType::U8,
                    orientation: "MF".into(),
                    image_type: String::new(),
                    pixels: vec![1, 2].into(),
                    fields: Vec::new(),
                };
                writer.write(grabber, &Reading::Frame(frame), begin + ms * MS).unwrap();
            }
        }
        writer.finish(begin + 800 * MS).unwrap();
        path
    }

    #[test]
    fn frames_get_poses_at_their_times_or_reasons() {
        let folder = tempfile::tempdir().unwrap();
        let path = session(folder.path());
        let all = delivered(&path).unwrap();
        let named = |device: &str| Delivered { device: device.into(), ..Delivered::default() };
        assert_eq!(
            all,
            [Delivered { stations: vec![7], ..named("a tracker") }, Delivered { pictures: true, ..named("a grabber") }]
        );
        let latency_ns = 4 * MS;
        let roles = vec![
            DeviceRole {
                name: "a tracker".into(),
                gives: Gives::Stations(vec![7]),
                frames: vec![["Probe".into(), "Tracker".into()]],
                latency_ns: 0,
            },
            DeviceRole { name: "a grabber".into(), gives: Gives::Pictures, frames: Vec::new(), latency_ns },
        ];
        let placing = Placing::read(&path, roles, Rules::default()).unwrap();
        assert_eq!(placing.sensors, [["Probe".to_owned(), "Tracker".to_owned()]]);
        for item in 0..25 {
            let ms = 33.0 * item as f64 - 4.0;
            let Sensed { time_ns, poses } = placing.of(item).unwrap();
            assert_eq!(*time_ns, Some((1_000.0 + ms) as i64 * MS));
            match &poses[0] {
                Ok(rigid) => assert!((rigid.position_mm - DVec3::X * 0.1 * ms).length() < 1e-9, "{item}: {rigid:?}"),
                Err(Unavailable::Before { .. }) => assert!(ms < 0.0, "{item}"),
                Err(Unavailable::Gap { .. }) => {
                    assert!((190.0..350.0).contains(&ms), "{item}")
                }
                Err(Unavailable::Invalid { .. }) => assert!((591.0..610.0).contains(&ms), "{item}"),
                Err(why) => panic!("{item}: {why}"),
            }
            let fails = ms < 0.0 || (190.0..350.0).contains(&ms) || (591.0..610.0).contains(&ms);
            assert_eq!(poses[0].is_err(), fails, "{item}: {:?}", poses[0]);
        }
        assert_eq!(placing.of(25), None);
    }
}
