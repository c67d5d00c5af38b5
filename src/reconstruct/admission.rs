//! What both paths ask of a slice before they look at where it goes: a picture of the right size, a pose that spans a plane, and news.

use calibration::frames::{Image as ImageFrame, Transform, World};

use super::reconstructor::Refused;
use super::slab::Plane;
use crate::mask::Mask;
use crate::slice::{Image, Slice};

/// The slice that entered last.
#[derive(Clone, Default)]
pub(super) struct Admission {
    last: Option<(Image, Transform<World, ImageFrame>)>,
}

impl Admission {
    /// The plane of a slice that may enter. What lies outside the data, as a scanner's clock does, makes no news.
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

    /// A slice has entered.
    pub(super) fn entered(&mut self, slice: &Slice) {
        self.last = Some((slice.image.clone(), slice.world_from_image));
    }
}
