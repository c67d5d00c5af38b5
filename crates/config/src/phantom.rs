//! Phantoms for probe calibration: our phantom file ([`calibration::phantom::file`]), or a PLUS
//! configuration.
//!
//! From a PLUS configuration, four parts are used:
//!
//! - `PhantomDefinition`: wires and landmarks;
//! - `vtkPlusProbeCalibrationAlgo`: the names of the frames;
//! - `CoordinateDefinitions` or results: the transform from the phantom to the reference, with
//!   its `Error`;
//! - `Segmentation`: the clip rectangle. Its other attributes control PLUS's own algorithm and
//!   are not needed here.

use std::path::Path;

use glam::DVec3;
use roxmltree::Node;

use calibration::phantom::file::{PhantomFile, Registration};
use calibration::phantom::{Geometry, Landmark, Wire};
use sonoweave_core::frames::{Phantom, Reference, Transform};
use sonoweave_core::region::ClipRect;

use super::plus::{Reader, document, is};
use super::{Error, Kind, MAX_BYTES, kind_of};

/// Frame names in a sequence's transforms: `ProbeToTracker` if the probe's frame is `Probe`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FrameNames {
    /// The image.
    pub image: String,
    /// The sensor on the transducer.
    pub probe: String,
    /// The sensor that the phantom is held on.
    pub reference: String,
    /// The phantom.
    pub phantom: String,
}

impl Default for FrameNames {
    fn default() -> Self {
        let [image, probe, reference, phantom] = ["Image", "Probe", "Reference", "Phantom"].map(str::to_owned);
        Self { image, probe, reference, phantom }
    }
}

/// A phantom, and the frame names in its recordings.
#[derive(Debug, Clone, PartialEq)]
pub struct PhantomSettings {
    /// Wires and landmarks.
    pub geometry: Geometry,
    /// Pose of the phantom, if the file contains it.
    pub registration: Option<Registration>,
    /// Names of frames.
    pub frames: FrameNames,
    /// Part of the image that can contain wires, by the file.
    pub clip: Option<ClipRect>,
}

impl PhantomSettings {
    /// Reads a file of either kind.
    ///
    /// # Errors
    /// [`Error`] naming file, line and key or element.
    pub fn read(path: &Path) -> Result<Self, Error> {
        Self::parse(path, &sonoweave_core::keys::read_text(path, MAX_BYTES)?)
    }

    /// Reads a file's text; `path` is for messages only.
    ///
    /// # Errors
    /// [`Error`] naming file, line and key or element.
    pub fn parse(path: &Path, text: &str) -> Result<Self, Error> {
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        if kind_of(path, text)? == Kind::Plus {
            return plus(path, text);
        }
        let PhantomFile { geometry, registration } = PhantomFile::parse(path, text)?;
        Ok(Self { geometry, registration, frames: FrameNames::default(), clip: None })
    }
}

fn plus(path: &Path, text: &str) -> Result<PhantomSettings, Error> {
    let document = document(path, text)?;
    let reader = Reader { path, document: &document };
    let Some(definition) = document.descendants().find(|n| is(n, "PhantomDefinition")) else {
        return Err(Error::Misplaced {
            path: path.to_owned(),
            what: "a PLUS file without PhantomDefinition",
            expected: "the wires' positions are wanted here: give the configuration of the recording, or a sonoweave \
                phantom file"
                .into(),
        });
    };
    let below =
        |name: &'static str| definition.descendants().filter(move |n| is(n, name)).collect::<Vec<Node<'_, '_>>>();
    let mut patterns = Vec::new();
    for pattern in below("Pattern") {
        let wires = pattern.children().filter(|n| is(n, "Wire")).map(|wire| read_wire(&reader, &wire));
        patterns.push(wires.collect::<Result<Vec<_>, _>>()?);
    }
    let landmark = |node: &Node<'_, '_>| -> Result<Landmark, Error> {
        Ok(Landmark { name: reader.need(node, "Name")?.to_owned(), position_mm: point(&reader, node, "Position")? })
    };
    let landmarks = below("Landmark").iter().map(landmark).collect::<Result<Vec<_>, _>>()?;
    let described = below("Description");
    let words = described.first().map(|n| [n.attribute("Name"), n.attribute("Version")]);
    let name = words.into_iter().flatten().flatten().collect::<Vec<_>>().join(" ");
    let geometry =
        Geometry::new(name, patterns, landmarks).map_err(|e| reader.error(&definition, "Geometry", e.to_string()))?;

    let frames = frame_names(document.root_element());
    let registration = registration(&reader, document.root_element(), &frames)?;
    let segmentation =
        document.descendants().find(|n| is(n, "Segmentation") && n.attribute("ClipRectangleSize").is_some());
    let clip = segmentation.map(|element| reader.clip(&element)).transpose()?.flatten();
    Ok(PhantomSettings { geometry, registration, frames, clip })
}

