//! Meaning of a sequence's per-frame fields: times, numbers, transforms and their validity.

use sonoweave_core::reading::{Status, split_transform_name};

use crate::image::fault::Fault;
use crate::image::header::{FrameField, Header};
use crate::image::layout::Layout;
use crate::image::numbers::{BadNumber, numbers, seconds, whole};
use crate::image::spacing::{self, ELEMENT_SPACING};

/// Global field with the orientation of the images.
pub(crate) const ORIENTATION: &str = "UltrasoundImageOrientation";
/// Global field with the type of the images.
pub(crate) const IMAGE_TYPE: &str = "UltrasoundImageType";

/// The interpreted header of a sequence. Memory is proportional to the header's length,
/// whatever it claims.
#[derive(Debug)]
pub struct Sequence {
    /// Global fields without a meaning here, in file order.
    pub fields: Vec<(String, String)>,
    /// The file's text, empty if not given.
    pub orientation: String,
    /// The file's text, empty if not given.
    pub image_type: String,
    /// Source and target frame of each transform, indexed by [`ItemTransform::name`].
    pub transforms: Vec<(String, String)>,
    /// Names of further per-frame fields, by the index in [`Item::fields`].
    pub names: Vec<Box<str>>,
    /// One item per frame; empty if the file has no per-frame fields.
    items: Vec<Item>,
    bare: Item,
}

/// Header fields of one frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Item {
    /// Time stamp of the file, s.
    pub source_s: Option<f64>,
    /// Time stamp before filtering, s.
    pub unfiltered_s: Option<f64>,
    /// The source's own frame number.
    pub frame_number: Option<u64>,
    /// Status of the image.
    pub image: Status,
    /// In file order.
    pub transforms: Vec<ItemTransform>,
    /// Fields without a meaning here, in file order.
    pub fields: Vec<(u32, Box<str>)>,
}

/// A transform of a frame.
#[derive(Debug, Clone, PartialEq)]
pub struct ItemTransform {
    /// Index of its name among the sequence's names.
    pub name: u32,
    /// Matrix, row major.
    pub matrix: [f64; 16],
    /// Status of the transform.
    pub status: Status,
}

impl Item {
    pub(crate) const fn bare() -> Self {
        Self {
            source_s: None,
            unfiltered_s: None,
            frame_number: None,
            image: Status::Ok,
            transforms: Vec::new(),
            fields: Vec::new(),
        }
    }
}

/// Meaning of a per-frame field's name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Role {
    Timestamp,
    UnfilteredTimestamp,
    FrameNumber,
    ImageStatus,
    Transform(u32),
    TransformStatus(u32),
    Other,
}

impl Sequence {
    /// Interprets all per-frame fields, so that a bad one is refused before the first frame is
    /// delivered.
    pub(crate) fn new(header: Header, layout: &Layout) -> Result<Self, Fault> {
        let (roles, bases) = roles(&header);
        if header.frames.is_empty() && !layout.has_images() && (header.grammar.times)(&header)?.is_none() {
            return Err(layout
                .shape
                .fault("promises no images, and no field Seq_Frame… holds a reading; the recording is empty"));
        }
        let mut items = Vec::new();
        for fields in header.frames.chunk_by(|a, b| a.frame == b.frame) {
            check_order(&header, &fields[0], items.len() as u64, layout)?;
            items.push(item(&header, fields, &roles)?);
        }
        if !items.is_empty() && (items.len() as u64) < layout.layers {
            return Err(layout.shape.fault(format!(
                "promises {} frames, but fields Seq_Frame… are given for the first {} only; correct it or record again",
                layout.layers,
                items.len()
            )));
        }
        if let Some(times) = (header.grammar.times)(&header)?
            && items.iter().all(|item| item.source_s.is_none())
        {
            if times.len() as u64 != layout.layers {
                return Err(layout.shape.fault(format!(
                    "promises {} frames, but the index of their axis holds {} times; correct one of them",
                    layout.layers,
                    times.len()
                )));
            }
            items.resize(times.len(), Item::bare());
            items.iter_mut().zip(times).for_each(|(item, time)| item.source_s = Some(time));
        }
        let text = |name: &str| header.get(name).map_or_else(String::new, |field| field.value.to_string());
        let mut fields = header.further_fields();
        fields.retain(|(name, _)| name != ORIENTATION && name != IMAGE_TYPE);
        if let Some(text) = (header.grammar.spacing)(&header).and_then(spacing::text) {
            fields.retain(|(name, _)| name != ELEMENT_SPACING);
            fields.insert(0, (ELEMENT_SPACING.into(), text));
        }
        Ok(Self {
            orientation: text(ORIENTATION),
            image_type: text(IMAGE_TYPE),
            transforms: bases.iter().map(|base| split_transform_name(base)).collect(),
            fields,
            names: header.names,
            items,
            bare: Item::bare(),
        })
    }

