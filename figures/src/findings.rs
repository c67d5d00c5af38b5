//! What a run finds: its pictures, and the statements that held or did not.

use std::error::Error;
use std::path::Path;

use crate::{Figure, files};

/// Pictures and checks of one run.
#[derive(Debug, Default)]
pub struct Findings {
    figures: Vec<Figure>,
    checks: usize,
    wrong: Vec<String>,
}

impl Findings {
    /// Adds a picture and writes it at once.
    ///
    /// # Errors
    /// When a file cannot be written.
    pub fn figure(&mut self, figure: Figure, folder: &Path) -> Result<(), Box<dyn Error>> {
        files::write(&figure, folder)?;
        self.figures.push(figure);
        Ok(())
    }

    /// What must be so on every machine; what is not fails the run in its end.
    pub fn check(&mut self, holds: bool, what: impl Into<String>) {
        self.checks += 1;
        if !holds {
            self.wrong(what);
        }
    }

    /// A check that says itself what is [wrong](Self::wrong).
    pub fn counted(&mut self) {
        self.checks += 1;
    }

    /// What is not as it must be.
    pub fn wrong(&mut self, what: impl Into<String>) {
        self.wrong.push(what.into());
    }

    /// The pictures so far.
    pub fn figures(&self) -> &[Figure] {
        &self.figures
    }

    /// Says on stdout what was wrong and how much was checked; whether nothing was.
    #[allow(clippy::print_stdout, reason = "the last words of a run")]
    pub fn tell(&self) -> bool {
        for what in &self.wrong {
            println!("WRONG: {what}");
        }
        println!("{} checks, {} wrong; {} figures", self.checks, self.wrong.len(), self.figures.len());
        self.wrong.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_wrong_statement_among_many_fails_the_run() {
        let mut findings = Findings::default();
        findings.check(true, "two and two are four");
        findings.counted();
        assert!(findings.tell());
        findings.check(false, "two and two are five");
        assert!(!findings.tell());
        assert_eq!((findings.checks, findings.wrong.len()), (3, 1));
    }
}
