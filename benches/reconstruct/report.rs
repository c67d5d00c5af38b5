//! Tables: printed with aligned columns, and written with all digits as CSV (one file per table)
//! and JSON (all of them). `figures.json` has each number by its name, for the records of
//! `docs/numbers`.

use std::error::Error;
use std::fs;
use std::path::Path;

use serde_json::{Map, Value, json};

use crate::timing::Times;

/// One entry of a table.
#[derive(Debug, Clone)]
pub(crate) enum Cell {
    /// A text.
    Text(String),
    /// A number, printed with this many decimals and written with all.
    Number(f64, usize),
    /// Quartiles, of which the median is shown; decimals.
    Spread([f64; 3], usize),
    /// An empty cell.
    Empty,
}

impl Cell {
    pub(crate) fn text(text: impl Into<String>) -> Self {
        Self::Text(text.into())
    }

    pub(crate) fn count(n: u64) -> Self {
        Self::Number(n as f64, 0)
    }

    pub(crate) fn spread(quartiles: [f64; 3], decimals: usize) -> Self {
        Self::Spread(quartiles, decimals)
    }

    fn shown(&self) -> String {
        match self {
            Self::Text(text) => text.clone(),
            Self::Number(value, decimals) | Self::Spread([_, value, _], decimals) => format!("{value:.decimals$}"),
            Self::Empty => "–".into(),
        }
    }

    fn json(&self) -> Value {
        match self {
            Self::Text(text) => json!(text),
            // JSON has no NaN; null marks a missing number.
            Self::Number(value, _) | Self::Spread([_, value, _], _) => json!(value),
            Self::Empty => Value::Null,
        }
    }

    fn csv(&self) -> String {
        match self {
            Self::Text(text) if text.contains([',', '"']) => format!("\"{}\"", text.replace('"', "\"\"")),
            Self::Text(text) => text.clone(),
            Self::Number(value, _) | Self::Spread([_, value, _], _) => value.to_string(),
            Self::Empty => String::new(),
        }
    }
}

/// A goal for a measured number.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Goal {
    AtMost(f64),
    AtLeast(f64),
}

impl Goal {
    fn is_met(self, measured: f64) -> bool {
        match self {
            Self::AtMost(limit) => measured <= limit,
            Self::AtLeast(limit) => measured >= limit,
        }
    }

    fn shown(self) -> String {
        match self {
            Self::AtMost(limit) => format!("≤ {limit}"),
            Self::AtLeast(limit) => format!("≥ {limit}"),
        }
    }
}

/// A table with named columns and rows of cells.
#[derive(Debug)]
pub(crate) struct Table {
    id: &'static str,
    title: String,
    notes: Vec<String>,
    columns: Vec<&'static str>,
    rows: Vec<Vec<Cell>>,
}

