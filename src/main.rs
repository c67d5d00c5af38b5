//! The `sonoweave` command.

use std::process::ExitCode;

fn main() -> ExitCode {
    sonoweave::cli::main()
}
