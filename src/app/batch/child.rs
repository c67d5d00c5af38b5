//! The process of a sweep: this program, with limits, in a process group of its own.
//!
//! The process takes its limits itself at its start, by environment variables: the parent then
//! needs no unsafe code between fork and exec.

use std::env;
use std::io::{self, Read};
use std::os::unix::process::{CommandExt as _, ExitStatusExt as _};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Resource, Rlimit, Signal, getppid, kill_process_group, setrlimit};

use crate::failure::{Failure, FailureKind};

/// Process that must live as long as this one.
const PARENT: &str = "SONOWEAVE_BATCH_PARENT";
/// Limit of the address space, bytes.
const MEMORY: &str = "SONOWEAVE_BATCH_MEMORY";
/// File for the peak of memory.
const PEAK: &str = "SONOWEAVE_BATCH_PEAK";

/// Times between two looks at a process: the shorter one at its beginning.
const LOOKS: [Duration; 2] = [Duration::from_millis(5), Duration::from_millis(100)];
/// Bytes of the end of standard error that are kept.
const KEPT: usize = 1 << 16;
/// Beginning of Rust's message before it aborts because memory is missing.
const NO_MEMORY: &str = "memory allocation of ";

/// Limits of a sweep's process.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Limits {
    pub(crate) memory_bytes: u64,
    pub(crate) timeout: Duration,
}

/// Result of a process.
#[derive(Debug)]
pub(crate) struct Ended {
    /// Exit code: that of a failure's kind, or 128 + the signal.
    pub(crate) exit: i32,
    pub(crate) signal: Option<i32>,
    /// Whether it was stopped together with the run.
    pub(crate) was_stopped: bool,
    pub(crate) peak_bytes: Option<u64>,
    /// The last sentence on standard error.
    pub(crate) sentence: Option<String>,
}

/// Takes the limits of a batch, if this process is one of its sweeps'. Called first of all.
///
/// # Errors
/// [`Failure`] when a limit cannot be set, or the batch has ended already.
pub(crate) fn begin() -> Result<(), Failure> {
    let Some(parent) = number(PARENT) else { return Ok(()) };
    rustix::process::set_parent_process_death_signal(Some(Signal::KILL)).map_err(io::Error::from)?;
    // It may have ended before that.
    let is_there = getppid().is_some_and(|now| now.as_raw_nonzero().get().unsigned_abs() == parent as u32);
    if !is_there {
        return Err(Failure::new("the batch that began this sweep has ended; run it again"));
    }
    let limit = |resource, most| {
        let limits = Rlimit { current: Some(most), maximum: Some(most) };
        setrlimit(resource, limits).map_err(io::Error::from)
    };
    limit(Resource::Core, 0)?;
    if let Some(bytes) = number(MEMORY) {
        limit(Resource::As, bytes)?;
    }
    Ok(())
}

/// Writes the peak of memory, if this process is a sweep's.
pub(crate) fn end() {
    if let (Some(path), Some(bytes)) = (env::var_os(PEAK), peak("self")) {
        // The account of the try then has the last value that the run has seen.
        let _ = std::fs::write(path, bytes.to_string());
    }
}

fn number(name: &str) -> Option<u64> {
    env::var(name).ok()?.parse().ok()
}

/// Returns the peak of a process's memory, bytes.
fn peak(process: &str) -> Option<u64> {
    let text = std::fs::read_to_string(format!("/proc/{process}/status")).ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok().map(|kilobytes| kilobytes * 1024)
}

/// Returns the file in a sweep's temporary folder that has the peak of memory.
pub(crate) fn peak_file(part: &Path) -> PathBuf {
    part.join(".peak")
}

