//! Manifests of batches: a sweep a row, as CSV or JSON Lines.

use std::path::Path;

use serde_json::{Map, Value};

use crate::failure::{Failure, FailureKind};

/// Columns with a meaning; others are kept.
const COLUMNS: [&str; 8] = ["id", "recording", "calibration", "config", "settings", "subject", "session", "tags"];

/// Longest id, characters: it is the name of a folder.
const LONGEST_ID: usize = 100;

/// A sweep, as its row has it.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Row {
    /// Line in the manifest, from 1.
    pub(crate) line: u64,
    pub(crate) id: String,
    /// The recording, relative to the manifest's folder.
    pub(crate) recording: String,
    /// A calibration file, or the 16 numbers of `--image-to-probe`.
    pub(crate) calibration: Option<String>,
    pub(crate) config: Option<String>,
    /// Flags of `reconstruct`.
    pub(crate) settings: Vec<String>,
    pub(crate) subject: Option<String>,
    pub(crate) session: Option<String>,
    pub(crate) tags: Vec<String>,
    /// All other columns.
    pub(crate) other: Map<String, Value>,
}

/// A row that cannot be used, and why.
pub(crate) struct BadRow {
    pub(crate) line: u64,
    pub(crate) why: String,
}

/// Reads a manifest: JSON Lines if its name ends in `.jsonl` or `.ndjson`, else CSV.
///
/// # Errors
/// [`Failure`] when the file cannot be read or has no columns; the second list has rows that
/// cannot be used.
pub(crate) fn read(path: &Path) -> Result<(Vec<Row>, Vec<BadRow>), Failure> {
    let bytes = std::fs::read(path).map_err(|e| Failure::io(path, "reading", &e))?;
    let Ok(text) = std::str::from_utf8(&bytes) else {
        return Err(wrong(path, "holds bytes that are no text (UTF-8); save it as UTF-8"));
    };
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let is_json = path.extension().is_some_and(|end| end == "jsonl" || end == "ndjson");
    let rows = if is_json { json_lines(text) } else { csv_rows(path, text)? };
    let (mut good, mut bad) = (Vec::new(), Vec::new());
    let mut lines = std::collections::BTreeMap::new();
    for (line, fields) in rows {
        match fields.and_then(|fields| row(line, fields)) {
            Err(why) => bad.push(BadRow { line, why }),
            Ok(row) => match lines.insert(row.id.clone(), line) {
                Some(first) => {
                    let why = format!("id {}: stands in row {first}, too; give each sweep its own", row.id);
                    bad.push(BadRow { line, why });
                }
                None => good.push(row),
            },
        }
    }
    if good.is_empty() && bad.is_empty() {
        return Err(wrong(path, "has no rows; add a row for each sweep"));
    }
    Ok((good, bad))
}

fn wrong(path: &Path, why: &str) -> Failure {
    Failure::new(format!("{}: {why}", path.display())).of(FailureKind::Input)
}

/// Fields of a row, with its line.
type Fields = (u64, Result<Map<String, Value>, String>);

