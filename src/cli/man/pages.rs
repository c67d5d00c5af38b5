//! Manual pages: one of the program, one of each subcommand, and one of the session
//! configuration.

use std::io;

use clap_mangen::Man;
use clap_mangen::roff::{Roff, bold, italic, roman};

use config::bedside::schema::SECTIONS;

/// Name of the manual that contains the pages.
const MANUAL: &str = "sonoweave";
const SOURCE: &str = concat!("sonoweave ", env!("CARGO_PKG_VERSION"));
/// Name of the configuration's page.
const CONFIGURATION: &str = "sonoweave-bedside";

/// A manual page.
#[derive(Debug)]
pub(super) struct Page {
    /// Its file name, with the section: `sonoweave-live.1`.
    pub(super) name: String,
    /// Its roff.
    pub(super) text: String,
}

impl Page {
    fn new(title: &str, section: u8, roff: &[u8]) -> Self {
        Self { name: format!("{title}.{section}"), text: String::from_utf8_lossy(roff).into_owned() }
    }

    /// Returns the name without the section.
    pub(super) fn title(&self) -> &str {
        self.name.rsplit_once('.').map_or(&self.name, |(title, _)| title)
    }
}

/// Returns all pages.
///
/// # Errors
/// None in practice; the writers' signatures allow errors.
pub(super) fn all(command: &clap::Command) -> io::Result<Vec<Page>> {
    let mut pages = vec![Page::new("sonoweave", 1, &page(command)?)];
    for sub in command.get_subcommands() {
        pages.push(Page::new(title(sub), 1, &page(sub)?));
        // Each kind of calibration has flags of its own.
        for kind in sub.get_subcommands().filter(|kind| kind.get_name() != "help") {
            pages.push(Page::new(title(kind), 1, &page(kind)?));
        }
    }
    pages.push(Page::new(CONFIGURATION, 5, &configuration()?));
    Ok(pages)
}

/// Returns the page name, such as `sonoweave-live` for the subcommand `live`.
fn title(command: &clap::Command) -> &str {
    command.get_display_name().unwrap_or_else(|| command.get_name())
}

/// Returns the page of a command.
fn page(command: &clap::Command) -> io::Result<Vec<u8>> {
    // clap_mangen leaves out the help of flags that only `--help` shows.
    let shown = command.clone().mut_args(|arg| arg.hide_short_help(false));
    let man = Man::new(shown).source(SOURCE).manual(MANUAL);
    let mut page = Vec::new();
    man.render_title(&mut page)?;
    man.render_name_section(&mut page)?;
    man.render_synopsis_section(&mut page)?;
    man.render_description_section(&mut page)?;
    let after = command.get_after_long_help().or_else(|| command.get_after_help()).map(ToString::to_string);
    let after = Afterword::new(after.as_deref().unwrap_or_default());
    let mut words = Roff::new();
    for paragraph in &after.paragraphs {
        words.control("PP", []).text([roman(paragraph)]);
    }
    words.to_writer(&mut page)?;
    man.render_options_section(&mut page)?;
    if command.has_subcommands() {
        man.render_subcommands_section(&mut page)?;
    }
    let mut end = Roff::new();
    end.control("SH", ["EXIT STATUS"]);
    end.text([roman("0 if it was done, 1 if it failed, 2 if it was not understood. Errors go to stderr.")]);
    if !after.examples.is_empty() {
        end.control("SH", ["EXAMPLES"]).control("nf", []);
        for line in &after.examples {
            end.text([roman(line)]);
        }
        end.control("fi", []);
    }
    see_also(&mut end, command);
    end.to_writer(&mut page)?;
    Ok(page)
}

fn see_also(end: &mut Roff, command: &clap::Command) {
    let mut others = vec![("sonoweave", "(1)")];
    if command.has_subcommands() {
        others = command.get_subcommands().map(|sub| (title(sub), "(1)")).collect();
    }
    if command.has_subcommands() || command.get_name() == "live" {
        others.push((CONFIGURATION, "(5)"));
    }
    end.control("SH", ["SEE ALSO"]);
    let mut line = Vec::new();
    for (n, (name, section)) in others.into_iter().enumerate() {
        line.extend([roman(if n > 0 { ", " } else { "" }), bold(name), roman(section)]);
    }
    end.text(line);
}

/// Text of a command's help after its flags.
#[derive(Debug, PartialEq, Eq)]
struct Afterword {
    /// Prose paragraphs.
    paragraphs: Vec<String>,
    /// Lines of the paragraph that begins with "Example:" or "Examples:", without that word.
    examples: Vec<String>,
}

impl Afterword {
    fn new(text: &str) -> Self {
        let (mut paragraphs, mut examples) = (Vec::new(), Vec::new());
        for paragraph in text.split("\n\n").map(str::trim).filter(|paragraph| !paragraph.is_empty()) {
            match paragraph.strip_prefix("Examples:").or_else(|| paragraph.strip_prefix("Example:")) {
                Some(lines) => {
                    examples.extend(lines.lines().map(str::trim).filter(|l| !l.is_empty()).map(str::to_owned));
                }
                None => paragraphs.push(paragraph.split_whitespace().collect::<Vec<_>>().join(" ")),
            }
        }
        Self { paragraphs, examples }
    }
}

