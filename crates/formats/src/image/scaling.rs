//! Scaling of stored values.

use sonoweave_core::reading::PixelType;

/// Scaling of stored values: value = `slope` × stored + `offset`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Scaling {
    pub(crate) slope: f64,
    pub(crate) offset: f64,
}

impl Scaling {
    /// Scalar type of scaled values.
    pub(crate) const PIXEL: PixelType = PixelType::F64;

    pub(super) fn apply(self, stored: &[u8], pixel: PixelType, values: &mut Vec<u8>) {
        fn each<const N: usize>(stored: &[u8], values: &mut Vec<u8>, value: impl Fn([u8; N]) -> f64) {
            values.extend(stored.as_chunks::<N>().0.iter().flat_map(|word| value(*word).to_ne_bytes()));
        }
        let Self { slope, offset } = self;
        let of = |value: f64| value * slope + offset;
        values.clear();
        match pixel {
            PixelType::U8 => each(stored, values, |b| of(u8::from_ne_bytes(b).into())),
            PixelType::I8 => each(stored, values, |b| of(i8::from_ne_bytes(b).into())),
            PixelType::U16 => each(stored, values, |b| of(u16::from_ne_bytes(b).into())),
            PixelType::I16 => each(stored, values, |b| of(i16::from_ne_bytes(b).into())),
            PixelType::U32 => each(stored, values, |b| of(u32::from_ne_bytes(b).into())),
            PixelType::I32 => each(stored, values, |b| of(i32::from_ne_bytes(b).into())),
            PixelType::U64 => each(stored, values, |b| of(u64::from_ne_bytes(b) as f64)),
            PixelType::I64 => each(stored, values, |b| of(i64::from_ne_bytes(b) as f64)),
            PixelType::F32 => each(stored, values, |b| of(f32::from_ne_bytes(b).into())),
            PixelType::F64 => each(stored, values, |b| of(f64::from_ne_bytes(b))),
        }
    }
}
