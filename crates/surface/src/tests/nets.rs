use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::PI;

use glam::DVec3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::ThreadPoolBuilder;

use super::reference::{Key, reference};
use super::*;
use crate::closed::Topology;
use crate::compensation::compensate;
use crate::error::SurfaceError;
use crate::measure::{area_mm2, volume_mm3};
use crate::parts::parts;
use crate::surface_nets::IncrementalSurface;

/// Value near the surface of a ball: 127.5 there, and lower by 100 a voxel outwards.
fn ball(voxel: [i64; 3], centre: [f64; 3], radius: f64) -> f32 {
    let distance = DVec3::from_array(voxel.map(|at| at as f64)).distance(DVec3::from_array(centre));
    (127.5 + 100.0 * (radius - distance)).clamp(0.0, 255.0) as f32
}

fn whole(
    low: i64,
    high: i64,
    value: impl Fn([i64; 3]) -> f32 + Sync,
) -> Field<impl Fn([i64; 3]) -> Option<f32> + Sync> {
    Field { low: [low; 3], high: [high; 3], value: move |voxel| Some(value(voxel)) }
}

/// Noise of a voxel, 0..255, the same for each call.
fn noise(voxel: [i64; 3]) -> f32 {
    let seed = voxel.iter().fold(17_u64, |seed, at| seed.wrapping_mul(1 << 20).wrapping_add((at + 512) as u64));
    ChaCha8Rng::seed_from_u64(seed).random_range(0.0..255.0)
}

#[test]
fn sphere_has_volume_within_tenth_percent() {
    let field = whole(-30, 30, |voxel| ball(voxel, [0.2, -0.3, 0.1], 25.0));
    let (mesh, _) = half_level(&field, lattice(0.5));
    let topology = Topology::of(&mesh);
    assert!(topology.is_closed());
    assert_eq!((topology.components, topology.euler_number(), topology.non_manifold_edges), (1, 2, 0));
    let (volume, area) = (4.0 / 3.0 * PI * 12.5_f64.powi(3), 4.0 * PI * 12.5_f64.powi(2));
    let error = |mesh: &Mesh| volume_mm3(mesh, &topology).unwrap() / volume - 1.0;
    // Interpolation and chords take 0.16 %.
    assert!((error(&mesh) + 1.56e-3).abs() < 2e-4, "{}", error(&mesh));
    assert!((area_mm2(&mesh) / area - 1.0).abs() < 2e-3, "{}", area_mm2(&mesh) / area);
    let (compensated, _) = compensate(&mesh, &field, lattice(0.5), 0.0).unwrap();
    assert!(error(&compensated).abs() < 1e-4, "{}", error(&compensated));
}

#[test]
fn normals_point_from_inside_to_outside() {
    let centre = [0.2, -0.3, 0.1];
    for (sign, is_bright) in [(1.0, true), (-1.0, false)] {
        let field =
            whole(
                -15,
                15,
                |voxel| if is_bright { ball(voxel, centre, 12.0) } else { 255.0 - ball(voxel, centre, 12.0) },
            );
        let mirrored = Transform::from_affine(DAffine3::from_scale(DVec3::new(-0.5, 0.5, 0.5)));
        for world_from_lattice in [lattice(0.5), mirrored] {
            let (mesh, _) = half_level(&field, world_from_lattice);
            let middle = world_from_lattice.point(DVec3::from_array(centre));
            let of = |vertex: u32| DVec3::from_array(mesh.vertices[vertex as usize].map(f64::from));
            for [a, b, c] in &mesh.triangles {
                let (p, q, r) = (of(*a), of(*b), of(*c));
                assert!(sign * (q - p).cross(r - p).dot(p - middle) > 0.0);
            }
            for (vertex, normal) in mesh.vertices.iter().zip(&mesh.normals) {
                let (outwards, normal) =
                    (DVec3::from_array(vertex.map(f64::from)) - middle, DVec3::from_array(normal.map(f64::from)));
                assert!((normal.length() - 1.0).abs() < 1e-6 && sign * normal.dot(outwards.normalize()) > 0.98);
            }
            let volume = volume_mm3(&mesh, &Topology::of(&mesh)).unwrap();
            assert_eq!(volume > 0.0, is_bright);
        }
    }
}

#[test]
fn bodies_touching_at_a_corner_stay_apart() {
    let cubes = |voxel: [i64; 3]| {
        let is_in = |low: i64, high: i64| voxel.iter().all(|at| (low..=high).contains(at));
        if is_in(-6, -1) || is_in(0, 5) { 200.0 } else { 40.0 }
    };
    let (mesh, _) = half_level(&whole(-10, 10, cubes), lattice(1.0));
    let topology = Topology::of(&mesh);
    assert_eq!((topology.components, topology.euler_number()), (2, 4));
    assert_eq!((topology.open_edges, topology.non_manifold_edges), (0, 0));
}

