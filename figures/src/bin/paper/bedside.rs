//! A simulated scan with echoes, reconstructed and rendered; shared by figures 12 and 13.

use std::error::Error;
use std::sync::Arc;

use glam::DVec3;
use sonoweave_figures::Raster;

use phantom::bmode::Layout;
use phantom::body::{Met, Passage};
use phantom::{Body, Motion, Scan, ScanSettings, Scanner, Scene};
use reconstruct::{PathReconstructor, Settings};
use render::camera::{Camera, View};
use render::classify::transfer::Transfer;
use render::{Cache, Mode, Picture, RenderRegion, RenderSettings, Renderer};

use crate::reconstructed_volumes::value;

/// A body, scanned and reconstructed.
pub(crate) struct Bedside {
    pub(crate) scan: Scan,
    pub(crate) body: Arc<Body>,
    pub(crate) reconstructor: PathReconstructor,
    spacing: DVec3,
}

/// Settings of the scan.
pub(crate) struct Sweep {
    pub(crate) motion: Motion,
    pub(crate) frames: u32,
    pub(crate) gap_mm: f64,
    pub(crate) image_size: [u32; 2],
}

impl Bedside {
    /// Scans a body and inserts the slices into voxels of `spacing` mm. The kernel's σ across
    /// the slices is half of their distance.
    pub(crate) fn new(body: Body, scanner: Scanner, sweep: &Sweep, spacing: DVec3) -> Result<Self, Box<dyn Error>> {
        let pixel = scanner.pixel_mm(sweep.image_size);
        let layout = Layout::new(&scanner, sweep.image_size, [pixel; 2])?;
        let body = Arc::new(body.placed_at(layout.face_below_middle_mm()));
        let scan = Scan::new(ScanSettings {
            scene: Scene::Body(body.clone()),
            scanner: Some(scanner),
            motion: sweep.motion,
            frames: sweep.frames,
            gap_mm: sweep.gap_mm,
            image_size: sweep.image_size,
            pixel_mm: [pixel; 2],
            noise_sd: 0.0,
            ..ScanSettings::default()
        })?;
        let settings =
            Settings { sigma_mm: [None, None, Some(0.5 * sweep.gap_mm)], threads: 2, ..Settings::new(spacing) };
        let mut reconstructor = PathReconstructor::general(settings, scan.mask().clone())?;
        for first in (0..sweep.frames).step_by(8) {
            for slice in scan.slices(first..sweep.frames.min(first + 8)) {
                reconstructor.insert(&slice)?;
            }
        }
        Ok(Self { scan, body, reconstructor, spacing })
    }

    /// Returns a frame as the scanner shows it.
    pub(crate) fn painted(&self, frame: u32) -> Result<Raster, Box<dyn Error>> {
        let bmode = self.scan.bmode().ok_or("a scan of echoes")?;
        let size = self.scan.settings().image_size;
        let mut picture = vec![0; size[0] as usize * size[1] as usize];
        self.scan.paint_echoes(frame, &mut bmode.workspace(), &mut picture);
        Raster::grey(size, &picture).ok_or_else(|| "a picture fills its size".into())
    }

    fn voxel(&self, at: [i64; 3]) -> Option<f64> {
        value(self.reconstructor.volume(), at)
    }

    /// Returns the value of the voxel nearest to a position in the body; `None` if unseen.
    pub(crate) fn at(&self, body: DVec3) -> Option<f64> {
        let world = self.body.world_from_body.transform_point3(body);
        let lattice = self.reconstructor.world_from_lattice().affine().inverse().transform_point3(world).round();
        self.voxel(lattice.to_array().map(|x| x as i64))
    }

    /// Returns the depth along y of the brightest voxel between two depths, mm of the body;
    /// `None` if unseen.
    pub(crate) fn brightest(&self, [x, z]: [f64; 2], [from, to]: [f64; 2]) -> Option<f64> {
        let depths = (0..).map(|k| from + 0.1 * f64::from(k)).take_while(|y| *y <= to);
        let shown: Vec<(f64, f64)> = depths.filter_map(|y| Some((self.at(DVec3::new(x, y, z))?, y))).collect();
        let most = shown.iter().map(|(v, _)| *v).reduce(f64::max)?;
        // A voxel occupies a range of depths; the middle is returned.
        let at: Vec<f64> = shown.iter().filter(|(v, _)| *v == most).map(|(_, y)| *y).collect();
        Some(at.iter().sum::<f64>() / at.len() as f64)
    }

    /// Returns the gradient at a voxel, grey levels per mm, by central differences; `None` next
    /// to unseen voxels.
    fn gradient(&self, at: [i64; 3]) -> Option<f64> {
        let mut squared = 0.0;
        for axis in 0..3 {
            let beside = |step: i64| self.voxel(std::array::from_fn(|a| at[a] + if a == axis { step } else { 0 }));
            let slope = (beside(1)? - beside(-1)?) / (2.0 * self.spacing[axis]);
            squared += slope * slope;
        }
        Some(squared.sqrt())
    }

