//! Flags of the OpenIGTLink server.

use std::net::SocketAddr;
use std::path::PathBuf;

use clap::Args;
use ipnet::IpNet;

use super::values;
use crate::app::igtl::Sharing;

/// Flags of the OpenIGTLink server.
#[derive(Debug, Clone, Args)]
pub(super) struct SharingFlags {
    /// Serve slices, sensors and the volume over OpenIGTLink (3D Slicer, PLUS) at this address.
    /// Other machines need an allowed network. Without an address: on this machine only
    #[arg(long, value_name = "ADDR:PORT", num_args = 0..=1, require_equals = true, default_missing_value = "127.0.0.1:18944")]
    igtl: Option<SocketAddr>,
    /// Networks of other machines that may connect and see the data, such as 192.168.0.0/24,
    /// besides those that the configuration of live lists [default: none]
    #[arg(long, value_name = "NETWORK", requires = "igtl", value_delimiter = ',', value_parser = values::network)]
    igtl_allow: Vec<IpNet>,
    /// Folder for the volumes that clients on this machine save with the command save; it is
    /// created if missing [default: saving is disabled]
    #[arg(long, value_name = "DIR", requires = "igtl")]
    igtl_save: Option<PathBuf>,
    /// Begin only when a client on this machine sends the command start
    #[arg(long, requires = "igtl")]
    igtl_wait: bool,
}

impl SharingFlags {
    /// Returns the server's settings.
    pub(super) fn sharing(&self) -> Sharing {
        let (save, allow) = (self.igtl_save.clone(), self.igtl_allow.clone());
        Sharing { address: self.igtl, allow, save, waits: self.igtl_wait }
    }
}
