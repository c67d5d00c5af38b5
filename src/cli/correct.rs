//! `sonoweave correct`: corrections of a recorded session.

mod report;

use std::path::{Path, PathBuf};

use clap::{Args, Subcommand};

use pipeline::session::RecordedDecisions;

use super::{Failure, values};
use crate::app::correct::{self, Correction, CorrectionFile, GateSignal, Settings, Standing};
use crate::app::input;
use crate::app::json::JsonFlag;
use report::{List, Report};

/// Flags of `correct`: the correction.
#[derive(Debug, Subcommand)]
pub enum Arguments {
    /// List the corrections of a session: which are applied, and which are stale or undone
    List(ListArguments),
    /// Smooth the poses of a tracker's sensors, which averages their white noise out
    Smoothing(SmoothingArguments),
    /// Correct the probe's calibration and the latency by slices that cross
    Calibration(CalibrationArguments),
    /// Correct slow drift of the poses by sweeps that cross
    Drift(DriftArguments),
    /// Correct the noise of poses within the image's plane, by the images of neighbouring frames
    Jitter(JitterArguments),
    /// Undo the compression of tissue by the probe, against a sweep with light contact
    Pressure(PressureArguments),
    /// Leave out the frames at which breathing displaces the body
    Gate(GateArguments),
    /// Undo a correction: the volume is then as it was before
    Undo(UndoArguments),
}

/// Flags of `correct list`.
#[derive(Debug, Args)]
pub struct ListArguments {
    /// Recorded session (.mcap)
    session: PathBuf,
    #[command(flatten)]
    json: JsonFlag,
}

/// Flags of `correct smoothing`.
#[derive(Debug, Args)]
#[command(after_long_help = "\
The correction is stored in a file beside the session, SESSION.corrections.jsonl, with the poses that it results in. \
Replays then use these. The session itself stays as it is.

Example: sonoweave correct smoothing SESSION-20261121-213000.mcap")]
pub struct SmoothingArguments {
    /// Recorded session (.mcap)
    session: PathBuf,
    /// Time before and after a frame over which poses are averaged, ms. The time used is shorter
    /// where the probe moves fast
    #[arg(long, value_name = "MS", default_value = "300", value_parser = half_width)]
    half_width: f64,
    #[command(flatten)]
    storing: StoringFlags,
}

/// Flags of `correct calibration`.
#[derive(Debug, Args)]
#[command(after_long_help = "\
The session must have sweeps of the same place in three directions, as for `sonoweave calibrate crossings`. The \
correction is stored beside the session, in SESSION.corrections.jsonl. It concerns this session alone: write a \
calibration for the next ones by `sonoweave calibrate crossings -o`.

Example: sonoweave correct calibration SESSION-20261121-213000.mcap")]
pub struct CalibrationArguments {
    /// Recorded session (.mcap)
    session: PathBuf,
    #[command(flatten)]
    storing: StoringFlags,
}

/// Flags of `correct drift`.
#[derive(Debug, Args)]
#[command(after_long_help = "\
The session must have sweeps of the same place that cross. The first of them is held: a drift that all share does not \
show. Frames between sweeps are left out, as nothing tells their place. Smooth the poses before, and correct the \
calibration if it is off.

Example: sonoweave correct drift SESSION-20261121-213000.mcap")]
pub struct DriftArguments {
    /// Recorded session (.mcap)
    session: PathBuf,
    #[command(flatten)]
    storing: StoringFlags,
}

/// Flags of `correct jitter`.
#[derive(Debug, Args)]
#[command(after_long_help = "\
For sessions with one pose for each frame, where smoothing has too few samples. A frame is displaced and turned in its \
plane to where its neighbours predict its image. The noise of the tracker must be known, from `sonoweave calibrate \
tracker` or the configuration.

Example: sonoweave correct jitter SESSION-20261121-213000.mcap")]
pub struct JitterArguments {
    /// Recorded session (.mcap)
    session: PathBuf,
    #[command(flatten)]
    storing: StoringFlags,
}

/// Flags of `correct pressure`.
#[derive(Debug, Args)]
#[command(after_long_help = "\
Sweep the place once with light contact, much gel and hardly any pressure, and once as usual, in the same direction. \
Images of the usual sweep are then stretched along their rows' depth until they show tissue where light contact shows \
it. Frames farther than 0.5 mm from one of the light sweep stay as they are.

Example: sonoweave correct pressure SESSION-20261121-213000.mcap --light 1")]
pub struct PressureArguments {
    /// Recorded session (.mcap)
    session: PathBuf,
    /// Number of the sweep with light contact, in the order of time, from 1; without it, the sweeps
    /// and their times are listed
    #[arg(long, value_name = "N")]
    light: Option<usize>,
    #[command(flatten)]
    storing: StoringFlags,
}

