//! The folder of an unfinished volume, and how it gets the volume's name.

use std::ffi::OsString;
use std::fs;
use std::io::{self, ErrorKind, Write as _};
use std::path::{Path, PathBuf};

use formats::whole::{folder_of, sync_folder, temporary};
use rustix::fs::{CWD, RenameFlags, renameat_with};
use rustix::io::Errno;

use crate::error::OmeZarrError;
use crate::metadata::FILE;

/// Ending of the unfinished volume's name.
const UNFINISHED: &str = ".part";
/// Metadata file of earlier versions' groups.
const EARLIER_FILE: &str = ".zgroup";

/// Returns the folder in which a volume is written.
pub(crate) fn unfinished(path: &Path) -> PathBuf {
    let mut name = path.file_name().map_or_else(OsString::new, OsString::from);
    name.push(UNFINISHED);
    path.with_file_name(name)
}

/// Checks that a path is free, or has a volume that may be replaced.
pub(crate) fn check_target(path: &Path) -> Result<(), OmeZarrError> {
    if path.file_name().is_none() {
        return Err(OmeZarrError::NotReplaced { path: path.into() });
    }
    match fs::metadata(path) {
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(()),
        Err(error) => Err(OmeZarrError::io(path, "opening")(error)),
        Ok(there) if !there.is_dir() => Err(OmeZarrError::IsFile { path: path.into() }),
        Ok(_) if is_volume(path) || is_empty(path)? => Ok(()),
        Ok(_) => Err(OmeZarrError::NotReplaced { path: path.into() }),
    }
}

/// Creates the folder of an unfinished volume. One that exists must be empty, a volume, or hold the
/// file `log`.
pub(crate) fn create_unfinished(part: &Path, log: &str) -> Result<(), OmeZarrError> {
    match fs::create_dir(part) {
        Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
        done => {
            return done
                .and_then(|()| sync_folder(folder_of(part)))
                .map_err(OmeZarrError::io(part, "creating the folder"));
        }
    }
    if !part.is_dir() {
        return Err(OmeZarrError::IsFile { path: part.into() });
    }
    if part.join(log).exists() || is_volume(part) || is_empty(part)? {
        return Ok(());
    }
    Err(OmeZarrError::NotReplaced { path: part.into() })
}

/// Writes a file of an unfinished volume, whole or not at all, and the folders above it. After a
/// power cut its name may be missing, but its content is whole.
pub(crate) fn write_file(path: &Path, bytes: &[u8]) -> Result<(), OmeZarrError> {
    let write = || -> io::Result<()> {
        fs::create_dir_all(folder_of(path))?;
        let mut file = temporary(path)?;
        // The type of temporary files adds their names to errors.
        file.as_file_mut().write_all(bytes)?;
        file.as_file().sync_all()?;
        file.persist(path).map(drop).map_err(|error| error.error)
    };
    write().map_err(OmeZarrError::io(path, "writing"))
}

/// Syncs all folders from this one on, so that the names in them survive a power cut.
pub(crate) fn sync_below(folder: &Path) -> Result<(), OmeZarrError> {
    for entry in fs::read_dir(folder).map_err(OmeZarrError::io(folder, "opening"))? {
        let entry = entry.map_err(OmeZarrError::io(folder, "opening"))?;
        if entry.file_type().is_ok_and(|kind| kind.is_dir()) {
            sync_below(&entry.path())?;
        }
    }
    sync_folder(folder).map_err(OmeZarrError::io(folder, "syncing"))
}

fn is_volume(path: &Path) -> bool {
    path.join(FILE).is_file() || path.join(EARLIER_FILE).is_file()
}

fn is_empty(path: &Path) -> Result<bool, OmeZarrError> {
    Ok(fs::read_dir(path).map_err(OmeZarrError::io(path, "opening"))?.next().is_none())
}

/// Removes all files of a folder but those that `keep` names by their keys (paths below the folder,
/// with slashes), and folders without files.
pub(crate) fn clean(folder: &Path, keep: &dyn Fn(&str) -> bool) -> Result<(), OmeZarrError> {
    clean_below(folder, "", keep).map(drop)
}

