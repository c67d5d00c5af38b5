//! `sonoweave calibrate tracker`: measures a tracker's quality on site.

use std::fmt::Write as _;

use clap::Args;
use glam::DAffine3;
use serde::Serialize;

use calibration::error::{CalibrationError, TrackerError};
use calibration::file::CalibrationFile;
use calibration::file::origin::Origin;
use calibration::tracker::distortion::{self, Map, Pair};
use calibration::tracker::noise::{self, Noise};
use calibration::tracker::zones::Zones;
use sonoweave_core::date::Date;

use super::super::{Failure, values};
use super::guide::poses::gathered;
use super::guide::{Advice, Gathering};
use super::outputs::{Input, Outputs, originates, place, print, rows};
use super::poses::{Counts, Poses, Recording, Source, poses};

/// Largest number of cells that the text lists.
const MOST_PRINTED: usize = 8;

/// Rest that determines a sensor's noise, s.
const STILL_S: f64 = 10.0;
/// Number of cells in a usual scanning room, at which the guide's progress bar is full.
const USUAL_CELLS: f64 = 200.0;

/// Flags of `calibrate tracker`.
#[derive(Debug, Args)]
#[command(after_help = "\
Noise: lay a sensor down, let go of it, and record for ten seconds. With -o the noise goes into the calibration file, \
and counts in the error of measurements.
A map of the room: fix two sensors to one piece of wood or plastic, 10 cm apart, and carry it slowly through the \
whole scanning area. Where the sensors' distance changes, metal distorts the field; do not scan there, or remove the \
metal. With -o these zones go into the calibration file, and `live` warns when the probe is in one.

Examples: sonoweave calibrate tracker --live bedside.toml -o calibration.toml
          sonoweave calibrate tracker --session SESSION.mcap --sensor Probe
          sonoweave calibrate tracker --session SESSION.mcap --sensor Probe --other Reference -o calibration.toml \
--report room.json")]
pub struct Arguments {
    #[command(flatten)]
    source: Source,
    #[command(flatten)]
    gathering: Gathering,
    /// Name of the frame of the sensor
    #[arg(long, value_name = "NAME", default_value = "Probe")]
    sensor: String,
    /// Name of the frame of a second sensor, on the same rigid piece: for a map of the room
    #[arg(long, value_name = "NAME")]
    other: Option<String>,
    /// Name of the tracker's own frame
    #[arg(long, value_name = "NAME", default_value = "Tracker")]
    tracker: String,
    /// Edge of the map's cells, mm
    #[arg(long, value_name = "MM", default_value_t = 50.0, value_parser = values::positive, requires = "other")]
    cell: f64,
    /// Warn of cells in which the sensors' distance from their nominal place is larger, mm (root
    /// mean square)
    #[arg(long, value_name = "MM", default_value_t = 1.0, value_parser = values::positive, requires = "other")]
    limit: f64,
    /// Leave out everything recorded before: seconds from the recording's beginning
    #[arg(long, value_name = "S", value_parser = values::number)]
    from: Option<f64>,
    /// Leave out everything recorded after: seconds from the recording's beginning
    #[arg(long, value_name = "S", value_parser = values::number)]
    to: Option<f64>,
    #[command(flatten)]
    outputs: Outputs,
}

/// Report on a resting sensor. The names contain the units.
#[derive(Debug, Serialize)]
struct NoiseReport<'a> {
    kind: &'static str,
    input: Input,
    sensor: &'a str,
    poses: &'a Counts,
    position_mm: [f64; 3],
    position_sd_mm: [f64; 3],
    position_rms_mm: f64,
    rotation_sd_deg: [f64; 3],
    rotation_rms_deg: f64,
    fast_rms_mm: f64,
    farthest_mm: f64,
}

