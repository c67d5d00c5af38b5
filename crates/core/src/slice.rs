//! A posed slice: an image in MF orientation, its time, and the pose of its plane in the world.

use std::sync::Arc;

use crate::frames::{Image as ImageFrame, Transform, World};
use crate::region::ClipRect;

/// A grey image in MF orientation: u right, v down, u fastest. The position of a pixel is its
/// centre; the first is (0, 0).
#[derive(Debug, Clone)]
pub struct Image {
    width: u32,
    height: u32,
    pixels: Pixels,
}

/// Grey values. Types other than 8 and 16 bit unsigned arrive as f32.
#[derive(Debug, Clone)]
pub enum Pixels {
    /// 8-bit unsigned.
    U8(Arc<[u8]>),
    /// 16-bit unsigned.
    U16(Arc<[u16]>),
    /// Single precision.
    F32(Arc<[f32]>),
}

impl Pixels {
    /// Number of pixels.
    pub fn len(&self) -> usize {
        match self {
            Self::U8(p) => p.len(),
            Self::U16(p) => p.len(),
            Self::F32(p) => p.len(),
        }
    }

    /// Memory that they take, bytes.
    pub fn bytes(&self) -> usize {
        match self {
            Self::U8(p) => size_of_val(&**p),
            Self::U16(p) => size_of_val(&**p),
            Self::F32(p) => size_of_val(&**p),
        }
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Whether both have the same type and bits.
    pub fn same_bits(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::U8(a), Self::U8(b)) => Arc::ptr_eq(a, b) || a == b,
            (Self::U16(a), Self::U16(b)) => Arc::ptr_eq(a, b) || a == b,
            (Self::F32(a), Self::F32(b)) => {
                Arc::ptr_eq(a, b) || a.iter().map(|x| x.to_bits()).eq(b.iter().map(|x| x.to_bits()))
            }
            _ => false,
        }
    }
}

impl Image {
    /// Returns an image of `width`×`height` pixels.
    ///
    /// # Panics
    /// When `pixels` does not hold exactly that many: the caller has just made both.
    pub fn new(width: u32, height: u32, pixels: Pixels) -> Self {
        assert_eq!(pixels.len(), width as usize * height as usize, "pixels do not fill the picture");
        Self { width, height, pixels }
    }

    /// Pixels along u.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Pixels along v.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// The grey values, u fastest.
    pub fn pixels(&self) -> &Pixels {
        &self.pixels
    }

    /// Whether both have the same size, type and bits within a rectangle. Parts of the
    /// rectangle outside the image are ignored.
    pub fn same_within(&self, other: &Self, rect: ClipRect) -> bool {
        if [self.width, self.height] != [other.width, other.height] {
            return false;
        }
        if rect.covers(self.width, self.height) {
            return self.pixels.same_bits(&other.pixels);
        }
        let width = self.width as usize;
        let end = |at: u32, length: u32, most: u32| at.saturating_add(length).min(most) as usize;
        let columns = (rect.x as usize).min(width)..end(rect.x, rect.width, self.width);
        let rows = rect.y as usize..end(rect.y, rect.height, self.height);
        rows.map(|v| v * width + columns.start..v * width + columns.end).all(|row| {
            match (&self.pixels, &other.pixels) {
                (Pixels::U8(a), Pixels::U8(b)) => a[row.clone()] == b[row],
                (Pixels::U16(a), Pixels::U16(b)) => a[row.clone()] == b[row],
                (Pixels::F32(a), Pixels::F32(b)) => {
                    a[row.clone()].iter().map(|x| x.to_bits()).eq(b[row].iter().map(|x| x.to_bits()))
                }
                _ => false,
            }
        })
    }
}

/// An image with its time and its pose in the world.
#[derive(Debug, Clone)]
pub struct Slice {
    /// The image.
    pub image: Image,
    /// Measurement time, ns, on the stream's clock.
    pub time_ns: i64,
    /// Maps pixels (u, v, 0) to world mm. Its third column is the direction of increasing plane
    /// distance; only its direction matters.
    pub world_from_image: Transform<World, ImageFrame>,
}
