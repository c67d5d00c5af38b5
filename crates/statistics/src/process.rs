//! Resources of this process.

use std::fs;

use rustix::time::{ClockId, clock_gettime};
use serde::Serialize;

/// Memory, time and files of this process. Values that the system does not report are 0.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ProcessNumbers {
    /// Resident memory, bytes.
    pub resident_bytes: u64,
    /// CPU time of its threads, s, including the kernel's work for them.
    pub cpu_s: f64,
    /// Its threads.
    pub threads: u64,
    /// Its open files, devices and connections.
    pub open_files: u64,
    /// Its start: host seconds, to a hundredth.
    #[serde(skip)]
    pub began_s: f64,
}

impl ProcessNumbers {
    /// Returns the present numbers.
    pub fn now() -> Self {
        let spent = clock_gettime(ClockId::ProcessCPUTime);
        // In pages: first all mapped ones, then the resident ones.
        let statm = fs::read_to_string("/proc/self/statm").unwrap_or_default();
        let resident: u64 = statm.split(' ').nth(1).and_then(|pages| pages.parse().ok()).unwrap_or(0);
        let entries = |folder: &str| fs::read_dir(folder).map_or(0, |entries| entries.count() as u64);
        Self {
            resident_bytes: resident * rustix::param::page_size() as u64,
            cpu_s: spent.tv_sec as f64 + spent.tv_nsec as f64 * 1e-9,
            threads: entries("/proc/self/task"),
            open_files: entries("/proc/self/fd"),
            began_s: began_s().unwrap_or(0.0),
        }
    }
}

/// Returns the start of this process, by the clock of its time stamps. The kernel counts from
/// its own start, including suspension.
fn began_s() -> Option<f64> {
    let stat = fs::read_to_string("/proc/self/stat").ok()?;
    // The program's name is in brackets and may contain brackets. The 22nd field is the 20th
    // after it.
    let ticks: f64 = stat.rsplit_once(')')?.1.split_whitespace().nth(19)?.parse().ok()?;
    let seconds = |clock| {
        let now = clock_gettime(clock);
        now.tv_sec as f64 + now.tv_nsec as f64 * 1e-9
    };
    let suspended = seconds(ClockId::Boottime) - seconds(ClockId::Monotonic);
    Some(ticks / rustix::param::clock_ticks_per_second() as f64 - suspended)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn process_reports_memory_time_and_files() {
        let before = ProcessNumbers::now();
        assert!(before.resident_bytes > 1 << 20 && before.resident_bytes < 1 << 40, "{before:?}");
        assert!(before.threads >= 1 && before.open_files >= 3, "{before:?}");
        let held = vec![1_u8; 64 << 20];
        let sum: u64 = held.iter().map(|byte| u64::from(*byte)).sum();
        let after = ProcessNumbers::now();
        assert_eq!(sum, 64 << 20);
        // Other tests may have freed memory meanwhile.
        assert!(after.resident_bytes >= 64 << 20, "{after:?}");
        assert!(after.cpu_s >= before.cpu_s);
        let now = clock_gettime(ClockId::Monotonic);
        let age = now.tv_sec as f64 + now.tv_nsec as f64 * 1e-9 - after.began_s;
        assert!((-0.02..3600.0).contains(&age) && (after.began_s - before.began_s).abs() < 0.001, "{age}");
    }
}
