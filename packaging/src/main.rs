//! `sonoweave-packaging FOLDER MACHINE`: writes the licences of the linked crates to a folder, for a
//! program built for MACHINE (rustc's target name).

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::{fs, io};

use sonoweave_packaging::notices;

fn main() -> ExitCode {
    let mut arguments = std::env::args_os().skip(1);
    let (Some(folder), Some(machine), None) = (arguments.next(), arguments.next(), arguments.next()) else {
        return say("usage: sonoweave-packaging FOLDER MACHINE", 2);
    };
    match write(&PathBuf::from(folder), &machine.to_string_lossy()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => say(&format!("sonoweave-packaging: {error}"), 1),
    }
}

#[allow(clippy::print_stderr, reason = "the one place where a failure is said")]
fn say(sentence: &str, code: u8) -> ExitCode {
    eprintln!("{sentence}");
    code.into()
}

fn write(folder: &Path, machine: &str) -> io::Result<()> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let linked = notices::linked(&notices::metadata(&root, machine)?, "sonoweave")?;
    let told = |error: io::Error, path: &Path| io::Error::new(error.kind(), format!("{}: {error}", path.display()));
    fs::create_dir_all(folder).map_err(|error| told(error, folder))?;
    let path = folder.join("licences.txt");
    fs::write(&path, notices::notices(&linked)?).map_err(|error| told(error, &path))
}
