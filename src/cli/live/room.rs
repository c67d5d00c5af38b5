//! Whether a session can be recorded in a folder at all, before anything is written there.

use std::path::Path;

use crate::cli::Failure;

/// Refuses a folder on whose disk no more is free than is to stay so.
///
/// # Errors
/// [`Failure`] with what to do. A folder that cannot be made is refused by who makes it.
pub(super) fn check(folder: &Path, keep_free_bytes: u64) -> Result<(), Failure> {
    // The folder, or the one that it will be made in.
    let here = folder.ancestors().find(|path| path.exists()).unwrap_or(Path::new("."));
    let Ok(disk) = rustix::fs::statvfs(here) else { return Ok(()) };
    let free = disk.f_bavail.saturating_mul(disk.f_frsize);
    if free > keep_free_bytes {
        return Ok(());
    }
    let mb = |bytes: u64| bytes / 1_000_000;
    Err(Failure(format!(
        "{}: {} MB are free on this disk, and [record] keep_free_mb wants {} to stay so: make room, record elsewhere, or lower it",
        folder.display(),
        mb(free),
        mb(keep_free_bytes)
    )))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_to_stay_free_must_be_free_now() {
        let folder = tempfile::tempdir().unwrap();
        let inner = folder.path().join("not/there/yet");
        check(&inner, 0).unwrap();
        let refused = check(&inner, u64::MAX).unwrap_err().0;
        assert!(refused.contains("MB are free on this disk") && refused.contains("lower it"), "{refused}");
        assert!(!inner.exists(), "nothing was made");
    }
}
