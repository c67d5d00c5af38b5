//! Pixel spacing of a sequence, as its file states it. It is only copied from file to file;
//! computations use the calibration's own scale.

use crate::Unwritable;
use crate::image::numbers::list;
use crate::image::numbers::number;

/// Sequence field: pixel spacing along the first and second axis, mm, and the value for the
/// frame axis if it is not 1. Absent if a file states nothing, or 1 throughout, the usual value
/// of writers that do not know the spacing.
pub const ELEMENT_SPACING: &str = "ElementSpacing";

/// Field names and texts.
type Fields = Vec<(String, String)>;

/// Spacings of 1, for which the field is omitted.
const PLAIN: [f64; 3] = [1.0; 3];

/// Returns the field's text; `None` for spacings of 1, and for values that are no lengths.
pub(crate) fn text(spacing: [f64; 3]) -> Option<String> {
    let is_stated = spacing != PLAIN && spacing.iter().all(|mm| are_apart(*mm));
    is_stated.then(|| list(if spacing[2] == 1.0 { &spacing[..2] } else { &spacing }))
}

/// Separates the spacing field from the other fields.
///
/// # Errors
/// [`Unwritable::Spacing`] and [`Unwritable::FieldTwice`].
pub(crate) fn split(fields: &[(String, String)]) -> Result<([f64; 3], Fields), Unwritable> {
    let (own, others): (Fields, Fields) = fields.iter().cloned().partition(|(name, _)| name == ELEMENT_SPACING);
    let spacing = match own.as_slice() {
        [] => PLAIN,
        [(_, value)] => {
            let numbers = value.split_whitespace().map(|token| number(token).filter(|mm| are_apart(*mm)));
            match numbers.collect::<Option<Vec<f64>>>().as_deref() {
                Some(&[x, y]) => [x, y, 1.0],
                Some(&[x, y, z]) => [x, y, z],
                _ => return Err(Unwritable::Spacing(value.clone())),
            }
        }
        _ => return Err(Unwritable::FieldTwice(ELEMENT_SPACING.into())),
    };
    Ok((spacing, others))
}

fn are_apart(mm: f64) -> bool {
    mm > 0.0 && mm.is_finite()
}