/// Report on a room.
#[derive(Debug, Serialize)]
struct MapReport<'a> {
    kind: &'static str,
    input: Input,
    sensors: [&'a str; 2],
    poses: &'a Counts,
    pairs: usize,
    distance_mm: f64,
    distance_rms_mm: f64,
    /// Row major, the second sensor's pose in the first one's frame.
    one_from_other: [f64; 16],
    rms_mm: f64,
    most_mm: f64,
    rms_deg: f64,
    limit_mm: f64,
    cell_mm: f64,
    cells: Vec<CellReport>,
}

#[derive(Debug, Serialize)]
struct CellReport {
    low_mm: [f64; 3],
    pairs: usize,
    rms_mm: f64,
    most_mm: f64,
    rms_deg: f64,
    /// Beyond the limit.
    warned_of: bool,
}

/// Runs the command.
///
/// # Errors
/// [`Failure`] when the recording does not determine the result.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let recording = arguments.recording(&arguments.tracker);
    arguments.outputs.check(&[recording.path()], false)?;
    let made = gathered(&recording, |tracks| match &arguments.other {
        None => Ok(stillness(&poses(&recording, tracks, recording.path())?)),
        Some(other) => {
            let one = poses(&recording, tracks, recording.path())?;
            let between = poses(&arguments.recording(other), tracks, recording.path())?;
            Ok(arguments.coverage(&arguments.mapped(&pairs(&one, &between))?))
        }
    })?;
    let recording = made.as_ref();
    let read = recording.read()?;
    match &arguments.other {
        None => arguments.noise(recording, &read),
        Some(other) => {
            // The first sensor in the second one's frame, at the same times. This locates the
            // second sensor whenever both were tracked.
            let between = Recording { reference: Some(other.clone()), ..recording.clone() }.read()?;
            arguments.map(recording, &read, &between, other)
        }
    }
}

/// Returns poses of both sensors at the same times; `between` is the first one's in the frame of
/// the second.
fn pairs(read: &Poses, between: &Poses) -> Vec<Pair> {
    let mut seen = between.poses.iter().peekable();
    let mut pairs = Vec::new();
    for (time_s, one) in &read.poses {
        while seen.next_if(|(earlier, _)| earlier < time_s).is_some() {}
        if let Some((_, other_from_one)) = seen.next_if(|(same, _)| same == time_s) {
            let one = one.affine();
            pairs.push(Pair { one, other: one * other_from_one.affine().inverse() });
        }
    }
    pairs
}

/// Returns advice with the time since the sensor was last moved.
fn stillness(read: &Poses) -> Advice {
    let end_s = read.poses.last().map_or(0.0, |(time_s, _)| *time_s);
    let still = |seconds: f64| {
        let from = read.poses.partition_point(|(time_s, _)| *time_s < end_s - seconds);
        let poses: Vec<DAffine3> = read.poses[from..].iter().map(|(_, pose)| pose.affine()).collect();
        noise::of(&poses, seconds)
    };
    // A slow tracker gives too few poses in a second to judge; this does not count as motion.
    let lies = |seconds: &f64| {
        *seconds <= end_s && !matches!(still(*seconds), Err(CalibrationError::Tracker(TrackerError::Moved { .. })))
    };
    let whole = (1..=STILL_S as u32).map(f64::from).take_while(lies);
    let seconds = whole.last().unwrap_or(0.0);
    let message =
        format!("the sensor lies still for {seconds:.0} of {STILL_S:.0} s; lay it down, let go of it, and keep away");
    Advice { from_s: Some(end_s - seconds), ..Advice::at(seconds / STILL_S, message) }
}

impl Arguments {
    fn recording(&self, reference: &str) -> Recording {
        Recording {
            source: self.source.clone(),
            gathering: self.gathering.clone(),
            stylus: self.sensor.clone(),
            reference: Some(reference.to_owned()),
            from: self.from,
            to: self.to,
        }
    }

