//! Session settings: pairing of frames with poses, recording, and status.

use std::net::{IpAddr, SocketAddr};
use std::path::PathBuf;

use calibration::file::preset::{Preset, Ruler};
use sonoweave_core::keys::FileError;

use super::reader::Reader;
use crate::values;

/// Pairing of frames with poses.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Pairing {
    /// Longest time that a frame waits for poses around its time, ns.
    pub wait_ns: i64,
    /// Longest time between two poses for interpolation, ns.
    pub longest_gap_ns: i64,
}

impl Pairing {
    pub(super) fn read(mut keys: Reader<'_, '_>) -> Result<Self, FileError> {
        Ok(Self {
            wait_ns: keys.ms("wait_ms", 500.0, 0.0..=10_000.0)?,
            longest_gap_ns: keys.ms("longest_gap_ms", 100.0, 1.0..=10_000.0)?,
        })
    }
}

/// The ultrasound scanner.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Scanner {
    /// Time of equal images at changing poses after which the scanner counts as stuck, ns.
    pub stuck_after_ns: i64,
}

impl Scanner {
    pub(super) fn read(mut keys: Reader<'_, '_>, preset: Option<&Preset>) -> Result<Self, FileError> {
        let frozen_s = keys.number("frozen_s", 0.5, 0.05..=60.0)?;
        let ruler = keys.entry("ruler").map(|entry| Ruler::read(&entry)).transpose()?;
        keys.notes("ruler", &ruler.map(|Ruler { px, mm }| [px, mm]));
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
    pub(super) fn read(mut keys: Reader<'_, '_>) -> Result<Self, FileError> {
        Ok(Self {
            folder: keys.text_if("folder")?.map(|folder| keys.path_of(&folder)),
            full_frame: keys.truth("full_frame", false)?,
            keep_free_bytes: u64::from(keys.whole("keep_free_mb", 1024, 0..=u32::MAX)?) * 1_000_000,
        })
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
    pub(super) fn read(mut keys: Reader<'_, '_>) -> Result<Self, FileError> {
        let listen = keys.value_if("listen", |entry| values::address(entry.text()?).map_err(|why| entry.error(why)))?;
        let mut path = |key| keys.text_if(key).map(|told| told.map(|told| keys.path_of(&told)));
        let [certificate, key, token_file] = [path("certificate")?, path("key")?, path("token_file")?];
        let names = keys.value("names", Vec::new(), |entry| {
            let items = entry.items("a list of names, such as [\"bedside-3.local\"]")?;
            items
                .iter()
                .map(|item| item.text().and_then(|name| host_name(name).map_err(|why| item.error(why))))
                .collect()
        })?;
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

/// Real-time scheduling, and memory that is not paged out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Realtime {
    /// Used as far as the system permits it.
    IfPermitted,
    /// Not even if it is permitted.
    Never,
    /// Required: no session runs without it.
    Required,
}

/// The session among the machine's other programs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Process {
    /// Whether it runs with real-time scheduling.
    pub realtime: Realtime,
}

impl Process {
    const USUAL: &'static str = "if-permitted";

    pub(super) fn read(mut keys: Reader<'_, '_>) -> Result<Self, FileError> {
        let names =
            [(Self::USUAL, Realtime::IfPermitted), ("never", Realtime::Never), ("required", Realtime::Required)];
        Ok(Self { realtime: keys.choice("realtime", Self::USUAL, &names)? })
    }
}
