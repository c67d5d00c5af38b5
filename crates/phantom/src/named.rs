//! Scenes, trajectories and scanners by name, for flags and configuration files.

use std::sync::Arc;

use clap::ValueEnum;
use glam::{DVec2, DVec3};

use super::bmode::Layout;
use super::body::{Body, calibration, doll, thigh};
use super::scene::{Blobs, MarschnerLobb, Plane, Pulsating, Speckle, ThinSheet, Waves, Wires, ZonePlate};
use super::{Motion, PhantomError, Scanner, Scene};

/// Radius of the curvilinear transducer, and of the thigh's skin, mm.
const FACE_RADIUS_MM: f64 = 60.0;

/// The scanned scene.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
pub enum SceneName {
    /// The same grey level everywhere
    Constant,
    /// Linear along every axis
    Ramp,
    /// 60 Gaussian blobs and a soft sphere
    #[default]
    Blobs,
    /// A hard sphere of 10 mm radius in the middle
    Sphere,
    /// A hard edge through the middle, across --normal
    Plane,
    /// Shells that become finer from the middle outwards
    ZonePlate,
    /// Plane waves: see --frequency
    Sinusoid,
    /// Seven wires of 0.5 mm in seven directions
    Wires,
    /// A sheet of 0.5 mm through the middle, across --normal
    Sheet,
    /// The test function of Marschner and Lobb, with a unit of 20 mm
    MarschnerLobb,
    /// Fully developed speckle: see --grain
    Speckle,
    /// A sphere whose radius oscillates between 8 and 12 mm once a second
    Pulsating,
    /// A doll in a water tank, with simulated echoes
    Doll,
    /// A thigh with femur, artery and vein, with simulated echoes
    Thigh,
    /// Three N-shaped layers of wires in water
    NWire,
    /// Two wires in water that cross at one point
    CrossWire,
    /// The sloping floor of a water tank
    TankFloor,
    /// A pointed steel rod in water
    Stylus,
}

/// The probe's motion.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
pub enum TrajectoryName {
    /// Equal steps along the plane's normal
    Parallel,
    /// Uneven steps along the plane's normal, from 2/3 to 4/3 of the gap
    Jittered,
    /// Equal tilts about an axis above the image
    Fan,
    /// Equal turns about the image's own middle line along u
    Rotation,
    /// By an arm: wandering in a plane and turning about u, nothing else
    Arm,
    /// By hand: wandering, tilting, at uneven speed
    #[default]
    Freehand,
    /// By an unsteady hand: as by hand, with corrections and tremor
    Unsteady,
    /// Two parallel sweeps that cross at a right angle, half of the frames each
    Crossing,
    /// Three sweeps of an unsteady hand: upright, turned by 90°, and tilted by 30°
    ThreeDirections,
    /// A parallel sweep with a pause in its middle: see --dwell
    Dwell,
    /// A parallel sweep and the same way back
    OutAndBack,
    /// Around the crossing, the tip or the floor's middle, which stays in the image: to
    /// calibrate a probe
    About,
}

/// A scanner's transducer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ProbeName {
    /// A fan of 60° from an arc of 60 mm radius, 3.5 MHz
    Curvilinear,
    /// A rectangle 38 mm wide, 7.5 MHz
    Linear,
}

/// Options of scenes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SceneOptions {
    /// Seed of random scenes.
    pub seed: u64,
    /// Grey level of the constant scene.
    pub grey: f64,
    /// Normal of planes and sheets, of length 1.
    pub normal: DVec3,
    /// One wave, cycles per mm; `None` for one of 0.25 along each axis.
    pub frequency: Option<DVec3>,
    /// Distance at which the correlation of speckle has fallen to a half, mm.
    pub grain_mm: f64,
    /// The transducer for a body; `None` for the default one.
    pub probe: Option<ProbeName>,
    /// Depth of the field, mm; `None` for the body's default.
    pub depth_mm: Option<f64>,
}

