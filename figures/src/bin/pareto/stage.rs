//! Phantoms and their scans, and the correct values at positions that lie on no voxel lattice.

use std::error::Error;

use glam::{DMat3, DQuat, DVec3, EulerRot};

use phantom::scene::{Blobs, MarschnerLobb, Plane, Scene, Speckle, ThinSheet, Waves, Wires, ZonePlate};
use phantom::{EffectiveKernel, Motion, Scan, ScanSettings, TrackerNoise, blur, truth};
use reconstruct::kernel::AxisKernel;
use reconstruct::reference::Reference;
use sonoweave_core::frames::{Image as ImageFrame, Transform, World};
use sonoweave_core::slice::Slice;
use volume::Grid;

use crate::contestant::default_kernels;

/// 32×28 mm of pixels finer than voxels, like those of scanners.
const PICTURE: [u32; 2] = [160, 140];
const PIXEL_MM: f64 = 0.2;
/// Three quarters of σ across the plane, in the middle of the gaps of Ohbuchi, Chen & Fuchs
/// (1992).
const GAP_MM: f64 = 0.75;
/// Twofold undersampling: two σ.
const SPARSE_GAP_MM: f64 = 2.0;
/// Length of a sweep from the first to the last slice, mm.
const SWEEP_MM: f64 = 28.0;
/// Positions count as inside if slices lie this far on both sides, which exceeds every
/// contestant's support.
const BOTH_SIDES_MM: f64 = 4.0;
/// Positions inside have at least this margin to the frame's border.
const FROM_BORDER_MM: f64 = 2.0;
/// Step of the blurred truth's differences, mm.
const STEP_MM: f64 = 0.1;

/// A phantom and its scan.
#[derive(Clone, Copy)]
pub(crate) struct Plan {
    /// Name in files.
    pub(crate) id: &'static str,
    /// Name in pictures and tables.
    pub(crate) title: &'static str,
    scene: fn() -> Scene,
    motion: Motion,
    /// Distance of slices, mm.
    gap_mm: f64,
    tracker: TrackerNoise,
    /// Whether all kernels, supports and voxels are swept over it.
    pub(crate) sweep: bool,
}

impl Plan {
    /// Returns the noise of the tracker's poses.
    pub(crate) fn noise(&self) -> calibration::tracker::noise::TrackerNoise {
        let TrackerNoise { position_mm, rotation_degrees } = self.tracker;
        calibration::tracker::noise::TrackerNoise { position_mm, rotation_deg: rotation_degrees }
    }

    /// Returns whether the tracker has noise.
    pub(crate) fn is_noisy(&self) -> bool {
        self.tracker != STILL
    }

    /// Returns whether all slices stay perpendicular to one plane, with u along its normal.
    pub(crate) fn is_planar(&self) -> bool {
        let moves = matches!(self.motion, Motion::Parallel | Motion::Jittered | Motion::Fan { .. } | Motion::Arm);
        moves && self.tracker == STILL
    }
}

const STILL: TrackerNoise = TrackerNoise { position_mm: 0.0, rotation_degrees: 0.0 };

const fn plan(id: &'static str, title: &'static str, scene: fn() -> Scene, motion: Motion) -> Plan {
    Plan { id, title, scene, motion, gap_mm: GAP_MM, tracker: STILL, sweep: false }
}

const fn erring(id: &'static str, title: &'static str, position_mm: f64, rotation_degrees: f64) -> Plan {
    Plan { tracker: TrackerNoise { position_mm, rotation_degrees }, ..plan(id, title, sphere, Motion::Freehand) }
}

fn blobs() -> Scene {
    Scene::Blobs(Blobs::draw(1))
}

fn sphere() -> Scene {
    Scene::standard_sphere()
}

fn zone_plate() -> Scene {
    Scene::ZonePlate(ZonePlate::standard())
}

