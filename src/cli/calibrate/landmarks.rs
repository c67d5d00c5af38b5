//! `sonoweave calibrate landmarks`: finds the pose of a phantom.

use std::fmt::Write as _;
use std::path::PathBuf;

use clap::Args;
use serde::Serialize;

use calibration::landmarks::{Registered, Rest};
use calibration::phantom::Landmark;
use calibration::statistics::Spread;
use config::phantom::PhantomSettings;

use super::super::{Failure, values};
use super::done::{Calibrate, Done, Outlets};
use crate::app::calibrate::landmarks::{Found, Touches, tip};
use crate::app::calibrate::outputs::{Input, Outputs, named, place, rows};
use crate::app::calibrate::poses::{Counts, Recording};

/// Flags of `calibrate landmarks`.
#[derive(Debug, Args)]
#[command(after_long_help = "\
Touch the phantom's landmarks with the stylus in any order, each for two seconds or more; you can swing the stylus \
meanwhile. Touch symmetric landmarks in the file's order. The result is the transform PhantomToReference.

Examples: sonoweave calibrate landmarks --phantom phantom.toml --live bedside.toml --stylus-tip calibration.toml -o \
calibration.toml
          sonoweave calibrate landmarks --phantom phantom.toml --sequence touched.igs.mha --stylus-tip \
calibration.toml -o calibration.toml")]
pub struct Arguments {
    /// Phantom with its landmarks: our file (TOML) or a PLUS XML
    #[arg(long, value_name = "FILE")]
    phantom: PathBuf,
    #[command(flatten)]
    recording: Recording,
    /// Stylus tip: a calibration file (TOML) or a PLUS XML with StylusTipToStylus [default: the
    /// phantom's file]
    #[arg(long, value_name = "FILE")]
    stylus_tip: Option<PathBuf>,
    /// Error of the tip's position, mm: a resting tip moves by at most twice as much
    #[arg(long, value_name = "MM", default_value_t = 1.0, value_parser = values::positive)]
    tip_error: f64,
    /// Refuse a result whose landmarks are off by more, mm (root mean square)
    #[arg(long, value_name = "MM", default_value_t = 1.5, value_parser = values::positive)]
    limit: f64,
    #[command(flatten)]
    outputs: Outputs,
}

/// Report of a result. The names contain the units.
#[derive(Debug, Serialize)]
struct Report<'a> {
    kind: &'static str,
    input: Input,
    phantom: Input,
    stylus_tip: Input,
    frame: &'a str,
    route: &'a str,
    poses: &'a Counts,
    /// Row major.
    phantom_to_reference: [f64; 16],
    /// Distances of touched landmarks from the file's. PLUS's registration error is the mean.
    error_mm: Spread,
    landmarks: Vec<LandmarksReport<'a>>,
    missed: Vec<&'a str>,
    elsewhere: Vec<RestReport>,
    by_order: bool,
    noise_mm: f64,
    rest_radius_mm: f64,
    /// Covariance of a rotation about the reference's axes (rad) and of a shift (mm).
    covariance: [[f64; 6]; 6],
    /// Predicted error of the phantom's centre, and the largest of its points: one standard
    /// deviation (root of the sum over axes).
    predicted_error_mm: [f64; 2],
    condition: f64,
    limit_mm: f64,
}

#[derive(Debug, Serialize)]
struct LandmarksReport<'a> {
    name: &'a str,
    /// In the phantom's frame.
    position_mm: [f64; 3],
    /// In the reference's frame, as touched.
    touched_mm: [f64; 3],
    error_mm: f64,
    rests: Vec<RestReport>,
}

#[derive(Debug, Serialize)]
struct RestReport {
    from_s: f64,
    to_s: f64,
    at_mm: [f64; 3],
    spread_mm: f64,
}

impl From<&Rest> for RestReport {
    fn from(rest: &Rest) -> Self {
        let [from_s, to_s] = rest.time_s;
        Self { from_s, to_s, at_mm: rest.at.to_array(), spread_mm: rest.spread_mm }
    }
}

