//! A recorded session, as its replay pairs it.

use std::path::{Path, PathBuf};
use std::sync::{Mutex, OnceLock, PoisonError};

use config::Settings as Config;
use config::bedside::Bedside;
use drivers::replay::{Pace, SequenceSettings};
use pipeline::OffPlane;
use pipeline::session::{PairedFrame, Recorded};
use sonoweave_core::slice::Image;

use super::{Keywords, LibraryError};
use crate::app::correct;
use crate::app::live::resume::Chain;
use crate::app::live::stages::{Kept, stages};
use crate::app::reconstruct::sweep::Sweep;
use crate::app::replay::reel::{Reel, Still};
use crate::failure::Failure;

/// Keyword of another session configuration.
const CONFIG: &str = "config";
/// Keywords of a reconstruction that change no bit of a session's volume.
const OF_MACHINE: [&str; 3] = ["threads", "simd", "max_memory"];

/// A recorded session. Its own configuration, or another one, has all its settings.
pub(super) struct RecordedSession {
    path: PathBuf,
    config: Option<PathBuf>,
    reel: Mutex<Reel>,
    pub(super) count: u64,
    /// World of the poses, and the route to it.
    pub(super) world: [String; 2],
    /// Frames in the order of their numbers, paired when they are asked for.
    paired: OnceLock<Vec<PairedFrame>>,
}

/// A session, opened for one run.
pub(super) struct Opened {
    pub(super) sweep: Sweep,
    pub(super) recorded: Recorded,
    /// Sessions that it continues, the earliest first.
    pub(super) resumed: Vec<Recorded>,
}

impl RecordedSession {
    /// Opens a session. The only keyword is `config`, another session configuration.
    ///
    /// # Errors
    /// [`LibraryError`] when it cannot be read, or has no frames, no configuration, or no route to
    /// the world.
    pub(super) fn open(path: &Path, keywords: &Keywords) -> Result<Self, LibraryError> {
        if let Some(name) = keywords.names().find(|name| *name != CONFIG) {
            return Err(LibraryError::Input(format!(
                "{name}: a session has settings of its own; give others by a session configuration as config"
            )));
        }
        let config = keywords.value(CONFIG).map(PathBuf::from);
        let reel = Reel::open(path).map_err(|failure| LibraryError::of_failure(path, failure))?;
        let count = reel.count() as u64;
        if count == 0 {
            return Err(LibraryError::Input(format!(
                "{}: the session has no frames; give one with a scanner's frames",
                path.display()
            )));
        }
        let world = [String::new(), String::new()];
        let session =
            Self { path: path.to_owned(), config, reel: Mutex::new(reel), count, world, paired: OnceLock::new() };
        let Opened { sweep, recorded, .. } = session.opened(&Keywords::default())?;
        let world = sweep.session.world(&recorded.roles).map_err(|error| LibraryError::of_run(path, error))?;
        Ok(Self { world, ..session })
    }

    /// Opens it for one run, by its own settings. A reconstruction's keywords that concern the
    /// machine count, and others are refused.
    ///
    /// # Errors
    /// [`LibraryError`] when a setting does not fit, or the file cannot be read.
    pub(super) fn opened(&self, keywords: &Keywords) -> Result<Opened, LibraryError> {
        if let Some(name) = keywords.names().find(|name| !OF_MACHINE.contains(name)) {
            return Err(LibraryError::Input(format!(
                "{name}: a session is reconstructed by settings of its own; leave it out, or open the session with \
                another configuration"
            )));
        }
        let open = || -> Result<Opened, Failure> {
            let own = keywords.flags()?.sweep(&self.path)?.session.settings;
            let mut chain = Chain::read(&self.path)?;
            let (_, decisions) = chain.last();
            let bedside = match &self.config {
                Some(path) => Bedside::read(path).map_err(Failure::configuration)?,
                None => Kept::bedside(&self.path, decisions)?,
            };
            let mut session = stages(&bedside, None)?;
            let settings = &mut session.settings;
            if keywords.has("threads") {
                settings.threads = own.threads;
            }
            if keywords.has("simd") {
                settings.simd = own.simd;
            }
            if keywords.has("max_memory") {
                settings.memory_bytes = own.memory_bytes;
            }
            for sentence in correct::apply(&mut chain, self.config.is_some().then_some(&bedside))? {
                tracing::info!("{sentence}");
            }
            let mut resumed = chain.recorded(self.config.is_some().then_some(&bedside), Pace::Unpaced)?;
            let Some(recorded) = resumed.pop() else { unreachable!("a chain has a session") };
            let (input, config) = (SequenceSettings::new(&self.path), Config::default());
            let sweep = Sweep { input, frames: 0..u64::MAX, off_plane: OffPlane::Settings, session, config };
            Ok(Opened { sweep, recorded, resumed })
        };
        open().map_err(|failure| LibraryError::of_failure(&self.path, failure))
    }

