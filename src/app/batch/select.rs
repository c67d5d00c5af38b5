//! Selection of a batch's sweeps, for parts that run elsewhere.

use std::str::FromStr;

use sha2::{Digest as _, Sha256};

use super::plan::Planned;
use crate::failure::Failure;

/// One of so many parts of a batch, which have no sweep in common.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Part {
    /// From 1.
    pub(crate) number: u64,
    pub(crate) of: u64,
}

impl FromStr for Part {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parsed = text.split_once('/').and_then(|(k, n)| Some((k.trim().parse().ok()?, n.trim().parse().ok()?)));
        match parsed {
            Some((number, of)) if (1..=of).contains(&number) => Ok(Self { number, of }),
            _ => Err(format!("{text:?} must be K/N, with K from 1 to N, such as 3/10")),
        }
    }
}

impl Part {
    /// Whether a sweep belongs to the part: by a hash of its id, so that no other row counts.
    pub(crate) fn has(self, id: &str) -> bool {
        let hash = Sha256::digest(id);
        let number = hash.iter().take(8).fold(0_u64, |number, byte| number << 8 | u64::from(*byte));
        number % self.of == self.number - 1
    }
}

/// Sweeps to consider.
#[derive(Debug, Clone, Default)]
pub(crate) struct Selection {
    /// Ids; empty for all.
    pub(crate) only: Vec<String>,
    pub(crate) part: Option<Part>,
}

impl Selection {
    /// Returns the selected sweeps.
    ///
    /// # Errors
    /// [`Failure`] for an id that the plan lacks.
    pub(crate) fn of<'a>(&self, sweeps: &'a [Planned]) -> Result<Vec<&'a Planned>, Failure> {
        if let Some(unknown) = self.only.iter().find(|id| !sweeps.iter().any(|sweep| sweep.id == **id)) {
            return Err(Failure::usage(format!("--only {unknown}: the plan has no such id; give one of its own")));
        }
        let is_selected = |sweep: &&Planned| {
            (self.only.is_empty() || self.only.contains(&sweep.id)) && self.part.is_none_or(|part| part.has(&sweep.id))
        };
        Ok(sweeps.iter().filter(is_selected).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_hold_each_sweep_once() {
        for of in [1, 3, 7] {
            let mut sizes = vec![0; of as usize];
            for id in 0..1000 {
                let id = format!("sweep-{id}");
                let parts: Vec<u64> = (1..=of).filter(|number| Part { number: *number, of }.has(&id)).collect();
                assert_eq!(parts.len(), 1, "{id}");
                sizes[parts[0] as usize - 1] += 1;
            }
            let fair = 1000 / of as usize;
            assert!(sizes.iter().all(|size| (fair * 3 / 4..=fair * 5 / 4).contains(size)), "{sizes:?}");
        }
        assert_eq!("3/10".parse(), Ok(Part { number: 3, of: 10 }));
        for wrong in ["", "0/3", "4/3", "3", "a/b", "1/0"] {
            assert!(wrong.parse::<Part>().is_err(), "{wrong}");
        }
    }
}
