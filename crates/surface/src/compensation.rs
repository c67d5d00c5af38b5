//! Moves the vertices of a blurred surface back to where the surface was.
//!
//! A blur of variance σ² moves the half level of a curved edge by σ²·H towards the centre of
//! curvature. H is the mean curvature, 1/R of a sphere, whose volume shrinks by 3σ²/R². Each vertex
//! is moved back by this distance. H is that of the level sets of the volume, smoothed.
//!
//! A mesh lies too deep for two more reasons, which together take as much as a blur of 0.57 voxels:
//!
//! - Values between voxels are interpolated linearly, and those of a convex body are too low. The
//!   second derivatives along the surface give the error at the vertex.
//! - Triangles are chords: in the mean they lie Σ e² κ / 24 below a surface of curvature κ, with
//!   the lengths e of their edges (integral over a triangle in a parabola).
//!
//! At the end of coverage, smoothing has voxels on one side only, and gives back half of the shift.

use glam::{DAffine3, DMat3, DVec3};
use rayon::prelude::*;
use serde::Serialize;

use sonoweave_core::frames::{Transform, Volume, World};
use volume::Values;
use volume::brick::EDGE;

use crate::block::Block;
use crate::error::SurfaceError;
use crate::measure::corners;
use crate::mesh::Mesh;
use crate::smoothing::Smoothing;

/// Above this σ·|H|, the shift of an edge is no longer σ²·H, and a vertex stays.
const MOST_CURVED: f64 = 0.3;

/// Outcome of the compensation, by vertices.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct Compensation {
    /// Vertices that were moved.
    pub moved: u64,
    /// Vertices that stayed because the surface is curved too much for the blur.
    pub too_curved: u64,
    /// Vertices that stayed because too few voxels around them are seen, or all have one value.
    pub undetermined: u64,
}

/// Returns the mesh before a blur of variance `blur_mm2`, mm², along each axis: that of the kernel
/// and of the point spread together. Normals stay. `volume` is the one that the mesh was made of,
/// and its grey value lies halfway between the body and its surroundings.
///
/// # Errors
/// [`SurfaceError::Blur`], [`SurfaceError::WideBlur`].
pub fn compensate<V: Values + ?Sized>(
    mesh: &Mesh,
    volume: &V,
    world_from_lattice: Transform<World, Volume>,
    blur_mm2: f64,
) -> Result<(Mesh, Compensation), SurfaceError> {
    let blur = Blur::new(world_from_lattice.affine(), blur_mm2)?;
    let vertices: Vec<Vertex> = mesh
        .vertices
        .iter()
        .zip(chords_mm2(mesh))
        .map(|(vertex, chord_mm2)| Vertex { place: blur.place(*vertex), chord_mm2 })
        .collect();
    let runs: Vec<&[Vertex]> = vertices.chunk_by(|a, b| a.brick() == b.brick()).collect();
    let shift_run = |block: &mut Block, run: &&[Vertex]| {
        let smoothing = &blur.smoothing;
        let low = run[0].brick().map(|brick| brick * EDGE as i64 - smoothing.reach() as i64);
        block.read(volume, low, EDGE + smoothing.taps());
        run.iter().map(|vertex| blur.shift(block, vertex, low)).collect::<Vec<Shift>>()
    };
    let shifts: Vec<Vec<Shift>> = runs.par_iter().map_init(Block::default, shift_run).collect();
    let mut compensated = mesh.clone();
    let mut outcome = Compensation::default();
    for (vertex, shift) in compensated.vertices.iter_mut().zip(shifts.iter().flatten()) {
        match shift {
            Shift::By(by) => {
                *vertex = (DVec3::from_array(vertex.map(f64::from)) + *by).as_vec3().to_array();
                outcome.moved += 1;
            }
            Shift::TooCurved => outcome.too_curved += 1,
            Shift::Undetermined => outcome.undetermined += 1,
        }
    }
    Ok((compensated, outcome))
}

/// A vertex of the mesh.
struct Vertex {
    /// Position, voxels.
    place: DVec3,
    /// Depth of the chords around it, times the radius of curvature, mm².
    chord_mm2: f64,
}

