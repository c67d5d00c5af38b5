//! The `sonoweave` command: parse, call, exit code.

use std::process::ExitCode;

use sonoweave::cli;

#[allow(clippy::print_stderr, reason = "the one place where a command's failure is said")]
fn main() -> ExitCode {
    match cli::run(&cli::Arguments::of_process()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(cli::Failure(sentence)) => {
            eprintln!("sonoweave: {sentence}");
            ExitCode::FAILURE
        }
    }
}