/// Cleans a folder below the first one, and returns whether it is empty then.
fn clean_below(folder: &Path, prefix: &str, keep: &dyn Fn(&str) -> bool) -> Result<bool, OmeZarrError> {
    let mut is_empty = true;
    for entry in fs::read_dir(folder).map_err(OmeZarrError::io(folder, "opening"))? {
        let entry = entry.map_err(OmeZarrError::io(folder, "opening"))?;
        let path = entry.path();
        let key = format!("{prefix}{}", entry.file_name().to_string_lossy());
        let is_folder = entry.file_type().map_err(OmeZarrError::io(&path, "opening"))?.is_dir();
        let remove = if is_folder { clean_below(&path, &format!("{key}/"), keep)? } else { !keep(&key) };
        if remove {
            let removed = if is_folder { fs::remove_dir(&path) } else { fs::remove_file(&path) };
            removed.map_err(OmeZarrError::io(&path, "removing"))?;
        }
        is_empty &= remove;
    }
    Ok(is_empty)
}

/// Gives a finished volume its name. An earlier volume of that name is replaced at once, and then
/// removed. On return the name survives a power cut.
pub(crate) fn publish(part: &Path, path: &Path) -> Result<(), OmeZarrError> {
    let parent = folder_of(path);
    let exchange = |flags| renameat_with(CWD, part, CWD, path, flags);
    let is_replaced = match exchange(RenameFlags::NOREPLACE) {
        Ok(()) => false,
        Err(Errno::EXIST) => match exchange(RenameFlags::EXCHANGE) {
            Ok(()) => true,
            Err(Errno::INVAL | Errno::NOSYS) => return rename_plainly(part, path),
            Err(error) => return Err(OmeZarrError::io(path, "renaming")(error.into())),
        },
        Err(Errno::INVAL | Errno::NOSYS) => return rename_plainly(part, path),
        Err(error) => return Err(OmeZarrError::io(path, "renaming")(error.into())),
    };
    sync_folder(parent).map_err(OmeZarrError::io(parent, "syncing"))?;
    if is_replaced {
        remove_earlier(part)?;
    }
    Ok(())
}

/// Does the same on file systems that do not exchange names. Between two renames there is no volume
/// of that name; both are then beside it.
fn rename_plainly(part: &Path, path: &Path) -> Result<(), OmeZarrError> {
    let mut aside = path.as_os_str().to_owned();
    aside.push(".earlier");
    let aside = PathBuf::from(aside);
    let is_replaced = path.exists();
    let rename = || -> io::Result<()> {
        if is_replaced {
            fs::rename(path, &aside)?;
        }
        fs::rename(part, path).inspect_err(|_| drop(fs::rename(&aside, path)))?;
        sync_folder(folder_of(path))
    };
    rename().map_err(OmeZarrError::io(path, "renaming"))?;
    if is_replaced { remove_earlier(&aside) } else { Ok(()) }
}

/// Removes a replaced volume; its root last, so that the rest is known as a volume's.
fn remove_earlier(folder: &Path) -> Result<(), OmeZarrError> {
    clean(folder, &|key| [FILE, EARLIER_FILE].contains(&key))?;
    fs::remove_dir_all(folder).map_err(OmeZarrError::io(folder, "removing the earlier volume"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn volume(path: &Path, text: &str) {
        fs::create_dir_all(path.join("0/c")).unwrap();
        fs::write(path.join(FILE), text).unwrap();
        fs::write(path.join("0/c/0"), text).unwrap();
    }

    #[test]
    fn earlier_volume_is_replaced_as_a_whole() {
        for publish in [publish, rename_plainly] {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("a.ome.zarr");
            let part = unfinished(&path);
            for text in ["first", "second"] {
                volume(&part, text);
                publish(&part, &path).unwrap();
                assert_eq!(fs::read_to_string(path.join("0/c/0")).unwrap(), text);
                assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
            }
        }
    }

    #[test]
    fn file_or_other_folder_is_not_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.ome.zarr");
        check_target(&path).unwrap();
        fs::create_dir(&path).unwrap();
        check_target(&path).unwrap();
        fs::write(path.join("thesis.txt"), "").unwrap();
        assert!(matches!(check_target(&path), Err(OmeZarrError::NotReplaced { .. })));
        assert!(matches!(create_unfinished(&path, "log"), Err(OmeZarrError::NotReplaced { .. })));
        let file = path.join("thesis.txt");
        assert!(matches!(check_target(&file), Err(OmeZarrError::IsFile { .. })));
        assert!(matches!(create_unfinished(&file, "log"), Err(OmeZarrError::IsFile { .. })));
        assert!(matches!(check_target(Path::new("/")), Err(OmeZarrError::NotReplaced { .. })));
    }

    #[test]
    fn cleaning_keeps_named_files_and_their_folders() {
        let folder = tempfile::tempdir().unwrap();
        volume(folder.path(), "");
        fs::create_dir_all(folder.path().join("1/c/2")).unwrap();
        clean(folder.path(), &|key| key == "0/c/0").unwrap();
        assert!(folder.path().join("0/c/0").exists());
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }
}
