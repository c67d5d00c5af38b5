//! `sonoweave calibrate arm`: an arm's lengths and zeros, and whether it still has them.

mod guide;
mod report;
mod session;
mod touched;

use std::path::{Path, PathBuf};

use calibration::arm::check::check;
use calibration::arm::fit::{Fitted, Options, fit};
use calibration::arm::reach::Reach;
use calibration::arm::{Arm, JOINTS};
use calibration::file::CalibrationFile;
use clap::{ArgGroup, Args};
use glam::DVec2;

use super::super::{Failure, values};
use super::guide::Gathering;
use super::outputs::{Input, Outputs, originates, print};
use report::{CheckReport, FitReport, Results};
use session::Recorded;
use touched::{Places, Touched, Which};

/// Of this part of the touches that do not agree with the others it is no longer said that the others are right.
const MOST_OUTLIERS: f64 = 0.25;

/// Flags of `calibrate arm`.
#[derive(Debug, Args)]
#[command(group(ArgGroup::new("from_arm").required(true).args(["session", "live"])), after_help = "\
Record a session with the arm (--live, or `live --record`), and set its tip down, for two seconds each time: moments at which the joints rest are touches.
--plate: on the divots of a plate that lies anywhere, in the file's order, round after round, each round with the arm bent otherwise.
--point: in one divot, from all sides, with the elbow to the left and to the right. One point tells no size: the longest link keeps its length.
--distances: on the one end of a bar and on the other; then the bar is laid elsewhere.
The zero of the first joint only says where the base's x axis points, and stays. Rests that were no touches are named by --skip.

--check holds an arm that is in use against what it was fitted to: touches as above, nothing is written but the report, and the exit code is 0 only if it is still that arm.

Examples: sonoweave calibrate arm --live bedside.toml --plate plate.toml -o arm-probe.toml
          sonoweave calibrate arm --session SESSION.mcap --plate plate.toml -o arm-probe.toml --report arm.json
          sonoweave calibrate arm --session SESSION.mcap --plate plate.toml --check")]
pub struct Arguments {
    /// A session that `live --record` wrote, of an arm
    #[arg(long, value_name = "SESSION.mcap")]
    session: Option<PathBuf>,
    /// A bedside's configuration: records its arm now, says what to do, and ends when there is enough
    #[arg(long, value_name = "BEDSIDE.toml")]
    live: Option<PathBuf>,
    #[command(flatten)]
    gathering: Gathering,
    /// With --live: it is enough when the tip is known to this wherever it reaches, mm (one standard deviation)
    #[arg(long, value_name = "MM", default_value_t = 0.3, value_parser = values::positive)]
    goal: f64,
    #[command(flatten)]
    places: Places,
    #[command(flatten)]
    which: Which,
    /// A calibration file whose [[arm.joint]] is taken in the place of the session's: lengths right to a tenth, zeros to some degrees
    #[arg(long, value_name = "CAL.toml")]
    arm: Option<PathBuf>,
    /// Hold the arm against its fit instead of fitting it anew, and name the encoder that has slipped
    #[arg(long, conflicts_with_all = ["output", "keep", "counts", "limit"])]
    check: bool,
    /// Where the tip is in the last link's frame (its origin at the link's end, x along it), mm: X,Y. A tip elsewhere is found as the last link's length and zero
    #[arg(long, value_name = "X,Y", default_value = "0,0", value_parser = tip, allow_hyphen_values = true)]
    tip: DVec2,
    /// Numbers that stay as they are, as length1 or zero3: the joint's number, from 1 at the base
    #[arg(long, value_name = "NUMBER", value_delimiter = ',', value_parser = kept)]
    keep: Vec<Kept>,
    /// Find counts a turn or a mm, too; an encoder's disc is mostly known better than it can be measured
    #[arg(long)]
    counts: bool,
    /// How exactly the tip sits in a divot, mm, one standard deviation along each axis
    #[arg(long, value_name = "MM", default_value_t = 0.1, value_parser = values::positive)]
    seat: f64,
    /// Refuse an arm whose touches lie off by more, mm (root mean square)
    #[arg(long, value_name = "MM", default_value_t = 1.0, value_parser = values::positive)]
    limit: f64,
    #[command(flatten)]
    outputs: Outputs,
}

/// A number of a joint that is not sought.
#[derive(Debug, Clone, Copy)]
enum Kept {
    Length(usize),
    Zero(usize),
    Direction(usize),
}

/// Of a joint, from 0.
type OfJoint = fn(usize) -> Kept;

fn kept(text: &str) -> Result<Kept, String> {
    let kinds = [("length", Kept::Length as OfJoint), ("zero", Kept::Zero), ("direction", Kept::Direction)];
    let of = |(name, of): (&str, OfJoint)| {
        let joint: usize = text.trim().strip_prefix(name)?.parse().ok()?;
        (1..=JOINTS).contains(&joint).then(|| of(joint - 1))
    };
    kinds.into_iter().find_map(of).ok_or_else(|| {
        format!("must be length, zero or direction with the joint's number 1 to {JOINTS} behind it, as length1")
    })
}

fn tip(text: &str) -> Result<DVec2, String> {
    crate::config::numbers::<2>(text).map(DVec2::from_array)
}

