//! Names in fields of fixed length, padded with zeros.

use std::fmt;

/// A name of at most `N` bytes, without control characters.
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Fixed<const N: usize> {
    bytes: [u8; N],
    length: usize,
}

/// Why a name does not fit its field.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Unfit {
    /// The name is too long.
    #[error("{name:?} has {length} bytes, and {most} fit; use a shorter name")]
    Long {
        /// The name.
        name: String,
        /// Bytes of the name.
        length: usize,
        /// Bytes of the field.
        most: usize,
    },
    /// The name has a control character.
    #[error("{name:?} has a control character at byte {at}; remove it")]
    Control {
        /// The name.
        name: String,
        /// Byte position of the control character.
        at: usize,
    },
}

impl<const N: usize> Fixed<N> {
    /// The empty name.
    pub const EMPTY: Self = Self { bytes: [0; N], length: 0 };

    /// Creates a name.
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

    /// Reads a field. The name ends at the first zero, and later bytes are ignored, as in the
    /// reference library. The error is the position of the first invalid byte.
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

    /// Returns the field's bytes.
    pub const fn bytes(&self) -> &[u8; N] {
        &self.bytes
    }

    /// Returns the name.
    pub fn as_str(&self) -> &str {
        // The bytes come from valid text.
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
    fn name_fits_up_to_field_length() {
        let name = Fixed::<5>::new("Probe").unwrap();
        assert_eq!((name.as_str(), *name.bytes()), ("Probe", *b"Probe"));
        assert_eq!(Fixed::read(name.bytes()), Ok(name));
        assert_eq!(Fixed::<8>::read(b"a\0garbag").unwrap(), Fixed::new("a").unwrap());
        assert_eq!(Fixed::<5>::new("Probes"), Err(Unfit::Long { name: "Probes".into(), length: 6, most: 5 }));
        assert_eq!(Fixed::<5>::new("a\nb"), Err(Unfit::Control { name: "a\nb".into(), at: 1 }));
        assert_eq!(Fixed::<4>::read(b"ab\x07\0"), Err(2));
        assert_eq!(Fixed::<4>::read(b"a\xff\0\0"), Err(1));
    }
}
