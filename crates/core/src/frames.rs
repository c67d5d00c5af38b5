//! Coordinate frames and the transforms between them, in f64.
//!
//! A [`Transform<To, From>`] maps points of `From` to points of `To`. Variables read
//! `tracker_from_probe`, so that in a product the adjacent names are equal: `world_from_probe *
//! probe_from_image`. A product of mismatched frames does not compile:
//!
//! ```compile_fail,E0308
//! use sonoweave_core::frames::{Image, Probe, Tracker, Transform};
//! let tracker_from_probe = Transform::<Tracker, Probe>::IDENTITY;
//! let probe_from_image = Transform::<Probe, Image>::IDENTITY;
//! let wrong = probe_from_image * tracker_from_probe;
//! ```

use std::fmt;
use std::marker::PhantomData;
use std::ops::Mul;

use glam::{DAffine3, DMat3, DMat4, DVec3};
use serde::{Deserialize, Serialize};

/// A coordinate frame, used as a type only.
pub trait Frame {
    /// The frame's usual name in files.
    const NAME: &'static str;
}

macro_rules! frames {
    ($($(#[$doc:meta])* $name:ident)*) => {$(
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        pub struct $name;
        impl Frame for $name {
            const NAME: &'static str = stringify!($name);
        }
    )*};
}

frames! {
    /// Pixels of the image in MF orientation: u right, v down, the origin at the **centre** of
    /// the first pixel, z = 0 in the plane.
    Image
    /// The sensor on the transducer, or the arm's last link; mm.
    Probe
    /// The transmitter, or the arm's base; mm.
    Tracker
    /// The second sensor, on the patient; mm.
    Reference
    /// The calibration phantom, as its file describes it; mm.
    Phantom
    /// The volume's reference frame: Reference if there is one, else Tracker; mm.
    World
    /// The sensor on a stylus; mm.
    Stylus
    /// A stylus's tip, z along its shaft away from the sensor; mm.
    StylusTip
    /// Voxel indices of a volume; a voxel's position is its centre.
    Volume
}

/// An affine map from points of `From` to points of `To`. In files it is 12 numbers: the matrix
/// column by column, then the translation.
#[derive(Serialize, Deserialize)]
#[serde(transparent, bound = "")]
pub struct Transform<To, From> {
    affine: DAffine3,
    #[serde(skip)]
    frames: PhantomData<fn(From) -> To>,
}

impl<To, From> Transform<To, From> {
    /// The identity: changes the frame's name only.
    pub const IDENTITY: Self = Self::from_affine(DAffine3::IDENTITY);

    /// Assigns frames to an affine map; the caller vouches for them.
    pub const fn from_affine(affine: DAffine3) -> Self {
        Self { affine, frames: PhantomData }
    }

    /// Builds the map from 16 numbers, row major, column vectors (the order of MetaImage
    /// sequences and PLUS files).
    ///
    /// # Errors
    /// The same as for [`affine_from_rows`].
    pub fn from_rows(rows: &[f64; 16]) -> Result<Self, BadMatrix> {
        affine_from_rows(rows).map(Self::from_affine)
    }

    /// Returns the 16 numbers, row major, as files hold them.
    pub fn to_rows(&self) -> [f64; 16] {
        DMat4::from(self.affine).transpose().to_cols_array()
    }

    /// Returns the untyped affine map.
    pub fn affine(&self) -> DAffine3 {
        self.affine
    }

    /// Maps a point.
    pub fn point(&self, p: DVec3) -> DVec3 {
        self.affine.transform_point3(p)
    }

    /// Maps a direction (no translation).
    pub fn vector(&self, v: DVec3) -> DVec3 {
        self.affine.transform_vector3(v)
    }

    /// Returns the inverse map.
    pub fn inverse(&self) -> Transform<From, To> {
        Transform::from_affine(self.affine.inverse())
    }

    /// Returns the nearest rigid transform and the deviation from it: see [`nearest_rigid`].
    ///
    /// # Errors
    /// [`NotRigid`] when the deviation is larger than `tolerance`, or the transform mirrors.
    pub fn nearest_rigid(&self, tolerance: f64) -> Result<(Self, f64), NotRigid> {
        nearest_rigid(&self.affine, tolerance).map(|(affine, deviation)| (Self::from_affine(affine), deviation))
    }
}

/// Returns the affine map of 16 numbers, row major, column vectors, for transforms between
/// frames that are known by name only.
///
/// # Errors [`BadMatrix`] when a number is not finite, the last row is not 0 0 0 1 (±1e-6), or
/// the matrix cannot be inverted.
pub fn affine_from_rows(rows: &[f64; 16]) -> Result<DAffine3, BadMatrix> {
    if let Some(index) = rows.iter().position(|x| !x.is_finite()) {
        return Err(BadMatrix::NotFinite { index });
    }
    let last = [rows[12], rows[13], rows[14], rows[15] - 1.0];
    if last.iter().any(|x| x.abs() > 1e-6) {
        return Err(BadMatrix::LastRow { row: [rows[12], rows[13], rows[14], rows[15]] });
    }
    let affine = DAffine3::from_mat4(DMat4::from_cols_array(rows).transpose());
    let scale = [affine.matrix3.x_axis, affine.matrix3.y_axis, affine.matrix3.z_axis]
        .iter()
        .map(|axis| axis.length())
        .product::<f64>();
    let determinant = affine.matrix3.determinant();
    // The determinant is relative to the axes' lengths, so that µm and km scales are judged
    // alike. The inverse is checked as well: lengths near the ends of f64's range overflow on
    // the way.
    if !(scale > 0.0 && determinant.abs() > 1e-9 * scale && affine.inverse().is_finite()) {
        return Err(BadMatrix::Singular { determinant });
    }
    Ok(affine)
}

/// Returns the nearest rigid map and the deviation of `affine` from it: max |RᵀR − I| of the
/// elements.
///
/// Printed digits and drifting trackers make rotations slightly inexact. Up to `tolerance`, the
/// rotation is replaced by the nearest one in the Frobenius norm, and the translation is kept.
/// The nearest rotation is the polar factor by Newton's iteration (Higham, SIAM J. Sci. Stat.
/// Comput. 7, 1986).
///
/// # Errors
/// [`NotRigid`] when the deviation is larger, or the map mirrors.
pub fn nearest_rigid(affine: &DAffine3, tolerance: f64) -> Result<(DAffine3, f64), NotRigid> {
    let m = affine.matrix3;
    let deviation = orthogonality_error(&m);
    let determinant = m.determinant();
    if determinant.is_nan() || determinant <= 0.0 {
        return Err(NotRigid::Mirrored { determinant });
    }
    if deviation.is_nan() || deviation > tolerance {
        return Err(NotRigid::Distorted { deviation, tolerance });
    }
    let mut rotation = m;
    // Converges quadratically from below 1e-2: three steps reach rounding, the others are a
    // reserve.
    for _ in 0..8 {
        let next = (rotation + rotation.inverse().transpose()) * 0.5;
        let step = (next - rotation).to_cols_array().iter().fold(0.0_f64, |a, x| a.max(x.abs()));
        rotation = next;
        if step < 1e-15 {
            break;
        }
    }
    Ok((DAffine3 { matrix3: rotation, translation: affine.translation }, deviation))
}

/// Returns max |MᵀM − I| over the elements: 0 for a rotation or a mirror.
fn orthogonality_error(m: &DMat3) -> f64 {
    let gram = m.transpose() * *m - DMat3::IDENTITY;
    // `f64::max` drops NaN, so NaN is checked first.
    let elements = gram.to_cols_array();
    if elements.iter().any(|x| x.is_nan()) { f64::NAN } else { elements.iter().fold(0.0, |a, x| a.max(x.abs())) }
}

/// Reasons why 16 numbers are no transform.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum BadMatrix {
    /// A number is NaN or infinite.
    #[error("element {index} (row {row}, column {column}) must be a finite number", row = index / 4, column = index % 4)]
    NotFinite {
        /// Position among the 16.
        index: usize,
    },
    /// The matrix is projective or transposed.
    #[error("the last row must be 0 0 0 1, not {}: check whether the matrix is transposed", row.map(|x| x.to_string()).join(" "))]
    LastRow {
        /// The given row.
        row: [f64; 4],
    },
    /// The matrix maps space to a plane or less.
    #[error("the matrix cannot be inverted (determinant {determinant:e}); check its numbers")]
    Singular {
        /// Determinant of the 3×3 part.
        determinant: f64,
    },
}

