//! Settings of a filling, its statistics, and the mark of filled voxels.

/// Weight of a filled voxel, and of no other.
pub const FILLED: f32 = -1.0;

/// Method for the value of a filled voxel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FillMethod {
    /// The nearest seen voxel.
    Nearest,
    /// The seen voxels around, nearer ones with more weight.
    Gaussian,
}

impl FillMethod {
    /// Returns the name on the command line and in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Nearest => "nearest",
            Self::Gaussian => "gaussian",
        }
    }
}

/// Settings for filling holes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Filling {
    /// The method.
    pub method: FillMethod,
    /// Radius of the seen voxels used, mm.
    pub radius_mm: f64,
}

impl std::fmt::Display for Filling {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} within {} mm", self.method.name(), self.radius_mm)
    }
}

/// Statistics of a filling.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct FillWork {
    /// Bricks of 8³ voxels common to the box and the tiles in reach.
    pub bricks_considered: u64,
    /// Considered bricks with a hole in the box, and a seen voxel within the radius along each
    /// axis of their part in the box. Only these are processed.
    pub bricks_touched: u64,
    /// Unseen voxels of touched bricks, in the box.
    pub holes: u64,
    /// Holes that were filled.
    pub filled: u64,
}

impl std::ops::AddAssign for FillWork {
    fn add_assign(&mut self, other: Self) {
        self.bricks_considered += other.bricks_considered;
        self.bricks_touched += other.bricks_touched;
        self.holes += other.holes;
        self.filled += other.filled;
    }
}
