//! Protocol Buffers' wire format: fields by number, limited to the needs of session messages.
//! Allocates only in the output buffer. prost's messages own their texts and lists, so that each
//! reading would allocate; and its macros would lengthen every build.

/// Appends fields to a message.
pub(super) struct Fields<'a>(&'a mut Vec<u8>);

const VARINT: u32 = 0;
const FIXED64: u32 = 1;
const BYTES: u32 = 2;
const FIXED32: u32 = 5;

impl<'a> Fields<'a> {
    /// Appends at the end of a buffer.
    pub(super) fn to(buffer: &'a mut Vec<u8>) -> Self {
        Self(buffer)
    }

    fn varint(&mut self, mut value: u64) {
        while value >= 0x80 {
            self.0.push(value as u8 | 0x80);
            value >>= 7;
        }
        self.0.push(value as u8);
    }

    fn key(&mut self, number: u32, kind: u32) {
        self.varint(u64::from(number << 3 | kind));
    }

    /// Writes `uint32`, `uint64`, `bool`, and non-negative `int32` and `int64`.
    pub(super) fn uint(&mut self, number: u32, value: u64) {
        self.key(number, VARINT);
        self.varint(value);
    }

    /// Writes `sint32` and `sint64`.
    pub(super) fn sint(&mut self, number: u32, value: i64) {
        self.uint(number, (value << 1 ^ value >> 63).cast_unsigned());
    }

    /// Writes `sfixed64`.
    pub(super) fn fixed(&mut self, number: u32, value: i64) {
        self.key(number, FIXED64);
        self.0.extend_from_slice(&value.to_le_bytes());
    }

    /// Writes `double`, bit by bit.
    pub(super) fn double(&mut self, number: u32, value: f64) {
        self.key(number, FIXED64);
        self.0.extend_from_slice(&value.to_bits().to_le_bytes());
    }

    /// Writes `bytes`.
    pub(super) fn bytes(&mut self, number: u32, bytes: &[u8]) {
        self.key(number, BYTES);
        self.varint(bytes.len() as u64);
        self.0.extend_from_slice(bytes);
    }

    /// Writes `string`.
    pub(super) fn text(&mut self, number: u32, text: &str) {
        self.bytes(number, text.as_bytes());
    }

    /// Writes an embedded message.
    pub(super) fn message(&mut self, number: u32, fill: impl FnOnce(&mut Fields<'_>)) {
        self.key(number, BYTES);
        let at = self.0.len();
        self.0.push(0);
        fill(&mut Fields(self.0));
        let mut length = self.0.len() - at - 1;
        // Most are shorter than 128 bytes, so that the length takes one byte.
        let mut place = at;
        while length >= 0x80 {
            self.0[place] = length as u8 | 0x80;
            length >>= 7;
            place += 1;
            self.0.insert(place, 0);
        }
        self.0[place] = length as u8;
    }

    /// Writes `repeated double`, packed.
    pub(super) fn doubles(&mut self, number: u32, values: &[f64]) {
        self.key(number, BYTES);
        self.varint(8 * values.len() as u64);
        values.iter().for_each(|value| self.0.extend_from_slice(&value.to_bits().to_le_bytes()));
    }

    /// Writes `repeated sint64`, packed.
    pub(super) fn sints(&mut self, number: u32, values: &[i64]) {
        self.message(number, |packed| {
            values.iter().for_each(|value| packed.varint((value << 1 ^ value >> 63).cast_unsigned()));
        });
    }
}

/// Content of a field.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Value<'a> {
    /// A number of variable length.
    Varint(u64),
    /// Eight bytes.
    Fixed64([u8; 8]),
    /// Bytes, a text, a message, or packed numbers.
    Bytes(&'a [u8]),
    /// Four bytes.
    Fixed32,
}

/// The bytes are no message, or a field has another type than expected.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Malformed;

impl<'a> Value<'a> {
    pub(super) fn uint(self) -> Result<u64, Malformed> {
        if let Self::Varint(value) = self { Ok(value) } else { Err(Malformed) }
    }

    pub(super) fn small<T: TryFrom<u64>>(self) -> Result<T, Malformed> {
        T::try_from(self.uint()?).map_err(|_| Malformed)
    }

    pub(super) fn sint(self) -> Result<i64, Malformed> {
        self.uint().map(unzigzag)
    }

    pub(super) fn fixed(self) -> Result<i64, Malformed> {
        if let Self::Fixed64(bytes) = self { Ok(i64::from_le_bytes(bytes)) } else { Err(Malformed) }
    }

    pub(super) fn double(self) -> Result<f64, Malformed> {
        if let Self::Fixed64(bytes) = self { Ok(f64::from_le_bytes(bytes)) } else { Err(Malformed) }
    }

    pub(super) fn bytes(self) -> Result<&'a [u8], Malformed> {
        if let Self::Bytes(bytes) = self { Ok(bytes) } else { Err(Malformed) }
    }

    pub(super) fn text(self) -> Result<&'a str, Malformed> {
        str::from_utf8(self.bytes()?).map_err(|_| Malformed)
    }

    /// Parses exactly `N` packed doubles.
    pub(super) fn doubles<const N: usize>(self) -> Result<[f64; N], Malformed> {
        let (chunks, rest) = self.bytes()?.as_chunks::<8>();
        if chunks.len() != N || !rest.is_empty() {
            return Err(Malformed);
        }
        Ok(std::array::from_fn(|n| f64::from_le_bytes(chunks[n])))
    }

    /// Parses exactly `N` packed signed numbers.
    pub(super) fn sints<const N: usize>(self) -> Result<[i64; N], Malformed> {
        let mut rest = Reader(self.bytes()?);
        let mut values = [0; N];
        for value in &mut values {
            *value = unzigzag(rest.varint()?);
        }
        if rest.0.is_empty() { Ok(values) } else { Err(Malformed) }
    }
}