#[test]
fn bodies_that_merge_are_one_component() {
    let balls = |voxel| ball(voxel, [-7.0, 0.0, 0.0], 8.0).max(ball(voxel, [7.0, 0.0, 0.0], 8.0));
    let topology = Topology::of(&half_level(&whole(-20, 20, balls), lattice(1.0)).0);
    assert!(topology.is_closed());
    assert_eq!((topology.components, topology.euler_number()), (1, 2));
}

#[test]
fn parts_of_a_mesh_have_volumes_of_their_own() {
    // The second ball is cut by the end of coverage, and the third is a hollow in the first.
    let balls = |voxel| {
        let solid = ball(voxel, [-9.0, 0.0, 0.0], 8.0).max(ball(voxel, [11.0, 0.0, 12.0], 5.0));
        solid.min(255.0 - ball(voxel, [-9.0, 1.0, 0.0], 4.0))
    };
    let field = Field { low: [-20; 3], high: [20, 20, 13], value: |voxel| Some(balls(voxel)) };
    let (mesh, _) = half_level(&field, lattice(1.0));
    assert!(!Topology::of(&mesh).is_closed());
    let parts = parts(&mesh);
    let volumes: Vec<Option<f64>> = parts.iter().map(|part| volume_mm3(part, &Topology::of(part)).ok()).collect();
    let [Some(large), None, Some(hollow)] = volumes[..] else { panic!("{volumes:?}") };
    let sphere = |radius: f64| 4.0 / 3.0 * PI * radius.powi(3);
    assert!((large / sphere(8.0) - 1.0).abs() < 0.03 && (hollow / -sphere(4.0) - 1.0).abs() < 0.1);
    assert!(parts.iter().all(|part| Topology::of(part).components == 1));
    assert_eq!(parts.iter().map(|part| part.triangles.len()).sum::<usize>(), mesh.triangles.len());
}

#[test]
fn torus_has_euler_number_zero() {
    let torus = |voxel: [i64; 3]| {
        let [x, y, z] = voxel.map(|at| at as f64);
        (127.5 + 100.0 * (4.0 - (x.hypot(y) - 12.0).hypot(z))) as f32
    };
    let topology = Topology::of(&half_level(&whole(-20, 20, torus), lattice(1.0)).0);
    assert!(topology.is_closed());
    assert_eq!((topology.components, topology.euler_number()), (1, 0));
}

#[test]
fn surface_is_open_where_coverage_ends() {
    let field = Field { low: [-15; 3], high: [15, 15, 4], value: |voxel| Some(ball(voxel, [0.0; 3], 10.0)) };
    let (mesh, _) = half_level(&field, lattice(1.0));
    let topology = Topology::of(&mesh);
    assert!(!topology.is_closed() && topology.open_edges > 50);
    assert_eq!((topology.components, topology.euler_number()), (1, 1));
    assert_eq!(volume_mm3(&mesh, &topology), Err(SurfaceError::Open { open_edges: topology.open_edges }));
}

#[test]
fn one_unseen_voxel_opens_the_surface() {
    let field = Field {
        low: [-15; 3],
        high: [15; 3],
        value: |voxel| (voxel != [10, 0, 0]).then(|| ball(voxel, [0.0; 3], 10.0)),
    };
    let topology = Topology::of(&half_level(&field, lattice(1.0)).0);
    assert!(topology.open_edges > 0);
}

#[test]
fn voxels_without_finite_values_are_unseen() {
    let field = whole(-15, 15, |voxel| if voxel == [10, 0, 0] { f32::NAN } else { ball(voxel, [0.0; 3], 10.0) });
    let mesh = half_level(&field, lattice(1.0)).0;
    assert!(mesh.vertices.iter().flatten().all(|at| at.is_finite()));
    assert!(!Topology::of(&mesh).is_closed());
}

#[test]
fn grey_value_of_voxels_has_a_closed_finite_mesh() {
    // The voxels of 100 are inside, and vertices lie beside them.
    let steps = |voxel: [i64; 3]| match voxel.iter().map(|at| at.abs()).max() {
        Some(..5) => 200.0,
        Some(5) => 100.0,
        _ => 0.0,
    };
    let (mesh, _) = extract(&whole(-8, 8, steps), 100.0, lattice(1.0), LIMIT).unwrap();
    let topology = Topology::of(&mesh);
    assert!(topology.is_closed() && mesh.vertices.iter().chain(&mesh.normals).flatten().all(|at| at.is_finite()));
    assert!((volume_mm3(&mesh, &topology).unwrap() - 1000.0).abs() < 0.2);
}

