//! Kinds of failures, which are the program's exit codes. Errors have theirs by their types; a
//! failure that a command words itself is of the kind [`FailureKind::Other`] unless it says one.

use std::error::Error as StdError;
use std::io;

use calibration::error::PresetError;
use export::ExportError;
use formats::Error as FormatError;
use mask::MaskError;
use ome_zarr::OmeZarrError;
use pipeline::PipelineError;
use pipeline::regions::TooSmall;
use reconstruct::{Refused, RepeatError, SettingsError};
use render::RenderError;
use segment::SegmentError;
use serde::{Deserialize, Serialize};
use sonoweave_core::keys::FileError;
use surface::SurfaceError;
use sync::NoPath;
use volume::dense::DenseError;

/// Kind of a failure.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FailureKind {
    /// None of the others.
    Other,
    /// Flags that contradict each other, or have wrong values.
    Usage,
    /// An input is missing, damaged, changed, or a file of another kind.
    Input,
    /// Calibration or configuration cannot be read, or does not fit the input.
    Configuration,
    /// No frame could be used.
    NoFrame,
    /// The memory limit.
    Memory,
    /// An output cannot be written.
    Output,
    /// The time limit.
    Timeout,
    /// Some sweeps of a batch have failed.
    SomeFailed,
}

/// First words of operations on files that read. All others write.
const READING: [&str; 5] = ["finding", "going", "opening", "reading", "skipping"];

impl FailureKind {
    /// All kinds, by their exit codes.
    pub const ALL: [Self; 9] = [
        Self::Other,
        Self::Usage,
        Self::Input,
        Self::Configuration,
        Self::NoFrame,
        Self::Memory,
        Self::Output,
        Self::Timeout,
        Self::SomeFailed,
    ];

    /// Returns the program's exit code.
    pub fn code(self) -> u8 {
        match self {
            Self::Other => 1,
            Self::Usage => 2,
            Self::Input => 3,
            Self::Configuration => 4,
            Self::NoFrame => 5,
            Self::Memory => 6,
            Self::Output => 7,
            Self::Timeout => 8,
            Self::SomeFailed => 10,
        }
    }

    /// Returns the kind of an exit code; `None` for success and codes of no kind.
    pub fn of_code(code: i32) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| i32::from(kind.code()) == code)
    }

    /// Returns the name; the serialised form is the same.
    pub fn name(self) -> &'static str {
        match self {
            Self::Other => "other",
            Self::Usage => "usage",
            Self::Input => "input",
            Self::Configuration => "configuration",
            Self::NoFrame => "no_frame",
            Self::Memory => "memory",
            Self::Output => "output",
            Self::Timeout => "timeout",
            Self::SomeFailed => "some_failed",
        }
    }

    /// Describes the kind in a few words.
    pub fn words(self) -> &'static str {
        match self {
            Self::Other => "another error",
            Self::Usage => "wrong flags",
            Self::Input => "an input is missing, damaged or of another kind",
            Self::Configuration => "calibration or configuration is unfit",
            Self::NoFrame => "no frame could be used",
            Self::Memory => "the memory limit",
            Self::Output => "an output could not be written",
            Self::Timeout => "the time limit",
            Self::SomeFailed => "some sweeps of a batch failed",
        }
    }

    /// Returns the kind of an error, by its type or the first of its causes that has a kind.
    pub(super) fn of(error: &(dyn StdError + 'static)) -> Self {
        let mut next = Some(error);
        while let Some(cause) = next {
            if let Some(kind) = by_type(cause) {
                return kind;
            }
            next = cause.source();
        }
        Self::Other
    }

    /// Returns the kind of a system's error in an operation on a file.
    pub(super) fn of_io(doing: &str, error: &io::Error) -> Self {
        let reads = READING.iter().any(|word| doing.split(' ').next() == Some(word));
        by_system(error).unwrap_or(if reads { Self::Input } else { Self::Output })
    }
}