fn csv_rows(path: &Path, text: &str) -> Result<Vec<Fields>, Failure> {
    let unreadable = |e: csv::Error| wrong(path, &format!("cannot be read as CSV: {e}; correct that row"));
    let mut reader =
        csv::ReaderBuilder::new().flexible(true).trim(csv::Trim::All).comment(Some(b'#')).from_reader(text.as_bytes());
    let names = reader.headers().map_err(unreadable)?.clone();
    for needed in ["id", "recording"] {
        if !names.iter().any(|name| name == needed) {
            let found: Vec<&str> = names.iter().take(10).collect();
            let why = format!(
                "has no column {needed}; name the columns in the first line, with commas between them (found: {})",
                found.join(", ")
            );
            return Err(wrong(path, &why));
        }
    }
    if let Some(twice) = names.iter().find(|name| names.iter().filter(|other| other == name).count() > 1) {
        return Err(wrong(path, &format!("has two columns {twice:?}; give each its own name")));
    }
    let mut rows = Vec::new();
    let (mut line, mut counted) = (1, 0);
    for record in reader.records() {
        let record = record.map_err(unreadable)?;
        let at = begin_of(text, record.position().map_or(0, csv::Position::byte));
        line += text.get(counted..at).map_or(0, |skipped| skipped.matches('\n').count() as u64);
        counted = at;
        let fields = if record.len() == names.len() {
            let cells = names.iter().zip(&record).filter(|(_, cell)| !cell.is_empty());
            Ok(cells.map(|(name, cell)| (name.to_owned(), Value::from(cell))).collect())
        } else {
            Err(format!(
                "has {} cells, and the first line {} columns; put cells with commas between quotation marks",
                record.len(),
                names.len()
            ))
        };
        rows.push((line, fields));
    }
    Ok(rows)
}

/// Returns the first byte of a record that the reader begins at line ends or comments before it.
fn begin_of(text: &str, byte: u64) -> usize {
    let mut at = usize::try_from(byte).unwrap_or(text.len());
    while let Some(rest) = text.get(at..) {
        let skipped = match rest.bytes().next() {
            Some(b'\r' | b'\n') => 1,
            Some(b'#') => rest.find('\n').unwrap_or(rest.len()),
            _ => break,
        };
        at += skipped;
    }
    at
}

fn json_lines(text: &str) -> Vec<Fields> {
    let lines = (1..).zip(text.lines()).filter(|(_, line)| !line.trim().is_empty());
    let parsed = lines.map(|(number, line)| match serde_json::from_str(line) {
        Ok(Value::Object(fields)) => (number, Ok(fields)),
        Ok(_) => (number, Err("is no JSON object; write {\"id\": …, \"recording\": …}".into())),
        Err(e) => (number, Err(format!("is no JSON: {e}; correct it"))),
    });
    parsed.collect()
}

/// Returns the row of these fields.
fn row(line: u64, mut fields: Map<String, Value>) -> Result<Row, String> {
    let id = text(&mut fields, "id")?.ok_or("id: is missing; give each sweep one")?;
    check_id(&id)?;
    let recording = text(&mut fields, "recording")?.ok_or("recording: is missing; give a tracked sequence")?;
    let mut made = Row { line, id, recording, ..Row::default() };
    made.calibration = text(&mut fields, "calibration")?;
    made.config = text(&mut fields, "config")?;
    made.settings = words(&mut fields, "settings", |text| text.split_whitespace().map(str::to_owned).collect())?;
    made.subject = text(&mut fields, "subject")?;
    made.session = text(&mut fields, "session")?;
    let tags = |text: &str| text.split([';', ' ', ',']).filter(|tag| !tag.is_empty()).map(str::to_owned).collect();
    made.tags = words(&mut fields, "tags", tags)?;
    debug_assert!(COLUMNS.iter().all(|column| !fields.contains_key(*column)));
    made.other = fields;
    Ok(made)
}

/// Takes a text, or a number as its text; `None` if the field is absent, null or empty.
fn text(fields: &mut Map<String, Value>, name: &str) -> Result<Option<String>, String> {
    match fields.remove(name) {
        None | Some(Value::Null) => Ok(None),
        Some(Value::String(text)) => Ok(Some(text.trim().to_owned()).filter(|text| !text.is_empty())),
        Some(Value::Number(number)) => Ok(Some(number.to_string())),
        Some(other) => Err(format!("{name}: {other} must be a text")),
    }
}

