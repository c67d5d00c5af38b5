//! Converts readings into samples: the one place where units, frames and clocks change.
//!
//! - **Image frame.** Sources store images in one of eight orientations, named by two letters,
//!   one for each stored axis (first axis first). M or U: the lateral axis grows towards the
//!   marked or the unmarked side of the transducer. F or N: the depth axis grows away from it
//!   or towards it. A third letter (A or D, the order of slices in a stack) is ignored for a
//!   single image. After this stage every image is MF.
//! - **Grey values.** 8 and 16 bit unsigned values stay; other types become f32. Colours are
//!   reduced to luma ([`grey`]). An 8-bit, one-channel MF image is not copied.
//! - **Clock.** Host nanoseconds if the source has them, else the source's seconds as
//!   nanoseconds, else the frame's number.
//!
//! Named transforms are in mm already and pass unchanged. Live hardware readings are handled by
//! [`live`].

pub mod grey;
pub mod live;

use std::sync::Arc;

use sonoweave_core::Reading;
use sonoweave_core::reading::{Frame, NamedTransform, PixelType, Stamp, Status};
use sonoweave_core::refusal::{Reason, Refusal};
use sonoweave_core::region::ClipRect;
use sonoweave_core::slice::{Image, Pixels};

/// Largest deviation of a tracker's rotation (max |RᵀR − I|) that is repaired by the nearest
/// rotation; beyond, the pose is refused.
pub const RIGID_TOLERANCE: f64 = 1e-2;

/// Result of converting a reading.
#[derive(Debug)]
#[allow(clippy::large_enum_variant, reason = "nearly all values are the large ones, moved once")]
pub enum Sample {
    /// An image in MF orientation.
    Picture(Picture),
    /// A transform for the frames with the same stamp.
    Transform(NamedTransform),
    /// A frame that cannot be used.
    Refused(Refusal),
    /// A reading that no stage uses, by kind.
    Unused(&'static str),
}

/// An image with its time.
#[derive(Debug, Clone)]
pub struct Picture {
    /// The frame's stamp, time and size.
    pub head: Head,
    /// The grey values.
    pub image: Image,
}

/// Properties of a frame that are known before its pixels are read.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Head {
    /// The source's stamp; transforms of the same stamp belong to the frame.
    pub stamp: Stamp,
    /// Measurement time, ns.
    pub time_ns: i64,
    /// Whether the source gave no time, so that the frame's number is used instead.
    pub untimed: bool,
    /// Width and height in MF orientation.
    pub size: [u32; 2],
    orientation: Orientation,
}

/// The ingest stage. Its only state is which notes it has already given.
#[derive(Debug, Default)]
pub struct Ingest {
    assumed_mf: bool,
    rounded: bool,
    greyed: bool,
    notes: Vec<String>,
}

impl Ingest {
    /// Returns a stage that has read nothing yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Converts a reading into a sample.
    pub fn take(&mut self, reading: Reading) -> Sample {
        match reading {
            Reading::Frame(frame) => match self.picture(&frame) {
                Ok(picture) => Sample::Picture(picture),
                Err(refusal) => Sample::Refused(refusal),
            },
            Reading::NamedTransform(transform) => Sample::Transform(transform),
            Reading::Counts(_) => Sample::Unused("counts"),
            Reading::Pose(_) => Sample::Unused("pose"),
            Reading::Recorded(_) => Sample::Unused("recorded"),
            Reading::Raw(_) => Sample::Unused("raw"),
        }
    }

