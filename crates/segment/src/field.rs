//! A box of voxels on a lattice, and values on it.

use volume::Values;
use volume::brick::{BrickIndex, EDGE};

/// A box of voxels on a lattice. Their order is x fastest.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct VoxelBox {
    /// Lattice index of the first voxel.
    pub low: [i64; 3],
    /// Voxels along each axis.
    pub size: [usize; 3],
}

impl VoxelBox {
    /// Number of voxels.
    pub fn voxels(&self) -> usize {
        self.size.iter().product()
    }

    /// Returns a voxel's place in the order; `None` outside of the box.
    pub fn place(&self, voxel: [i64; 3]) -> Option<usize> {
        let [x, y, z] = [0, 1, 2].map(|a| voxel[a].checked_sub(self.low[a]).and_then(|at| usize::try_from(at).ok()));
        let [x, y, z] = [x?, y?, z?];
        (x < self.size[0] && y < self.size[1] && z < self.size[2]).then(|| (z * self.size[1] + y) * self.size[0] + x)
    }

    /// Returns the lattice index of the voxel at a place.
    pub fn voxel(&self, place: usize) -> [i64; 3] {
        let [nx, ny, _] = self.size;
        let at = [place % nx, place / nx % ny, place / (nx * ny)];
        [0, 1, 2].map(|a| self.low[a] + at[a] as i64)
    }

    /// Returns the places of the up to six voxels that share a face with that at a place.
    pub(crate) fn beside(&self, place: usize) -> impl Iterator<Item = usize> {
        let (size, steps) = (self.size, [1, self.size[0], self.size[0] * self.size[1]]);
        (0..3).flat_map(move |a| {
            let at = place / steps[a] % size[a];
            let before = (at > 0).then(|| place - steps[a]);
            before.into_iter().chain((at + 1 < size[a]).then(|| place + steps[a]))
        })
    }

    /// Returns the places of all voxels that are `open` and connected by faces with those `from`
    /// which the walk begins.
    pub(crate) fn connected(&self, mut from: Vec<usize>, open: impl Fn(usize) -> bool) -> Vec<bool> {
        let mut reached = vec![false; self.voxels()];
        from.retain(|place| open(*place));
        from.iter().for_each(|place| reached[*place] = true);
        while let Some(place) = from.pop() {
            for beside in self.beside(place) {
                if !reached[beside] && open(beside) {
                    reached[beside] = true;
                    from.push(beside);
                }
            }
        }
        reached
    }
}

/// Values of a box of voxels. All are seen, and all outside are unseen.
#[derive(Debug, Clone, PartialEq)]
pub struct Field {
    space: VoxelBox,
    values: Vec<f32>,
}

impl Field {
    /// Places values in a box.
    ///
    /// # Panics
    /// When there is not one for each voxel.
    pub fn new(space: VoxelBox, values: Vec<f32>) -> Self {
        assert_eq!(values.len(), space.voxels(), "a value for each voxel");
        Self { space, values }
    }

    /// The box.
    pub fn space(&self) -> &VoxelBox {
        &self.space
    }

    /// The values, in the order of the voxels.
    pub fn in_order(&self) -> &[f32] {
        &self.values
    }
}

impl Values for Field {
    fn values(&self, start: [i64; 3], value: &mut [f32], weight: &mut [f32]) {
        assert_eq!(value.len(), weight.len(), "a value and a weight a voxel");
        for (i, (value, weight)) in value.iter_mut().zip(weight).enumerate() {
            let place = self.space.place([start[0] + i as i64, start[1], start[2]]);
            (*value, *weight) = place.map_or((0.0, 0.0), |place| (self.values[place], 1.0));
        }
    }

    fn bricks(&self) -> Box<dyn Iterator<Item = BrickIndex> + '_> {
        let along = |a: usize| {
            let (low, edge) = (self.space.low[a], EDGE as i64);
            (low.div_euclid(edge) as i32)..=((low + self.space.size[a] as i64 - 1).div_euclid(edge) as i32)
        };
        Box::new(along(2).flat_map(move |z| along(1).flat_map(move |y| along(0).map(move |x| [x, y, z]))))
    }
}
