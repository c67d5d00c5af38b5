//! The file of a session's corrections, beside the session: `SESSION.corrections.jsonl`.
//!
//! Each line is a JSON document: a correction, or the number of one that was undone. Lines are
//! only added. The session itself is a recording of readings, and stays as it is, bit by bit.

use std::fs::{File, OpenOptions};
use std::io::{ErrorKind, Read as _, Write as _};
use std::path::{Path, PathBuf};

use formats::whole::{folder_of, sync_folder};
use sonoweave_core::date::Date;

use super::note::{Correction, Kind, Line, Note};
use crate::app::provenance::program;
use crate::failure::Failure;

/// Largest size of a file, bytes.
const MOST_BYTES: u64 = 1 << 30;

/// A session's corrections, read from their file.
#[derive(Debug)]
pub(crate) struct CorrectionFile {
    path: PathBuf,
    lines: Vec<Line>,
}

impl CorrectionFile {
    /// Reads the corrections of a session; none if the file does not exist.
    ///
    /// # Errors
    /// [`Failure`] with the line, if the file cannot be read.
    pub(crate) fn of(session: &Path) -> Result<Self, Failure> {
        let path = session.with_extension("corrections.jsonl");
        let failed = |why: String| Failure::new(format!("{}: {why}", path.display()));
        let mut text = String::new();
        match File::open(&path) {
            Ok(file) => drop(file.take(MOST_BYTES).read_to_string(&mut text).map_err(|why| failed(why.to_string()))?),
            Err(why) if why.kind() == ErrorKind::NotFound => {}
            Err(why) => return Err(failed(why.to_string())),
        }
        if !text.is_empty() && !text.ends_with('\n') {
            let last = text.lines().count();
            return Err(failed(format!("line {last} is cut off; delete that line, and compute its correction again")));
        }
        let mut read = Self { path: path.clone(), lines: Vec::new() };
        for (at, text) in text.lines().enumerate() {
            let wrong = |why: String| failed(format!("line {}: {why}; restore the file, or delete the line", at + 1));
            let line: Line = serde_json::from_str(text).map_err(|why| wrong(why.to_string()))?;
            match &line.note {
                Note::Correction(new) if new.id != read.last_id() + 1 => {
                    return Err(wrong(format!("correction {} follows correction {}", new.id, read.last_id())));
                }
                Note::CorrectionUndone(id) if read.standing(*id).is_none() => {
                    return Err(wrong(format!("undoes correction {id}, which does not stand")));
                }
                Note::Correction(_) | Note::CorrectionUndone(_) => read.lines.push(line),
            }
        }
        Ok(read)
    }

    /// Returns the path of the file.
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// Returns all corrections that were accepted, and whether each stands: it was not undone.
    /// With each is the program that wrote it.
    pub(crate) fn all(&self) -> impl Iterator<Item = (&Correction, &str, bool)> {
        self.lines.iter().filter_map(|line| match &line.note {
            Note::Correction(correction) => Some((&**correction, &*line.program, !self.is_undone(correction.id))),
            Note::CorrectionUndone(_) => None,
        })
    }

    /// Returns a correction that stands.
    pub(crate) fn standing(&self, id: u64) -> Option<&Correction> {
        self.all().find(|(correction, _, stands)| correction.id == id && *stands).map(|(correction, ..)| correction)
    }

    fn is_undone(&self, id: u64) -> bool {
        self.lines.iter().any(|line| matches!(line.note, Note::CorrectionUndone(undone) if undone == id))
    }

    fn last_id(&self) -> u64 {
        self.all().map(|(correction, ..)| correction.id).max().unwrap_or(0)
    }

    /// Adds a correction, with the next number, which is returned.
    ///
    /// # Errors
    /// [`Failure`] if a correction of its kind stands already, or the file cannot be written.
    pub(crate) fn accept(&mut self, correction: Correction) -> Result<u64, Failure> {
        self.check(correction.kind)?;
        let id = self.last_id() + 1;
        self.add(Note::Correction(Box::new(Correction { id, ..correction })))?;
        Ok(id)
    }

