//! PLUS configuration and calibration result files (XML).
//!
//! The reader uses every `Transform` inside a `CoordinateDefinitions` or `CalibrationResults`
//! element. From `VolumeReconstruction` it uses the frames' names, `OutputSpacing`, the clip
//! rectangle and the clip fan. The other attributes of `VolumeReconstruction` control PLUS's own
//! algorithm and are reported as not taken over. Attributes, defaults and deprecated names are
//! those of the PLUS application's user manual, "Volume reconstruction".
//!
//! Two conventions differ from PLUS:
//!
//! - PLUS's clip rectangle includes the pixel after its last one (IGSIO's `GetClipExtent` takes
//!   origin + size as the last index). Here `ClipRectangleSize` counts pixels.
//! - PLUS files express "not clipped" by a rectangle around the whole frame. Here such a
//!   rectangle leaves the automatic mask in force (see [`mask::Clip::RectOrAuto`]).

use std::path::Path;

use roxmltree::{Document, Node, ParsingOptions};

use sonoweave_core::keys::numbers;
use sonoweave_core::named::StaticTransform;
use sonoweave_core::region::{ClipRect, Fan};

use super::xml_limits::check_limits;
use crate::error::Error;
use crate::settings::{Settings, SourceKind};

/// Attributes that PLUS's algorithm needs and ours does not.
const NOT_TAKEN: [&str; 12] = [
    "Interpolation",
    "CompoundingMode",
    "Compounding",
    "Calculation",
    "FillHoles",
    "Optimization",
    "NumberOfThreads",
    "OutputOrigin",
    "OutputExtent",
    "PixelRejectionThreshold",
    "SkipInterval",
    "EnableFanAnglesAutoDetect",
];

/// PLUS's default depth of a clip fan, pixels.
const DEFAULT_FAN_RADIUS: f64 = 500.0;

/// Reads the text of a PLUS file; `path` is for messages.
pub(super) fn parse(path: &Path, text: &str) -> Result<Settings, Error> {
    let document = document(path, text)?;
    let reader = Reader { path, document: &document };

    let mut settings = Settings { source: SourceKind::Plus, path: Some(path.to_owned()), ..Settings::default() };
    let definitions =
        || document.descendants().filter(|n| is(n, "CoordinateDefinitions") || is(n, "CalibrationResults"));
    let mut lines = Vec::new();
    for element in definitions().flat_map(|n| n.children()).filter(|n| is(n, "Transform")) {
        let transform = reader.transform(&element)?;
        let earlier = settings.transforms.iter().position(|other| other.relates_same_frames(&transform));
        match earlier {
            Some(at) if settings.transforms[at] == transform => {}
            Some(at) => {
                let problem = format!(
                    "{} and {} are already related, with other numbers, on line {}; delete one of the two transforms",
                    transform.from, transform.to, lines[at]
                );
                return Err(reader.error(&element, "Matrix", problem));
            }
            None => {
                lines.push(reader.line(&element, "Matrix"));
                settings.transforms.push(transform);
            }
        }
    }

    let mut reconstructions: Vec<_> = document.descendants().filter(|n| is(n, "VolumeReconstruction")).collect();
    // One at the top level is the file's own; others belong to virtual devices.
    reconstructions.sort_by_key(|n| n.parent() != Some(document.root_element()));
    if let Some(element) = reconstructions.first() {
        if reconstructions.len() > 1 {
            settings.notes.push(format!(
                "{} VolumeReconstruction elements were found; the one on line {} is taken",
                reconstructions.len(),
                document.text_pos_at(element.range().start).row
            ));
        }
        reader.volume_reconstruction(element, &mut settings)?;
    } else if definitions().next().is_none() {
        return Err(Error::NothingInside { path: path.to_owned() });
    }
    Ok(settings)
}

/// Parses the document within the limits.
pub(super) fn document<'t>(path: &Path, text: &'t str) -> Result<Document<'t>, Error> {
    check_limits(path, text)?;
    let options = ParsingOptions { allow_dtd: false, nodes_limit: 1 << 20, ..ParsingOptions::default() };
    Document::parse_with_options(text, options).map_err(|e| Error::Xml {
        path: path.to_owned(),
        line: e.pos().row,
        problem: e.to_string(),
    })
}

/// Whether a node is an element of that name.
pub(super) fn is(node: &Node<'_, '_>, name: &str) -> bool {
    node.is_element() && node.tag_name().name() == name
}

/// Reads attributes, with their places for error messages.
pub(super) struct Reader<'a> {
    pub(super) path: &'a Path,
    pub(super) document: &'a Document<'a>,
}

