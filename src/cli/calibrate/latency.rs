//! `sonoweave calibrate latency`: finds the tracker's latency relative to the video.

mod guide;
mod report;
mod source;

use std::path::{Path, PathBuf};

use clap::{ArgGroup, Args, ValueEnum};

use calibration::error::{CalibrationError, LatencyError};
use calibration::file::CalibrationFile;
use calibration::latency::align::AlignOptions;
use calibration::latency::crossings::{Agreement, Slices};
use calibration::latency::floor::{FloorFrame, FloorLag, FloorOptions, floor_lag};
use calibration::latency::line::{Finder, Still};
use calibration::latency::pose_spline::PoseSpline;
use config::Settings;
use config::bedside::pixel_mm;

use super::super::Failure;
use super::guide::Gathering;
use super::outputs::{Outputs, originates, print};
use super::recorded::{Recorded, data};
use report::{Found, Report};
use source::Source;

/// Largest number of slices held at once. Pairs of more take longer than they are worth.
const MOST_SLICES: u64 = 1000;
/// Flags of `calibrate latency`.
#[derive(Debug, Args)]
#[command(
    group(ArgGroup::new("from").required(true).args(["video", "sequence", "session", "live"])),
    after_help = "\
--method line: hold the probe above the floor of a water tank, and move it up and down, unevenly, for 10 to 20 s. \
The command compares the floor's line in the frames with the tracker's motion. --method crossings: scan any object \
at rest twice, in crossing directions. The command compares slices where they cross; this check needs no phantom.

A lag above 0 means that the tracker lags the video. tracker.latency_ms = video.latency_ms + 1000 · lag_s; both go \
into the calibration file. A session uses them unless its configuration has latency_ms.

Examples:
  sonoweave calibrate latency --live bedside.toml -o probe.toml
  sonoweave calibrate latency --session SESSION-20261121-213000.mcap -o probe.toml
  sonoweave calibrate latency --video tank-video.igs.mha --tracker tank-tracker.igs.mha --report latency.json"
)]
pub struct Arguments {
    /// Video frames: a sequence (.mha, .mhd, .nrrd, .nhdr); the poses come from --tracker
    #[arg(long, value_name = "SEQUENCE", requires = "tracker")]
    video: Option<PathBuf>,
    /// Poses: a tracked sequence, which needs no video frames
    #[arg(long, value_name = "SEQUENCE", requires = "video")]
    tracker: Option<PathBuf>,
    /// Video frames with their poses: a tracked sequence
    #[arg(long, value_name = "SEQUENCE")]
    sequence: Option<PathBuf>,
    /// Video frames and poses: a recorded session (.mcap). Its own latencies are ignored
    #[arg(long, value_name = "SESSION")]
    session: Option<PathBuf>,
    /// Session configuration: record its devices now, show instructions, and end when there is
    /// enough
    #[arg(long, value_name = "BEDSIDE.toml")]
    live: Option<PathBuf>,
    #[command(flatten)]
    gathering: Gathering,
    /// Method to find the lag [default: line, and crossings if no video frame shows a floor]
    #[arg(long, value_enum, value_name = "METHOD")]
    method: Option<Method>,
    /// Latency of the video frames' time stamps behind their contents, ms [default: the
    /// session's, else 0]
    #[arg(long, value_name = "MS", allow_hyphen_values = true)]
    video_latency_ms: Option<f64>,
    /// Search for lags from -MS to +MS
    #[arg(long, value_name = "MS", default_value_t = 500.0)]
    range_ms: f64,
    /// Transform from image to probe: our TOML or a PLUS XML [default: the session's]
    #[arg(short, long, value_name = "FILE")]
    config: Option<PathBuf>,
    #[command(flatten)]
    outputs: Outputs,
}

/// Method to find a lag.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Method {
    /// The line of a water tank's floor
    Line,
    /// Slices that cross
    Crossings,
}

/// Runs the command.
///
/// # Errors
/// [`Failure`] when the recording does not determine the lag; nothing is written then.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    arguments.check()?;
    let made = arguments
        .gathering
        .of(arguments.live.as_ref())?
        .map(|path| guide::gathered(path, &arguments.gathering))
        .transpose()?;
    let source = arguments.source(made.as_deref())?;
    let config = arguments.config.as_deref().map(|path| Settings::read(path, None)).transpose()?;
    let nothing = Settings::default();
    let calibration = config.as_ref().or(source.calibration()).unwrap_or(&nothing);
    let mut notes = Vec::new();
    let found = match arguments.method {
        Some(Method::Line) => {
            Found::Line(Box::new(arguments.by_line(&source, calibration, &mut notes)?.map_err(refusal)?))
        }
        Some(Method::Crossings) => {
            Found::Crossings(Box::new(arguments.by_crossings(&source, calibration, &mut notes)?))
        }
        None => match arguments.by_line(&source, calibration, &mut notes)? {
            Ok(found) => Found::Line(Box::new(found)),
            Err(no_floor @ CalibrationError::Latency(LatencyError::NoFloor { .. })) => {
                match arguments.by_crossings(&source, calibration, &mut notes) {
                    Ok(found) => Found::Crossings(Box::new(found)),
                    Err(Failure(no_crossings)) => {
                        return Err(Failure(format!(
                            "by --method line: {no_floor}; by --method crossings: {no_crossings}"
                        )));
                    }
                }
            }
            Err(other) => return Err(refusal(other)),
        },
    };
    let video_ms = arguments.video_latency_ms.or(source.video_ms()).unwrap_or(0.0);
    let report = Report::new(&source, found, video_ms, notes)?;
    if report.latency().tracker_ms.abs() > 1000.0 {
        return Err(Failure(format!(
            "the tracker's latency would be {:.0} ms, but 1000 ms is the limit; check that all stamps are from one \
            clock",
            report.latency().tracker_ms
        )));
    }
    let change = |file: &mut CalibrationFile| {
        file.latency = Some(report.latency());
        originates(file, "latency", &report.provenance());
        file.originates("latency", arguments.outputs.origin(report.inputs()));
    };
    arguments.outputs.write_changed(change, &report)?;
    print(&report.text(&arguments.outputs))
}