/// Runs the command.
///
/// # Errors
/// [`Failure`] when the recording does not say what the arm is like, or it is not the arm that it was.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let given = [&arguments.session, &arguments.live].into_iter().flatten();
    let inputs: Vec<&Path> = given.chain(arguments.places.file()).map(PathBuf::as_path).collect();
    arguments.outputs.check(&inputs, false)?;
    let made = arguments
        .gathering
        .of(arguments.live.as_ref())?
        .map(|bedside| guide::gathered(bedside, arguments))
        .transpose()?;
    // One of the two is there: the command line sees to it.
    let session = made.as_ref().or(arguments.session.as_ref()).map_or(Path::new(""), PathBuf::as_path);
    let work = Work { arguments, session };
    let recorded = arguments.which.read(session)?;
    let (arm, fit_rms_mm) = work.start(recorded.arm, recorded.fit_rms_mm)?;
    let touched = arguments.which.touches(session, &arm, &recorded.readings, arguments.places.read()?)?;
    if arguments.check {
        work.hold(&arm, fit_rms_mm, &recorded, &touched)
    } else {
        work.find(&arm, &recorded, &touched)
    }
}

/// What was asked for, of a session.
#[derive(Clone, Copy)]
struct Work<'a> {
    arguments: &'a Arguments,
    session: &'a Path,
}

impl Work<'_> {
    fn within(&self, problem: impl std::fmt::Display) -> Failure {
        Failure(format!("{}: {problem}", self.session.display()))
    }

    /// The arm that it begins with, and what its fit left; the configuration's, unless another was given.
    fn start(&self, configured: Option<Arm>, fit_rms_mm: Option<f64>) -> Result<(Arm, Option<f64>), Failure> {
        let Some(path) = &self.arguments.arm else {
            let none = "its configuration holds no joints, with which to begin: give a calibration file with [[arm.joint]] by --arm, lengths as a ruler says";
            return Ok((configured.ok_or_else(|| self.within(none))?, fit_rms_mm));
        };
        let file = CalibrationFile::read(path)?;
        let none = "holds no [[arm.joint]]; `sonoweave live --example arm-probe` prints some to begin with";
        let arm = file.arm.ok_or_else(|| Failure(format!("{}: {none}", path.display())))?;
        Ok((arm, file.arm_fit_rms_mm))
    }

    fn options(&self, arm: &Arm, touched: &Touched) -> Options {
        let Arguments { tip, seat, counts, keep, .. } = self.arguments;
        let known = touched.known();
        let mut options = Options::of(arm, &known);
        (options.tip_mm, options.seat_mm, options.counts_per_unit) = (*tip, *seat, *counts);
        // Who says what stays takes care of the size.
        if keep.iter().any(|kept| matches!(kept, Kept::Length(_))) {
            options.lengths = arm.joints().map(|joint| joint.kind == calibration::arm::Kind::Revolute);
        }
        for kept in keep {
            match *kept {
                Kept::Length(joint) => options.lengths[joint] = false,
                Kept::Zero(joint) => options.zeros[joint] = false,
                Kept::Direction(joint) => options.directions[joint] = false,
            }
        }
        options
    }

    fn find(&self, arm: &Arm, recorded: &Recorded, touched: &Touched) -> Result<(), Failure> {
        let options = self.options(arm, touched);
        let fitted = fit(arm, &touched.known(), &touched.touches, &options).map_err(|e| self.within(e))?;
        self.accept(&fitted, touched)?;
        let reach = Reach::of(&fitted);
        let results = Results { touched, counts: &recorded.counts, seat_mm: self.arguments.seat };
        let input = Input::of(self.session)?;
        let provenance = format!("{} in {}, {:.3} mm", touched.words(), input.name(), fitted.rms_mm);
        let text = results.of_fit(&fitted, &reach, &options);
        let report = FitReport::new(input, &results, &fitted, &reach, self.arguments.limit);
        let change = |file: &mut CalibrationFile| {
            (file.arm, file.arm_fit_rms_mm) = (Some(fitted.arm), Some(fitted.rms_mm));
            originates(file, "Arm", &provenance);
        };
        self.arguments.outputs.write_changed(change, &report)?;
        print(&(text + &self.arguments.outputs.told()))
    }

    fn accept(&self, fitted: &Fitted, touched: &Touched) -> Result<(), Failure> {
        let (out, all) = (fitted.outliers.len(), fitted.residuals_mm.len());
        if out as f64 > MOST_OUTLIERS * all as f64 {
            let listed: Vec<String> = fitted.outliers.iter().map(|at| touched.name(*at)).collect();
            return Err(self.within(format!(
                "{out} of {all} do not agree with the others ({}): look which touch is of what (--order), and what was no touch (--skip)",
                listed.join(", ")
            )));
        }
        if fitted.rms_mm > self.arguments.limit {
            return Err(self.within(format!(
                "the touches lie {:.2} mm off (root mean square), more than the limit of {} mm: look which touch is of what (--order), what was no touch (--skip), and whether the joints' \
                 types, signs and counts a turn are the arm's",
                fitted.rms_mm, self.arguments.limit
            )));
        }
        Ok(())
    }

    /// Holds an arm against its fit.
    fn hold(&self, arm: &Arm, fit_rms_mm: Option<f64>, recorded: &Recorded, touched: &Touched) -> Result<(), Failure> {
        let options = self.options(arm, touched);
        // An arm of which nobody knows what its fit left is held against the seat alone.
        let fitted_mm = fit_rms_mm.unwrap_or(0.0);
        let checked =
            check(arm, &touched.known(), &touched.touches, &options, fitted_mm).map_err(|e| self.within(e))?;
        let results = Results { touched, counts: &recorded.counts, seat_mm: self.arguments.seat };
        let text = results.of_check(&checked, fit_rms_mm);
        let report = CheckReport::new(Input::of(self.session)?, &results, &checked, fit_rms_mm);
        self.arguments.outputs.write_changed(|_| {}, &report)?;
        print(&(text + &self.arguments.outputs.told()))?;
        match checked.changed {
            true => Err(self.within(format!("it is no longer the arm that was fitted: {}", checked.advice()))),
            false => Ok(()),
        }
    }
}
