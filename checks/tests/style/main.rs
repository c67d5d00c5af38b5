//! Checks the text and the structure of the sources: comments, names, lengths, modules,
//! layers, crates, and the documents.
//!
//! Each test reads the whole repository and lists all its findings, as `file:line: sentence`.

mod book;
mod comments;
mod crates;
mod cycles;
mod errors;
mod failures;
mod findings;
mod layers;
mod lexer;
mod messages;
mod modules;
mod names;
mod prose;
mod resolve;
mod sockets;
mod sources;

use std::path::Path;
use std::sync::LazyLock;

use findings::{Finding, report};
use sources::Sources;

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the repository's root")
}

/// The repository's files, read once for all tests.
static SOURCES: LazyLock<Sources> = LazyLock::new(|| {
    let sources = Sources::read(root());
    assert!(sources.rust().count() > 100, "only {} Rust files found", sources.rust().count());
    sources
});

/// Longest file, in lines.
const LINES: usize = 520;

#[test]
fn comments_are_plain_and_narrow() {
    report(SOURCES.rust().flat_map(comments::check).collect());
}

#[test]
fn documents_scripts_and_pages_are_plain() {
    report(SOURCES.all().flat_map(prose::check).collect());
}

#[test]
fn test_names_are_short() {
    report(SOURCES.rust().flat_map(names::tests).collect());
}

#[test]
fn identifiers_have_no_metaphors() {
    report(SOURCES.rust().flat_map(names::metaphors).collect());
}

#[test]
fn files_are_short() {
    let long = SOURCES.all().filter_map(|source| {
        let lines = source.text.lines().count();
        let sentence = format!("{lines} lines, of at most {LINES}");
        (lines > LINES && !source.path.ends_with(".toml") && !source.path.ends_with(".md"))
            .then(|| Finding::new(&source.path, LINES + 1, sentence))
    });
    report(long.collect());
}

#[test]
fn modules_have_no_cycles() {
    report(cycles::check(&SOURCES));
}

#[test]
fn crates_depend_on_crates_above() {
    report(crates::check(&SOURCES));
}

#[test]
fn application_is_below_command_line() {
    report(layers::check(&SOURCES));
}

#[test]
fn sockets_are_where_documented() {
    report(sockets::check(&SOURCES));
}

#[test]
fn names_avoid_retired_words() {
    report(SOURCES.rust().flat_map(names::retired).collect());
}

#[test]
fn links_of_documents_lead_somewhere() {
    report(book::links(&SOURCES, |path| root().join(path).exists()));
}

#[test]
fn pages_are_in_table_of_contents() {
    report(book::contents(&SOURCES));
}

#[test]
fn explained_messages_are_in_sources() {
    report(book::messages(&SOURCES));
}

#[test]
fn errors_say_what_where_and_what_to_do() {
    report(messages::check(&SOURCES));
}

#[test]
fn failures_say_what_to_do() {
    report(failures::check(&SOURCES));
}

#[test]
fn first_pages_state_the_purpose() {
    report(book::notice(&SOURCES));
}

#[test]
fn errors_and_warnings_are_explained() {
    report(book::unexplained(&SOURCES));
}