    /// Notes for the user: sentences, each given once.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// Checks everything of a frame except its pixels, which may be absent (a device opened
    /// without images).
    ///
    /// # Errors
    /// A [`Refusal`] for the status, size, type, colour, orientation or time.
    pub fn head(&mut self, frame: &Frame) -> Result<Head, Refusal> {
        let refuse = |reason, detail: String| Err(Refusal::new(frame.stamp.item, reason, detail));
        if let Status::Other(word) = &frame.status {
            return refuse(Reason::ImageStatus, format!("the picture's status is {word}"));
        }
        if frame.size.contains(&0) {
            return refuse(Reason::ImageMissing, format!("the picture is {}×{} pixels", frame.size[0], frame.size[1]));
        }
        let kind = frame.image_type.trim().to_ascii_uppercase();
        if !(1..=4).contains(&frame.channels) {
            let detail = format!("{} channels a pixel; pictures have 1 to 4 of them", frame.channels);
            return refuse(Reason::Colour, detail);
        }
        if !(matches!(kind.as_str(), "" | "BRIGHTNESS") || kind == "RGB_COLOR" && frame.channels > 2) {
            return refuse(Reason::ImageType, format!("the image type is {kind}, not BRIGHTNESS"));
        }
        let code = frame.orientation.trim();
        let orientation = if code.is_empty() {
            if !std::mem::replace(&mut self.assumed_mf, true) {
                self.notes.push(
                    "no image orientation is given: MF is assumed (u to the marked side, v away from the probe)".into(),
                );
            }
            Orientation::MF
        } else {
            match Orientation::from_code(code) {
                Some(orientation) => orientation,
                None => {
                    let detail =
                        format!("\"{code}\" is no orientation of a 2D picture (MF, MN, UF, UN, FM, FU, NM or NU)");
                    return refuse(Reason::ImageOrientation, detail);
                }
            }
        };
        let (time_ns, untimed) = match (stamp_ns(&frame.stamp), frame.stamp.source_s) {
            (Some(ns), _) => (ns, false),
            (None, Some(seconds)) => {
                return refuse(Reason::TimeInvalid, format!("{seconds} s does not fit 64 bits of nanoseconds"));
            }
            (None, None) => (i64::try_from(frame.stamp.item).unwrap_or(i64::MAX), true),
        };
        let [first, second] = frame.size;
        let size = if orientation.transposed { [second, first] } else { [first, second] };
        Ok(Head { stamp: frame.stamp, time_ns, untimed, size, orientation })
    }

    /// Checks a frame and converts its image to MF.
    ///
    /// # Errors
    /// A [`Refusal`] as in [`Self::head`], or for the pixels.
    pub fn picture(&mut self, frame: &Frame) -> Result<Picture, Refusal> {
        let head = self.head(frame)?;
        let refuse = |reason, detail: String| Err(Refusal::new(frame.stamp.item, reason, detail));
        let pixels = frame.size[0] as usize * frame.size[1] as usize * frame.channels as usize;
        if pixels.checked_mul(frame.pixel.bytes()) != Some(frame.pixels.len()) {
            let ([w, h], bytes) = (frame.size, frame.pixels.len());
            return refuse(
                Reason::ImageMissing,
                format!("{bytes} bytes of pixels are not {w}×{h} of {} {:?}", frame.channels, frame.pixel),
            );
        }
        if matches!(frame.pixel, PixelType::U32 | PixelType::I32 | PixelType::U64 | PixelType::I64 | PixelType::F64)
            && !std::mem::replace(&mut self.rounded, true)
        {
            self.notes.push(format!("pixels of type {:?} are rounded to single precision (24 bits)", frame.pixel));
        }
        if let Some(note) = grey::described(frame.channels).filter(|_| !self.greyed) {
            self.greyed = true;
            self.notes.push(note);
        }
        let (place, channels) = (head.orientation, frame.channels);
        let bytes = &frame.pixels;
        let pixels = match frame.pixel {
            PixelType::U8 if place == Orientation::MF && channels == 1 => Pixels::U8(Arc::clone(bytes)),
            PixelType::U8 => Pixels::U8(place.arrange(grey::of(bytes.to_vec(), channels), frame.size).into()),
            PixelType::U16 => {
                let grey = grey::of(scalars(bytes, u16::from_ne_bytes), channels);
                Pixels::U16(place.arrange(grey, frame.size).into())
            }
            other => Pixels::F32(place.arrange(grey::of(floats(bytes, other), channels), frame.size).into()),
        };
        if let Pixels::F32(values) = &pixels
            && let Some(at) = values.iter().position(|x| !x.is_finite())
        {
            let (u, v) = (at % head.size[0] as usize, at / head.size[0] as usize);
            let detail = format!("pixel ({u}, {v}) is NaN, infinite or beyond single precision");
            return refuse(Reason::PixelNotFinite, detail);
        }
        Ok(Picture { head, image: Image::new(head.size[0], head.size[1], pixels) })
    }
}