    /// Returns a sequence of these frames without further fields.
    pub(crate) fn of_items(transforms: Vec<(String, String)>, orientation: &str, items: Vec<Item>) -> Self {
        Self {
            fields: Vec::new(),
            orientation: orientation.to_owned(),
            image_type: String::new(),
            transforms,
            names: Vec::new(),
            items,
            bare: Item::bare(),
        }
    }

    /// Returns the header fields of a frame.
    pub fn item(&self, index: u64) -> &Item {
        usize::try_from(index).ok().and_then(|index| self.items.get(index)).unwrap_or(&self.bare)
    }
}

/// Checks that frames are numbered 0, 1, 2, … without gaps. After a gap, the assignment of the
/// remaining frames to images is unknown.
fn check_order(header: &Header, field: &FrameField, expected: u64, layout: &Layout) -> Result<(), Fault> {
    if field.frame >= layout.layers {
        let (shape, frames) = (&layout.shape.name, layout.layers);
        let problem =
            format!("belongs to frame {}, but {shape} promises only {frames}; correct one of them", field.frame);
        return Err(header.frame_fault(field, problem));
    }
    if field.frame != expected {
        let problem = format!(
            "belongs to frame {}, but frame {expected} has no fields; frames are numbered from 0 without gaps",
            field.frame
        );
        return Err(header.frame_fault(field, problem));
    }
    Ok(())
}

/// Returns the meaning of each name, and the transforms' names without the word `Transform`.
///
/// A name is a transform's if it ends in `Transform`. Early files omit the word; two more cases
/// count therefore: a name such as `ProbeToTracker` with 16 numbers in some frame, and a bare
/// word whose 16 numbers end in the row 0 0 0 1. A transform must then hold 16 numbers in every
/// frame that has it.
fn roles(header: &Header) -> (Vec<Role>, Vec<String>) {
    let mut old_style = vec![false; header.names.len()];
    for field in &header.frames {
        let known = &mut old_style[field.name as usize];
        if !*known && let Ok(matrix) = numbers::<16>(&field.value) {
            let splits = !split_transform_name(&header.names[field.name as usize]).1.is_empty();
            *known = splits || matrix[12..] == [0.0, 0.0, 0.0, 1.0];
        }
    }
    let mut bases: Vec<String> = Vec::new();
    let mut roles = vec![Role::Other; header.names.len()];
    for (id, name) in header.names.iter().enumerate() {
        let base = match name.strip_suffix("Transform") {
            Some(base) => base,
            None if old_style[id] => name,
            None => continue,
        };
        let index = bases.iter().position(|known| known == base).unwrap_or_else(|| {
            bases.push(base.to_owned());
            bases.len() - 1
        });
        roles[id] = Role::Transform(u32::try_from(index).unwrap_or(u32::MAX));
    }
    for (id, name) in header.names.iter().enumerate() {
        roles[id] = match &**name {
            "Timestamp" => Role::Timestamp,
            "UnfilteredTimestamp" => Role::UnfilteredTimestamp,
            "FrameNumber" => Role::FrameNumber,
            // Some writers use `Status` alone for the image's status.
            "ImageStatus" | "Status" => Role::ImageStatus,
            name => {
                let of = name.strip_suffix("Status").map(|of| of.strip_suffix("Transform").unwrap_or(of));
                let index = of.and_then(|of| bases.iter().position(|base| base == of));
                index.map_or(roles[id], |index| Role::TransformStatus(u32::try_from(index).unwrap_or(u32::MAX)))
            }
        };
    }
    (roles, bases)
}

fn item(header: &Header, fields: &[FrameField], roles: &[Role]) -> Result<Item, Fault> {
    let mut item = Item::bare();
    // Transforms first: a status may precede its transform.
    for field in fields {
        let Role::Transform(name) = roles[field.name as usize] else { continue };
        if item.transforms.iter().any(|transform| transform.name == name) {
            let problem = "gives a transform that this frame already has under its other spelling; remove one of them";
            return Err(header.frame_fault(field, problem));
        }
        let matrix = numbers::<16>(&field.value).map_err(|bad| header.frame_fault(field, bad))?;
        item.transforms.push(ItemTransform { name, matrix, status: Status::Ok });
    }
    for field in fields {
        let refused = |bad: BadNumber| header.frame_fault(field, bad);
        match roles[field.name as usize] {
            Role::Transform(_) => {}
            Role::Timestamp => item.source_s = Some(seconds(&field.value).map_err(refused)?),
            Role::UnfilteredTimestamp => item.unfiltered_s = Some(seconds(&field.value).map_err(refused)?),
            Role::FrameNumber => item.frame_number = Some(whole(&field.value).map_err(refused)?),
            Role::ImageStatus => worsen(&mut item.image, &field.value),
            Role::TransformStatus(name) => {
                match item.transforms.iter_mut().find(|transform| transform.name == name) {
                    Some(transform) => worsen(&mut transform.status, &field.value),
                    // This frame lacks the transform: the status is kept, since it may give the
                    // reason.
                    None => item.fields.push((field.name, field.value.clone())),
                }
            }
            Role::Other => item.fields.push((field.name, field.value.clone())),
        }
    }
    // Saves memory: a hostile header may have millions of frames with one field each.
    item.transforms.shrink_to_fit();
    item.fields.shrink_to_fit();
    Ok(item)
}

