//! Sections of the volume and its picture. Their keys have the names of the commands' flags.

use clap::ValueEnum;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use smart_default::SmartDefault;

use reconstruct::kernel::Method;
use reconstruct::path_choice::PathChoice;
use reconstruct::planar::{OnDeparture, PlanarSettings};
use reconstruct::settings::{MAX_WEIGHT, MOST_WEIGHT};
use render::Cache;
use render::classify::light::Light;
use render::settings::CACHE_BYTES;

use super::values::{Name, Notation, named, of_flag};
use crate::view_settings::{Classified, Draw, Mode};
use crate::weighing::{CompoundName, DecayName};

/// The volume that slices are inserted into; keys have the names of `reconstruct`'s flags
#[derive(Debug, SmartDefault, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub(crate) struct Volume {
    /// Coordinate frame of the volume; default: Reference if a reference_station is given, else
    /// Tracker
    #[schemars(extend("x-takes" = "a frame's name"))]
    pub(crate) world: Option<String>,
    /// Distance between voxels; default: the calibration file's, else 0.5
    #[schemars(extend("x-takes" = "a number or [x, y, z]"))]
    pub(crate) spacing_mm: Option<Notation>,
    /// World position of voxel (0, 0, 0); default: the lattice passes through the world's origin
    #[schemars(extend("x-takes" = "[x, y, z]"))]
    pub(crate) origin_mm: Option<Notation>,
    /// Insertion path of slices
    #[default(Name(PathChoice::Auto))]
    pub(crate) path: Name<PathChoice>,
    /// Treatment of a frame that leaves a planar scan's plane
    #[default(Name(OnDeparture::Upgrade))]
    pub(crate) departure: Name<OnDeparture>,
    /// Largest distance of the image's corners from the plane
    #[schemars(range(min = 0))]
    #[default(PlanarSettings::default().tolerance_voxels)]
    pub(crate) planar_tolerance_voxels: f64,
    /// Kernel
    pub(crate) method: Name<Method>,
    /// σ of the kernel; default: 0.75 × the larger of spacing and pixel in the plane, 1.0 across it
    #[schemars(extend("x-takes" = "[u, v, normal]"))]
    pub(crate) sigma_mm: Option<Notation>,
    /// Width of the kernel as half widths at half maximum, instead of sigma_mm
    #[schemars(extend("x-takes" = "[u, v, normal]"))]
    pub(crate) hwhm_mm: Option<Notation>,
    /// End of a Gaussian kernel, in the plane and across it; default: energy=0.001,energy=0.01
    #[schemars(extend("x-takes" = "\"CRITERION=E\" or two of them"))]
    pub(crate) support: Option<Notation>,
    /// Largest weight of a voxel, in slices at their peak
    #[schemars(range(min = 1, max = MOST_WEIGHT))]
    #[default(MAX_WEIGHT)]
    pub(crate) max_weight: f64,
    /// Compounding of slices that reach the same voxel
    pub(crate) compound: Name<CompoundName>,
    /// Fading of earlier slices with compound = "decay"; default: dead-time
    pub(crate) decay: Option<Name<DecayName>>,
    /// Rate of the fading; default: 1
    #[schemars(range(min = 1e-6, max = 1e6))]
    pub(crate) decay_per_s: Option<f64>,
    /// Time before the fading begins; default: 2
    #[schemars(range(min = 0, max = 1e6))]
    pub(crate) decay_wait_s: Option<f64>,
    /// Whether slices are weighted by the gaps beside them, each when the next one comes; needs the
    /// general path
    pub(crate) gap_weights: bool,
    /// Whether pixels in the shadow of bone or gas count little; needs the general path
    pub(crate) shadow_weights: bool,
    /// Whether the standard error of each voxel is known; needs the general path
    pub(crate) standard_error: bool,
    /// Number of threads that insert slices; any number gives the same volume; default: one a core
    #[schemars(range(min = 1, max = 1024))]
    pub(crate) threads: Option<u32>,
    /// Largest memory of the volume
    #[schemars(range(max = 1e6), extend("exclusiveMinimum" = 0))]
    #[default(8.0)]
    pub(crate) max_memory_gib: f64,
}