/// Orientation of a stored image relative to MF.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Orientation {
    /// The first stored axis is depth.
    transposed: bool,
    /// The lateral axis grows towards the unmarked side.
    flip_u: bool,
    /// The depth axis grows towards the transducer.
    flip_v: bool,
}

impl Orientation {
    const MF: Self = Self { transposed: false, flip_u: false, flip_v: false };

    fn from_code(code: &str) -> Option<Self> {
        let code = code.to_ascii_uppercase();
        let (first, second) = match code.as_bytes() {
            [first, second] | [first, second, b'A' | b'D'] => (*first, *second),
            _ => return None,
        };
        let lateral = |letter| match letter {
            b'M' => Some(false),
            b'U' => Some(true),
            _ => None,
        };
        let depth = |letter| match letter {
            b'F' => Some(false),
            b'N' => Some(true),
            _ => None,
        };
        if let (Some(flip_u), Some(flip_v)) = (lateral(first), depth(second)) {
            return Some(Self { transposed: false, flip_u, flip_v });
        }
        Some(Self { transposed: true, flip_u: lateral(second)?, flip_v: depth(first)? })
    }

    /// Returns the pixels of the MF image, u fastest, from `stored` ones of `size`, first axis
    /// fastest.
    fn arrange<T: Copy>(self, stored: Vec<T>, size: [u32; 2]) -> Vec<T> {
        let [first, second] = size.map(|n| n as usize);
        if self == Self::MF {
            return stored;
        }
        let (width, height) = if self.transposed { (second, first) } else { (first, second) };
        let mut pixels = Vec::with_capacity(stored.len());
        for v in 0..height {
            let depth = if self.flip_v { height - 1 - v } else { v };
            let at = |u: usize| {
                let lateral = if self.flip_u { width - 1 - u } else { u };
                if self.transposed { stored[lateral * first + depth] } else { stored[depth * first + lateral] }
            };
            pixels.extend((0..width).map(at));
        }
        pixels
    }
}

/// Converts a rectangle of the MF image to stored axes (first, second), for frames of this
/// stored size and orientation code (empty: MF). `rect` receives the size of the MF image, and
/// its rectangle must lie in it. `None` for an unknown code.
pub fn stored_rect(size: [u32; 2], code: &str, rect: impl FnOnce([u32; 2]) -> ClipRect) -> Option<ClipRect> {
    let code = code.trim();
    let orientation = if code.is_empty() { Orientation::MF } else { Orientation::from_code(code)? };
    let Orientation { transposed, flip_u, flip_v } = orientation;
    let [width, height] = if transposed { [size[1], size[0]] } else { size };
    let ClipRect { x, y, width: of_u, height: of_v } = rect([width, height]);
    let lateral = if flip_u { width.saturating_sub(x + of_u) } else { x };
    let depth = if flip_v { height.saturating_sub(y + of_v) } else { y };
    Some(match transposed {
        true => ClipRect { x: depth, y: lateral, width: of_v, height: of_u },
        false => ClipRect { x: lateral, y: depth, width: of_u, height: of_v },
    })
}