    fn noise(&self, recording: &Recording, read: &Poses) -> Result<(), Failure> {
        let poses: Vec<DAffine3> = read.poses.iter().map(|(_, pose)| pose.affine()).collect();
        let ends = |(first, last): (&(f64, _), &(f64, _))| last.0 - first.0;
        let seconds = read.poses.first().zip(read.poses.last()).map_or(0.0, ends);
        let found = noise::of(&poses, seconds)
            .map_err(|e| Failure(format!("{}: {e}{}", recording.path().display(), read.counts.also())))?;
        let Noise { position_rms_mm, rotation_rms_deg, fast_rms_mm, farthest_mm, .. } = found;
        let input = Input::of(recording.path())?;
        let provenance = format!("{} of {}, {position_rms_mm:.3} mm", self.sensor, input.name());
        let origin = self.outputs.origin([&input]);
        let noise = found.per_axis();
        let report = NoiseReport {
            kind: "tracker_noise",
            input,
            sensor: &self.sensor,
            poses: &read.counts,
            position_mm: found.position_mm.to_array(),
            position_sd_mm: found.position_sd_mm.to_array(),
            position_rms_mm,
            rotation_sd_deg: found.rotation_sd_deg.to_array(),
            rotation_rms_deg,
            fast_rms_mm,
            farthest_mm,
        };
        let change = |file: &mut CalibrationFile| {
            file.tracker_noise = Some(noise);
            originates(file, "Noise", &provenance);
            file.originates("tracker_noise", origin);
        };
        self.outputs.write_changed(change, &report)?;
        print(&(self.of_noise(read, &found) + &self.outputs.summary()))
    }

    fn of_noise(&self, read: &Poses, found: &Noise) -> String {
        let three = |v: glam::DVec3| v.to_array().map(|x| format!("{x:.3}")).join(", ");
        format!(
            "{} lay at {} mm in {} for {} poses{}\n\
             noise {:.3} mm (x, y, z {}), {:.3}° (about x, y, z {}), one standard deviation; at most {:.3} mm from the mean\n\
             noise from one pose to the next {:.3} mm, which averaging removes\n",
            self.sensor,
            place(found.position_mm),
            self.tracker,
            found.poses,
            read.counts.refusals(),
            found.position_rms_mm,
            three(found.position_sd_mm),
            found.rotation_rms_deg,
            three(found.rotation_sd_deg),
            found.farthest_mm,
            found.fast_rms_mm
        )
    }

    fn mapped(&self, pairs: &[Pair]) -> Result<Map, CalibrationError> {
        distortion::map(pairs, &distortion::Options { cell_mm: self.cell, limit_mm: self.limit })
    }

    /// Returns advice with the covered part of the room.
    fn coverage(&self, map: &Map) -> Advice {
        let cells = map.cells.len();
        let beyond = map.zones.len();
        let message = format!(
            "{cells} cells of {} mm were visited, {beyond} of them beyond {} mm; continue through the scanning area, \
            and end by Ctrl-C",
            self.cell, self.limit
        );
        // Only the operator knows the size of the room, so the progress never reaches 1.
        Advice::at((cells as f64 / USUAL_CELLS).min(0.99), message)
    }