/// Runs this program with these words until it ends, the time is over, or `stop` is set.
/// `started` receives the process's number.
///
/// # Errors
/// Errors of the system when it cannot be started; those of `started`, when it was stopped.
pub(crate) fn run(
    words: &[std::ffi::OsString],
    part: &Path,
    limits: &Limits,
    stop: &AtomicBool,
    started: impl FnOnce(u32) -> Result<(), Failure>,
) -> Result<Ended, Failure> {
    let began = Instant::now();
    let mut child = Command::new(env::current_exe()?)
        .args(words)
        .env(PARENT, std::process::id().to_string())
        .env(MEMORY, limits.memory_bytes.to_string())
        .env(PEAK, peak_file(part))
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .process_group(0)
        .spawn()?;
    let (said, heard) = channel();
    if let Some(mut stderr) = child.stderr.take() {
        // Ends with the process, which alone has the other end.
        std::thread::spawn(move || said.send(last_bytes(&mut stderr)));
    }
    if let Err(failure) = started(child.id()) {
        kill(&mut child)?;
        return Err(failure);
    }
    let process = child.id().to_string();
    let (mut seen, mut timed_out, mut was_stopped) = (None, false, false);
    let end = began.checked_add(limits.timeout);
    let [mut look, longest] = LOOKS;
    let stderr = loop {
        seen = peak(&process).or(seen);
        let left = end.map_or(look, |end| end.saturating_duration_since(Instant::now()));
        let pause = look.min(left);
        look = longest.min(look * 2);
        match heard.recv_timeout(pause) {
            Ok(text) => break text,
            Err(RecvTimeoutError::Disconnected) => break Vec::new(),
            Err(RecvTimeoutError::Timeout) => {
                was_stopped = stop.load(Ordering::Relaxed);
                timed_out = !was_stopped && end.is_some_and(|end| Instant::now() >= end);
                if was_stopped || timed_out {
                    kill(&mut child)?;
                }
            }
        }
    };
    let status = child.wait()?;
    let written = std::fs::read_to_string(peak_file(part)).ok().and_then(|text| text.trim().parse().ok());
    let text = String::from_utf8_lossy(&stderr);
    let signal = status.signal();
    let lacked_memory = signal.is_some() && text.lines().any(|line| line.starts_with(NO_MEMORY));
    let kind = |kind: FailureKind| i32::from(kind.code());
    let (exit, sentence) = match (status.code(), signal) {
        _ if timed_out => {
            let limit = limits.timeout.as_secs_f64();
            let sentence = format!("did not end within {limit} s; raise --timeout, or choose coarser settings");
            (kind(FailureKind::Timeout), Some(sentence))
        }
        (_, Some(_)) if lacked_memory => {
            let limit = limits.memory_bytes as f64 / f64::from(1 << 30);
            let sentence = format!("needs more than {limit:.2} GiB; raise --memory, or choose coarser settings");
            (kind(FailureKind::Memory), Some(sentence))
        }
        (Some(code), _) => (code, last_sentence(&text)),
        (None, Some(signal)) => {
            let before = last_sentence(&text).map(|text| format!("; its last message: {text}")).unwrap_or_default();
            (128 + signal, Some(format!("was ended by signal {signal}{before}")))
        }
        (None, None) => (kind(FailureKind::Other), last_sentence(&text)),
    };
    Ok(Ended { exit, signal, was_stopped, peak_bytes: written.or(seen), sentence })
}

/// Kills a process with its group.
fn kill(child: &mut Child) -> Result<(), Failure> {
    let group = i32::try_from(child.id()).ok().and_then(Pid::from_raw);
    let killed = group.is_some_and(|group| kill_process_group(group, Signal::KILL).is_ok());
    // The group is that of the process once it runs.
    if killed { Ok(()) } else { Ok(child.kill()?) }
}

/// Reads to the end, and returns the last bytes.
fn last_bytes(from: &mut impl Read) -> Vec<u8> {
    let (mut kept, mut buffer) = (Vec::new(), [0; 4096]);
    loop {
        match from.read(&mut buffer) {
            Ok(0) => return kept,
            Ok(count) => kept.extend_from_slice(&buffer[..count]),
            Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
            Err(_) => return kept,
        }
        if kept.len() > 2 * KEPT {
            kept.drain(..kept.len() - KEPT);
        }
    }
}

/// Returns the last sentence of this program in its output, else the last line.
fn last_sentence(text: &str) -> Option<String> {
    let ours = text.lines().rev().find_map(|line| line.strip_prefix("sonoweave: "));
    let line = ours.or_else(|| text.lines().rev().find(|line| !line.trim().is_empty()))?;
    Some(line.trim().to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn end_of_output_and_its_last_sentence_are_kept() {
        let text = format!("{}\nsonoweave: note: a\nsonoweave: b; give c\n  d\n", "x".repeat(300_000));
        let kept = last_bytes(&mut text.as_bytes());
        assert!(kept.len() <= 2 * KEPT && text.as_bytes().ends_with(&kept));
        assert_eq!(last_sentence(&text).as_deref(), Some("b; give c"));
        assert_eq!(last_sentence("thread panicked\n\n").as_deref(), Some("thread panicked"));
        assert_eq!(last_sentence("\n"), None);
        assert!(peak("self").is_some_and(|bytes| bytes > 1 << 20) && peak("0").is_none());
    }
}