/// Returns every phantom once and every trajectory at least once; the first three are swept in
/// full.
pub(crate) fn plans() -> Vec<Plan> {
    let oblique = || Scene::Plane(Plane::standard(DVec3::new(0.4, 0.5, 1.0)));
    let sheet = || Scene::ThinSheet(ThinSheet::standard(DVec3::new(0.3, 1.0, 0.4)));
    vec![
        Plan { sweep: true, ..plan("blobs-freehand", "Blobs, by hand", blobs, Motion::Freehand) },
        Plan { sweep: true, ..plan("sphere-jittered", "Sphere, uneven gaps", sphere, Motion::Jittered) },
        Plan {
            sweep: true,
            gap_mm: SPARSE_GAP_MM,
            ..plan("zone-plate-sparse", "Zone plate, gaps of 2 σ", zone_plate, Motion::Parallel)
        },
        plan("waves-parallel", "Sinusoids, even gaps", || Scene::Waves(Waves::standard()), Motion::Parallel),
        plan("edge-fan", "Plane edge, tilted sweep", oblique, Motion::Fan { axis_distance_mm: 40.0 }),
        plan("wires-freehand", "Wires, by hand", || Scene::Wires(Wires::standard()), Motion::Freehand),
        plan("sheet-jittered", "Thin sheet, uneven gaps", sheet, Motion::Jittered),
        plan(
            "marschner-lobb",
            "Marschner–Lobb, by hand",
            || Scene::MarschnerLobb(MarschnerLobb::standard()),
            Motion::Freehand,
        ),
        plan(
            "speckle-freehand",
            "Speckle, by hand",
            || Scene::Speckle(Speckle::draw(1, Speckle::STANDARD_PITCH_MM)),
            Motion::Freehand,
        ),
        plan("ramp-jittered", "Ramp, uneven gaps", Scene::standard_ramp, Motion::Jittered),
        plan("constant-arm", "Constant, by the arm", || Scene::Constant(128.0), Motion::Arm),
        plan("blobs-crossing", "Blobs, crossing sweeps", blobs, Motion::Crossing),
        erring("sphere-tracker-small", "Sphere, tracker ±0.1 mm, 0.1°", 0.1, 0.1),
        erring("sphere-tracker-large", "Sphere, tracker ±0.5 mm, 0.5°", 0.5, 0.5),
    ]
}

/// Positions and the correct values there, grey levels.
#[derive(Default)]
pub(crate) struct Probes {
    pub(crate) places: Vec<DVec3>,
    /// The scene.
    pub(crate) truth: Vec<f32>,
    /// The scene under the default kernel's effective width.
    pub(crate) blurred: Vec<f32>,
    /// The default kernel's equations in f64 at the same positions.
    pub(crate) oracle: Vec<f32>,
    /// Gradient of `blurred`, grey levels per mm; empty if it is not needed.
    pub(crate) slope: Vec<DVec3>,
}

/// A scan, ready for reconstruction and comparison.
pub(crate) struct Stage {
    pub(crate) plan: Plan,
    pub(crate) scan: Scan,
    pub(crate) slices: Vec<Slice>,
    /// Positions with slices on both sides beyond every support.
    pub(crate) inside: Probes,
    /// Positions where the default kernel's weight is less than half the median inside.
    pub(crate) boundary: Probes,
}

impl Stage {
    /// Simulates the scan and computes the correct values.
    ///
    /// # Errors
    /// If a phantom cannot be made, or no position is inside.
    pub(crate) fn new(plan: Plan) -> Result<Self, Box<dyn Error>> {
        // Crossing sweeps take half of the frames each.
        let sweeps = if plan.motion == Motion::Crossing { 2 } else { 1 };
        let frames = sweeps * ((SWEEP_MM / plan.gap_mm) as u32 + 1);
        let scan = Scan::new(ScanSettings {
            scene: (plan.scene)(),
            motion: plan.motion,
            frames,
            gap_mm: plan.gap_mm,
            image_size: PICTURE,
            pixel_mm: [PIXEL_MM; 2],
            tracker_noise: plan.tracker,
            ..ScanSettings::default()
        })?;
        let slices = scan.slices(0..frames);
        let kernels = default_kernels([PIXEL_MM; 2], None)?;
        let kernel = EffectiveKernel::new(kernels.map(|k| k.sigma_effective_mm()))?;
        let middle = probe_grid(24, 0.83);
        let poses: Vec<_> = (0..frames).map(|f| scan.true_world_from_image(f)).collect();
        let (oracle, weights) = oracle(middle, &slices, &scan, &kernels);
        let places = places(&middle);
        let is_inside: Vec<bool> = places.iter().map(|p| inside(*p, &poses)).collect();
        let inside = Probes {
            slope: slopes(&scan, &kernel, middle, &is_inside)?,
            ..answers(&scan, &kernel, middle, &oracle, |i| is_inside[i])?
        };
        let mut typical: Vec<f64> = weights.iter().zip(&is_inside).filter(|(_, i)| **i).map(|(w, _)| *w).collect();
        typical.sort_by(f64::total_cmp);
        let median = *typical.get(typical.len() / 2).ok_or_else(|| format!("{}: no place is inside", plan.title))?;
        let whole = probe_grid(26, 1.37);
        let (oracle, weights) = self::oracle(whole, &slices, &scan, &kernels);
        let boundary = answers(&scan, &kernel, whole, &oracle, |i| !oracle[i].is_nan() && weights[i] < 0.5 * median)?;
        Ok(Self { plan, scan, slices, inside, boundary })
    }
}