impl SceneOptions {
    /// Returns the default options.
    pub fn new(seed: u64) -> Self {
        let normal = DVec3::new(1.0, 2.0, 3.0).normalize();
        let grain_mm = Speckle::STANDARD_PITCH_MM;
        Self { seed, grey: 100.0, normal, frequency: None, grain_mm, probe: None, depth_mm: None }
    }
}

/// Options of trajectories.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotionOptions {
    /// Distance of a fan's axis from the image's middle, mm.
    pub axis_distance_mm: f64,
    /// Distance from a rotation's axis at which neighbouring images lie the gap apart, mm.
    pub radius_mm: f64,
    /// Frames of a dwell.
    pub dwell: u32,
}

/// Default distance of a fan's axis, mm.
pub const AXIS_DISTANCE_MM: f64 = 60.0;
/// Default distance from a rotation's axis, mm.
pub const RADIUS_MM: f64 = 24.0;
/// Default dwell, frames.
pub const DWELL: u32 = 30;

/// Default distance between frames of a motion around a point, mm.
const ABOUT_GAP_MM: f64 = 1.0;

impl Default for MotionOptions {
    fn default() -> Self {
        Self { axis_distance_mm: AXIS_DISTANCE_MM, radius_mm: RADIUS_MM, dwell: DWELL }
    }
}

/// A body, its default scanner, and the length of a sweep over all of it.
#[derive(Debug, Clone)]
pub struct Scanned {
    /// The body.
    pub body: Body,
    /// The scanner.
    pub scanner: Scanner,
    /// Length of a sweep over the whole body, mm.
    pub sweep_mm: f64,
}

/// The displayed form of a scene.
#[derive(Debug, Clone)]
pub enum SceneContent {
    /// Its grey levels.
    Greys(Scene),
    /// Its echoes.
    Echoes(Box<Scanned>),
}

impl SceneName {
    /// Returns the scene's default transducer; `None` if no echoes are simulated.
    pub fn usual_probe(self) -> Option<ProbeName> {
        match self {
            Self::Doll | Self::Thigh => Some(ProbeName::Curvilinear),
            Self::NWire | Self::CrossWire | Self::TankFloor | Self::Stylus => Some(ProbeName::Linear),
            _ => None,
        }
    }

    /// Returns the scene and its displayed form.
    pub fn content(self, options: &SceneOptions) -> SceneContent {
        let SceneOptions { seed, grey, normal, frequency, grain_mm, probe, depth_mm } = *options;
        let (body, depth, sweep_mm) = match self {
            Self::Constant => return SceneContent::Greys(Scene::Constant(grey)),
            Self::Ramp => return SceneContent::Greys(Scene::standard_ramp()),
            Self::Blobs => return SceneContent::Greys(Scene::Blobs(Blobs::draw(seed))),
            Self::Sphere => return SceneContent::Greys(Scene::standard_sphere()),
            Self::Plane => return SceneContent::Greys(Scene::Plane(Plane::standard(normal))),
            Self::ZonePlate => return SceneContent::Greys(Scene::ZonePlate(ZonePlate::standard())),
            Self::Sinusoid => {
                return SceneContent::Greys(Scene::Waves(frequency.map_or_else(Waves::standard, Waves::single)));
            }
            Self::Wires => return SceneContent::Greys(Scene::Wires(Wires::standard())),
            Self::Sheet => return SceneContent::Greys(Scene::ThinSheet(ThinSheet::standard(normal))),
            Self::MarschnerLobb => return SceneContent::Greys(Scene::MarschnerLobb(MarschnerLobb::standard())),
            Self::Speckle => return SceneContent::Greys(Scene::Speckle(Speckle::draw(seed, grain_mm))),
            Self::Pulsating => return SceneContent::Greys(Scene::Pulsating(Pulsating::standard())),
            Self::Doll => (doll::doll(), 110.0, doll::SWEEP_MM),
            Self::Thigh => (thigh::thigh(FACE_RADIUS_MM), 120.0, thigh::SWEEP_MM),
            Self::NWire => (calibration::n_wires(&calibration::NWires::default()), 50.0, 36.0),
            Self::CrossWire => (calibration::cross_wire(28.0), 50.0, 20.0),
            Self::TankFloor => (calibration::floor(40.0, DVec2::new(0.1, 0.05)), 50.0, 30.0),
            Self::Stylus => {
                let along = DVec3::new(0.55, -0.35, 0.75);
                (calibration::stylus(DVec3::new(-4.0, 32.0, -8.0), along), 50.0, 24.0)
            }
        };
        let depth = depth_mm.unwrap_or(depth);
        let scanner = match probe.or(self.usual_probe()) {
            Some(ProbeName::Linear) => Scanner::small_parts(depth),
            Some(ProbeName::Curvilinear) | None => Scanner::abdominal(depth),
        };
        let scanner = if self == Self::Thigh { scanner } else { scanner.in_water() };
        SceneContent::Echoes(Box::new(Scanned { body, scanner: Scanner { seed, ..scanner }, sweep_mm }))
    }
}