impl Vertex {
    /// Returns the brick that it lies in.
    fn brick(&self) -> [i64; 3] {
        (self.place / EDGE as f64).floor().as_i64vec3().to_array()
    }
}

/// Shift of a vertex in the world, mm.
enum Shift {
    By(DVec3),
    TooCurved,
    Undetermined,
}

/// The blur to be compensated.
struct Blur {
    /// Axes of the voxels in the world, mm.
    axes: DMat3,
    lattice_from_world: DAffine3,
    variance_mm2: f64,
    smoothing: Smoothing,
}

impl Blur {
    fn new(world_from_lattice: DAffine3, blur_mm2: f64) -> Result<Self, SurfaceError> {
        if !(blur_mm2 >= 0.0 && blur_mm2.is_finite()) {
            return Err(SurfaceError::Blur { blur_mm2 });
        }
        let axes = world_from_lattice.matrix3;
        let spacing = DVec3::new(axes.x_axis.length(), axes.y_axis.length(), axes.z_axis.length());
        // Smoothing of any width keeps the curvature of a sphere's level sets. A voxel is the least
        // for derivatives without errors of sampling.
        let smoothing = Smoothing::new(blur_mm2.sqrt().max(spacing.max_element()), spacing)?;
        Ok(Self { axes, lattice_from_world: world_from_lattice.inverse(), variance_mm2: blur_mm2, smoothing })
    }

    /// Returns a position in the world in voxels.
    fn place(&self, vertex: [f32; 3]) -> DVec3 {
        self.lattice_from_world.transform_point3(DVec3::from_array(vertex.map(f64::from)))
    }

    /// Returns the shift of a vertex, from the values of a block whose lowest voxel is `low`.
    fn shift(&self, block: &Block, vertex: &Vertex, low: [i64; 3]) -> Shift {
        let Some(smooth) = self.smoothing.at(block, vertex.place, low) else { return Shift::Undetermined };
        let to_lattice = self.lattice_from_world.matrix3;
        let gradient = to_lattice.transpose() * smooth.gradient;
        let second = to_lattice.transpose() * smooth.second * to_lattice;
        let steepness = gradient.length();
        if !(steepness > 0.0 && steepness.is_finite()) {
            return Shift::Undetermined;
        }
        let outwards = -gradient / steepness;
        let trace = second.x_axis.x + second.y_axis.y + second.z_axis.z;
        let curvature = (outwards.dot(second * outwards) - trace) / (2.0 * steepness);
        if self.variance_mm2.sqrt() * curvature.abs() > MOST_CURVED {
            return Shift::TooCurved;
        }
        let interpolation = self.interpolation_error(vertex.place, outwards, second) / steepness;
        Shift::By(outwards * ((self.variance_mm2 + vertex.chord_mm2) * curvature + interpolation))
    }

    /// Returns the true value minus that interpolated linearly, at a place in voxels. Across an
    /// edge, at half its height, the second derivative is zero; the others are taken along the
    /// surface.
    fn interpolation_error(&self, place: DVec3, outwards: DVec3, second: DMat3) -> f64 {
        let between = place - place.floor();
        let along_axis = |a: usize| {
            let axis = self.axes.col(a);
            let along = axis - outwards * outwards.dot(axis);
            -along.dot(second * along) * between[a] * (1.0 - between[a]) / 2.0
        };
        (0..3).map(along_axis).sum()
    }
}

/// Returns the mean depth of the triangles at each vertex below a surface of curvature 1/mm, by
/// area, mm².
fn chords_mm2(mesh: &Mesh) -> impl Iterator<Item = f64> {
    let mut sums = vec![[0.0; 2]; mesh.vertices.len()];
    for (triangle, [a, b, c]) in mesh.triangles.iter().zip(corners(mesh)) {
        let depth = (a.distance_squared(b) + b.distance_squared(c) + c.distance_squared(a)) / 24.0;
        let area = (b - a).cross(c - a).length();
        for vertex in triangle {
            let [depths, areas] = &mut sums[*vertex as usize];
            *depths += depth * area;
            *areas += area;
        }
    }
    sums.into_iter().map(|[depths, areas]| if areas > 0.0 { depths / areas } else { 0.0 })
}
