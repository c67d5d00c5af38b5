//! The modules of a crate, with what each defines, imports and names. Items of tests are left out.

use std::collections::{BTreeMap, BTreeSet};

use crate::lexer::{Kind, Token};
use crate::sources::Sources;

/// Keywords that begin an item whose name follows.
const NAMING: [&str; 9] = ["struct", "enum", "trait", "type", "fn", "const", "static", "union", "mod"];

/// Keywords that begin an item.
const ITEMS: [&str; 9] = ["use", "impl", "unsafe", "extern", "async", "macro_rules", "let", "if", "for"];

/// A path such as `crate::a::B`, and its line.
pub(crate) type Named = (Vec<String>, usize);

/// A module, in a file of its own or within one.
#[derive(Default)]
pub(crate) struct Module {
    pub(crate) parent: Option<usize>,
    /// The module that owns its file; itself, unless it is within another's file.
    pub(crate) owner: usize,
    /// Its file.
    pub(crate) file: String,
    /// Its path from the crate's root, such as `a::b`.
    pub(crate) name: String,
    pub(crate) children: BTreeMap<String, usize>,
    pub(crate) definitions: BTreeSet<String>,
    /// Paths by the names that `use` gives them, public or not.
    pub(crate) imports: BTreeMap<String, Vec<Vec<String>>>,
    /// Modules and enumerations whose contents are imported.
    pub(crate) globs: Vec<Vec<String>>,
    /// Paths of private `use`, and paths and single names in code.
    pub(crate) used: Vec<Named>,
    pub(crate) named: Vec<Named>,
    /// Private imports of all that a module has.
    pub(crate) used_globs: Vec<Named>,
    /// Folder of its children's files, with `/` at the end.
    folder: String,
}

/// Reads the modules of a crate from its root file. Modules without a file are left out.
pub(crate) fn read(sources: &Sources, root: &str) -> Vec<Module> {
    let folder = root[..root.rfind('/').map_or(0, |at| at + 1)].to_owned();
    let mut modules = vec![Module { file: root.to_owned(), name: "crate".to_owned(), folder, ..Module::default() }];
    let mut next = 0;
    while next < modules.len() {
        // Modules within a file were read with it.
        if modules[next].owner == next
            && let Some(source) = sources.get(&modules[next].file)
        {
            Reader { sources, code: without_tests(&source.code()), modules: &mut modules }.read(next);
        }
        next += 1;
    }
    modules
}

/// Removes items behind `#[cfg(test)]`.
fn without_tests<'a>(code: &[Token<'a>]) -> Vec<Token<'a>> {
    let mut kept = Vec::new();
    let mut at = 0;
    while at < code.len() {
        if !code[at].is("#") {
            kept.push(code[at]);
            at += 1;
            continue;
        }
        let is_inner = code.get(at + 1).is_some_and(|t| t.is("!"));
        let end = group_end(code, at + 1 + usize::from(is_inner));
        let attribute = &code[at..end];
        let has = |word: &str| attribute.iter().any(|t| t.is(word));
        let is_test =
            attribute.get(2 + usize::from(is_inner)).is_some_and(|t| t.is("cfg")) && has("test") && !has("not");
        if !is_test {
            kept.extend(attribute);
            at = end;
        } else if is_inner {
            return Vec::new();
        } else {
            at = item_end(code, end);
        }
    }
    kept
}

/// Returns the index behind the group that opens at an index.
fn group_end(code: &[Token], at: usize) -> usize {
    let mut depth = 0_usize;
    for (i, token) in code.iter().enumerate().skip(at) {
        depth = match () {
            () if opens(token) => depth + 1,
            () if closes(token) => depth.saturating_sub(1),
            () => depth,
        };
        if depth == 0 {
            return i + 1;
        }
    }
    code.len()
}

fn opens(token: &Token) -> bool {
    token.kind == Kind::Sign && matches!(token.text, "(" | "[" | "{")
}

fn closes(token: &Token) -> bool {
    token.kind == Kind::Sign && matches!(token.text, ")" | "]" | "}")
}

/// Returns the indices of the names of enumerations' variants, which may be those of types.
fn variants(code: &[Token]) -> BTreeSet<usize> {
    let mut all = BTreeSet::new();
    for begin in (0..code.len()).filter(|at| code[*at].is("enum")) {
        let Some(body) = code[begin..].iter().position(|t| t.is("{")) else { break };
        let mut at = begin + body + 1;
        while code.get(at).is_some_and(|t| !t.is("}")) {
            while code.get(at).is_some_and(|t| t.is("#")) {
                at = group_end(code, at + 1);
            }
            all.insert(at);
            while code.get(at).is_some_and(|t| !t.is(",") && !t.is("}")) {
                at = if opens(&code[at]) { group_end(code, at) } else { at + 1 };
            }
            at += usize::from(code.get(at).is_some_and(|t| t.is(",")));
        }
    }
    all
}