impl SceneContent {
    /// Returns body and scanner, if echoes are simulated.
    pub fn scanned(&self) -> Option<&Scanned> {
        match self {
            Self::Greys(_) => None,
            Self::Echoes(scanned) => Some(scanned),
        }
    }

    /// Returns the scene for images of a given size.
    ///
    /// # Errors
    /// [`PhantomError`] for an invalid scanner, or one whose field lies outside such images.
    pub fn placed(self, image_size: [u32; 2], pixel_mm: f64) -> Result<Scene, PhantomError> {
        match self {
            Self::Greys(scene) => Ok(scene),
            Self::Echoes(scanned) => scanned.placed(image_size, pixel_mm).map(Scene::Body),
        }
    }

    /// Returns the default pixel size, mm; for a body, it fits the scanner's whole field.
    pub fn usual_pixel_mm(&self, image_size: [u32; 2]) -> f64 {
        self.scanned().map_or(0.1, |scanned| scanned.scanner.pixel_mm(image_size))
    }

    /// Returns the default distance of a sweep's frames, mm; for a body, the sweep covers all
    /// of it.
    pub fn usual_gap_mm(&self, frames: u32) -> f64 {
        self.scanned().map_or(0.35, |scanned| scanned.sweep_mm / f64::from(frames.max(2) - 1))
    }

    /// Returns the default noise, grey levels; a simulated scanner has noise of its own.
    pub fn usual_noise_sd(&self) -> f64 {
        if self.scanned().is_some() { 0.0 } else { 6.0 }
    }
}

impl Scanned {
    /// Returns the body, placed at the scanner's face.
    fn placed(self, image_size: [u32; 2], pixel_mm: f64) -> Result<Arc<Body>, PhantomError> {
        let layout = Layout::new(&self.scanner, image_size, [pixel_mm; 2])?;
        Ok(Arc::new(self.body.placed_at(layout.face_below_middle_mm())))
    }
}

impl TrajectoryName {
    /// Returns the default distance of a sweep's frames for a scene, mm.
    pub fn usual_gap_mm(self, shown: &SceneContent, frames: u32) -> f64 {
        match self {
            Self::About => ABOUT_GAP_MM,
            _ => shown.usual_gap_mm(frames),
        }
    }

    /// Returns the motion for a scene; `About` moves around the middle of its landmarks.
    pub fn motion(self, options: &MotionOptions, scene: &Scene) -> Motion {
        let MotionOptions { axis_distance_mm, radius_mm, dwell } = *options;
        match self {
            Self::Parallel => Motion::Parallel,
            Self::Fan => Motion::Fan { axis_distance_mm },
            Self::Freehand => Motion::Freehand,
            Self::Unsteady => Motion::Unsteady,
            Self::Jittered => Motion::Jittered,
            Self::Rotation => Motion::Rotation { radius_mm },
            Self::Arm => Motion::Arm,
            Self::Crossing => Motion::Crossing,
            Self::Dwell => Motion::Dwell { frames: dwell },
            Self::ThreeDirections => Motion::ThreeDirections,
            Self::OutAndBack => Motion::OutAndBack,
            Self::About => {
                let landmarks = scene.landmarks();
                Motion::About { point: landmarks.iter().sum::<DVec3>() / landmarks.len().max(1) as f64 }
            }
        }
    }
}
