//! Histograms of a sweep: probe speed, slice distances, frame intervals, and tracker status.

use std::collections::BTreeMap;

use glam::DVec3;
use serde::Serialize;

use sonoweave_core::Reading;
use sonoweave_core::reading::Status;
use sync::FramePose;

use super::text::{Text, short};
use crate::app::histogram::{Histogram, bars};

/// Longest gap between a sensor's samples that is interpolated, ns.
const LONGEST_NS: i64 = 100_000_000;

/// Histograms of a sweep; `None` if nothing is known.
#[derive(Debug, Default, Serialize)]
pub(super) struct Histograms {
    /// Interval between frames, ms.
    interval_ms: Option<Histogram>,
    /// Distance between frames over the time between them, mm/s.
    speed_mm_s: Option<Histogram>,
    /// Distance between neighbouring slices, mm.
    gap_mm: Option<Histogram>,
    /// The same in spacings of the volume.
    gap_voxels: Option<Histogram>,
    /// Assumed volume spacing, mm.
    spacing_mm: Option<f64>,
    /// Poses by the source's status.
    status: BTreeMap<String, u64>,
}

impl Histograms {
    /// Makes the histograms of a sequence. Takes its frames' times in s, its placed frames, the
    /// gaps between them and the volume's spacing in mm, and the counts of transform status.
    pub(super) fn of_sequence(
        times_s: &[f64],
        poses: &[FramePose],
        gaps_mm: &[f64],
        spacing_mm: f64,
        status: BTreeMap<String, u64>,
    ) -> Self {
        let intervals: Vec<f64> = times_s.windows(2).map(|pair| (pair[1] - pair[0]) * 1e3).collect();
        let centre = |pose: &FramePose| {
            let [u, v] = pose.size.map(|n| 0.5 * (f64::from(n) - 1.0));
            pose.world_from_image.point(DVec3::new(u, v, 0.0))
        };
        // A sequence without times has no speeds.
        let is_timed = !times_s.is_empty();
        let placed: Vec<(i64, DVec3)> = poses.iter().filter(|_| is_timed).map(|p| (p.time_ns, centre(p))).collect();
        Self {
            interval_ms: Histogram::positive(&intervals),
            speed_mm_s: Histogram::positive(&speeds(&placed)),
            gap_mm: Histogram::positive(gaps_mm),
            gap_voxels: Histogram::positive(&gaps_mm.iter().map(|mm| mm / spacing_mm).collect::<Vec<_>>()),
            spacing_mm: (!gaps_mm.is_empty()).then_some(spacing_mm),
            status,
        }
    }

    fn is_empty(&self) -> bool {
        let Self { interval_ms, speed_mm_s, gap_mm, status, .. } = self;
        interval_ms.is_none() && speed_mm_s.is_none() && gap_mm.is_none() && status.is_empty()
    }

    /// Writes the histograms as bars of text, below a heading; nothing if nothing is known.
    pub(super) fn write(&self, heading: &str, text: &mut Text) {
        if self.is_empty() {
            return;
        }
        text.heading(heading);
        let lines = |histogram: &Option<Histogram>| histogram.as_ref().map(Histogram::lines).unwrap_or_default();
        text.rows("intervals, ms", lines(&self.interval_ms));
        text.rows("speed, mm/s", lines(&self.speed_mm_s));
        text.rows("gaps, mm", lines(&self.gap_mm));
        if let Some(spacing) = self.spacing_mm {
            let mut rows = lines(&self.gap_voxels);
            rows.push(format!("voxels of {} mm", short(spacing)));
            text.rows("gaps, voxels", rows);
        }
        text.rows("status", bars(&self.status.iter().map(|(word, n)| (word.clone(), *n)).collect::<Vec<_>>()));
    }
}

/// Returns the speeds between places in mm/s; pairs without a later time are left out.
fn speeds(placed: &[(i64, DVec3)]) -> Vec<f64> {
    let pairs = placed.windows(2).filter(|pair| pair[1].0 > pair[0].0);
    pairs.map(|pair| pair[0].1.distance(pair[1].1) / ((pair[1].0 - pair[0].0) as f64 * 1e-9)).collect()
}

/// Returns the word for a status.
pub(super) fn word(status: &Status) -> String {
    match status {
        Status::Ok => "OK".into(),
        Status::Other(word) => word.clone().into_owned(),
    }
}

/// Collects frame times and poses from a session's messages.
#[derive(Debug, Default)]
pub(super) struct Streams {
    /// Arrival times of frames, by topic, ns.
    frames: BTreeMap<String, Vec<i64>>,
    sensors: BTreeMap<String, Sensor>,
}

/// Positions of a sensor.
#[derive(Debug, Default)]
struct Sensor {
    /// Time, ns, and position, mm, of valid poses.
    places: Vec<(i64, DVec3)>,
    status: BTreeMap<String, u64>,
}

/// Report of a session's stream.
#[derive(Debug, Serialize)]
pub(super) struct StreamReport {
    topic: String,
    #[serde(flatten)]
    histograms: Histograms,
}

impl Streams {
    /// Takes a frame.
    pub(super) fn frame(&mut self, topic: &str, at_ns: i64) {
        match self.frames.get_mut(topic) {
            Some(times) => times.push(at_ns),
            None => {
                self.frames.insert(topic.to_owned(), vec![at_ns]);
            }
        }
    }

