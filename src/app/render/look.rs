//! View, mode and quality of a picture.

use glam::DVec3;

use config::view_settings::ViewSettings;
use render::RenderSettings;

use super::planar::Planes;
use crate::failure::Failure;

/// View, mode and quality of a picture.
#[derive(Debug, Clone)]
pub(crate) struct Look {
    pub(crate) view: ViewSettings,
    /// Colour behind the volume, 0 to 1.
    pub(crate) background: [f32; 3],
    pub(crate) planar: Planes,
    /// Name of the soft light, if any.
    pub(crate) soft: Option<String>,
}

impl Look {
    /// Returns the name of the transfer function in reports: that of the soft light, if it has its
    /// own.
    pub(crate) fn transfer_name(&self) -> &str {
        self.soft.as_deref().filter(|_| self.view.transfer.is_none()).unwrap_or_else(|| self.view.transfer_name())
    }

    /// Returns the render settings for a volume with these slice axes, and grey values from
    /// black to white over `range`.
    ///
    /// # Errors
    /// [`Failure`] when there is no such transfer function.
    pub(crate) fn settings(
        &self,
        range: [f32; 2],
        slice_axes: Option<[DVec3; 2]>,
        threads: usize,
    ) -> Result<RenderSettings, Failure> {
        self.view.settings(range, slice_axes, threads).map_err(Failure::flag)
    }
}
