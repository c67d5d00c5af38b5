//! Reads a message's fields in order, and reports which is wrong and where.

use super::fixed::Fixed;

/// Kinds of errors in a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Fault {
    /// The header is invalid.
    Header,
    /// The message is too large.
    TooLarge,
    /// The checksum is wrong.
    Checksum,
    /// The message is shorter or longer than its fields require.
    Length,
    /// A field has an invalid value.
    Field,
}

/// An error in a message, and its position.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Trouble {
    pub(super) fault: Fault,
    /// Bytes from the beginning of the message.
    pub(super) offset: usize,
    /// The problem and the remedy.
    pub(super) problem: String,
}

/// Reads fields in order.
pub(super) struct Cursor<'a> {
    bytes: &'a [u8],
    /// Position of the first of `bytes`, from the message's first byte.
    offset: usize,
}

impl<'a> Cursor<'a> {
    /// Creates a cursor over bytes that begin at `offset` of the message.
    pub(super) const fn new(bytes: &'a [u8], offset: usize) -> Self {
        Self { bytes, offset }
    }

    pub(super) const fn left(&self) -> usize {
        self.bytes.len()
    }

    pub(super) const fn offset(&self) -> usize {
        self.offset
    }

    pub(super) fn trouble<T>(&self, fault: Fault, problem: String) -> Result<T, Trouble> {
        Err(Trouble { fault, offset: self.offset, problem })
    }

    /// Reads `length` bytes of the field with this name.
    pub(super) fn slice(&mut self, field: &str, length: usize) -> Result<&'a [u8], Trouble> {
        let Some((taken, rest)) = self.bytes.split_at_checked(length) else {
            let left = self.bytes.len();
            let problem = format!("{field} needs {length} bytes, but {left} are left; send the whole message");
            return self.trouble(Fault::Length, problem);
        };
        self.bytes = rest;
        self.offset += length;
        Ok(taken)
    }

    pub(super) fn array<const N: usize>(&mut self, field: &str) -> Result<[u8; N], Trouble> {
        let mut array = [0; N];
        array.copy_from_slice(self.slice(field, N)?);
        Ok(array)
    }

    pub(super) fn u8(&mut self, field: &str) -> Result<u8, Trouble> {
        self.array::<1>(field).map(|[byte]| byte)
    }

    pub(super) fn u16(&mut self, field: &str) -> Result<u16, Trouble> {
        self.array(field).map(u16::from_be_bytes)
    }

    pub(super) fn u32(&mut self, field: &str) -> Result<u32, Trouble> {
        self.array(field).map(u32::from_be_bytes)
    }

    pub(super) fn f32(&mut self, field: &str) -> Result<f32, Trouble> {
        self.array(field).map(f32::from_be_bytes)
    }

    pub(super) fn name<const N: usize>(&mut self, field: &str) -> Result<Fixed<N>, Trouble> {
        let offset = self.offset;
        Fixed::read(&self.array(field)?).map_err(|at| {
            let problem = format!("{field} is not text; send UTF-8 without control characters");
            Trouble { fault: Fault::Field, offset: offset + at, problem }
        })
    }

    /// Checks that everything was read.
    pub(super) fn end(&self, of: &str) -> Result<(), Trouble> {
        match self.bytes.len() {
            0 => Ok(()),
            left => self.trouble(Fault::Length, format!("{left} bytes follow {of}; remove them")),
        }
    }
}
