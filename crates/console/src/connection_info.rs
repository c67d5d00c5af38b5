//! The connection of a request, as its handlers see it.

use std::net::SocketAddr;

/// The connection of a request.
#[derive(Debug, Clone, Copy)]
pub(super) struct ConnectionInfo {
    /// Local address.
    pub(super) local: SocketAddr,
    /// Remote address.
    pub(super) peer: SocketAddr,
    /// Whether the connection is encrypted by TLS.
    pub(super) secured: bool,
}
