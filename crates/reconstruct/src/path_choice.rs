//! Choice of the insertion path for a recording: by the user's setting, the poses and the mask.

use mask::Mask;
use sync::FramePose;

use crate::planar::{Departure, OnDeparture, PlanarSettings, worst_departure};
use crate::{Path, PathReconstructor, Settings, SettingsError};

/// Setting that selects the insertion path.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PathChoice {
    /// By the poses and the mask.
    #[default]
    Auto,
    /// Always the general path.
    General,
    /// The general path, because a box along the world's axes was requested.
    WorldBox,
    /// The planar path; slices that it cannot hold are a [`Departure`].
    Planar,
}

/// The path that a recording's poses allow, and the reason. The mask is checked later.
#[derive(Debug, Clone, PartialEq)]
pub struct Chosen {
    /// The path.
    pub path: Path,
    /// The reason, as the end of a sentence.
    pub why: String,
}

/// A frame that prevents the planar path.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error("frame {item}: {departure}")]
pub struct NotPlanar {
    /// Number of the frame in the recording.
    pub item: u64,
    /// Its distance from the plane.
    pub departure: Departure,
}

impl Chosen {
    /// Returns the general path, with the reason.
    pub fn general(why: impl Into<String>) -> Self {
        Self { path: Path::General, why: why.into() }
    }

    /// Chooses the path by all poses of a recording.
    ///
    /// # Errors
    /// [`NotPlanar`] when the planar path was requested, a pose leaves the plane, and an
    /// upgrade is not allowed.
    pub fn by_poses(
        choice: PathChoice,
        settings: &Settings,
        planar: &PlanarSettings,
        poses: &[FramePose],
    ) -> Result<Self, NotPlanar> {
        match choice {
            PathChoice::General => return Ok(Self::general("it was asked for")),
            PathChoice::WorldBox => return Ok(Self::general("a box along the world's axes was asked for")),
            PathChoice::Auto | PathChoice::Planar => {}
        }
        if choice == PathChoice::Auto
            && let Some(what) = settings.beyond_planar()
        {
            return Ok(Self::general(format!("the planar path has no way for {what}")));
        }
        let tolerance_voxels = planar.tolerance_voxels;
        let size = poses.first().map_or([0; 2], |pose| pose.size);
        let worst = worst_departure(settings, planar, size, poses.iter().map(|pose| pose.world_from_image));
        let beyond = worst.filter(|(_, voxels)| *voxels > tolerance_voxels);
        let asked = choice == PathChoice::Planar;
        match beyond {
            Some((i, voxels)) if asked && planar.on_departure == OnDeparture::Refuse => {
                Err(NotPlanar { item: poses[i].item, departure: Departure::Pose { voxels, tolerance_voxels } })
            }
            _ if asked => Ok(Self { path: Path::Planar, why: "it was asked for".into() }),
            Some((i, voxels)) => Ok(Self::general(format!(
                "frame {} lies up to {voxels:.3} voxel off the first one's plane",
                poses[i].item
            ))),
            // A single slice is perpendicular to many planes.
            None if poses.len() < 2 => Ok(Self::general("one slice is no scan of a plane")),
            // The spacing's three numbers are along the world's axes.
            None if settings.spacing_mm != glam::DVec3::splat(settings.spacing_mm.x) => {
                Ok(Self::general("the spacing along x, y and z differs, and a planar scan's axes are not the world's"))
            }
            None => {
                let worst = worst.map_or(0.0, |(_, voxels)| voxels);
                let why = format!("all poses are perpendicular to one plane, to {worst:.3} voxel");
                Ok(Self { path: Path::Planar, why })
            }
        }
    }

    /// Creates the reconstructor once the mask is known. If the path was chosen automatically,
    /// a non-rectangular mask changes it to the general one.
    ///
    /// # Errors
    /// Those of [`PathReconstructor::general`] and [`PathReconstructor::planar`].
    pub fn weaver(
        &mut self,
        choice: PathChoice,
        settings: &Settings,
        planar: &PlanarSettings,
        mask: &Mask,
    ) -> Result<PathReconstructor, SettingsError> {
        if self.path == Path::Planar
            && choice == PathChoice::Auto
            && let Err(departure) = Departure::rectangle(mask)
        {
            let Departure::Mask { data, rectangle } = departure else { return Err(departure.into()) };
            *self = Self::general(format!("the data is no rectangle: {data} pixels of the {rectangle} around them"));
        }
        match self.path {
            Path::General => PathReconstructor::general(settings.clone(), mask.clone()),
            Path::Planar => PathReconstructor::planar(settings.clone(), *planar, mask.clone()),
        }
    }
}
