//! This program's own attributes of a volume, as they are read.

use glam::DAffine3;
use serde_json::Value;

use sonoweave_core::frames::affine_from_rows;

use crate::metadata::OWN;

/// Attributes of a volume that this program has written.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Own {
    pub(crate) content_key: String,
    pub(crate) first: [i64; 3],
    pub(crate) fields: Vec<(String, String)>,
    pub(crate) range: Option<[f32; 2]>,
    pub(crate) slices_box: Option<[[i64; 3]; 2]>,
    pub(crate) world_from_volume: Option<DAffine3>,
}

impl Own {
    /// Reads the attributes of a group; `None` if they are another program's. Errors are the field
    /// and its fault.
    pub(crate) fn read(attributes: &Value) -> Result<Option<Self>, (String, String)> {
        let Some(own) = attributes.get(OWN) else { return Ok(None) };
        let fault = |field: &str, problem: &str| (format!("{OWN}.{field}"), problem.to_owned());
        let first =
            index(&own["lattice_index"]).ok_or_else(|| fault("lattice_index", "must be whole numbers z, y, x"))?;
        let fields = own["fields"].as_array().map(|all| all.iter().map(field).collect::<Option<Vec<_>>>());
        let fields = match fields {
            None => Vec::new(),
            Some(fields) => fields.ok_or_else(|| fault("fields", "must be pairs of texts"))?,
        };
        let range = match own.get("range") {
            None => None,
            Some(range) => {
                let range = numbers::<2>(range).map(|range| range.map(|number| number as f32));
                Some(range.filter(|[low, high]| low < high).ok_or_else(|| fault("range", "must be two numbers"))?)
            }
        };
        let slices_box = match own.get("slices_box") {
            None => None,
            Some(ends) => {
                let ends = index(&ends["first"]).zip(index(&ends["last"]));
                let (first, last) =
                    ends.ok_or_else(|| fault("slices_box", "must be a first and a last lattice index"))?;
                Some([first, last])
            }
        };
        let world_from_volume = match own.get("world_from_volume") {
            None => None,
            Some(rows) => {
                let rows: Option<Vec<[f64; 4]>> =
                    rows.as_array().and_then(|rows| rows.iter().map(numbers::<4>).collect());
                let rows = rows.and_then(|rows| <[[f64; 4]; 4]>::try_from(rows).ok());
                let affine = rows.and_then(|rows| affine_from_rows(rows.as_flattened().try_into().ok()?).ok());
                let must_be = "must be a matrix of 4×4 numbers, the last row 0 0 0 1";
                Some(affine.ok_or_else(|| fault("world_from_volume", must_be))?)
            }
        };
        let content_key = own["content_key"].as_str().unwrap_or_default().to_owned();
        Ok(Some(Self { content_key, first, fields, range, slices_box, world_from_volume }))
    }
}

/// Reads a lattice index, in the order x, y, z.
fn index(value: &Value) -> Option<[i64; 3]> {
    Some([value["x"].as_i64()?, value["y"].as_i64()?, value["z"].as_i64()?])
}

fn field(value: &Value) -> Option<(String, String)> {
    let [name, value] = value.as_array()?.as_slice() else { return None };
    Some((name.as_str()?.to_owned(), value.as_str()?.to_owned()))
}

/// Reads a list of N finite numbers.
pub(crate) fn numbers<const N: usize>(value: &Value) -> Option<[f64; N]> {
    let numbers: Vec<f64> = value.as_array()?.iter().map(Value::as_f64).collect::<Option<_>>()?;
    <[f64; N]>::try_from(numbers).ok().filter(|numbers| numbers.iter().all(|number| number.is_finite()))
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn malformed_attributes_are_named() {
        assert_eq!(Own::read(&json!({"ome": {}})), Ok(None));
        let index = json!({"z": 3, "y": 2, "x": -1});
        let good = json!({"sonoweave": {"lattice_index": index, "fields": [["a", "b"]], "range": [0, 1]}});
        let own = Own::read(&good).unwrap().unwrap();
        assert_eq!((own.first, own.range), ([-1, 2, 3], Some([0.0, 1.0])));
        for (field, value) in [
            ("lattice_index", json!([1, 2, 3])),
            ("fields", json!([["a", 1]])),
            ("range", json!([1, 1])),
            ("slices_box", json!({"first": index})),
            ("world_from_volume", json!([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]])),
        ] {
            let mut bad = good.clone();
            bad["sonoweave"][field] = value;
            assert_eq!(Own::read(&bad).unwrap_err().0, format!("sonoweave.{field}"));
        }
    }
}
