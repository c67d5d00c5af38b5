//! One try to reconstruct a sweep.

use std::ffi::OsString;
use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::time::{Instant, SystemTime};

use serde_json::{Map, Value};

use super::attempt::{Attempt, AttemptState};
use super::child::{self, Ended, Limits};
use super::done::{self, Done};
use super::folder::RunFolder;
use super::owner::{self, Owner};
use super::plan::Planned;
use super::publish::publish;
use crate::app::sha256;
use crate::failure::{Failure, Reason};

/// Report of the reconstruction, in its temporary folder.
const REPORT: &str = ".report.json";

/// Fields of the report that an account keeps.
const KEPT: [&str; 16] = [
    "frames",
    "first_refusals",
    "untimed",
    "voxels_updated",
    "path",
    "bricks",
    "bytes",
    "threads",
    "simd",
    "grid",
    "world",
    "scalar",
    "sigma_mm",
    "work",
    "regions",
    "notes",
];

/// Share of a process's address space that the volume may take.
const VOLUME_SHARE: f64 = 0.75;

/// Settings of all sweeps of a run.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Machine {
    pub(crate) limits: Limits,
    /// Threads of each process, unless its row says another number.
    pub(crate) threads: usize,
}

/// Tries once, and returns the account. A failure of the sweep is in the account.
///
/// # Errors
/// [`Failure`] when the batch's own files cannot be written, so that nothing can be done.
pub(crate) fn attempt(
    folder: &RunFolder,
    sweep: &Planned,
    machine: &Machine,
    stop: &AtomicBool,
) -> Result<Attempt, Failure> {
    folder.clean(&sweep.id, false)?;
    let began = Instant::now();
    let mut attempt = Attempt::begin(folder, &sweep.id, &sweep.key)?;
    let place = folder.sweep(&sweep.id);
    let part = owner::temporary(&place, sha256::short(&sweep.key));
    let worked = work(folder, sweep, machine, stop, (&part, &mut attempt), began);
    // Nothing is there any more if it has its name.
    let removed = owner::remove(&part).map_err(|e| Failure::io(&part, "removing", &e));
    match worked.and(removed) {
        Ok(()) => {}
        // Another run of the same sweep may have removed our files, because it was faster.
        Err(_) if done::is_done(folder, sweep) => attempt.exit = Some(0),
        Err(Failure(Reason { sentence, kind })) => {
            attempt.exit = Some(i32::from(kind.code()));
            attempt.sentence = Some(sentence);
        }
    }
    attempt.wall_s = began.elapsed().as_secs_f64();
    if attempt.state == AttemptState::Started {
        attempt.state = AttemptState::Ended;
    }
    attempt.write(folder)?;
    Ok(attempt)
}

/// Makes the results in a temporary folder, and gives them their name.
fn work(
    folder: &RunFolder,
    sweep: &Planned,
    machine: &Machine,
    stop: &AtomicBool,
    (part, attempt): (&Path, &mut Attempt),
    began: Instant,
) -> Result<(), Failure> {
    let stamps = stamps(sweep);
    sweep.inputs.iter().try_for_each(super::key::Input::check)?;
    std::fs::create_dir_all(part).map_err(|e| Failure::io(part, "making the folder", &e))?;
    let words = words(sweep, part, machine);
    let ended = child::run(&words, part, &machine.limits, stop, |process| {
        attempt.child = Some(process);
        attempt.write(folder)
    })?;
    let Ended { exit, signal, was_stopped, peak_bytes, sentence } = ended;
    (attempt.peak_bytes, attempt.signal) = (peak_bytes, signal);
    if was_stopped {
        attempt.state = AttemptState::Interrupted;
        return Ok(());
    }
    (attempt.exit, attempt.sentence) = (Some(exit), sentence);
    if exit != 0 {
        // Another run of the same sweep may have done it.
        if done::is_done(folder, sweep) {
            attempt.exit = Some(0);
        }
        return Ok(());
    }
    if stamps != self::stamps(sweep) {
        // Read while it changed: the results are of no content that is known.
        sweep.inputs.iter().try_for_each(super::key::Input::check)?;
    }
    let report = kept(&part.join(REPORT))?;
    for extra in [part.join(REPORT), child::peak_file(part)] {
        owner::remove(&extra).map_err(|e| Failure::io(&extra, "removing", &e))?;
    }
    let outputs = publish(part, &folder.sweep(&sweep.id), &sweep.key)?;
    let done = Done {
        id: sweep.id.clone(),
        key: sweep.key.clone(),
        outputs,
        inputs: sweep.inputs.clone(),
        settings: sweep.settings.clone(),
        program: sweep.program.clone(),
        command: words.iter().map(|word| word.to_string_lossy().into_owned()).collect(),
        host: Owner::this().host.clone(),
        attempt: attempt.number,
        wall_s: began.elapsed().as_secs_f64(),
        peak_bytes,
        report,
    };
    done.write(folder)?;
    folder.clean(&sweep.id, true)
}

/// Returns the lengths and times of change of a sweep's inputs.
fn stamps(sweep: &Planned) -> Vec<Option<(u64, SystemTime)>> {
    let stamp = |path: &Path| path.metadata().ok().and_then(|there| Some((there.len(), there.modified().ok()?)));
    sweep.inputs.iter().map(|input| stamp(&input.path)).collect()
}

/// Returns the arguments of the sweep's process.
fn words(sweep: &Planned, part: &Path, machine: &Machine) -> Vec<OsString> {
    let mut words: Vec<OsString> = vec!["reconstruct".into(), sweep.recording.clone().into()];
    let joined = |flag: &str, path: &Path| {
        let mut word = OsString::from(flag);
        word.push(path);
        word
    };
    for name in &sweep.outputs {
        let flag = match name.as_str() {
            "weights.mha" => "--weights=",
            "planes.png" => "--planes=",
            _ => "--output=",
        };
        words.push(joined(flag, &part.join(name)));
    }
    words.push(joined("--json=", &part.join(REPORT)));
    words.extend(sweep.config.iter().map(|path| joined("--config=", path)));
    words.extend(sweep.settings.iter().map(OsString::from));
    // The volume's own limit names the frame, and is below that of the process.
    let most = machine.limits.memory_bytes as f64 / f64::from(1 << 30) * VOLUME_SHARE;
    let of = |flag: &str| sweep.resources.iter().find_map(|word| word.strip_prefix(flag));
    let asked: f64 = of("--max-memory=").and_then(|gib| gib.parse().ok()).unwrap_or(most);
    words.push(format!("--max-memory={}", asked.min(most)).into());
    if of("--threads=").is_none() {
        words.push(format!("--threads={}", machine.threads).into());
    }
    let others = sweep.resources.iter().filter(|word| !word.starts_with("--max-memory="));
    words.extend(others.map(OsString::from));
    words
}

/// Returns the fields of a report that an account keeps.
fn kept(path: &Path) -> Result<Value, Failure> {
    let text = std::fs::read(path).map_err(|e| Failure::io(path, "reading", &e))?;
    let mut report: Map<String, Value> = serde_json::from_slice(&text)?;
    report.retain(|name, _| KEPT.contains(&name.as_str()));
    Ok(report.into())
}
