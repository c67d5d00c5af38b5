//! Checks that every measured figure of the documents comes from a record, and that each record
//! is of today's sources or its commit is stated.
//!
//! Without git, such as in an archive, figures are compared with their records as usual. Records
//! are not compared with the sources, and a line on standard error says so.

use std::io::Write as _;
use std::path::Path;

use sonoweave_checks::chart;
use sonoweave_checks::documents::Documents;
use sonoweave_checks::record::read_all;
use sonoweave_checks::sources::Checkout;

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the repository's root")
}

/// Opens the clone, or says why it cannot be. The test harness does not capture the line.
fn checkout() -> Option<Checkout> {
    let opened = Checkout::open(root());
    opened.map_err(|error| note(&format!("measured figures are not compared with today's sources: {error}"))).ok()
}

fn note(text: &str) {
    writeln!(std::io::stderr(), "figures: {text}").expect("standard error");
}

#[test]
fn figures_of_documents_come_from_records() {
    let documents = Documents::read(root(), checkout().as_ref()).expect("documents");
    assert!(documents.pages.len() > 10 && !documents.records.is_empty(), "the documents were not found");
    let findings = documents.findings();
    assert!(findings.is_empty(), "{} findings\n{}", findings.len(), findings.join("\n"));
}

#[test]
fn chart_shows_the_records() {
    let records = read_all(&root().join(sonoweave_checks::FOLDER)).expect("records");
    let file = std::fs::read_to_string(root().join(chart::PATH)).unwrap_or_default();
    assert!(file == chart::drawn(&records).expect("chart"), "{} is older; `make numbers` renews it", chart::PATH);
}

#[test]
fn sources_of_records_are_those_of_their_commits() {
    let Some(checkout) = checkout() else { return };
    let records = read_all(&root().join(sonoweave_checks::FOLDER)).expect("records");
    for (name, record) in &records {
        if checkout.has(&record.commit) {
            let there = checkout.hashes(&record.commit, record.sources.keys().map(String::as_str));
            assert_eq!(record.sources, there, "{name}: sources at {}", record.commit);
        } else {
            note(&format!("commit {} of {name} is not in this clone; its sources are not compared", record.commit));
        }
    }
}
