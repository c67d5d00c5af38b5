//! The devices of a session, by their roles.

use formats::session::LineProtocol;
use sonoweave_core::Device;
use sync::ingest::live::Gives;

/// Description of a device for pairing.
pub struct DeviceRole {
    /// Its name, in the recording too.
    pub name: String,
    /// The kind of its readings.
    pub gives: Gives,
    /// For each of its pose sources, the coordinate frames between which the pose maps: from and
    /// to.
    pub frames: Vec<[String; 2]>,
    /// Latency of its times beyond what its driver knows, ns.
    pub latency_ns: i64,
}

/// A device of a session.
pub struct SessionDevice {
    /// Its description.
    pub role: DeviceRole,
    /// The device, stopped.
    pub device: Box<dyn Device>,
    /// Protocol of its lines, if their bytes are recorded as readings, too.
    pub protocol: Option<LineProtocol>,
}
