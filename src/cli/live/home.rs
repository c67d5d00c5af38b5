//! How the user says that the arm is in its home position: by a word or a signal.

use std::io::{BufRead as _, IsTerminal as _, stdin};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use signal_hook::consts::SIGUSR1;

use crate::cli::Failure;

/// What is to be typed.
const WORD: &str = "home";

/// Takes the user's word from now on, and says how it is to be given.
///
/// # Errors
/// [`Failure`] when the system takes no handler.
pub(in crate::cli) fn listen(at_home: Arc<AtomicBool>, quiet: bool) -> Result<(), Failure> {
    signal_hook::flag::register(SIGUSR1, Arc::clone(&at_home))?;
    let types = stdin().is_terminal();
    if !quiet {
        super::outputs::say(&how(types, std::process::id()));
    }
    if types {
        // It waits for a line when the session has ended, too, and ends with the program.
        std::thread::Builder::new().name("home".into()).spawn(move || {
            for line in stdin().lock().lines().map_while(Result::ok) {
                if line.trim() == WORD {
                    at_home.store(true, Ordering::Relaxed);
                }
            }
        })?;
    }
    Ok(())
}

fn how(types: bool, process: u32) -> String {
    let type_it = if types { format!("type \"{WORD}\" and Enter, or ") } else { String::new() };
    format!(
        "an arm that is not homed gives no poses: move it through its index marks, or hold it in its home position and {type_it}send SIGUSR1 (kill -USR1 {process})"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_user_is_told_what_to_do() {
        assert!(how(true, 17).ends_with("and type \"home\" and Enter, or send SIGUSR1 (kill -USR1 17)"));
        assert!(how(false, 17).ends_with("hold it in its home position and send SIGUSR1 (kill -USR1 17)"));
    }
}