/// Returns the MF size of images stored with this size and orientation code; the reverse
/// conversion is the same. `None` for an unknown code.
pub fn mf_size([first, second]: [u32; 2], code: &str) -> Option<[u32; 2]> {
    let transposed = Orientation::from_code(code.trim())?.transposed;
    Some(if transposed { [second, first] } else { [first, second] })
}

/// Returns the pixels of the MF image, u fastest, from stored ones of this size; `None` for an
/// unknown code.
pub fn to_mf<T: Copy>(pixels: Vec<T>, size: [u32; 2], code: &str) -> Option<Vec<T>> {
    Orientation::from_code(code.trim()).map(|orientation| orientation.arrange(pixels, size))
}

/// Returns the pixels of an MF image (u fastest, of this size) in the order in which a source
/// of this orientation stores them, first axis fastest. For an unknown code the order stays.
pub fn stored<T: Copy>(mf: &[T], [width, height]: [u32; 2], code: &str) -> Vec<T> {
    let place = Orientation::from_code(code).unwrap_or(Orientation::MF);
    let [width, height] = [width, height].map(|n| n as usize);
    let (first, second) = if place.transposed { (height, width) } else { (width, height) };
    let at = |along_first: usize, along_second: usize| {
        let (lateral, depth) = if place.transposed { (along_second, along_first) } else { (along_first, along_second) };
        let u = if place.flip_u { width - 1 - lateral } else { lateral };
        let v = if place.flip_v { height - 1 - depth } else { depth };
        mf[v * width + u]
    };
    let places = (0..second).flat_map(|row| (0..first).map(move |column| (column, row)));
    places.map(|(column, row)| at(column, row)).collect()
}

/// Returns the time of a stamp, ns; `None` without one, or if it does not fit.
pub(crate) fn stamp_ns(stamp: &Stamp) -> Option<i64> {
    stamp.host_ns.or_else(|| nanoseconds(stamp.source_s?))
}

/// Returns the nearest whole nanosecond; `None` when it does not fit.
fn nanoseconds(seconds: f64) -> Option<i64> {
    // Converts whole seconds and the fraction separately: one product with 1e9 would round to
    // 256 ns at present-day times.
    let whole = seconds.trunc();
    if !(seconds.is_finite() && whole.abs() < 9.2e9) {
        return None;
    }
    let (whole, rest) = (whole as i64, ((seconds - whole) * 1e9).round() as i64);
    whole.checked_mul(1_000_000_000)?.checked_add(rest)
}

fn scalars<T, const N: usize>(bytes: &[u8], read: fn([u8; N]) -> T) -> Vec<T> {
    bytes
        .chunks_exact(N)
        .map(|chunk| {
            let mut word = [0; N];
            word.copy_from_slice(chunk);
            read(word)
        })
        .collect()
}

/// Converts scalars of any type to f32.
fn floats(bytes: &[u8], kind: PixelType) -> Vec<f32> {
    match kind {
        PixelType::U8 => scalars(bytes, |b| f32::from(u8::from_ne_bytes(b))),
        PixelType::I8 => scalars(bytes, |b| f32::from(i8::from_ne_bytes(b))),
        PixelType::U16 => scalars(bytes, |b| f32::from(u16::from_ne_bytes(b))),
        PixelType::I16 => scalars(bytes, |b| f32::from(i16::from_ne_bytes(b))),
        PixelType::U32 => scalars(bytes, |b| u32::from_ne_bytes(b) as f32),
        PixelType::I32 => scalars(bytes, |b| i32::from_ne_bytes(b) as f32),
        PixelType::U64 => scalars(bytes, |b| u64::from_ne_bytes(b) as f32),
        PixelType::I64 => scalars(bytes, |b| i64::from_ne_bytes(b) as f32),
        PixelType::F32 => scalars(bytes, f32::from_ne_bytes),
        PixelType::F64 => scalars(bytes, |b| f64::from_ne_bytes(b) as f32),
    }
}

#[cfg(test)]
mod tests;
