//! One error type for all drivers.

use std::path::PathBuf;

/// What went wrong with a device or a recording. The display is a sentence that says what, where and what to do.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The file cannot be read or written at all.
    #[error("{path}: {doing} failed: {source}", path = path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What was being done.
        doing: &'static str,
        /// The system's reason.
        #[source]
        source: std::io::Error,
    },
    /// A field of a file's header is missing, malformed or contradicts another.
    #[error("{path}: field {field} (byte {offset}): {problem}", path = path.display())]
    Header {
        /// The file.
        path: PathBuf,
        /// The field's name as in the file.
        field: String,
        /// Where the field begins, in bytes from the beginning of the file.
        offset: u64,
        /// What is wrong and what to do.
        problem: String,
    },
    /// The pixel data is not what the header promises.
    #[error("{path}: pixel data of frame {frame} (byte {offset} of the file): {problem}", path = path.display())]
    Data {
        /// The file.
        path: PathBuf,
        /// The frame that could not be read whole, from 0.
        frame: u64,
        /// Position in the file up to which bytes were consumed.
        offset: u64,
        /// What is wrong and what to do.
        problem: String,
    },
    /// A session's file is none, or is not what its checksums and numbers say.
    #[error("{path}: byte {offset}: {problem}", path = path.display())]
    Session {
        /// The file.
        path: PathBuf,
        /// Where, in bytes from the beginning of the file.
        offset: u64,
        /// What is wrong and what to do.
        problem: String,
    },
    /// A stated limit was exceeded; nothing of that size was allocated.
    #[error("{path}: {what} is {value}, more than the limit of {limit}: {advice}", path = path.display())]
    Limit {
        /// The file.
        path: PathBuf,
        /// What is too large.
        what: String,
        /// How large it claims to be.
        value: u128,
        /// The limit.
        limit: u128,
        /// What to do.
        advice: &'static str,
    },
    /// The call does not fit the device's state or kind.
    #[error("{0}")]
    Misuse(String),
}
