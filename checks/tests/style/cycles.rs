//! Cycles of modules: files of a crate that name each other's items, directly or through others.
//!
//! A file depends on another if it names an item that the other defines: by a private `use`, or by
//! a path or an imported name in code. Imports are followed to the definition. A public `use` alone
//! is no dependency: it is the interface of its module.

use std::collections::{BTreeMap, BTreeSet, VecDeque};

use crate::findings::Finding;
use crate::modules::{self, Module};
use crate::resolve::{Place, resolve};
use crate::sources::Sources;

/// Modules of a crate that reach each other.
struct Cycle {
    /// Names of the modules, sorted.
    names: Vec<String>,
    /// Dependencies between them.
    edges: Vec<Edge>,
}

/// A module that names an item of another.
#[derive(Debug, Clone)]
struct Edge {
    from: String,
    to: String,
    /// The path as it is written.
    path: String,
    file: String,
    line: usize,
}

/// Returns the cycles of all libraries and programs. Tests and benches are left out: their modules
/// share what `main.rs` prepares.
fn find(sources: &Sources) -> Vec<Cycle> {
    let roots = sources.rust().map(|source| source.path.as_str()).filter(|path| is_root(path));
    roots.flat_map(|root| of_crate(sources, root)).collect()
}

/// Returns whether a file is the root of a library or a program.
fn is_root(file: &str) -> bool {
    let parts: Vec<&str> = file.split('/').collect();
    parts.contains(&"src") && matches!(parts.last(), Some(&"lib.rs" | &"main.rs"))
}

fn of_crate(sources: &Sources, root: &str) -> Vec<Cycle> {
    let modules = modules::read(sources, root);
    let edges = edges(&modules);
    let reached: Vec<BTreeSet<usize>> = (0..modules.len()).map(|m| reached(&edges, m)).collect();
    let mut cycles = Vec::new();
    let mut done = BTreeSet::new();
    for module in 0..modules.len() {
        if !done.contains(&module) && reached[module].contains(&module) {
            let members: BTreeSet<usize> =
                reached[module].iter().copied().filter(|other| reached[*other].contains(&module)).collect();
            let within = |(from, to): &(usize, usize)| members.contains(from) && members.contains(to);
            let edges = edges.iter().filter(|(pair, _)| within(pair)).map(|((from, to), (path, line))| Edge {
                from: modules[*from].name.clone(),
                to: modules[*to].name.clone(),
                path: path.clone(),
                file: modules[*from].file.clone(),
                line: *line,
            });
            let mut names: Vec<String> = members.iter().map(|m| modules[*m].name.clone()).collect();
            names.sort();
            cycles.push(Cycle { names, edges: edges.collect() });
            done.extend(members);
        }
    }
    cycles
}

/// Returns which modules name items of which, each with one path and its line.
fn edges(modules: &[Module]) -> BTreeMap<(usize, usize), (String, usize)> {
    let mut edges = BTreeMap::new();
    for (index, module) in modules.iter().enumerate() {
        let all = module.used.iter().chain(&module.named).map(|named| (named, false));
        for ((path, line), is_glob) in all.chain(module.used_globs.iter().map(|named| (named, true))) {
            let to = match resolve(modules, index, path) {
                Some(Place::Within(to)) => to,
                Some(Place::Module(to)) if is_glob => to,
                _ => continue,
            };
            let (from, to) = (module.owner, modules[to].owner);
            if from != to {
                edges.entry((from, to)).or_insert_with(|| (path.join("::"), *line));
            }
        }
    }
    edges
}

/// Returns the modules that a module depends on, directly or not.
fn reached(edges: &BTreeMap<(usize, usize), (String, usize)>, from: usize) -> BTreeSet<usize> {
    let mut all = BTreeSet::new();
    let mut next = vec![from];
    while let Some(module) = next.pop() {
        for ((_, to), _) in edges.range((module, 0)..(module + 1, 0)) {
            if all.insert(*to) {
                next.push(*to);
            }
        }
    }
    all
}

/// Returns the dependencies of each cycle's shortest way around.
pub(crate) fn check(sources: &Sources) -> Vec<Finding> {
    let finding = |cycle: &Cycle, edge: &Edge| {
        let (size, Edge { from, to, path, .. }) = (cycle.names.len(), edge);
        let sentence = format!("{from} names {path} of {to}: part of a cycle of {size} modules");
        Finding::new(&edge.file, edge.line, sentence)
    };
    let cycles = find(sources);
    cycles.iter().flat_map(|cycle| shortest(cycle).into_iter().map(|edge| finding(cycle, edge))).collect()
}

/// Returns a cycle's shortest way around.
fn shortest(cycle: &Cycle) -> Vec<&Edge> {
    cycle.edges.iter().map(|start| around(cycle, start)).min_by_key(Vec::len).unwrap_or_default()
}