impl Calibrate for Arguments {
    fn calibrate(&self, outlets: Outlets<'_>) -> Result<Done, Failure> {
        let Arguments { phantom, recording, stylus_tip, tip_error, limit, outputs } = self;
        let tip_file = stylus_tip.as_ref().unwrap_or(phantom);
        // The tip's file may be the output file: its other contents are kept.
        outputs.check(&[recording.path(), phantom])?;
        let settings = PhantomSettings::read(phantom)?;
        let tip_mm = tip(tip_file, &recording.stylus, stylus_tip.is_some())?;
        let landmarks = settings.geometry.landmarks();
        let touches = Touches { phantom: &settings, file: phantom, tip_mm, tip_error_mm: *tip_error, limit_mm: *limit };
        let found = touches.find(recording, outlets.advisor)?;
        let Found { recording, read, registered, predicted } = found;

        let (input, phantom, stylus_tip) = (Input::of(recording.path())?, Input::of(phantom)?, Input::of(tip_file)?);
        let origin = outputs.origin([&input, &phantom, &stylus_tip]);
        let transform = named(&settings.frames.phantom, &read.frame, &registered.reference_from_phantom);
        let provenance = format!(
            "{} landmarks touched in {}, {:.2} mm",
            registered.touched.len(),
            input.name(),
            registered.error_mm.mean
        );
        let text = text(&registered, landmarks, &read.frame, &read.counts, predicted);
        let name = |index: &usize| landmarks[*index].name.as_str();
        let report = Report {
            kind: "landmarks",
            input,
            phantom,
            stylus_tip,
            frame: &read.frame,
            route: &read.route,
            poses: &read.counts,
            phantom_to_reference: rows(registered.reference_from_phantom.affine()),
            error_mm: registered.error_mm,
            landmarks: (registered.touched.iter())
                .map(|touched| LandmarksReport {
                    name: name(&touched.landmark),
                    position_mm: landmarks[touched.landmark].position_mm.to_array(),
                    touched_mm: touched.at_mm.to_array(),
                    error_mm: touched.error_mm,
                    rests: touched.rests.iter().map(RestReport::from).collect(),
                })
                .collect(),
            missed: registered.missed.iter().map(name).collect(),
            elsewhere: registered.elsewhere.iter().map(RestReport::from).collect(),
            by_order: registered.by_order,
            noise_mm: registered.noise_mm,
            rest_radius_mm: registered.radius_mm,
            covariance: registered.covariance,
            predicted_error_mm: predicted,
            condition: registered.condition,
            limit_mm: *limit,
        };
        let report = outputs.write(&transform, &provenance, origin, &report)?;
        Ok(Done::new(text + &outputs.summary(), report))
    }
}

fn text(registered: &Registered, landmarks: &[Landmark], frame: &str, counts: &Counts, predicted: [f64; 2]) -> String {
    let mut text = String::new();
    let spread = &registered.error_mm;
    // Writing to a string does not fail.
    let _ = writeln!(
        text,
        "{} of {} landmarks were touched, {:.3} mm off on average (rms {:.3}, at most {:.3}), in {frame}",
        registered.touched.len(),
        landmarks.len(),
        spread.mean,
        spread.rms,
        spread.max
    );
    for touched in &registered.touched {
        let times: Vec<String> =
            touched.rests.iter().map(|rest| format!("{:.1} to {:.1} s", rest.time_s[0], rest.time_s[1])).collect();
        let _ = writeln!(
            text,
            "  {:8} {:.3} mm off, touched at {} mm, {}",
            landmarks[touched.landmark].name,
            touched.error_mm,
            place(touched.at_mm),
            times.join(", ")
        );
    }
    for index in &registered.missed {
        let _ = writeln!(text, "  {:8} not touched", landmarks[*index].name);
    }
    for rest in &registered.elsewhere {
        let _ = writeln!(
            text,
            "  rested elsewhere: {} mm, {:.1} to {:.1} s",
            place(rest.at),
            rest.time_s[0],
            rest.time_s[1]
        );
    }
    if registered.by_order {
        let _ = writeln!(text, "the landmarks are symmetric: the order of the touches distinguishes them");
    }
    let _ = writeln!(
        text,
        "the phantom's centre is known to {:.3} mm, its worst point to {:.3} (one standard deviation); noise at the tip {:.3} mm; {} poses{}",
        predicted[0],
        predicted[1],
        registered.noise_mm,
        counts.usable,
        counts.refusals()
    );
    text
}
