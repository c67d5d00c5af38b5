//! Scalar types of written values, and values in them.

use serde::{Deserialize, Serialize};

/// Scalar type of the written values.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Scalar {
    /// 8 bit unsigned.
    U8,
    /// 16 bit unsigned.
    U16,
    /// Single precision.
    F32,
}

impl Scalar {
    /// Returns the name in messages, as on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::U8 => "u8",
            Self::U16 => "u16",
            Self::F32 => "f32",
        }
    }

    /// Returns the name in array metadata.
    pub(crate) fn data_type(self) -> &'static str {
        match self {
            Self::U8 => "uint8",
            Self::U16 => "uint16",
            Self::F32 => "float32",
        }
    }
}

/// Values of a shard in their scalar type, x fastest.
#[derive(Debug, Clone, Copy)]
pub enum Samples<'a> {
    /// 8 bit unsigned.
    U8(&'a [u8]),
    /// 16 bit unsigned.
    U16(&'a [u16]),
    /// Single precision.
    F32(&'a [f32]),
}

impl Samples<'_> {
    /// Returns the scalar type.
    pub fn scalar(&self) -> Scalar {
        match self {
            Self::U8(_) => Scalar::U8,
            Self::U16(_) => Scalar::U16,
            Self::F32(_) => Scalar::F32,
        }
    }
}

/// A number that arrays hold.
pub(crate) trait Sample: bytemuck::Pod + PartialEq + Send + Sync {
    /// Converts to f64 without loss.
    fn to_f64(self) -> f64;

    /// Returns the number next to a mean; halves go to even integers.
    fn of_mean(mean: f64) -> Self;

    /// Returns the value of unseen voxels, which is one of this type.
    fn of_unseen(value: f32) -> Self {
        Self::of_mean(value.into())
    }

    /// Whether arrays may hold it.
    fn is_valid(self) -> bool {
        true
    }

    /// Whether the bits are those of another.
    fn is_same(self, other: Self) -> bool {
        bytemuck::bytes_of(&self) == bytemuck::bytes_of(&other)
    }
}

impl Sample for u8 {
    fn to_f64(self) -> f64 {
        self.into()
    }

    fn of_mean(mean: f64) -> Self {
        mean.round_ties_even() as Self
    }
}

impl Sample for u16 {
    fn to_f64(self) -> f64 {
        self.into()
    }

    fn of_mean(mean: f64) -> Self {
        mean.round_ties_even() as Self
    }
}

impl Sample for f32 {
    fn to_f64(self) -> f64 {
        self.into()
    }

    fn of_mean(mean: f64) -> Self {
        mean as Self
    }

    fn of_unseen(value: f32) -> Self {
        // The bits that metadata's "NaN" stands for.
        if value.is_nan() { Self::NAN } else { value }
    }

    fn is_valid(self) -> bool {
        self.is_finite()
    }
}
