//! The metadata files of a volume: `zarr.json` of groups and arrays.

use std::fmt::Write as _;
use std::io::ErrorKind;
use std::path::Path;

use serde_json::{Value, json};
use sha2::{Digest as _, Sha256};

use crate::error::OmeZarrError;
use crate::meta::Meta;
use crate::scalar::Scalar;

/// Metadata file of a group or an array.
pub(crate) const FILE: &str = "zarr.json";
/// Version of OME-Zarr.
pub(crate) const VERSION: &str = "0.5";
/// Attribute of this program's own.
pub(crate) const OWN: &str = "sonoweave";

/// A kind of voxel data: an image of its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    /// Values.
    Value,
    /// Weights.
    Weight,
    /// 1 where a voxel was seen.
    Seen,
}

impl Kind {
    /// Returns the folder of the image, as a prefix of keys.
    pub(crate) fn prefix(self) -> &'static str {
        match self {
            Self::Value => "",
            Self::Weight => "weight/",
            Self::Seen => "labels/seen/",
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Value => "value",
            Self::Weight => "weight",
            Self::Seen => "seen",
        }
    }
}

impl Meta {
    /// Returns the images that are written.
    pub(crate) fn kinds(&self) -> &'static [Kind] {
        if self.label { &[Kind::Value, Kind::Weight, Kind::Seen] } else { &[Kind::Value, Kind::Weight] }
    }

    /// Returns the scalar type of an image.
    pub(crate) fn scalar_of(&self, kind: Kind) -> Scalar {
        match kind {
            Kind::Value => self.scalar,
            Kind::Weight => Scalar::F32,
            Kind::Seen => Scalar::U8,
        }
    }

    /// Returns the value of unseen voxels of an image.
    pub(crate) fn fill_of(&self, kind: Kind) -> f32 {
        if kind == Kind::Value { self.unseen } else { 0.0 }
    }
}

/// Returns all metadata files by their keys; the root's is last.
pub(crate) fn files(meta: &Meta) -> Vec<(String, String)> {
    let mut files = Vec::new();
    for kind in meta.kinds() {
        for level in 0..meta.extent.levels() {
            files.push((format!("{}{level}/{FILE}", kind.prefix()), text(&array(meta, *kind, level))));
        }
    }
    files.push((format!("weight/{FILE}"), text(&image(meta, Kind::Weight))));
    if meta.label {
        files.push((format!("labels/seen/{FILE}"), text(&image(meta, Kind::Seen))));
        files.push((format!("labels/{FILE}"), text(&group(json!({"version": VERSION, "labels": ["seen"]}), None))));
    }
    files.push((FILE.to_owned(), text(&image(meta, Kind::Value))));
    files
}

/// Reads a metadata file; `None` if there is none.
pub(crate) fn read_json(path: &Path, key: &str) -> Result<Option<Value>, OmeZarrError> {
    let file = path.join(key);
    let text = match std::fs::read(&file) {
        Ok(text) => text,
        Err(error) if error.kind() == ErrorKind::NotADirectory => {
            return Err(OmeZarrError::IsFile { path: path.into() });
        }
        Err(error) if error.kind() == ErrorKind::NotFound && path.exists() => return Ok(None),
        Err(error) => return Err(OmeZarrError::io(file, "reading")(error)),
    };
    let json = serde_json::from_slice(&text);
    let fault = |error: serde_json::Error| OmeZarrError::Json {
        path: path.into(),
        key: key.to_owned(),
        problem: error.to_string(),
    };
    json.map(Some).map_err(fault)
}

/// Returns the hash of everything that a description decides.
pub(crate) fn fingerprint(files: &[(String, String)]) -> String {
    let mut hash = Sha256::new();
    for (key, text) in files {
        for part in [key, text] {
            hash.update(part);
            hash.update([0]);
        }
    }
    hex(&hash.finalize())
}

/// Returns bytes as hexadecimal digits.
pub(crate) fn hex(bytes: &[u8]) -> String {
    bytes.iter().fold(String::new(), |mut text, byte| {
        let _ = write!(text, "{byte:02x}");
        text
    })
}

