//! Results of a run: its figures, and the checks that passed or failed.

use std::error::Error;
use std::path::Path;

use crate::{Figure, files};

/// Figures and checks of one run.
#[derive(Debug, Default)]
pub struct Findings {
    figures: Vec<Figure>,
    checks: usize,
    wrong: Vec<String>,
}

impl Findings {
    /// Adds a figure and writes it at once.
    ///
    /// # Errors
    /// If a file cannot be written.
    pub fn figure(&mut self, figure: Figure, folder: &Path) -> Result<(), Box<dyn Error>> {
        files::write(&figure, folder)?;
        self.figures.push(figure);
        Ok(())
    }

    /// Checks a statement that must hold on every machine; a failure fails the run at its end.
    pub fn check(&mut self, holds: bool, what: impl Into<String>) {
        self.checks += 1;
        if !holds {
            self.wrong(what);
        }
    }

    /// Counts a check that reports [`Self::wrong`] itself.
    pub fn counted(&mut self) {
        self.checks += 1;
    }

    /// Reports a failed check.
    pub fn wrong(&mut self, what: impl Into<String>) {
        self.wrong.push(what.into());
    }

    /// Returns the figures so far.
    pub fn figures(&self) -> &[Figure] {
        &self.figures
    }

    /// Prints the failures and the number of checks; returns whether all passed.
    #[allow(clippy::print_stdout, reason = "the last words of a run")]
    pub fn report(&self) -> bool {
        for what in &self.wrong {
            println!("WRONG: {what}");
        }
        println!("{} checks, {} wrong; {} figures", self.checks, self.wrong.len(), self.figures.len());
        self.wrong.is_empty()
    }
}
