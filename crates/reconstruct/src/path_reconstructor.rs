//! The two insertion paths behind one `insert`: the general path, and the planar one for scans
//! that stay perpendicular to a plane.

use mask::Mask;
use sonoweave_core::frames::{Transform, Volume, World};
use sonoweave_core::slice::Slice;
use volume::Voxels;

use super::kernel::AxisKernel;
use super::planar::{Departure, OnDeparture, PlanarReconstructor, PlanarSettings};
use super::{
    Compounding, Entered, FirstMoment, Reconstructor, Refused, Settings, SettingsError, StandardErrors, Touched, Work,
};

/// Insertion path of slices.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Path {
    /// Any pose, any mask: bricks with a weight per voxel.
    General,
    /// Poses perpendicular to one plane and rectangular data: columns with one weight each.
    Planar,
}

impl Path {
    /// The name on the command line and in statistics.
    pub fn name(self) -> &'static str {
        match self {
            Self::General => "general",
            Self::Planar => "planar",
        }
    }
}

/// Inserts slices into a volume by either path, and upgrades from the planar to the general one
/// when needed and allowed.
pub struct PathReconstructor {
    active: Active,
    upgraded: Option<Departure>,
}

enum Active {
    General(Box<Reconstructor>),
    Planar(Box<PlanarReconstructor>),
}

/// Calls a method that both paths have.
macro_rules! either {
    ($self:ident, $r:ident => $call:expr) => {
        match &$self.active {
            Active::General($r) => $call,
            Active::Planar($r) => $call,
        }
    };
}

impl PathReconstructor {
    /// Creates it on the general path.
    ///
    /// # Errors
    /// [`SettingsError`] when the settings cannot work for any slice.
    pub fn general(settings: Settings, mask: Mask) -> Result<Self, SettingsError> {
        Ok(Self { active: Active::General(Box::new(Reconstructor::new(settings, mask)?)), upgraded: None })
    }

    /// Creates it on the planar path. If the mask does not suit that path and the planar
    /// settings contain [`OnDeparture::Upgrade`], it begins on the general path.
    ///
    /// # Errors
    /// [`SettingsError`] when the settings cannot work for any slice, [`SettingsError::Planar`]
    /// when the mask does not suit the path and an upgrade is not allowed.
    pub fn planar(settings: Settings, planar: PlanarSettings, mask: Mask) -> Result<Self, SettingsError> {
        match PlanarReconstructor::new(settings.clone(), planar, mask.clone()) {
            Ok(reconstructor) => Ok(Self { active: Active::Planar(Box::new(reconstructor)), upgraded: None }),
            Err(SettingsError::Planar(departure)) if planar.on_departure == OnDeparture::Upgrade => {
                Ok(Self { upgraded: Some(departure), ..Self::general(settings, mask)? })
            }
            Err(error) => Err(error),
        }
    }

    /// Returns a copy that continues by itself; neither changes with the other. They share threads.
    ///
    /// # Errors
    /// When the system has no memory to give.
    pub fn copy(&self) -> std::io::Result<Self> {
        let active = match &self.active {
            Active::General(reconstructor) => Active::General(Box::new(reconstructor.copy()?)),
            Active::Planar(planar) => Active::Planar(Box::new(planar.copy()?)),
        };
        Ok(Self { active, upgraded: self.upgraded })
    }

    /// The present path of slices.
    pub fn path(&self) -> Path {
        match self.active {
            Active::General(_) => Path::General,
            Active::Planar(_) => Path::Planar,
        }
    }

    /// Reason why the general path has replaced the planar one, if it has.
    pub fn upgraded(&self) -> Option<Departure> {
        self.upgraded
    }

    /// Inserts a slice into the volume. A slice that leaves the plane is refused, or causes the
    /// upgrade to the general path. In either case earlier insertions remain, even if the slice
    /// is then refused.
    ///
    /// # Errors
    /// [`Refused`] with the reason; no voxel has changed then.
    pub fn insert(&mut self, slice: &Slice) -> Result<Touched, Refused> {
        self.insert_weighted(slice, 1.0)
    }