impl Table {
    /// Creates an empty table; `id` names the CSV file.
    pub(crate) fn new(id: &'static str, title: impl Into<String>, columns: &[&'static str]) -> Self {
        Self { id, title: title.into(), notes: Vec::new(), columns: columns.to_vec(), rows: Vec::new() }
    }

    pub(crate) fn note(&mut self, note: impl Into<String>) {
        self.notes.push(note.into());
    }

    /// Appends a row.
    ///
    /// # Panics
    /// If the row does not have one cell per column, which the caller must ensure.
    pub(crate) fn row(&mut self, cells: Vec<Cell>) {
        assert_eq!(cells.len(), self.columns.len(), "{}: a cell a column", self.title);
        self.rows.push(cells);
    }

    fn print(&self) {
        let shown: Vec<Vec<String>> = self.rows.iter().map(|row| row.iter().map(Cell::shown).collect()).collect();
        let width = |c: usize| {
            let cells = shown.iter().map(|row| row[c].chars().count()).max().unwrap_or(0);
            cells.max(self.columns[c].chars().count())
        };
        let widths: Vec<usize> = (0..self.columns.len()).map(width).collect();
        // Columns of numbers, with their gaps, are aligned right; texts are aligned left.
        let is_text = |c: usize| self.rows.iter().any(|row| matches!(row[c], Cell::Text(_)));
        let line = |cells: &[String]| {
            let padded = cells.iter().enumerate().map(|(c, cell)| {
                let pad = " ".repeat(widths[c] - cell.chars().count());
                if is_text(c) { format!("{cell}{pad}") } else { format!("{pad}{cell}") }
            });
            println!("  {}", padded.collect::<Vec<_>>().join("  ").trim_end());
        };
        println!("\n{}", self.title);
        line(&self.columns.iter().map(ToString::to_string).collect::<Vec<_>>());
        println!("  {}", "─".repeat(widths.iter().sum::<usize>() + 2 * (widths.len() - 1)));
        shown.iter().for_each(|row| line(row));
        self.notes.iter().for_each(|note| println!("  {note}"));
    }

    fn csv(&self) -> String {
        let mut text = self.columns.join(",") + "\n";
        for row in &self.rows {
            text += &row.iter().map(Cell::csv).collect::<Vec<_>>().join(",");
            text.push('\n');
        }
        text
    }

    /// Adds the numbers by their names: the table's, the row's texts, threads and parts, and the
    /// column's. Columns of quantiles are the spread of the column `median`.
    fn figures(&self, rounds: usize, figures: &mut Map<String, Value>) {
        for row in &self.rows {
            let cells = || self.columns.iter().copied().zip(row);
            let names = cells()
                .take_while(|(column, cell)| matches!(cell, Cell::Text(_)) || ["threads", "parts"].contains(column));
            let texts: Vec<String> = names.map(|(_, cell)| cell.shown()).collect();
            let name = |column: &str| format!("{}/{}/{column}", self.id, texts.join("/"));
            let mut median = Map::from_iter([("rounds".to_owned(), rounds.into())]);
            for (column, cell) in cells().skip(texts.len()) {
                match (column, cell) {
                    (_, Cell::Number(value, _)) if !value.is_finite() => {}
                    ("median" | "p25" | "p75" | "p95" | "p99", Cell::Number(value, _)) => {
                        median.insert(column.to_owned(), json!(value));
                    }
                    ("min", Cell::Number(value, _)) => drop(median.insert("least".to_owned(), json!(value))),
                    (_, Cell::Number(value, _)) => drop(figures.insert(name(column), json!(value))),
                    (_, Cell::Spread([p25, middle, p75], _)) => {
                        let spread = json!({ "median": middle, "p25": p25, "p75": p75, "rounds": rounds });
                        figures.insert(name(column), spread);
                    }
                    (_, Cell::Text(_) | Cell::Empty) => {}
                }
            }
            if median.contains_key("median") {
                figures.insert(name("median"), median.into());
            }
        }
    }

    fn json(&self) -> Value {
        let row = |row: &Vec<Cell>| -> Value {
            let fields = self.columns.iter().zip(row).map(|(name, cell)| ((*name).to_owned(), cell.json()));
            Value::Object(fields.collect())
        };
        let rows: Vec<Value> = self.rows.iter().map(row).collect();
        json!({ "id": self.id, "title": self.title, "notes": self.notes, "rows": rows })
    }
}

/// All results of a run.
pub(crate) struct Report {
    tables: Vec<Table>,
    threads: Table,
    goals: Table,
    figures: Map<String, Value>,
    peers: Map<String, Value>,
    wrong: Vec<String>,
    missed: usize,
}

impl Report {
    pub(crate) fn new() -> Self {
        let columns = ["what", "goal", "measured", "verdict"];
        let goals = Table::new("goals", "Goals, number by number", &columns);
        let columns = ["what", "1 thread", "2 threads", "ratio", "p25", "p75", "arithmetic", "goal", "verdict"];
        let threads = Table::new("threads", "Two threads against one, taking turns; ms a frame", &columns);
        Self {
            tables: Vec::new(),
            threads,
            goals,
            figures: Map::new(),
            peers: Map::new(),
            wrong: Vec::new(),
            missed: 0,
        }
    }

    /// Compares a number with its goal: returns the two cells "goal" and "verdict", and adds a
    /// line to the last table.
    pub(crate) fn judge(&mut self, what: impl Into<String>, goal: Goal, measured: f64) -> [Cell; 2] {
        let met = goal.is_met(measured);
        self.missed += usize::from(!met);
        let verdict = Cell::text(if met { "met" } else { "not met" });
        self.goals.row(vec![
            Cell::Text(what.into()),
            Cell::Text(goal.shown()),
            Cell::Number(measured, 3),
            verdict.clone(),
        ]);
        [Cell::Text(goal.shown()), verdict]
    }

