//! Parts of a whole that run elsewhere: K of N.

use std::str::FromStr;

use sha2::{Digest as _, Sha256};

/// One of so many parts of a whole, which have nothing in common.
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
    /// Whether a named member belongs to the part: by a hash of its name, so that no other one
    /// counts.
    pub(crate) fn has(self, name: &str) -> bool {
        let hash = Sha256::digest(name);
        let number = hash.iter().take(8).fold(0_u64, |number, byte| number << 8 | u64::from(*byte));
        number % self.of == self.number - 1
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_hold_each_member_once() {
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
