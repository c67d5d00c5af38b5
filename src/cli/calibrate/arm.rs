//! `sonoweave calibrate arm`: finds an arm's link lengths and encoder zeros, and checks them
//! later.

mod guide;
mod report;
mod session;
mod touched;

use std::path::{Path, PathBuf};

use clap::{ArgGroup, Args};
use glam::DVec2;

use calibration::arm::check::check;
use calibration::arm::fit::{Fitted, Options, fit};
use calibration::arm::reach::Reach;
use calibration::arm::{Arm, JOINTS};
use calibration::file::CalibrationFile;

use super::super::{Failure, values};
use super::guide::Gathering;
use super::outputs::{Input, Outputs, originates, print};
use report::{CheckReport, FitReport, Results};
use session::Recorded;
use touched::{Places, Touched, Which};

/// Largest share of outlying touches at which the report still calls the other touches right.
const MOST_OUTLIERS: f64 = 0.25;

/// Flags of `calibrate arm`.
#[derive(Debug, Args)]
#[command(group(ArgGroup::new("from_arm").required(true).args(["session", "live"])), after_help = "\
Record a session with the arm (--live, or `live --record`), and set its tip down for two seconds each time. Every \
moment at which the joints rest counts as a touch.
--plate: touch the divots of a plate in any position, in the file's order, for several rounds; bend the arm \
differently in each round.
--point: touch one divot from all sides, with the elbow to the left and to the right. One point determines no size, \
so the longest link keeps its length.
--distances: touch both ends of a bar; then lay the bar elsewhere, and repeat.
The zero of the first joint defines the direction of the base's x axis, and is not changed. Give --skip for rests \
that were no touches.

--check compares an arm in use with its calibration. Touch as above. Only the report is written; the exit code is 0 \
only if the arm still agrees with its calibration.

Examples: sonoweave calibrate arm --live bedside.toml --plate plate.toml -o arm-probe.toml
          sonoweave calibrate arm --session SESSION.mcap --plate plate.toml -o arm-probe.toml --report arm.json
          sonoweave calibrate arm --session SESSION.mcap --plate plate.toml --check")]
pub struct Arguments {
    /// Session of an arm, recorded by `live --record`
    #[arg(long, value_name = "SESSION.mcap")]
    session: Option<PathBuf>,
    /// Session configuration: record its arm now, show instructions, and end when there is
    /// enough
    #[arg(long, value_name = "BEDSIDE.toml")]
    live: Option<PathBuf>,
    #[command(flatten)]
    gathering: Gathering,
    /// Goal for --live: end when the tip is known to this in all of its reach, mm (one standard
    /// deviation)
    #[arg(long, value_name = "MM", default_value_t = 0.3, value_parser = values::positive)]
    goal: f64,
    #[command(flatten)]
    places: Places,
    #[command(flatten)]
    which: Which,
    /// Calibration file whose [[arm.joint]] replaces the session's: lengths right to a tenth,
    /// zeros to some degrees
    #[arg(long, value_name = "CAL.toml")]
    arm: Option<PathBuf>,
    /// Check the arm against its fit instead of fitting it anew, and name the encoder that has
    /// slipped
    #[arg(long, conflicts_with_all = ["output", "keep", "counts", "limit"])]
    check: bool,
    /// Tip in the last link's frame (its origin at the link's end, x along it), mm: X,Y. A tip
    /// elsewhere is found as the last link's length and zero
    #[arg(long, value_name = "X,Y", default_value = "0,0", value_parser = tip, allow_hyphen_values = true)]
    tip: DVec2,
    /// Numbers that stay fixed, such as length1 or zero3: the joint's number, from 1 at the base
    #[arg(long, value_name = "NUMBER", value_delimiter = ',', value_parser = kept)]
    keep: Vec<Kept>,
    /// Find counts per turn or per mm, too; an encoder's disc is mostly known better than it can
    /// be measured
    #[arg(long)]
    counts: bool,
    /// Repeatability of the tip in a divot, mm, one standard deviation along each axis
    #[arg(long, value_name = "MM", default_value_t = 0.1, value_parser = values::positive)]
    seat: f64,
    /// Refuse an arm whose touches are off by more, mm (root mean square)
    #[arg(long, value_name = "MM", default_value_t = 1.0, value_parser = values::positive)]
    limit: f64,
    #[command(flatten)]
    outputs: Outputs,
}

/// A joint's number that is not fitted.
#[derive(Debug, Clone, Copy)]
enum Kept {
    Length(usize),
    Zero(usize),
    Direction(usize),
}

