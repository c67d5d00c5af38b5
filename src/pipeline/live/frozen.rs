//! Pictures that come again while the probe moves: the grabber repeats them, or the scanner is frozen.

use calibration::region::ClipRect;

use crate::mask::MaskSettings;
use crate::slice::Image;
use crate::sync::bracket::Placed;

/// Watches for them. Only what is data is compared: a clock beside a frozen picture goes on.
pub(super) struct Frozen {
    mask: MaskSettings,
    /// The data's rectangle, of pictures of a size.
    data: Option<([u32; 2], ClipRect)>,
    last: Option<(Image, [f64; 16])>,
    since_ns: Option<i64>,
}

impl Frozen {
    /// Of pictures whose data is this.
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

    /// Whether this picture is the last one's at another pose. What is the same in both, the loom refuses.
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

    /// For how long the scanner has shown one picture, ns, if it does.
    pub(super) fn since_ns(&self, now_ns: i64) -> Option<i64> {
        self.since_ns.map(|since| now_ns - since)
    }
}
