//! A finished sweep's files: from the temporary folder to their name, with the account at the end.

use std::fs;
use std::io;
use std::path::Path;

use formats::whole::sync_folder;

use super::done::{Output, files};
use super::owner;
use crate::app::sha256;
use crate::failure::Failure;

/// Gives a finished folder its name, the beginning of the key, and returns its files. If another
/// run has been faster, its files stay if they are the same.
///
/// # Errors
/// [`Failure`] of the file system; nothing has the name then, or what had it before.
pub(crate) fn publish(part: &Path, sweep_folder: &Path, content_key: &str) -> Result<Vec<Output>, Failure> {
    let name = sha256::short(content_key);
    let target = sweep_folder.join(name);
    let failed = |e: io::Error| Failure::io(&target, "giving the results their name", &e);
    let outputs = files(part, name)?;
    sync_folder(part).map_err(failed)?;
    let mut tries = 0;
    loop {
        match fs::rename(part, &target) {
            Ok(()) => break,
            Err(e) if is_taken(&e) && tries < 3 => {
                if files(&target, name).is_ok_and(|there| there == outputs) {
                    owner::remove(part).map_err(failed)?;
                    break;
                }
                // Damaged, or of a run that was killed while it removed them.
                let aside = owner::temporary(sweep_folder, "replaced");
                match fs::rename(&target, &aside) {
                    Err(e) if e.kind() != io::ErrorKind::NotFound => return Err(failed(e)),
                    _ => owner::remove(&aside).map_err(failed)?,
                }
                tries += 1;
            }
            Err(e) => return Err(failed(e)),
        }
    }
    sync_folder(sweep_folder).map_err(failed)?;
    Ok(outputs)
}

fn is_taken(error: &io::Error) -> bool {
    matches!(
        error.kind(),
        io::ErrorKind::DirectoryNotEmpty | io::ErrorKind::AlreadyExists | io::ErrorKind::NotADirectory
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn same_files_stay_and_others_are_replaced() {
        let place = tempfile::tempdir().unwrap();
        let part = |content: &str| {
            let part = owner::temporary(place.path(), "new");
            fs::create_dir(&part).unwrap();
            fs::write(part.join("volume.mha"), content).unwrap();
            part
        };
        let key = "0123456789abcdef";
        let publish = |content: &str| publish(&part(content), place.path(), key).unwrap();
        let first = publish("one");
        assert_eq!(first[0].path, "0123456789ab/volume.mha");
        assert_eq!(first, publish("one"));
        assert_ne!(first, publish("two"));
        assert_eq!(fs::read(place.path().join(&first[0].path)).unwrap(), b"two");
        assert_eq!(fs::read_dir(place.path()).unwrap().count(), 1, "no temporary folder is left");
    }
}
