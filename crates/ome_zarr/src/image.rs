//! The description of an image in a group's metadata: axes, units, levels and their places.

use serde_json::Value;

use crate::metadata::VERSION;

/// An image, as `multiscales` describes it.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Image {
    /// Number of axes before z: time and channel, of one element each.
    pub(crate) leading: usize,
    /// Levels, the finest first.
    pub(crate) levels: Vec<Place>,
    /// Notes for the user: sentences.
    pub(crate) notes: Vec<String>,
}

/// A level: its array and its place, in mm along z, y, x.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Place {
    pub(crate) path: String,
    pub(crate) scale: [f64; 3],
    pub(crate) translation: [f64; 3],
}

/// Reason why a group is not read as an image.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum NoImage {
    /// It describes none.
    Absent,
    /// Another version.
    Version(String),
    /// A field, with fault and remedy.
    Field(String, String),
}

/// Length of units of the specification, in mm.
const UNITS: [(&str, f64); 12] = [
    ("angstrom", 1e-7),
    ("picometer", 1e-9),
    ("nanometer", 1e-6),
    ("micrometer", 1e-3),
    ("millimeter", 1.0),
    ("centimeter", 10.0),
    ("decimeter", 100.0),
    ("meter", 1e3),
    ("kilometer", 1e6),
    ("inch", 25.4),
    ("foot", 304.8),
    ("yard", 914.4),
];

fn bad<T>(field: impl Into<String>, problem: impl Into<String>) -> Result<T, NoImage> {
    Err(NoImage::Field(field.into(), problem.into()))
}

impl Image {
    /// Reads the first image that a group's attributes describe.
    pub(crate) fn read(attributes: &Value) -> Result<Self, NoImage> {
        let Some(ome) = attributes.get("ome") else { return Err(NoImage::Absent) };
        match ome.get("version").and_then(Value::as_str) {
            Some(VERSION) => {}
            Some(other) => return Err(NoImage::Version(other.to_owned())),
            None => return bad("ome.version", "is missing; it must be \"0.5\""),
        }
        let Some(image) = ome.get("multiscales").and_then(|all| all.get(0)) else { return Err(NoImage::Absent) };
        let mut notes = Vec::new();
        let (leading, units) = axes(&image["axes"], &mut notes)?;
        let outer =
            transforms(image.get("coordinateTransformations"), leading, "multiscales.coordinateTransformations")?;
        let datasets = image["datasets"].as_array().map_or(&[][..], Vec::as_slice);
        if datasets.is_empty() {
            return bad("multiscales.datasets", "has no level; there must be one at least");
        }
        let level = |(number, dataset): (usize, &Value)| {
            let field = format!("multiscales.datasets[{number}]");
            let Some(path) = dataset["path"].as_str().filter(|path| is_plain(path)) else {
                return bad(format!("{field}.path"), "must be the name of an array in the volume");
            };
            let field = format!("{field}.coordinateTransformations");
            let inner = transforms(dataset.get("coordinateTransformations"), leading, &field)?;
            let scale: [f64; 3] = std::array::from_fn(|a| inner[0][a] * outer[0][a] * units[a]);
            let translation = std::array::from_fn(|a| (inner[1][a] * outer[0][a] + outer[1][a]) * units[a]);
            if scale.iter().any(|s| *s <= 0.0) {
                return bad(field, "scales by numbers that are not positive; the voxels' spacing must be");
            }
            Ok(Place { path: path.to_owned(), scale, translation })
        };
        let levels = datasets.iter().enumerate().map(level).collect::<Result<_, _>>()?;
        Ok(Self { leading, levels, notes })
    }
}

/// Whether a path leads to something within the volume.
fn is_plain(path: &str) -> bool {
    path.split('/').all(|part| !["", ".", ".."].contains(&part))
}

/// Reads the axes: their number before z, and the lengths of the units along z, y, x.
fn axes(axes: &Value, notes: &mut Vec<String>) -> Result<(usize, [f64; 3]), NoImage> {
    let field = "multiscales.axes";
    let axes = axes.as_array().map_or(&[][..], Vec::as_slice);
    let is_space = |axis: &Value| axis["type"].as_str() == Some("space");
    let leading = axes.iter().take_while(|axis| !is_space(axis)).count();
    let space = &axes[leading..];
    let ([z, y, x], true) = (space, space.iter().all(is_space)) else {
        let found = axes.iter().filter(|axis| is_space(axis)).count();
        let advice = "a volume has three, which must be the last; give another image";
        return bad(field, format!("has {found} axes of space: {advice}"));
    };
    let names = [z, y, x].map(|axis| axis["name"].as_str().unwrap_or_default());
    let mut sorted = names;
    sorted.sort_unstable();
    if sorted == ["x", "y", "z"] && names != ["z", "y", "x"] {
        return bad(field, format!("are in the order {}; they must be z, y, x", names.join(", ")));
    }
    let mut lengths = [1.0; 3];
    for (length, axis) in lengths.iter_mut().zip([z, y, x]) {
        match axis["unit"].as_str() {
            None => notes.push("the volume's axes have no unit: millimeter is taken".to_owned()),
            Some(unit) => match UNITS.iter().find(|(name, _)| *name == unit) {
                Some((_, mm)) => *length = *mm,
                None => {
                    return bad(field, format!("have the unit {unit:?}, which is not read; convert it to millimeter"));
                }
            },
        }
    }
    notes.dedup();
    Ok((leading, lengths))
}

