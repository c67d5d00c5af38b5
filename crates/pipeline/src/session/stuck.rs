//! Frames that repeat while the probe moves: the grabber repeats them, or the scanner is stuck.

use mask::MaskSettings;
use sonoweave_core::region::ClipRect;
use sonoweave_core::slice::Image;
use sync::pairing::timed::Placed;

/// Detects repeated frames. Only the data rectangle is compared, since a clock beside a stuck
/// image continues to change.
pub(super) struct StuckDetector {
    mask: MaskSettings,
    /// The data's rectangle, for frames of one size.
    data: Option<([u32; 2], ClipRect)>,
    last: Option<(Image, [f64; 16])>,
    since_ns: Option<i64>,
}

impl StuckDetector {
    /// Detects repetition in frames with this mask.
    pub(super) fn new(mask: MaskSettings) -> Self {
        Self { mask, data: None, last: None, since_ns: None }
    }

    fn data(&mut self, image: &Image) -> ClipRect {
        let size = [image.width(), image.height()];
        match self.data {
            Some((of, data)) if of == size => data,
            _ => {
                let data = self.mask.bounds(size);
                self.data = Some((size, data));
                data
            }
        }
    }

    /// Returns whether this frame repeats the last one at another pose. If the pose is the same
    /// too, the inserter refuses the slice.
    pub(super) fn is(&mut self, image: &Image, placed: &Placed, captured_ns: i64) -> bool {
        let (pose, data) = (placed.world_from_image.to_rows(), self.data(image));
        let same = self.last.as_ref().is_some_and(|(last, _)| last.same_within(image, data));
        let moved = self.last.as_ref().is_some_and(|(_, last)| *last != pose);
        if !same {
            self.since_ns = None;
            self.last = Some((image.clone(), pose));
        } else if moved {
            self.since_ns.get_or_insert(captured_ns);
        }
        same && moved
    }

    /// Returns for how long the scanner has repeated one frame, ns, if it does.
    pub(super) fn since_ns(&self, now_ns: i64) -> Option<i64> {
        self.since_ns.map(|since| now_ns - since)
    }
}
