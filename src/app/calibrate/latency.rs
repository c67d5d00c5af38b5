//! The tracker's latency relative to the video.

mod guide;
mod options;
mod source;

use std::path::{Path, PathBuf};

use calibration::error::{CalibrationError, LatencyError};
use calibration::latency::align::AlignOptions;
use calibration::latency::crossings::Agreement;
use calibration::latency::floor::{FloorFrame, FloorLag, FloorOptions, floor_lag};
use calibration::latency::line::{Finder, Still};
use config::Settings;
use config::bedside::pixel_mm;

use super::guide::Advisor;
use super::outputs::Outputs;
use super::recorded::Recorded;
use super::slices::{sizes, slices};
use crate::failure::{Failure, Reason};
use options::Method;
pub(crate) use options::Options;
pub(crate) use source::Source;
pub(super) use source::{Poses, probe_from_image};

/// Result of the method used.
pub(crate) enum Found {
    Line(Box<FloorLag>),
    Crossings(Box<Agreement>),
}

/// A lag, and how it was found.
pub(crate) struct Searched {
    pub(crate) source: Source,
    pub(crate) found: Found,
    /// Latency of the video, ms.
    pub(crate) video_ms: f64,
    /// Sentences for the user.
    pub(crate) notes: Vec<String>,
}

impl Options {
    /// Finds the lag in a recording, which is made first if it is still to be made.
    ///
    /// # Errors
    /// [`Failure`] when the recording does not determine the lag.
    pub(crate) fn find(&self, advisor: &mut dyn Advisor) -> Result<Searched, Failure> {
        let config = self.config.as_deref().map(|path| Settings::read(path, None)).transpose()?;
        let needed = |configured: &Settings| match self.method {
            Some(Method::Crossings) => probe_from_image(config.as_ref().unwrap_or(configured)).map(|_| ()),
            _ => Ok(()),
        };
        let made = self
            .gathering
            .of(self.live.as_ref())?
            .map(|path| guide::gathered(path, &self.gathering, advisor, needed))
            .transpose()?;
        let source = self.source(made.as_deref())?;
        let nothing = Settings::default();
        let calibration = config.as_ref().or(source.calibration()).unwrap_or(&nothing);
        let mut notes = Vec::new();
        let found = match self.method {
            Some(Method::Line) => {
                Found::Line(Box::new(self.by_line(&source, calibration, &mut notes)?.map_err(refusal)?))
            }
            Some(Method::Crossings) => {
                Found::Crossings(Box::new(self.by_crossings(&source, calibration, &mut notes)?))
            }
            None => match self.by_line(&source, calibration, &mut notes)? {
                Ok(found) => Found::Line(Box::new(found)),
                Err(no_floor @ CalibrationError::Latency(LatencyError::NoFloor { .. })) => {
                    match self.by_crossings(&source, calibration, &mut notes) {
                        Ok(found) => Found::Crossings(Box::new(found)),
                        Err(Failure(Reason { sentence: why, .. })) => {
                            fail!("by --method line: {no_floor}; by --method crossings: {why}");
                        }
                    }
                }
                Err(other) => return Err(refusal(other)),
            },
        };
        let video_ms = self.video_latency_ms.or(source.video_ms()).unwrap_or(0.0);
        Ok(Searched { source, found, video_ms, notes })
    }

    /// Refuses invalid flags and outputs before the work.
    ///
    /// # Errors
    /// [`Failure`] with the flag.
    pub(crate) fn check(&self, outputs: &Outputs) -> Result<(), Failure> {
        if !(20.0..=1000.0).contains(&self.range_ms) {
            fail!("--range-ms {}: must lie between 20 and 1000", self.range_ms);
        }
        if let Some(ms) = self.video_latency_ms.filter(|ms| !(-1000.0..=1000.0).contains(ms)) {
            fail!("--video-latency-ms {ms}: must lie between -1000 and 1000");
        }
        // The calibration may be the output file: its other contents are kept.
        let config = self.config.as_ref().filter(|path| !outputs.is_output(path));
        let recordings = [&self.video, &self.tracker, &self.sequence, &self.session, &self.live].into_iter().flatten();
        let inputs: Vec<&Path> = recordings.chain(config).map(PathBuf::as_path).collect();
        outputs.check(&inputs)
    }

    fn source(&self, made: Option<&Path>) -> Result<Source, Failure> {
        match (&self.video, &self.tracker, &self.sequence, made.or(self.session.as_deref())) {
            (Some(video), tracker, _, _) => {
                let tracker = tracker.clone().filter(|tracker| tracker != video);
                Ok(Source::new(Recorded::Sequence(video.clone()), tracker))
            }
            (_, _, Some(path), _) => Ok(Source::new(Recorded::Sequence(path.clone()), None)),
            (_, _, _, Some(path)) => Ok(Source::new(Recorded::session(path)?, None)),
            _ => Err(Failure::new("give --video and --tracker, --sequence, --session or --live")),
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
        let slices = slices(source, calibration, Poses::OfImages, 0.0, notes)?;
        slices.lag(self.range_s()).map_err(|why| Failure::new(format!("no lag: {why}")))
    }
}

fn refusal(why: CalibrationError) -> Failure {
    Failure::new(format!("no lag: {why}"))
}
