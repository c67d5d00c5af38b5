//! Report on a tracked sequence, and on the position of its images in the world.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use glam::DVec3;
use serde::Serialize;
use serde_json::{Map, Value, json};

use config::Settings as Config;
use drivers::OpenSettings;
use drivers::replay::SequenceSettings;
use formats::Limits;
use formats::image::About;
use sonoweave_core::ledger::Ledger;
use sonoweave_core::reading::{Frame, NamedTransform};
use sonoweave_core::refusal::{Reason, Refusal};
use sonoweave_core::{Next, Reading};
use sync::Survey;
use sync::ingest::grey::described;
use sync::ingest::{Head, Ingest};
use sync::survey;
use sync::survey::{SurveyError, gaps};

use super::super::Failure;
use super::super::reconstruct::flags::SPACING_MM;
use super::histograms::{Histograms, word};
use super::text::{Text, bytes, count, short, times};
use super::volume::scalar_name;

/// Field of the whole file that is meaningless for a sequence, which contains no volume.
const ANATOMY: &str = "AnatomicalOrientation";

/// A sequence's content.
#[derive(Debug, Serialize)]
pub(super) struct SequenceReport {
    path: PathBuf,
    bytes: u64,
    /// Frames, or tracker samples.
    items: u64,
    /// `None` when the file has no images.
    picture: Option<Picture>,
    /// The written orientation; empty if not given.
    orientation: String,
    image_type: String,
    /// Images by their status.
    image_status: BTreeMap<String, u64>,
    /// `None` when no frame has a time.
    time: Option<Times>,
    frame_numbers: Option<FrameNumbers>,
    transforms: Vec<TransformCount>,
    /// Further fields of frames: the number of frames that have them.
    frame_fields: BTreeMap<String, u64>,
    /// Further fields of the file.
    header_fields: Vec<(String, String)>,
    placement: Placement,
    histograms: Histograms,
}

#[derive(Debug, Serialize)]
struct Picture {
    /// Pixels as stored: first axis, second axis.
    size: [u32; 2],
    scalar: String,
    channels: u32,
    format: &'static str,
    encoding: &'static str,
    compressed: bool,
    big_endian: bool,
}

/// The source's times, s.
#[derive(Debug, Serialize)]
struct Times {
    first_s: f64,
    last_s: f64,
    duration_s: f64,
    /// Intervals over duration; `None` without a duration.
    rate_hz: Option<f64>,
    interval_s: Option<Spread>,
    /// Frames whose time is not after that of the previous frame.
    not_ascending: u64,
    /// Frames without a time.
    untimed: u64,
    /// Frames that also have the time before the source's filtering.
    unfiltered: u64,
}

/// Distribution of numbers.
#[derive(Debug, Serialize)]
struct Spread {
    min: f64,
    median: f64,
    mean: f64,
    p90: f64,
    max: f64,
    sd: f64,
}

impl Spread {
    /// Returns `None` without samples.
    fn of(mut samples: Vec<f64>) -> Option<Self> {
        samples.sort_by(f64::total_cmp);
        let n = samples.len() as f64;
        let rank = |q: f64| samples.get((q * (n - 1.0)).round() as usize).copied();
        let mean = samples.iter().sum::<f64>() / n;
        let variance = samples.iter().map(|s| (s - mean) * (s - mean)).sum::<f64>() / n;
        Some(Self { min: rank(0.0)?, median: rank(0.5)?, mean, p90: rank(0.9)?, max: rank(1.0)?, sd: variance.sqrt() })
    }
}

/// The source's running numbers.
#[derive(Debug, Serialize)]
struct FrameNumbers {
    first: u64,
    last: u64,
    /// Numbers between neighbouring frames that no frame has.
    skipped: u64,
}

/// A transform, with counts of its status.
#[derive(Debug, Serialize)]
struct TransformCount {
    name: String,
    /// Frames by status.
    status: BTreeMap<String, u64>,
}

/// Placement of the images, as `reconstruct` determines it.
#[derive(Debug, Default, Serialize)]
struct Placement {
    /// The transforms from the image to the world.
    route: Option<String>,
    world: Option<String>,
    /// Reason why there is none.
    problem: Option<String>,
    /// Pixel size along u and v, mm.
    pixel_mm: Option<[f64; 2]>,
    /// Path length of the image's centre from frame to frame, mm.
    sweep_mm: Option<f64>,
    /// Distance of neighbouring slices, mm: see [`gaps`].
    gap_mm: Option<Spread>,
    /// Corners of the box around all images, world mm.
    bounds_mm: Option<[[f64; 3]; 2]>,
    /// Expected outcomes of the frames, as far as the header shows them.
    #[serde(flatten)]
    ledger: Ledger,
    /// Notes from the configuration's reader.
    notes: Vec<String>,
}

