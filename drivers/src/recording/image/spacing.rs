//! How far a sequence's pixels are apart, as its file says. Nothing goes by it, since a calibration has its own scale: it goes through, from file to file.

use super::numbers::number;
use super::write::text::list;

/// Field of a sequence: how far its pixels are apart along the first and the second axis, mm, and, where that is not 1, what the file says of the frames. Not there
/// where a file says nothing, or 1 of everything, as those write it who do not know.
pub const ELEMENT_SPACING: &str = "ElementSpacing";

/// Names and texts.
type Fields = Vec<(String, String)>;

/// Three spacings of 1, of which the field says nothing.
const PLAIN: [f64; 3] = [1.0; 3];

/// The field's text; `None` of plain spacings, and of numbers that are no lengths.
pub(crate) fn text(spacing: [f64; 3]) -> Option<String> {
    let said = spacing != PLAIN && spacing.iter().all(|mm| are_apart(*mm));
    said.then(|| list(if spacing[2] == 1.0 { &spacing[..2] } else { &spacing }))
}

/// The spacings that fields tell, and the other fields.
///
/// # Errors
/// A sentence: the field holds no spacings.
pub(crate) fn split(fields: &[(String, String)]) -> Result<([f64; 3], Fields), String> {
    let (own, others): (Fields, Fields) = fields.iter().cloned().partition(|(name, _)| name == ELEMENT_SPACING);
    let spacing = match own.as_slice() {
        [] => PLAIN,
        [(_, value)] => {
            let numbers = value.split_whitespace().map(|token| number(token).filter(|mm| are_apart(*mm)));
            match numbers.collect::<Option<Vec<f64>>>().as_deref() {
                Some(&[x, y]) => [x, y, 1.0],
                Some(&[x, y, z]) => [x, y, z],
                _ => return Err(format!("field {ELEMENT_SPACING} is {value:?}; it must be two or three lengths")),
            }
        }
        _ => return Err(format!("field {ELEMENT_SPACING} is given twice")),
    };
    Ok((spacing, others))
}

fn are_apart(mm: f64) -> bool {
    mm > 0.0 && mm.is_finite()
}
