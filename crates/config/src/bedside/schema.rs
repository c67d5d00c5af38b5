//! Every section and key of a session configuration: its values, its meaning, and when a change
//! of it takes effect.
//!
//! Unknown keys are detected with this list, `live --keys` prints it, and it determines which
//! changes wait for a restart.

mod key;
mod sections;

pub use key::{Applies, Key, Section};
pub use sections::SECTIONS;

impl Section {
    /// Returns the names of its keys and subsections.
    pub fn known(&self) -> Vec<&'static str> {
        let inner = SECTIONS.iter().filter_map(|section| section.name.strip_prefix(self.name)?.strip_prefix('.'));
        self.keys.iter().map(|key| key.name).chain(inner).collect()
    }
}

/// Returns the section of a heading.
pub fn section(name: &str) -> Option<&'static Section> {
    SECTIONS.iter().find(|section| section.name == name)
}

/// Returns the key of a dotted name.
pub fn key(dotted: &str) -> Option<&'static Key> {
    let (heading, name) = dotted.rsplit_once('.')?;
    section(heading)?.keys.iter().find(|key| key.name == name)
}
