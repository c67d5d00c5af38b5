//! Page faults of this process's threads: waits for fresh memory.

use std::fs;

/// Returns how often the present threads whose names are accepted have waited for a page of memory
/// that was not read from a disk; 0 where the system does not report it. A name has at most 15
/// bytes.
pub fn of_threads(accepts: impl Fn(&str) -> bool) -> u64 {
    let Ok(tasks) = fs::read_dir("/proc/self/task") else { return 0 };
    let stats = tasks.flatten().filter_map(|task| fs::read_to_string(task.path().join("stat")).ok());
    stats.filter_map(|stat| faults(&stat, &accepts)).sum()
}

/// Returns the minor page faults of a thread by the system's line about it.
fn faults(stat: &str, accepts: impl Fn(&str) -> bool) -> Option<u64> {
    // The name is in brackets and may contain brackets. The 10th field is the 8th after it.
    let (head, fields) = stat.rsplit_once(')')?;
    accepts(head.split_once('(')?.1).then(|| fields.split_whitespace().nth(7)?.parse().ok())?
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_are_those_of_named_threads() {
        let stat = "12 (in) (sert-0) S 1 2 3 0 -1 4194304 77 5 0 0 1 2";
        assert_eq!(faults(stat, |name| name == "in) (sert-0"), Some(77));
        assert_eq!(faults(stat, |name| name == "other"), None);
        assert_eq!(faults("12 (cut) S", |_| true), None);
        assert_eq!(of_threads(|name| name == "none such"), 0);
        // A thread that writes to fresh pages, one fault each at least.
        let written = |pages: usize| {
            let run = move || {
                let fresh = vec![1_u8; pages * rustix::param::page_size()];
                (std::hint::black_box(fresh).len(), of_threads(|name| name == "faulty"))
            };
            std::thread::Builder::new().name("faulty".into()).spawn(run).unwrap().join().unwrap().1
        };
        // Large pages of the system are of 2 MiB.
        assert!(written(8192) >= written(0) + 16);
    }
}
