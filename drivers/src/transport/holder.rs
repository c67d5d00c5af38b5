//! Who has a device's file open, as far as the kernel tells.

use std::fs;
use std::os::unix::fs::MetadataExt as _;
use std::path::Path;

/// Another process that holds a device's file: its name and number. Who has locked it goes before who has it open only. `None` where that is not known: it is of another user, or in
/// another namespace.
pub(crate) fn holder(path: &Path) -> Option<String> {
    let own = std::process::id();
    let process = locker(path).or_else(|| opener(path, own)).filter(|process| *process != own)?;
    let name = fs::read_to_string(format!("/proc/{process}/comm")).ok()?;
    Some(format!("{} (process {process})", name.trim()))
}

/// Who holds a lock on it.
fn locker(path: &Path) -> Option<u32> {
    let file = fs::metadata(path).ok()?;
    let (major, minor) = (rustix::fs::major(file.dev()), rustix::fs::minor(file.dev()));
    let place = format!("{major:02x}:{minor:02x}:{}", file.ino());
    let locks = fs::read_to_string("/proc/locks").ok()?;
    locked_by(&locks, &place)
}

/// Of the kernel's list of locks: `1: FLOCK  ADVISORY  WRITE 1234 00:1a:5 0 EOF`. What waits for a lock stands behind it, with an arrow.
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

/// Who else has it open.
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
    fn the_kernel_s_list_of_locks_is_read() {
        let locks = "1: POSIX  ADVISORY  READ 900 00:1a:5 128 128\n2: FLOCK  ADVISORY  WRITE 77 00:1a:15 0 EOF\n\
                     2: -> FLOCK  ADVISORY  WRITE 78 00:1a:6 0 EOF\n3: FLOCK  ADVISORY  WRITE 0 00:1a:6 0 EOF\n4: damaged\n";
        assert_eq!(locked_by(locks, "00:1a:15"), Some(77));
        assert_eq!(locked_by(locks, "00:1a:5"), Some(900));
        assert_eq!(locked_by(locks, "00:1a:6"), None, "one waits, the other is in another namespace");
    }

    #[test]
    fn another_process_that_has_a_file_open_is_named() {
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
