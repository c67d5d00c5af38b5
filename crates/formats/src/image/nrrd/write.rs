//! Writes NRRD headers: in the form of PLUS (`.nrrd`, `.igs.nrrd`), of 3D Slicer (`.seq.nrrd`),
//! and of volumes.

use sonoweave_core::reading::PixelType;

use crate::Unwritable;
use crate::image::nrrd::grammar::{GRAMMAR, KEYS, escaped};
use crate::image::numbers::list;
use crate::image::sequence::{IMAGE_TYPE, ORIENTATION};
use crate::image::sequence_header::SequenceHeader;
use crate::image::spacing;
use crate::image::volume_header::VolumeHeader;
use crate::image::write::header::{Style, Text, taken};

/// PLUS uses this name for the image status in NRRD, and reads no other.
static STYLE: Style =
    Style { grammar: &GRAMMAR, separator: ":=", reserved: ':', image_status: "Status", escape: escaped };

/// Program whose form a sequence follows. Only Slicer's form stores the spacing of the frame
/// axis, as the spacing of the images' single slice.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum Habit {
    /// PLUS: images in a plane.
    Plus,
    /// Slicer: images as volumes of one slice, with their times as the index of the list axis.
    Slicer,
}

/// Returns the header of a sequence; `data_file` names the file of its pixels, if they do not
/// follow the header.
pub(crate) fn sequence(
    header: &SequenceHeader,
    compressed: bool,
    habit: Habit,
    data_file: Option<&str>,
) -> Result<Text, Unwritable> {
    let space = if habit == Habit::Slicer { 3 } else { 2 };
    let mut sizes = header.size.to_vec();
    sizes.extend((habit == Habit::Slicer).then_some(1));
    let mut text = begin(header.pixel, header.channels, &sizes, Some(header.items.len()));
    match habit {
        Habit::Plus => structure(&mut text, "space dimension", "2"),
        Habit::Slicer => structure(&mut text, "space", NOT_ANATOMICAL),
    }
    let (spacing, fields) = spacing::split(&header.fields)?;
    let step = |k: usize| (0..space).map(|i| if i == k { spacing[k] } else { 0.0 }).collect::<Vec<f64>>();
    let steps: Vec<Vec<f64>> = (0..space).map(step).collect();
    placed(&mut text, header.channels, &steps, &vec![0.0; space], true);
    packed(&mut text, compressed, data_file);
    if habit == Habit::Slicer {
        index(&mut text, header);
    }
    let SequenceHeader { orientation, image_type, .. } = header;
    text.pictures([(KEYS[0].0, orientation), (KEYS[1].0, image_type)])?;
    debug_assert_eq!((KEYS[0].1, KEYS[1].1), (ORIENTATION, IMAGE_TYPE));
    text.extra(&fields, &taken(orientation, image_type))?;
    for (frame, item) in (0..).zip(&header.items) {
        text.item(frame, item)?;
    }
    text.text.push('\n');
    Ok(text)
}

/// Returns the header of a volume.
pub(crate) fn volume(header: &VolumeHeader, data_file: Option<&str>) -> Result<Text, Unwritable> {
    let mut text = begin(header.pixel, header.channels, &header.size, None);
    // A file with an anatomical orientation came from ITK and has ITK's coordinates.
    let anatomical = header.fields.iter().any(|(name, value)| name == "AnatomicalOrientation" && !value.contains('?'));
    structure(&mut text, "space", if anatomical { "left-posterior-superior" } else { NOT_ANATOMICAL });
    let steps: Vec<Vec<f64>> =
        header.axes.iter().zip(header.spacing).map(|(axis, mm)| axis.iter().map(|v| v * mm).collect()).collect();
    placed(&mut text, header.channels, &steps, &header.origin, false);
    packed(&mut text, header.compressed, data_file);
    text.extra(&header.fields, &[])?;
    text.text.push('\n');
    Ok(text)
}

/// A right-handed space without further meaning.
const NOT_ANATOMICAL: &str = "3D-right-handed";

/// Appends a line of NRRD's own structure.
fn structure(text: &mut Text, name: &str, value: &str) {
    text.text.push_str(&format!("{name}: {value}\n"));
}

fn begin(pixel: PixelType, channels: u32, sizes: &[u32], frames: Option<usize>) -> Text {
    let mut text = Text::new(&STYLE);
    text.text.push_str("NRRD0004\n# http://teem.sourceforge.net/nrrd/format.html\n");
    structure(&mut text, "type", type_name(pixel));
    let colour = (channels > 1).then_some(channels).into_iter();
    let all: Vec<String> = colour
        .map(|n| n.to_string())
        .chain(sizes.iter().map(u32::to_string))
        .chain(frames.map(|n| n.to_string()))
        .collect();
    structure(&mut text, "dimension", &all.len().to_string());
    structure(&mut text, "sizes", &all.join(" "));
    let mut kinds = Vec::new();
    kinds.extend((channels > 1).then_some("vector"));
    kinds.extend(sizes.iter().map(|_| "domain"));
    kinds.extend(frames.map(|_| "list"));
    structure(&mut text, "kinds", &kinds.join(" "));
    text
}

fn placed(text: &mut Text, channels: u32, steps: &[Vec<f64>], origin: &[f64], frames: bool) {
    let vector = |v: &[f64]| format!("({})", list(v).replace(' ', ","));
    let mut directions = Vec::new();
    directions.extend((channels > 1).then(|| "none".to_owned()));
    directions.extend(steps.iter().map(|step| vector(step)));
    directions.extend(frames.then(|| "none".to_owned()));
    structure(text, "space directions", &directions.join(" "));
    structure(text, "space origin", &vector(origin));
}

fn packed(text: &mut Text, compressed: bool, data_file: Option<&str>) {
    structure(text, "endian", if cfg!(target_endian = "big") { "big" } else { "little" });
    structure(text, "encoding", if compressed { "gzip" } else { "raw" });
    if let Some(name) = data_file {
        structure(text, "data file", name);
    }
}

/// Writes the items' times, if all have one, as the index of the list axis; else their order.
fn index(text: &mut Text, header: &SequenceHeader) {
    let times: Option<Vec<f64>> = header.items.iter().map(|item| item.stamp.source_s).collect();
    let (label, unit) = if times.is_some() { ("time", "s") } else { ("frame", "") };
    let none = "\"\" ".repeat(3 + usize::from(header.channels > 1));
    structure(text, "labels", &format!("{none}\"{label}\""));
    structure(text, "units", &format!("{none}\"{unit}\""));
    let node = if header.channels > 1 { "vtkMRMLVectorVolumeNode" } else { "vtkMRMLScalarVolumeNode" };
    text.line("DataNodeClassName", node);
    text.line("axis 3 index type", "numeric");
    let values = times.unwrap_or_else(|| (0..header.items.len()).map(|n| n as f64).collect());
    text.line("axis 3 index values", &list(&values));
}

/// Returns the type name used by ITK and teem.
const fn type_name(pixel: PixelType) -> &'static str {
    match pixel {
        PixelType::U8 => "uint8",
        PixelType::I8 => "int8",
        PixelType::U16 => "uint16",
        PixelType::I16 => "int16",
        PixelType::U32 => "uint32",
        PixelType::I32 => "int32",
        PixelType::U64 => "uint64",
        PixelType::I64 => "int64",
        PixelType::F32 => "float",
        PixelType::F64 => "double",
    }
}
