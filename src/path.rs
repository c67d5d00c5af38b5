//! Which path a recording's slices go: by what the user says, by their poses, and by what of the picture is data.

use crate::mask::Mask;
use crate::reconstruct::planar::{Departure, OnDeparture, PlanarSettings, worst_departure};
use crate::reconstruct::{Path, Settings, SettingsError, Weaver};
use crate::sync::FramePose;

/// Who says which way slices go.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PathChoice {
    /// The poses and the mask.
    #[default]
    Auto,
    /// The general path whatever they are.
    General,
    /// The general path, for a box along the world's axes is asked for.
    WorldBox,
    /// The planar path; what it cannot hold is a [`Departure`].
    Planar,
}

/// The path that a recording's poses allow, and why it is that; the mask has still to agree.
#[derive(Debug, Clone, PartialEq)]
pub struct Chosen {
    /// The path.
    pub path: Path,
    /// Why, as the end of a sentence.
    pub why: String,
}

/// A frame that keeps a recording from the planar path.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error("frame {item}: {departure}")]
pub struct NotPlanar {
    /// Number of the frame in the recording.
    pub item: u64,
    /// How far it leaves the plane.
    pub departure: Departure,
}

impl Chosen {
    /// The general path because the user said so, or for another reason given.
    pub fn general(why: impl Into<String>) -> Self {
        Self { path: Path::General, why: why.into() }
    }

    /// Chooses by all poses of a recording.
    ///
    /// # Errors
    /// [`NotPlanar`] when the planar path is asked for, a pose leaves the plane, and that is not to be upgraded.
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
            // One slice is perpendicular to many planes.
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

    /// The weaver once the mask is known, too. Where the path is the recording's own choice, a mask that is no rectangle makes it the general one.
    ///
    /// # Errors
    /// As [`Weaver::general`] and [`Weaver::planar`].
    pub fn weaver(
        &mut self,
        choice: PathChoice,
        settings: &Settings,
        planar: &PlanarSettings,
        mask: &Mask,
    ) -> Result<Weaver, SettingsError> {
        if self.path == Path::Planar
            && choice == PathChoice::Auto
            && let Err(departure) = Departure::rectangle(mask)
        {
            let Departure::Mask { data, rectangle } = departure else { return Err(departure.into()) };
            *self = Self::general(format!("the data is no rectangle: {data} pixels of the {rectangle} around them"));
        }
        match self.path {
            Path::General => Weaver::general(settings.clone(), mask.clone()),
            Path::Planar => Weaver::planar(settings.clone(), *planar, mask.clone()),
        }
    }
}
