//! The session: how frames find their poses, what is recorded, what is told.

use std::net::SocketAddr;
use std::path::PathBuf;

use calibration::file::preset::{Preset, Ruler};
use calibration::keys::FileError;

use super::reader::Reader;
use crate::config::values;

/// How a frame finds its pose.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Pairing {
    /// For how long a frame waits for poses around its time, ns.
    pub wait_ns: i64,
    /// The longest time between two poses that a pose is made between, ns.
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
    /// After how long a time of equal pictures at changing poses it counts as frozen, ns.
    pub frozen_ns: i64,
}

impl Scanner {
    pub(super) fn read(mut keys: Reader<'_, '_>, preset: Option<&Preset>) -> Result<Self, FileError> {
        let frozen_s = keys.number("frozen_s", 0.5, 0.05..=60.0)?;
        let ruler = keys.entry("ruler").map(|entry| Ruler::read(&entry)).transpose()?;
        keys.notes("ruler", &ruler.map(|Ruler { px, mm }| [px, mm]));
        if let Some(Err(misfit)) = preset.map(|preset| preset.fits(None, ruler)) {
            return Err(keys.error("ruler", misfit.to_string()));
        }
        Ok(Self { frozen_ns: (frozen_s * 1e9).round() as i64 })
    }
}

/// The recording.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Record {
    /// Where sessions are recorded, if they are.
    pub folder: Option<PathBuf>,
    /// Keep the whole video frame.
    pub full_frame: bool,
    /// It ends before less is left on the disk, bytes.
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

/// What the session tells of itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Status {
    /// Where, on this machine only; nowhere for `None`.
    pub listen: Option<SocketAddr>,
}

impl Status {
    pub(super) fn read(mut keys: Reader<'_, '_>) -> Result<Self, FileError> {
        let listen =
            keys.value_if("listen", |entry| values::loopback(entry.text()?).map_err(|why| entry.error(why)))?;
        Ok(Self { listen })
    }
}

/// Real time, and memory that is not paged out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Realtime {
    /// As far as the system permits it.
    IfPermitted,
    /// Not even then.
    Never,
    /// No session without it.
    Required,
}

/// The session among the machine's other programs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Process {
    /// Whether it runs in real time.
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
