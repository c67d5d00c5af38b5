//! `--json`: the report of a command as one JSON document, in the same form for every command.

use std::convert::Infallible;
use std::io::{ErrorKind, Write as _};
use std::path::{Path, PathBuf};
use std::str::FromStr;

use clap::Args;
use serde::Serialize;

use formats::whole::write_whole;

use super::document;
use crate::app::input;
use crate::failure::Failure;

/// Value of the flag without a file.
const STDOUT: &str = "-";

/// Place of the document.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Json {
    /// To stdout, where the text is then left out.
    Stdout,
    /// To a file, beside the text.
    File(PathBuf),
}

impl FromStr for Json {
    type Err = Infallible;

    fn from_str(text: &str) -> Result<Self, Infallible> {
        Ok(if text == STDOUT { Self::Stdout } else { Self::File(text.into()) })
    }
}

/// The flag `--json[=FILE]`.
#[derive(Debug, Clone, Default, Args)]
pub(crate) struct JsonFlag {
    /// Print the report as one JSON document instead of text; with a file, write it there beside
    /// the text
    #[arg(long, value_name = "FILE.json", num_args = 0..=1, require_equals = true, default_missing_value = STDOUT)]
    json: Option<Json>,
}

impl JsonFlag {
    /// Returns the flag with a file.
    pub(crate) fn to_file(path: PathBuf) -> Self {
        Self { json: Some(Json::File(path)) }
    }

    /// Returns the file, if one is to be written.
    pub(crate) fn file(&self) -> Option<&Path> {
        match &self.json {
            Some(Json::File(path)) => Some(path),
            _ => None,
        }
    }

    /// Whether a document is wanted.
    pub(crate) fn is_wanted(&self) -> bool {
        self.json.is_some()
    }

    /// Checks before the work that the file can be written and is none of the inputs.
    ///
    /// # Errors
    /// [`Failure`] with the first violation.
    pub(crate) fn check<'a>(&self, inputs: impl IntoIterator<Item = &'a Path>) -> Result<(), Failure> {
        let Some(path) = self.file() else { return Ok(()) };
        input::check_output(path)?;
        inputs.into_iter().try_for_each(|input| input::check_is_not(path, input))
    }

    /// Writes the report where the flag says, if it was given.
    ///
    /// # Errors
    /// [`Failure`]: the file does not exist then.
    pub(crate) fn write(&self, report: &impl Serialize) -> Result<(), Failure> {
        if self.is_wanted() { self.write_text(&document(report)?) } else { Ok(()) }
    }

    /// Writes a finished document. A closed pipe is no error.
    ///
    /// # Errors
    /// [`Failure`]: the file does not exist then.
    pub(crate) fn write_text(&self, document: &str) -> Result<(), Failure> {
        match &self.json {
            None => Ok(()),
            Some(Json::Stdout) => match std::io::stdout().write_all(document.as_bytes()) {
                Err(error) if error.kind() != ErrorKind::BrokenPipe => Err(Failure::stdout(&error)),
                _ => Ok(()),
            },
            Some(Json::File(path)) => write_whole(path, |to| to.write_all(document.as_bytes()))
                .map_err(|error| Failure::io(path, "writing", &error)),
        }
    }
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Parser)]
    struct Command {
        words: Vec<String>,
        #[command(flatten)]
        json: JsonFlag,
    }

    #[test]
    fn file_needs_equals_sign_else_stdout() {
        let parsed = Command::parse_from(["x", "--json", "a.json"]);
        assert_eq!((parsed.json.json, parsed.words), (Some(Json::Stdout), vec!["a.json".to_owned()]));
        let parsed = Command::parse_from(["x", "--json=a.json", "b"]);
        assert_eq!(parsed.json.file(), Some(Path::new("a.json")));
        assert!(!Command::parse_from(["x"]).json.is_wanted());
    }

    #[test]
    fn json_file_is_whole_document() {
        let folder = tempfile::tempdir().unwrap();
        let flag = JsonFlag::to_file(folder.path().join("r.json"));
        flag.write(&["a", "b"]).unwrap();
        let text = std::fs::read_to_string(folder.path().join("r.json")).unwrap();
        assert_eq!(text, "[\n  \"a\",\n  \"b\"\n]\n");
        assert!(flag.check([folder.path().join("r.json").as_path()]).is_err());
        assert!(JsonFlag::to_file(folder.path().join("none/r.json")).check([]).is_err());
    }
}
