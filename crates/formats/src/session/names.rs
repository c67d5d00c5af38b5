//! Names in messages: pairs of texts, and the names of pixel types.

use sonoweave_core::reading::PixelType;

use crate::session::proto::{Fields, Malformed, Reader, Value};

/// Writes pairs of a name and its text.
pub(super) fn texts(out: &mut Fields<'_>, number: u32, texts: &[(String, String)]) {
    for (name, text) in texts {
        out.message(number, |out| {
            out.text(1, name);
            out.text(2, text);
        });
    }
}

/// Reads one such pair.
pub(super) fn named_text(value: Value<'_>) -> Result<(String, String), Malformed> {
    let mut named = (String::new(), String::new());
    for field in Reader(value.bytes()?) {
        match field? {
            (1, value) => named.0 = value.text()?.to_owned(),
            (2, value) => named.1 = value.text()?.to_owned(),
            _ => {}
        }
    }
    Ok(named)
}

/// Names of pixel types in messages.
const PIXELS: [(PixelType, &str); 10] = [
    (PixelType::U8, "u8"),
    (PixelType::I8, "i8"),
    (PixelType::U16, "u16"),
    (PixelType::I16, "i16"),
    (PixelType::U32, "u32"),
    (PixelType::I32, "i32"),
    (PixelType::U64, "u64"),
    (PixelType::I64, "i64"),
    (PixelType::F32, "f32"),
    (PixelType::F64, "f64"),
];

/// Returns the name of a pixel type.
pub(super) fn name_of(pixel: PixelType) -> &'static str {
    PIXELS.iter().find(|(one, _)| *one == pixel).map_or("", |(_, name)| name)
}

/// Returns the pixel type of that name.
pub(super) fn pixel_of(name: &str) -> Option<PixelType> {
    PIXELS.iter().find(|(_, one)| *one == name).map(|(pixel, _)| *pixel)
}
