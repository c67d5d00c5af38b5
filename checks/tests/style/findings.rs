//! Findings, and the report of a test that has any.

/// Something to repair. Findings are sorted by file and line.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Finding {
    /// Path from the repository's root.
    pub(crate) file: String,
    pub(crate) line: usize,
    pub(crate) sentence: String,
}

impl Finding {
    pub(crate) fn new(file: &str, line: usize, sentence: impl Into<String>) -> Self {
        Self { file: file.to_owned(), line, sentence: sentence.into() }
    }
}

/// Fails with all findings, if there are any.
pub(crate) fn report(mut findings: Vec<Finding>) {
    findings.sort();
    let lines: String = findings.iter().map(|f| format!("{}:{}: {}\n", f.file, f.line, f.sentence)).collect();
    assert!(findings.is_empty(), "{} findings\n{lines}", findings.len());
}