/// Merges a further status word; the first one that is not `OK` stays.
fn worsen(status: &mut Status, word: &str) {
    if *status == Status::Ok && !word.eq_ignore_ascii_case("OK") {
        *status = Status::Other(word.to_owned().into());
    }
}

#[cfg(test)]
mod tests {
    use super::super::header::Parser;
    use super::super::metaimage::grammar::GRAMMAR;
    use super::*;
    use crate::Limits;

    const EYE: &str = "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1";

    /// Parses a sequence of `frames` without images.
    fn sequence(frames: u64, lines: &str) -> Result<Sequence, Fault> {
        let mut parser = Parser::new(&GRAMMAR, Limits::default());
        let head = format!("NDims = 3\nDimSize = 0 0 {frames}\nElementType = MET_OTHER\nKinds = domain domain list\n");
        for line in head.split_inclusive('\n').chain(lines.split_inclusive('\n')) {
            parser.line(line.as_bytes())?;
        }
        parser.line(b"ElementDataFile = LOCAL\n")?;
        let header = parser.finish()?;
        let claims = (header.grammar.claims)(&header)?;
        let layout = Layout::new(&claims, header.end, 0, &Limits::default())?;
        Sequence::new(header, &layout)
    }

    fn problem(frames: u64, lines: &str) -> (String, u64, String) {
        match sequence(frames, lines).unwrap_err() {
            Fault::Field { field, offset, problem } => (field, offset, problem),
            limit @ Fault::Limit { .. } => panic!("{limit:?}"),
        }
    }

    #[test]
    fn transform_names_split_at_separating_to() {
        let cases = [
            ("ProbeToTracker", "Probe", "Tracker"),
            ("ToolToTracker", "Tool", "Tracker"),
            ("TorsoToTracker", "Torso", "Tracker"),
            ("ImageToCroppedImage", "Image", "CroppedImage"),
            ("StylusToTool", "Stylus", "Tool"),
            ("AToB", "A", "B"),
            ("ProbeTo2", "Probe", "2"),
            ("TopToToe", "Top", "Toe"),
            ("HeadToToeToTracker", "Head", "ToeToTracker"),
            ("Stylus", "Stylus", ""),
            ("AutoTool", "AutoTool", ""),
            ("ToTracker", "ToTracker", ""),
            ("ProbeTo", "ProbeTo", ""),
            ("ÉcranToÎle", "Écran", "Île"),
        ];
        for (name, from, to) in cases {
            assert_eq!(split_transform_name(name), (from.to_owned(), to.to_owned()), "{name}");
        }
    }

    #[test]
    fn frame_fields_are_interpreted() {
        let matrix = "1 2 3 4 5 6 7 8 9 10 11 12 0 0 0 1";
        let got = sequence(
            2,
            &format!(
                "Seq_Frame0000_Later = b\nSeq_Frame0000_ProbeToTrackerTransformStatus = INVALID\nSeq_Frame0000_ProbeToTrackerTransform = {matrix} \n\
                 Seq_Frame0000_NeedleToProbe = {EYE}\nSeq_Frame0000_NeedleToProbeStatus = MISSING\nSeq_Frame0000_Timestamp = 1.5\n\
                 Seq_Frame0000_UnfilteredTimestamp = 1.25\nSeq_Frame0000_FrameNumber = 77\nSeq_Frame0000_ImageStatus = BAD\n\
                 Seq_Frame0000_FooStatus = x\nSeq_Frame0000_Earlier = a\nSeq_Frame0000_Row = 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16\n\
                 Seq_Frame0001_ProbeToTrackerTransform = {EYE}\nSeq_Frame0001_ProbeToTrackerTransformStatus = ok\nSeq_Frame0001_Stylus = {EYE}\n\
                 Seq_Frame0001_NeedleToProbeStatus = LOST\nSeq_Frame0001_Later = c\nSeq_Frame0001_Status = OK\n"
            ),
        )
        .unwrap();
        assert_eq!(
            got.transforms,
            [("Probe", "Tracker"), ("Needle", "Probe"), ("Stylus", "")].map(|(a, b)| (a.to_owned(), b.to_owned()))
        );
        let first = got.item(0);
        assert_eq!((first.source_s, first.unfiltered_s, first.frame_number), (Some(1.5), Some(1.25), Some(77)));
        assert_eq!(first.image, Status::Other("BAD".into()));
        let transforms: Vec<_> = first.transforms.iter().map(|t| (t.name, t.matrix[1], t.status.clone())).collect();
        assert_eq!(
            transforms,
            [(0, 2.0, Status::Other("INVALID".into())), (1, 0.0, Status::Other("MISSING".into()))],
            "row major, each with its own status, in file order"
        );
        let fields: Vec<_> = first.fields.iter().map(|(name, text)| (&*got.names[*name as usize], &**text)).collect();
        assert_eq!(fields[..3], [("Later", "b"), ("FooStatus", "x"), ("Earlier", "a")]);
        assert_eq!(fields[3].0, "Row", "16 numbers alone make no transform");
        let second = got.item(1);
        let fields: Vec<_> = second.fields.iter().map(|(name, text)| (&*got.names[*name as usize], &**text)).collect();
        assert_eq!(fields, [("NeedleToProbeStatus", "LOST"), ("Later", "c")]);
        assert_eq!((second.source_s, &second.image), (None, &Status::Ok));
        assert_eq!(
            second.transforms.iter().map(|t| (t.name, &t.status)).collect::<Vec<_>>(),
            [(0, &Status::Ok), (2, &Status::Ok)]
        );
    }

