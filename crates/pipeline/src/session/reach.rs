//! The box that a picture shows, while the extent of the scan is unknown.

use volume::brick::{BrickIndex, EDGE};

/// A box of voxels that grows in steps. It grows seldom, since each step casts all rays again. Its
/// growth depends on the slices alone, so that the picture after a slice does not depend on
/// earlier pictures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Reach {
    /// First and last brick, both inclusive.
    low: [i64; 3],
    high: [i64; 3],
}

/// Smallest step, bricks.
const STEP: i64 = 4;

impl Reach {
    /// Returns the box around the bricks of a first slice; `None` without bricks.
    pub(super) fn around(bricks: &[BrickIndex]) -> Option<Self> {
        let first = bricks.first()?.map(i64::from);
        let mut reach = Self { low: first, high: first };
        for brick in bricks {
            for (a, &at) in brick.iter().enumerate() {
                reach.low[a] = reach.low[a].min(i64::from(at));
                reach.high[a] = reach.high[a].max(i64::from(at));
            }
        }
        reach.low.iter_mut().for_each(|low| *low -= STEP);
        reach.high.iter_mut().for_each(|high| *high += STEP);
        Some(reach)
    }

    /// Widens the box for a slice that leaves it: on that side, by half of the box's length or
    /// more. Returns whether it was widened.
    pub(super) fn widen(&mut self, bricks: &[BrickIndex]) -> bool {
        let before = *self;
        for a in 0..3 {
            let step = ((before.high[a] - before.low[a] + 1) / 2).max(STEP);
            let ends = bricks.iter().map(|brick| i64::from(brick[a]));
            if let Some(low) = ends.clone().min().filter(|low| *low < before.low[a]) {
                self.low[a] = low.min(before.low[a] - step);
            }
            if let Some(high) = ends.max().filter(|high| *high > before.high[a]) {
                self.high[a] = high.max(before.high[a] + step);
            }
        }
        *self != before
    }

    /// Returns the first and last voxel, both inclusive.
    pub(super) fn voxels(&self) -> [[i64; 3]; 2] {
        let edge = EDGE as i64;
        [self.low.map(|low| low * edge), self.high.map(|high| high * edge + edge - 1)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn box_grows_seldom_and_by_slices_alone() {
        let mut reach = Reach::around(&[[0, 0, 0], [9, 3, 0]]).unwrap();
        assert_eq!(reach.voxels(), [[-32; 3], [(13 + 1) * 8 - 1, (7 + 1) * 8 - 1, 39]]);
        let mut steps = 0;
        for z in 0..1000 {
            let slice = [[0, 0, z], [9, 3, z]];
            steps += u32::from(reach.widen(&slice));
            assert!(!reach.widen(&slice), "what is held is held");
            let [low, high] = reach.voxels();
            assert!(low[2] <= i64::from(z) * 8 && i64::from(z) * 8 + 7 <= high[2]);
        }
        assert!((5..15).contains(&steps), "{steps}");
        assert_eq!(reach.voxels()[0], [-32; 3], "the other sides stay");
        assert!(reach.widen(&[[-5, 0, 0]]) && reach.voxels()[0][0] < -40);
        assert_eq!(Reach::around(&[]), None);
    }
}
