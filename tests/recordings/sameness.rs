//! Fixed SHA-256 hashes of volumes, weights and pictures, which no change of structure may change.
//!
//! `sameness.txt` lists the hashes of the voxels, the weights and the decoded picture of each scan.
//! With `SONOWEAVE_SAMENESS=all`, as in CI, every scan is run with 1 and 2 threads and every
//! instruction set that the machine has; else with 1 thread and the widest set, and with 2 threads
//! and the narrowest. `SONOWEAVE_SAMENESS_OF` is a command, such as an emulator and a program for
//! other processors, that runs all scans in place of this machine's program; see
//! `scripts/arm64.sh`. The recorded sessions in `sessions/` were written by the program of November
//! 2026 and must replay for ever.
//!
//! A change that is meant to change results renews the list:
//! `SONOWEAVE_GOLDEN=renew cargo test --test recordings sameness`. The commit says why.

use std::path::Path;
use std::process::Command;
use std::sync::Mutex;

use libtest_mimic::Failed;
use sha2::{Digest, Sha256};
use tempfile::TempDir;

use reconstruct::Simd;

use crate::Test;
use crate::reconstruct::{CALIBRATION, RESULTS_XML, SPINE, SPINE_XML, bytes};

/// Variable with the command that is tested in place of this machine's program.
const OF: &str = "SONOWEAVE_SAMENESS_OF";
/// Names and hashes, a scan a line.
const LIST: &str = "tests/recordings/sameness.txt";

pub(crate) const TESTS: &[Test] = &[
    Test::of_folder("spine", &[SPINE, SPINE_XML], |folder| recording("spine", folder, SPINE, SPINE_XML)),
    Test::of_folder("nwire", &[CALIBRATION, RESULTS_XML], |folder| {
        recording("nwire", folder, CALIBRATION, RESULTS_XML)
    }),
    Test::of_folder("blobs_freehand", &[], |_| {
        phantom("blobs_freehand", "--scene blobs --trajectory freehand --fan", "", "")
    }),
    Test::of_folder("ramp_arm_planar", &[], |_| phantom("ramp_arm_planar", "--scene ramp --trajectory arm", "", "")),
    Test::of_folder("doll_echoes", &[], |_| {
        phantom("doll_echoes", "--scene doll --trajectory parallel", "--sigma auto", "--transfer phantom")
    }),
    Test::of_folder("pulsating_decay", &[], |_| {
        phantom("pulsating_decay", "--scene pulsating --trajectory out-and-back", "--compound decay", "--mode mip")
    }),
    Test::of_folder("sphere_maximum", &[], |_| {
        phantom("sphere_maximum", "--scene sphere --trajectory fan", "--compound maximum", "--mode iso --isovalue 90")
    }),
    Test::of_folder("zone_plate_latest_planar", &[], |_| {
        let flags = "--compound latest --method bspline3 --type u16";
        phantom("zone_plate_latest_planar", "--scene zone-plate --trajectory arm", flags, "--mode average")
    }),
    Test::of_folder("session_demo", &[], |_| session("demo")),
    Test::of_folder("session_commands", &[], |_| session("commands")),
    Test::of_folder("session_arm", &[], |_| session("arm")),
];

/// Runs a scan's commands in every setting and compares the hashes of `v.mha`, `w.mha` and `p.png`.
///
/// `commands` are lines of words; `THREADS` and `SIMD` in them stand for the setting's.
fn check(name: &str, once: &str, commands: &str) -> Result<(), Failed> {
    let place = tempfile::tempdir()?;
    run(&place, once, "2", "auto")?;
    let mut hashes = Vec::new();
    for (threads, simd) in settings() {
        run(&place, commands, threads, simd)?;
        hashes.push((format!("{threads} threads, {simd}"), outcome(name, &place)?));
    }
    let list = Path::new(env!("CARGO_MANIFEST_DIR")).join(LIST);
    if std::env::var_os("SONOWEAVE_GOLDEN").is_some_and(|how| how == "renew") {
        return renew(&list, name, &hashes[0].1);
    }
    let list = std::fs::read_to_string(list)?;
    let expected = list.lines().find(|line| line.split(' ').next() == Some(name)).ok_or("the list lacks this scan")?;
    for (setting, found) in hashes {
        assert_eq!(found, expected, "{setting}: volume, weights or picture have changed");
    }
    Ok(())
}