    #[test]
    fn nan_is_accepted_in_matrices_only() {
        let nan = EYE.replacen("1", "nan", 1).replacen("0", "inf", 1);
        let got = sequence(1, &format!("Seq_Frame0000_AToBTransform = {nan}\n")).unwrap();
        let matrix = got.item(0).transforms[0].matrix;
        assert!(matrix[0].is_nan() && matrix[1] == f64::INFINITY);
        for (value, expected) in
            [("nan", "finite"), ("inf", "finite"), ("noon", "number of seconds"), ("", "number of seconds")]
        {
            for name in ["Timestamp", "UnfilteredTimestamp"] {
                let (field, offset, problem) = problem(1, &format!("Seq_Frame0000_{name} = {value}\n"));
                assert_eq!((field, offset), (format!("Seq_Frame0000_{name}"), 77));
                assert!(problem.contains(expected), "{problem}");
            }
        }
    }

    #[test]
    fn contradictions_are_refused_by_field_and_offset() {
        let t = |frame: u32| format!("Seq_Frame{frame:04}_AToBTransform = {EYE}\n");
        let line = t(0).len() as u64;
        let fifteen = "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0";
        let cases = [
            (
                1,
                format!("Seq_Frame0000_AToBTransform = {fifteen}\n"),
                "Seq_Frame0000_AToBTransform",
                77,
                "holds 15 numbers",
            ),
            (
                2,
                format!("{}Seq_Frame0001_AToBTransform = {EYE} 5\n", t(0)),
                "Seq_Frame0001_AToBTransform",
                77 + line,
                "holds 17",
            ),
            (
                1,
                "Seq_Frame0000_AToBTransform = a b\n".into(),
                "Seq_Frame0000_AToBTransform",
                77,
                "\"a\", number 1 of 16",
            ),
            (
                2,
                format!("Seq_Frame0000_AToB = {EYE}\nSeq_Frame0001_AToB = {fifteen}\n"),
                "Seq_Frame0001_AToB",
                130,
                "holds 15",
            ),
            (1, format!("Seq_Frame0000_AToB = {EYE}\n{}", t(0)), "Seq_Frame0000_AToBTransform", 130, "other spelling"),
            (3, t(0) + &t(2), "Seq_Frame0002_AToBTransform", 77 + line, "frame 1 has no fields"),
            (2, t(1), "Seq_Frame0001_AToBTransform", 77, "frame 0 has no fields"),
            (1, t(0) + &t(1), "Seq_Frame0001_AToBTransform", 77 + line, "DimSize promises only 1"),
            (3, t(0) + &t(1), "DimSize", 10, "promises 3 frames, but fields Seq_Frame… are given for the first 2"),
            (3, String::new(), "DimSize", 10, "the recording is empty"),
            (1, "Seq_Frame0000_FrameNumber = -1\n".into(), "Seq_Frame0000_FrameNumber", 77, "negative"),
            (1, "Seq_Frame0000_FrameNumber = one\n".into(), "Seq_Frame0000_FrameNumber", 77, "not a whole number"),
        ];
        for (frames, lines, field, offset, expected) in cases {
            let (f, o, p) = problem(frames, &lines);
            assert_eq!((f.as_str(), o), (field, offset), "{p}");
            assert!(p.contains(expected), "{p:?} does not contain {expected:?}");
        }
    }
}
