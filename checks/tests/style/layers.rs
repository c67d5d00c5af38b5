//! The order of the program's two layers: the command line calls the application, never the other
//! way round, and only the command line parses flags and prints.

use crate::findings::Finding;
use crate::sources::Sources;

/// Folder of the application.
const APP: &str = "src/app/";
/// Files of the application that may define flags: options that would only be copied.
const OPTIONS: &str = "options.rs";
/// Macros that print.
const PRINTS: [&str; 4] = ["println", "print", "eprintln", "eprint"];

/// Returns the places where the application names the command line, prints, or parses flags.
pub(crate) fn check(sources: &Sources) -> Vec<Finding> {
    let mut findings = Vec::new();
    for source in sources.rust().filter(|source| source.path.starts_with(APP)) {
        let has_options = source.path.rsplit('/').next() == Some(OPTIONS);
        let code = source.code();
        for (at, name) in code.iter().enumerate() {
            let follows = |text: &str| code.get(at + 1).is_some_and(|next| next.text == text);
            let sentence = match name.text {
                "cli" => "names the command line, which is above the application",
                "indicatif" => "draws progress; the command line does",
                "clap" if !has_options => "parses flags outside options.rs; the command line does",
                macro_ if PRINTS.contains(&macro_) && follows("!") => "prints; the command line does",
                _ => continue,
            };
            findings.push(Finding::new(&source.path, name.line, sentence));
        }
    }
    findings
}

#[test]
fn layers_out_of_order_are_found() {
    let sources = Sources::of(&[
        ("src/app/live.rs", "use clap::Args;\nuse crate::cli::say;\nfn f() { println!(); print(\"cli\"); }\n"),
        ("src/app/live/options.rs", "use clap::Args;\n// eprintln!\nuse super::super::cli;\n"),
        ("src/cli/live.rs", "use clap::Args;\nfn f() { eprintln!(); }\n"),
    ]);
    let found: Vec<(String, usize)> = check(&sources).into_iter().map(|f| (f.file, f.line)).collect();
    let live = |line| ("src/app/live.rs".to_owned(), line);
    assert_eq!(found, [live(1), live(2), live(3), ("src/app/live/options.rs".to_owned(), 3)]);
}