    fn map(&self, recording: &Recording, read: &Poses, between: &Poses, other: &str) -> Result<(), Failure> {
        let map = self
            .mapped(&pairs(read, between))
            .map_err(|e| Failure(format!("{}: {e}{}", recording.path().display(), between.counts.also())))?;
        let cells = map.cells.iter().enumerate().map(|(index, cell)| CellReport {
            low_mm: cell.low_mm.to_array(),
            pairs: cell.pairs,
            rms_mm: cell.rms_mm,
            most_mm: cell.most_mm,
            rms_deg: cell.rms_deg,
            warned_of: map.zones.contains(&index),
        });
        let input = Input::of(recording.path())?;
        let zones = Zones::of(&map, self.limit, Date::today());
        // The zones themselves hold the day.
        let origin = Origin { made: None, ..self.outputs.origin([&input]) };
        let provenance = format!("{} of {} cells, by {}", zones.count(), map.cells.len(), input.name());
        let report = MapReport {
            kind: "tracker_map",
            input,
            sensors: [&self.sensor, other],
            poses: &between.counts,
            pairs: map.pairs,
            distance_mm: map.distance_mm,
            distance_rms_mm: map.distance_rms_mm,
            one_from_other: rows(map.one_from_other),
            rms_mm: map.rms_mm,
            most_mm: map.most_mm,
            rms_deg: map.rms_deg,
            limit_mm: self.limit,
            cell_mm: map.cell_mm,
            cells: cells.collect(),
        };
        let change = |file: &mut CalibrationFile| {
            file.distortion = Some(zones);
            originates(file, "Distortion", &provenance);
            file.originates("distortion", origin);
        };
        self.outputs.write_changed(change, &report)?;
        print(&(self.of_map(other, between, &map) + &self.outputs.summary()))
    }

    fn of_map(&self, other: &str, between: &Poses, map: &Map) -> String {
        let mut text = format!(
            "{} and {other} are {:.2} mm apart ({:.3} mm rms) at {} moments{}\n\
             {other} deviates by {:.3} mm and {:.3}° (rms) from its place on the piece, by at most {:.2} mm\n",
            self.sensor,
            map.distance_mm,
            map.distance_rms_mm,
            map.pairs,
            between.counts.refusals(),
            map.rms_mm,
            map.rms_deg,
            map.most_mm
        );
        // Writing to a string does not fail.
        let _ = match map.zones.len() {
            0 => writeln!(
                text,
                "all {} visited cells of {} mm are within {} mm",
                map.cells.len(),
                map.cell_mm,
                self.limit
            ),
            zones => writeln!(
                text,
                "{zones} of {} cells of {} mm are beyond {} mm: metal distorts the field there",
                map.cells.len(),
                map.cell_mm,
                self.limit
            ),
        };
        for cell in map.zones.iter().take(MOST_PRINTED).map(|zone| &map.cells[*zone]) {
            let middle = cell.low_mm + glam::DVec3::splat(0.5 * map.cell_mm);
            let _ = writeln!(
                text,
                "  about {} mm: {:.2} mm, {:.2}° ({} moments)",
                place(middle),
                cell.rms_mm,
                cell.rms_deg,
                cell.pairs
            );
        }
        if map.zones.len() > MOST_PRINTED {
            let _ = writeln!(text, "  and {} more in the report", map.zones.len() - MOST_PRINTED);
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use glam::DVec3;
    use sonoweave_core::frames::Transform;

    use super::*;

    /// Returns poses of a sensor that is carried for five seconds and then laid down, at
    /// `rate_hz`.
    fn laid(rate_hz: u32, seconds: u32) -> Poses {
        let pose = |n: u32| {
            let time_s = f64::from(n) / f64::from(rate_hz);
            let at = DVec3::X * 40.0 * (5.0 - time_s).max(0.0);
            (time_s, Transform::from_affine(DAffine3::from_translation(at)))
        };
        let poses: Vec<_> = (0..=rate_hz * seconds).map(pose).collect();
        let counts = Counts { read: 0, usable: 0, refused: BTreeMap::new(), first_refusal: None };
        Poses { frame: "Tracker".into(), route: String::new(), poses, counts }
    }

    #[test]
    fn stillness_counts_from_sensor_laid_down() {
        for rate_hz in [10, 60, 240] {
            let early = stillness(&laid(rate_hz, 9));
            assert!((early.share - 0.4).abs() < 1e-9, "{rate_hz}: {early:?}");
            let enough = stillness(&laid(rate_hz, 16));
            assert!(enough.share >= 1.0 && (enough.from_s.unwrap() - 6.0).abs() < 1e-9, "{rate_hz}: {enough:?}");
        }
        assert!(stillness(&laid(60, 4)).share < 0.1);
    }
}