/// Returns the metadata of an array.
pub(crate) fn array(meta: &Meta, kind: Kind, level: usize) -> Value {
    let (shard, chunk) = (meta.extent.shard, meta.extent.chunk);
    let scalar = meta.scalar_of(kind);
    let bytes = json!({"name": "bytes", "configuration": {"endian": "little"}});
    let zstd = json!({"name": "zstd", "configuration": {"level": 3, "checksum": false}});
    let crc = json!({"name": "crc32c"});
    json!({
        "zarr_format": 3,
        "node_type": "array",
        "shape": meta.extent.shape(level),
        "data_type": scalar.data_type(),
        "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": [shard, shard, shard]}},
        "chunk_key_encoding": {"name": "default", "configuration": {"separator": "/"}},
        "fill_value": fill(scalar, meta.fill_of(kind)),
        // Each chunk has a checksum of its own: those of the index do not cover voxels.
        "codecs": [{"name": "sharding_indexed", "configuration": {
            "chunk_shape": [chunk, chunk, chunk],
            "codecs": [bytes, zstd, crc],
            "index_codecs": [bytes, crc],
            "index_location": "end",
        }}],
        "attributes": {},
        "dimension_names": ["z", "y", "x"],
    })
}

/// Returns a fill value as array metadata has it.
fn fill(scalar: Scalar, value: f32) -> Value {
    match scalar {
        Scalar::U8 | Scalar::U16 => json!(value as u64),
        Scalar::F32 if value.is_nan() => json!("NaN"),
        Scalar::F32 if value.is_infinite() => json!(if value > 0.0 { "Infinity" } else { "-Infinity" }),
        Scalar::F32 => json!(value),
    }
}

/// Returns the metadata of an image: the volume itself, its weights, or its label.
fn image(meta: &Meta, kind: Kind) -> Value {
    let axes = ["z", "y", "x"].map(|name| json!({"name": name, "type": "space", "unit": "millimeter"}));
    let datasets: Vec<Value> = (0..meta.extent.levels())
        .map(|level| {
            let [scale, translation] = place(meta, level);
            json!({"path": level.to_string(), "coordinateTransformations": [
                {"type": "scale", "scale": scale},
                {"type": "translation", "translation": translation},
            ]})
        })
        .collect();
    let method = if kind == Kind::Seen { "any" } else { "weighted mean" };
    let multiscales = json!([{
        "name": kind.name(),
        "axes": axes,
        "datasets": datasets,
        "type": method,
        "metadata": {"method": OWN, "version": env!("CARGO_PKG_VERSION")},
    }]);
    match kind {
        Kind::Value => group(json!({"version": VERSION, "multiscales": multiscales}), Some(own(meta))),
        Kind::Weight => group(json!({"version": VERSION, "multiscales": multiscales}), None),
        Kind::Seen => {
            let colors = json!([{"label-value": 1, "rgba": [0, 160, 255, 96]}]);
            let label = json!({"colors": colors, "source": {"image": "../../"}});
            group(json!({"version": VERSION, "multiscales": multiscales, "image-label": label}), None)
        }
    }
}

/// Returns scale and translation of a level along z, y, x. The first voxel of a level lies in the
/// middle of its children.
fn place(meta: &Meta, level: usize) -> [[f64; 3]; 2] {
    let factor = (1_u64 << level) as f64;
    let ([sx, sy, sz], [ox, oy, oz]) = (meta.spacing.to_array(), meta.origin.to_array());
    let (spacing, origin) = ([sz, sy, sx], [oz, oy, ox]);
    [spacing.map(|s| s * factor), std::array::from_fn(|a| origin[a] + spacing[a] * (factor - 1.0) / 2.0)]
}

/// Returns this program's own attributes.
fn own(meta: &Meta) -> Value {
    let mut own = json!({
        "version": env!("CARGO_PKG_VERSION"),
        "content_key": meta.content_key,
        "lattice_index": index(meta.extent.first),
        "fields": meta.fields.iter().map(|(name, value)| json!([name, value])).collect::<Vec<_>>(),
    });
    if let Some(range) = meta.range {
        own["range"] = json!(range);
    }
    if let Some([first, last]) = meta.slices_box {
        own["slices_box"] = json!({"first": index(first), "last": index(last)});
    }
    if meta.direction != glam::DMat3::IDENTITY {
        let rows = meta.grid().world_from_volume().to_rows();
        own["world_from_volume"] = json!(rows.chunks(4).collect::<Vec<_>>());
    }
    own
}

/// Returns a lattice index with the names of its axes.
fn index([x, y, z]: [i64; 3]) -> Value {
    json!({"z": z, "y": y, "x": x})
}

fn group(ome: Value, own: Option<Value>) -> Value {
    let mut attributes = json!({"ome": ome});
    if let Some(own) = own {
        attributes[OWN] = own;
    }
    json!({"zarr_format": 3, "node_type": "group", "attributes": attributes})
}

fn text(value: &Value) -> String {
    format!("{value:#}\n")
}
