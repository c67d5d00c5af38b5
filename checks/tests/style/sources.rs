//! The repository's text files, found by walking its folders, as an archive has no git.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use crate::lexer::{Kind, Token, tokens};

/// Folders that are not source.
const SKIPPED: [&str; 3] = ["target", "out", "node_modules"];

/// Marks a folder of build results or caches, such as another target folder of cargo.
const CACHE_MARK: &str = "CACHEDIR.TAG";

/// Endings of the files that are read, beside manifests.
const ENDINGS: [&str; 5] = ["rs", "js", "sh", "py", "md"];

/// A text file.
pub(crate) struct Source {
    /// Path from the repository's root, with `/` between folders.
    pub(crate) path: String,
    pub(crate) text: &'static str,
    /// Tokens of Rust, comments included; empty for other files.
    pub(crate) tokens: Vec<Token<'static>>,
}

impl Source {
    fn new(path: String, text: String) -> Self {
        // The process ends with the tests.
        let text: &'static str = text.leak();
        let tokens = if path.ends_with(".rs") { tokens(text) } else { Vec::new() };
        Self { path, text, tokens }
    }

    /// Returns the tokens without comments.
    pub(crate) fn code(&self) -> Vec<Token<'static>> {
        self.tokens.iter().filter(|t| t.kind != Kind::Comment).copied().collect()
    }
}

/// Files by their paths.
pub(crate) struct Sources(BTreeMap<String, Source>);

impl Sources {
    /// Reads all Rust, JavaScript, shell, Python and Markdown files, and manifests, below a folder.
    pub(crate) fn read(root: &Path) -> Self {
        let mut files = BTreeMap::new();
        walk(root, "", &mut files);
        Self::from(files)
    }

    /// Returns files of a test, given as pairs of path and text.
    pub(crate) fn of(files: &[(&str, &str)]) -> Self {
        Self::from(files.iter().map(|(path, text)| ((*path).to_owned(), (*text).to_owned())).collect())
    }

    fn from(files: BTreeMap<String, String>) -> Self {
        Self(files.into_iter().map(|(path, text)| (path.clone(), Source::new(path, text))).collect())
    }

    /// Returns all files, sorted by path.
    pub(crate) fn all(&self) -> impl Iterator<Item = &Source> {
        self.0.values()
    }

    /// Returns the Rust files, sorted by path.
    pub(crate) fn rust(&self) -> impl Iterator<Item = &Source> {
        self.all().filter(|source| source.path.ends_with(".rs"))
    }

    /// Returns the manifests, sorted by path.
    pub(crate) fn manifests(&self) -> impl Iterator<Item = &Source> {
        self.all().filter(|source| source.path.ends_with("Cargo.toml"))
    }

    pub(crate) fn get(&self, path: &str) -> Option<&Source> {
        self.0.get(path)
    }
}

fn is_read(name: &str) -> bool {
    name == "Cargo.toml" || name.rsplit_once('.').is_some_and(|(_, end)| ENDINGS.contains(&end))
}

/// Adds the files of a folder and of those below. Links and hidden files are skipped.
fn walk(folder: &Path, path: &str, files: &mut BTreeMap<String, String>) {
    let entries = fs::read_dir(folder).unwrap_or_else(|e| panic!("{}: {e}", folder.display()));
    for entry in entries {
        let entry = entry.unwrap_or_else(|e| panic!("{}: {e}", folder.display()));
        let name = entry.file_name().to_string_lossy().into_owned();
        let at = entry.path();
        let kind = entry.file_type().unwrap_or_else(|e| panic!("{}: {e}", at.display()));
        let path = if path.is_empty() { name.clone() } else { format!("{path}/{name}") };
        if name.starts_with('.') {
            continue;
        }
        if kind.is_dir() {
            if !SKIPPED.contains(&name.as_str()) && !at.join(CACHE_MARK).exists() {
                walk(&at, &path, files);
            }
        } else if kind.is_file() && is_read(&name) {
            let text = fs::read_to_string(&at).unwrap_or_else(|e| panic!("{}: {e}", at.display()));
            files.insert(path, text);
        }
    }
}
