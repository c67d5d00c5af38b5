//! Choice of the insertion path for a recording: by the user's setting, the poses and the mask.

use mask::Mask;
use sonoweave_core::frames::{Image, Transform, World};
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
        let tolerance_voxels = planar.tolerance_voxels;
        let size = poses.first().map_or([0; 2], |pose| pose.size);
        let departure = || worst_departure(settings, planar, size, poses.iter().map(|pose| pose.world_from_image));
        match choice {
            PathChoice::General => Ok(Self::general("it was asked for")),
            PathChoice::WorldBox => Ok(Self::general("a box along the world's axes was asked for")),
            PathChoice::Planar => match departure() {
                Some((i, voxels)) if voxels > tolerance_voxels && planar.on_departure == OnDeparture::Refuse => {
                    Err(NotPlanar { item: poses[i].item, departure: Departure::Pose { voxels, tolerance_voxels } })
                }
                _ => Ok(Self { path: Path::Planar, why: "it was asked for".into() }),
            },
            PathChoice::Auto => {
                let off = |i: usize, voxels| {
                    format!("frame {} lies up to {voxels:.3} voxel off the first one's plane", poses[i].item)
                };
                Ok(Self::automatic(settings, planar, departure, poses.len(), off))
            }
        }
    }

    /// Chooses the path by poses spread over those that a session's device can reach, for images
    /// of this size; the choice is automatic.
    pub fn by_reach(
        settings: &Settings,
        planar: &PlanarSettings,
        size: [u32; 2],
        poses: &[Transform<World, Image>],
    ) -> Self {
        if poses.is_empty() {
            return Self::general("live poses are not known beforehand");
        }
        let off = |_, voxels| {
            format!("the arm can turn the image out of its plane, by up to {voxels:.3} voxel: u is not along its axis")
        };
        Self::automatic(
            settings,
            planar,
            || worst_departure(settings, planar, size, poses.iter().copied()),
            poses.len(),
            off,
        )
    }

    fn automatic(
        settings: &Settings,
        planar: &PlanarSettings,
        departure: impl FnOnce() -> Option<(usize, f64)>,
        poses: usize,
        off: impl FnOnce(usize, f64) -> String,
    ) -> Self {
        if let Some(what) = settings.beyond_planar() {
            return Self::general(format!("the planar path has no way for {what}"));
        }
        let worst = departure();
        match worst {
            Some((i, voxels)) if voxels > planar.tolerance_voxels => Self::general(off(i, voxels)),
            // A single slice is perpendicular to many planes.
            _ if poses < 2 => Self::general("one slice is no scan of a plane"),
            // The spacing's three numbers are along the world's axes.
            _ if settings.spacing_mm != glam::DVec3::splat(settings.spacing_mm.x) => {
                Self::general("the spacing along x, y and z differs, and a planar scan's axes are not the world's")
            }
            _ => {
                let worst = worst.map_or(0.0, |(_, voxels)| voxels);
                Self {
                    path: Path::Planar,
                    why: format!("all poses are perpendicular to one plane, to {worst:.3} voxel"),
                }
            }
        }
    }

    /// Creates the reconstructor once the mask is known. If the path was chosen automatically,
    /// a non-rectangular mask changes it to the general one.
    ///
    /// # Errors
    /// Those of [`PathReconstructor::general`] and [`PathReconstructor::planar`].
    pub fn reconstructor(
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

#[cfg(test)]
mod tests {
    use glam::{DAffine3, DMat3, DVec3};

    use super::*;
    use crate::Compounding;

    /// Image poses of an arm that turns about z: u is tilted by an angle against z.
    fn reach(tilt: f64) -> Vec<Transform<World, Image>> {
        let u = DVec3::new(0.0, tilt.sin(), tilt.cos());
        let image = DMat3::from_cols(u, DVec3::X, u.cross(DVec3::X));
        let turned = |turn: i32| {
            let turn = DMat3::from_rotation_z(0.5 * f64::from(turn));
            Transform::from_affine(DAffine3 { matrix3: turn * image * 0.2, translation: turn * DVec3::X * 300.0 })
        };
        (-1..2).map(turned).collect()
    }

    #[test]
    fn reach_of_arm_gives_planar_path_if_u_is_its_axis() {
        let (settings, planar) = (Settings::new(DVec3::splat(0.5)), PlanarSettings::default());
        let chosen = |settings: &Settings, poses: &[_]| Chosen::by_reach(settings, &planar, [200, 160], poses);
        assert_eq!(chosen(&settings, &reach(0.0)).path, Path::Planar);
        let tilted = chosen(&settings, &reach(0.05));
        assert!(tilted.path == Path::General && tilted.why.contains("u is not along its axis"), "{}", tilted.why);
        assert_eq!(chosen(&settings, &[]).path, Path::General);
        let latest = Settings { compounding: Compounding::Latest, ..settings };
        assert_eq!(chosen(&latest, &reach(0.0)).path, Path::General);
    }
}