    /// The same with a weight of the whole slice, by the [gaps](super::gap_weights) beside it. The
    /// planar path, which [`Settings::gap_weights`] excludes, takes no weight.
    ///
    /// # Errors
    /// [`Refused`] with the reason; no voxel has changed then.
    pub fn insert_weighted(&mut self, slice: &Slice, weight: f32) -> Result<Touched, Refused> {
        let planar = match &mut self.active {
            Active::General(reconstructor) => return reconstructor.insert_weighted(slice, weight),
            Active::Planar(planar) => planar,
        };
        match planar.insert(slice) {
            Err(Refused::Departure(departure)) if planar.on_departure() == OnDeparture::Upgrade => {
                let mut general = Box::new(planar.upgraded()?);
                let result = general.insert(slice);
                self.active = Active::General(general);
                self.upgraded = Some(departure);
                // Existing content is rewritten, with some bits different.
                result.map(|touched| Touched { slab: None, ..touched })
            }
            result => result,
        }
    }

    /// Changes the mask of later slices; what is in the volume stays. Returns false on the planar
    /// path, which has changed nothing: its columns hold one rectangle.
    ///
    /// # Errors
    /// [`SettingsError`] when the settings cannot work with this mask; nothing has changed then.
    pub fn set_mask(&mut self, mask: Mask) -> Result<bool, SettingsError> {
        match &mut self.active {
            Active::General(reconstructor) => reconstructor.set_mask(mask).map(|()| true),
            Active::Planar(_) => Ok(false),
        }
    }

    /// Returns the slice that was inserted last, on the general path.
    pub fn last(&self) -> Option<Entered> {
        match &self.active {
            Active::General(reconstructor) => reconstructor.last(),
            Active::Planar(_) => None,
        }
    }

    /// The volume so far.
    pub fn volume(&self) -> &dyn Voxels {
        either!(self, r => r.volume())
    }

    /// Maps voxel indices to world mm.
    pub fn world_from_lattice(&self) -> Transform<World, Volume> {
        either!(self, r => r.world_from_lattice())
    }

    /// The settings in use; on the planar path, with the lattice's direction as found by the
    /// first slice.
    pub fn settings(&self) -> &Settings {
        either!(self, r => r.settings())
    }

    /// Kernels along u, v and the normal, once the first slice has given the pixel size.
    pub fn kernels(&self) -> Option<&[AxisKernel; 3]> {
        either!(self, r => r.kernels())
    }

    /// Pixel size along u and v in mm, once known.
    pub fn pixel_mm(&self) -> Option<[f64; 2]> {
        either!(self, r => r.pixel_mm())
    }

    /// Node spacing of the filtered image in pixels, and the bound on its samples' deviation
    /// from the exact in-plane sum as a fraction of the image's range. `None` before the first
    /// slice. The planar path samples no filtered image: one pixel, and rounding errors only.
    pub fn decimation(&self) -> Option<([f64; 2], f64)> {
        match &self.active {
            Active::General(r) => r.decimation(),
            Active::Planar(r) => r.kernels().map(|_| ([1.0; 2], 0.0)),
        }
    }

    /// Returns the standard errors of the volume's voxels. `pose_mm` is the root mean square error
    /// of places in the image by the noise of poses, 0 if it is unknown. `None` if they were not
    /// asked for, or if no voxel was reached by two slices.
    pub fn standard_errors(&self, pose_mm: f64) -> Option<StandardErrors<'_>> {
        StandardErrors::new(self.keeping_errors()?, pose_mm)
    }

    /// Returns the reconstructor on the general path, if it keeps standard errors.
    pub fn keeping_errors(&self) -> Option<&Reconstructor> {
        match &self.active {
            Active::General(reconstructor) => Some(&**reconstructor).filter(|r| r.settings().standard_error),
            Active::Planar(_) => None,
        }
    }

    /// Returns the volume with its [first moment](super::first_moment) corrected; `None` before the
    /// first slice, with shadow weights, for a compounding other than the mean, and for the kernel
    /// nearest.
    pub fn first_moment(&self) -> Option<FirstMoment<'_>> {
        let (settings, normal) = (self.settings(), &self.kernels()?[2]);
        let is_mean = settings.compounding == Compounding::Mean && settings.shadow_weights.is_none();
        if !is_mean || !FirstMoment::suits(normal) {
            return None;
        }
        Some(FirstMoment::new(self.volume(), settings.spacing_mm, normal, either!(self, r => r.normals())))
    }

    /// Work done so far.
    pub fn work(&self) -> Work {
        either!(self, r => r.work())
    }
}
