//! `sonoweave calibrate tracker`: measures a tracker's quality on site.

use std::fmt::Write as _;
use std::path::Path;

use clap::Args;
use serde::Serialize;

use calibration::file::CalibrationFile;
use calibration::file::origin::Origin;
use calibration::tracker::distortion::Map;
use calibration::tracker::noise::{LEAST_FAST, Noise};
use calibration::tracker::zones::Zones;
use sonoweave_core::date::Date;

use super::super::Failure;
use super::done::{Calibrate, Done, Outlets};
use crate::app::calibrate::outputs::{Input, Outputs, originates, place, rows};
use crate::app::calibrate::poses::Counts;
use crate::app::calibrate::tracker::{Found, Measured, Options};

/// Largest number of cells that the text lists.
const MOST_PRINTED: usize = 8;

/// Flags of `calibrate tracker`.
#[derive(Debug, Args)]
#[command(after_long_help = "\
Noise: lay a sensor down, let go of it, and record for ten seconds. With -o the noise goes into the calibration file, \
and counts in the error of measurements.
A map of the room: fix two sensors to one piece of wood or plastic, 10 cm apart, and carry it slowly through the \
whole scanning area. Where the sensors' distance changes, metal distorts the field; do not scan there, or remove the \
metal. With -o these zones go into the calibration file, and `live` warns when the probe is in one.

Examples: sonoweave calibrate tracker --live bedside.toml -o calibration.toml
          sonoweave calibrate tracker --session SESSION.mcap --sensor Probe
          sonoweave calibrate tracker --session SESSION.mcap --sensor Probe --other Reference -o calibration.toml \
--json=room.json")]
pub struct Arguments {
    #[command(flatten)]
    options: Options,
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
    fast_rms_deg: f64,
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

impl Calibrate for Arguments {
    fn calibrate(&self, outlets: Outlets<'_>) -> Result<Done, Failure> {
        let Arguments { options, outputs } = self;
        outputs.check(&[options.recording(&options.tracker).path()])?;
        let Found { path, counts, result } = options.find(outlets.advisor)?;
        match result {
            Measured::Noise(noise) => self.noise(&path, &counts, &noise),
            Measured::Map(map) => self.map(&path, &counts, &map, options.other.as_deref().unwrap_or_default()),
        }
    }
}

/// Returns a warning if smoothing would leave most of the noise; it ends a line.
fn slow(found: &Noise) -> &'static str {
    match found.per_axis().fast_shares().into_iter().fold(1.0, f64::min) < LEAST_FAST {
        true => ".\nThe rest is slow, and more than half: a configuration with smoothing_ms is refused",
        false => "",
    }
}

impl Arguments {
    fn noise(&self, path: &Path, counts: &Counts, found: &Noise) -> Result<Done, Failure> {
        let Noise { position_rms_mm, rotation_rms_deg, fast_rms_mm, fast_rms_deg, farthest_mm, .. } = *found;
        let input = Input::of(path)?;
        let provenance = format!("{} of {}, {position_rms_mm:.3} mm", self.options.sensor, input.name());
        let origin = self.outputs.origin([&input]);
        let noise = found.per_axis();
        let report = NoiseReport {
            kind: "tracker_noise",
            input,
            sensor: &self.options.sensor,
            poses: counts,
            position_mm: found.position_mm.to_array(),
            position_sd_mm: found.position_sd_mm.to_array(),
            position_rms_mm,
            rotation_sd_deg: found.rotation_sd_deg.to_array(),
            rotation_rms_deg,
            fast_rms_mm,
            fast_rms_deg,
            farthest_mm,
        };
        let change = |file: &mut CalibrationFile| {
            file.tracker_noise = Some(noise);
            originates(file, "Noise", &provenance);
            file.originates("tracker_noise", origin);
        };
        let report = self.outputs.write_changed(change, &report)?;
        Ok(Done::new(self.of_noise(counts, found) + &self.outputs.summary(), report))
    }

    fn of_noise(&self, counts: &Counts, found: &Noise) -> String {
        let three = |v: glam::DVec3| v.to_array().map(|x| format!("{x:.3}")).join(", ");
        format!(
            "{} lay at {} mm in {} for {} poses{}\n\
             noise {:.3} mm (x, y, z {}), {:.3}° (about x, y, z {}), one standard deviation; at most {:.3} mm from the mean\n\
             noise from one pose to the next {:.3} mm and {:.3}°, which smoothing averages out{}\n",
            self.options.sensor,
            place(found.position_mm),
            self.options.tracker,
            found.poses,
            counts.refusals(),
            found.position_rms_mm,
            three(found.position_sd_mm),
            found.rotation_rms_deg,
            three(found.rotation_sd_deg),
            found.farthest_mm,
            found.fast_rms_mm,
            found.fast_rms_deg,
            slow(found)
        )
    }

    fn map(&self, path: &Path, counts: &Counts, map: &Map, other: &str) -> Result<Done, Failure> {
        let cells = map.cells.iter().enumerate().map(|(index, cell)| CellReport {
            low_mm: cell.low_mm.to_array(),
            pairs: cell.pairs,
            rms_mm: cell.rms_mm,
            most_mm: cell.most_mm,
            rms_deg: cell.rms_deg,
            warned_of: map.zones.contains(&index),
        });
        let input = Input::of(path)?;
        let zones = Zones::of(map, self.options.limit, Date::today());
        // The zones themselves hold the day.
        let origin = Origin { made: None, ..self.outputs.origin([&input]) };
        let provenance = format!("{} of {} cells, by {}", zones.count(), map.cells.len(), input.name());
        let report = MapReport {
            kind: "tracker_map",
            input,
            sensors: [&self.options.sensor, other],
            poses: counts,
            pairs: map.pairs,
            distance_mm: map.distance_mm,
            distance_rms_mm: map.distance_rms_mm,
            one_from_other: rows(map.one_from_other),
            rms_mm: map.rms_mm,
            most_mm: map.most_mm,
            rms_deg: map.rms_deg,
            limit_mm: self.options.limit,
            cell_mm: map.cell_mm,
            cells: cells.collect(),
        };
        let change = |file: &mut CalibrationFile| {
            file.distortion = Some(zones);
            originates(file, "Distortion", &provenance);
            file.originates("distortion", origin);
        };
        let report = self.outputs.write_changed(change, &report)?;
        Ok(Done::new(self.of_map(other, counts, map) + &self.outputs.summary(), report))
    }

    fn of_map(&self, other: &str, counts: &Counts, map: &Map) -> String {
        let mut text = format!(
            "{} and {other} are {:.2} mm apart ({:.3} mm rms) at {} moments{}\n\
             {other} deviates by {:.3} mm and {:.3}° (rms) from its place on the piece, by at most {:.2} mm\n",
            self.options.sensor,
            map.distance_mm,
            map.distance_rms_mm,
            map.pairs,
            counts.refusals(),
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
                self.options.limit
            ),
            zones => writeln!(
                text,
                "{zones} of {} cells of {} mm are beyond {} mm: metal distorts the field there",
                map.cells.len(),
                map.cell_mm,
                self.options.limit
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