/// Returns the shortest way around that begins with a dependency.
fn around<'a>(cycle: &'a Cycle, start: &'a Edge) -> Vec<&'a Edge> {
    let mut by: BTreeMap<&str, &Edge> = BTreeMap::new();
    let mut next = VecDeque::from([start.to.as_str()]);
    while let Some(module) = next.pop_front() {
        if module == start.from {
            break;
        }
        for edge in cycle.edges.iter().filter(|edge| edge.from == module && edge.to != start.to) {
            if !by.contains_key(edge.to.as_str()) {
                by.insert(&edge.to, edge);
                next.push_back(&edge.to);
            }
        }
    }
    let mut way = vec![start];
    let mut at = start.from.as_str();
    while at != start.to {
        let Some(edge) = by.get(at) else { break };
        way.push(edge);
        at = &edge.from;
    }
    way
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(files: &[(&str, &str)]) -> Vec<Vec<String>> {
        find(&Sources::of(files)).into_iter().map(|c| c.names).collect()
    }

    #[test]
    fn cycle_by_use_and_by_path_is_found() {
        let found = names(&[
            ("crates/a/src/lib.rs", "mod one; mod two; mod three;"),
            ("crates/a/src/one.rs", "use super::two::Two; pub struct One; fn f(t: Two) {}"),
            ("crates/a/src/two.rs", "pub struct Two; fn f() { let x = crate::three::Three::new(); }"),
            ("crates/a/src/three.rs", "use crate::one; pub struct Three(one::One); impl Three { fn new() {} }"),
        ]);
        assert_eq!(found, [["one", "three", "two"]]);
    }

    #[test]
    fn public_import_and_tests_are_no_cycle() {
        let found = names(&[
            ("crates/a/src/lib.rs", "mod one; mod two; pub use one::One; pub(crate) use two::{Two, x as y};"),
            ("crates/a/src/main.rs", "mod one; mod two; pub use one::One; enum E<T> { Two(T), #[a] One { x: T } }"),
            (
                "crates/a/src/one.rs",
                "use super::{Two, y}; pub struct One; #[cfg(test)] mod tests { use crate::other; }",
            ),
            ("crates/a/src/two.rs", "pub struct Two; pub fn x() {} #[cfg(test)] #[test] fn t() { crate::One; }"),
        ]);
        assert_eq!(found, [[""; 0]; 0]);
    }

    #[test]
    fn imports_are_followed_to_definition() {
        let found = names(&[
            ("crates/a/src/lib.rs", "mod folder; mod one;"),
            ("crates/a/src/folder/mod.rs", "mod deep; pub use deep::*;"),
            ("crates/a/src/folder/deep.rs", "use crate::one::One; pub struct Deep(One);"),
            ("crates/a/src/one.rs", "use crate::folder::Deep as D; pub struct One;"),
        ]);
        assert_eq!(found, [["folder::deep", "one"]]);
    }

    #[test]
    fn item_of_parent_is_cycle_if_parent_names_child() {
        let parent = "mod child; const N: usize = child::M; mod within { pub struct A; }";
        let child = "use super::within::A; pub const M: usize = 1;";
        let files = [("src/lib.rs", "mod p;"), ("src/p/mod.rs", parent), ("src/p/child.rs", child)];
        assert_eq!(names(&files), [["p", "p::child"]]);
        let public = "mod child; pub use child::M; pub struct A;";
        let files = [
            ("src/lib.rs", "mod p;"),
            ("src/p.rs", public),
            ("src/p/child.rs", "use super::A; pub const M: usize = 1;"),
        ];
        assert_eq!(names(&files), [[""; 0]; 0]);
    }

    #[test]
    fn other_crates_fields_and_methods_are_no_dependency() {
        let found = names(&[
            ("src/lib.rs", "mod one; mod two;"),
            (
                "src/one.rs",
                "use std::two::Two; use other::two; pub struct One; fn f(t: Two) { t.two::<One>(); two::g() }",
            ),
            ("src/two.rs", "use crate::one::One;"),
        ]);
        assert_eq!(found, [[""; 0]; 0]);
    }

    #[test]
    fn each_dependency_of_a_cycle_is_named() {
        let sources = Sources::of(&[
            ("src/lib.rs", "mod a; mod b;"),
            ("src/a.rs", "pub struct A;\nuse crate::b::B;"),
            ("src/b.rs", "pub struct B;\n\nuse crate::a::A;"),
        ]);
        let mut found: Vec<(String, usize)> = check(&sources).into_iter().map(|f| (f.file, f.line)).collect();
        found.sort();
        assert_eq!(found, [("src/a.rs".to_owned(), 2), ("src/b.rs".to_owned(), 3)]);
    }
}
