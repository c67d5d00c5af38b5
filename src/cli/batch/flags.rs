//! Flags that several commands of `batch` take.

use std::time::Duration;

use clap::Args;

use super::values;
use crate::app::batch::child::Limits;
use crate::app::batch::run::RunOptions;
use crate::app::batch::select::Selection;
use crate::app::batch::sweep::Machine;
use crate::app::part::Part;

/// Flags that select sweeps.
#[derive(Debug, Clone, Args)]
pub(super) struct SelectionFlags {
    /// Only the sweep of this id; may be given several times
    #[arg(long, value_name = "ID", conflicts_with = "part")]
    only: Vec<String>,
    /// Only the part K of N: each sweep is in one, by a hash of its id
    #[arg(long, value_name = "K/N")]
    part: Option<Part>,
}

impl SelectionFlags {
    /// Returns the selection.
    pub(super) fn selection(&self) -> Selection {
        Selection { only: self.only.clone(), part: self.part }
    }
}

/// Limits of a sweep's process, and the number of processes.
#[derive(Debug, Clone, Args)]
pub(super) struct LimitFlags {
    /// Sweeps at a time [default: as many as processors, if their memory suffices]
    #[arg(long, value_name = "JOBS", value_parser = clap::value_parser!(u16).range(1..=1024))]
    jobs: Option<u16>,
    /// Tries of a sweep, unless its failure would be the same again
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u32).range(1..=100))]
    attempts: u32,
    /// Longest time of a try, after which it is killed
    #[arg(long, value_name = "TIME", default_value = "1h", value_parser = values::time)]
    timeout: Duration,
    /// Most memory of a sweep's process: its address space
    #[arg(long, value_name = "SIZE", default_value = "8GiB", value_parser = values::memory)]
    memory: u64,
}

impl LimitFlags {
    /// Returns the settings of a run.
    pub(super) fn options(&self, selection: Selection, fails_fast: bool, counts_earlier: bool) -> RunOptions {
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        let about = rustix::system::sysinfo();
        let memory = (about.totalram as u64).saturating_mul(u64::from(about.mem_unit));
        let fitting = usize::try_from(memory / self.memory).unwrap_or(1).clamp(1, cores);
        let jobs = self.jobs.map_or(fitting, usize::from);
        RunOptions {
            selection,
            jobs,
            attempts: self.attempts,
            machine: Machine {
                limits: Limits { memory_bytes: self.memory, timeout: self.timeout },
                threads: (cores / jobs).max(1),
            },
            fails_fast,
            counts_earlier,
        }
    }
}