    /// Takes a tracker's reading; others are ignored.
    pub(super) fn reading(&mut self, topic: &str, at_ns: i64, reading: &Reading) {
        let (name, place, status) = match reading {
            Reading::Pose(pose) => (topic.to_owned(), DVec3::from_array(pose.position_cm) * 10.0, &pose.status),
            Reading::NamedTransform(transform) => {
                let [.., x, _, _, _, y, _, _, _, z, _, _, _, _] = transform.matrix;
                (format!("{topic}: {}", transform.name()), DVec3::new(x, y, z), &transform.status)
            }
            _ => return,
        };
        let sensor = self.sensors.entry(name).or_default();
        *sensor.status.entry(word(status)).or_default() += 1;
        if *status == Status::Ok && place.is_finite() {
            sensor.places.push((at_ns, place));
        }
    }

    /// Returns a report for each stream: the frames' intervals, and each sensor's motion between
    /// frames of the first stream of frames.
    pub(super) fn finish(self) -> Vec<StreamReport> {
        let of_frames = |(topic, times): (&String, &Vec<i64>)| {
            let intervals: Vec<f64> = times.windows(2).map(|pair| (pair[1] - pair[0]) as f64 * 1e-6).collect();
            let histograms = Histograms { interval_ms: Histogram::positive(&intervals), ..Histograms::default() };
            StreamReport { topic: topic.clone(), histograms }
        };
        let mut reports: Vec<StreamReport> = self.frames.iter().map(of_frames).collect();
        let times = self.frames.into_values().next().unwrap_or_default();
        reports.extend(self.sensors.into_iter().map(|(topic, sensor)| {
            let placed: Vec<(i64, DVec3)> = times.iter().filter_map(|at| Some((*at, sensor.at(*at)?))).collect();
            let ways: Vec<f64> = placed.windows(2).map(|pair| pair[0].1.distance(pair[1].1)).collect();
            let histograms = Histograms {
                speed_mm_s: Histogram::positive(&speeds(&placed)),
                gap_mm: Histogram::positive(&ways),
                status: sensor.status,
                ..Histograms::default()
            };
            StreamReport { topic, histograms }
        }));
        reports
    }
}

impl Sensor {
    /// Returns the position, linearly interpolated between the neighbouring samples; `None` if
    /// they are too far apart.
    fn at(&self, at_ns: i64) -> Option<DVec3> {
        let after = self.places.partition_point(|(time, _)| *time < at_ns);
        let (later, to) = *self.places.get(after)?;
        if later == at_ns {
            return Some(to);
        }
        let (earlier, from) = *self.places.get(after.checked_sub(1)?)?;
        let part = (at_ns - earlier) as f64 / (later - earlier) as f64;
        (later - earlier <= LONGEST_NS).then(|| from.lerp(to, part))
    }
}

impl StreamReport {
    pub(super) fn write(&self, text: &mut Text) {
        self.histograms.write(&self.topic, text);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sonoweave_core::reading::{NamedTransform, Stamp};

    fn transform(x: f64, status: Status) -> Reading {
        let mut matrix = [0.0; 16];
        (matrix[3], matrix[7], matrix[11]) = (x, 2.0 * x, 2.0 * x);
        Reading::NamedTransform(NamedTransform {
            stamp: Stamp::default(),
            from: "Probe".into(),
            to: "Tracker".into(),
            matrix,
            status,
        })
    }

    #[test]
    fn sensor_motion_between_frames_is_interpolated() {
        let mut streams = Streams::default();
        for k in 0..10 {
            // 3 mm in 10 ms: 300 mm/s.
            streams.reading("/t/transform", k * 10_000_000, &transform(k as f64, Status::Ok));
        }
        streams.reading("/t/transform", 5, &transform(f64::NAN, Status::Ok));
        streams.reading("/t/transform", 5, &transform(900.0, Status::Other("MISSING".into())));
        for at in [5_000_000, 25_000_000, 45_000_000, 400_000_000] {
            streams.frame("/g/image", at);
        }
        let reports = streams.finish();
        assert_eq!(
            reports.iter().map(|r| r.topic.as_str()).collect::<Vec<_>>(),
            ["/g/image", "/t/transform: ProbeToTracker"]
        );
        let json = serde_json::to_value(&reports).unwrap();
        assert_eq!(
            json[0]["interval_ms"]["counts"].as_array().unwrap().iter().filter_map(|n| n.as_u64()).sum::<u64>(),
            3
        );
        assert_eq!(json[1]["status"], serde_json::json!({ "MISSING": 1, "OK": 11 }));
        // Two steps of 6 mm; the last frame has no samples around it.
        let total =
            |name: &str| json[1][name]["counts"].as_array().unwrap().iter().filter_map(|n| n.as_u64()).sum::<u64>();
        assert_eq!((total("speed_mm_s"), total("gap_mm")), (2, 2));
        let bin = |name: &str, value: f64| {
            let h = &json[1][name];
            let at = ((value - h["from"].as_f64().unwrap()) / h["width"].as_f64().unwrap() + 1e-9) as usize;
            h["counts"][at].as_u64().unwrap()
        };
        assert_eq!((bin("speed_mm_s", 300.0), bin("gap_mm", 6.0)), (2, 2));
    }
}