    /// Checks before the work that no correction of a kind stands.
    ///
    /// # Errors
    /// [`Failure`] with its number.
    pub(crate) fn check(&self, kind: Kind) -> Result<(), Failure> {
        if let Some((old, ..)) = self.all().find(|(old, _, stands)| *stands && old.kind == kind) {
            fail!("correction {} is a {kind}, too; run `sonoweave correct undo SESSION {0}` before", old.id);
        }
        Ok(())
    }

    /// Undoes a correction.
    ///
    /// # Errors
    /// [`Failure`] if it does not stand, or the file cannot be written.
    pub(crate) fn undo(&mut self, id: u64) -> Result<(), Failure> {
        if self.standing(id).is_none() {
            fail!("there is no correction {id} to undo; list them: sonoweave correct list SESSION");
        }
        self.add(Note::CorrectionUndone(id))
    }

    /// Adds a line to the file, and waits until it is on the disk.
    fn add(&mut self, note: Note) -> Result<(), Failure> {
        let line = Line { date: Date::today().to_string(), program: program(), note };
        let text = serde_json::to_string(&line)? + "\n";
        let write = || {
            let mut file = OpenOptions::new().append(true).create(true).open(&self.path)?;
            file.write_all(text.as_bytes())?;
            file.sync_all()?;
            sync_folder(folder_of(&self.path))
        };
        write().map_err(|why| Failure::new(format!("{}: {why}", self.path.display())))?;
        self.lines.push(line);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::super::note::CorrectionResult;
    use super::*;

    fn correction(kind: Kind) -> Correction {
        Correction {
            id: 0,
            kind,
            version: kind.version(),
            inputs: "ab".repeat(32),
            settings: [("pairing.smoothing_ms".to_owned(), 300.into())].into(),
            evidence: serde_json::Map::new(),
            result: CorrectionResult::Poses(vec![(7, [0.1 + 0.2; 12])]),
        }
    }

    #[test]
    fn corrections_are_added_and_undone_but_never_removed() {
        let folder = tempfile::tempdir().unwrap();
        let session = folder.path().join("SESSION-20261121-213000.mcap");
        let mut file = CorrectionFile::of(&session).unwrap();
        assert!(file.all().next().is_none() && !file.path().exists());
        assert_eq!(file.accept(correction(Kind::Smoothing)).unwrap(), 1);
        let refused = file.accept(correction(Kind::Smoothing)).unwrap_err().0.sentence;
        assert!(refused.contains("correction 1 is a smoothing, too; run `sonoweave correct undo"), "{refused}");
        assert_eq!(file.accept(correction(Kind::Calibration)).unwrap(), 2);
        file.undo(1).unwrap();
        assert!(file.undo(1).unwrap_err().0.sentence.contains("no correction 1 to undo"));
        assert_eq!(file.accept(correction(Kind::Smoothing)).unwrap(), 3);
        assert!(file.path().ends_with("SESSION-20261121-213000.corrections.jsonl"));
        let again = CorrectionFile::of(&session).unwrap();
        assert_eq!(again.lines, file.lines, "numbers are read as they were written, bit by bit");
        let stands: Vec<_> = again.all().map(|(correction, _, stands)| (correction.id, stands)).collect();
        assert_eq!(stands, [(1, false), (2, true), (3, true)]);
    }

    #[test]
    fn damaged_file_is_refused_with_its_line() {
        let folder = tempfile::tempdir().unwrap();
        let session = folder.path().join("s.mcap");
        let mut file = CorrectionFile::of(&session).unwrap();
        file.accept(correction(Kind::Smoothing)).unwrap();
        file.undo(1).unwrap();
        let text = fs::read_to_string(file.path()).unwrap();
        let refused = |text: &str| {
            fs::write(file.path(), text).unwrap();
            CorrectionFile::of(&session).unwrap_err().0.sentence
        };
        assert!(refused(text.trim_end()).contains("s.corrections.jsonl: line 2 is cut off; delete that line"));
        assert!(
            refused(&text.replace("correction_undone\":1", "correction_undone\":4"))
                .contains("line 2: undoes correction 4")
        );
        assert!(refused(&text.replace("\"id\":1", "\"id\":2")).contains("line 1: correction 2 follows correction 0"));
        assert!(refused(&text.replace("smoothing\"", "tightening\"")).contains("line 1: unknown variant"));
    }
}
