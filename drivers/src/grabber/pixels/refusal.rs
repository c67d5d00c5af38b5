//! Why a buffer of video gives no frame.

use super::format::PixelFormat;

/// Why a buffer gives no frame.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Refusal {
    /// The layout is impossible.
    #[error("{width}×{height} pixels in {format} with {row_bytes} bytes a line cannot be converted: {problem}")]
    Layout {
        /// Width in pixels.
        width: u32,
        /// Height in pixels.
        height: u32,
        /// Pixel format.
        format: PixelFormat,
        /// Bytes from row to row.
        row_bytes: u32,
        /// The problem.
        problem: &'static str,
    },
    /// The buffer is shorter than its layout requires.
    #[error("the frame has {given} of {needed} bytes; check the cable")]
    Short {
        /// Present bytes.
        given: usize,
        /// Required bytes.
        needed: usize,
    },
    /// The JPEG image is damaged or not as agreed.
    #[error("the frame is not a complete JPEG image: {0}")]
    Jpeg(String),
}
