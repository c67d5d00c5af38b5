//! Atomic file writing: files are written under a temporary name in the same folder, and renamed
//! when complete.

use std::io::{self, BufWriter, Write};
use std::os::unix::fs::PermissionsExt;
use std::path::Path;

/// Writes a file, whole or not at all; replaces an existing file.
///
/// # Errors
/// Errors of the file system or of `content`; an existing file then stays unchanged.
pub fn write_whole(path: &Path, content: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<()> {
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    // A temporary file is readable only by its owner by default; this one gets the usual
    // permissions, by the umask.
    let everyone = std::fs::Permissions::from_mode(0o666);
    let mut file = BufWriter::new(tempfile::Builder::new().permissions(everyone).tempfile_in(folder)?);
    content(&mut file)?;
    let file = file.into_inner().map_err(io::IntoInnerError::into_error)?;
    file.persist(path).map_err(|e| e.error)?;
    Ok(())
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
            Err(io::ErrorKind::Other.into())
        });
        assert!(broken.is_err());
        assert_eq!(std::fs::read(&path).unwrap(), b"first");
        write_whole(&path, |to| to.write_all(b"second")).unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"second");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "no temporary file is left");
    }
}
