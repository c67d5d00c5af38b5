//! A surface of a volume: its mesh, area and volume.

use std::path::Path;

use serde::Serialize;

use formats::whole::write_whole;
use render::crop::{Crop, Cropped, LatticeCrop};
use sonoweave_core::NOTICE;
use surface::measure::{area_mm2, volume_mm3};
use surface::parts::parts;
use surface::{Compensation, Format, Mesh, SurfaceError, SurfaceWork, Topology, compensate, extract};
use volume::DenseVolume;

use super::volume_input::{FRAME_FIELD, INPUT_FIELD, dense, field};
use crate::app::input::name_of;
use crate::failure::{Failure, FailureKind};

/// Header field with the kernel's standard deviations along u, v and the normal, mm.
const SIGMA_FIELD: &str = "SonoweaveSigmaMm";

/// A blur for which the surface is moved back.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Blur {
    /// Standard deviation, mm.
    Mm(f64),
    /// That of the volume's kernel, by its header.
    Kernel,
}

/// A surface to be made.
pub(crate) struct Request<'a> {
    pub(crate) volume: &'a Path,
    pub(crate) weights: Option<&'a Path>,
    pub(crate) output: Option<&'a Path>,
    /// Grey value; `None` for halfway between black and white.
    pub(crate) isovalue: Option<f32>,
    pub(crate) crop: Crop,
    /// Whether only the largest part is kept.
    pub(crate) largest: bool,
    pub(crate) blur: Option<Blur>,
    pub(crate) threads: usize,
    /// Memory limit for volume and mesh, bytes.
    pub(crate) memory_bytes: u64,
}

/// The measures of a mesh.
#[derive(Debug, Serialize)]
pub(crate) struct Measures {
    area_mm2: f64,
    /// `null` for an open surface.
    pub(crate) volume_mm3: Option<f64>,
}

/// A surface, in its JSON form.
#[derive(Debug, Serialize)]
pub(crate) struct Made {
    version: &'static str,
    isovalue: f32,
    vertices: u64,
    triangles: u64,
    /// Bodies apart from each other in the mesh.
    parts: u64,
    closed: bool,
    /// Edges with a triangle on one side only: coverage or a cut ends the surface there.
    open_edges: u64,
    euler_number: i64,
    /// The surface between the voxels.
    #[serde(flatten)]
    measures: Measures,
    /// Standard deviation of the blur, mm, and the surface that was moved back by it.
    blur_mm: Option<f64>,
    compensated: Option<Measures>,
    /// Vertices that were moved, and those that were not.
    moved: Option<u64>,
    unmoved: Option<u64>,
    work: SurfaceWork,
    pub(crate) notes: Vec<String>,
}

impl Measures {
    pub(crate) fn of(mesh: &Mesh, topology: &Topology) -> Self {
        Self { area_mm2: area_mm2(mesh), volume_mm3: volume_mm3(mesh, topology).ok() }
    }

    pub(crate) fn text(&self) -> String {
        let area = format!("area {:.2} cm²", self.area_mm2 / 100.0);
        match self.volume_mm3 {
            Some(volume) => format!("{area}, volume {:.3} ml", volume / 1000.0),
            None => area,
        }
    }
}

impl Made {
    /// Returns the surface in words.
    pub(crate) fn text(&self) -> String {
        let parts = if self.parts == 1 { "1 part".into() } else { format!("{} parts", self.parts) };
        let mut text = format!("{} triangles in {parts}, {}", self.triangles, self.measures.text());
        if let (Some(compensated), Some(blur_mm)) = (&self.compensated, self.blur_mm) {
            text += &format!("; moved back by a blur of {blur_mm:.2} mm: {}", compensated.text());
        }
        if !self.closed {
            text += &format!("; open at {} edges, where coverage ends: it encloses no volume", self.open_edges);
        }
        text
    }
}

