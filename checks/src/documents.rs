//! Documents: blocks with the text of a template, between `<!-- table: NAME -->` and
//! `<!-- end -->`; and measured figures outside of them.

use std::collections::{BTreeMap, BTreeSet};
use std::error::Error;
use std::fs;
use std::path::Path;

use crate::record::{self, Figure, Run};
use crate::sources::Checkout;
use crate::template::{Records, Template, lookup};

const END: &str = "<!-- end -->";

/// Units of measured figures, in a cell behind the number or in the head of its column.
const UNITS: [&str; 12] = ["ms", "s", "mm", "%", "MB", "µs", "RMSE", "rms", "a second", "bytes", "seconds", "mm,"];

/// Documents by their paths, templates and records by their names, and what git knows of them.
#[derive(Debug, Default)]
pub struct Documents {
    /// Markdown by path.
    pub pages: BTreeMap<String, String>,
    /// Templates by name.
    pub templates: BTreeMap<String, String>,
    /// Records by name.
    pub records: Records,
    /// Hashes of today's sources by path; `None` without git.
    pub today: Option<BTreeMap<String, String>>,
}

/// A block in a page.
struct Block<'a> {
    line: usize,
    name: &'a str,
    text: &'a str,
}

impl Documents {
    /// Reads `README.md`, `CONTRIBUTING.md`, the pages of `docs/`, templates and records. Today's
    /// sources are unknown without `checkout`.
    ///
    /// # Errors
    /// If a file cannot be read, a record is invalid, or git refuses.
    pub fn read(root: &Path, checkout: Option<&Checkout>) -> Result<Self, Box<dyn Error>> {
        let mut documents = Self { records: record::read_all(&root.join(crate::FOLDER))?, ..Self::default() };
        let text = |path: &Path| fs::read_to_string(path).map_err(|e| format!("{}: {e}", path.display()));
        for page in ["README.md", "CONTRIBUTING.md"] {
            documents.pages.insert(page.to_owned(), text(&root.join(page))?);
        }
        for folder in ["docs", crate::FOLDER] {
            for entry in fs::read_dir(root.join(folder))? {
                let path = entry?.path();
                let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
                match path.extension().and_then(|end| end.to_str()) {
                    Some("md") => drop(documents.pages.insert(format!("{folder}/{stem}.md"), text(&path)?)),
                    Some("in") => drop(documents.templates.insert(stem, text(&path)?)),
                    _ => {}
                }
            }
        }
        if let Some(checkout) = checkout {
            let paths: BTreeSet<&str> =
                documents.records.values().flat_map(|record| record.sources.keys()).map(String::as_str).collect();
            documents.today = Some(checkout.today(paths)?);
        }
        Ok(documents)
    }

    /// Returns whether a record measured the sources of today. Without git none is known to.
    fn is_current(&self, record: &str) -> bool {
        let Some((record, today)) = self.records.get(record).zip(self.today.as_ref()) else { return false };
        record.sources.iter().all(|(path, hash)| today.get(path) == Some(hash))
    }

    /// Returns the path and the new text of each page whose blocks are not their templates' text.
    ///
    /// # Errors
    /// The first fault of a block, a template or a record, as `path:line: sentence`.
    pub fn renewed(&self) -> Result<Vec<(String, String)>, String> {
        let mut renewed = Vec::new();
        for (path, page) in &self.pages {
            let mut text = String::new();
            let mut rest = 0;
            for block in blocks(page).map_err(|(line, fault)| format!("{path}:{line}: {fault}"))? {
                let rendered = self.template(block.name).and_then(|t| t.render(&self.records, |r| self.is_current(r)));
                let rendered = rendered.map_err(|fault| format!("{path}:{}: {fault}", block.line))?;
                let from = block.text.as_ptr() as usize - page.as_ptr() as usize;
                text += &page[rest..from];
                text += &format!("\n{rendered}\n\n");
                rest = from + block.text.len();
            }
            text += &page[rest..];
            if text != *page {
                renewed.push((path.clone(), text));
            }
        }
        Ok(renewed)
    }

