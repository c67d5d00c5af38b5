use std::io::ErrorKind;
use std::path::Path;

use super::*;
use crate::error::SurfaceError;
use crate::files::Format;

/// Provenance with characters that formats must quote, and with others than ASCII.
const PROVENANCE: &str = "sonoweave 1.0, \"sweep\" of 3 Mär\nFor research: not anatomical truth\n\n\u{7}end_header\n";

fn mesh() -> Mesh {
    let ball = |[x, y, z]: [i64; 3]| Some((127.5 + 60.0 * (5.3 - ((x * x + y * y + z * z) as f64).sqrt())) as f32);
    half_level(&Field { low: [-9; 3], high: [9; 3], value: ball }, turned_lattice()).0
}

fn written(format: Format, mesh: &Mesh) -> Vec<u8> {
    let mut bytes = Vec::new();
    format.write(mesh, PROVENANCE, &mut bytes).unwrap();
    bytes
}

fn f32_at(bytes: &[u8], at: usize) -> f32 {
    f32::from_le_bytes(bytes[at..at + 4].try_into().unwrap())
}

fn vec_at(bytes: &[u8], at: usize) -> [f32; 3] {
    [0, 4, 8].map(|k| f32_at(bytes, at + k))
}

fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap())
}

fn corners(mesh: &Mesh) -> Vec<[[f32; 3]; 3]> {
    mesh.triangles.iter().map(|triangle| triangle.map(|vertex| mesh.vertices[vertex as usize])).collect()
}

#[test]
fn extensions_name_formats() {
    let of = |name: &str| Format::of(Path::new(name));
    assert_eq!(of("a/b.c.STL"), Ok(Format::Stl));
    assert_eq!([of("a.ply"), of("a.obj"), of("a.glb")], [Ok(Format::Ply), Ok(Format::Obj), Ok(Format::Glb)]);
    for name in ["a", "a.gltf", "stl", ""] {
        assert_eq!(of(name), Err(SurfaceError::Extension { path: name.into() }));
    }
}

#[test]
fn empty_mesh_is_not_written() {
    for format in [Format::Stl, Format::Ply, Format::Obj, Format::Glb] {
        let mut bytes = Vec::new();
        let error = format.write(&Mesh::default(), "", &mut bytes).unwrap_err();
        assert_eq!((error.kind(), bytes.len()), (ErrorKind::InvalidInput, 0));
        assert_eq!(error.into_inner().unwrap().downcast_ref(), Some(&SurfaceError::Empty));
    }
}

#[test]
fn stl_holds_the_triangles() {
    let mesh = mesh();
    let bytes = written(Format::Stl, &mesh);
    assert_eq!(bytes.len(), 84 + 50 * mesh.triangles.len());
    assert!(bytes.starts_with(b"STL in mm; sonoweave 1.0, \"sweep\" of 3 M?r; For research") && bytes[..80].is_ascii());
    assert_eq!(u32_at(&bytes, 80) as usize, mesh.triangles.len());
    for (record, corners) in bytes[84..].chunks_exact(50).zip(corners(&mesh)) {
        assert_eq!([12, 24, 36].map(|at| vec_at(record, at)), corners);
        let [a, b, c] = corners.map(|at| DVec3::from_array(at.map(f64::from)));
        let normal = DVec3::from_array(vec_at(record, 0).map(f64::from));
        assert!(normal.distance((b - a).cross(c - a).normalize()) < 1e-6);
    }
}

#[test]
fn stl_is_read_by_stl_io() {
    let mesh = mesh();
    let read = stl_io::read_stl(&mut std::io::Cursor::new(written(Format::Stl, &mesh))).unwrap();
    let of = |face: &stl_io::IndexedTriangle| face.vertices.map(|vertex| read.vertices[vertex]);
    let found: Vec<[[f32; 3]; 3]> = read.faces.iter().map(|face| of(face).map(|v| [v[0], v[1], v[2]])).collect();
    assert_eq!(found, corners(&mesh));
    read.validate().unwrap();
}

#[test]
fn ply_holds_vertices_normals_and_triangles() {
    let mesh = mesh();
    let bytes = written(Format::Ply, &mesh);
    let end = bytes.windows(11).position(|window| window == b"end_header\n").unwrap();
    let comment = bytes.windows(19).position(|window| window == b"comment end_header\n").unwrap();
    assert_eq!(end, comment + 8);
    let start = bytes.windows(12).position(|window| window == b"\nend_header\n").unwrap() + 12;
    let header = std::str::from_utf8(&bytes[..start]).unwrap();
    assert!(header.starts_with("ply\nformat binary_little_endian 1.0\ncomment unit: mm\ncomment sonoweave 1.0"));
    assert!(header.contains("\ncomment For research: not anatomical truth\n"));
    assert!(header.contains(&format!("\nelement vertex {}\n", mesh.vertices.len())));
    assert!(
        header.contains(&format!("\nelement face {}\nproperty list uchar uint vertex_indices\n", mesh.triangles.len()))
    );
    let faces = start + 24 * mesh.vertices.len();
    for (i, record) in bytes[start..faces].chunks_exact(24).enumerate() {
        assert_eq!((vec_at(record, 0), vec_at(record, 12)), (mesh.vertices[i], mesh.normals[i]));
    }
    let found: Vec<[u32; 3]> =
        bytes[faces..].chunks_exact(13).map(|face| [1, 5, 9].map(|at| u32_at(face, at))).collect();
    assert_eq!((found, bytes.len()), (mesh.triangles.clone(), faces + 13 * mesh.triangles.len()));
}

