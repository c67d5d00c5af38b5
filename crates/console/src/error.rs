//! Reasons why the console cannot start.

use std::io;
use std::net::SocketAddr;
use std::path::PathBuf;

/// Reasons why the console cannot start. They name keys of the session configuration.
#[derive(Debug, thiserror::Error)]
pub enum ConsoleError {
    /// Other machines can reach the address, but keys are missing.
    #[error(
        "status.listen: other machines can reach {address}, and [status] has no {missing}: give {those}, or listen at \
        127.0.0.1. `certificate` and `key` are PEM files for TLS; `token_file` holds one line of {least} characters or \
        more",
        least = crate::token::LEAST
    )]
    Open {
        /// The configured address.
        address: SocketAddr,
        /// Missing keys, as a list.
        missing: String,
        /// "it" or "them", for the message.
        those: &'static str,
    },
    /// A certificate without a key, or a key without a certificate.
    #[error("status.{has}: has no effect without {lacks}; give both, or neither")]
    Half {
        /// The key that is given.
        has: &'static str,
        /// The key that is missing.
        lacks: &'static str,
    },
    /// An unusable file.
    #[error("status.{key}: {path}: {problem}", path = path.display())]
    File {
        /// The configuration's key.
        key: &'static str,
        /// The configured path.
        path: PathBuf,
        /// The problem, and its remedy.
        problem: String,
    },
    /// The address cannot be bound.
    #[error("status.listen: cannot listen at {address}: {source}; {}", advice(source))]
    Taken {
        /// The configured address.
        address: SocketAddr,
        /// The reason.
        source: io::Error,
    },
    /// The thread or its event loop cannot be created.
    #[error("status.listen: cannot start the server's thread: {0}")]
    Thread(io::Error),
}

fn advice(error: &io::Error) -> &'static str {
    match error.kind() {
        io::ErrorKind::AddrInUse => "another session or program uses this port; end it, or give another port",
        io::ErrorKind::PermissionDenied => "ports below 1024 are reserved for the administrator; give a higher one",
        _ => "give 127.0.0.1 with a free port",
    }
}