fn unzigzag(value: u64) -> i64 {
    (value >> 1).cast_signed() ^ -(value & 1).cast_signed()
}

/// Iterates over the fields of a message, in their stored order.
pub(super) struct Reader<'a>(pub(super) &'a [u8]);

impl<'a> Reader<'a> {
    fn varint(&mut self) -> Result<u64, Malformed> {
        let mut value = 0;
        for shift in (0..64).step_by(7) {
            let (byte, rest) = self.0.split_first().ok_or(Malformed)?;
            self.0 = rest;
            // The tenth byte has room for one bit.
            if shift == 63 && *byte > 1 {
                return Err(Malformed);
            }
            value |= u64::from(byte & 0x7f) << shift;
            if byte & 0x80 == 0 {
                return Ok(value);
            }
        }
        Err(Malformed)
    }

    fn split(&mut self, bytes: usize) -> Result<&'a [u8], Malformed> {
        let (taken, rest) = self.0.split_at_checked(bytes).ok_or(Malformed)?;
        self.0 = rest;
        Ok(taken)
    }

    fn field(&mut self) -> Result<(u32, Value<'a>), Malformed> {
        let key = u32::try_from(self.varint()?).map_err(|_| Malformed)?;
        let value = match key & 7 {
            VARINT => Value::Varint(self.varint()?),
            FIXED64 => Value::Fixed64(self.split(8)?.try_into().map_err(|_| Malformed)?),
            BYTES => {
                let length = usize::try_from(self.varint()?).map_err(|_| Malformed)?;
                Value::Bytes(self.split(length)?)
            }
            FIXED32 => {
                self.split(4)?;
                Value::Fixed32
            }
            _ => return Err(Malformed),
        };
        Ok((key >> 3, value))
    }
}

impl<'a> Iterator for Reader<'a> {
    type Item = Result<(u32, Value<'a>), Malformed>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.0.is_empty() {
            return None;
        }
        let field = self.field();
        if field.is_err() {
            self.0 = &[];
        }
        Some(field)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn encoding_matches_published_examples() {
        let mut bytes = Vec::new();
        Fields::to(&mut bytes).uint(1, 150);
        Fields::to(&mut bytes).text(2, "testing");
        Fields::to(&mut bytes).message(3, |inner| inner.uint(1, 150));
        assert_eq!(bytes, *b"\x08\x96\x01\x12\x07testing\x1a\x03\x08\x96\x01");
        let mut bytes = Vec::new();
        [0, -1, 1, -2, i64::MAX, i64::MIN].iter().for_each(|n| Fields::to(&mut bytes).sint(1, *n));
        assert_eq!(&bytes[..8], [8, 0, 8, 1, 8, 2, 8, 3]);
        assert_eq!(bytes[bytes.len() - 11..], [8, 255, 255, 255, 255, 255, 255, 255, 255, 255, 1]);
    }

    proptest! {
        #[test]
        fn fields_roundtrip(ints: [i64; 3], bits: [u64; 3], bytes: Vec<u8>, number in 1_u32..1 << 28) {
            let doubles = bits.map(f64::from_bits);
            let long = [&bytes[..], &[7; 20_000]].concat();
            let mut buffer = vec![9];
            let mut fields = Fields::to(&mut buffer);
            fields.message(number, |inner| {
                inner.bytes(1, &bytes);
                inner.message(2, |inner| inner.bytes(3, &long));
                inner.sints(4, &ints);
                inner.doubles(5, &doubles);
                inner.fixed(6, ints[0]);
                inner.double(7, doubles[0]);
                inner.sint(8, ints[1]);
            });
            let mut outer = Reader(&buffer[1..]);
            let (again, value) = outer.next().unwrap().unwrap();
            prop_assert_eq!(again, number);
            prop_assert!(outer.next().is_none());
            let inner: Vec<_> = Reader(value.bytes().unwrap()).map(Result::unwrap).collect();
            prop_assert_eq!(inner[0], (1, Value::Bytes(&bytes)));
            let (_, deep) = Reader(inner[1].1.bytes().unwrap()).next().unwrap().unwrap();
            prop_assert_eq!(deep.bytes().unwrap(), &long[..]);
            prop_assert_eq!(inner[2].1.sints::<3>().unwrap(), ints);
            prop_assert_eq!(inner[3].1.doubles::<3>().unwrap().map(f64::to_bits), bits);
            prop_assert_eq!(inner[4].1.fixed().unwrap(), ints[0]);
            prop_assert_eq!(inner[5].1.double().unwrap().to_bits(), bits[0]);
            prop_assert_eq!(inner[6].1.sint().unwrap(), ints[1]);
        }

        #[test]
        fn arbitrary_bytes_never_panic(bytes: Vec<u8>) {
            let mut seen = 0;
            for field in Reader(&bytes) {
                seen += 1;
                if let Ok((_, Value::Bytes(inner))) = field {
                    prop_assert!(inner.len() < bytes.len());
                }
            }
            prop_assert!(seen <= bytes.len());
        }
    }
}