/// Flags of `correct gate`.
#[derive(Debug, Args)]
#[command(after_long_help = "\
Frames are used around the end of breathing out, where a body rests longest. A Reference sensor on the body tells its \
displacement; without one, the images do, if the probe moves slowly. Moments marked on the page (key B), or by a line \
([markers] of the configuration), tell its phase instead. Record 30 s or more, and several sweeps: while \
the body is displaced, no frame is used.

Example: sonoweave correct gate SESSION-20261121-213000.mcap --share 0.35")]
pub struct GateArguments {
    /// Recorded session (.mcap)
    session: PathBuf,
    /// Share of the frames that is used, the least displaced ones
    #[arg(long, value_name = "X", default_value = "0.35")]
    share: f64,
    /// Signal of the body's displacement [default: markers if there are any, else the Reference
    /// sensor, else the images]
    #[arg(long, value_name = "SIGNAL")]
    signal: Option<GateSignal>,
    /// Phase around which frames are used, by markers: 0 at a marker, up to 1 at the next one
    #[arg(long, value_name = "X", default_value = "0")]
    phase: f64,
    #[command(flatten)]
    storing: StoringFlags,
}

/// Flags of a correction's result.
#[derive(Debug, Args)]
struct StoringFlags {
    /// Compute and report the correction, but do not store it
    #[arg(long)]
    dry_run: bool,
    #[command(flatten)]
    json: JsonFlag,
}

/// Flags of `correct undo`.
#[derive(Debug, Args)]
pub struct UndoArguments {
    /// Recorded session (.mcap)
    session: PathBuf,
    /// Number of the correction, as in the list
    number: u64,
}

/// Parses the time over which poses are smoothed, which is not 0.
fn half_width(text: &str) -> Result<f64, String> {
    match values::smoothing(text).map_err(|why| why.to_string())? {
        0.0 => Err("must not be 0, which smooths nothing".to_owned()),
        ms => Ok(ms),
    }
}

/// Runs the command.
///
/// # Errors
/// [`Failure`] when the session cannot be read, or its data do not determine the correction;
/// nothing is stored then.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    match arguments {
        Arguments::List(ListArguments { session, json }) => {
            let list = list(session)?;
            print_line!("{}", list.text());
            json.write(&list)
        }
        Arguments::Smoothing(SmoothingArguments { session, half_width, storing }) => {
            check(session)?;
            store(session, correct::smoothing::compute(session, *half_width)?, storing)
        }
        Arguments::Calibration(CalibrationArguments { session, storing }) => {
            check(session)?;
            store(session, correct::calibration::compute(session)?, storing)
        }
        Arguments::Drift(DriftArguments { session, storing }) => {
            check(session)?;
            store(session, correct::drift::compute(session)?, storing)
        }
        Arguments::Jitter(JitterArguments { session, storing }) => {
            check(session)?;
            store(session, correct::jitter::compute(session)?, storing)
        }
        Arguments::Pressure(PressureArguments { session, light, storing }) => {
            check(session)?;
            store(session, correct::pressure::compute(session, light.unwrap_or(0))?, storing)
        }
        Arguments::Gate(GateArguments { session, share, signal, phase, storing }) => {
            check(session)?;
            let settings = Settings { share: *share, signal: *signal, phase: *phase };
            store(session, correct::gate::compute(session, &settings)?, storing)
        }
        Arguments::Undo(UndoArguments { session, number }) => {
            check(session)?;
            CorrectionFile::of(session)?.undo(*number)?;
            print_line!("correction {number} is undone");
            print_line!("{}", list(session)?.text());
            Ok(())
        }
    }
}

fn check(session: &Path) -> Result<(), Failure> {
    if input::is_session(session)? {
        return Ok(());
    }
    fail!("{}: is not a session; give a recorded session (.mcap)", session.display())
}

/// Lists the corrections of a session.
fn list(session: &Path) -> Result<List, Failure> {
    check(session)?;
    Ok(List::new(CorrectionFile::of(session)?.path(), correct::list(session)?))
}

/// Stores a correction, unless it is only to be reported.
fn store(session: &Path, correction: Correction, flags: &StoringFlags) -> Result<(), Failure> {
    let StoringFlags { dry_run, json } = flags;
    json.check([session])?;
    let mut file = CorrectionFile::of(session)?;
    let mut report = Report::new(&correction, file.path());
    let id = if *dry_run { None } else { Some(file.accept(correction)?) };
    let stale: Vec<String> = Standing::of(session, &RecordedDecisions::read(session)?)?.stale().collect();
    report.id = id;
    report.stale = stale;
    print_line!("{}", report.text());
    json.write(&report)
}
