//! Checks that both paths apply to a slice before locating it: the frame's size, a pose that
//! spans a plane, and a difference from the last slice.

use mask::Mask;
use sonoweave_core::frames::{Image as ImageFrame, Transform, World};
use sonoweave_core::slice::{Image, Slice};

use super::refusal::Refused;
use super::slab::Plane;

/// The slice that was inserted last.
#[derive(Clone, Default)]
pub(super) struct Admission {
    last: Option<(Image, Transform<World, ImageFrame>)>,
}

impl Admission {
    /// Returns the plane of an admissible slice. Changes outside the data, such as a scanner's
    /// clock, do not count as a difference.
    ///
    /// # Errors
    /// [`Refused::Size`], [`Refused::Repeated`] and [`Refused::Degenerate`].
    pub(super) fn check(&self, slice: &Slice, mask: &Mask) -> Result<Plane, Refused> {
        let found = [slice.image.width(), slice.image.height()];
        let expected = [mask.width(), mask.height()];
        if found != expected {
            return Err(Refused::Size { found, expected });
        }
        if let Some((image, pose)) = &self.last
            && *pose == slice.world_from_image
            && mask.bounds().is_none_or(|data| image.same_within(&slice.image, data))
        {
            return Err(Refused::Repeated);
        }
        Plane::new(slice.world_from_image).ok_or(Refused::Degenerate)
    }

    /// Records an inserted slice.
    pub(super) fn entered(&mut self, slice: &Slice) {
        self.last = Some((slice.image.clone(), slice.world_from_image));
    }
}
