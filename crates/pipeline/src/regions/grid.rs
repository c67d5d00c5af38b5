//! The grid of regions: boxes of equal size around all bricks that slices reach.

use volume::brick::{BrickBox, BrickIndex};

/// Reason why there is no grid.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error(
    "a region of {edge}×{edge}×{edge} voxels may take {needed_bytes} bytes of memory, more than the limit of {limit_bytes}: raise the memory limit"
)]
pub struct TooSmall {
    /// Voxels along the edge of the smallest region.
    edge: u64,
    /// Memory of its bricks.
    needed_bytes: u64,
    /// Memory allowed.
    limit_bytes: u64,
}

/// Regions that cover all bricks reached, each a cube of whole cells. A cell is a part of the
/// lattice that is written at once; its corners lie at multiples of its edge.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RegionGrid {
    /// Bricks along the edge of a cell.
    cell: i32,
    /// Cells along the edge of a region.
    edge: i32,
    /// Lowest cell of the first region, and the number of regions along each axis.
    first: [i32; 3],
    counts: [i32; 3],
    meetings: u64,
}

impl RegionGrid {
    /// Makes a grid for slices that reach these boxes. Regions are as large as the memory limit
    /// permits if they were full, and no larger than needed. They begin where the fewest slices
    /// meet several of them, as found axis by axis.
    ///
    /// # Errors
    /// [`TooSmall`] if the limit is below the memory of one cell.
    pub fn new(slices: &[BrickBox], cell_bricks: i32, brick_bytes: u64, limit_bytes: u64) -> Result<Self, TooSmall> {
        let bytes =
            |edge: i32| (u64::from(edge.unsigned_abs()) * u64::from(cell_bricks.unsigned_abs())).pow(3) * brick_bytes;
        if bytes(1) > limit_bytes {
            let edge = u64::from(cell_bricks.unsigned_abs()) * volume::brick::EDGE as u64;
            return Err(TooSmall { edge, needed_bytes: bytes(1), limit_bytes });
        }
        let cells: Vec<BrickBox> = slices.iter().map(|bricks| in_cells(bricks, cell_bricks)).collect();
        let all = cells.iter().copied().reduce(|a, b| a.around(&b)).unwrap_or(BrickBox::EMPTY);
        let extent = [0, 1, 2].map(|a| all.high[a] - all.low[a] + 1);
        let longest = extent.into_iter().max().unwrap_or(1).max(1);
        let edge = (1..=longest).take_while(|edge| bytes(*edge) <= limit_bytes).last().unwrap_or(1);
        let mut first = all.low;
        for axis in 0..3 {
            let shifted = |shift: i32| {
                let mut first = first;
                first[axis] -= shift;
                first
            };
            // The first of equal ones: the fewest regions.
            let best = (0..edge).min_by_key(|shift| meetings(&cells, edge, shifted(*shift))).unwrap_or(0);
            first = shifted(best);
        }
        let counts = [0, 1, 2].map(|a| (all.high[a] - first[a]).div_euclid(edge) + 1);
        let meetings = meetings(&cells, edge, first);
        Ok(Self { cell: cell_bricks, edge, first, counts, meetings })
    }

    /// Number of regions that each slice meets, summed over slices.
    pub fn meetings(&self) -> u64 {
        self.meetings
    }

    /// Iterates over the regions that a slice meets, x fastest.
    pub fn regions<'a>(&'a self, slices: &'a [BrickBox]) -> impl Iterator<Item = BrickBox> + 'a {
        let [nx, ny, nz] = self.counts;
        let places = (0..nz).flat_map(move |z| (0..ny).flat_map(move |y| (0..nx).map(move |x| [x, y, z])));
        let regions = places.map(|place| self.region(place));
        regions.filter(|region| slices.iter().any(|bricks| !bricks.within(region).is_empty()))
    }

    fn region(&self, place: [i32; 3]) -> BrickBox {
        let low: BrickIndex = [0, 1, 2].map(|a| (self.first[a] + place[a] * self.edge) * self.cell);
        BrickBox { low, high: low.map(|low| low + self.edge * self.cell - 1) }
    }
}

/// Returns the cells that a box of bricks meets.
fn in_cells(bricks: &BrickBox, cell: i32) -> BrickBox {
    BrickBox { low: bricks.low.map(|b| b.div_euclid(cell)), high: bricks.high.map(|b| b.div_euclid(cell)) }
}

/// Returns the number of regions that each box meets, summed, if the first region begins there.
fn meetings(cells: &[BrickBox], edge: i32, first: [i32; 3]) -> u64 {
    let along =
        |b: &BrickBox, a: usize| (b.high[a] - first[a]).div_euclid(edge) - (b.low[a] - first[a]).div_euclid(edge) + 1;
    cells.iter().map(|b| (0..3).map(|a| u64::from(along(b, a).unsigned_abs())).product::<u64>()).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cube(low: i32, high: i32) -> BrickBox {
        BrickBox { low: [low; 3], high: [high; 3] }
    }

    #[test]
    fn regions_cover_reached_bricks_once() {
        let slices = [cube(-37, -20), cube(-20, 5), cube(40, 41)];
        for limit in [16_u64.pow(3), 32_u64.pow(3), 100_u64.pow(3)] {
            let grid = RegionGrid::new(&slices, 16, 1, limit).unwrap();
            let regions: Vec<BrickBox> = grid.regions(&slices).collect();
            for brick in (-48..48).step_by(3).map(|b| [b; 3]) {
                let at = BrickBox { low: brick, high: brick };
                let count = regions.iter().filter(|region| !region.within(&at).is_empty()).count();
                let is_reached = slices.iter().any(|slice| !slice.within(&at).is_empty());
                assert!(count == 1 || count == 0 && !is_reached, "{brick:?} is in {count} regions");
            }
            for region in &regions {
                assert!(region.low.iter().all(|low| low % 16 == 0), "{region:?} begins within a cell");
                let bricks: u64 = (0..3).map(|a| u64::from(region.high[a].abs_diff(region.low[a])) + 1).product();
                assert!(bricks <= limit, "{region:?} may need more than {limit}");
            }
            let met: usize = slices
                .iter()
                .map(|slice| regions.iter().filter(|region| !region.within(slice).is_empty()).count())
                .sum();
            assert_eq!(met as u64, grid.meetings());
        }
    }

    #[test]
    fn grid_is_shifted_where_fewest_slices_meet_two_regions() {
        // Cells 0 to 3 along each axis; most slices lie in the middle two.
        let mut slices = vec![cube(0, 3)];
        slices.extend([cube(1, 2); 19]);
        let grid = RegionGrid::new(&slices, 1, 1, 8).unwrap();
        assert_eq!((grid.edge, grid.first), (2, [-1; 3]));
        assert_eq!(grid.meetings(), 27 + 19);
    }

    #[test]
    fn limit_below_one_cell_is_refused() {
        let error = RegionGrid::new(&[cube(0, 1)], 16, 4096, 1 << 20).unwrap_err();
        assert_eq!(error, TooSmall { edge: 128, needed_bytes: 1 << 24, limit_bytes: 1 << 20 });
    }

    #[test]
    fn volume_that_fits_is_one_region() {
        let slices = [cube(-3, 40)];
        let grid = RegionGrid::new(&slices, 16, 4096, 8 << 30).unwrap();
        assert_eq!((grid.regions(&slices).count(), grid.meetings()), (1, 1));
    }
}
