//! Functions shared by commands that read files: hashing, progress, formatting.

use std::fmt::Write as _;
use std::fs::File;
use std::io::{ErrorKind, Read, Write as _};
use std::path::Path;
use std::sync::{Arc, OnceLock};
use std::time::Duration;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use sha2::{Digest, Sha256};

use drivers::replay::Progress;
use formats::image::Container;

use super::Failure;

/// Magic bytes of a session's file.
const SESSION: &[u8] = b"\x89MCAP";

/// Returns the SHA-256 of a file, as `sha256sum` prints it.
///
/// # Errors
/// [`Failure`] when the file cannot be read.
pub fn hash(path: &Path) -> Result<String, Failure> {
    let failed = |e: std::io::Error| Failure(format!("{}: reading failed: {e}", path.display()));
    let mut file = File::open(path).map_err(failed)?;
    let mut hasher = Sha256::new();
    let mut buffer = vec![0; 1 << 20];
    loop {
        match file.read(&mut buffer).map_err(failed)? {
            0 => break,
            n => hasher.update(&buffer[..n]),
        }
    }
    let mut text = String::with_capacity(64);
    for byte in hasher.finalize() {
        // Writing to a string does not fail.
        let _ = write!(text, "{byte:02x}");
    }
    Ok(text)
}

/// Whether a file is a recorded session: by its first bytes, or by its name if the beginning may
/// be damaged.
///
/// # Errors
/// [`Failure`] when the file cannot be read.
pub fn is_session(path: &Path) -> Result<bool, Failure> {
    let failed = |e: std::io::Error| Failure(format!("{}: reading failed: {e}", path.display()));
    let mut head = Vec::new();
    File::open(path).map_err(failed)?.take(SESSION.len() as u64).read_to_end(&mut head).map_err(failed)?;
    Ok(head == SESSION || path.extension().is_some_and(|extension| extension == "mcap"))
}

/// Prints to stdout. A closed pipe (`| head`) is no error.
///
/// # Errors
/// [`Failure`] when the text cannot be written.
pub fn print(text: &str) -> Result<(), Failure> {
    match std::io::stdout().write_all(text.as_bytes()) {
        Err(e) if e.kind() == ErrorKind::BrokenPipe => Ok(()),
        Err(e) => Err(Failure(format!("writing to stdout failed: {e}"))),
        Ok(()) => Ok(()),
    }
}

/// Checks before the work that a file can be written there.
///
/// # Errors
/// [`Failure`] when its folder does not exist, or something that is no file has its name.
pub fn check_output(path: &Path) -> Result<(), Failure> {
    check_folder(path)?;
    if path.exists() && !path.is_file() {
        fail!("{}: exists and is not a file; give another name", path.display());
    }
    Ok(())
}

/// Checks that a path's name has a known volume format.
///
/// # Errors
/// [`Failure`] for an unknown format.
pub fn check_volume(path: &Path) -> Result<(), Failure> {
    let named = Container::of_volume(path).map_err(|why| Failure(format!("{}: {why}", path.display())));
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
    Err(Failure(format!("{}: the folder {} does not exist", path.display(), folder.display())))
}

/// Checks that an output is not an input.
///
/// # Errors
/// [`Failure`] when it is.
pub fn check_is_not(output: &Path, input: &Path) -> Result<(), Failure> {
    if output.canonicalize().ok().is_some_and(|path| input.canonicalize().ok() == Some(path)) {
        fail!("{}: is the input; give another name", output.display());
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

/// Returns a progress bar on a terminal; it is hidden in a pipe.
pub fn progress(doing: &'static str, total: u64) -> ProgressBar {
    let bar = ProgressBar::with_draw_target(Some(total), ProgressDrawTarget::stderr());
    if let Ok(style) = ProgressStyle::with_template("{msg:12} {wide_bar} {pos}/{len} {eta:>4}") {
        bar.set_style(style);
    }
    bar.set_message(doing);
    bar.enable_steady_tick(Duration::from_millis(200));
    bar
}

/// Returns a progress bar for files whose list is the first axis. All their frames are read
/// before the first one is available.
pub fn turning() -> Progress {
    // No bar is shown for other files.
    let bar = OnceLock::new();
    Progress(Some(Arc::new(move |done, of| {
        let bar: &ProgressBar = bar.get_or_init(|| progress("turning", of));
        bar.set_position(done);
        if done == of {
            bar.finish_and_clear();
        }
    })))
}