/// The picture that is rendered while the volume grows; keys have the names of `render`'s flags
#[derive(Debug, SmartDefault, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
#[schemars(extend("x-at-once" = true))]
pub(crate) struct Picture {
    /// Largest number of pictures a second
    #[schemars(range(min = 0.1, max = 1000))]
    #[default(30.0)]
    pub(crate) most_hz: f64,
    /// Size in pixels
    #[schemars(extend("x-takes" = "\"WxH\" or [width, height]"))]
    #[default(Notation::Text("512x512".into()))]
    pub(crate) image_size: Notation,
    /// Direction of the view; default: obliquely from the deep side, with the probe on top
    #[schemars(extend("x-takes" = "[azimuth, elevation] or [azimuth, elevation, roll]"))]
    pub(crate) view_deg: Option<Notation>,
    /// Angle of view along the shorter side; default: parallel rays
    #[schemars(range(max = 170), extend("exclusiveMinimum" = 0))]
    pub(crate) perspective_deg: Option<f64>,
    /// Rendering mode
    pub(crate) mode: Name<Mode>,
    /// Grey level of the surface with mode = "iso"; default: halfway between black and white
    #[schemars(extend("x-takes" = "a grey level"))]
    pub(crate) isovalue: Option<f64>,
    /// Values that the transfer function classifies; default: voxel
    pub(crate) shading: Option<Name<Classified>>,
    /// Opacity and colour of grey levels; default: tissue, for mip and average xray
    #[schemars(extend("x-takes" = "a preset or a path ending in .toml"))]
    pub(crate) transfer: Option<String>,
    /// Parts of the volume that are hidden; default: none
    #[schemars(extend("x-takes" = "a path of a crop file, ending in .toml"))]
    pub(crate) crop: Option<String>,
    /// Grey levels that are drawn black and white
    #[schemars(extend("x-takes" = "[black, white]"))]
    #[default(Notation::Text("0,255".into()))]
    pub(crate) window: Notation,
    /// Distance of samples along a ray
    #[schemars(extend("exclusiveMinimum" = 0))]
    #[default(1.0)]
    pub(crate) step_voxels: f64,
    /// Number of samples that are combined at a time; default: near the square root of a ray's
    /// samples
    #[schemars(range(min = 1))]
    pub(crate) arity: Option<u32>,
    /// Transparency below which a ray ends; default: 1/1024
    #[schemars(range(min = 0, max = 1))]
    pub(crate) stop: Option<f64>,
    /// Difference of the picture below which rays are left out; with 0, none is
    #[schemars(range(min = 0, max = 1))]
    pub(crate) adaptive: f64,
    /// Colour behind the volume, each component 0 to 1
    #[schemars(extend("x-takes" = "[red, green, blue]"))]
    #[default(Notation::Text("0,0,0".into()))]
    pub(crate) background: Notation,
    /// Light at the observer, or the direction towards the light in the world; default: headlight
    #[schemars(extend("x-takes" = "\"headlight\" or [x, y, z]"))]
    pub(crate) light: Option<Notation>,
    /// Part of the light that comes from all sides
    #[schemars(range(min = 0, max = 1))]
    #[default(Light::default().parts().ambient)]
    pub(crate) ambient: f64,
    /// Part of the light that a surface scatters evenly
    #[schemars(range(min = 0, max = 1))]
    #[default(Light::default().parts().diffuse)]
    pub(crate) diffuse: f64,
    /// Part of the light that a surface reflects as a highlight
    #[schemars(range(min = 0, max = 1))]
    #[default(Light::default().parts().specular)]
    pub(crate) specular: f64,
    /// Exponent of the highlight
    #[schemars(range(min = 1))]
    #[default(Light::default().parts().shininess)]
    pub(crate) shininess: u32,
    /// True to light the backs of surfaces too
    #[default(Light::default().is_two_sided())]
    pub(crate) two_sided: bool,
    /// Brightness of the nearest and the farthest sample; default: the same brightness at all
    /// depths
    #[schemars(extend("x-takes" = "[near, far]"))]
    pub(crate) depth_cue: Option<Notation>,
    /// Kind of the ray cache; all give the same picture
    pub(crate) cache: Name<Cache>,
    /// Largest memory of the ray cache
    #[schemars(range(max = 1 << 20))]
    #[default((CACHE_BYTES >> 20) as u32)]
    pub(crate) cache_mib: u32,
    /// Parts of the volume, cut across its z axis, that threads render each by itself; any number
    /// gives the same picture; default: 1
    #[schemars(range(min = 1, max = 1024))]
    pub(crate) parts: Option<u32>,
    /// Annotations drawn over the picture
    #[schemars(extend("x-takes" = "a list of slice, probe, scale and cube"))]
    #[default(vec![Name(Draw::Slice), Name(Draw::Probe)])]
    pub(crate) draw: Vec<Name<Draw>>,
    /// Number of threads that render; any number gives the same picture; default: one a core
    #[schemars(range(min = 1, max = 1024))]
    pub(crate) threads: Option<u32>,
}

named! {
    PathChoice: [("auto", PathChoice::Auto), ("general", PathChoice::General), ("planar", PathChoice::Planar)];
    OnDeparture: [("upgrade", OnDeparture::Upgrade), ("refuse", OnDeparture::Refuse)];
    Method: Method::ALL.map(|method| (method.name(), method));
    CompoundName: of_flag(CompoundName::value_variants());
    DecayName: of_flag(DecayName::value_variants());
    Mode: of_flag(&Mode::OF_RAYS);
    Classified: of_flag(Classified::value_variants());
    Cache: Cache::ALL.map(|cache| (cache.name(), cache));
    Draw: of_flag(&[Draw::Slice, Draw::Probe, Draw::Scale, Draw::Cube]);
}