    /// Returns the volume's x-y slice at a z (mm of the world), as grey levels and as opacities
    /// by a transfer function. Pixels are square.
    pub(crate) fn slice(&self, z_mm: f64, transfer: &Transfer) -> Result<[Raster; 2], Box<dyn Error>> {
        let (low, high) = self.reconstructor.volume().seen_bounds().ok_or("nothing was seen")?;
        let z = (z_mm / self.spacing.z).round() as i64;
        let pixel = self.spacing.x.min(self.spacing.y);
        let length = |axis: usize| (((high[axis] - low[axis]) as f64 * self.spacing[axis] / pixel) as i64).max(1);
        let [wide, tall] = [length(0), length(1)];
        let (mut greys, mut opacities) = (Vec::new(), Vec::new());
        for (j, i) in (0..tall).flat_map(|j| (0..wide).map(move |i| (j, i))) {
            let index = |n: i64, axis: usize| low[axis] + (n as f64 * pixel / self.spacing[axis]).round() as i64;
            let at = [index(i, 0), index(j, 1), z];
            let seen = self.voxel(at);
            greys.push(seen.map_or(0, |v| v.round() as u8));
            let opacity = seen.zip(self.gradient(at)).map_or(0.0, |(v, slope)| transfer.alpha(v, slope));
            opacities.push((255.0 * opacity).round() as u8);
        }
        let size = [wide as u32, tall as u32];
        let raster = |pixels: &[u8]| Raster::grey(size, pixels).ok_or("a slice fills its size");
        Ok([raster(&greys)?, raster(&opacities)?])
    }

    /// Returns the render region: the seen box, limited to depths `y_mm` of the body, so that
    /// nothing in front or behind hides it.
    pub(crate) fn region(&self, y_mm: [f64; 2]) -> Result<RenderRegion, Box<dyn Error>> {
        let (mut low, mut high) = self.reconstructor.volume().seen_bounds().ok_or("nothing was seen")?;
        let world = y_mm.map(|y| self.body.world_from_body.transform_point3(DVec3::new(0.0, y, 0.0)).y);
        low[1] = low[1].max((world[0] / self.spacing.y).ceil() as i64);
        high[1] = high[1].min((world[1] / self.spacing.y).floor() as i64);
        Ok(RenderRegion::new(self.reconstructor.world_from_lattice(), low, high)?)
    }

    /// Renders the volume.
    pub(crate) fn rendered(
        &self,
        region: RenderRegion,
        view: View,
        mode: Mode,
        transfer: &Transfer,
    ) -> Result<Picture, Box<dyn Error>> {
        let view_settings = RenderSettings {
            view,
            mode,
            cache: Cache::None,
            step: 0.5,
            threads: 2,
            ..RenderSettings::new([320; 2], transfer.clone())
        };
        let mut renderer = Renderer::new(&view_settings, region)?;
        renderer.update_all(self.reconstructor.volume());
        Ok(renderer.picture())
    }

    /// Returns for each ray of a rendered picture whether it meets a solid of a material whose name
    /// passes `accepts`, according to the body.
    pub(crate) fn met(
        &self,
        region: &RenderRegion,
        view: &View,
        accepts: impl Fn(&str) -> bool,
    ) -> Result<Vec<bool>, Box<dyn Error>> {
        let camera = Camera::new(view, [320; 2], 0.5, region)?;
        let body_from_stage = self.body.world_from_body.inverse() * region.world_from_region();
        let (mut met, mut passages) = (Met::with_room_for(&self.body), Vec::new());
        let mut hit = |i: u32, j: u32| {
            let ray = camera.ray(i, j);
            let origin = body_from_stage.transform_point3(ray.base);
            let direction = body_from_stage.transform_vector3(ray.step).normalize();
            self.body.trace(origin, direction, 1e3, &mut met, &mut passages);
            passages.iter().any(|p: &Passage| accepts(self.body.materials[usize::from(p.to)].name))
        };
        Ok((0..320).flat_map(|j| (0..320).map(move |i| (i, j))).map(|(i, j)| hit(i, j)).collect())
    }
}

/// Returns a rendered picture on black.
pub(crate) fn shown(picture: &Picture) -> Result<Raster, Box<dyn Error>> {
    Raster::rgb(picture.size, picture.over([0.0; 3])).ok_or_else(|| "a picture fills its size".into())
}

/// Returns the median and the 90th percentile.
pub(crate) fn middle_and_ninth(mut values: Vec<f64>) -> [f64; 2] {
    values.sort_by(f64::total_cmp);
    let at = |part: f64| values.get((part * values.len() as f64) as usize).copied().unwrap_or(f64::NAN);
    [at(0.5), at(0.9)]
}
