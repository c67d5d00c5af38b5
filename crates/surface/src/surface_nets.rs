//! The surface at a grey value by surface nets (Gibson 1998), kept by brick.
//!
//! A cell whose eight voxels are seen has a vertex for each sheet of the surface in it. An edge
//! between two voxels has a quad if it is crossed and its four cells have vertices. Where a voxel
//! is unseen there is no vertex, and the surface is open.
//!
//! Bricks are meshed in parallel, and joined in their order: the mesh has the same bits for any
//! number of threads.

use std::collections::BTreeMap;

use rayon::prelude::*;
use rustc_hash::FxHashMap;

use sonoweave_core::frames::{Transform, Volume, World};
use volume::Values;
use volume::brick::{BrickIndex, VOXELS};

use crate::block::Block;
use crate::error::SurfaceError;
use crate::join::join;
use crate::layers::{Layers, Range};
use crate::mesh::{Mesh, TRIANGLE_BYTES, VERTEX_BYTES};
use crate::piece::{Piece, ToWorld};
use crate::work::SurfaceWork;

/// Bricks that are meshed between two checks of the memory.
const CHUNK: usize = 512;

/// Returns the surface of a volume at the grey value `iso`. Voxels of `iso` or above are inside.
/// All memory for it may take `limit_bytes`.
///
/// # Errors
/// [`SurfaceError::Iso`], [`SurfaceError::Memory`], [`SurfaceError::Vertices`].
pub fn extract<V: Values + ?Sized>(
    volume: &V,
    iso: f32,
    world_from_lattice: Transform<World, Volume>,
    limit_bytes: u64,
) -> Result<(Mesh, SurfaceWork), SurfaceError> {
    let mut surface = IncrementalSurface::new(iso, world_from_lattice, limit_bytes)?;
    let bricks: Vec<BrickIndex> = volume.bricks().collect();
    let work = surface.update(volume, &bricks)?;
    Ok((surface.mesh()?, work))
}

/// The surface of a volume at a grey value, by brick. An update meshes only changed bricks and
/// those beside them, and yields the same bits as a new surface.
#[derive(Debug)]
pub struct IncrementalSurface {
    iso: f32,
    to_world: ToWorld,
    is_mirrored: bool,
    limit_bytes: u64,
    layers: FxHashMap<BrickIndex, Layers>,
    pieces: BTreeMap<BrickIndex, Piece>,
    /// Bytes of the pieces, and of the mesh while it is joined.
    piece_bytes: u64,
}

impl IncrementalSurface {
    /// Returns a surface without bricks, at the grey value `iso`. It may take `limit_bytes`, see
    /// [`Self::bytes`]. Up to 512 bricks more are meshed before they count.
    ///
    /// # Errors
    /// [`SurfaceError::Iso`].
    pub fn new(iso: f32, world_from_lattice: Transform<World, Volume>, limit_bytes: u64) -> Result<Self, SurfaceError> {
        if !iso.is_finite() {
            return Err(SurfaceError::Iso { iso });
        }
        let affine = world_from_lattice.affine();
        Ok(Self {
            iso,
            to_world: ToWorld::new(affine),
            is_mirrored: affine.matrix3.determinant() < 0.0,
            limit_bytes,
            layers: FxHashMap::default(),
            pieces: BTreeMap::new(),
            piece_bytes: 0,
        })
    }

    /// Meshes `changed` bricks, and those that have cells between their voxels and those of a
    /// changed one. Bricks that are new, or gone, are changed, too.
    ///
    /// # Errors
    /// [`SurfaceError::Memory`]; the surface is then without bricks, as at the beginning.
    pub fn update<V: Values + ?Sized>(
        &mut self,
        volume: &V,
        changed: &[BrickIndex],
    ) -> Result<SurfaceWork, SurfaceError> {
        let changed = sorted(changed.to_vec());
        let layers: Vec<Option<Layers>> = changed.par_iter().map(|brick| Layers::read(volume, *brick)).collect();
        for (brick, layers) in changed.iter().zip(layers) {
            match layers {
                Some(layers) => self.layers.insert(*brick, layers),
                None => self.layers.remove(brick),
            };
        }
        let affected = sorted(changed.iter().flat_map(|brick| beside(*brick, -1)).collect());
        let mut work = SurfaceWork { bricks_read: changed.len() as u64, ..SurfaceWork::default() };
        for bricks in affected.chunks(CHUNK) {
            work += self.mesh_bricks(volume, bricks);
            let needed_bytes = self.bytes();
            if needed_bytes > self.limit_bytes {
                self.clear();
                return Err(SurfaceError::Memory { needed_bytes, limit_bytes: self.limit_bytes });
            }
        }
        Ok(work)
    }