#[test]
fn volume_without_surface_is_empty() {
    let field = whole(0, 20, |_| 100.0);
    let (mesh, work) = half_level(&field, lattice(1.0));
    assert_eq!((mesh.is_empty(), mesh.bounds(), mesh.bytes()), (true, None, 0));
    assert_eq!(work, SurfaceWork { bricks_read: 27, bricks_skipped: 27, ..SurfaceWork::default() });
    assert_eq!(volume_mm3(&mesh, &Topology::of(&mesh)), Err(SurfaceError::Empty));
}

#[test]
fn bricks_that_no_surface_crosses_are_skipped() {
    // The surface lies between the voxels of x = 7 and x = 8: in the cells of the first brick, by
    // the layer of the next.
    let field =
        Field { low: [0; 3], high: [23, 7, 7], value: |[x, ..]: [i64; 3]| Some(if x < 8 { 200.0 } else { 50.0 }) };
    let (_, work) = half_level(&field, lattice(1.0));
    let expected =
        SurfaceWork { bricks_read: 3, bricks_skipped: 2, bricks_meshed: 1, cells_visited: 512, vertices: 49 };
    assert_eq!(work, expected);
    let mut sum = expected;
    sum += expected;
    assert_eq!((sum.bricks_read, sum.cells_visited, sum.vertices), (6, 1024, 98));
}

/// Compares with the reference: the same vertices within 1e-4 voxel, and the same quads.
fn assert_same<V: Values>(volume: &V, low: [i64; 3], high: [i64; 3]) {
    let slow = reference(volume, 127.5, low, high);
    let (mesh, work) = half_level(volume, lattice(1.0));
    assert_eq!((mesh.vertices.len(), work.vertices), (slow.vertices.len(), slow.vertices.len() as u64));
    // Vertices in the order of bricks, of cells in them, and of edges in these.
    let placed = |(cell, edge): Key| (cell.map(|at| at.div_euclid(8)), [cell[2], cell[1], cell[0]], edge);
    let order: BTreeMap<_, _> = slow.vertices.iter().map(|(key, at)| (placed(*key), (*key, *at))).collect();
    let mut keys = Vec::new();
    for ((key, at), vertex) in order.values().zip(&mesh.vertices) {
        let distance = at.distance(DVec3::from_array(vertex.map(f64::from)));
        assert!(distance < 1e-4, "{key:?}: {at} is not {vertex:?}");
        keys.push(*key);
    }
    let quads: BTreeSet<_> = mesh
        .triangles
        .chunks_exact(2)
        .map(|pair| {
            // Both triangles have the diagonal; the second ends at the corner that the first lacks.
            let [[a, b, c], [d, e, f]] = [pair[0], pair[1]];
            let quad = if (a, c) == (d, e) {
                [a, b, c, f]
            } else {
                assert_eq!((b, c), (d, f));
                [a, b, e, c]
            };
            let mut quad = quad.map(|vertex| keys[vertex as usize]);
            let first = (0..4).min_by_key(|i| quad[*i]).unwrap();
            quad.rotate_left(first);
            quad
        })
        .collect();
    assert_eq!(quads.len() * 2, mesh.triangles.len());
    assert!(quads == slow.quads);
}

#[test]
fn ball_across_negative_bricks_is_that_of_the_reference() {
    assert_same(&whole(-18, 13, |voxel| ball(voxel, [-2.3, -1.1, -3.2], 9.4)), [-20; 3], [15; 3]);
}

#[test]
fn noise_with_unseen_voxels_is_that_of_the_reference() {
    let value = |voxel: [i64; 3]| Some(noise(voxel)).filter(|value| *value > 6.0);
    assert_same(&Field { low: [-9; 3], high: [12; 3], value }, [-10; 3], [13; 3]);
}

#[test]
fn noise_without_coverage_at_its_rim_is_closed() {
    let value = |voxel: [i64; 3]| if voxel.iter().all(|at| (-18..=17).contains(at)) { noise(voxel) } else { 0.0 };
    let (mesh, _) = half_level(&whole(-20, 19, value), lattice(1.0));
    let topology = Topology::of(&mesh);
    assert!(topology.is_closed() && volume_mm3(&mesh, &topology).unwrap() > 0.0);
    assert!(topology.non_manifold_edges * 100 < topology.edges);
}