/// Reads scale and translation along z, y, x. The translation follows the scale.
fn transforms(all: Option<&Value>, leading: usize, field: &str) -> Result<[[f64; 3]; 2], NoImage> {
    let (mut scale, mut translation) = ([1.0; 3], [0.0; 3]);
    let all = all.and_then(Value::as_array).map_or(&[][..], Vec::as_slice);
    for transform in all {
        let kind = transform["type"].as_str().unwrap_or_default();
        let numbers = || -> Option<[f64; 3]> {
            let numbers: Vec<f64> = transform[kind].as_array()?.iter().map(Value::as_f64).collect::<Option<_>>()?;
            let numbers = numbers.get(leading..)?;
            numbers.try_into().ok().filter(|n: &[f64; 3]| n.iter().all(|number| number.is_finite()))
        };
        match kind {
            "identity" => {}
            "scale" | "translation" => {
                let Some(numbers) = numbers() else {
                    return bad(field, format!("has a {kind} that is no list; it must have a number an axis"));
                };
                if kind == "scale" {
                    scale = std::array::from_fn(|a| scale[a] * numbers[a]);
                    translation = std::array::from_fn(|a| translation[a] * numbers[a]);
                } else {
                    translation = std::array::from_fn(|a| translation[a] + numbers[a]);
                }
            }
            other => {
                let advice = "OME-Zarr 0.5 has scale and translation; convert it";
                return bad(field, format!("has the type {other:?}: {advice}"));
            }
        }
    }
    Ok([scale, translation])
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn attributes() -> Value {
        let axis = |name: &str| json!({"name": name, "type": "space", "unit": "micrometer"});
        json!({"ome": {"version": "0.5", "multiscales": [{
            "axes": [{"name": "t", "type": "time"}, {"name": "c", "type": "channel"}, axis("z"), axis("y"), axis("x")],
            "datasets": [{"path": "0", "coordinateTransformations": [
                {"type": "scale", "scale": [1, 1, 500, 250, 125]},
                {"type": "translation", "translation": [0, 0, 3000, 2000, 1000]},
            ]}],
            "coordinateTransformations": [{"type": "scale", "scale": [1, 1, 2, 2, 2]}],
        }]}})
    }

    #[test]
    fn units_and_transforms_are_combined() {
        let image = Image::read(&attributes()).unwrap();
        assert_eq!((image.leading, image.levels.len()), (2, 1));
        assert_eq!(image.levels[0].scale, [1.0, 0.5, 0.25]);
        assert_eq!(image.levels[0].translation, [6.0, 4.0, 2.0]);
        assert_eq!(image.notes, [""; 0]);
    }

    #[test]
    fn other_images_are_refused_by_field() {
        let with = |path: &str, value: Value| {
            let mut attributes = attributes();
            *attributes.pointer_mut(path).unwrap() = value;
            Image::read(&attributes)
        };
        assert_eq!(Image::read(&json!({})), Err(NoImage::Absent));
        assert_eq!(with("/ome/multiscales", json!([])), Err(NoImage::Absent));
        assert_eq!(with("/ome/version", json!("0.6")), Err(NoImage::Version("0.6".to_owned())));
        let first = "/ome/multiscales/0";
        for (path, value, sentence) in [
            ("axes/2/type", json!("channel"), "has 2 axes of space"),
            ("axes/4/unit", json!("parsec"), "have the unit \"parsec\""),
            ("axes/4/name", json!("y"), ""),
            ("datasets", json!([]), "has no level"),
            ("datasets/0/path", json!("../0"), "must be the name"),
            ("datasets/0/coordinateTransformations/0/type", json!("affine"), "has the type \"affine\""),
            ("datasets/0/coordinateTransformations/0/scale", json!([1, 2, 3]), "has a scale that is no list"),
            ("datasets/0/coordinateTransformations/0/scale", json!([1, 1, 0, 1, 1]), "scales by numbers"),
        ] {
            match with(&format!("{first}/{path}"), value) {
                Err(NoImage::Field(field, problem)) => assert!(problem.contains(sentence), "{field}: {problem}"),
                other => assert!(sentence.is_empty(), "{path}: {other:?}"),
            }
        }
        let mut attributes = attributes();
        for (at, name) in [(2, "x"), (4, "z")] {
            attributes["ome"]["multiscales"][0]["axes"][at]["name"] = json!(name);
        }
        assert!(matches!(Image::read(&attributes), Err(NoImage::Field(_, problem)) if problem.contains("x, y, z")));
    }

    #[test]
    fn axes_without_unit_are_noted() {
        let mut attributes = attributes();
        for at in 2..5 {
            attributes["ome"]["multiscales"][0]["axes"][at].as_object_mut().unwrap().remove("unit");
        }
        let image = Image::read(&attributes).unwrap();
        assert_eq!((image.levels[0].scale, image.notes.len()), ([1000.0, 500.0, 250.0], 1));
    }
}