/// Reasons why a pose is not rigid.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum NotRigid {
    /// The pose is left-handed.
    #[error("the pose mirrors (determinant {determinant:.6}); check the signs of its axes")]
    Mirrored {
        /// Determinant of the rotation part.
        determinant: f64,
    },
    /// The scale or skew exceeds rounding of printed digits.
    #[error("the pose is no rotation: |RᵀR − I| = {deviation:.2e} > {tolerance:.0e}; check its numbers")]
    Distorted {
        /// max |RᵀR − I|.
        deviation: f64,
        /// The accepted limit.
        tolerance: f64,
    },
}

impl<A, B, C> Mul<Transform<B, C>> for Transform<A, B> {
    type Output = Transform<A, C>;

    fn mul(self, rhs: Transform<B, C>) -> Transform<A, C> {
        Transform::from_affine(self.affine * rhs.affine)
    }
}

// Implemented by hand, because derives would require the same traits of the frame types.
impl<To, From> Clone for Transform<To, From> {
    fn clone(&self) -> Self {
        *self
    }
}
impl<To, From> Copy for Transform<To, From> {}
impl<To, From> PartialEq for Transform<To, From> {
    fn eq(&self, other: &Self) -> bool {
        self.affine == other.affine
    }
}
impl<To: Frame, From: Frame> fmt::Debug for Transform<To, From> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}From{}{:?}", To::NAME, From::NAME, self.to_rows())
    }
}

