//! A brick: 8×8×8 voxels that are allocated, filled and drawn together.

/// Voxels along a brick's edge.
pub const EDGE: usize = 8;
/// Voxels in a brick.
pub const VOXELS: usize = EDGE * EDGE * EDGE;

/// Position of a brick on the lattice: voxel index divided by [`EDGE`], rounded down.
pub type BrickIndex = [i32; 3];

/// Voxels of a tile along x, y and z: sixteen voxels that lie together, one vector of the hot loops.
///
/// A compact tile meets a slab more fully than a row of sixteen would: of the voxels in tiles that a slab ten voxels thick meets, seven in ten
/// lie in the slab in its worst orientation, against four in seven with rows (measured).
pub const TILE: [usize; 3] = [4, 2, 2];

/// Numerator and weight of the weighted mean at each voxel, placed by [`offset`]: the value is `r / w` where `w` is large enough to count
/// as seen.
///
/// 4 KiB, so that one voxel's neighbourhood costs one page and a handful of cache lines whatever the slice's orientation.
#[derive(Clone, Copy, bytemuck::Zeroable, bytemuck::Pod)]
#[repr(C, align(64))]
pub struct Brick {
    /// Σ weight·value.
    pub r: [f32; VOXELS],
    /// Σ weight.
    pub w: [f32; VOXELS],
}

/// When each voxel of a brick was last written, in ticks of the writer's; 0 before. Placed by [`offset`].
#[derive(Clone, Copy, bytemuck::Zeroable, bytemuck::Pod)]
#[repr(C, align(64))]
pub struct Stamps(pub [u32; VOXELS]);

/// When each voxel of a brick was last written, in the 16-bit ticks of a decay since its brick's [`Epoch`](super::sparse::Epoch). Placed by [`offset`].
#[derive(Clone, Copy, bytemuck::Zeroable, bytemuck::Pod)]
#[repr(C, align(64))]
pub struct Ages(pub [u16; VOXELS]);

/// Place of a voxel in its brick: tiles x fastest, and x fastest in a tile.
pub const fn offset(x: usize, y: usize, z: usize) -> usize {
    let [tx, ty, tz] = TILE;
    let tile = (z / tz * (EDGE / ty) + y / ty) * (EDGE / tx) + x / tx;
    tile * (tx * ty * tz) + (z % tz * ty + y % ty) * tx + x % tx
}

/// The voxel at a place in its brick: the inverse of [`offset`].
pub const fn voxel_at(place: usize) -> [usize; 3] {
    let [tx, ty, tz] = TILE;
    let (tile, lane) = (place / (tx * ty * tz), place % (tx * ty * tz));
    let (columns, rows) = (EDGE / tx, EDGE / ty);
    [
        tile % columns * tx + lane % tx,
        tile / columns % rows * ty + lane / tx % ty,
        tile / (columns * rows) * tz + lane / (tx * ty),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_brick_is_one_page() {
        assert_eq!(size_of::<Brick>(), 4096);
    }

    #[test]
    fn every_voxel_has_a_place_of_its_own_and_a_tile_lies_together() {
        let mut seen = [false; VOXELS];
        for (place, seen) in seen.iter_mut().enumerate() {
            let [x, y, z] = voxel_at(place);
            assert_eq!(offset(x, y, z), place);
            *seen = x < EDGE && y < EDGE && z < EDGE;
        }
        assert!(seen.iter().all(|s| *s));
        assert_eq!([offset(1, 0, 0), offset(0, 1, 0), offset(0, 0, 1), offset(4, 0, 0)], [1, 4, 8, 16]);
    }
}