impl SequenceReport {
    pub(super) fn read(path: &Path, config: Config, world: Option<&str>) -> Result<Self, Failure> {
        let settings = OpenSettings::Sequence(SequenceSettings { images: false, ..SequenceSettings::new(path) });
        let mut device = drivers::open(&settings)?;
        let description = device.describe().clone();
        let mut walk = Walk::default();
        device.start()?;
        loop {
            match device.next(sonoweave_core::NO_DEADLINE)? {
                Next::Reading(Reading::Frame(frame)) => walk.frame(frame),
                Next::Reading(Reading::NamedTransform(transform)) => walk.transform(&transform),
                Next::Reading(_) | Next::Pending => {}
                Next::End => break,
            }
        }
        device.stop()?;
        let options = config.pairing_options(world);
        let spacing = config.spacing_mm.map_or(SPACING_MM, |mm| DVec3::from_array(mm).max_element());
        let (placement, poses) = match survey(device.as_mut(), &options, None) {
            Ok(survey) => (Placement::of(&survey, config.notes), survey.poses),
            Err(SurveyError::NoPath(problem)) => {
                (Placement::none(problem.to_string(), walk.ledger, config.notes), Vec::new())
            }
            Err(SurveyError::Device(error)) => return Err(error.into()),
        };
        let about = About::read(path, &Limits::default())?;
        let mut status = BTreeMap::new();
        for (word, count) in walk.transforms.iter().flat_map(|transform| &transform.status) {
            *status.entry(word.clone()).or_default() += count;
        }
        let histograms = Histograms::of_sequence(&walk.times, &poses, &gaps(&poses), spacing, status);
        let picture = description.image_size.zip(description.pixel).map(|(size, (pixel, channels))| Picture {
            size,
            scalar: scalar_name(pixel),
            channels,
            format: about.format,
            encoding: about.encoding,
            compressed: about.compressed,
            big_endian: about.big_endian,
        });
        Ok(Self {
            path: path.to_owned(),
            bytes: std::fs::metadata(path)?.len(),
            items: description.items.unwrap_or(walk.frames),
            picture,
            orientation: walk.orientation,
            image_type: walk.image_type,
            image_status: walk.image_status,
            time: Times::of(&walk.times, walk.frames, walk.unfiltered),
            frame_numbers: walk.numbers,
            transforms: walk.transforms,
            frame_fields: walk.fields,
            header_fields: description.fields.into_iter().filter(|(name, _)| name != ANATOMY).collect(),
            placement,
            histograms,
        })
    }

    /// Returns the facts for a side file: frames, times, devices' frames and place.
    pub(super) fn recording(&self) -> Map<String, Value> {
        let time = self.time.as_ref();
        let names: Vec<&str> = self.transforms.iter().map(|transform| transform.name.as_str()).collect();
        let facts = json!({
            "Frames": self.items,
            "ImageSize": self.picture.as_ref().map(|picture| picture.size),
            "ImageOrientation": self.orientation,
            "DurationS": time.map(|time| time.duration_s),
            "FrameRateHz": time.and_then(|time| time.rate_hz),
            "Transforms": names,
            "Route": self.placement.route,
            "World": self.placement.world,
            "PixelMm": self.placement.pixel_mm,
            "SweepMm": self.placement.sweep_mm,
            "FramesWithPose": self.placement.ledger.frames.used,
        });
        let Value::Object(mut facts) = facts else { return Map::new() };
        facts.retain(|_, value| !value.is_null());
        facts
    }

