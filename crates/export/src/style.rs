//! Colours and sizes that all pictures of planes share.

use image::Rgb;

/// Colour of unseen voxels: a muted blue, distinct from all grey levels.
pub const UNSEEN: Rgb<u8> = Rgb([46, 64, 96]);

/// Colour of the background.
pub(super) const PAPER: Rgb<u8> = Rgb([20, 20, 22]);
/// Colour of lettering and lines.
pub(super) const INK: Rgb<u8> = Rgb([214, 214, 214]);
/// Colour of lines around planes and colours.
pub(super) const BORDER: Rgb<u8> = Rgb([120, 120, 124]);

/// Pixels per dot of the lettering.
pub(super) const DOT: u32 = 2;
/// Gap around everything and between planes, pixels.
pub(super) const GAP: u32 = 16;
