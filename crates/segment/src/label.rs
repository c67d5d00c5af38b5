//! Values of label volumes, 8 bits a voxel.

/// A voxel outside of the region.
pub const OUTSIDE: u8 = 0;
/// A voxel of the region.
pub const REGION: u8 = 1;
/// A voxel that no slice reached: it is neither.
pub const UNSEEN: u8 = 255;