    pub(super) fn write(&self, text: &mut Text) {
        text.heading(&format!("{}: tracked sequence, {}", self.path.display(), bytes(self.bytes)));
        text.row("frames", self.items.to_string());
        match &self.picture {
            Some(Picture { size, scalar, channels: of, encoding, big_endian, .. }) => {
                let order = if *big_endian { ", big-endian" } else { "" };
                let channels = count(u64::from(*of), "channel");
                text.row("picture", format!("{} pixels, {scalar}, {channels}, {encoding}{order}", times(*size)));
                if let Some(how) = described(*of) {
                    text.row("", how);
                }
                let or_not = |text: &str| if text.is_empty() { "not given".to_owned() } else { text.to_owned() };
                text.row("orientation", or_not(&self.orientation));
                text.row("image type", or_not(&self.image_type));
            }
            None => text.row("picture", "none: tracker samples only"),
        }
        text.row("image status", counts(&self.image_status));
        match &self.time {
            Some(time) => time.write(text),
            None => text.row("time", "not given"),
        }
        if let Some(FrameNumbers { first, last, skipped }) = self.frame_numbers {
            text.row("frame numbers", format!("{first} to {last}, {skipped} skipped"));
        }
        let widest = self.transforms.iter().map(|t| t.name.chars().count()).max().unwrap_or(0);
        text.rows("transforms", self.transforms.iter().map(|t| format!("{:widest$}  {}", t.name, counts(&t.status))));
        if self.transforms.is_empty() {
            text.row("transforms", "none");
        }
        text.rows(
            "frame fields",
            self.frame_fields.iter().map(|(name, n)| format!("{name} in {}", count(*n, "frame"))),
        );
        text.rows("header fields", self.header_fields.iter().map(|(name, value)| format!("{name} = {value}")));
        self.placement.write(text);
        self.histograms.write("the sweep", text);
    }
}

/// Results of reading all of the header's entries.
#[derive(Debug, Default)]
struct Walk {
    frames: u64,
    orientation: String,
    image_type: String,
    image_status: BTreeMap<String, u64>,
    times: Vec<f64>,
    unfiltered: u64,
    numbers: Option<FrameNumbers>,
    transforms: Vec<TransformCount>,
    fields: BTreeMap<String, u64>,
    ingest: Ingest,
    /// Outcomes of the frames if none had a pose.
    ledger: Ledger,
}

impl Walk {
    fn frame(&mut self, frame: Frame) {
        self.frames += 1;
        self.ledger.arrived();
        let nowhere =
            |head: Head| Refusal::new(head.stamp.item, Reason::NoPath, "the image has no position in the world");
        self.ledger.refused(&self.ingest.head(&frame).map_or_else(|unfit| unfit, nowhere));
        *self.image_status.entry(word(&frame.status)).or_default() += 1;
        self.times.extend(frame.stamp.source_s);
        self.unfiltered += u64::from(frame.stamp.unfiltered_s.is_some());
        if let Some(number) = frame.frame_number {
            let numbers = self.numbers.get_or_insert(FrameNumbers { first: number, last: number, skipped: 0 });
            // Numbers that repeat or go back skip nothing.
            numbers.skipped = numbers.skipped.saturating_add(number.saturating_sub(numbers.last).saturating_sub(1));
            numbers.last = number;
        }
        for (name, _) in frame.fields {
            *self.fields.entry(name).or_default() += 1;
        }
        self.orientation = frame.orientation.into_owned();
        self.image_type = frame.image_type;
    }

    fn transform(&mut self, transform: &NamedTransform) {
        let name = transform.name();
        let at = self.transforms.iter().position(|known| known.name == name).unwrap_or_else(|| {
            self.transforms.push(TransformCount { name, status: BTreeMap::new() });
            self.transforms.len() - 1
        });
        *self.transforms[at].status.entry(word(&transform.status)).or_default() += 1;
    }
}

impl Times {
    fn of(times: &[f64], frames: u64, unfiltered: u64) -> Option<Self> {
        let (first, last) = (*times.first()?, *times.last()?);
        let intervals: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
        let duration = last - first;
        Some(Self {
            first_s: first,
            last_s: last,
            duration_s: duration,
            rate_hz: (duration > 0.0).then(|| intervals.len() as f64 / duration),
            not_ascending: intervals.iter().filter(|i| **i <= 0.0).count() as u64,
            interval_s: Spread::of(intervals),
            untimed: frames - times.len() as u64,
            unfiltered,
        })
    }

    fn write(&self, text: &mut Text) {
        let rate = self.rate_hz.map_or(String::new(), |hz| format!(": {} frames a second", short(hz)));
        let (first, last) = (self.first_s, self.last_s);
        text.row("time", format!("{first} s to {last} s, {} s{rate}", short(self.duration_s)));
        if let Some(Spread { min, median, max, sd, .. }) = self.interval_s {
            let [min, median, max, sd] = [min, median, max, sd].map(|s| format!("{:.1}", 1e3 * s));
            text.row("intervals", format!("median {median} ms, from {min} to {max}, standard deviation {sd}"));
        }
        if self.not_ascending > 0 {
            text.row("", format!("{} not later than the frame before", count(self.not_ascending, "frame")));
        }
        if self.untimed > 0 {
            text.row("", format!("{} without a time", count(self.untimed, "frame")));
        }
        if self.unfiltered > 0 {
            text.row("", format!("{} with the time before filtering, too", count(self.unfiltered, "frame")));
        }
    }
}

