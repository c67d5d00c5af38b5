//! The lower convex hull of points that arrive one by one: all points that a line from below
//! can touch.

/// A sample as used by the fit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Point {
    /// Device time since the start of the epoch, by the nominal rate, ns.
    pub(super) x: i64,
    /// Receive time minus the known delays, since the start of the epoch, minus `x`, ns.
    pub(super) z: i64,
}

/// Twice the area of the triangle `o`, `a`, `b`. For points in the order of x, it is positive
/// if `b` lies above the line from `o` to `a`.
pub(super) fn turn(o: Point, a: Point, b: Point) -> i128 {
    let wide = |to: i64, from: i64| i128::from(to) - i128::from(from);
    wide(a.x, o.x) * wide(b.z, o.z) - wide(a.z, o.z) * wide(b.x, o.x)
}

/// Corners that a hull holds. For n points scattered evenly above a line some (4/3) ln n are
/// corners, so only contrived points reach this.
pub(super) const CORNERS: usize = 32;

/// A hull of bounded size.
#[derive(Debug, Clone, Copy)]
pub(super) struct Hull {
    corners: [Point; CORNERS],
    length: usize,
}

/// Cost of an insertion.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Inserted {
    /// Corners visited.
    pub(super) steps: u64,
    /// A corner was dropped because the hull was full.
    pub(super) coarsened: bool,
}

impl Hull {
    /// The hull of no points.
    pub(super) const EMPTY: Self = Self { corners: [Point { x: 0, z: 0 }; CORNERS], length: 0 };

    /// The corners in the order of x; the first and the last point are among them.
    pub(super) fn corners(&self) -> &[Point] {
        &self.corners[..self.length]
    }

    fn remove(&mut self, at: usize) {
        self.corners.copy_within(at + 1..self.length, at);
        self.length -= 1;
    }

    /// Inserts a point at any x.
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

    /// Returns the inner corner whose removal changes the hull least.
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
    fn point_on_or_above_chord_is_no_corner() {
        let points = [(0, 5), (10, 0), (20, 5), (5, 3), (15, 2), (15, 3), (10, 1), (5, 2)];
        let hull = hull(&points.map(|(x, z)| Point { x, z }));
        let expected = [(0, 5), (5, 2), (10, 0), (15, 2), (20, 5)].map(|(x, z)| Point { x, z });
        assert_eq!(hull.corners(), expected);
        assert!(hull.corners.len() > hull.corners().len());
    }

    #[test]
    fn full_hull_drops_flattest_corner_and_reports_it() {
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
        fn no_point_below_hull_and_corners_are_points(
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
