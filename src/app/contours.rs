//! The body between contours on planes.

use std::path::Path;

use serde::Serialize;

use export::dicom::Identifiers;
use formats::image::VolumeHeader;
use segment::body::Lattice;
use segment::planimetry::{cubic_mm3, straight_mm3};
use segment::{Body, Contours, label};
use sonoweave_core::reading::PixelType;

use super::input::{hash, name_of};
use super::labels::{Form, Origin, RegionMesh, mesh, write_labels};
use crate::failure::Failure;

/// Difference of both volumes above which a note warns.
const APART: f64 = 0.03;

/// A body to be made.
pub(crate) struct Request<'a> {
    path: &'a Path,
    output: Option<(&'a Path, Form)>,
    contours: Contours,
    lattice: Lattice,
    identifiers: Identifiers,
    threads: usize,
    memory_bytes: u64,
}

/// A body, in its JSON form.
#[derive(Debug, Serialize)]
pub(crate) struct Made {
    version: &'static str,
    contours: usize,
    /// Pairs of contours that were moved along the line between their largest discs.
    moved_pairs: usize,
    spacing_mm: f64,
    /// The surface between the contours.
    mesh: RegionMesh,
    /// Volume by areas and centroids that are cubic between the contours, and straight.
    planimetry_mm3: f64,
    straight_planimetry_mm3: f64,
    pub(crate) notes: Vec<String>,
}

impl Made {
    /// Returns the body in words.
    pub(crate) fn text(&self) -> String {
        let [cubic, straight] = [self.planimetry_mm3, self.straight_planimetry_mm3].map(|mm3| mm3 / 1000.0);
        format!(
            "{} triangles between {} contours, {}; by their areas {cubic:.3} ml (straight between them: {straight:.3} ml)",
            self.mesh.triangles,
            self.contours,
            self.mesh.measures.text()
        )
    }
}

impl<'a> Request<'a> {
    /// Reads contours, and plans the body's voxels of edge `spacing_mm`; `None` for a hundredth of
    /// the body's longest edge. `identifiers` are those of a DICOM file.
    ///
    /// # Errors
    /// [`Failure`] when the contours cannot be used, or there are too many voxels.
    pub(crate) fn new(
        path: &'a Path,
        output: Option<&'a Path>,
        spacing_mm: Option<f64>,
        identifiers: Identifiers,
        (threads, memory_bytes): (usize, u64),
    ) -> Result<Self, Failure> {
        let output = output.map(|path| Ok::<_, Failure>((path, Form::of(path)?))).transpose()?;
        let contours = Contours::read(path)?;
        let lattice = Lattice::around(&contours, spacing_mm)?;
        Ok(Self { path, output, contours, lattice, identifiers, threads, memory_bytes })
    }

    /// Returns the voxels and their memory in words, before they are made.
    pub(crate) fn plan(&self) -> String {
        let size = self.lattice.size.map(|n| n.to_string()).join("×");
        let mib = self.lattice.bytes().div_ceil(1 << 20);
        format!("{size} voxels of {:.4} mm take {mib} MiB", self.lattice.spacing_mm)
    }

    /// Makes the body, and writes it.
    ///
    /// # Errors
    /// [`Failure`] when memory does not suffice, or the file cannot be written.
    pub(crate) fn run(&self) -> Result<Made, Failure> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(self.threads).build()?;
        pool.install(|| self.make())
    }

    fn make(&self) -> Result<Made, Failure> {
        let Self { contours, lattice, .. } = self;
        let body = Body::new(contours);
        let field = body.field(lattice, self.memory_bytes)?;
        let count = contours.list().len();
        let settings = format!("body between {count} contours, voxels of {} mm", lattice.spacing_mm);
        let origin = Origin {
            input: format!("{} sha256 {}", name_of(self.path), hash(self.path)?),
            frame: format!("{} (mm, not anatomical)", contours.frame()),
            settings: &settings,
        };
        let to = self.output.and_then(|(path, form)| match form {
            Form::Mesh(format) => Some((path, format)),
            Form::Labels | Form::Dicom => None,
        });
        let left = self.memory_bytes.saturating_sub(lattice.bytes());
        let mesh = mesh(&field, lattice.world_from_lattice(), left, to, &origin)?;
        if let Some(output) = self.output {
            let size = lattice.size.map(|n| u32::try_from(n).unwrap_or(u32::MAX));
            let header = VolumeHeader {
                spacing: [lattice.spacing_mm; 3],
                origin: lattice.origin.to_array(),
                ..VolumeHeader::new(size, PixelType::U8)
            };
            let [nx, ny, _] = lattice.size;
            write_labels(output, &header, &origin, &self.identifiers, |y, z, labels| {
                let row = &field.in_order()[(z as usize * ny + y as usize) * nx..][..nx];
                let label = |distance: &f32| if *distance >= 0.0 { label::REGION } else { label::OUTSIDE };
                labels.iter_mut().zip(row).for_each(|(to, distance)| *to = label(distance));
            })?;
        }
        let (planimetry_mm3, straight_planimetry_mm3) = (cubic_mm3(contours), straight_mm3(contours));
        let mut notes = Vec::new();
        if let Some(volume) = mesh.measures.volume_mm3
            && (volume / planimetry_mm3 - 1.0).abs() > APART
        {
            notes.push(format!(
                "warning: both volumes are {:.1} % apart; check the contours, or draw more of them",
                100.0 * (volume / planimetry_mm3 - 1.0).abs()
            ));
        }
        Ok(Made {
            version: env!("CARGO_PKG_VERSION"),
            contours: count,
            moved_pairs: body.moved(),
            spacing_mm: lattice.spacing_mm,
            mesh,
            planimetry_mm3,
            straight_planimetry_mm3,
            notes,
        })
    }
}