fn point(reader: &Reader<'_>, node: &Node<'_, '_>, attribute: &str) -> Result<DVec3, Error> {
    reader.need(node, attribute)?;
    Ok(DVec3::from_array(reader.numbers::<3>(node, attribute)?.unwrap_or_default()))
}

fn read_wire(reader: &Reader<'_>, node: &Node<'_, '_>) -> Result<Wire, Error> {
    let ends_mm = [point(reader, node, "EndPointFront")?, point(reader, node, "EndPointBack")?];
    Ok(Wire { name: reader.need(node, "Name")?.to_owned(), ends_mm })
}

fn frame_names(root: Node<'_, '_>) -> FrameNames {
    let mut names = FrameNames::default();
    let Some(element) = root.descendants().find(|n| is(n, "vtkPlusProbeCalibrationAlgo")) else { return names };
    let slots = [
        ("ImageCoordinateFrame", &mut names.image),
        ("ProbeCoordinateFrame", &mut names.probe),
        ("ReferenceCoordinateFrame", &mut names.reference),
        ("PhantomCoordinateFrame", &mut names.phantom),
    ];
    for (attribute, slot) in slots {
        if let Some(name) = element.attribute(attribute) {
            *slot = name.to_owned();
        }
    }
    names
}

/// Returns the only transform between the phantom and the reference, in either direction.
fn registration(reader: &Reader<'_>, root: Node<'_, '_>, frames: &FrameNames) -> Result<Option<Registration>, Error> {
    let definitions = root.descendants().filter(|n| is(n, "CoordinateDefinitions") || is(n, "CalibrationResults"));
    for element in definitions.flat_map(|n| n.children()).filter(|n| is(n, "Transform")) {
        let transform = reader.transform(&element)?;
        let (to_reference, from_reference) = (
            transform.from == frames.phantom && transform.to == frames.reference,
            transform.from == frames.reference && transform.to == frames.phantom,
        );
        if to_reference || from_reference {
            let matrix = Transform::<Reference, Phantom>::from_affine(transform.affine);
            let matrix = if to_reference { matrix } else { Transform::from_affine(transform.affine.inverse()) };
            let error_mm = reader.numbers::<1>(&element, "Error")?.map(|[mm]| mm).filter(|mm| *mm > 0.0);
            let registration = Registration::new(matrix, error_mm);
            return registration.map(Some).map_err(|error| reader.error(&element, "Matrix", error.to_string()));
        }
    }
    Ok(None)
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLUS: &str = r##"<PlusConfiguration version="2.1">
<CoordinateDefinitions>
  <Transform From="StylusTip" To="Stylus" Matrix="1 0 0 203 0 1 0 -12 0 0 1 1 0 0 0 1"/>
  <Transform From="Block" To="Reference" Matrix="0 0 -1 9.5 0 -1 0 36 -1 0 0 88 0 0 0 1" Error="0.404711"/>
</CoordinateDefinitions>
<Segmentation ApproximateSpacingMmPerPixel="0.078" ClipRectangleOrigin="27 27" ClipRectangleSize="766 562"/>
<PhantomDefinition>
  <Description Name="fCAL" Version="1.2"/>
  <Geometry>
    <Pattern Type="NWire">
      <Wire Name="1:E2_e2" EndPointFront="20.0 0.0 10.0" EndPointBack="20.0 40.0 10.0"/>
      <Wire Name="2:I2_f2" EndPointFront="40.0 0.0 10.0" EndPointBack="25.0 40.0 10.0"/>
      <Wire Name="3:J2_j2" EndPointFront="45.0 0.0 10.0" EndPointBack="45.0 40.0 10.0"/>
    </Pattern>
    <Landmarks>
      <Landmark Name="#1" Position="95.0 5.0 15.0"/>
      <Landmark Name="#2" Position="95.0 40.0 15.0"/>
    </Landmarks>
  </Geometry>
</PhantomDefinition>
<vtkPlusProbeCalibrationAlgo PhantomCoordinateFrame="Block"/>
</PlusConfiguration>"##;

    fn parse(text: &str) -> Result<PhantomSettings, String> {
        PhantomSettings::parse(Path::new("fcal.xml"), text).map_err(|e| e.to_string())
    }

    #[test]
    fn plus_file_gives_wires_landmarks_registration_names() {
        let found = parse(PLUS).unwrap();
        assert_eq!(found.geometry.name(), "fCAL 1.2");
        assert_eq!(found.geometry.wires()[1].ends_mm[1], DVec3::new(25.0, 40.0, 10.0));
        assert_eq!(found.geometry.nwires().len(), 1);
        assert_eq!(found.geometry.landmarks()[1].position_mm, DVec3::new(95.0, 40.0, 15.0));
        assert_eq!(found.frames, FrameNames { phantom: "Block".into(), ..FrameNames::default() });
        assert_eq!(found.clip, Some(ClipRect::new(27, 27, 766, 562).unwrap()));
        let registration = found.registration.unwrap();
        assert_eq!(registration.error_mm, Some(0.404711));
        assert_eq!(registration.reference_from_phantom.point(DVec3::ZERO), DVec3::new(9.5, 36.0, 88.0));
    }

    #[test]
    fn registration_inverse_is_inverted_missing_is_none() {
        let other = PLUS.replace("From=\"Block\" To=\"Reference\"", "From=\"Reference\" To=\"Block\"");
        let turned = parse(&other).unwrap().registration.unwrap().reference_from_phantom;
        assert!(turned.point(DVec3::new(9.5, 36.0, 88.0)).length() < 1e-12);
        let none = PLUS.replace("From=\"Block\"", "From=\"Phantom\"");
        assert_eq!(parse(&none).unwrap().registration, None);
    }

    #[test]
    fn own_file_recognised_by_content() {
        let plus = parse(PLUS).unwrap();
        let file = PhantomFile { geometry: plus.geometry.clone(), registration: plus.registration };
        let own = parse(&file.to_text()).unwrap();
        assert_eq!((own.geometry, own.registration, own.clip), (plus.geometry, plus.registration, None));
    }

    #[test]
    fn errors_name_missing_or_wrong_item() {
        let cases = [
            (
                "PhantomDefinition>",
                "Other>",
                "is a PLUS file without PhantomDefinition; the wires' positions are wanted here",
            ),
            ("EndPointFront=\"20.0 0.0 10.0\" ", "", "fcal.xml: Wire EndPointFront (line 11): is missing"),
            ("\"20.0 40.0 10.0\"", "\"20.0 40.0\"", "Wire EndPointBack (line 11): must hold 3 numbers, not 2"),
            ("2:I2_f2", "1:E2_e2", "PhantomDefinition Geometry (line 7): two wires are called 1:E2_e2"),
            ("0 -1 0 36", "0 1 0 36", "Transform Matrix (line 4): the pose mirrors"),
        ];
        for (from, to, expected) in cases {
            let error = parse(&PLUS.replace(from, to)).unwrap_err();
            assert!(error.contains(expected), "{expected}\n{error}");
        }
    }
}