    fn template(&self, name: &str) -> Result<Template<'_>, String> {
        let text = self.templates.get(name).ok_or_else(|| format!("there is no template {name:?}"))?;
        Template::new(text)
    }

    /// Returns all findings, as `path:line: sentence`.
    pub fn findings(&self) -> Vec<String> {
        let mut findings = Vec::new();
        let mut shown = BTreeSet::new();
        for (path, page) in &self.pages {
            let blocks = match blocks(page) {
                Ok(blocks) => blocks,
                Err((line, fault)) => {
                    findings.push(format!("{path}:{line}: {fault}"));
                    continue;
                }
            };
            for block in &blocks {
                shown.insert(block.name);
                findings.extend(self.fault(block).map(|fault| format!("{path}:{}: {fault}", block.line)));
            }
            findings.extend(unmarked(page, &blocks).into_iter().map(|(line, of)| format!("{path}:{line}: {of}")));
        }
        findings.extend(self.unused(&shown));
        findings
    }

    /// Returns what is wrong with a block's text.
    fn fault(&self, block: &Block<'_>) -> Option<String> {
        let template = match self.template(block.name) {
            Ok(template) => template,
            Err(fault) => return Some(fault),
        };
        let (records, statements) = (template.records(), template.statements());
        if let Some(record) = records.iter().find(|record| !statements.contains(*record)) {
            return Some(format!("the template {:?} has figures of {record:?} without {{{record}}}", block.name));
        }
        let text = block.text.trim_matches('\n');
        let rendered = |current: &dyn Fn(&str) -> bool| template.render(&self.records, current);
        let past = match rendered(&|_| false) {
            Ok(past) => past,
            Err(fault) => return Some(fault),
        };
        let present = rendered(&|_| true).unwrap_or_default();
        // It is always true that figures were measured at their commit.
        if text == past || rendered(&|record| self.is_current(record)).is_ok_and(|now| text == now) {
            return None;
        }
        if text != present {
            return Some(format!("not the text of the template {:?}; `make numbers` renews it", block.name));
        }
        let today = self.today.as_ref()?;
        let changed = records.iter().filter_map(|record| self.records.get(*record)).flat_map(|record| &record.sources);
        let changed = changed.filter(|(path, hash)| today.get(*path) != Some(hash)).map(|(path, _)| path.as_str());
        let changed = changed.collect::<Vec<_>>().join(", ");
        Some(format!("{changed} changed since the measurement; `make numbers` states its commit, or measure again"))
    }

    /// Returns templates, records and figures that no page shows, and figures within templates.
    fn unused(&self, shown: &BTreeSet<&str>) -> Vec<String> {
        let mut findings = Vec::new();
        let mut used = BTreeSet::new();
        for (name, text) in &self.templates {
            let path = format!("{}/{name}.in", crate::FOLDER);
            if !shown.contains(name.as_str()) {
                findings.push(format!("{path}:1: no page shows this template"));
            }
            let Ok(template) = Template::new(text) else { continue };
            for (record, figure) in template.figures() {
                let found = self.records.get(record).and_then(|record| lookup(&record.figures, figure));
                used.extend(found.map(|(whole, _)| (record, whole)));
            }
            let text = template.text();
            let literal = tables(&text).into_iter().flat_map(|table| measured(&table));
            findings.extend(literal.map(|(line, cell)| format!("{path}:{line}: {cell:?} is not from a record")));
        }
        for (name, record) in &self.records {
            let unused = record.figures.keys().filter(|figure| !used.contains(&(name.as_str(), figure.as_str())));
            findings.extend(unused.map(|f| format!("{}/{name}.json:1: no template shows {f:?}", crate::FOLDER)));
        }
        findings
    }

    /// Returns the figures of a run that templates show, for the record of this name.
    ///
    /// # Errors
    /// The reason why the run's figures cannot be shown.
    pub fn shown(&self, name: &str, run: &Run) -> Result<BTreeMap<String, Figure>, String> {
        if run.quick {
            return Err("a quick run measures no times".into());
        }
        let templates = self.templates.values().filter_map(|text| Template::new(text).ok());
        let names: BTreeSet<&str> =
            templates.flat_map(|t| t.figures()).filter(|(of, _)| *of == name).map(|(_, figure)| figure).collect();
        if names.is_empty() {
            return Err("no template shows its figures".into());
        }
        let absent: Vec<String> =
            names.iter().filter(|n| lookup(&run.figures, n).is_none()).map(|n| format!("{n:?}")).collect();
        if !absent.is_empty() {
            return Err(format!("templates also show {}", absent.join(", ")));
        }
        let figures = names.iter().filter_map(|name| lookup(&run.figures, name));
        Ok(figures.map(|(name, _)| (name.to_owned(), run.figures[name].clone())).collect())
    }
}

