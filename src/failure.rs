//! The failure of a command: a sentence for the user, and its kind, which is the exit code.

mod kind;

use std::io;
use std::path::Path;

use config::Error;
use drivers::transport::DENIED;
use pipeline::PipelineError;
use reconstruct::Refused;
use render::RenderError;
use sync::NoPath;
use volume::dense::DenseError;

pub use kind::FailureKind;

/// Failure of a command.
#[derive(Debug)]
pub struct Failure(pub Reason);

/// Reason of a failure. A text is a reason of the kind [`FailureKind::Other`].
#[derive(Debug)]
pub struct Reason {
    /// Sentence for stderr.
    pub sentence: String,
    /// Kind, which is the exit code.
    pub kind: FailureKind,
}

impl From<String> for Reason {
    fn from(sentence: String) -> Self {
        Self { sentence, kind: FailureKind::Other }
    }
}

impl From<&str> for Reason {
    fn from(sentence: &str) -> Self {
        sentence.to_owned().into()
    }
}

/// Returns a failure from a function, with a formatted sentence.
macro_rules! fail {
    ($($sentence:tt)*) => { return Err($crate::failure::Failure::new(format!($($sentence)*))) };
}

/// Returns a failure of usage from a function, with a formatted sentence on flags.
macro_rules! fail_usage {
    ($($sentence:tt)*) => { return Err($crate::failure::Failure::usage(format!($($sentence)*))) };
}

impl<E: std::error::Error + 'static> From<E> for Failure {
    fn from(error: E) -> Self {
        let text = error.to_string();
        let mut causes = std::iter::successors(Some(&error as &(dyn std::error::Error + 'static)), |e| e.source());
        let of_system = causes.find_map(|cause| cause.downcast_ref::<io::Error>());
        let system = of_system.filter(|cause| text.ends_with(&cause.to_string())).map_or("", system);
        Self(Reason { sentence: format!("{text}{}{system}", remedy(&error)), kind: FailureKind::of(&error) })
    }
}

/// Returns the remedy for an error of the system, to follow its text; empty if the text is one of
/// this program.
fn system(error: &io::Error) -> &'static str {
    use io::ErrorKind::{
        AlreadyExists, IsADirectory, NotADirectory, NotFound, PermissionDenied, QuotaExceeded, ReadOnlyFilesystem,
        StorageFull,
    };
    if error.raw_os_error().is_none() {
        return "";
    }
    match error.kind() {
        AlreadyExists => "; give another name",
        IsADirectory => "; give a file",
        NotADirectory | NotFound => "; check the name",
        PermissionDenied => "; check its permissions",
        ReadOnlyFilesystem => "; write to another place",
        QuotaExceeded | StorageFull => "; make room on the disk",
        _ => "; check the device or the disk",
    }
}

/// Returns the command that remedies the cause of an error, to follow its text; empty if there is
/// none. Libraries do not know the commands.
fn remedy(error: &(dyn std::error::Error + 'static)) -> &'static str {
    use formats::Error::Damaged;
    let mut causes = std::iter::successors(Some(error), |error| error.source());
    if let Some(flags) = causes.clone().find_map(flags) {
        return flags;
    }
    match causes.find_map(|cause| cause.downcast_ref()) {
        Some(Damaged { .. }) => " by `sonoweave repair FILE -o OUT`, which lists the missing parts",
        _ => "",
    }
}

/// Flags that place the image in the world.
const CALIBRATION: &str = " (--config FILE, --image-to-probe, --world)";

/// Returns the flags for the settings that the text of an error names.
fn flags(error: &(dyn std::error::Error + 'static)) -> Option<&'static str> {
    if let Some(Refused::Memory { .. }) = error.downcast_ref() {
        return Some(" (--spacing, --clip, --max-memory)");
    }
    if let Some(DenseError::Memory { .. }) = error.downcast_ref() {
        return Some(" (--max-memory)");
    }
    match error.downcast_ref() {
        Some(RenderError::Step { .. }) => return Some(" (--step)"),
        Some(RenderError::Memory { .. }) => return Some(" (--max-memory, --image-size, --step, --level)"),
        Some(RenderError::Arity) => return Some(" (--arity)"),
        Some(RenderError::Adaptive { .. } | RenderError::AdaptiveMode { .. }) => return Some(" (--adaptive)"),
        _ => {}
    }
    match error.downcast_ref() {
        Some(PipelineError::NoGap) => return Some(" (--sigma, --resolution)"),
        Some(PipelineError::NoPath(_)) => return Some(CALIBRATION),
        _ => {}
    }
    error.downcast_ref::<NoPath>().map(|_| CALIBRATION)
}

impl Failure {
    /// Makes a failure of the system at a file; `doing` is the operation.
    pub(crate) fn io(path: &Path, doing: &str, error: &io::Error) -> Self {
        let sentence = format!("{}: {doing} failed: {error}{}", path.display(), system(error));
        Self(Reason { sentence, kind: FailureKind::of_io(doing, error) })
    }

    /// Makes a failure by a sentence.
    pub(crate) fn new(reason: impl Into<Reason>) -> Self {
        Self(reason.into())
    }

    /// Makes a failure of flags.
    pub(crate) fn usage(sentence: impl Into<Reason>) -> Self {
        Self::new(sentence).of(FailureKind::Usage)
    }

    /// Changes the kind.
    pub(crate) fn of(self, kind: FailureKind) -> Self {
        Self(Reason { kind, ..self.0 })
    }

    /// Makes a failure to write to stdout.
    pub(crate) fn stdout(error: &io::Error) -> Self {
        Self::io(Path::new("stdout"), "writing", error)
    }

    /// Converts a problem of settings whose flags have the settings' names.
    pub(crate) fn flag(error: Error) -> Self {
        match error {
            Error::Setting { setting, problem } if !setting.is_empty() => {
                Self::usage(format!("--{}: {problem}", setting.replace(", ", ", --").replace('_', "-")))
            }
            other => other.into(),
        }
    }

    /// Adds to a refused session configuration the command that helps.
    pub(crate) fn configuration(error: Error) -> Self {
        let advice = match &error {
            Error::Misplaced { .. } | Error::DeviceSet { .. } => {
                "; `sonoweave live --example fastrak` prints an example"
            }
            Error::Example { .. } => {
                "; `sonoweave calibrate probe --live` measures them, and --accept-example tries a session without them"
            }
            Error::Uncalibrated { .. } => "; `sonoweave calibrate probe --live` measures it",
            _ => "",
        };
        Self(Reason { sentence: format!("{error}{advice}"), kind: FailureKind::of(&error) })
    }
}

/// Returns a device's reason with the command that remedies it, if there is one. The drivers do not
/// know the commands.
pub(crate) fn with_remedy(why: &str) -> String {
    let remedy = if why.contains(DENIED) { " (`sonoweave devices --udev` prints the rules)" } else { "" };
    format!("{why}{remedy}")
}