/// Returns the page of the session configuration: every section and key of the program's own
/// list.
fn configuration() -> io::Result<Vec<u8>> {
    let mut page = Roff::new();
    page.control("TH", [CONFIGURATION, "5", "", SOURCE, MANUAL]);
    page.control("SH", ["NAME"]);
    page.text([roman(format!("{CONFIGURATION} - configuration of a session at the bedside"))]);
    page.control("SH", ["DESCRIPTION"]);
    page.text([roman(
        "A configuration is TOML that begins with format = \"sonoweave-bedside\" and version = 1. Keys have their units in their names; a key that is not known is refused. \
         Commented ones to begin with are in /usr/share/doc/sonoweave/examples, and printed by",
    )]);
    page.text([bold("sonoweave live --example"), roman(".")]);
    page.control("PP", []);
    page.text([roman(
        "A change of a key that says so takes effect while a session runs, when the file is read again (SIGHUP, or systemctl reload sonoweave); \
         of all others in the next session.",
    )]);
    for section in SECTIONS.iter() {
        page.control("SH", [format!("[{}]", section.name).as_str()]);
        page.text([roman(format!("{}.", section.about))]);
        for key in &section.keys {
            page.control("TP", []);
            page.text([bold(&key.name), roman(" = "), italic(&key.takes)]);
            let at_once = if key.at_once { " May change while a session runs." } else { "" };
            page.text([roman(format!("{}{at_once}", key.about))]);
        }
    }
    page.control("SH", ["FILES"]);
    page.control("TP", []).text([bold("/etc/sonoweave/bedside.toml")]);
    page.text([roman("What the service sonoweave.service goes by.")]);
    page.control("SH", ["SEE ALSO"]);
    page.text([bold("sonoweave-live"), roman("(1)")]);
    let mut bytes = Vec::new();
    page.to_writer(&mut bytes)?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the text as a reader sees it, without roff's escapes.
    fn read(page: &Page) -> String {
        [("\\-", "-"), ("\\fB", ""), ("\\fI", ""), ("\\fR", ""), ("\\*(Aq", "'"), ("\\&", ""), ("\\\\", "\\")]
            .iter()
            .fold(page.text.clone(), |text, (escape, plain)| text.replace(escape, plain))
    }

    #[test]
    fn every_command_page_documents_all_flags() {
        let command = crate::cli::command_line();
        let pages = all(&command).unwrap();
        let names: Vec<&str> = pages.iter().map(|page| page.name.as_str()).collect();
        let mut flags = 0;
        for sub in command.get_subcommands() {
            let name = format!("sonoweave-{}.1", sub.get_name());
            let page = read(&pages[names.iter().position(|n| *n == name).unwrap_or_else(|| panic!("no {name}"))]);
            assert!(page.contains(&format!("\n.SH NAME\nsonoweave-{} - ", sub.get_name())), "{page}");
            for arg in sub.get_arguments() {
                let help = arg.get_long_help().or(arg.get_help()).map(ToString::to_string).unwrap_or_default();
                assert!(help.trim().len() > 3, "{name}: {} is not explained", arg.get_id());
                assert!(page.contains(help.lines().next().unwrap()), "{name}: {help}");
                if let Some(long) = arg.get_long() {
                    assert!(page.contains(&format!("--{long}")), "{name}: --{long}");
                    flags += 1;
                }
            }
            let after = sub.get_after_long_help().map(ToString::to_string).unwrap_or_default();
            let begins = ["Example:", "Examples:"].iter().find_map(|word| after.split_once(word));
            if let Some((_, examples)) = begins {
                let shown = page.split_once("\n.SH EXAMPLES\n.nf\n").expect("examples").1;
                for line in examples.lines().map(str::trim) {
                    assert!(shown.contains(line), "{name}: {line}");
                }
            }
        }
        assert!(flags > 100, "{flags}");
        let whole = read(&pages[0]);
        for sub in command.get_subcommands() {
            assert!(whole.contains(&format!("sonoweave-{}(1)", sub.get_name())), "{whole}");
        }
    }

    #[test]
    fn configuration_page_has_every_key() {
        let pages = all(&crate::cli::command_line()).unwrap();
        let page = read(pages.last().unwrap());
        for section in SECTIONS.iter() {
            let (_, rest) = page.split_once(&format!("\n.SH [{}]\n", section.name)).expect("a heading");
            let part = rest.split("\n.SH ").next().unwrap();
            for key in &section.keys {
                assert!(part.contains(&format!("\n.TP\n{} = {}\n", key.name, key.takes)), "{}: {part}", key.name);
                assert_eq!(part.contains(&format!("{} May change", key.about)), key.at_once);
            }
        }
    }

    #[test]
    fn examples_are_separated_from_prose() {
        let text = "One\nsentence.\n\nExamples: a b\n          c d\n\nAnother.";
        let want = Afterword {
            paragraphs: vec!["One sentence.".into(), "Another.".into()],
            examples: vec!["a b".into(), "c d".into()],
        };
        assert_eq!(Afterword::new(text), want);
        assert_eq!(Afterword::new("Example:\n  a b").examples, ["a b"]);
        assert_eq!(Afterword::new("").paragraphs, [""; 0]);
    }
}
