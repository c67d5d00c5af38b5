//! `sonoweave-packaging FOLDER MACHINE`: writes the licences of the linked crates and the list of
//! all crates to a folder, for a program built for MACHINE (rustc's target name).

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::{fs, io};

use sonoweave_packaging::{notices, sbom};

/// Package of the program.
const PROGRAM: &str = "sonoweave";

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
    let metadata = notices::metadata(&root, machine)?;
    let licences = notices::notices(&notices::linked(&metadata, PROGRAM)?)?.into_bytes();
    let lock = fs::read_to_string(root.join("Cargo.lock"))?;
    let crates = sbom::sbom(&lock, &metadata, PROGRAM)?;
    let told = |error: io::Error, path: &Path| io::Error::new(error.kind(), format!("{}: {error}", path.display()));
    fs::create_dir_all(folder).map_err(|error| told(error, folder))?;
    for (name, content) in [("licences.txt", licences), ("sbom.cdx.json", crates)] {
        let path = folder.join(name);
        fs::write(&path, content).map_err(|error| told(error, &path))?;
    }
    Ok(())
}
