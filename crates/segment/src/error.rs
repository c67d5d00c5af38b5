//! Errors of regions and contours.

/// Reasons why there is no region, and no body between contours.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SegmentError {
    /// A seed beside all data.
    #[error("the seed {}, {}, {} mm lies outside of the volume, or at a voxel that no slice reached: choose a place that was scanned", at[0], at[1], at[2])]
    SeedUnseen {
        /// The seed, world mm.
        at: [f64; 3],
    },
    /// A seed whose value is not in the range.
    #[error(
        "the smoothed value {value} at the seed lies outside of the range {low} to {high}: move the seed, or widen the range"
    )]
    SeedRange {
        /// Smoothed value at the seed.
        value: f32,
        /// Lowest value of the region.
        low: f32,
        /// Highest value of the region.
        high: f32,
    },
    /// An impossible number.
    #[error("{setting} must be {needs}, not {value}")]
    Setting {
        /// Name of the setting.
        setting: &'static str,
        /// Its value.
        value: f64,
        /// The valid values.
        needs: &'static str,
    },
    /// Too few voxels for their mean and standard deviation.
    #[error(
        "the ball of {radius_mm} mm around the seed holds {voxels} seen voxels, of at least {least}: widen it, or give the range"
    )]
    FewVoxels {
        /// Radius of the ball, mm.
        radius_mm: f64,
        /// Seen voxels in it.
        voxels: usize,
        /// The least number.
        least: usize,
    },
    /// A length over too many voxels.
    #[error("{setting} of {mm} mm spans {voxels} voxels, of at most {most}: lower it, or take larger voxels")]
    Wide {
        /// Name of the setting.
        setting: &'static str,
        /// Its value, mm.
        mm: f64,
        /// Voxels on each side.
        voxels: u64,
        /// The limit.
        most: u64,
    },
    /// A region that outgrew its limit.
    #[error("the region grew beyond the limit of {limit_ml} ml: narrow the range, move the seed, or raise the limit")]
    Limit {
        /// The limit, ml.
        limit_ml: f64,
    },
    /// An opening that removes the seed.
    #[error(
        "the opening by {radius_mm} mm leaves nothing at the seed: lower it, or move the seed away from the border"
    )]
    Opened {
        /// Radius of the ball, mm.
        radius_mm: f64,
    },
    /// Axes that are not at right angles.
    #[error(
        "two axes of the volume are at a cosine of {cosine}, and must be at right angles: convert it to such a lattice"
    )]
    Sheared {
        /// Cosine of the angle between two axes.
        cosine: f64,
    },
    /// More memory than allowed.
    #[error("this takes {} MiB of memory, of which {} may be taken: take larger voxels, or raise the limit", mib(*needed_bytes), mib(*limit_bytes))]
    Memory {
        /// Memory needed, bytes.
        needed_bytes: u64,
        /// Memory allowed, bytes.
        limit_bytes: u64,
    },
    /// Too few contours for a body.
    #[error("the number of contours must be 2 or more, not {count}")]
    FewContours {
        /// Number of contours.
        count: usize,
    },
    /// A contour with too few points, or too many.
    #[error("the number of points of contour {number} must be 3 to {most}, not {count}")]
    Points {
        /// Number of the contour, from 1.
        number: usize,
        /// Number of points.
        count: usize,
        /// Most points.
        most: usize,
    },
    /// Axes of a plane that span none, or are not at right angles.
    #[error("across and along of contour {number} must be directions at right angles to each other")]
    Axes {
        /// Number of the contour, from 1.
        number: usize,
    },
    /// Two successive points at one place.
    #[error("point {point} of contour {number} lies at the place of the point before it: delete it")]
    Repeated {
        /// Number of the contour, from 1.
        number: usize,
        /// Number of the point, from 1.
        point: usize,
    },
    /// A contour that crosses or touches itself.
    #[error("contour {number} crosses itself: move its points, or list them in their order around it")]
    Crossed {
        /// Number of the contour, from 1.
        number: usize,
    },
    /// Contours out of order.
    #[error(
        "contour {number} does not lie after contour {before} along the sweep: list the contours in their order, one a plane"
    )]
    Order {
        /// Number of the contour, from 1.
        number: usize,
        /// Number of one that must lie before it.
        before: usize,
    },
    /// Planes that cross within their contours.
    #[error(
        "the planes of contours {before} and {number} cross inside of a contour: delete one of them, or draw it on another plane"
    )]
    Planes {
        /// Number of the contour, from 1.
        number: usize,
        /// Number of the other, which lies before it.
        before: usize,
    },
}

impl SegmentError {
    /// Returns the number of the contour at fault, from 1; `None` if it is no single one.
    pub(crate) fn contour(&self) -> Option<usize> {
        match self {
            Self::Points { number, .. }
            | Self::Axes { number }
            | Self::Repeated { number, .. }
            | Self::Crossed { number }
            | Self::Order { number, .. }
            | Self::Planes { number, .. } => Some(*number),
            _ => None,
        }
    }
}

fn mib(bytes: u64) -> u64 {
    bytes.div_ceil(1 << 20)
}
