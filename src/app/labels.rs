//! Regions as files: label volumes, DICOM segmentations and meshes.

use std::io::Write as _;
use std::path::Path;

use serde::Serialize;

use export::ExportError;
use export::dicom::Identifiers;
use export::dicom::segmentation::Segmentation;
use formats::image::write::VolumeWriter;
use formats::image::{Container, VolumeHeader};
use formats::whole::write_whole;
use segment::field::Field;
use segment::label;
use sonoweave_core::NOTICE;
use sonoweave_core::frames::{Transform, Volume, World};
use sonoweave_core::reading::PixelType;
use surface::{Format, Topology, extract};
use volume::dense::{RANGE_FIELD, UNSEEN_FIELD};
use volume::placed::PlacedHeader;

use super::input::is_dicom;
use super::surface::Measures;
use super::volume_input::{FRAME_FIELD, INPUT_FIELD};
use crate::failure::Failure;

/// Field of ITK's readers and writers, by which other programs know an anatomical world.
const ORIENTATION_FIELD: &str = "AnatomicalOrientation";

/// Form in which a file holds a region.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Form {
    /// A label volume.
    Labels,
    /// A DICOM segmentation.
    Dicom,
    /// A mesh of its surface.
    Mesh(Format),
}

impl Form {
    /// Returns the form that a file's name asks for.
    ///
    /// # Errors
    /// [`Failure`] for any other name.
    pub(crate) fn of(path: &Path) -> Result<Self, Failure> {
        if Container::of_volume(path).is_ok() {
            return Ok(Self::Labels);
        }
        if is_dicom(path) {
            return Ok(Self::Dicom);
        }
        Format::of(path).map(Self::Mesh).map_err(|_| {
            let volumes = Container::VOLUMES.replace(" or ", ", ");
            Failure::usage(format!(
                "{}: the name of a region's file must end in {volumes}, .dcm, .stl, .ply, .obj or .glb",
                path.display()
            ))
        })
    }
}

/// Origin of a region, for its file.
pub(crate) struct Origin<'a> {
    /// The volume or the contours, with the SHA-256 of the recording or of the file.
    pub(crate) input: String,
    /// Frame of reference.
    pub(crate) frame: String,
    /// The settings in words.
    pub(crate) settings: &'a str,
}

/// Writes the labels of the voxels of `of`, by the form that the file's name asks for; a mesh is
/// written by [`mesh`]. `row(y, z, labels)` gives those of a row. `identifiers` are those of a
/// DICOM file.
///
/// # Errors
/// [`Failure`]: nothing is written then.
pub(crate) fn write_labels(
    (path, form): (&Path, Form),
    of: &VolumeHeader,
    origin: &Origin,
    identifiers: &Identifiers,
    mut row: impl FnMut(u32, u32, &mut [u8]),
) -> Result<(), Failure> {
    match form {
        Form::Mesh(_) => return Ok(()),
        Form::Dicom => return write_dicom(path, of, origin, identifiers, row),
        Form::Labels => {}
    }
    let header =
        VolumeHeader { pixel: PixelType::U8, compressed: true, fields: fields(path, of, origin), ..of.clone() };
    let mut file = VolumeWriter::create(path, &header)?;
    let [nx, ny, nz] = header.size;
    let mut labels = vec![label::OUTSIDE; nx as usize];
    for (z, y) in (0..nz).flat_map(|z| (0..ny).map(move |y| (z, y))) {
        row(y, z, &mut labels);
        file.write_all(&labels).map_err(|source| ExportError::Write { path: path.to_owned(), source })?;
    }
    Ok(file.finish()?)
}

fn write_dicom(
    path: &Path,
    of: &VolumeHeader,
    origin: &Origin,
    identifiers: &Identifiers,
    mut row: impl FnMut(u32, u32, &mut [u8]),
) -> Result<(), Failure> {
    let grid = PlacedHeader::new(of.clone()).grid();
    let region = Segmentation {
        grid: &grid,
        settings: origin.settings,
        recording: origin.input.rsplit_once(" sha256 ").map_or(origin.input.as_str(), |(_, hash)| hash),
        world: origin.frame.split_once(" (").map_or("World", |(name, _)| name),
        identifiers,
    };
    let mut labels = vec![label::OUTSIDE; of.size[0] as usize];
    let inside = |y: u64, z: u64, inside: &mut [bool]| {
        row(y as u32, z as u32, &mut labels);
        inside.iter_mut().zip(&labels).for_each(|(inside, label)| *inside = *label == label::REGION);
    };
    Ok(region.write(path, inside)?)
}

/// Returns the fields of a label volume. An NRRD has those by which 3D Slicer names segments.
fn fields(path: &Path, of: &VolumeHeader, origin: &Origin) -> Vec<(String, String)> {
    let line = |name: &str, value: &str| (name.to_owned(), value.to_owned());
    let mut fields: Vec<(String, String)> =
        of.fields.iter().filter(|(name, _)| name == ORIENTATION_FIELD).cloned().collect();
    let [outside, region, unseen] = [label::OUTSIDE, label::REGION, label::UNSEEN].map(|label| label.to_string());
    fields.extend([
        line("SonoweaveVersion", env!("CARGO_PKG_VERSION")),
        line(FRAME_FIELD, &origin.frame),
        line(INPUT_FIELD, &origin.input),
        line("SonoweaveRegion", origin.settings),
        line("SonoweaveLabels", &format!("{outside} outside, {region} region, {unseen} unseen")),
        line(UNSEEN_FIELD, &unseen),
        line(RANGE_FIELD, &format!("{outside} {region}")),
    ]);
    if matches!(Container::of(path), Some(Container::Nrrd | Container::Nhdr)) {
        for (number, (name, value, colour)) in
            [("region", region, "0.9 0.7 0.2"), ("unseen", unseen, "0.3 0.3 0.6")].into_iter().enumerate()
        {
            let segment = |key: &str, value: &str| (format!("Segment{number}_{key}"), value.to_owned());
            fields.extend([
                segment("ID", name),
                segment("Name", name),
                segment("LabelValue", &value),
                segment("Layer", "0"),
                segment("Color", colour),
            ]);
        }
    }
    fields
}

/// A mesh of a region, in its JSON form.
#[derive(Debug, Serialize)]
pub(crate) struct RegionMesh {
    pub(crate) triangles: u64,
    closed: bool,
    /// Bodies apart from each other.
    parts: u64,
    #[serde(flatten)]
    pub(crate) measures: Measures,
}

/// Makes the mesh of signed distances, positive inside, and writes it to a path, if there is one.
///
/// # Errors
/// [`Failure`] when memory does not suffice, or the mesh cannot be written.
pub(crate) fn mesh(
    field: &Field,
    world_from_lattice: Transform<World, Volume>,
    limit_bytes: u64,
    to: Option<(&Path, Format)>,
    origin: &Origin,
) -> Result<RegionMesh, Failure> {
    let (mesh, _) = extract(field, 0.0, world_from_lattice, limit_bytes)?;
    if let Some((path, format)) = to {
        let Origin { input, frame, settings } = origin;
        let version = env!("CARGO_PKG_VERSION");
        let provenance = format!("sonoweave {version}: {settings} of {input}; frame {frame}. {NOTICE}");
        write_whole(path, |to| format.write(&mesh, &provenance, to))
            .map_err(|error| Failure::io(path, "writing", &error))?;
    }
    let topology = Topology::of(&mesh);
    Ok(RegionMesh {
        triangles: topology.triangles,
        closed: topology.is_closed(),
        parts: topology.components,
        measures: Measures::of(&mesh, &topology),
    })
}