/// Numbers of threads and instruction sets.
fn settings() -> Vec<(&'static str, &'static str)> {
    // Another processor's sets are not known here.
    if std::env::var_os(OF).is_some() {
        return vec![("2", "auto")];
    }
    // The widest first; the last is portable.
    let sets: Vec<&str> = Simd::ALL.into_iter().filter(|simd| simd.is_available()).map(Simd::name).collect();
    if std::env::var_os("SONOWEAVE_SAMENESS").is_some_and(|which| which == "all") {
        return ["1", "2"].into_iter().flat_map(|threads| sets.iter().map(move |simd| (threads, *simd))).collect();
    }
    vec![("1", sets[0]), ("2", sets[sets.len() - 1])]
}

/// Runs lines of words through the program. Affinity limits the threads of commands that have no
/// flag for them.
fn run(place: &TempDir, commands: &str, threads: &str, simd: &str) -> Result<(), Failed> {
    let program = std::env::var(OF).unwrap_or_else(|_| env!("CARGO_BIN_EXE_sonoweave").to_owned());
    for line in commands.lines() {
        let mut command = Command::new("taskset");
        command.args(["--cpu-list", if threads == "1" { "0" } else { "0-1023" }]);
        command.args(program.split(' ')).env("SONOWEAVE_SIMD", simd).current_dir(place.path());
        let words = line.split_whitespace().map(|word| match word {
            "THREADS" => threads,
            "SIMD" => simd,
            word => word,
        });
        let output = command.args(words).output()?;
        if !output.status.success() {
            return Err(format!("{line}: {}", String::from_utf8_lossy(&output.stderr)).into());
        }
    }
    Ok(())
}

/// The line of the list for the files that a run has left.
fn outcome(name: &str, place: &TempDir) -> Result<String, Failed> {
    let picture = image::open(place.path().join("p.png"))?.into_rgb8();
    let [volume, weights] = ["v.mha", "w.mha"].map(|file| bytes(&place.path().join(file)));
    let hash = |bytes: &[u8]| Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect::<String>();
    Ok(format!("{name} {} {} {}", hash(&volume?), hash(&weights?), hash(&picture)))
}

/// Puts a line into the list, in the place of the one with the same name.
fn renew(list: &Path, name: &str, line: &str) -> Result<(), Failed> {
    static ALONE: Mutex<()> = Mutex::new(());
    let _alone = ALONE.lock();
    let text = std::fs::read_to_string(list).unwrap_or_default();
    let others = text.lines().filter(|line| line.split(' ').next() != Some(name));
    let mut lines: Vec<&str> = others.chain([line]).collect();
    lines.sort_unstable();
    Ok(std::fs::write(list, lines.join("\n") + "\n")?)
}

fn recording(name: &str, folder: &Path, sequence: &str, config: &str) -> Result<(), Failed> {
    let [sequence, config] = [sequence, config].map(|file| folder.join(file).canonicalize());
    let (sequence, config) = (sequence?.display().to_string(), config?.display().to_string());
    let reconstruct = format!("reconstruct {sequence} --config {config} {OUTPUTS}");
    check(name, "", &format!("{reconstruct}\n{RENDER} --transfer tissue"))
}

/// Flags that name the outputs and the setting.
const OUTPUTS: &str = "-o v.mha --weights w.mha --threads THREADS --simd SIMD";
/// Draws the volume.
const RENDER: &str = "render v.mha --weights w.mha -o p.png --threads THREADS --image-size 96x96 --view 30,20";

fn phantom(name: &str, scan: &str, flags: &str, look: &str) -> Result<(), Failed> {
    let once = format!("phantom -o s.igs.mha {scan} --frames 24 --image-size 96x80 --seed 3");
    check(name, &once, &format!("reconstruct s.igs.mha {OUTPUTS} {flags}\n{RENDER} {look}"))
}

fn session(name: &str) -> Result<(), Failed> {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("tests/recordings/sessions/{name}.mcap"));
    let replay = format!("replay {} -o v.mha --weights w.mha --picture p.png", file.display());
    check(&format!("session_{name}"), "", &replay)
}
