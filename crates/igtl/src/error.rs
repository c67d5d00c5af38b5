//! Errors of the server, and of its clients' commands.

use std::io;
use std::net::SocketAddr;

/// Reasons why the server cannot start, or refuses a command.
#[derive(Debug, thiserror::Error)]
pub enum IgtlError {
    /// The address cannot be bound.
    #[error("cannot listen at {address}: {source}; give another port, or end the program that uses this one")]
    Taken {
        /// The requested address.
        address: SocketAddr,
        /// The reason.
        source: io::Error,
    },
    /// Other machines reach the address, and none is allowed.
    #[error(
        "cannot listen at {address}, which other machines can reach, as no network is allowed; list the clients' \
        networks under allow in [igtl], such as [\"192.168.0.0/24\"], or listen at 127.0.0.1"
    )]
    NoNetwork {
        /// The requested address.
        address: SocketAddr,
    },
    /// The thread or its event loop cannot be created.
    #[error("cannot start the server's thread: {0}")]
    Thread(io::Error),
    /// A command from another machine.
    #[error("only clients on this machine may send commands; run the client here, or through a tunnel")]
    NotLocal,
    /// An unknown command.
    #[error("the command is unknown; give start, stop, save, freeze, unfreeze or clear")]
    UnknownCommand,
    /// `start` while the session runs.
    #[error("the session runs already; stop it first to start another")]
    Running,
    /// A command that changes the volume of a replay.
    #[error("the session is a replay, which cannot be changed; give start, stop or save")]
    NotLive,
    /// The session's reason why it cannot follow now.
    #[error("{0}")]
    Refused(String),
    /// `save` without a folder.
    #[error("there is no folder to save in; start the session with one")]
    NoFolder,
    /// `save` without a volume.
    #[error("there is no volume yet; start the session, or wait for its first slice")]
    NoVolume,
    /// The session's reason why a volume cannot be read or saved.
    #[error("{0}")]
    Volume(String),
}