    /// Returns the two cells of a row without a goal.
    pub(crate) fn no_goal() -> [Cell; 2] {
        [Cell::Empty, Cell::Empty]
    }

    /// Compares the times of one thread with those of two, and with the gain of
    /// [arithmetic](crate::timing::arithmetic) in the same rounds. Where that gained little, two
    /// cores were not free, and the goal is skipped.
    pub(crate) fn threads(&mut self, what: &str, [one, two]: [&Times; 2], [alone, both]: [&Times; 2]) {
        let [low, ratio, high] = one.over(two);
        let mut row = vec![Cell::text(what)];
        row.extend([one, two].map(|times| Cell::spread(times.quartiles(), 3)));
        row.push(Cell::spread([low, ratio, high], 2));
        row.extend([low, high].map(|x| Cell::Number(x, 2)));
        let control = alone.over(both);
        row.push(Cell::spread(control, 2));
        let (what, goal) = (format!("{what}: 2 threads over 1"), Goal::AtLeast(1.7));
        if control[1] < 1.9 {
            row.extend([Cell::Text(goal.shown()), Cell::text("skipped")]);
            self.skipped(what, goal);
        } else {
            row.extend(self.judge(what, goal, ratio));
        }
        self.threads.row(row);
    }

    /// Adds a goal that could not be measured.
    pub(crate) fn skipped(&mut self, what: impl Into<String>, goal: Goal) {
        let row = vec![Cell::Text(what.into()), Cell::Text(goal.shown()), Cell::Empty, Cell::text("skipped")];
        self.goals.row(row);
    }

    /// Notes a wrong timed result. The run continues, but fails at its end.
    pub(crate) fn wrong(&mut self, what: impl Into<String>) {
        self.wrong.push(what.into());
    }

    /// Adds a number that is in no table, or a better one than before by `better`.
    pub(crate) fn figure(&mut self, name: &str, value: f64, better: fn(f64, f64) -> f64) {
        let value = self.figures.get(name).and_then(Value::as_f64).map_or(value, |before| better(before, value));
        self.figures.insert(name.to_owned(), value.into());
    }

    /// Names the source of another program that takes part.
    pub(crate) fn peer(&mut self, name: &str, source: String) {
        self.peers.insert(name.to_owned(), source.into());
    }

    /// Prints a finished table at once, because a run takes minutes.
    pub(crate) fn add(&mut self, table: Table) {
        table.print();
        self.tables.push(table);
    }

    /// Prints the goals, writes the files, and returns whether every timed result was correct.
    /// `quick` is whether the run is a smoke test, of `rounds` rounds.
    ///
    /// # Errors
    /// If a file cannot be written.
    pub(crate) fn finish(
        mut self,
        machine: Value,
        folder: &Path,
        quick: bool,
        rounds: usize,
    ) -> Result<bool, Box<dyn Error>> {
        let empty = || Table::new("", "", &[]);
        let mut threads = std::mem::replace(&mut self.threads, empty());
        threads.note("Ratios are medians over rounds. \"arithmetic\" is what two threads gained in the same rounds where they only compute");
        threads.note(
            "in registers: 2 where each had a core to itself, which the processors of a virtual machine need not.",
        );
        self.add(threads);
        self.tables.iter().for_each(|table| table.figures(rounds, &mut self.figures));
        let goals = std::mem::replace(&mut self.goals, empty());
        self.add(goals);
        println!("  {} not met", self.missed);
        fs::create_dir_all(folder)?;
        for table in &self.tables {
            fs::write(folder.join(format!("{}.csv", table.id)), table.csv())?;
        }
        let tables: Vec<Value> = self.tables.iter().map(Table::json).collect();
        let all = json!({ "machine": machine, "tables": tables, "wrong": self.wrong });
        fs::write(folder.join("reconstruct.json"), serde_json::to_string_pretty(&all)? + "\n")?;
        let figures = json!({ "quick": quick, "figures": self.figures, "peers": self.peers });
        fs::write(folder.join("figures.json"), serde_json::to_string_pretty(&figures)? + "\n")?;
        for what in &self.wrong {
            println!("\nWRONG ANSWER: {what}");
        }
        Ok(self.wrong.is_empty())
    }
}
