//! Checks before the recording that its disk has enough space.

use std::path::Path;

use crate::failure::{Failure, FailureKind};

/// Refuses a folder if its disk's free space does not exceed the space to keep free.
///
/// # Errors
/// [`Failure`] with the remedy. A folder that cannot be created is refused elsewhere, at its
/// creation.
pub(super) fn check(folder: &Path, keep_free_bytes: u64) -> Result<(), Failure> {
    // The folder, or the one that it will be created in.
    let here = folder.ancestors().find(|path| path.exists()).unwrap_or(Path::new("."));
    let Ok(disk) = rustix::fs::statvfs(here) else { return Ok(()) };
    let free = disk.f_bavail.saturating_mul(disk.f_frsize);
    if free > keep_free_bytes {
        return Ok(());
    }
    let mb = |bytes: u64| bytes / 1_000_000;
    Err(Failure::new(format!(
        "{}: {} MB are free on this disk, but [record] keep_free_mb reserves {}; delete files, record elsewhere, or \
        lower it",
        folder.display(),
        mb(free),
        mb(keep_free_bytes)
    ))
    .of(FailureKind::Output))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn disk_without_reserved_space_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let inner = folder.path().join("not/there/yet");
        check(&inner, 0).unwrap();
        let refused = check(&inner, u64::MAX).unwrap_err().0.sentence;
        assert!(refused.contains("MB are free on this disk") && refused.contains("lower it"), "{refused}");
        assert!(!inner.exists(), "nothing was made");
    }
}