    fn mesh_bricks<V: Values + ?Sized>(&mut self, volume: &V, bricks: &[BrickIndex]) -> SurfaceWork {
        let mesh_brick = |block: &mut Block, brick: &BrickIndex| {
            self.is_crossed(*brick).then(|| {
                block.read_cells(volume, *brick);
                Piece::new(*brick, &block.values, self.iso, &self.to_world)
            })
        };
        let pieces: Vec<Option<Piece>> = bricks.par_iter().map_init(Block::default, mesh_brick).collect();
        let mut work = SurfaceWork::default();
        for (brick, piece) in bricks.iter().zip(pieces) {
            match &piece {
                Some(piece) => {
                    work.bricks_meshed += 1;
                    work.cells_visited += VOXELS as u64;
                    work.vertices += piece.vertices.len() as u64;
                }
                None => work.bricks_skipped += u64::from(self.layers.contains_key(brick)),
            }
            self.replace(*brick, piece.filter(|piece| !piece.vertices.is_empty()));
        }
        work
    }

    /// Whether some voxels of a brick's cells are inside, and others are not.
    fn is_crossed(&self, brick: BrickIndex) -> bool {
        let range = |(layer, brick)| self.layers.get(&brick).map_or(Range::EMPTY, |layers| layers.range(layer));
        self.layers.contains_key(&brick)
            && beside(brick, 1).enumerate().map(range).fold(Range::EMPTY, Range::around).straddles(self.iso)
    }

    fn replace(&mut self, brick: BrickIndex, piece: Option<Piece>) {
        let added = piece.as_ref().map_or(0, bytes_of);
        let before = match piece {
            Some(piece) => self.pieces.insert(brick, piece),
            None => self.pieces.remove(&brick),
        };
        self.piece_bytes = self.piece_bytes + added - before.as_ref().map_or(0, bytes_of);
    }

    /// Forgets all bricks.
    pub fn clear(&mut self) {
        self.layers = FxHashMap::default();
        self.pieces = BTreeMap::new();
        self.piece_bytes = 0;
    }

    /// Returns the mesh of all bricks.
    ///
    /// # Errors
    /// [`SurfaceError::Vertices`].
    pub fn mesh(&self) -> Result<Mesh, SurfaceError> {
        join(&self.pieces, self.is_mirrored)
    }

    /// Bytes of what is kept by brick, and most bytes of the mesh while it is joined.
    pub fn bytes(&self) -> u64 {
        self.piece_bytes + (self.layers.capacity() * size_of::<(BrickIndex, Layers)>()) as u64
    }
}

/// Triangles count twice, as they are gathered by brick first.
fn bytes_of(piece: &Piece) -> u64 {
    piece.bytes() + piece.vertices.len() as u64 * VERTEX_BYTES + 2 * piece.most_triangles() * TRIANGLE_BYTES
}

/// Returns a brick and the seven beside it, in the direction `sign` along the axes that are bits of
/// their number.
fn beside(brick: BrickIndex, sign: i32) -> impl Iterator<Item = BrickIndex> {
    (0..8).map(move |number| [0, 1, 2].map(|a| brick[a].saturating_add(sign * ((number >> a) & 1))))
}

fn sorted(mut bricks: Vec<BrickIndex>) -> Vec<BrickIndex> {
    bricks.sort_unstable();
    bricks.dedup();
    bricks
}
