//! Finds the process that has a device file open, as far as the kernel reports it.

use std::fs;
use std::os::unix::fs::MetadataExt as _;
use std::path::Path;

/// Returns name and number of another process that holds a device file. A process with a lock
/// takes precedence over one that only has it open. `None` if unknown: the process belongs to
/// another user, or to another namespace.
pub(crate) fn holder(path: &Path) -> Option<String> {
    let own = std::process::id();
    let process = locker(path).or_else(|| opener(path, own)).filter(|process| *process != own)?;
    let name = fs::read_to_string(format!("/proc/{process}/comm")).ok()?;
    Some(format!("{} (process {process})", name.trim()))
}

/// Returns the process that holds a lock on the file.
fn locker(path: &Path) -> Option<u32> {
    let file = fs::metadata(path).ok()?;
    let (major, minor) = (rustix::fs::major(file.dev()), rustix::fs::minor(file.dev()));
    let place = format!("{major:02x}:{minor:02x}:{}", file.ino());
    let locks = fs::read_to_string("/proc/locks").ok()?;
    locked_by(&locks, &place)
}

/// Searches the kernel's list of locks: `1: FLOCK  ADVISORY  WRITE 1234 00:1a:5 0 EOF`. A
/// process that waits for a lock is listed after it, with an arrow.
fn locked_by(locks: &str, place: &str) -> Option<u32> {
    let holds = |line: &str| {
        let mut words = line.split_whitespace().skip(1);
        if words.next()? == "->" {
            return None;
        }
        let process = words.nth(2)?.parse().ok()?;
        (words.next()? == place && process != 0).then_some(process)
    };
    locks.lines().find_map(holds)
}

/// Returns another process that has the file open.
fn opener(path: &Path, own: u32) -> Option<u32> {
    let file = fs::canonicalize(path).ok()?;
    let number = |entry: fs::DirEntry| entry.file_name().to_str()?.parse().ok();
    let others = fs::read_dir("/proc").ok()?.filter_map(Result::ok).filter_map(number);
    others.filter(|process| *process != own).find(|process: &u32| {
        let open = fs::read_dir(format!("/proc/{process}/fd")).into_iter().flatten().filter_map(Result::ok);
        open.into_iter().any(|link| fs::read_link(link.path()).is_ok_and(|target| target == file))
    })
}

#[cfg(test)]
mod tests {
    use std::process::{Command, Stdio};

    use super::*;

    #[test]
    fn locked_by_ignores_waiting_and_foreign_processes() {
        let locks = "1: POSIX  ADVISORY  READ 900 00:1a:5 128 128\n2: FLOCK  ADVISORY  WRITE 77 00:1a:15 0 EOF\n\
                     2: -> FLOCK  ADVISORY  WRITE 78 00:1a:6 0 EOF\n3: FLOCK  ADVISORY  WRITE 0 00:1a:6 0 EOF\n4: damaged\n";
        assert_eq!(locked_by(locks, "00:1a:15"), Some(77));
        assert_eq!(locked_by(locks, "00:1a:5"), Some(900));
        assert_eq!(locked_by(locks, "00:1a:6"), None, "one waits, the other is in another namespace");
    }

    #[test]
    fn holder_names_other_process_with_file_open() {
        let file = tempfile::NamedTempFile::new().unwrap();
        assert_eq!(holder(file.path()), None, "this process itself is no other");
        let open = fs::File::open(file.path()).unwrap();
        let mut other = Command::new("sleep").arg("60").stdin(Stdio::from(open)).spawn().unwrap();
        let found = holder(file.path());
        other.kill().unwrap();
        other.wait().unwrap();
        assert_eq!(found, Some(format!("sleep (process {})", other.id())));
    }
}