/// Returns the index behind an item, a field, a variant, an arm or a statement.
fn item_end(code: &[Token], mut at: usize) -> usize {
    while code.get(at).is_some_and(|t| t.is("#")) {
        at = group_end(code, at + 1);
    }
    if code.get(at).is_some_and(|t| t.is("pub")) {
        at += 1;
        if code.get(at).is_some_and(|t| t.is("(")) {
            at = group_end(code, at);
        }
    }
    let is_item = code.get(at).is_some_and(|t| NAMING.iter().chain(&ITEMS).any(|word| t.is(word)));
    while let Some(token) = code.get(at) {
        if closes(token) {
            return at;
        }
        if opens(token) {
            at = group_end(code, at);
            if token.is("{") {
                return at;
            }
            continue;
        }
        at += 1;
        if token.is(";") || !is_item && token.is(",") {
            return at;
        }
    }
    at
}

/// Reads a file's code into its modules.
struct Reader<'a, 'm> {
    sources: &'m Sources,
    code: Vec<Token<'a>>,
    modules: &'m mut Vec<Module>,
}

impl Reader<'_, '_> {
    fn is(&self, at: usize, text: &str) -> bool {
        self.code.get(at).is_some_and(|t| t.is(text))
    }

    fn is_word(&self, at: usize) -> bool {
        self.code.get(at).is_some_and(Token::is_word)
    }

    fn is_double_colon(&self, at: usize) -> bool {
        self.is(at, ":") && self.is(at + 1, ":")
    }

    fn read(&mut self, owner: usize) {
        // Modules that are open, with the depth of brackets within them.
        let mut open = vec![(owner, 0_usize)];
        let mut depth = 0_usize;
        let mut at = 0;
        let variants = variants(&self.code);
        while at < self.code.len() {
            let token = self.code[at];
            let (module, inside) = open.last().copied().unwrap_or((owner, 0));
            if opens(&token) {
                depth += 1;
            } else if closes(&token) {
                depth = depth.saturating_sub(1);
                if depth < inside {
                    open.pop();
                }
            } else if token.is("mod") && self.is_word(at + 1) {
                if let Some(child) = self.module(module, at)
                    && self.is(at + 2, "{")
                {
                    depth += 1;
                    open.push((child, depth));
                }
                at += 3;
                continue;
            } else if token.is("use") {
                at = self.import(module, at);
                continue;
            } else if token.is("macro_rules") && self.is_word(at + 2) {
                let name = self.code[at + 2].text.to_owned();
                let is_exported = self.code[at.saturating_sub(8)..at].iter().any(|t| t.is("macro_export"));
                self.modules[if is_exported { 0 } else { module }].definitions.insert(name);
                at += 3;
                continue;
            } else if NAMING.iter().any(|word| token.is(word)) && self.is_word(at + 1) {
                if depth == inside {
                    self.modules[module].definitions.insert(self.code[at + 1].text.to_owned());
                }
                at += if self.is(at + 1, "fn") { 1 } else { 2 };
                continue;
            } else if token.is_word() && !variants.contains(&at) {
                at = self.path(module, at);
                continue;
            }
            at += 1;
        }
    }

    /// Adds the module that is declared at an index, unless its file is missing.
    fn module(&mut self, parent: usize, at: usize) -> Option<usize> {
        let name = self.code[at + 1].text.trim_start_matches("r#");
        let is_within = self.is(at + 2, "{");
        let owner = self.modules[parent].owner;
        let (file, folder) = if is_within {
            (self.modules[parent].file.clone(), format!("{}{name}/", self.modules[parent].folder))
        } else if let Some(path) = self.path_attribute(at) {
            let own = &self.modules[parent].file;
            let file = joined(&own[..own.rfind('/').map_or(0, |at| at + 1)], &path);
            let folder = file[..file.rfind('/').map_or(0, |at| at + 1)].to_owned();
            (file, folder)
        } else {
            let folder = format!("{}{name}/", self.modules[parent].folder);
            let file = format!("{}.rs", folder.trim_end_matches('/'));
            let file = if self.sources.get(&file).is_some() { file } else { format!("{folder}mod.rs") };
            (file, folder)
        };
        self.sources.get(&file)?;
        let index = self.modules.len();
        let full = if parent == 0 { name.to_owned() } else { format!("{}::{name}", self.modules[parent].name) };
        self.modules[parent].children.insert(name.to_owned(), index);
        let owner = if is_within { owner } else { index };
        self.modules.push(Module { parent: Some(parent), owner, file, name: full, folder, ..Module::default() });
        Some(index)
    }

