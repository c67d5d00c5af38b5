//! Names in fields of fixed length: what is left of the field is zeros.

use std::fmt;

/// A name of at most `N` bytes, without control characters.
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Fixed<const N: usize> {
    bytes: [u8; N],
    length: usize,
}

/// A name that does not go into its field.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Unfit {
    /// Too long.
    #[error("{name:?} has {length} bytes where {most} fit; take a shorter name")]
    Long {
        /// The name.
        name: String,
        /// Its bytes.
        length: usize,
        /// Those of the field.
        most: usize,
    },
    /// Has a control character.
    #[error("{name:?} has a control character at byte {at}; leave it out")]
    Control {
        /// The name.
        name: String,
        /// Where.
        at: usize,
    },
}

impl<const N: usize> Fixed<N> {
    /// No name.
    pub const EMPTY: Self = Self { bytes: [0; N], length: 0 };

    /// That name.
    ///
    /// # Errors
    /// [`Unfit`].
    pub fn new(name: &str) -> Result<Self, Unfit> {
        if name.len() > N {
            return Err(Unfit::Long { name: name.into(), length: name.len(), most: N });
        }
        if let Some((at, _)) = name.char_indices().find(|(_, c)| c.is_control()) {
            return Err(Unfit::Control { name: name.into(), at });
        }
        let mut bytes = [0; N];
        bytes[..name.len()].copy_from_slice(name.as_bytes());
        Ok(Self { bytes, length: name.len() })
    }

    /// A field as it came: the name ends with the first zero, and what follows it does not count, as where the reference library reads it. The first byte that no
    /// name has where it is none.
    pub(super) fn read(bytes: &[u8; N]) -> Result<Self, usize> {
        let length = bytes.iter().position(|byte| *byte == 0).unwrap_or(N);
        let name = std::str::from_utf8(&bytes[..length]).map_err(|error| error.valid_up_to())?;
        match name.char_indices().find(|(_, c)| c.is_control()) {
            Some((at, _)) => Err(at),
            None => {
                let mut kept = [0; N];
                kept[..length].copy_from_slice(&bytes[..length]);
                Ok(Self { bytes: kept, length })
            }
        }
    }

    /// The field's bytes.
    pub const fn bytes(&self) -> &[u8; N] {
        &self.bytes
    }

    /// The name.
    pub fn as_str(&self) -> &str {
        // Made of text alone.
        std::str::from_utf8(&self.bytes[..self.length]).unwrap_or_default()
    }
}

impl<const N: usize> fmt::Debug for Fixed<N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Debug::fmt(self.as_str(), f)
    }
}

impl<const N: usize> fmt::Display for Fixed<N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}

impl<const N: usize> PartialEq<str> for Fixed<N> {
    fn eq(&self, other: &str) -> bool {
        self.as_str() == other
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_fill_their_fields_and_no_more() {
        let name = Fixed::<5>::new("Probe").unwrap();
        assert_eq!((name.as_str(), *name.bytes()), ("Probe", *b"Probe"));
        assert_eq!(Fixed::read(name.bytes()), Ok(name));
        assert_eq!(Fixed::<8>::read(b"a\0garbag").unwrap(), Fixed::new("a").unwrap());
        let long = Fixed::<5>::new("Probes").unwrap_err().to_string();
        assert!(long.contains("6 bytes where 5 fit"), "{long}");
        let control = Fixed::<5>::new("a\nb").unwrap_err().to_string();
        assert!(control.contains("at byte 1"), "{control}");
        assert_eq!(Fixed::<4>::read(b"ab\x07\0"), Err(2));
        assert_eq!(Fixed::<4>::read(b"a\xff\0\0"), Err(1));
    }
}
