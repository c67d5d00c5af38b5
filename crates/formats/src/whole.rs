//! Files that appear whole or not at all, also if the disk is full or the power is cut.
//!
//! A file is written under a temporary name in its folder and synced, then renamed, and then the
//! folder is synced. An earlier file of that name stays until the rename. A power cut may leave a
//! temporary file, `.sonoweave-*.part`.

use std::fs::File;
use std::io::{self, BufWriter, ErrorKind, Write};
use std::path::Path;

use tempfile::{NamedTempFile, TempPath};

/// Writes a file, whole or not at all; replaces an existing file. On return it survives a power
/// cut.
///
/// # Errors
/// Errors of the file system or of `content`. An existing file then stays unchanged, unless only
/// the last step failed, the sync of the folder.
pub fn write_whole(path: &Path, content: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<()> {
    let mut file = BufWriter::new(temporary(path)?);
    content(&mut file)?;
    persist(file.into_inner().map_err(io::IntoInnerError::into_error)?, path)
}

/// Creates a temporary file in the folder of `path`. Dropped, it is deleted.
///
/// # Errors
/// Errors of the file system.
pub fn temporary(path: &Path) -> io::Result<NamedTempFile> {
    // Opened here rather than by `tempfile`, which makes files private and adds the temporary name
    // to errors. This file becomes the user's and gets the permissions of any other new file.
    let open = |path: &Path| File::options().read(true).write(true).create_new(true).open(path);
    tempfile::Builder::new().prefix(".sonoweave-").suffix(".part").make_in(folder_of(path), open)
}

/// Gives a complete temporary file its name. On return it survives a power cut.
///
/// # Errors
/// See [`write_whole`].
pub fn persist(file: NamedTempFile, path: &Path) -> io::Result<()> {
    // Without this, a power cut could leave the name on an empty file.
    file.as_file().sync_all()?;
    file.persist(path).map_err(|error| error.error)?;
    sync_folder(folder_of(path))
}

/// Gives a complete temporary file its name, unless a file has it already.
///
/// # Errors
/// See [`write_whole`]; [`ErrorKind::AlreadyExists`].
pub fn persist_new(file: NamedTempFile, path: &Path) -> io::Result<()> {
    file.as_file().sync_all()?;
    file.persist_noclobber(path).map_err(|error| error.error)?;
    sync_folder(folder_of(path))
}

/// Gives two files their names: the pixels first, so that no header exists without its pixels.
/// If either fails, both earlier files are unchanged. If the power is cut between the renames,
/// there is no header.
pub(crate) fn persist_both(
    (pixels, pixels_path): (NamedTempFile, &Path),
    (header, path): (NamedTempFile, &Path),
) -> io::Result<()> {
    pixels.as_file().sync_all()?;
    header.as_file().sync_all()?;
    // An earlier header goes first, as it does not describe the new pixels.
    let earlier_header = set_aside(path)?;
    let earlier_pixels = set_aside(pixels_path).and_then(|earlier| {
        sync_folder(folder_of(path))?;
        Ok(earlier)
    });
    let put = earlier_pixels.and_then(|earlier_pixels| {
        let put = persist(pixels, pixels_path)
            .and_then(|()| persist(header, path).inspect_err(|_| drop(std::fs::remove_file(pixels_path))));
        if put.is_err() {
            restore(earlier_pixels, pixels_path)?;
        }
        put
    });
    if put.is_err() {
        restore(earlier_header, path)?;
    }
    put
}

/// Moves an existing file to a temporary name, which is deleted on drop; `None` if there is no
/// file. A folder stays, and cannot be replaced.
fn set_aside(path: &Path) -> io::Result<Option<TempPath>> {
    if path.symlink_metadata().map_or(true, |there| there.is_dir()) {
        return Ok(None);
    }
    let aside = temporary(path)?.into_temp_path();
    std::fs::rename(path, &aside)?;
    Ok(Some(aside))
}

/// Moves a file back. If this fails, the file stays under its temporary name rather than being
/// deleted.
fn restore(earlier: Option<TempPath>, path: &Path) -> io::Result<()> {
    let Some(earlier) = earlier else { return Ok(()) };
    earlier.persist(path).or_else(|error| error.path.keep().map(drop)).map_err(|error| error.error)
}

/// Creates a folder, and the folders above it that are missing. They survive a power cut.
pub(crate) fn create_folders(folder: &Path) -> io::Result<()> {
    let is_missing = |folder: &&Path| !folder.as_os_str().is_empty() && !folder.exists();
    let missing: Vec<&Path> = folder.ancestors().take_while(is_missing).collect();
    std::fs::create_dir_all(folder)?;
    missing.into_iter().try_for_each(|made| sync_folder(folder_of(made)))
}

/// Syncs a folder, so that the names in it survive a power cut.
///
/// # Errors
/// Errors of the file system, unless it does not sync folders.
pub fn sync_folder(folder: &Path) -> io::Result<()> {
    match File::open(folder).and_then(|folder| folder.sync_all()) {
        // Not every file system syncs folders, and a folder may be writable without being readable.
        Err(error)
            if matches!(
                error.kind(),
                ErrorKind::InvalidInput | ErrorKind::Unsupported | ErrorKind::PermissionDenied
            ) =>
        {
            Ok(())
        }
        done => done,
    }
}

/// Returns the folder of a file: the working folder for a bare name.
pub fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn file_is_replaced_only_when_complete() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("numbers.json");
        write_whole(&path, |to| to.write_all(b"first")).unwrap();
        let broken = write_whole(&path, |to| {
            to.write_all(b"half of the sec")?;
            Err(io::ErrorKind::StorageFull.into())
        });
        assert_eq!(broken.unwrap_err().kind(), ErrorKind::StorageFull);
        assert_eq!(std::fs::read(&path).unwrap(), b"first");
        write_whole(&path, |to| to.write_all(b"second")).unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"second");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "no temporary file is left");
    }

    #[test]
    fn temporary_file_has_plain_error_and_permissions() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("no/numbers.json");
        let error = temporary(&path).unwrap_err();
        assert_eq!(error.to_string(), std::fs::read(&path).unwrap_err().to_string());
        let (ours, new) = (folder.path().join("ours"), folder.path().join("new"));
        persist(temporary(&ours).unwrap(), &ours).unwrap();
        File::create(&new).unwrap();
        let [ours, new] = [ours, new].map(|path| path.metadata().unwrap().permissions());
        assert_eq!(ours, new);
    }

    #[test]
    fn new_file_replaces_none() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("whole.mcap");
        let file = |content: &[u8]| {
            let mut file = temporary(&path).unwrap();
            file.write_all(content).unwrap();
            file
        };
        persist_new(file(b"first"), &path).unwrap();
        assert_eq!(persist_new(file(b"second"), &path).unwrap_err().kind(), ErrorKind::AlreadyExists);
        assert_eq!(std::fs::read(&path).unwrap(), b"first");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "no temporary file is left");
    }

    #[test]
    fn pair_is_replaced_together_or_stays() {
        let folder = tempfile::tempdir().unwrap();
        let [header, pixels] = ["a.mhd", "a.raw"].map(|name| folder.path().join(name));
        let put = |content: &[u8], header: &Path, pixels: &Path| {
            let [one, two] = [(pixels, 0), (header, 1)].map(|(path, n)| {
                let mut file = temporary(path).unwrap();
                file.write_all(&content[n..=n]).unwrap();
                (file, path)
            });
            persist_both(one, two)
        };
        let contents = || [&pixels, &header].map(|path| std::fs::read(path).unwrap());
        put(b"12", &header, &pixels).unwrap();
        put(b"34", &header, &pixels).unwrap();
        assert_eq!(contents(), [b"3", b"4"]);
        // Folders cannot be replaced.
        let taken = folder.path().join("taken");
        std::fs::create_dir_all(taken.join("x")).unwrap();
        assert!(put(b"56", &taken, &pixels).is_err());
        assert!(put(b"56", &header, &taken).is_err());
        assert_eq!(contents(), [b"3", b"4"]);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 3, "no temporary file is left");
    }

    #[test]
    fn missing_folders_are_created() {
        let folder = tempfile::tempdir().unwrap();
        let inner = folder.path().join("a/b/c");
        create_folders(&inner).unwrap();
        create_folders(&inner).unwrap();
        assert!(inner.is_dir());
        std::fs::write(inner.join("file"), "").unwrap();
        assert!(create_folders(&inner.join("file/d")).is_err());
    }
}
