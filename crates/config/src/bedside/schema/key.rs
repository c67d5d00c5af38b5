//! A section, a key, and the time at which a change of it takes effect.

/// A section of the file.
#[derive(Debug)]
pub struct Section {
    /// Its heading, dotted.
    pub name: &'static str,
    /// Its subject.
    pub about: &'static str,
    /// Its keys.
    pub keys: &'static [Key],
}

/// A key of a section.
#[derive(Debug)]
pub struct Key {
    /// Its name, its unit last.
    pub name: &'static str,
    /// Its valid values.
    pub takes: &'static str,
    /// Its meaning, and its default.
    pub about: &'static str,
    /// Time at which a change of it takes effect.
    pub applies: Applies,
}

/// Time at which a change of a key takes effect in a running session.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Applies {
    /// At the next reading of the file.
    AtOnce,
    /// In the next session.
    NextSession,
}

pub(super) const fn next(name: &'static str, takes: &'static str, about: &'static str) -> Key {
    Key { name, takes, about, applies: Applies::NextSession }
}

pub(super) const fn once(name: &'static str, takes: &'static str, about: &'static str) -> Key {
    Key { name, takes, about, applies: Applies::AtOnce }
}
