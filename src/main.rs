//! The `sonoweave` command.

use std::process::ExitCode;

/// The allocator of the static program. With musl's own, it would take up to 1.6 times as long.
#[cfg(target_env = "musl")]
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() -> ExitCode {
    sonoweave::cli::main()
}
