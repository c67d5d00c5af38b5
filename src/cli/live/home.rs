//! How the user says that the arm is in its home position: by a word or a signal.

use std::io::{BufRead as _, IsTerminal as _, stdin};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use signal_hook::consts::SIGUSR1;

use crate::cli::Failure;

/// What is to be typed.
const WORD: &str = "home";

/// Who takes the user's word.
#[derive(Default)]
pub(in crate::cli) struct Home {
    /// Whom a typed word is told to: the arm that was opened last. There once a line is waited for, which lasts as long as the program.
    typed: Option<Arc<Mutex<Arc<AtomicBool>>>>,
}

impl Home {
    /// Takes the user's word from now on, for this arm, and says how it is to be given.
    ///
    /// # Errors
    /// [`Failure`] when the system takes no handler.
    pub(in crate::cli) fn listen(&mut self, at_home: Arc<AtomicBool>, quiet: bool) -> Result<(), Failure> {
        signal_hook::flag::register(SIGUSR1, Arc::clone(&at_home))?;
        let types = stdin().is_terminal();
        if !quiet {
            super::outputs::say(&how(types, std::process::id()));
        }
        if let Some(typed) = &self.typed {
            *typed.lock().unwrap_or_else(PoisonError::into_inner) = at_home;
        } else if types {
            let typed = Arc::new(Mutex::new(at_home));
            self.typed = Some(Arc::clone(&typed));
            std::thread::Builder::new().name("home".into()).spawn(move || {
                for line in stdin().lock().lines().map_while(Result::ok) {
                    if line.trim() == WORD {
                        typed.lock().unwrap_or_else(PoisonError::into_inner).store(true, Ordering::Relaxed);
                    }
                }
            })?;
        }
        Ok(())
    }
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