    /// Whether its replay is to have the recorded results.
    pub(super) fn is_unchanged(&self) -> bool {
        self.config.is_none()
    }

    /// Returns time and pose of each frame, or the reason why it has none.
    ///
    /// # Errors
    /// [`LibraryError`] when the file cannot be read.
    pub(super) fn paired(&self) -> Result<&[PairedFrame], LibraryError> {
        if let Some(paired) = self.paired.get() {
            return Ok(paired);
        }
        let Opened { sweep, recorded, .. } = self.opened(&Keywords::default())?;
        let paired = sweep.session.pair(recorded).map_err(|error| LibraryError::of_run(&self.path, error))?.frames;
        if paired.len() as u64 != self.count {
            return Err(LibraryError::Input(format!(
                "{}: has {} frames, but {} different numbers of frames; repair it by `sonoweave repair`",
                self.path.display(),
                self.count,
                paired.len()
            )));
        }
        Ok(self.paired.get_or_init(|| paired.into_values().collect()))
    }

    /// Reads a frame by its place.
    ///
    /// # Errors
    /// [`LibraryError`] when it cannot be read, or is no usable picture.
    pub(super) fn picture(&self, place: usize) -> Result<Image, LibraryError> {
        let mut reel = self.reel.lock().unwrap_or_else(PoisonError::into_inner);
        let Still { image, .. } = reel
            .still(place)
            .map_err(|problem| LibraryError::Input(format!("{}: frame {place}: {problem}", self.path.display())))?;
        Ok(image)
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;
    use std::path::PathBuf;
    use std::sync::atomic::AtomicBool;

    use crate::library::{Keywords, Reconstruction, Recording};

    fn session(name: &str) -> Recording {
        let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/recordings/sessions").join(name);
        Recording::open(&path, Keywords::default()).unwrap()
    }

    #[test]
    fn session_has_poses_and_volume_of_its_replay() {
        for (name, frozen) in [("arm.mcap", 0), ("commands.mcap", 17), ("demo.mcap", 0)] {
            let session = session(name);
            let poses = session.poses().unwrap();
            let mut reasons: BTreeMap<&str, u64> = BTreeMap::new();
            poses.status.iter().for_each(|status| *reasons.entry(status).or_default() += 1);
            assert_eq!((poses.status.len() as u64, reasons.remove("frozen").unwrap_or(0)), (session.count(), frozen));
            let mut volume = Reconstruction::new(Keywords::default()).unwrap();
            let ledger = volume.insert_all(&session, &AtomicBool::new(false), |_| ()).unwrap();
            assert_eq!(
                (reasons.remove("ok"), session.count()),
                (Some(ledger.frames.used), ledger.frames.total),
                "{name}"
            );
            assert_eq!(reasons.values().sum::<u64>() + frozen, ledger.refused_total(), "{name}");
            let notes = volume.snapshot().unwrap().unwrap().notes();
            assert!(!notes.iter().any(|note| note.contains("differs")), "{notes:?}");
            let timed = poses.times_s.iter().filter(|time| time.is_finite()).count();
            assert_eq!(timed as u64, ledger.frames.used, "{name}");
        }
    }
}