impl Reader<'_> {
    pub(super) fn line(&self, element: &Node<'_, '_>, attribute: &str) -> u32 {
        let at = element.attribute_node(attribute).map_or(element.range().start, |a| a.range().start);
        self.document.text_pos_at(at).row
    }

    pub(super) fn error(&self, element: &Node<'_, '_>, attribute: &str, problem: impl Into<String>) -> Error {
        Error::Attribute {
            path: self.path.to_owned(),
            line: self.line(element, attribute),
            element: element.tag_name().name().to_owned(),
            attribute: attribute.to_owned(),
            problem: problem.into(),
        }
    }

    pub(super) fn need<'n>(&self, element: &Node<'n, '_>, attribute: &str) -> Result<&'n str, Error> {
        element.attribute(attribute).ok_or_else(|| self.error(element, attribute, "is missing"))
    }

    /// Returns N finite numbers separated by white space, if the attribute is present.
    pub(super) fn numbers<const N: usize>(
        &self,
        element: &Node<'_, '_>,
        attribute: &str,
    ) -> Result<Option<[f64; N]>, Error> {
        let Some(text) = element.attribute(attribute) else { return Ok(None) };
        numbers(text).map(Some).map_err(|problem| self.error(element, attribute, problem))
    }

    /// Returns the value under one of a setting's names: the current name, else a deprecated
    /// one.
    fn either<const N: usize>(
        &self,
        element: &Node<'_, '_>,
        names: [&'static str; 2],
    ) -> Result<Option<(&'static str, [f64; N])>, Error> {
        for name in names {
            if let Some(numbers) = self.numbers(element, name)? {
                return Ok(Some((name, numbers)));
            }
        }
        Ok(None)
    }

    pub(super) fn transform(&self, element: &Node<'_, '_>) -> Result<StaticTransform, Error> {
        let (from, to) = (self.need(element, "From")?, self.need(element, "To")?);
        self.need(element, "Matrix")?;
        let rows = self.numbers::<16>(element, "Matrix")?.unwrap_or_default();
        StaticTransform::new(from, to, &rows).map_err(|e| self.error(element, "Matrix", e.to_string()))
    }

    fn volume_reconstruction(&self, element: &Node<'_, '_>, settings: &mut Settings) -> Result<(), Error> {
        settings.image_frame = element.attribute("ImageCoordinateFrame").map(str::to_owned);
        settings.world = element.attribute("ReferenceCoordinateFrame").map(str::to_owned);
        if let Some(spacing) = self.numbers::<3>(element, "OutputSpacing")? {
            if let Some(x) = spacing.iter().find(|x| **x <= 0.0) {
                return Err(self.error(element, "OutputSpacing", format!("must hold numbers above 0, not {x}")));
            }
            settings.spacing_mm = Some(spacing);
        }
        settings.clip = self.clip(element)?;
        settings.fan = self.fan(element, &mut settings.notes)?;
        let present: Vec<String> = NOT_TAKEN
            .iter()
            .filter_map(|name| element.attribute(*name).map(|value| format!("{name}=\"{value}\"")))
            .collect();
        if !present.is_empty() {
            settings.notes.push(format!("read but not taken over: {}", present.join(", ")));
        }
        Ok(())
    }

    pub(super) fn clip(&self, element: &Node<'_, '_>) -> Result<Option<ClipRect>, Error> {
        const SIZE: &str = "ClipRectangleSize";
        const ORIGIN: &str = "ClipRectangleOrigin";
        let whole = |name| -> Result<Option<[i64; 2]>, Error> {
            let Some(numbers) = self.numbers::<2>(element, name)? else { return Ok(None) };
            if numbers.iter().any(|x| x.fract() != 0.0 || x.abs() > 1e9) {
                return Err(self.error(element, name, format!("must hold whole numbers of pixels, not {numbers:?}")));
            }
            Ok(Some(numbers.map(|x| x as i64)))
        };
        let origin = whole(ORIGIN)?.unwrap_or_default();
        // PLUS: a size of 0 0, its default, clips nothing.
        let size = whole(SIZE)?.unwrap_or_default();
        if size.iter().all(|x| *x <= 0) {
            return Ok(None);
        }
        // The part left of or above the image clips nothing.
        let first = origin.map(|x| x.max(0));
        let count = [0, 1].map(|axis| (origin[axis] + size[axis] - first[axis]).max(0));
        let [x, y, width, height] =
            [first[0], first[1], count[0], count[1]].map(|n| u32::try_from(n).unwrap_or(u32::MAX));
        ClipRect::new(x, y, width, height).map(Some).map_err(|e| self.error(element, SIZE, e.to_string()))
    }

    fn fan(&self, element: &Node<'_, '_>, notes: &mut Vec<String>) -> Result<Option<Fan>, Error> {
        let Some((angles_name, mut angles)) = self.either::<2>(element, ["FanAnglesDeg", "FanAngles"])? else {
            return Ok(None);
        };
        // PLUS: both angles 0, its default, clips nothing.
        if angles == [0.0; 2] {
            return Ok(None);
        }
        if angles[0] > angles[1] {
            // PLUS swaps them too.
            angles.swap(0, 1);
        }
        let mut default =
            |name: &str, value: String| notes.push(format!("{name} is missing: {value} is used, as in PLUS"));
        let origin = match self.either::<2>(element, ["FanOriginPixel", "FanOrigin"])? {
            Some((_, origin)) => origin,
            None => {
                default("FanOriginPixel", "0 0".into());
                [0.0; 2]
            }
        };
        let start = self.numbers::<1>(element, "FanRadiusStartPixel")?.map_or(0.0, |[r]| r);
        let stop = match self.either::<1>(element, ["FanRadiusStopPixel", "FanDepth"])? {
            Some((_, [stop])) => stop,
            None => {
                default("FanRadiusStopPixel", DEFAULT_FAN_RADIUS.to_string());
                DEFAULT_FAN_RADIUS
            }
        };
        Fan::new(origin, [start, stop], angles).map(Some).map_err(|e| self.error(element, angles_name, e.to_string()))
    }
}
