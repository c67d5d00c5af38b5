//! The lower convex hull of points that come one by one: all of them that a line from below can touch.

/// A sample as the fit sees it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Point {
    /// Device time since the epoch began, by the nominal rate, ns.
    pub(super) x: i64,
    /// Receive time less the known delays, since the epoch began, less `x`, ns.
    pub(super) z: i64,
}

/// Twice the area of the triangle, positive where `b` lies left of the way from `o` to `a`: above it, for points in the order of x.
pub(super) fn turn(o: Point, a: Point, b: Point) -> i128 {
    let wide = |to: i64, from: i64| i128::from(to) - i128::from(from);
    wide(a.x, o.x) * wide(b.z, o.z) - wide(a.z, o.z) * wide(b.x, o.x)
}

/// Corners that a hull holds. Of points scattered evenly above a line some (4/3) ln n are corners, so that this is reached by contrived ones only.
pub(super) const CORNERS: usize = 32;

/// A hull of bounded size.
#[derive(Debug, Clone, Copy)]
pub(super) struct Hull {
    corners: [Point; CORNERS],
    length: usize,
}

/// What an insertion took.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Inserted {
    /// Corners looked at.
    pub(super) steps: u64,
    /// A corner was left out for want of room.
    pub(super) coarsened: bool,
}

impl Hull {
    /// Of nothing.
    pub(super) const EMPTY: Self = Self { corners: [Point { x: 0, z: 0 }; CORNERS], length: 0 };

    /// The corners in the order of x; the first and the last point are among them.
    pub(super) fn corners(&self) -> &[Point] {
        &self.corners[..self.length]
    }

    fn remove(&mut self, at: usize) {
        self.corners.copy_within(at + 1..self.length, at);
        self.length -= 1;
    }

    /// Takes in a point, wherever its x lies among the others'.
    pub(super) fn insert(&mut self, point: Point) -> Inserted {
        let mut inserted = Inserted { steps: 1, coarsened: false };
        let mut at = self.corners().partition_point(|corner| corner.x < point.x);
        if at < self.length && self.corners[at].x == point.x {
            if self.corners[at].z <= point.z {
                return inserted;
            }
            self.corners[at] = point;
        } else {
            if 0 < at && at < self.length && turn(self.corners[at - 1], self.corners[at], point) >= 0 {
                return inserted;
            }
            if self.length == CORNERS {
                let flattest = self.flattest();
                self.remove(flattest);
                at -= usize::from(flattest < at);
                inserted = Inserted { steps: CORNERS as u64, coarsened: true };
            }
            self.corners.copy_within(at..self.length, at + 1);
            self.corners[at] = point;
            self.length += 1;
        }
        while at + 2 < self.length && turn(point, self.corners[at + 1], self.corners[at + 2]) <= 0 {
            self.remove(at + 1);
            inserted.steps += 1;
        }
        while at >= 2 && turn(self.corners[at - 2], self.corners[at - 1], point) <= 0 {
            self.remove(at - 1);
            at -= 1;
            inserted.steps += 1;
        }
        inserted
    }

    /// The inner corner without which the hull changes least.
    fn flattest(&self) -> usize {
        let area = |at: &usize| turn(self.corners[at - 1], self.corners[*at], self.corners[at + 1]);
        (1..self.length - 1).min_by_key(area).unwrap_or(0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn hull(points: &[Point]) -> Hull {
        let mut hull = Hull::EMPTY;
        for point in points {
            hull.insert(*point);
        }
        hull
    }

    #[test]
    fn what_lies_on_or_above_a_chord_is_no_corner() {
        let points = [(0, 5), (10, 0), (20, 5), (5, 3), (15, 2), (15, 3), (10, 1), (5, 2)];
        let hull = hull(&points.map(|(x, z)| Point { x, z }));
        let expected = [(0, 5), (5, 2), (10, 0), (15, 2), (20, 5)].map(|(x, z)| Point { x, z });
        assert_eq!(hull.corners(), expected);
        assert!(hull.corners.len() > hull.corners().len());
    }

    #[test]
    fn a_hull_that_is_full_leaves_out_the_flattest_corner_and_says_so() {
        let mut hull = Hull::EMPTY;
        let mut coarsened = 0;
        for x in 0..60_i64 {
            coarsened += u32::from(hull.insert(Point { x, z: (x - 30) * (x - 30) }).coarsened);
        }
        assert_eq!(coarsened, 60 - CORNERS as u32);
        let corners = hull.corners();
        assert_eq!((corners[0].x, corners[CORNERS - 1].x), (0, 59));
        assert!(corners.windows(3).all(|three| turn(three[0], three[1], three[2]) > 0));
    }

    proptest! {
        #[test]
        fn no_point_is_below_and_every_corner_is_a_point(
            points in prop::collection::vec((-500_i64..500, -500_i64..500), 1..60),
        ) {
            let points: Vec<Point> = points.into_iter().map(|(x, z)| Point { x, z }).collect();
            let hull = hull(&points);
            let corners = hull.corners();
            prop_assert!(corners.iter().all(|corner| points.contains(corner)));
            prop_assert!(corners.windows(3).all(|three| turn(three[0], three[1], three[2]) > 0));
            for point in &points {
                let under = corners.windows(2).find(|two| two[0].x <= point.x && point.x <= two[1].x);
                match under {
                    Some(two) => prop_assert!(turn(two[0], two[1], *point) >= 0),
                    None => prop_assert!(corners.len() == 1 && corners[0].x == point.x && corners[0].z <= point.z),
                }
            }
        }
    }
}
