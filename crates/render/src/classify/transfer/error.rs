//! Reasons why a transfer function is invalid.

use super::curve::CurveError;
use super::preset_names;

/// Reason why a transfer function is invalid. The message gives the valid values; the caller
/// adds the name.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TransferError {
    /// The unit length.
    #[error("the length that opacities are meant for must be a positive number of mm, not {0}")]
    Unit(f64),
    /// The isovalue.
    #[error("the isovalue must be a finite number of grey levels, not {0}")]
    Isovalue(f64),
    /// The isosurface's thickness.
    #[error("the surface's thickness must be a positive number of mm, not {0}")]
    Thickness(f64),
    /// The isosurface's opacity.
    #[error("the surface's opacity must lie between 0 and 1, not {0}")]
    Opacity(f64),
    /// A region curve of one point.
    #[error("borders between regions must have at least two points, one for each region")]
    Region,
    /// A gradient curve that begins below 0.
    #[error("a gradient's magnitude is never below 0: begin at 0 or above, not at {0}")]
    Gradient(f64),
    /// The colours' window.
    #[error("the window must rise from a finite grey level to a larger one, not from {} to {}", .0[0], .0[1])]
    Window([f64; 2]),
    /// The volume's range.
    #[error("the range of intensities must rise from a finite grey level to a larger one, not from {} to {}", .0[0], .0[1])]
    Range([f64; 2]),
    /// A curve's points.
    #[error("a point {0}")]
    Curve(#[from] CurveError),
    /// No preset of this name.
    #[error("no transfer function is called \"{0}\"; give one of {names}", names = preset_names::names())]
    Name(String),
}
