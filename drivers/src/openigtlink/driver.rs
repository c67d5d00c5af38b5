//! Finds and opens OpenIGTLink servers.

use std::sync::Arc;

use sonoweave_core::Device;
use sonoweave_core::clock::Clock;

use super::client::{Client, RemoteSettings};
use crate::connection::Connection;
use crate::transport::TcpOpener;
use crate::{Error, Listing};

/// The registered port of the protocol.
pub const PORT: u16 = 18944;

/// Opens a server with the given clock, which must advance by itself.
///
/// # Errors
/// [`Error::Setting`] for invalid settings.
pub fn open(settings: &RemoteSettings, clock: Arc<dyn Clock>) -> Result<Box<dyn Device>, Error> {
    let client = Client::new(settings.clone())?;
    let opener = TcpOpener::new(&settings.address, Arc::clone(&clock));
    Ok(Box::new(Connection::new(Box::new(opener), clock, client, false)))
}

/// Lists the server on this machine, at the usual port, if the kernel reports a listening
/// socket. Connects to no server.
pub fn list() -> Vec<Listing> {
    let listens = ["/proc/net/tcp", "/proc/net/tcp6"]
        .iter()
        .filter_map(|path| std::fs::read_to_string(path).ok())
        .any(|table| listens(&table, PORT));
    let listing = || Listing {
        id: format!("openigtlink:127.0.0.1:{PORT}"),
        description: "OpenIGTLink server on this machine".into(),
        unavailable: None,
    };
    listens.then(listing).into_iter().collect()
}

/// Returns whether the kernel's table of sockets has one that listens at a port.
fn listens(table: &str, port: u16) -> bool {
    let port = format!(":{port:04X}");
    table.lines().skip(1).any(|line| {
        let mut fields = line.split_whitespace().skip(1);
        // Own address, remote address, and state, which is 0A for a listening socket.
        let (own, state) = (fields.next(), fields.nth(1));
        own.is_some_and(|own| own.ends_with(&port)) && state == Some("0A")
    })
}

#[cfg(test)]
mod tests {
    use sonoweave_core::clock::Manual;

    use super::*;

    #[test]
    fn server_is_listed_from_kernel_socket_table() {
        let table = "  sl  local_address rem_address   st tx_queue\n   0: 0100007F:4A00 00000000:0000 0A 0:0\n   1: 0100007F:0016 0100007F:4A00 01 0:0\n";
        assert!(listens(table, PORT));
        assert!(!listens(table, 22), "connected, and does not listen");
        assert!(!listens(table, 80));
    }

    #[test]
    fn invalid_settings_are_refused() {
        let refused = |settings| match open(&settings, Arc::new(Manual::at(0))).err().unwrap() {
            Error::Setting { device: "remote", setting, problem } => (setting, problem),
            other => panic!("{other}"),
        };
        let transforms = Some(super::super::RemoteTransforms::default());
        for address in ["", "plus", ":18944", "plus:", "plus:99999"] {
            let settings = RemoteSettings { address: address.into(), transforms: transforms.clone(), pictures: None };
            let (setting, why) = refused(settings);
            assert!(setting == "address" && why.contains("HOST:PORT"), "{why}");
        }
        let address = "plus:18944".to_owned();
        let (_, why) = refused(RemoteSettings { address: address.clone(), ..RemoteSettings::default() });
        assert_eq!(why, "neither pictures nor transforms are requested; request one of them");
        let names = vec!["AVeryLongNameOfAFrameToTracker".to_owned()];
        let transforms = Some(super::super::RemoteTransforms { names, interval_ms: 0 });
        let (setting, why) = refused(RemoteSettings { address, transforms, pictures: None });
        assert!(setting == "transforms" && why.contains("has 30 bytes"), "{why}");
    }
}