fn refusal(why: CalibrationError) -> Failure {
    Failure(format!("no lag: {why}"))
}

impl Arguments {
    /// Refuses invalid flags before the work.
    fn check(&self) -> Result<(), Failure> {
        if !(20.0..=1000.0).contains(&self.range_ms) {
            return Err(Failure(format!("--range-ms {}: must lie between 20 and 1000", self.range_ms)));
        }
        if let Some(ms) = self.video_latency_ms.filter(|ms| !(-1000.0..=1000.0).contains(ms)) {
            return Err(Failure(format!("--video-latency-ms {ms}: must lie between -1000 and 1000")));
        }
        // The calibration may be the output file: its other contents are kept.
        let config = self.config.as_ref().filter(|path| !self.outputs.is_output(path));
        let recordings = [&self.video, &self.tracker, &self.sequence, &self.session, &self.live].into_iter().flatten();
        let inputs: Vec<&Path> = recordings.chain(config).map(PathBuf::as_path).collect();
        self.outputs.check(&inputs, false)
    }

    fn source(&self, made: Option<&Path>) -> Result<Source, Failure> {
        match (&self.video, &self.tracker, &self.sequence, made.or(self.session.as_deref())) {
            (Some(video), tracker, _, _) => {
                let tracker = tracker.clone().filter(|tracker| tracker != video);
                Ok(Source::new(Recorded::Sequence(video.clone()), tracker))
            }
            (_, _, Some(path), _) => Ok(Source::new(Recorded::Sequence(path.clone()), None)),
            (_, _, _, Some(path)) => Ok(Source::new(Recorded::session(path)?, None)),
            _ => Err(Failure("give --video and --tracker, --sequence, --session or --live".into())),
        }
    }

    fn range_s(&self) -> f64 {
        1e-3 * self.range_ms
    }

    fn by_line(
        &self,
        source: &Source,
        calibration: &Settings,
        notes: &mut Vec<String>,
    ) -> Result<Result<FloorLag, CalibrationError>, Failure> {
        let mut still: Option<Still> = None;
        let unfit = source.pictures(|image, _| {
            let view = image.view()?;
            match &mut still {
                None => still = Some(Still::new(&view)),
                Some(still) => {
                    if !still.add(&view) {
                        return Err(sizes(source));
                    }
                }
            }
            Ok(())
        })?;
        *notes = unfit.notes();
        let mut frames = Vec::new();
        if let Some(still) = still {
            let mut finder = Finder::new(still);
            source.pictures(|image, stamps| {
                let line = finder.find(&image.view()?);
                frames.push(FloorFrame { stamps, line });
                Ok(())
            })?;
        }
        let options = FloorOptions {
            align: AlignOptions { range_s: self.range_s() },
            pixel_mm: pixel_mm(calibration).map(|[_, v]| v),
        };
        // Without a visible floor, the probe sensor's poses do not matter.
        let poses = if frames.iter().any(|frame| frame.line.is_ok()) { source.poses()? } else { Vec::new() };
        Ok(floor_lag(&frames, &poses, &options))
    }

    fn by_crossings(
        &self,
        source: &Source,
        calibration: &Settings,
        notes: &mut Vec<String>,
    ) -> Result<Agreement, Failure> {
        let (samples, probe_from_image) = source.placed(calibration)?;
        let poses = PoseSpline::new(&samples)?;
        // Finds the pixels that change at all, and counts the video frames.
        let mut ends: Option<(Vec<[u8; 2]>, [u32; 2])> = None;
        let mut count = 0_u64;
        let unfit = source.pictures(|image, _| {
            count += 1;
            match &mut ends {
                None => ends = Some((image.pixels.iter().map(|x| [*x; 2]).collect(), image.size)),
                Some((_, size)) if *size != image.size => return Err(sizes(source)),
                Some((ends, _)) => {
                    ends.iter_mut()
                        .zip(image.pixels)
                        .for_each(|([low, high], x)| (*low, *high) = ((*low).min(*x), (*high).max(*x)));
                }
            }
            Ok(())
        })?;
        *notes = unfit.notes();
        let Some((ends, [width, height])) = ends else {
            return Err(Failure(format!("{}: holds no usable frame", source.paths()[0].display())));
        };
        let mask = data(&source.mask().unwrap_or(calibration.mask()), [width, height])?;
        let is_data: Vec<bool> = (0..height)
            .flat_map(|v| (0..width).map(move |u| (u, v)))
            .zip(&ends)
            .map(|((u, v), [low, high])| match &mask {
                Some(mask) => mask.contains(u, v),
                None => low < high,
            })
            .collect();
        let mut slices = Slices::new(width, height, &is_data, probe_from_image, poses);
        let every = count.div_ceil(MOST_SLICES).max(1);
        let mut at = 0_u64;
        source.pictures(|image, stamps| {
            if at.is_multiple_of(every) {
                slices.push(stamps.given_s, image.pixels, width, height);
            }
            at += 1;
            Ok(())
        })?;
        slices.lag(self.range_s()).map_err(|why| Failure(format!("no lag: {why}")))
    }
}

fn sizes(source: &Source) -> Failure {
    Failure(format!("{}: its frames have several sizes", source.paths()[0].display()))
}