#[cfg(test)]
mod tests {
    use static_assertions::{assert_impl_all, assert_not_impl_any};

    use super::*;

    // Products whose inner frames differ do not compile.
    assert_impl_all!(Transform<Tracker, Probe>: Mul<Transform<Probe, Image>, Output = Transform<Tracker, Image>>);
    assert_not_impl_any!(Transform<Probe, Image>: Mul<Transform<Tracker, Probe>>);
    assert_not_impl_any!(Transform<Probe, Tracker>: Mul<Transform<Probe, Image>>);

    fn turned() -> DAffine3 {
        DAffine3::from_rotation_translation(
            glam::DQuat::from_euler(glam::EulerRot::ZYX, 0.3, -0.7, 1.1),
            DVec3::new(10.0, -20.0, 30.0),
        )
    }

    #[test]
    fn product_maps_like_its_factors_in_turn() {
        let tracker_from_probe = Transform::<Tracker, Probe>::from_affine(turned());
        let probe_from_image = Transform::<Probe, Image>::from_affine(DAffine3::from_scale(DVec3::new(0.1, 0.2, 1.0)));
        let p = DVec3::new(3.0, 4.0, 0.0);
        let whole = (tracker_from_probe * probe_from_image).point(p);
        let stepwise = tracker_from_probe.point(probe_from_image.point(p));
        assert!((whole - stepwise).length() < 1e-12);
    }

    #[test]
    fn rows_round_trip_with_translation_last() {
        let rows = Transform::<World, Probe>::from_affine(turned()).to_rows();
        assert_eq!([rows[3], rows[7], rows[11], rows[15]], [10.0, -20.0, 30.0, 1.0]);
        let back = Transform::<World, Probe>::from_rows(&rows).expect("a rigid matrix");
        assert_eq!(back.to_rows(), rows);
    }

    #[test]
    fn nan_is_refused_by_position() {
        let mut rows = Transform::<World, Probe>::IDENTITY.to_rows();
        rows[6] = f64::NAN;
        let error = Transform::<World, Probe>::from_rows(&rows).expect_err("NaN");
        assert_eq!(error, BadMatrix::NotFinite { index: 6 });
        assert!(error.to_string().contains("row 1, column 2"));
    }

    #[test]
    fn transposed_or_singular_matrix_is_refused() {
        let mut rows = Transform::<World, Probe>::from_affine(turned()).to_rows();
        rows[12] = 5.0;
        assert!(matches!(Transform::<World, Probe>::from_rows(&rows), Err(BadMatrix::LastRow { .. })));
        let mut flat = Transform::<World, Probe>::IDENTITY.to_rows();
        flat[10] = 0.0;
        assert!(matches!(Transform::<World, Probe>::from_rows(&flat), Err(BadMatrix::Singular { .. })));
    }

    #[test]
    fn rounded_digits_are_repaired_and_distortion_is_refused() {
        let mut rows = Transform::<Tracker, Probe>::from_affine(turned()).to_rows();
        for x in &mut rows {
            *x = (*x * 1e3).round() / 1e3;
        }
        let rounded = Transform::<Tracker, Probe>::from_rows(&rows).expect("finite");
        let (rigid, deviation) = rounded.nearest_rigid(1e-2).expect("close to a rotation");
        assert!(deviation > 1e-5 && deviation < 2e-3, "{deviation}");
        assert!(orthogonality_error(&rigid.affine().matrix3) < 1e-14);
        // The result must be at least as near to the input as the true rotation.
        let truth = turned().matrix3;
        let distance = |a: DMat3| (a - rounded.affine().matrix3).to_cols_array().iter().map(|x| x * x).sum::<f64>();
        assert!(distance(rigid.affine().matrix3) <= distance(truth) + 1e-15);

        let scaled = Transform::<Tracker, Probe>::from_affine(DAffine3::from_scale(DVec3::splat(1.01)));
        assert!(matches!(scaled.nearest_rigid(1e-2), Err(NotRigid::Distorted { .. })));
        let mirrored = Transform::<Tracker, Probe>::from_affine(DAffine3::from_scale(DVec3::new(1.0, 1.0, -1.0)));
        assert!(matches!(mirrored.nearest_rigid(1e-2), Err(NotRigid::Mirrored { .. })));
    }
}