#[test]
fn obj_reads_back_as_the_same_bits() {
    let mesh = mesh();
    let text = String::from_utf8(written(Format::Obj, &mesh)).unwrap();
    assert!(
        text.starts_with("# unit: mm\n# sonoweave 1.0, \"sweep\" of 3 Mär\n# For research: not anatomical truth\n")
    );
    let vectors = |name: &str| -> Vec<[f32; 3]> {
        let rows = text.lines().filter_map(|line| line.strip_prefix(name)?.strip_prefix(' '));
        let numbers = rows.map(|row| row.split(' ').map(|word| word.parse().unwrap()).collect::<Vec<f32>>());
        numbers.map(|row| row.try_into().unwrap()).collect()
    };
    let corner = |word: &str| {
        let (vertex, normal) = word.split_once("//").unwrap();
        assert_eq!(vertex, normal);
        vertex.parse::<u32>().unwrap() - 1
    };
    let faces = text.lines().filter_map(|line| line.strip_prefix("f "));
    let triangles = faces.map(|row| row.split(' ').map(corner).collect::<Vec<u32>>().try_into().unwrap()).collect();
    assert_eq!(Mesh { vertices: vectors("v"), normals: vectors("vn"), triangles }, mesh);
}

#[test]
fn glb_accessors_lead_to_the_mesh() {
    let mesh = mesh();
    let bytes = written(Format::Glb, &mesh);
    let json_bytes = u32_at(&bytes, 12) as usize;
    let json: serde_json::Value = serde_json::from_slice(&bytes[20..20 + json_bytes]).unwrap();
    let binary = &bytes[28 + json_bytes..];
    let number = |value: &serde_json::Value| value.as_u64().unwrap_or_default() as usize;
    let scene = &json["scenes"][number(&json["scene"])];
    let node = &json["nodes"][number(&scene["nodes"][0])];
    assert_eq!(node["scale"], serde_json::json!([0.001, 0.001, 0.001]));
    let primitive = &json["meshes"][number(&node["mesh"])]["primitives"][0];
    // Triangles are the default.
    assert!(primitive["mode"].is_null() || primitive["mode"] == 4);
    let words = |accessor: &serde_json::Value, component: u32, kind: &str| -> Vec<u32> {
        let accessor = &json["accessors"][number(accessor)];
        assert_eq!((&accessor["componentType"], &accessor["type"]), (&component.into(), &kind.into()));
        let view = &json["bufferViews"][number(&accessor["bufferView"])];
        let start = number(&view["byteOffset"]) + number(&accessor["byteOffset"]);
        let each = if kind == "SCALAR" { 1 } else { 3 };
        (0..each * number(&accessor["count"])).map(|k| u32_at(binary, start + 4 * k)).collect()
    };
    let vectors = |name: &str| -> Vec<[f32; 3]> {
        words(&primitive["attributes"][name], 5126, "VEC3")
            .as_chunks::<3>()
            .0
            .iter()
            .map(|v| v.map(f32::from_bits))
            .collect()
    };
    let positions = &json["accessors"][number(&primitive["attributes"]["POSITION"])];
    let bound = |name: &str| [0, 1, 2].map(|a| positions[name][a].as_f64().unwrap() as f32);
    assert_eq!([bound("min"), bound("max")], mesh.bounds().unwrap());
    let triangles = words(&primitive["indices"], 5125, "SCALAR").as_chunks::<3>().0.to_vec();
    assert_eq!(Mesh { vertices: vectors("POSITION"), normals: vectors("NORMAL"), triangles }, mesh);
}

#[test]
fn glb_has_two_chunks_of_whole_words() {
    let mesh = mesh();
    let bytes = written(Format::Glb, &mesh);
    assert_eq!((&bytes[..4], u32_at(&bytes, 4), u32_at(&bytes, 8) as usize), (&b"glTF"[..], 2, bytes.len()));
    let json_bytes = u32_at(&bytes, 12) as usize;
    assert_eq!((&bytes[16..20], json_bytes % 4), (&b"JSON"[..], 0));
    let json: serde_json::Value = serde_json::from_slice(&bytes[20..20 + json_bytes]).unwrap();
    let extras = &json["asset"]["extras"];
    let lines = ["sonoweave 1.0, \"sweep\" of 3 Mär", "For research: not anatomical truth", "end_header"];
    assert_eq!((&extras["unit"], &extras["provenance"]), (&"mm".into(), &serde_json::json!(lines)));
    assert_eq!(json["buffers"][0]["byteLength"], mesh.bytes());
    let binary = 20 + json_bytes;
    assert_eq!((u64::from(u32_at(&bytes, binary)), &bytes[binary + 4..binary + 8]), (mesh.bytes(), &b"BIN\0"[..]));
    assert_eq!(bytes.len() as u64, binary as u64 + 8 + mesh.bytes());
}
