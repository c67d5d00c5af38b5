//! Expectations of the tests, their measurements, and the table of all of them.

use std::fmt::{Display, Write as _};
use std::path::Path;
use std::sync::{Arc, Mutex};

use libtest_mimic::{Arguments, Failed, Trial};

/// Duration of the long tests.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Length {
    /// Seconds, for every run of the tests.
    Quick,
    /// Full, as stated in the expectation.
    Full,
}

impl Length {
    pub(crate) fn from_environment() -> Self {
        match std::env::var("SONOWEAVE_STRESS").as_deref() {
            Ok("full") => Self::Full,
            Ok("quick") | Err(_) => Self::Quick,
            Ok(other) => panic!("SONOWEAVE_STRESS is full or quick, not {other:?}"),
        }
    }

    pub(crate) fn of<T>(self, quick: T, full: T) -> T {
        match self {
            Self::Quick => quick,
            Self::Full => full,
        }
    }
}

/// A test before it runs.
pub(crate) struct Test {
    name: String,
    check: fn(&mut Sheet),
}

impl Test {
    /// Creates a test. `number` is that of the table in `README.md`; the name states the
    /// expectation.
    pub(crate) fn new(number: &str, expectation: impl Display, check: fn(&mut Sheet)) -> Self {
        Self { name: format!("{number} {expectation}"), check }
    }

    pub(crate) fn trial(self, length: Length, report: &Arc<Report>) -> Trial {
        let report = Arc::clone(report);
        let Self { name, check } = self;
        let title = name.clone();
        let run = move || {
            let mut sheet = Sheet { test: title, length, report, failures: Vec::new() };
            check(&mut sheet);
            if sheet.failures.is_empty() { Ok(()) } else { Err(Failed::from(sheet.failures.join("\n"))) }
        };
        Trial::test(name, run)
    }
}

/// Collects the measurements of a test. It continues after failures, since all measurements are
/// wanted.
pub(crate) struct Sheet {
    test: String,
    pub(crate) length: Length,
    report: Arc<Report>,
    failures: Vec<String>,
}

impl Sheet {
    fn enter(&mut self, what: &str, expected: String, measured: String, pass: bool) {
        if !pass {
            self.failures.push(format!("{what}: {measured}, expected {expected}"));
        }
        let row = Row { test: self.test.clone(), what: what.into(), expected, measured, pass };
        self.report.0.lock().unwrap().push(row);
    }

    /// Records a measurement that may not exceed a limit; NaN does.
    pub(crate) fn at_most(&mut self, what: &str, measured: f64, limit: f64) {
        self.enter(what, format!("≤ {limit:.3e}"), format!("{measured:.3e}"), measured <= limit);
    }

    /// Records a measurement that must exceed a limit: a precondition of the test, or a defect
    /// that must be visible.
    pub(crate) fn above(&mut self, what: &str, measured: f64, limit: f64) {
        self.enter(what, format!("> {limit:.3e}"), format!("{measured:.3e}"), measured > limit);
    }

    /// Records a measurement with its closed form and the largest distance from it.
    pub(crate) fn near(&mut self, what: &str, measured: f64, expected: f64, within: f64) {
        let pass = (measured - expected).abs() <= within;
        self.enter(what, format!("{expected:.6} ± {within:.1e}"), format!("{measured:.6}"), pass);
    }

    pub(crate) fn equal<T: PartialEq + std::fmt::Debug>(&mut self, what: &str, measured: T, expected: T) {
        let pass = measured == expected;
        self.enter(what, format!("{expected:?}"), format!("{measured:?}"), pass);
    }

    pub(crate) fn holds(&mut self, what: &str, pass: bool) {
        self.enter(what, "yes".into(), if pass { "yes" } else { "no" }.into(), pass);
    }

    /// Records a measurement without an expectation.
    pub(crate) fn record(&mut self, what: &str, measured: impl Display) {
        self.enter(what, "recorded".into(), measured.to_string(), true);
    }
}

struct Row {
    test: String,
    what: String,
    expected: String,
    measured: String,
    pass: bool,
}

/// All rows of a run.
#[derive(Default)]
pub(crate) struct Report(Mutex<Vec<Row>>);

impl Report {
    /// Writes the table of a whole run to `out/stress` and prints it: completely on request,
    /// else the failures.
    pub(crate) fn finish(&self, length: Length, arguments: &Arguments) {
        let mut rows = self.0.lock().unwrap();
        if rows.is_empty() {
            return;
        }
        // Tests run in parallel; the rows of one test keep their order.
        rows.sort_by(|a, b| a.test.cmp(&b.test));
        let failed = rows.iter().filter(|row| !row.pass).count();
        let summary = format!("{} figures, {failed} outside their expectation", rows.len());
        if arguments.nocapture || length == Length::Full {
            println!("{}", table(rows.iter()));
        } else if failed > 0 {
            println!("{}", table(rows.iter().filter(|row| !row.pass)));
        }
        println!("{summary}");
        let chosen = arguments.filter.is_some() || !arguments.skip.is_empty();
        if !chosen {
            let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../out/stress");
            let file = folder.join(length.of("report-quick.txt", "report.txt"));
            let words = length.of("short length (full: make stress)", "full length");
            let text = format!("Numerical stress tests, {words}\n{}\n{summary}\n", table(rows.iter()));
            std::fs::create_dir_all(&folder).unwrap();
            std::fs::write(&file, text).unwrap();
            println!("all of them: {}", file.display());
        }
    }
}

/// Formats rows under the name of their test: label, measured, expected.
fn table<'a>(rows: impl Iterator<Item = &'a Row>) -> String {
    let mut text = String::new();
    let mut test = "";
    for row in rows {
        if row.test != test {
            test = &row.test;
            writeln!(text, "\n{test}").unwrap();
        }
        let mark = if row.pass { ' ' } else { '✗' };
        writeln!(text, " {mark} {:<76} {:>24}   {}", row.what, row.measured, row.expected).unwrap();
    }
    text
}
