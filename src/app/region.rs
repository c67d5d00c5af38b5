//! The region of a volume that grows from a seed.

use std::path::Path;

use serde::Serialize;

use export::dicom::Identifiers;
use segment::region::{Counts, FloodWork};
use segment::{Growth, Region, label};
use volume::{DenseVolume, Values};

use super::input::{hash, name_of};
use super::labels::{Form, Origin, RegionMesh, mesh, write_labels};
use super::volume_input::{FRAME_FIELD, INPUT_FIELD, dense, field};
use crate::failure::Failure;

/// A region to be found.
pub(crate) struct Request<'a> {
    pub(crate) volume: &'a Path,
    pub(crate) weights: Option<&'a Path>,
    pub(crate) output: Option<&'a Path>,
    /// Its grey level is that of the volume.
    pub(crate) growth: Growth,
    /// Those of a DICOM file.
    pub(crate) identifiers: Identifiers,
    pub(crate) threads: usize,
    /// Memory limit for the volume and the region, bytes.
    pub(crate) memory_bytes: u64,
}

/// A region, in its JSON form.
#[derive(Debug, Serialize)]
pub(crate) struct Made {
    version: &'static str,
    /// World mm.
    seed: [f64; 3],
    /// Lowest and highest smoothed value.
    range: [f32; 2],
    smoothing_mm: f64,
    opening_mm: f64,
    volume_mm3: f64,
    /// Half of the border's voxels: a border that lies up to half a voxel elsewhere, and nothing
    /// else.
    border_error_mm3: f64,
    #[serde(flatten)]
    counts: Counts,
    /// `null` unless a mesh was written.
    mesh: Option<RegionMesh>,
    work: FloodWork,
    pub(crate) notes: Vec<String>,
}

impl Made {
    /// Returns the region in words.
    pub(crate) fn text(&self) -> String {
        let [low, high] = self.range;
        let mut text = format!(
            "{:.3} ml ± {:.3} ml if its border lies half a voxel elsewhere, {} voxels of {low} to {high}",
            self.volume_mm3 / 1000.0,
            self.border_error_mm3 / 1000.0,
            self.counts.voxels
        );
        if let Some(mesh) = &self.mesh {
            text += &format!("; {} triangles, {}", mesh.triangles, mesh.measures.text());
        }
        text
    }
}

impl Request<'_> {
    /// Finds the region, and writes it.
    ///
    /// # Errors
    /// [`Failure`] when the volume cannot be read, there is no region, memory does not suffice, or
    /// the file cannot be written.
    pub(crate) fn run(&self) -> Result<Made, Failure> {
        let form = self.output.map(Form::of).transpose()?;
        let volume = dense(self.volume, self.weights, self.memory_bytes)?;
        let left = self.memory_bytes.saturating_sub(volume.bytes());
        let pool = rayon::ThreadPoolBuilder::new().num_threads(self.threads).build()?;
        pool.install(|| self.make(&volume, form, left))
    }

    fn make(&self, volume: &DenseVolume, form: Option<Form>, limit_bytes: u64) -> Result<Made, Failure> {
        let [black, white] = volume.range();
        let growth = Growth { grey_level: (white - black) / 255.0, ..self.growth.clone() };
        let world_from_lattice = volume.world_from_lattice();
        let region = growth.grow(volume, world_from_lattice, limit_bytes)?;
        let settings = settings(&growth, &region);
        let text = |name: &str| field(&volume.header().fields, name);
        let origin = Origin {
            input: self.input(text(INPUT_FIELD))?,
            frame: text(FRAME_FIELD).unwrap_or("World (mm, not anatomical)").to_owned(),
            settings: &settings,
        };
        let mut made = Made {
            version: env!("CARGO_PKG_VERSION"),
            seed: growth.seed.to_array(),
            range: region.range,
            smoothing_mm: region.smoothing_mm,
            opening_mm: growth.opening_mm,
            volume_mm3: region.volume_mm3,
            border_error_mm3: region.error_mm3,
            counts: region.counts,
            mesh: None,
            work: region.work,
            notes: volume.notes().to_vec(),
        };
        if region.counts.unseen_faces > 0 {
            made.notes.push(format!(
                "the region ends at unseen voxels by {} faces, and may continue there",
                region.counts.unseen_faces
            ));
        }
        if let Some((path, form)) = self.output.zip(form) {
            let rows = label_rows(volume, &region);
            write_labels((path, form), volume.header(), &origin, &self.identifiers, rows)?;
            if let Form::Mesh(format) = form {
                let field = region.field()?;
                made.mesh = Some(mesh(&field, world_from_lattice, limit_bytes, Some((path, format)), &origin)?);
            }
        }
        Ok(made)
    }

    /// Returns the name and the hash of the recording by the volume's header, else those of the
    /// volume's file.
    fn input(&self, recorded: Option<&str>) -> Result<String, Failure> {
        match recorded {
            Some(input) if input.contains(" sha256 ") || !self.volume.is_file() => Ok(input.to_owned()),
            None if !self.volume.is_file() => Ok(name_of(self.volume)),
            _ => Ok(format!("{} sha256 {}", name_of(self.volume), hash(self.volume)?)),
        }
    }
}

/// Returns the labels of the volume's rows, in the order of its file.
fn label_rows<'a>(volume: &'a DenseVolume, region: &'a Region) -> impl FnMut(u32, u32, &mut [u8]) + 'a {
    let width = volume.header().size[0] as usize;
    let (mut values, mut weights) = (vec![0.0; width], vec![0.0; width]);
    move |y, z, labels| {
        let start = volume.index([0, i64::from(y), i64::from(z)]);
        volume.values(start, &mut values, &mut weights);
        for (x, (label, weight)) in labels.iter_mut().zip(&weights).enumerate() {
            *label = match region.contains([start[0] + x as i64, start[1], start[2]]) {
                true => label::REGION,
                false if *weight > 0.0 => label::OUTSIDE,
                false => label::UNSEEN,
            };
        }
    }
}

/// Returns the settings of a region in words.
fn settings(growth: &Growth, region: &Region) -> String {
    let ([x, y, z], [low, high]) = (growth.seed.to_array(), region.range);
    format!(
        "region from {x}, {y}, {z} mm, values {low} to {high}, smoothed by {} mm, opened by {} mm",
        region.smoothing_mm, growth.opening_mm
    )
}
