//! Functions shared by commands that read files: hashes, kinds of files, checks of names.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use sha2::{Digest as _, Sha256};

use formats::Limits;
use formats::image::{Container, open_sequence};

use super::sha256;
use crate::failure::{Failure, FailureKind};

/// Magic bytes of a session's file.
const SESSION: &[u8] = b"\x89MCAP";

/// Returns the SHA-256 of a file, as `sha256sum` prints it.
///
/// # Errors
/// [`Failure`] when the file cannot be read.
pub fn hash(path: &Path) -> Result<String, Failure> {
    let failed = |e: std::io::Error| Failure::io(path, "reading", &e);
    let mut file = File::open(path).map_err(failed)?;
    let mut hasher = Sha256::new();
    // A small file needs no large buffer, whose zeros would take longer than its hash.
    let length = file.metadata().map_err(failed)?.len();
    let mut buffer = vec![0; length.clamp(1 << 10, 1 << 20) as usize];
    loop {
        match file.read(&mut buffer).map_err(failed)? {
            0 => break,
            n => hasher.update(&buffer[..n]),
        }
    }
    Ok(sha256::text(hasher))
}

/// Returns the files of a recording, and its size as an estimate of its cost: pixels of all
/// frames, or bytes if its header cannot be read. The run reports the latter.
pub(crate) fn recording(path: &Path) -> (Vec<PathBuf>, u64) {
    let bytes = path.metadata().map_or(0, |there| there.len());
    match open_sequence(path, &Limits::default()) {
        Ok(opened) => {
            let mut files = vec![path.to_owned()];
            if opened.data_path != path {
                files.push(opened.data_path);
            }
            (files, opened.layout.layer_bytes as u64 * opened.layout.layers)
        }
        Err(_) => (vec![path.to_owned()], bytes),
    }
}

/// Whether a file is a recorded session: by its first bytes, or by its name if the beginning may
/// be damaged.
///
/// # Errors
/// [`Failure`] when the file cannot be read.
pub fn is_session(path: &Path) -> Result<bool, Failure> {
    let failed = |e: std::io::Error| Failure::io(path, "reading", &e);
    let mut head = Vec::new();
    File::open(path).map_err(failed)?.take(SESSION.len() as u64).read_to_end(&mut head).map_err(failed)?;
    Ok(head == SESSION || path.extension().is_some_and(|extension| extension == "mcap"))
}

/// Checks before the work that a file can be written there.
///
/// # Errors
/// [`Failure`] when its folder does not exist, or something that is no file has its name.
pub fn check_output(path: &Path) -> Result<(), Failure> {
    check_folder(path)?;
    if path.exists() && !path.is_file() {
        fail_usage!("{}: exists and is not a file; give another name", path.display());
    }
    Ok(())
}

/// Checks that a path's name has a known volume format.
///
/// # Errors
/// [`Failure`] for an unknown format.
pub fn check_volume(path: &Path) -> Result<(), Failure> {
    let named = Container::of_volume(path).map_err(|why| Failure::usage(format!("{}: {why}", path.display())));
    named.map(|_| ())
}

/// Checks that the folder of a file exists.
///
/// # Errors
/// [`Failure`] when it does not.
pub fn check_folder(path: &Path) -> Result<(), Failure> {
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(".".as_ref());
    if folder.is_dir() {
        return Ok(());
    }
    Err(Failure::new(format!(
        "{}: the folder {} does not exist; make it, or give another name",
        path.display(),
        folder.display()
    ))
    .of(FailureKind::Output))
}

/// Checks that an output is not an input.
///
/// # Errors
/// [`Failure`] when it is.
pub fn check_is_not(output: &Path, input: &Path) -> Result<(), Failure> {
    if output.canonicalize().ok().is_some_and(|path| input.canonicalize().ok() == Some(path)) {
        fail_usage!("{}: is the input; give another name", output.display());
    }
    Ok(())
}

/// Returns the requested number of threads, else one per core.
pub fn threads(asked: Option<u16>) -> usize {
    match asked {
        Some(n) => usize::from(n),
        None => std::thread::available_parallelism().map_or(1, usize::from),
    }
}

/// Checks that a picture's name is that of a PNG file.
///
/// # Errors
/// [`Failure`] when the name has another extension.
pub fn check_png(path: &Path) -> Result<(), Failure> {
    if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("png")) {
        return Ok(());
    }
    Err(Failure::usage(format!("{}: pictures are PNG files; give a name that ends in .png", path.display())))
}

/// Whether a path's name is that of a DICOM file.
pub fn is_dicom(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("dcm"))
}

/// Returns a file's name without its folder.
pub(crate) fn name_of(path: &Path) -> String {
    path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}