impl Placement {
    fn none(problem: String, ledger: Ledger, notes: Vec<String>) -> Self {
        Self { problem: Some(problem), ledger, notes, ..Self::default() }
    }

    fn of(survey: &Survey, notes: Vec<String>) -> Self {
        let poses = &survey.poses;
        let corners = |size: [u32; 2]| {
            let [right, bottom] = size.map(|n| f64::from(n) - 1.0);
            [[0.0, 0.0], [right, 0.0], [0.0, bottom], [right, bottom]].map(|[u, v]| DVec3::new(u, v, 0.0))
        };
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for pose in poses {
            for corner in corners(pose.size).map(|c| pose.world_from_image.point(c)) {
                (low, high) = (low.min(corner), high.max(corner));
            }
        }
        let centres: Vec<DVec3> = poses
            .iter()
            .map(|p| p.world_from_image.point(0.5 * DVec3::from_array(corners(p.size)[3].to_array())))
            .collect();
        let first = poses.first();
        Self {
            route: Some(survey.route.describe()),
            world: Some(survey.route.world().to_owned()),
            problem: None,
            pixel_mm: first.map(|p| [DVec3::X, DVec3::Y].map(|axis| p.world_from_image.vector(axis).length())),
            sweep_mm: first.map(|_| centres.windows(2).map(|pair| pair[0].distance(pair[1])).sum()),
            gap_mm: Spread::of(gaps(poses)),
            bounds_mm: first.map(|_| [low.to_array(), high.to_array()]),
            ledger: survey.ledger.clone(),
            notes,
        }
    }

    fn write(&self, text: &mut Text) {
        text.heading("in the world");
        if let Some(problem) = &self.problem {
            text.row("nowhere", problem);
        }
        if let Some(route) = &self.route {
            text.row("route", route);
        }
        if let Some(pixel) = self.pixel_mm {
            text.row("pixel", format!("{} mm", times(pixel.map(short))));
        }
        if let Some([low, high]) = self.bounds_mm {
            let size = [0, 1, 2].map(|a| short(high[a] - low[a]));
            let from = low.map(short).join(", ");
            text.row("box", format!("{} mm from {from} mm", times(size)));
        }
        if let Some(sweep) = self.sweep_mm {
            text.row("sweep", format!("{} mm along the picture's centre", short(sweep)));
        }
        if let Some(Spread { mean, p90, max, .. }) = self.gap_mm {
            let [mean, p90, max] = [mean, p90, max].map(short);
            text.row("gaps", format!("{mean} mm between slices on average; 90 % up to {p90}, the largest {max}"));
        }
        text.row("reconstruct", self.ledger.to_string());
        if self.ledger.poses_projected > 0 {
            let (n, worst) = (self.ledger.poses_projected, short(self.ledger.worst_projection));
            text.row(
                "",
                format!(
                    "{} differ from a rotation by up to {worst} and will be replaced by the nearest",
                    count(n, "pose")
                ),
            );
        }
        text.rows("notes", &self.notes);
    }
}

/// Formats counts as `94 OK, 3 INVALID`.
fn counts(status: &BTreeMap<String, u64>) -> String {
    let ok = status.get_key_value("OK").into_iter();
    let others = status.iter().filter(|(word, _)| *word != "OK");
    ok.chain(others).map(|(word, n)| format!("{n} {word}")).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spread_of_known_numbers() {
        let spread = Spread::of((1..=11).rev().map(f64::from).collect()).unwrap();
        assert_eq!((spread.min, spread.median, spread.mean, spread.p90, spread.max), (1.0, 6.0, 6.0, 10.0, 11.0));
        assert!((spread.sd - 10.0_f64.sqrt()).abs() < 1e-12);
        assert!(Spread::of(Vec::new()).is_none());
    }

    #[test]
    fn times_going_back_counted_give_no_rate() {
        let times = Times::of(&[2.0, 2.5, 2.5, 2.0], 5, 0).unwrap();
        assert_eq!((times.not_ascending, times.untimed, times.rate_hz), (2, 1, None));
        let even = Times::of(&[1.0, 1.5, 2.0], 3, 0).unwrap();
        assert_eq!((even.rate_hz, even.duration_s), (Some(2.0), 1.0));
        assert!(Times::of(&[], 3, 0).is_none());
    }

    #[test]
    fn counts_lists_ok_first() {
        let status = BTreeMap::from([("INVALID".to_owned(), 3), ("OK".to_owned(), 94), ("A".to_owned(), 1)]);
        assert_eq!(counts(&status), "94 OK, 1 A, 3 INVALID");
    }
}