    /// Returns the path of `#[path = "…"]` in front of a module.
    fn path_attribute(&self, at: usize) -> Option<String> {
        let mut begin = at;
        while begin > 0 && !self.is(begin - 1, ";") && !self.is(begin - 1, "}") && !self.is(begin - 1, "{") {
            begin -= 1;
        }
        let path = (begin..at).find(|i| self.is(*i, "path") && self.is(i + 1, "="))?;
        Some(self.code.get(path + 2)?.text.trim_matches('"').to_owned())
    }

    /// Reads `use …;` and returns the index behind it.
    fn import(&mut self, module: usize, at: usize) -> usize {
        let is_public = at > 0 && (self.is(at - 1, "pub") || self.is(at - 1, ")") && self.is_restricted(at - 1));
        let end = at + self.code[at..].iter().position(|t| t.is(";")).unwrap_or(self.code.len() - at - 1);
        // `use<…>` in a return type captures lifetimes.
        if self.is(at + 1, "<") {
            return at + 1;
        }
        let mut leaves = Vec::new();
        let mut from = at + 1;
        self.tree(&mut from, end, &Vec::new(), &mut leaves);
        let line = self.code[at].line;
        let own = &mut self.modules[module];
        for (path, name) in leaves {
            if path.last().is_some_and(|l| l == "*") {
                let path = path[..path.len() - 1].to_vec();
                if !is_public {
                    own.used_globs.push((path.clone(), line));
                }
                own.globs.push(path);
            } else {
                if !is_public {
                    own.used.push((path.clone(), line));
                }
                own.imports.entry(name).or_default().push(path);
            }
        }
        end + 1
    }

    /// Returns whether the bracket at an index closes `pub(…)`.
    fn is_restricted(&self, at: usize) -> bool {
        let begin = self.code[..at].iter().rposition(|t| t.is("("));
        begin.is_some_and(|begin| begin > 0 && self.is(begin - 1, "pub"))
    }

    /// Adds the paths of a `use` tree with their names; `*` ends a path of all contents.
    fn tree(&self, at: &mut usize, end: usize, prefix: &[String], leaves: &mut Vec<(Vec<String>, String)>) {
        let mut path = prefix.to_vec();
        while *at < end {
            let token = self.code[*at];
            if token.is("{") {
                *at += 1;
                while *at < end && !self.is(*at, "}") {
                    self.tree(at, end, &path, leaves);
                    *at += usize::from(self.is(*at, ","));
                }
                *at += 1;
                return;
            }
            if token.is(",") || token.is("}") {
                break;
            }
            if token.is("as") {
                leaves.push((trimmed(path), self.code[*at + 1].text.to_owned()));
                *at += 2;
                return;
            }
            if token.is_word() || token.is("*") {
                path.push(token.text.to_owned());
            }
            *at += 1;
        }
        let path = trimmed(path);
        if let Some(name) = path.last().cloned() {
            leaves.push((path, name));
        }
    }

    /// Reads a path in code and returns the index behind it.
    fn path(&mut self, module: usize, at: usize) -> usize {
        let mut segments = vec![self.code[at].text.to_owned()];
        let mut end = at + 1;
        while self.is_double_colon(end) && self.is_word(end + 2) {
            segments.push(self.code[end + 2].text.to_owned());
            end += 3;
        }
        let before = |text: &str, n: usize| at >= n && self.is(at - n, text);
        let is_member = before(".", 1) && !before(".", 2);
        let goes_on = before(":", 1) && before(":", 2);
        let first = &segments[0];
        // A single name counts if it looks like a type, a constant, a call or a macro.
        let is_informative = segments.len() > 1
            || first.starts_with(char::is_uppercase)
            || self.is(end, "(")
            || self.is(end, "!") && !self.is(end + 1, "=")
            || self.is_double_colon(end);
        let is_own = before("for", 1) && first == "self";
        if is_informative && !is_member && !goes_on && !is_own {
            self.modules[module].named.push((segments, self.code[at].line));
        }
        end
    }
}

/// Removes `self` from the end of `a::{self}`.
fn trimmed(mut path: Vec<String>) -> Vec<String> {
    if path.len() > 1 && path.last().is_some_and(|l| l == "self") {
        path.pop();
    }
    path
}

/// Returns a path below a folder without `..`.
fn joined(folder: &str, path: &str) -> String {
    let mut parts: Vec<&str> = folder.split('/').filter(|p| !p.is_empty()).collect();
    for part in path.split('/') {
        match part {
            ".." => drop(parts.pop()),
            "." => {}
            part => parts.push(part),
        }
    }
    parts.join("/")
}