/// Returns the kind of an error that has one by its type.
fn by_type(error: &(dyn StdError + 'static)) -> Option<FailureKind> {
    if let Some(error) = error.downcast_ref::<PipelineError>() {
        return of_pipeline(error);
    }
    if let Some(error) = error.downcast_ref::<FormatError>() {
        return of_format(error);
    }
    if let Some(error) = error.downcast_ref::<config::Error>() {
        return Some(of_configuration(error));
    }
    if let Some(error) = error.downcast_ref::<FileError>() {
        return Some(of_file(error));
    }
    if let Some(error) = error.downcast_ref::<ExportError>() {
        return of_export(error);
    }
    if let Some(error) = error.downcast_ref::<OmeZarrError>() {
        return Some(of_ome_zarr(error));
    }
    if let Some(error) = error.downcast_ref::<DenseError>() {
        return match error {
            DenseError::File(error) => of_format(error),
            DenseError::Memory { .. } => Some(FailureKind::Memory),
            _ => Some(FailureKind::Input),
        };
    }
    if let Some(error) = error.downcast_ref::<RenderError>() {
        return match error {
            RenderError::Step { .. }
            | RenderError::Arity
            | RenderError::Adaptive { .. }
            | RenderError::AdaptiveMode { .. } => Some(FailureKind::Usage),
            RenderError::Memory { .. } => Some(FailureKind::Memory),
            RenderError::Message { .. } => Some(FailureKind::Input),
            _ => None,
        };
    }
    if let Some(error) = error.downcast_ref::<SurfaceError>() {
        return match error {
            SurfaceError::Memory { .. } | SurfaceError::Vertices { .. } => Some(FailureKind::Memory),
            _ => Some(FailureKind::Usage),
        };
    }
    if let Some(error) = error.downcast_ref::<SegmentError>() {
        return Some(match error {
            SegmentError::Memory { .. } => FailureKind::Memory,
            _ => FailureKind::Usage,
        });
    }
    if let Some(Refused::Memory { .. }) = error.downcast_ref() {
        return Some(FailureKind::Memory);
    }
    if error.is::<TooSmall>() {
        return Some(FailureKind::Memory);
    }
    if let Some(RepeatError::OtherKernels) = error.downcast_ref() {
        return Some(FailureKind::Configuration);
    }
    let is_unfit = error.is::<NoPath>() || error.is::<MaskError>() || error.is::<SettingsError>();
    if is_unfit || error.is::<PresetError>() {
        return Some(FailureKind::Configuration);
    }
    error.downcast_ref().and_then(by_system)
}

fn of_pipeline(error: &PipelineError) -> Option<FailureKind> {
    match error {
        // Their causes are those of the error inside.
        PipelineError::Device(_) | PipelineError::Observer(_) | PipelineError::Planned { .. } => None,
        PipelineError::NoPath(_)
        | PipelineError::Mask(_)
        | PipelineError::Settings(_)
        | PipelineError::NotPlanar(_)
        | PipelineError::NoGap => Some(FailureKind::Configuration),
        PipelineError::Memory { .. } => Some(FailureKind::Memory),
        PipelineError::OtherRecording { .. } => Some(FailureKind::Input),
        PipelineError::NothingUsed(_) | PipelineError::NoSuchFrames { .. } => Some(FailureKind::NoFrame),
    }
}

fn of_format(error: &FormatError) -> Option<FailureKind> {
    match error {
        FormatError::Io { doing, source, .. } => Some(FailureKind::of_io(doing, source)),
        FormatError::Unwritable { .. } => Some(FailureKind::Output),
        FormatError::Volume(error) => Some(FailureKind::of(&**error)),
        _ => Some(FailureKind::Input),
    }
}

fn of_configuration(error: &config::Error) -> FailureKind {
    match error {
        config::Error::File(error) => of_file(error),
        // Settings and values without a file are flags.
        config::Error::Setting { .. } | config::Error::Value(_) => FailureKind::Usage,
        _ => FailureKind::Configuration,
    }
}

/// Returns the kind of an error of a configuration's or calibration's file.
fn of_file(error: &FileError) -> FailureKind {
    match error {
        FileError::Io { doing, source, .. } if FailureKind::of_io(doing, source) == FailureKind::Output => {
            FailureKind::Output
        }
        _ => FailureKind::Configuration,
    }
}

fn of_export(error: &ExportError) -> Option<FailureKind> {
    match error {
        ExportError::File(error) => of_format(error),
        ExportError::Memory { .. } => Some(FailureKind::Memory),
        ExportError::NoFrame => Some(FailureKind::NoFrame),
        ExportError::RadiusTooSmall { .. }
        | ExportError::RadiusTooLarge { .. }
        | ExportError::Identifier { .. }
        | ExportError::FloatingPoint => Some(FailureKind::Usage),
        ExportError::Threads { .. } => None,
        _ => Some(FailureKind::Output),
    }
}

fn of_ome_zarr(error: &OmeZarrError) -> FailureKind {
    match error {
        OmeZarrError::Io { doing, source, .. } => FailureKind::of_io(doing, source),
        OmeZarrError::IsFile { .. }
        | OmeZarrError::NotReplaced { .. }
        | OmeZarrError::Busy { .. }
        | OmeZarrError::Unwritable { .. } => FailureKind::Output,
        OmeZarrError::Level { .. } => FailureKind::Usage,
        OmeZarrError::Memory { .. } => FailureKind::Memory,
        _ => FailureKind::Input,
    }
}

/// Returns the kind of a system's error that has one whatever the operation.
fn by_system(error: &io::Error) -> Option<FailureKind> {
    match error.kind() {
        io::ErrorKind::StorageFull
        | io::ErrorKind::QuotaExceeded
        | io::ErrorKind::ReadOnlyFilesystem
        | io::ErrorKind::FileTooLarge => Some(FailureKind::Output),
        io::ErrorKind::OutOfMemory => Some(FailureKind::Memory),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::failure::Failure;

    fn kind<E: StdError + 'static>(error: E) -> FailureKind {
        Failure::from(error).0.kind
    }

    #[test]
    fn errors_have_kind_of_their_cause() {
        let io = |kind: io::ErrorKind| io::Error::from(kind);
        let file = |doing: &'static str, kind| FormatError::Io { path: "a".into(), doing, source: io(kind) };
        let full = io::ErrorKind::StorageFull;
        let denied = io::ErrorKind::PermissionDenied;
        let frames = PipelineError::NoSuchFrames { frames: 3..4, total: 2 };
        let memory = PipelineError::Memory { item: 3, source: Refused::Memory { needed: 1, limit_bytes: 2 } };
        let other = FailureKind::Other;
        assert_eq!(kind(io(full)), FailureKind::Output);
        assert_eq!(kind(io(denied)), other);
        assert_eq!(kind(file("reading pixels", denied)), FailureKind::Input);
        assert_eq!(kind(file("reading pixels", full)), FailureKind::Output);
        assert_eq!(kind(file("writing", denied)), FailureKind::Output);
        assert_eq!(kind(ExportError::File(file("writing", full))), FailureKind::Output);
        assert_eq!(
            kind(FormatError::NoImage { path: "a".into(), source: formats::NoImage::Empty }),
            FailureKind::Input
        );
        let device = PipelineError::from(sonoweave_core::Error::from(file("opening", io::ErrorKind::NotFound)));
        assert_eq!(kind(device), FailureKind::Input);
        assert_eq!(kind(frames), FailureKind::NoFrame);
        assert_eq!(kind(memory), FailureKind::Memory);
        assert_eq!(kind(config::Error::Uncalibrated { path: "a".into() }), FailureKind::Configuration);
        assert_eq!(kind(config::Error::Value("x".into())), FailureKind::Usage);
        assert_eq!(kind(std::fmt::Error), other);
        assert_eq!(Failure::io("a".as_ref(), "reading", &io(denied)).0.kind, FailureKind::Input);
        assert_eq!(Failure::io("a".as_ref(), "making the folder", &io(denied)).0.kind, FailureKind::Output);
    }

    #[test]
    fn every_kind_has_its_own_code() {
        for kind in FailureKind::ALL {
            assert_eq!(serde_json::to_value(kind).unwrap(), kind.name());
            assert_eq!(FailureKind::of_code(kind.code().into()), Some(kind));
        }
        let codes: std::collections::BTreeSet<u8> = FailureKind::ALL.map(FailureKind::code).into();
        assert_eq!(codes.len(), FailureKind::ALL.len());
        assert_eq!([FailureKind::of_code(0), FailureKind::of_code(9), FailureKind::of_code(101)], [None; 3]);
    }
}