/// Takes a list of texts; a single text is `split`.
fn words(
    fields: &mut Map<String, Value>,
    name: &str,
    split: impl Fn(&str) -> Vec<String>,
) -> Result<Vec<String>, String> {
    match fields.remove(name) {
        None | Some(Value::Null) => Ok(Vec::new()),
        Some(Value::String(text)) => Ok(split(&text)),
        Some(Value::Array(items)) => items
            .into_iter()
            .map(|item| match item {
                Value::String(text) => Ok(text),
                Value::Number(number) => Ok(number.to_string()),
                other => Err(format!("{name}: {other} must be a text")),
            })
            .collect(),
        Some(other) => Err(format!("{name}: {other} must be a text or a list of texts")),
    }
}

/// Checks that an id can be the name of a folder.
fn check_id(id: &str) -> Result<(), String> {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '.' | '_' | '-');
    let begins = id.starts_with(|c: char| c.is_ascii_alphanumeric());
    if begins && id.chars().all(is_plain) && id.len() <= LONGEST_ID {
        return Ok(());
    }
    Err(format!(
        "id {id:?}: names a folder, and must have 1 to {LONGEST_ID} letters, digits, points, hyphens and underscores, \
         the first a letter or a digit"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(name: &str, text: &str) -> Result<(Vec<Row>, Vec<BadRow>), Failure> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        read(&path)
    }

    #[test]
    fn csv_and_json_lines_give_the_same_rows() {
        let table = "\u{feff}id,recording,settings,tags,site\r\n# a note\r\n7,a.mha,\"--spacing 0.5,0.5,1\",x;y,Ulm\r\nb,\"b, c.mha\",,,\r\n";
        let (rows, bad) = of("m.csv", table).unwrap();
        assert!(bad.is_empty());
        assert_eq!([rows[0].line, rows[1].line], [3, 4]);
        assert_eq!(rows[0].settings, ["--spacing", "0.5,0.5,1"]);
        assert_eq!((rows[0].tags.join(" "), rows[0].other["site"].as_str()), ("x y".into(), Some("Ulm")));
        assert_eq!((rows[1].recording.as_str(), rows[1].other.len()), ("b, c.mha", 0));
        let lines = "{\"id\":7,\"recording\":\"a.mha\",\"settings\":[\"--spacing\",\"0.5,0.5,1\"],\"tags\":[\"x\",\"y\"],\"site\":\"Ulm\"}\n\n{\"id\":\"b\",\"recording\":\"b, c.mha\"}\n";
        let (same, bad) = of("m.jsonl", lines).unwrap();
        assert!(bad.is_empty());
        let unnumbered = |rows: Vec<Row>| rows.into_iter().map(|row| Row { line: 0, ..row }).collect::<Vec<_>>();
        assert_eq!(unnumbered(rows), unnumbered(same));
    }

    #[test]
    fn unusable_rows_are_named_by_line() {
        let table = "id,recording\na,x\na,y\n../b,z\n.c,z\n,z\nd,\ne,f,g\n";
        let (rows, bad) = of("m.csv", table).unwrap();
        assert_eq!(rows.len(), 1);
        assert_eq!(bad.iter().map(|bad| bad.line).collect::<Vec<_>>(), [3, 4, 5, 6, 7, 8]);
        let whys = ["row 2, too", "names a folder", "names a folder", "id: is missing", "recording: is", "3 cells"];
        for (bad, why) in bad.iter().zip(whys) {
            assert!(bad.why.contains(why), "{}", bad.why);
        }
        let (_, bad) = of("m.jsonl", "[1]\n{\"id\":{}}\n{\n").unwrap();
        assert_eq!(bad.len(), 3);
    }

    #[test]
    fn files_without_rows_or_columns_are_refused() {
        for (text, why) in [
            ("", "has no column id"),
            ("id;recording\na;b\n", "with commas between them"),
            ("id,recording\n", "has no rows"),
            ("id,recording,id\n", "two columns \"id\""),
        ] {
            let Err(Failure(crate::failure::Reason { sentence, kind })) = of("m.csv", text) else {
                panic!("{text:?} is read")
            };
            assert!(sentence.contains(why) && kind == FailureKind::Input, "{sentence}");
        }
    }
}