/// Returns the blocks of a page, or the line of a marker without its counterpart.
fn blocks(page: &str) -> Result<Vec<Block<'_>>, (usize, String)> {
    let mut blocks = Vec::new();
    let mut open: Option<(usize, &str, usize)> = None;
    let mut at = 0;
    for (i, line) in page.split_inclusive('\n').enumerate() {
        let (number, marker) = (i + 1, line.trim());
        let name = marker.strip_prefix("<!-- table: ").and_then(|rest| rest.strip_suffix(" -->"));
        match (name, open) {
            (Some(_), Some(_)) => return Err((number, "a block within a block".into())),
            (Some(name), None) => open = Some((number, name, at + line.len())),
            (None, Some((line, name, from))) if marker == END => {
                blocks.push(Block { line, name, text: &page[from..at] });
                open = None;
            }
            (None, None) if marker == END => return Err((number, "the end of no block".into())),
            _ => {}
        }
        at += line.len();
    }
    match open {
        Some((line, name, _)) => Err((line, format!("the block {name:?} has no {END}"))),
        None => Ok(blocks),
    }
}

/// Returns lines outside of blocks with measured figures in a table, or with the commit of a
/// measurement.
fn unmarked(page: &str, blocks: &[Block<'_>]) -> Vec<(usize, String)> {
    let within = |line: usize| blocks.iter().any(|b| line > b.line && line <= b.line + b.text.lines().count());
    let cells = tables(page).into_iter().flat_map(|table| measured(&table));
    let mut findings: Vec<(usize, String)> = cells
        .filter(|(line, _)| !within(*line))
        .map(|(line, cell)| (line, format!("{cell:?} is measured and has no record: add a template and a block")))
        .collect();
    for (i, line) in page.lines().enumerate().filter(|(i, _)| !within(i + 1)) {
        let words: Vec<&str> = line.split(|c: char| !c.is_ascii_alphanumeric()).filter(|w| !w.is_empty()).collect();
        let is_commit = |pair: &[&str]| {
            let [before, word] = pair else { return false };
            let hexadecimal = (7..=40).contains(&word.len()) && word.bytes().all(|b| b.is_ascii_hexdigit());
            hexadecimal && matches!(*before, "commit" | "Commit" | "at")
        };
        if words.windows(2).any(is_commit) {
            findings.push((i + 1, "a commit's measurement outside of a block".into()));
        }
    }
    findings
}

/// Returns the tables of a page: each line's number and cells, the head first.
fn tables(page: &str) -> Vec<Vec<(usize, Vec<&str>)>> {
    let mut tables: Vec<Vec<(usize, Vec<&str>)>> = Vec::new();
    let mut last = 0;
    let mut is_code = false;
    for (i, line) in page.lines().enumerate() {
        is_code ^= line.trim_start().starts_with("```");
        let Some(row) = line.strip_prefix('|').filter(|_| !is_code) else { continue };
        let cells: Vec<&str> = row.trim_end().trim_end_matches('|').split('|').map(str::trim).collect();
        match tables.last_mut().filter(|_| last == i && i > 0) {
            Some(table) => table.push((i + 1, cells)),
            None => tables.push(vec![(i + 1, cells)]),
        }
        last = i + 1;
    }
    tables
}

/// Returns the cells of a table that begin with a measured figure, by their lines: a number with
/// decimals or a unit, or one in a column whose head has a unit. The first column names the rows.
fn measured<'a>(table: &[(usize, Vec<&'a str>)]) -> Vec<(usize, &'a str)> {
    let Some((head, rows)) = table.split_first() else { return Vec::new() };
    let has_unit = |text: &str| text.split([' ', ',', '(', ')']).any(|word| UNITS.contains(&word));
    let heads: Vec<bool> = head.1.iter().map(|head| has_unit(head) || head.contains("a second")).collect();
    let mut found = Vec::new();
    for (line, cells) in rows {
        for (column, cell) in cells.iter().enumerate().skip(1) {
            let bare = cell.trim_start_matches(['*', '−', '-', '+', '±', '~', '(']);
            let number: String = bare.chars().take_while(|c| c.is_ascii_digit() || *c == '.').collect();
            if !number.starts_with(|c: char| c.is_ascii_digit()) {
                continue;
            }
            let behind = bare[number.len()..].trim_start_matches('*');
            let is_decimal = number.trim_end_matches('.').contains('.');
            let unit = behind.strip_prefix(' ').and_then(|rest| rest.split([' ', ',', ';']).next());
            if is_decimal || unit.is_some_and(|unit| UNITS.contains(&unit)) || heads.get(column) == Some(&true) {
                found.push((*line, *cell));
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::{Machine, Record};

    /// A page with one block, which shows one figure of `crates/a`.
    fn sample(block: &str) -> Documents {
        let hash = "1".repeat(40);
        let record = Record {
            peers: [].into(),
            commit: "0123abc".into(),
            date: "2026-11-21".into(),
            command: "make bench".into(),
            machine: Machine { cpu: "a Xeon".into(), cores: 2, os: "Debian".into() },
            sources: [("crates/a".to_owned(), hash.clone())].into(),
            figures: [("ms".to_owned(), Figure::Value(0.456))].into(),
        };
        let page = format!("# A\n\n<!-- table: speed -->\n{block}<!-- end -->\n\nend\n");
        Documents {
            pages: [("a.md".to_owned(), page)].into(),
            templates: [("speed".to_owned(), "{r}:\n\n| | ms |\n|---|---|\n| ours | {r/ms:2} |\n".to_owned())].into(),
            records: [("r".to_owned(), record)].into(),
            today: Some([("crates/a".to_owned(), hash)].into()),
        }
    }

    fn with(statement: &str, number: &str) -> Documents {
        sample(&format!(
            "\n{statement}, 2026-11-21, by `make bench`, on 2 cores of a Xeon:\n\n| | ms |\n|---|---|\n| ours | {number} |\n\n"
        ))
    }

    const PRESENT: &str = "The present sources, commit 0123abc";
    const PAST: &str = "Measured at 0123abc";

    fn changed(mut documents: Documents) -> Documents {
        documents.today = Some([("crates/a".to_owned(), "2".repeat(40))].into());
        documents
    }

    #[test]
    fn block_with_figures_of_its_record_passes() {
        assert_eq!(with(PRESENT, "0.46").findings(), [""; 0]);
        assert_eq!(with(PAST, "0.46").findings(), [""; 0]);
    }

    #[test]
    fn other_figure_than_the_records_is_found() {
        for statement in [PRESENT, PAST] {
            let found = with(statement, "0.45").findings();
            assert!(
                matches!(&found[..], [one] if one.starts_with("a.md:3: not the text of the template")),
                "{found:?}"
            );
        }
    }

    #[test]
    fn changed_sources_need_the_commit_beside_the_figures() {
        let found = changed(with(PRESENT, "0.46")).findings();
        assert!(matches!(&found[..], [one] if one.starts_with("a.md:3: crates/a changed")), "{found:?}");
        assert_eq!(changed(with(PAST, "0.46")).findings(), [""; 0]);
        // A measured folder that is gone has changed, too.
        let mut gone = with(PRESENT, "0.46");
        gone.today = Some(BTreeMap::new());
        assert_eq!(gone.findings().len(), 1);
    }

    #[test]
    fn without_git_either_statement_passes_and_figures_do_not() {
        for statement in [PRESENT, PAST] {
            let mut bare = with(statement, "0.46");
            bare.today = None;
            assert_eq!(bare.findings(), [""; 0]);
        }
        let mut bare = with(PRESENT, "0.45");
        bare.today = None;
        assert_eq!(bare.findings().len(), 1);
    }

    #[test]
    fn renewal_writes_figures_and_statement() {
        let (documents, past) = (sample(""), changed(sample("old\n")));
        let renewed = documents.renewed().expect("renewed");
        assert_eq!(renewed, [("a.md".to_owned(), with(PRESENT, "0.46").pages["a.md"].clone())]);
        assert_eq!(past.renewed().expect("renewed")[0].1, with(PAST, "0.46").pages["a.md"]);
        assert!(with(PRESENT, "0.46").renewed().expect("renewed").is_empty());
    }

    #[test]
    fn measured_table_without_block_is_found() {
        let lines = |text: &str| {
            let mut documents = with(PRESENT, "0.46");
            documents.pages.insert("b.md".into(), text.into());
            documents.findings().len()
        };
        assert_eq!(lines("| | ms |\n|---|---|\n| ours | 3 |\n| theirs | **4** |\n"), 2);
        assert_eq!(lines("| what | result |\n|---|---|\n| a | 0.29 off |\n| b | 53 % |\n"), 2);
        assert_eq!(lines("Commit 0123abc, 2026-11-21: fast.\n"), 1);
        assert_eq!(lines("| byte | field |\n|---|---|\n| 0 | 1 to 4 channels |\n| 2.5 | `0.2 s` |\n"), 0);
        assert_eq!(lines("```\n| | ms |\n|---|---|\n| ours | 3 |\n```\n"), 0);
    }

    #[test]
    fn faulty_markers_templates_and_records_are_found() {
        let found = |change: fn(&mut Documents)| {
            let mut documents = with(PRESENT, "0.46");
            change(&mut documents);
            documents.findings().join("\n")
        };
        let page = |text: &str| BTreeMap::from([("a.md".to_owned(), text.to_owned())]);
        assert!(found(|d| d.templates = BTreeMap::new()).contains("no template \"speed\""));
        assert!(found(|d| d.records = BTreeMap::new()).contains("no record"));
        assert!(found(|d| d.records.get_mut("r").expect("r").figures.clear()).contains("no figure \"r/ms\""));
        let second = |d: &mut Documents| {
            d.records.get_mut("r").expect("r").figures.insert("s".into(), Figure::Value(1.0));
        };
        assert!(found(second).contains("no template shows \"s\""));
        let literal = |d: &mut Documents| {
            d.templates.insert("speed".into(), "{r}\n\n| | ms |\n|---|---|\n| ours | 0.46 |\n| b | {r/ms:2} |".into());
        };
        assert!(found(literal).contains("\"0.46\" is not from a record"));
        let unstated = |d: &mut Documents| {
            d.templates.insert("speed".into(), "{r/ms:2}".into());
        };
        assert!(found(unstated).contains("without {r}"));
        for (text, fault) in [
            ("<!-- table: speed -->\n", "has no <!-- end -->"),
            ("<!-- end -->\n", "the end of no block"),
            ("<!-- table: speed -->\n<!-- table: speed -->\n<!-- end -->\n", "a block within a block"),
            ("", "no page shows this template"),
        ] {
            let documents = Documents { pages: page(text), ..with(PRESENT, "0.46") };
            assert!(documents.findings().join("\n").contains(fault), "{text}");
        }
    }

    #[test]
    fn whole_run_gives_the_shown_figures_only() {
        let documents = with(PRESENT, "0.46");
        let figures = [("ms".to_owned(), Figure::Value(1.0)), ("s".to_owned(), Figure::Value(2.0))];
        let run = Run { quick: false, figures: figures.clone().into(), peers: [].into() };
        assert_eq!(documents.shown("r", &run), Ok([figures[0].clone()].into()));
        assert!(documents.shown("new", &run).is_err_and(|e| e.contains("no template")));
        assert!(documents.shown("r", &Run { quick: true, ..run.clone() }).is_err_and(|e| e.contains("quick")));
        let partial = Run { figures: BTreeMap::new(), ..run };
        assert!(documents.shown("r", &partial).is_err_and(|e| e.contains("\"ms\"")));
    }
}