/// Returns a cube of positions about the world's origin, rotated so that its offsets to the
/// voxel lattice vary.
fn probe_grid(edge: u64, spacing: f64) -> Grid {
    let direction = DMat3::from_quat(DQuat::from_euler(EulerRot::ZYX, 0.31, -0.22, 0.17));
    let half = DVec3::splat(0.5 * spacing * (edge - 1) as f64);
    Grid { origin: direction * -half, spacing: DVec3::splat(spacing), direction, size: [edge; 3] }
}

fn places(grid: &Grid) -> Vec<DVec3> {
    let [nx, ny, nz] = grid.size;
    let to_world = grid.world_from_volume();
    (0..nx * ny * nz)
        .map(|i| to_world.point(DVec3::new((i % nx) as f64, (i / nx % ny) as f64, (i / (nx * ny)) as f64)))
        .collect()
}

/// Returns whether every sweep near a position has slices on both sides of it, with frames that
/// reach beyond it.
fn inside(place: DVec3, poses: &[Transform<World, ImageFrame>]) -> bool {
    let normal = poses[0].affine().matrix3.z_axis;
    let last = PICTURE.map(|n| f64::from(n - 1));
    let border = FROM_BORDER_MM / PIXEL_MM;
    // Sweeps differ by the direction of their slices.
    let (mut low, mut high, mut near, mut beside) = ([f64::MAX; 2], [f64::MIN; 2], [false; 2], false);
    for pose in poses {
        let sweep = usize::from(pose.affine().matrix3.z_axis.dot(normal) < 0.7);
        let foot = pose.inverse().point(place);
        let within = |slack: f64| (0..2).all(|a| foot[a] >= slack && foot[a] <= last[a] - slack);
        if foot.z.abs() <= BOTH_SIDES_MM && within(-border) {
            near[sweep] = true;
            beside |= !within(border);
        }
        (low[sweep], high[sweep]) = (low[sweep].min(foot.z), high[sweep].max(foot.z));
    }
    let between = |sweep: usize| low[sweep] <= -BOTH_SIDES_MM && high[sweep] >= BOTH_SIDES_MM;
    !beside && near.contains(&true) && (0..2).all(|sweep| !near[sweep] || between(sweep))
}

/// Returns value (NaN if unseen) and weight of the default kernel's equations in f64 at each
/// position.
fn oracle(grid: Grid, slices: &[Slice], scan: &Scan, kernels: &[AxisKernel; 3]) -> (Vec<f32>, Vec<f64>) {
    let mut reference = Reference::new(grid);
    for slice in slices {
        reference.insert(slice, scan.mask(), kernels);
    }
    let values = (0..reference.w.len()).map(|i| reference.value(i).map_or(f32::NAN, |v| v as f32)).collect();
    (values, reference.w)
}

fn answers(
    scan: &Scan,
    kernel: &EffectiveKernel,
    grid: Grid,
    oracle: &[f32],
    chosen: impl Fn(usize) -> bool,
) -> Result<Probes, Box<dyn Error>> {
    let pick = |all: &[f32]| all.iter().enumerate().filter(|(i, _)| chosen(*i)).map(|(_, v)| *v).collect();
    Ok(Probes {
        places: places(&grid).into_iter().enumerate().filter(|(i, _)| chosen(*i)).map(|(_, p)| p).collect(),
        truth: pick(&truth::sample(&scan.settings().scene, &grid)?),
        blurred: pick(&blur::sample_under(scan, kernel, &grid, 0)?),
        oracle: pick(oracle),
        slope: Vec::new(),
    })
}

/// Returns differences of the blurred truth at the chosen positions of a grid.
fn slopes(scan: &Scan, kernel: &EffectiveKernel, grid: Grid, chosen: &[bool]) -> Result<Vec<DVec3>, Box<dyn Error>> {
    let mut slopes = vec![DVec3::ZERO; chosen.iter().filter(|c| **c).count()];
    for axis in 0..3 {
        for side in [-1.0, 1.0] {
            let moved = Grid { origin: grid.origin + DVec3::AXES[axis] * (side * STEP_MM), ..grid };
            let values = blur::sample_under(scan, kernel, &moved, 0)?;
            let values = values.iter().zip(chosen).filter(|(_, c)| **c).map(|(v, _)| f64::from(*v));
            for (slope, value) in slopes.iter_mut().zip(values) {
                slope[axis] += side * value / (2.0 * STEP_MM);
            }
        }
    }
    Ok(slopes)
}
