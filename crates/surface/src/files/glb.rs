//! Binary glTF 2.0: JSON, and one buffer of positions, normals and indices. Positions are in mm; a
//! node scales them to metres.

use std::io::{self, Write};

use crate::mesh::Mesh;

/// Largest mesh, bytes. The file's length has 32 bits, and must hold the JSON, too.
pub(super) const MOST_BYTES: u64 = u32::MAX as u64 - (1 << 20);

/// Bytes of a chunk's length and type.
const CHUNK_HEADER: usize = 8;

/// Writes a mesh, the provenance in `extras` of the asset.
pub(super) fn write(
    mesh: &Mesh,
    lines: impl Iterator<Item = String>,
    to: &mut (impl Write + ?Sized),
) -> io::Result<()> {
    let mut json = json(mesh, lines)?;
    while json.len() % 4 != 0 {
        json.push(' ');
    }
    // All numbers have 4 bytes, and need no padding.
    let binary = mesh.bytes() as usize;
    let total = 12 + CHUNK_HEADER + json.len() + CHUNK_HEADER + binary;
    to.write_all(b"glTF")?;
    for number in [2, total, json.len()] {
        to.write_all(&(number as u32).to_le_bytes())?;
    }
    to.write_all(b"JSON")?;
    to.write_all(json.as_bytes())?;
    to.write_all(&(binary as u32).to_le_bytes())?;
    to.write_all(b"BIN\0")?;
    for number in mesh.vertices.iter().chain(&mesh.normals).flatten() {
        to.write_all(&number.to_le_bytes())?;
    }
    for vertex in mesh.triangles.iter().flatten() {
        to.write_all(&vertex.to_le_bytes())?;
    }
    Ok(())
}

/// Returns the JSON, always with its keys in this order.
fn json(mesh: &Mesh, lines: impl Iterator<Item = String>) -> io::Result<String> {
    let provenance = serde_json::to_string(&lines.collect::<Vec<_>>())?;
    let [low, high] = mesh.bounds().unwrap_or_default();
    let (low, high) = (serde_json::to_string(&low)?, serde_json::to_string(&high)?);
    let (vertices, indices) = (mesh.vertices.len(), 3 * mesh.triangles.len());
    let (positions, corners) = (12 * vertices, 4 * indices);
    let (from, all) = (2 * positions, mesh.bytes());
    Ok(format!(
        r#"{{"asset":{{"version":"2.0","generator":"sonoweave","extras":{{"unit":"mm","provenance":{provenance}}}}},
"scene":0,"scenes":[{{"nodes":[0]}}],
"nodes":[{{"mesh":0,"scale":[0.001,0.001,0.001],"extras":{{"unit":"mm"}}}}],
"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0,"NORMAL":1}},"indices":2,"mode":4}}]}}],
"accessors":[
{{"bufferView":0,"componentType":5126,"count":{vertices},"type":"VEC3","min":{low},"max":{high}}},
{{"bufferView":1,"componentType":5126,"count":{vertices},"type":"VEC3"}},
{{"bufferView":2,"componentType":5125,"count":{indices},"type":"SCALAR"}}],
"bufferViews":[
{{"buffer":0,"byteOffset":0,"byteLength":{positions},"target":34962}},
{{"buffer":0,"byteOffset":{positions},"byteLength":{positions},"target":34962}},
{{"buffer":0,"byteOffset":{from},"byteLength":{corners},"target":34963}}],
"buffers":[{{"byteLength":{all}}}]}}"#
    ))
}
