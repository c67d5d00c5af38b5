//! Session settings: pairing of frames with poses, recording, and status.

use std::net::{IpAddr, SocketAddr};
use std::path::PathBuf;

use calibration::file::preset::{Preset, Ruler};

use super::reader::Reader;
use super::schema::{self, values::ns};
use crate::{Error, values};

pub use super::schema::session::Realtime;

/// Pairing of frames with poses.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Pairing {
    /// Longest time that a frame waits for poses around its time, ns.
    pub wait_ns: i64,
    /// Longest time between two poses for interpolation, ns.
    pub longest_gap_ns: i64,
}

impl Pairing {
    pub(super) fn read(mut keys: Reader<'_, '_>) -> Result<Self, Error> {
        let schema::session::Pairing { wait_ms, longest_gap_ms } = keys.read()?;
        Ok(Self { wait_ns: ns(wait_ms), longest_gap_ns: ns(longest_gap_ms) })
    }
}

/// The ultrasound scanner.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Scanner {
    /// Time of equal images at changing poses after which the scanner counts as stuck, ns.
    pub stuck_after_ns: i64,
}

impl Scanner {
    pub(super) fn read(mut keys: Reader<'_, '_>, preset: Option<&Preset>) -> Result<Self, Error> {
        let schema::session::Scanner { frozen_s, ruler } = keys.read()?;
        let ruler = ruler.and_then(|ruler| Ruler::new(ruler.px, ruler.mm));
        keys.note("ruler", &ruler.map(|Ruler { px, mm }| [px, mm]));
        if let Some(Err(misfit)) = preset.map(|preset| preset.fits(None, ruler)) {
            return Err(keys.error("ruler", misfit.to_string()));
        }
        Ok(Self { stuck_after_ns: (frozen_s * 1e9).round() as i64 })
    }
}

/// The recording.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Record {
    /// Folder for recorded sessions, if they are recorded.
    pub folder: Option<PathBuf>,
    /// Keep the whole video frame.
    pub full_frame: bool,
    /// Free disk space at which the recording ends, bytes.
    pub keep_free_bytes: u64,
}

impl Record {
    pub(super) fn read(mut keys: Reader<'_, '_>) -> Result<Self, Error> {
        let schema::session::Record { folder, full_frame, keep_free_mb } = keys.read()?;
        Ok(Self { folder: keys.path_if(folder), full_frame, keep_free_bytes: u64::from(keep_free_mb) * 1_000_000 })
    }
}

/// Publication of the session's status.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Status {
    /// Address; `None` if it is not published.
    pub listen: Option<SocketAddr>,
    /// Access control.
    pub access: Access,
}

/// Access control and names of the browser console. Its files are read when the session begins,
/// and are not part of the recording.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Access {
    /// The server's certificate, and those between it and one that browsers know; PEM.
    pub certificate: Option<PathBuf>,
    /// Its private key, PEM.
    pub key: Option<PathBuf>,
    /// The file of the token that clients must present.
    pub token_file: Option<PathBuf>,
    /// Names and addresses of this machine besides those of the certificate, in lower case.
    pub names: Vec<String>,
}

impl Status {
    pub(super) fn read(mut keys: Reader<'_, '_>) -> Result<Self, Error> {
        let given: schema::session::Status = keys.read()?;
        let listen = given.listen.map(|listen| values::address(&listen)).transpose();
        let listen = listen.map_err(|why| keys.error("listen", why.to_string()))?;
        let [certificate, key, token_file] =
            [given.certificate, given.key, given.token_file].map(|path| keys.path_if(path));
        let names = given.names.iter().enumerate();
        let names = names.map(|(n, name)| host_name(name).map_err(|why| keys.error(&format!("names[{n}]"), why)));
        let names = names.collect::<Result<Vec<_>, _>>()?;
        keys.note("names", &names);
        Ok(Self { listen, access: Access { certificate, key, token_file, names } })
    }
}

/// Parses a machine's name or address, as browsers write it.
fn host_name(text: &str) -> Result<String, String> {
    let name = text.to_ascii_lowercase();
    let is_name = name.len() <= 253
        && name.split('.').all(|part| {
            (1..=63).contains(&part.len())
                && part.bytes().all(|b| b.is_ascii_alphanumeric() || matches!(b, b'-' | b'_'))
        });
    let is_address = name.parse::<IpAddr>().is_ok();
    if is_name || is_address {
        return Ok(name);
    }
    Err(format!(
        "\"{text}\" is not a machine's name; give the name in the browser's address, without a port, such as \
        \"bedside-3.local\""
    ))
}

/// The session among the machine's other programs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Process {
    /// Whether it runs with real-time scheduling.
    pub realtime: Realtime,
}

impl Process {
    pub(super) fn read(mut keys: Reader<'_, '_>) -> Result<Self, Error> {
        let schema::session::Process { realtime } = keys.read()?;
        Ok(Self { realtime: realtime.0 })
    }
}
