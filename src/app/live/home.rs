//! Lets the user declare that the arm is in its home position, by a typed word or a signal.

use std::io::{BufRead as _, IsTerminal as _, stdin};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use signal_hook::consts::SIGUSR1;

use crate::failure::Failure;

/// Word to type.
const WORD: &str = "home";

/// Receiver of the user's word.
#[derive(Default)]
pub(crate) struct Home {
    /// Flag of the most recently opened arm, which a typed word sets. If set, a thread is
    /// reading lines until the program ends.
    typed: Option<Arc<Mutex<Arc<AtomicBool>>>>,
}

impl Home {
    /// Waits for the user's word for this arm from now on, and says what to do.
    ///
    /// # Errors
    /// [`Failure`] when the system refuses the signal handler.
    pub(crate) fn listen(&mut self, at_home: Arc<AtomicBool>, say: impl Fn(&str)) -> Result<(), Failure> {
        signal_hook::flag::register(SIGUSR1, Arc::clone(&at_home))?;
        let types = stdin().is_terminal();
        say(&how(types, std::process::id()));
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
        "the arm is not homed and gives no poses: move it through its index marks, or hold it in its home position and \
        {type_it}send SIGUSR1 (kill -USR1 {process})"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn how_names_word_and_signal() {
        assert!(how(true, 17).ends_with("and type \"home\" and Enter, or send SIGUSR1 (kill -USR1 17)"));
        assert!(how(false, 17).ends_with("hold it in its home position and send SIGUSR1 (kill -USR1 17)"));
    }
}