impl Request<'_> {
    /// Makes the surface, and writes it.
    ///
    /// # Errors
    /// [`Failure`] when the volume cannot be read, there is no surface, memory does not suffice, or
    /// the mesh cannot be written.
    pub(crate) fn run(&self) -> Result<Made, Failure> {
        let volume = dense(self.volume, self.weights, self.memory_bytes)?;
        let left = self.memory_bytes.saturating_sub(volume.bytes());
        let pool = rayon::ThreadPoolBuilder::new().num_threads(self.threads).build()?;
        pool.install(|| self.make(&volume, left))
    }

    fn make(&self, volume: &DenseVolume, limit_bytes: u64) -> Result<Made, Failure> {
        let world_from_lattice = volume.placed().world_from_lattice();
        let crop = LatticeCrop::new(self.crop.present(), world_from_lattice.affine());
        let seen = Cropped::new(volume, &crop);
        let [black, white] = volume.range();
        let isovalue = self.isovalue.unwrap_or(0.5 * (black + white));
        let (mut mesh, work) = extract(&seen, isovalue, world_from_lattice, limit_bytes)?;
        if mesh.is_empty() {
            return Err(SurfaceError::Empty.into());
        }
        if self.largest {
            mesh = parts(&mesh).into_iter().next().unwrap_or(mesh);
        }
        let topology = Topology::of(&mesh);
        let measures = Measures::of(&mesh, &topology);
        let blur_mm = self.blur.map(|blur| blur_mm(blur, volume, self.volume)).transpose()?;
        let mut made = Made {
            version: env!("CARGO_PKG_VERSION"),
            isovalue,
            vertices: topology.vertices,
            triangles: topology.triangles,
            parts: topology.components,
            closed: topology.is_closed(),
            open_edges: topology.open_edges,
            euler_number: topology.euler_number(),
            measures,
            blur_mm,
            compensated: None,
            moved: None,
            unmoved: None,
            work,
            notes: volume.notes().to_vec(),
        };
        if let Some(blur_mm) = blur_mm {
            let (moved, Compensation { moved: count, too_curved, undetermined }) =
                compensate(&mesh, &seen, world_from_lattice, blur_mm * blur_mm)?;
            made.compensated = Some(Measures::of(&moved, &topology));
            (made.moved, made.unmoved) = (Some(count), Some(too_curved + undetermined));
            mesh = moved;
        }
        if let Some(path) = self.output {
            let (format, provenance) = (Format::of(path)?, self.provenance(volume, &made));
            write_whole(path, |to| format.write(&mesh, &provenance, to))
                .map_err(|error| Failure::io(path, "writing", &error))?;
        }
        Ok(made)
    }

    /// Returns the origin of the mesh, for its file.
    fn provenance(&self, volume: &DenseVolume, made: &Made) -> String {
        let input = field(&volume.header().fields, INPUT_FIELD).map_or_else(|| name_of(self.volume), str::to_owned);
        let frame = field(&volume.header().fields, FRAME_FIELD).unwrap_or("World (mm, not anatomical)");
        let blur = made.blur_mm.map_or_else(String::new, |mm| format!(", moved back by a blur of {mm} mm"));
        format!(
            "sonoweave {}: grey value {} of {input}{blur}; frame {frame}. {NOTICE}",
            env!("CARGO_PKG_VERSION"),
            made.isovalue
        )
    }
}

/// Returns the standard deviation of a blur, mm. A kernel that differs along the axes counts by the
/// mean of its variances.
fn blur_mm(blur: Blur, volume: &DenseVolume, path: &Path) -> Result<f64, Failure> {
    let Blur::Mm(mm) = blur else {
        let numbers: Option<Vec<f64>> = field(&volume.header().fields, SIGMA_FIELD)
            .and_then(|text| text.split_whitespace().map(|number| number.parse().ok()).collect());
        return match numbers.as_deref() {
            Some([u, v, n]) => Ok(((u * u + v * v + n * n) / 3.0).sqrt()),
            _ => Err(Failure::new(format!(
                "--blur kernel: {} has no {SIGMA_FIELD} in its header; give the blur in mm",
                path.display()
            ))
            .of(FailureKind::Usage)),
        };
    };
    Ok(mm)
}
