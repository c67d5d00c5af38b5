//! One error type for all drivers.

use std::path::PathBuf;

/// Error of a device or a recording. Its text is a sentence that names the fault, its location
/// and the remedy.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The file cannot be read or written at all.
    #[error("{path}: {doing} failed: {source}", path = path.display())]
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
    #[error("{path}: field {field} (byte {offset}): {problem}", path = path.display())]
    Header {
        /// The file.
        path: PathBuf,
        /// Field name, as in the file.
        field: String,
        /// Position of the field, in bytes from the beginning of the file.
        offset: u64,
        /// Fault and remedy.
        problem: String,
    },
    /// The pixel data does not match the header.
    #[error("{path}: pixel data of frame {frame} (byte {offset} of the file): {problem}", path = path.display())]
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
    /// The file is no session, or contradicts its checksums and numbers.
    #[error("{path}: byte {offset}: {problem}", path = path.display())]
    Session {
        /// The file.
        path: PathBuf,
        /// Position of the fault, in bytes from the beginning of the file.
        offset: u64,
        /// Fault and remedy.
        problem: String,
    },
    /// A stated limit was exceeded; no memory of that size was allocated.
    #[error("{path}: {what} is {value}, more than the limit of {limit}: {advice}", path = path.display())]
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
    /// The call does not fit the device's state or kind.
    #[error("{0}")]
    Misuse(String),
}