#[test]
fn mesh_has_the_same_bits_for_any_threads() {
    let field = whole(-20, 19, |voxel| ball(voxel, [0.4; 3], 14.0) + noise(voxel) / 4.0);
    let with = |threads: usize| {
        let pool = ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| half_level(&field, turned_lattice()))
    };
    let first = with(1);
    assert!(first.0.triangles.len() > 1000);
    assert!(first == with(2) && first == with(3));
}

#[test]
fn update_visits_changed_bricks_and_those_beside() {
    let before = |voxel| ball(voxel, [0.0; 3], 20.0);
    // The second ball is within the brick at 16..24.
    let after = |voxel: [i64; 3]| before(voxel).max(ball(voxel, [20.0, 19.0, 20.0], 2.5));
    let mut surface = IncrementalSurface::new(127.5, turned_lattice(), LIMIT).unwrap();
    let (old, new) = (whole(-32, 31, before), whole(-32, 31, after));
    let bricks: Vec<BrickIndex> = old.bricks().collect();
    assert_eq!(surface.update(&old, &bricks).unwrap().bricks_read, 512);
    let work = surface.update(&new, &[[2, 2, 2], [2, 2, 2]]).unwrap();
    assert_eq!((work.bricks_read, work.bricks_meshed + work.bricks_skipped), (1, 8));
    assert!(work.cells_visited == 512 * work.bricks_meshed && work.bricks_meshed > 0);
    let (scratch, _) = half_level(&new, turned_lattice());
    assert!(surface.mesh().unwrap() == scratch && scratch != half_level(&old, turned_lattice()).0);
    surface.update(&old, &[[2, 2, 2]]).unwrap();
    assert!(surface.mesh().unwrap() == half_level(&old, turned_lattice()).0);
}

#[test]
fn update_follows_bricks_that_come_and_go() {
    let value = |voxel| Some(ball(voxel, [0.0; 3], 20.0));
    let part = |high: i64| Field { low: [-32; 3], high: [high, 31, 31], value };
    let mut surface = IncrementalSurface::new(127.5, lattice(1.0), LIMIT).unwrap();
    let changed: Vec<BrickIndex> = part(31).bricks().filter(|brick| brick[0] == 1).collect();
    for high in [7, 15, 7] {
        let bricks: Vec<BrickIndex> = if surface.bytes() == 0 { part(7).bricks().collect() } else { changed.clone() };
        surface.update(&part(high), &bricks).unwrap();
        assert!(surface.mesh().unwrap() == half_level(&part(high), lattice(1.0)).0);
    }
    surface.clear();
    assert!(surface.mesh().unwrap().is_empty() && surface.bytes() == 0);
}

#[test]
fn impossible_surfaces_are_refused() {
    let field = whole(-20, 19, noise);
    let try_iso = |iso: f32| extract(&field, iso, lattice(1.0), LIMIT).unwrap_err();
    assert!(matches!(try_iso(f32::NAN), SurfaceError::Iso { .. }));
    assert_eq!(try_iso(f32::INFINITY), SurfaceError::Iso { iso: f32::INFINITY });
    let bytes = half_level(&field, lattice(1.0)).0.bytes();
    let mut surface = IncrementalSurface::new(127.5, lattice(1.0), bytes).unwrap();
    let error = surface.update(&field, &field.bricks().collect::<Vec<_>>()).unwrap_err();
    let SurfaceError::Memory { needed_bytes, limit_bytes } = error else { panic!("{error}") };
    assert!(needed_bytes > bytes && limit_bytes == bytes);
    assert!(surface.mesh().unwrap().is_empty());
}

#[test]
fn vertices_beside_voxels_of_the_value_stay_apart() {
    // Whole grey values, many of which are that of the surface.
    let ball = |at: [i64; 3]| {
        let [x, y, z] = at.map(|x| (x * x) as f64);
        Some((128.0 + 20.0 * (6.3 - (x + 1.3 * y + 0.8 * z).sqrt())).round() as f32)
    };
    let volume = Field { low: [-9; 3], high: [9; 3], value: ball };
    let (mesh, _) = extract(&volume, 128.0, turned_lattice(), u64::MAX).unwrap();
    let mut places: Vec<[u32; 3]> = mesh.vertices.iter().map(|at| at.map(f32::to_bits)).collect();
    places.sort_unstable();
    places.dedup();
    assert_eq!(places.len(), mesh.vertices.len());
    let of_value = (0..19_i64.pow(3)).filter(|n| ball([n % 19 - 9, n / 19 % 19 - 9, n / 361 - 9]) == Some(128.0));
    assert!(of_value.count() > 5, "some voxels have the value");
}
