//! Temporary files and folders of a batch. Their names tell the process that makes them, so that a
//! later run removes those of processes that were killed, and none of a process that still works.

use std::fs::{self, File};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::sync::LazyLock;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use formats::whole::{folder_of, sync_folder};

/// End of temporary names.
const END: &str = ".part";
/// Sign between the parts of a temporary name. No host's name has it.
const BETWEEN: char = '+';
/// Pauses while a killed process ends that still writes into a folder.
const PAUSES: u32 = 100;
const PAUSE: Duration = Duration::from_millis(20);

/// A process on a host.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Owner {
    pub(crate) host: String,
    pub(crate) process: u32,
    /// Time of its start, in ticks since the machine's: a later process may have its number.
    pub(crate) start: u64,
}

impl Owner {
    /// Returns this process.
    pub(crate) fn this() -> &'static Self {
        static THIS: LazyLock<Owner> = LazyLock::new(|| {
            let name = rustix::system::uname().nodename().to_string_lossy().replace([BETWEEN, '/'], "-");
            let process = std::process::id();
            Owner { host: name, process, start: start_of(process).unwrap_or(0) }
        });
        &THIS
    }

    /// Whether the process still runs; `None` if it is on another host.
    pub(crate) fn is_alive(&self) -> Option<bool> {
        (self.host == Self::this().host).then(|| start_of(self.process) == Some(self.start))
    }
}

/// Returns the time of a process's start; `None` if there is none, or it has ended.
fn start_of(process: u32) -> Option<u64> {
    let text = fs::read_to_string(format!("/proc/{process}/stat")).ok()?;
    // The name is between brackets, and may contain any sign.
    let fields: Vec<&str> = text.rsplit_once(')')?.1.split_whitespace().collect();
    let has_ended = matches!(*fields.first()?, "Z" | "X");
    if has_ended { None } else { fields.get(19)?.parse().ok() }
}

/// Returns a new temporary name in a folder.
pub(crate) fn temporary(folder: &Path, begins: &str) -> PathBuf {
    static COUNT: AtomicU64 = AtomicU64::new(0);
    let Owner { host, process, start } = Owner::this();
    let count = COUNT.fetch_add(1, Ordering::Relaxed);
    folder.join(format!(".{begins}{BETWEEN}{host}{BETWEEN}{process}{BETWEEN}{start}{BETWEEN}{count}{END}"))
}

/// Returns the process that made a temporary name; `None` for other names.
fn owner_of(name: &str) -> Option<Owner> {
    let parts: Vec<&str> = name.strip_prefix('.')?.strip_suffix(END)?.split(BETWEEN).collect();
    let [_, host, process, start, _] = parts[..] else { return None };
    Some(Owner { host: host.to_owned(), process: process.parse().ok()?, start: start.parse().ok()? })
}

/// Removes temporary files and folders of processes that have ended. `with_foreign` removes those
/// of other hosts, too: of a sweep that is done, nobody needs them.
///
/// # Errors
/// Errors of the file system.
pub(crate) fn clean(folder: &Path, with_foreign: bool) -> io::Result<()> {
    let entries = match fs::read_dir(folder) {
        // A file of that name is left to the try that needs the folder.
        Err(error) if matches!(error.kind(), io::ErrorKind::NotFound | io::ErrorKind::NotADirectory) => return Ok(()),
        entries => entries?,
    };
    for entry in entries {
        let entry = entry?;
        let Some(owner) = entry.file_name().to_str().and_then(owner_of) else { continue };
        if !owner.is_alive().unwrap_or(!with_foreign) {
            remove(&entry.path())?;
        }
    }
    Ok(())
}

/// Removes a file or a folder with its content; it may be gone already.
///
/// # Errors
/// Errors of the file system.
pub(crate) fn remove(path: &Path) -> io::Result<()> {
    let is_folder = path.symlink_metadata().is_ok_and(|there| there.is_dir());
    for pause in 0.. {
        match if is_folder { fs::remove_dir_all(path) } else { fs::remove_file(path) } {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(()),
            Err(error) if error.kind() == io::ErrorKind::DirectoryNotEmpty && pause < PAUSES => {
                std::thread::sleep(PAUSE);
            }
            done => return done,
        }
    }
    Ok(())
}

/// Writes a file, whole or not at all; replaces an existing file.
///
/// # Errors
/// Errors of the file system; an existing file is unchanged then.
pub(crate) fn write(path: &Path, content: &[u8]) -> io::Result<()> {
    let folder = folder_of(path);
    let part = temporary(folder, "file");
    let written = File::options().write(true).create_new(true).open(&part).and_then(|mut file| {
        file.write_all(content)?;
        file.sync_all()?;
        fs::rename(&part, path)
    });
    if written.is_err() {
        // A full disk gets its room back; the first error counts.
        let _ = fs::remove_file(&part);
    }
    written?;
    sync_folder(folder)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_tell_their_process() {
        let folder = Path::new("f");
        let (one, other) = (temporary(folder, "a"), temporary(folder, "a"));
        assert_ne!(one, other);
        let owner = owner_of(one.file_name().unwrap().to_str().unwrap()).unwrap();
        assert_eq!((&owner, owner.is_alive()), (Owner::this(), Some(true)));
        assert_eq!(Owner { start: owner.start + 1, ..owner.clone() }.is_alive(), Some(false), "a later process");
        assert_eq!(Owner { host: "elsewhere".into(), ..owner }.is_alive(), None);
        for name in ["done.json", ".a.part", ".a+b+c+1+2.part", ".sonoweave-x.part"] {
            assert_eq!(owner_of(name), None, "{name}");
        }
    }

    #[test]
    fn only_files_of_ended_processes_are_removed() {
        let place = tempfile::tempdir().unwrap();
        let Owner { host, process, start } = Owner::this();
        let names = [
            format!(".a+{host}+{process}+{}+0.part", start + 1),
            format!(".a+elsewhere+{process}+{start}+0.part"),
            format!(".a+{host}+{process}+{start}+0.part"),
            "kept".into(),
        ];
        let make = |name: &String| {
            fs::create_dir_all(place.path().join(name)).unwrap();
            fs::write(place.path().join(name).join("inner"), "x").unwrap();
        };
        let left = || names.each_ref().map(|name| place.path().join(name).exists());
        names.iter().for_each(make);
        clean(place.path(), false).unwrap();
        assert_eq!(left(), [false, true, true, true]);
        names.iter().for_each(make);
        clean(place.path(), true).unwrap();
        assert_eq!(left(), [false, false, true, true]);
        clean(&place.path().join("none"), true).unwrap();
    }
}
