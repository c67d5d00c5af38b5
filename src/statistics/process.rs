//! What this process takes of the machine.

use std::fs;

use rustix::time::{ClockId, clock_gettime};
use serde::Serialize;

/// Memory, time and files of this process. What the system does not say is 0.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ProcessNumbers {
    /// Memory that it holds, bytes.
    pub resident_bytes: u64,
    /// Time that its threads have run, s, the kernel's work for them included.
    pub cpu_s: f64,
    /// Its threads.
    pub threads: u64,
    /// Its open files, devices and connections.
    pub open_files: u64,
}

impl ProcessNumbers {
    /// At this moment.
    pub fn now() -> Self {
        let spent = clock_gettime(ClockId::ProcessCPUTime);
        // Pages: all that is mapped, then what is there.
        let statm = fs::read_to_string("/proc/self/statm").unwrap_or_default();
        let resident: u64 = statm.split(' ').nth(1).and_then(|pages| pages.parse().ok()).unwrap_or(0);
        let entries = |folder: &str| fs::read_dir(folder).map_or(0, |entries| entries.count() as u64);
        Self {
            resident_bytes: resident * rustix::param::page_size() as u64,
            cpu_s: spent.tv_sec as f64 + spent.tv_nsec as f64 * 1e-9,
            threads: entries("/proc/self/task"),
            open_files: entries("/proc/self/fd"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_process_takes_memory_time_and_files() {
        let before = ProcessNumbers::now();
        assert!(before.resident_bytes > 1 << 20 && before.resident_bytes < 1 << 40, "{before:?}");
        assert!(before.threads >= 1 && before.open_files >= 3, "{before:?}");
        let held = vec![1_u8; 64 << 20];
        let sum: u64 = held.iter().map(|byte| u64::from(*byte)).sum();
        let after = ProcessNumbers::now();
        assert_eq!(sum, 64 << 20);
        // Other tests may have given memory back meanwhile.
        assert!(after.resident_bytes >= 64 << 20, "{after:?}");
        assert!(after.cpu_s >= before.cpu_s);
    }
}