/// Makes a [`Kept`] from a joint's index, from 0.
type OfJoint = fn(usize) -> Kept;

fn kept(text: &str) -> Result<Kept, String> {
    let kinds = [("length", Kept::Length as OfJoint), ("zero", Kept::Zero), ("direction", Kept::Direction)];
    let of = |(name, of): (&str, OfJoint)| {
        let joint: usize = text.trim().strip_prefix(name)?.parse().ok()?;
        (1..=JOINTS).contains(&joint).then(|| of(joint - 1))
    };
    kinds.into_iter().find_map(of).ok_or_else(|| {
        format!("must be length, zero or direction, followed by the joint's number 1 to {JOINTS}, such as length1")
    })
}

fn tip(text: &str) -> Result<DVec2, String> {
    Ok(DVec2::from_array(sonoweave_core::keys::numbers::<2>(text)?))
}

/// Runs the command.
///
/// # Errors
/// [`Failure`] when the recording does not determine the arm, or the arm no longer matches its
/// fit.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let given = [&arguments.session, &arguments.live].into_iter().flatten();
    let inputs: Vec<&Path> = given.chain(arguments.places.file()).map(PathBuf::as_path).collect();
    arguments.outputs.check(&inputs, false)?;
    let made = arguments
        .gathering
        .of(arguments.live.as_ref())?
        .map(|bedside| guide::gathered(bedside, arguments))
        .transpose()?;
    // The command line guarantees that one of the two is present.
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

/// The flags, together with the session that they apply to.
#[derive(Clone, Copy)]
struct Work<'a> {
    arguments: &'a Arguments,
    session: &'a Path,
}

impl Work<'_> {
    fn within(&self, problem: impl std::fmt::Display) -> Failure {
        Failure(format!("{}: {problem}", self.session.display()))
    }

    /// Returns the arm to begin with, and its fit's residual, mm. Uses the configuration's arm
    /// unless --arm was given.
    fn start(&self, configured: Option<Arm>, fit_rms_mm: Option<f64>) -> Result<(Arm, Option<f64>), Failure> {
        let Some(path) = &self.arguments.arm else {
            let none = "its configuration holds no initial joints; give --arm with a calibration file with \
                [[arm.joint]], and lengths measured by a ruler";
            return Ok((configured.ok_or_else(|| self.within(none))?, fit_rms_mm));
        };
        let file = CalibrationFile::read(path)?;
        let none = "holds no [[arm.joint]]; `sonoweave live --example arm-probe` prints an example";
        let arm = file.arm.ok_or_else(|| Failure(format!("{}: {none}", path.display())))?;
        Ok((arm, file.arm_fit_rms_mm))
    }

    fn options(&self, arm: &Arm, touched: &Touched) -> Options {
        let Arguments { tip, seat, counts, keep, .. } = self.arguments;
        let known = touched.known();
        let mut options = Options::of(arm, &known);
        (options.tip_mm, options.seat_mm, options.counts_per_unit) = (*tip, *seat, *counts);
        // A user who fixes numbers is responsible for fixing the scale.
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
                "{out} of {all} residuals contradict the others ({}); check the touches' order (--order), and rests that \
                were no touches (--skip)",
                listed.join(", ")
            )));
        }
        if fitted.rms_mm > self.arguments.limit {
            return Err(self.within(format!(
                "the touches are {:.2} mm off (root mean square), more than the limit of {} mm; check their order \
                (--order), rests that were no touches (--skip), and the joints' types, signs and counts a turn",
                fitted.rms_mm, self.arguments.limit
            )));
        }
        Ok(())
    }

    /// Checks an arm against its fit.
    fn hold(&self, arm: &Arm, fit_rms_mm: Option<f64>, recorded: &Recorded, touched: &Touched) -> Result<(), Failure> {
        let options = self.options(arm, touched);
        // If the fit's residual is unknown, the arm is checked against the seat alone.
        let fitted_mm = fit_rms_mm.unwrap_or(0.0);
        let checked =
            check(arm, &touched.known(), &touched.touches, &options, fitted_mm).map_err(|e| self.within(e))?;
        let results = Results { touched, counts: &recorded.counts, seat_mm: self.arguments.seat };
        let text = results.of_check(&checked, fit_rms_mm);
        let report = CheckReport::new(Input::of(self.session)?, &results, &checked, fit_rms_mm);
        self.arguments.outputs.write_changed(|_| {}, &report)?;
        print(&(text + &self.arguments.outputs.told()))?;
        match checked.changed {
            true => Err(self.within(format!("the arm no longer agrees with its calibration; {}", checked.advice()))),
            false => Ok(()),
        }
    }
}
