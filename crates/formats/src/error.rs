//! Errors of files.

use std::path::PathBuf;

use crate::session::walk::Damage;

/// Error of an image file or a session.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The file cannot be read or written at all.
    #[error("{path}: {doing} failed: {source}", path = .path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Operation that failed.
        doing: &'static str,
        /// The operating system's reason.
        #[source]
        source: std::io::Error,
    },
    /// A field of a file's header is missing, malformed or contradicts another.
    #[error("{path}: {} (byte {offset}): {problem}", place(field), path = .path.display())]
    Header {
        /// The file.
        path: PathBuf,
        /// Field name, as in the file; `line N` for a line without a name.
        field: String,
        /// Position of the field, in bytes from the beginning of the file.
        offset: u64,
        /// Fault and remedy.
        problem: String,
    },
    /// The pixel data does not match the header.
    #[error("{path}: pixel data of frame {frame} (byte {offset} of the file): {problem}", path = .path.display())]
    Data {
        /// The file.
        path: PathBuf,
        /// Frame that could not be read completely, from 0.
        frame: u64,
        /// Position in the file up to which bytes were consumed.
        offset: u64,
        /// Fault and remedy.
        problem: String,
    },
    /// A stated limit was exceeded; no memory of that size was allocated.
    #[error("{path}: {what} is {value}, more than the limit of {limit}: {advice}", path = .path.display())]
    Limit {
        /// The file.
        path: PathBuf,
        /// Quantity that is too large.
        what: String,
        /// Value that the file claims.
        value: u128,
        /// The limit.
        limit: u128,
        /// Remedy.
        advice: &'static str,
    },
    /// The file is no image.
    #[error("{path}: {source}", path = .path.display())]
    NoImage {
        /// The file.
        path: PathBuf,
        /// Content found instead.
        source: NoImage,
    },
    /// The file is not a session of this program, or an empty one.
    #[error("{path}: {source}", path = .path.display())]
    NoSession {
        /// The file.
        path: PathBuf,
        /// Content found instead.
        source: NoSession,
    },
    /// A part of a session is lost.
    #[error("{path}: byte {}: {}, up to byte {}; repair the session", .damage.from, .damage.what, .damage.until, path = .path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// The lost part.
        damage: Damage,
    },
    /// A message of a session gives no reading.
    #[error("{path}: {source}", path = .path.display())]
    Message {
        /// The file.
        path: PathBuf,
        /// Reason.
        source: Unreadable,
    },
    /// This version does not know the messages of a topic.
    #[error("{path}: {topic} holds messages {schema:?}, which this version does not know; use the version that wrote the session", path = .path.display())]
    UnknownMessages {
        /// The file.
        path: PathBuf,
        /// The topic.
        topic: String,
        /// Schema of its messages.
        schema: String,
    },
    /// The content of a session contradicts itself or its devices.
    #[error("{path}: {problem}", path = .path.display())]
    Session {
        /// The file.
        path: PathBuf,
        /// Fault and remedy.
        problem: String,
    },
    /// The file cannot hold the given content.
    #[error("{path}: {source}", path = .path.display())]
    Unwritable {
        /// The file to be written.
        path: PathBuf,
        /// Content that does not fit.
        source: Unwritable,
    },
    /// A volume that another crate reads.
    #[error(transparent)]
    Volume(Box<dyn std::error::Error + Send + Sync>),
}

/// Devices that read files pass these errors on.
impl From<Error> for sonoweave_core::Error {
    fn from(error: Error) -> Self {
        Self::other(error)
    }
}

/// Returns the words for the place of a header's fault.
pub(crate) fn place(field: &str) -> String {
    let is_line = field.starts_with("line ") || field == "blank line";
    if is_line { field.to_owned() } else { format!("field {field}") }
}

/// Reason why a file is no image.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum NoImage {
    /// A file without content.
    #[error("is empty; copy or record it again")]
    Empty,
    /// A file of another kind, in words.
    #[error("is {0} and no image file; give one in MetaImage, NRRD, NIfTI or DICOM")]
    Foreign(&'static str),
}

/// Reason why a message gives no reading.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum Unreadable {
    /// The message does not match its schema.
    #[error("a message does not match its schema; use the version that wrote the session")]
    Malformed,
    /// The message has an unknown version.
    #[error("a message has version {0}, which this version does not know; use the version that wrote the session")]
    Version(u64),
    /// A frame's encoded pixels are invalid, with the fault.
    #[error("a frame has {0}; use the version that wrote the session")]
    Picture(&'static str),
    /// A frame is too large, with its size in bytes.
    #[error("a frame has {0} bytes, more than the limit; raise the limit if the file is trusted")]
    TooLarge(u64),
}

