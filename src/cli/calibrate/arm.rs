//! `sonoweave calibrate arm`: finds an arm's link lengths and encoder zeros, and checks them
//! later.

mod report;

use clap::{ArgGroup, Args};

use calibration::arm::reach::Reach;
use calibration::file::CalibrationFile;

use super::super::Failure;
use super::done::{Calibrate, Done, Outlets};
use crate::app::calibrate::arm::{Options, TouchedArm};
use crate::app::calibrate::outputs::{Input, Outputs, originates};
use report::{CheckReport, FitReport, Results};

/// Flags of `calibrate arm`.
#[derive(Debug, Args)]
#[command(group(ArgGroup::new("from_arm").required(true).args(["session", "live"])), after_long_help = "\
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
          sonoweave calibrate arm --session SESSION.mcap --plate plate.toml -o arm-probe.toml --json=arm.json
          sonoweave calibrate arm --session SESSION.mcap --plate plate.toml --check")]
pub struct Arguments {
    #[command(flatten)]
    options: Options,
    #[command(flatten)]
    outputs: Outputs,
}

impl Calibrate for Arguments {
    fn calibrate(&self, outlets: Outlets<'_>) -> Result<Done, Failure> {
        let Arguments { options, outputs } = self;
        outputs.check(&options.inputs())?;
        let touching = options.touching(outlets.advisor)?;
        if options.check { hold(&touching, self) } else { find(&touching, self) }
    }
}

/// Fits the arm to its touches.
fn find(touching: &TouchedArm<'_>, Arguments { options, outputs }: &Arguments) -> Result<Done, Failure> {
    let TouchedArm { session, counts, touched, fit_options, .. } = touching;
    let fitted = touching.fit()?;
    let reach = Reach::of(&fitted);
    let results = Results { touched, counts, tip_sd_mm: options.tip_sd_mm };
    let input = Input::of(session)?;
    let provenance = format!("{} in {}, {:.3} mm", touched.words(), input.name(), fitted.rms_mm);
    let plate = options.plate().map(Input::of).transpose()?;
    let origin = outputs.origin([Some(&input), plate.as_ref()].into_iter().flatten());
    let text = results.of_fit(&fitted, &reach, fit_options);
    let report = FitReport::new(input, &results, &fitted, &reach, options.limit);
    let change = |file: &mut CalibrationFile| {
        (file.arm, file.arm_fit_rms_mm) = (Some(fitted.arm), Some(fitted.rms_mm));
        originates(file, "Arm", &provenance);
        file.originates("arm", origin);
    };
    let report = outputs.write_changed(change, &report)?;
    Ok(Done::new(text + &outputs.summary(), report))
}

/// Checks the arm against its fit.
fn hold(touching: &TouchedArm<'_>, Arguments { options, outputs }: &Arguments) -> Result<Done, Failure> {
    let TouchedArm { session, counts, touched, fit_rms_mm, .. } = touching;
    let checked = touching.check()?;
    let results = Results { touched, counts, tip_sd_mm: options.tip_sd_mm };
    let text = results.of_check(&checked, *fit_rms_mm);
    let report = CheckReport::new(Input::of(session)?, &results, &checked, *fit_rms_mm);
    let report = outputs.write_changed(|_| {}, &report)?;
    let failure = checked.changed.then(|| touching.changed(&checked));
    Ok(Done { failure, ..Done::new(text + &outputs.summary(), report) })
}
