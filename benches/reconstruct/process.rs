//! Another program in a process of its own, controlled line by line.

use std::error::Error;
use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

/// Process that answers each line with a line.
pub(crate) struct Process {
    name: &'static str,
    log: PathBuf,
    child: Child,
    commands: ChildStdin,
    answers: BufReader<ChildStdout>,
}

impl Process {
    /// Starts a program. Its messages on stderr go into the file `log`.
    ///
    /// # Errors
    /// If the file cannot be created or the program cannot be started.
    pub(crate) fn start(name: &'static str, command: &mut Command, log: &Path) -> Result<Self, Box<dyn Error>> {
        let mut child = command
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(fs::File::create(log)?)
            .spawn()
            .map_err(|e| format!("{name} cannot be started: {e}"))?;
        let (Some(commands), Some(answers)) = (child.stdin.take(), child.stdout.take()) else {
            return Err("no pipes".into());
        };
        Ok(Self { name, log: log.to_owned(), child, commands, answers: BufReader::new(answers) })
    }

    /// Returns the next line.
    ///
    /// # Errors
    /// If the process has ended.
    pub(crate) fn answer(&mut self) -> Result<String, Box<dyn Error>> {
        let mut line = String::new();
        match self.answers.read_line(&mut line)? {
            0 => Err(format!(
                "{}'s process ended; its messages are in {}; make peers makes it anew",
                self.name,
                self.log.display()
            )
            .into()),
            _ => Ok(line.trim().to_owned()),
        }
    }

    /// Writes a command and returns its answer.
    ///
    /// # Errors
    /// If the process has ended.
    pub(crate) fn ask(&mut self, command: &str) -> Result<String, Box<dyn Error>> {
        // If the process has ended, the missing answer says so.
        let _ = writeln!(self.commands, "{command}").and_then(|()| self.commands.flush());
        self.answer()
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        // Errors only mean that the process has already ended.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
