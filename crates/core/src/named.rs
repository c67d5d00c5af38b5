//! Transforms whose frames are known by name only, as files hold them.

use glam::{DAffine3, DMat4};
use serde::Serialize;

use crate::frames::{BadMatrix, Image, Probe, Transform, affine_from_rows};

/// A constant transform between two named frames; mm, or pixels on an image's side. Serialised
/// as `from`, `to` and the 16 numbers of `matrix`, row major.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(into = "Written")]
pub struct StaticTransform {
    /// Name of the source frame.
    pub from: String,
    /// Name of the target frame.
    pub to: String,
    /// Maps points of `from` to points of `to`; finite and invertible.
    pub affine: DAffine3,
}

impl StaticTransform {
    /// Checks names and numbers (16, row major, column vectors) and builds the transform.
    ///
    /// # Errors [`BadStatic`] when a name is empty, both are the same, or the matrix is not
    /// affine, finite and invertible.
    pub fn new(from: &str, to: &str, rows: &[f64; 16]) -> Result<Self, BadStatic> {
        if from.is_empty() || to.is_empty() {
            return Err(BadStatic::Nameless);
        }
        if from == to {
            return Err(BadStatic::Loop(from.to_owned()));
        }
        Ok(Self { from: from.to_owned(), to: to.to_owned(), affine: affine_from_rows(rows)? })
    }

    /// Returns the probe's calibration under its usual name, `Image` to `Probe`.
    pub fn image_to_probe(probe_from_image: &Transform<Probe, Image>) -> Self {
        Self { from: "Image".into(), to: "Probe".into(), affine: probe_from_image.affine() }
    }

    /// Returns its name in files, such as `ImageToProbe`.
    pub fn name(&self) -> String {
        format!("{}To{}", self.from, self.to)
    }

    /// Returns the 16 numbers, row major.
    pub fn rows(&self) -> [f64; 16] {
        DMat4::from(self.affine).transpose().to_cols_array()
    }

    /// Returns whether both relate the same two frames, in either direction.
    pub fn relates_same_frames(&self, other: &Self) -> bool {
        (self.from == other.from && self.to == other.to) || (self.from == other.to && self.to == other.from)
    }
}

/// The serialised form.
#[derive(Serialize)]
struct Written {
    from: String,
    to: String,
    matrix: [f64; 16],
}

impl From<StaticTransform> for Written {
    fn from(transform: StaticTransform) -> Self {
        Self { matrix: transform.rows(), from: transform.from, to: transform.to }
    }
}

/// Reasons why names and numbers do not make a static transform.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum BadStatic {
    /// A frame has no name.
    #[error("a frame's name is empty; give one")]
    Nameless,
    /// The transform goes from a frame to itself.
    #[error("the transform goes from {0} to itself; correct one of its frames")]
    Loop(String),
    /// The numbers are invalid.
    #[error(transparent)]
    Matrix(#[from] BadMatrix),
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_numbers_are_checked() {
        let identity = Transform::<Probe, Image>::IDENTITY.to_rows();
        let good = StaticTransform::new("Phantom", "Reference", &identity).unwrap();
        assert_eq!(good.name(), "PhantomToReference");
        assert_eq!(good.rows(), identity);
        assert_eq!(StaticTransform::new("A", "A", &identity), Err(BadStatic::Loop("A".into())));
        assert_eq!(StaticTransform::new("", "A", &identity), Err(BadStatic::Nameless));
        assert!(matches!(StaticTransform::new("A", "B", &[0.0; 16]), Err(BadStatic::Matrix(_))));
        let back = StaticTransform::new("Reference", "Phantom", &identity).unwrap();
        let other = StaticTransform::new("Reference", "Tracker", &identity).unwrap();
        assert!(good.relates_same_frames(&back) && !good.relates_same_frames(&other));
    }
}
