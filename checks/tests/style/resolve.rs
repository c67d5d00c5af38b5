//! Paths to the modules that define what they name.

use crate::modules::Module;

/// Longest chain of imports that is followed.
const CHAIN: usize = 24;

/// The end of a path.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Place {
    /// A module.
    Module(usize),
    /// Something that a module defines, or that was not found in it.
    Within(usize),
}

/// Returns the place that a path in a module ends at; `None` if that is in another crate.
pub(crate) fn resolve(modules: &[Module], from: usize, path: &[String]) -> Option<Place> {
    follow(modules, from, path, CHAIN)
}

fn follow(modules: &[Module], from: usize, path: &[String], chain: usize) -> Option<Place> {
    let chain = chain.checked_sub(1)?;
    let mut current = from;
    let mut rest = path;
    let mut is_anchored = false;
    while let Some((first, after)) = rest.split_first() {
        current = match first.as_str() {
            "crate" => 0,
            "self" => current,
            "super" => modules[current].parent?,
            _ => break,
        };
        is_anchored = true;
        rest = after;
    }
    for name in rest {
        match lookup(modules, current, name, chain) {
            Some(Place::Module(module)) => current = module,
            // A function does not hide another crate of its name.
            Some(_) if !is_anchored && rest.len() > 1 && name.starts_with(char::is_lowercase) => return None,
            Some(place) => return Some(place),
            None if is_anchored && !is_foreign(modules, current, name) => return Some(Place::Within(current)),
            None => return None,
        }
        is_anchored = true;
    }
    Some(Place::Module(current))
}

/// Returns the place of a name in a module, through its imports.
fn lookup(modules: &[Module], module: usize, name: &str, chain: usize) -> Option<Place> {
    let own = &modules[module];
    if let Some(child) = own.children.get(name) {
        return Some(Place::Module(*child));
    }
    if own.definitions.contains(name) {
        return Some(Place::Within(module));
    }
    if let Some(paths) = own.imports.get(name) {
        // `use name;` and `use name as name` would look themselves up.
        let mut others = paths.iter().filter(|path| path.len() > 1 || path[0] != name);
        return others.find_map(|path| follow(modules, module, path, chain));
    }
    // Nor is a glob's own first name looked for in globs: with several, the search would not end.
    own.globs.iter().filter(|glob| glob[0] != name).find_map(|glob| match follow(modules, module, glob, chain)? {
        Place::Module(other) if other != module => lookup(modules, other, name, chain.checked_sub(1)?),
        _ => None,
    })
}

/// Returns whether a module imports a name from another crate.
fn is_foreign(modules: &[Module], module: usize, name: &str) -> bool {
    modules[module].imports.contains_key(name)
}