/// Reason why a file is not a session.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum NoSession {
    /// An MCAP file of another program.
    #[error(
        "is not a session of sonoweave but an MCAP file of profile {profile:?}, written by {library:?}; give a recorded session"
    )]
    Foreign {
        /// The file's profile.
        profile: String,
        /// The library that wrote the file.
        library: String,
    },
    /// An MCAP file of this program's profile, without a description of a session.
    #[error("is not a session of sonoweave: its first chunk does not describe one; give a recorded session")]
    Undescribed,
    /// The recording ended before its first chunk was on the disk.
    #[error("is an empty session: it ends before its first chunk; give a recorded session")]
    Empty,
    /// No chunk of MCAP was found.
    #[error("is not a session: the file has no complete chunk of MCAP; give a recorded session")]
    NoChunk,
}

/// Reason why a file cannot hold the given content.
#[derive(Debug, thiserror::Error)]
pub enum Unwritable {
    /// A sequence without items, or with images without pixels.
    #[error("a sequence must have at least one item, and its images at least one pixel along both axes")]
    EmptySequence,
    /// A volume without voxels.
    #[error("a volume must have at least one voxel along each axis, of at least one channel")]
    EmptyVolume,
    /// More bytes than 64 bits can count.
    #[error("the pixels would take more than 2⁶⁴ bytes; write fewer")]
    TooLarge,
    /// The position of a volume is invalid.
    #[error("a volume's spacing must be positive, and its origin and axes finite")]
    Place,
    /// An invalid number of channels.
    #[error("{0} channels were given; give 1 to 4")]
    Channels(u32),
    /// The file's name has an unknown ending.
    #[error("{content} are written as {endings}; give such a name")]
    FileName {
        /// `sequences` or `volumes`.
        content: &'static str,
        /// The known endings.
        endings: &'static str,
    },
    /// The name of a field is invalid.
    #[error(
        "{name:?} is not a valid field name: it must not be empty, hold {reserved} or line ends, begin with #, or begin or end in a space"
    )]
    FieldName {
        /// The name.
        name: String,
        /// Character that the format reserves.
        reserved: char,
    },
    /// The value of a field is invalid.
    #[error("the value {value:?} of field {name} must not hold line ends or begin or end in a space")]
    FieldValue {
        /// Name of the field.
        name: String,
        /// The value.
        value: String,
    },
    /// A field is given twice, or the writer sets it itself.
    #[error("field {0} is given twice, or is one that the writer sets itself; leave it out")]
    FieldTwice(String),
    /// The field of the spacing holds something else.
    #[error("field ElementSpacing is {0:?}; it must be two or three lengths")]
    Spacing(String),
    /// The names of two frames are the same in a file.
    #[error("the frame names {from:?} and {to:?} run together in {from}To{to}; begin the second with a capital letter")]
    FrameNames {
        /// Source frame.
        from: String,
        /// Target frame.
        to: String,
    },
    /// A time is NaN or infinite.
    #[error("the {name} of frame {frame} is {seconds}; it must be finite")]
    Time {
        /// Name of the field.
        name: &'static str,
        /// Number of the frame.
        frame: u64,
        /// The time, s.
        seconds: f64,
    },
    /// A status word that readers take as valid.
    #[error("the status {0:?} would read back as valid; give another word")]
    Status(String),
    /// The header would not be readable.
    #[error("the header would not be readable: {0}")]
    Header(String),
    /// A field's name has another meaning in the file.
    #[error("frame {0} would not read back as given: the name of one of its fields has another meaning; rename it")]
    Meaning(u64),
    /// A size that NIfTI-1 cannot hold.
    #[error("NIfTI-1 holds at most 32767 voxels along an axis, not {0}; write another format")]
    NiftiSize(u32),
    /// A voxel type that NIfTI-1 lacks.
    #[error(
        "NIfTI-1 has no voxels of {channels} channels of {pixel}, and colours only as 3 or 4 of u8; write another format"
    )]
    NiftiType {
        /// Channels of a voxel.
        channels: u32,
        /// Scalar type.
        pixel: sonoweave_core::reading::PixelType,
    },
    /// More fields than fit in the header of NIfTI-1.
    #[error("the fields take {0} bytes, more than a NIfTI-1 header can hold; write another format")]
    NiftiFields(usize),
    /// A frame has another size than the header states.
    #[error("a frame of {given} bytes was given, but it must have the {expected} that the header promises")]
    FrameSize {
        /// Bytes given.
        given: usize,
        /// Bytes stated.
        expected: u64,
    },
    /// The file was finished before all pixels were written.
    #[error("{written} of {expected} bytes of pixels were written; the file is not kept: write all before finishing")]
    Unfinished {
        /// Bytes written.
        written: u64,
        /// Bytes stated.
        expected: u64,
    },
    /// A device's name is taken or invalid in a session.
    #[error("the device name {0:?} is taken or invalid; give each device a name of its own, without slashes")]
    DeviceName(String),
    /// MCAP does not permit the content.
    #[error("MCAP does not permit this content: {0}; shorten names and notes")]
    Mcap(#[source] mcap::McapError),
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_name_file_problem_and_remedy() {
        let path = || PathBuf::from("f");
        let damage = Damage { from: 8, until: 20, what: "a chunk with a wrong checksum", is_loss: true };
        let limit =
            Error::Limit { path: path(), what: "the number of frames".into(), value: 9, limit: 8, advice: "split it" };
        let unknown = Error::UnknownMessages { path: path(), topic: "/a".into(), schema: "b".into() };
        let foreign = NoSession::Foreign { profile: "ros2".into(), library: "x".into() };
        let not_there = std::io::Error::new(std::io::ErrorKind::NotFound, "not there");
        let no_session = |source| Error::NoSession { path: path(), source };
        for (error, text) in [
            (Error::Io { path: path(), doing: "opening", source: not_there }, "f: opening failed: not there"),
            (limit, "f: the number of frames is 9, more than the limit of 8: split it"),
            (
                Error::Damaged { path: path(), damage },
                "f: byte 8: a chunk with a wrong checksum, up to byte 20; repair the session",
            ),
            (
                Error::Message { path: path(), source: Unreadable::Malformed },
                "f: a message does not match its schema; use the version that wrote the session",
            ),
            (
                unknown,
                "f: /a holds messages \"b\", which this version does not know; use the version that wrote the session",
            ),
            (Error::Session { path: path(), problem: "is odd".into() }, "f: is odd"),
            (
                no_session(foreign),
                "f: is not a session of sonoweave but an MCAP file of profile \"ros2\", written by \"x\"; give a recorded session",
            ),
            (
                no_session(NoSession::Undescribed),
                "f: is not a session of sonoweave: its first chunk does not describe one; give a recorded session",
            ),
            (
                no_session(NoSession::Empty),
                "f: is an empty session: it ends before its first chunk; give a recorded session",
            ),
            (
                no_session(NoSession::NoChunk),
                "f: is not a session: the file has no complete chunk of MCAP; give a recorded session",
            ),
        ] {
            assert_eq!(error.to_string(), text);
        }
    }

    #[test]
    fn unwritable_content_is_named() {
        let (name, value) = ("A".to_owned(), "x".to_owned());
        for (error, text) in [
            (
                Unwritable::EmptySequence,
                "a sequence must have at least one item, and its images at least one pixel along both axes",
            ),
            (Unwritable::EmptyVolume, "a volume must have at least one voxel along each axis, of at least one channel"),
            (Unwritable::TooLarge, "the pixels would take more than 2⁶⁴ bytes; write fewer"),
            (Unwritable::Place, "a volume's spacing must be positive, and its origin and axes finite"),
            (Unwritable::Channels(5), "5 channels were given; give 1 to 4"),
            (
                Unwritable::FileName { content: "volumes", endings: ".mha or .nii" },
                "volumes are written as .mha or .nii; give such a name",
            ),
            (
                Unwritable::FieldName { name: name.clone(), reserved: '=' },
                "\"A\" is not a valid field name: it must not be empty, hold = or line ends, begin with #, or begin or end in a space",
            ),
            (
                Unwritable::FieldValue { name: name.clone(), value: value.clone() },
                "the value \"x\" of field A must not hold line ends or begin or end in a space",
            ),
            (
                Unwritable::FieldTwice(name.clone()),
                "field A is given twice, or is one that the writer sets itself; leave it out",
            ),
            (Unwritable::Spacing(value.clone()), "field ElementSpacing is \"x\"; it must be two or three lengths"),
            (
                Unwritable::FrameNames { from: name, to: value },
                "the frame names \"A\" and \"x\" run together in ATox; begin the second with a capital letter",
            ),
            (
                Unwritable::Time { name: "Timestamp", frame: 3, seconds: f64::NAN },
                "the Timestamp of frame 3 is NaN; it must be finite",
            ),
            (Unwritable::Status("ok".into()), "the status \"ok\" would read back as valid; give another word"),
            (Unwritable::Header("field A: is odd".into()), "the header would not be readable: field A: is odd"),
            (
                Unwritable::Meaning(2),
                "frame 2 would not read back as given: the name of one of its fields has another meaning; rename it",
            ),
            (
                Unwritable::NiftiSize(40_000),
                "NIfTI-1 holds at most 32767 voxels along an axis, not 40000; write another format",
            ),
            (
                Unwritable::NiftiType { channels: 2, pixel: sonoweave_core::reading::PixelType::U8 },
                "NIfTI-1 has no voxels of 2 channels of u8, and colours only as 3 or 4 of u8; write another format",
            ),
            (
                Unwritable::NiftiFields(9),
                "the fields take 9 bytes, more than a NIfTI-1 header can hold; write another format",
            ),
            (
                Unwritable::FrameSize { given: 7, expected: 8 },
                "a frame of 7 bytes was given, but it must have the 8 that the header promises",
            ),
            (
                Unwritable::Unfinished { written: 7, expected: 8 },
                "7 of 8 bytes of pixels were written; the file is not kept: write all before finishing",
            ),
            (
                Unwritable::DeviceName("a/b".into()),
                "the device name \"a/b\" is taken or invalid; give each device a name of its own, without slashes",
            ),
        ] {
            assert_eq!(error.to_string(), text);
        }
    }
}
