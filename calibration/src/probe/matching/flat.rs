//! Recognises the dots of N's that lie in one plane, or of a single N.
//!
//! All their dots are in line in the image, and the posts' dots divide it in the posts'
//! proportions. For a single N any three dots in line fit. It is only required that the middle
//! one lies between the others, that they are bright, and that the pixel size is possible. So a
//! single image may be misread, and its side is unknown. The poses decide when all images are
//! compared. A single line leaves the image's rotation about it open.

use glam::DVec2;

use super::lines::Triple;
use super::marks::{Mark, Match};
use super::scale::{BEYOND, IN_LINE_MM, NEAR_MM, STEEPEST, Scale, best};
use crate::probe::dots::Dot;
use crate::probe::layout::{Layout, N};

/// Positions of the posts of one plane in the image: along a line, by mm across them.
#[derive(Debug, Clone, Copy)]
struct Row {
    /// The pixel of the origin that posts are measured from.
    from: DVec2,
    /// Pixels per mm across the posts.
    mm: DVec2,
    /// That origin, and the direction of the posts' sequence; across them, mm.
    at: DVec2,
    towards: DVec2,
}

/// Returns the readings of each line of three as each N in either direction.
pub(super) fn readings(triples: &[Triple], dots: &[Dot], scale: &Scale, layout: &Layout) -> Vec<Match> {
    let as_each = |triple: &Triple| {
        let [a, b] = triple.outer;
        let middle = triple.middle;
        layout.ns().iter().enumerate().flat_map(move |(n, _)| [([a, b], middle, n), ([b, a], middle, n)])
    };
    triples
        .iter()
        .flat_map(as_each)
        .filter_map(|(outer, middle, n)| {
            let row = Row::of(&layout.ns()[n], outer.map(|dot| dots[dot].at_px), scale, layout)?;
            row.read((n, middle), dots, scale, layout)
        })
        .collect()
}

impl Row {
    /// Computes the row from one N's outer dots, if the pixel size is possible.
    fn of(n: &N, outer_px: [DVec2; 2], scale: &Scale, layout: &Layout) -> Option<Self> {
        let [at, to] = n.outer.map(|post| layout.posts()[post].at);
        let mm = (outer_px[1] - outer_px[0]) / n.width_mm;
        // A plane oblique to the posts cuts them at larger distances than a perpendicular one.
        let sizes = scale.pixel_mm[0] * STEEPEST..=scale.pixel_mm[1];
        let row = Self { from: outer_px[0], mm, at, towards: (to - at) / n.width_mm };
        sizes.contains(&(1.0 / mm.length())).then_some(row)
    }

    /// Returns the distance along the row of a position across the posts, mm; `None` off the
    /// row.
    fn along(&self, across: DVec2) -> Option<f64> {
        let way = across - self.at;
        (way.perp_dot(self.towards).abs() <= NEAR_MM).then(|| way.dot(self.towards))
    }

    /// Returns the distances of a dot along the row and from it, mm.
    fn of_dot(&self, dot: &Dot) -> [f64; 2] {
        let way = (dot.at_px - self.from) / self.mm.length_squared();
        [way.dot(self.mm), way.perp_dot(self.mm).abs()]
    }

    /// Returns the reading with one N's given middle dot. Other N's take theirs by position
    /// along the row, if visible.
    fn read(&self, own: (usize, usize), dots: &[Dot], scale: &Scale, layout: &Layout) -> Option<Match> {
        let mut used = vec![false; dots.len()];
        let (own, middle) = own;
        used[middle] = true;
        let mut marks = Vec::new();
        let mut off_line = 0.0_f64;
        for post in layout.posts() {
            let Some(there) = self.along(post.at) else { continue };
            let against = |dot: &Dot| {
                let [along, off] = self.of_dot(dot);
                scale.against((along - there).hypot(off), dot)
            };
            let free = dots.iter().map(against).enumerate().filter(|(dot, _)| !used[*dot]);
            if let Some((dot, _)) = best(free) {
                used[dot] = true;
                marks.push(Mark::of(post.wire, &dots[dot]));
            }
        }
        for (number, n) in layout.ns().iter().enumerate() {
            let [from, to] = n.outer.map(|post| self.along(layout.posts()[post].at));
            let (Some(from), Some(to)) = (from, to) else { continue };
            let against = |dot: &Dot| {
                let [along, off] = self.of_dot(dot);
                let share = (along - from) / (to - from);
                (off <= IN_LINE_MM && share > 0.0 && share < 1.0 && is_held(n, share))
                    .then(|| off / IN_LINE_MM + scale.faint(dot.contrast))
            };
            let free = |dot: usize| if number == own { dot == middle } else { !used[dot] };
            let found = best(dots.iter().map(against).enumerate().filter(|(dot, _)| free(*dot)));
            if let Some((dot, _)) = found {
                used[dot] = true;
                off_line = off_line.max(self.of_dot(&dots[dot])[1] / IN_LINE_MM);
                marks.push(Mark::of(n.middle, &dots[dot]));
            }
        }
        marks.sort_by_key(|mark| mark.wire);
        let mut found = Match::of(marks, scale, layout)?;
        found.cost += off_line * off_line;
        Some(found)
    }
}

/// Returns whether an N's slanted wire exists at this share of the way between the others.
fn is_held(n: &N, share: f64) -> bool {
    let along = (share - n.ends[0]) / (n.ends[1] - n.ends[0]);
    (-BEYOND..=1.0 + BEYOND).contains(&along)
}

#[cfg(test)]
mod tests {
    use super::super::Matcher;
    use super::*;
    use crate::phantom::Geometry;
    use crate::phantom::geometry::tests::three_ns;

    #[test]
    fn row_is_read_in_either_direction() {
        let one = Geometry::new("one N", vec![three_ns().wires()[..3].to_vec()], Vec::new()).unwrap();
        let layout = Layout::new(one).unwrap();
        let dot = |u: f64| Dot { at_px: DVec2::new(u, 200.0 + 0.1 * u), contrast: 100.0, area_px: 50 };
        let [left, middle, right] = [150.0, 290.0, 450.0].map(dot);
        for dots in [[left, middle, right], [right, left, middle], [middle, right, left]] {
            let reading = Matcher::new().read(&dots, [820, 616], &layout).unwrap();
            let mirrored = reading.mirrored.unwrap();
            assert_ne!(reading.best.rightwards, mirrored.rightwards);
            let of = |found: &Match, wire: usize| found.marks.iter().find(|mark| mark.wire == wire).unwrap().at_px;
            for (first, last) in [(0, 2), (2, 0)] {
                assert_eq!(of(&reading.best, first), of(&mirrored, last));
            }
            assert!([&reading.best, &mirrored].iter().all(|found| of(found, 1) == middle.at_px));
        }
    }

    #[test]
    fn impossible_triple_is_no_n() {
        let one = Geometry::new("one N", vec![three_ns().wires()[..3].to_vec()], Vec::new()).unwrap();
        let layout = Layout::new(one).unwrap();
        let read = |places: [[f64; 2]; 3]| {
            let dots = places.map(|at| Dot { at_px: at.into(), contrast: 100.0, area_px: 50 });
            Matcher::new().read(&dots, [820, 616], &layout)
        };
        assert!(read([[150.0, 200.0], [290.0, 200.0], [450.0, 200.0]]).is_some());
        assert!(read([[150.0, 200.0], [290.0, 240.0], [450.0, 200.0]]).is_none(), "not in line");
        assert!(read([[150.0, 200.0], [153.0, 200.0], [156.0, 200.0]]).is_none(), "pixels of centimetres");
        assert!(read([[150.0, 200.0], [155.0, 200.0], [450.0, 200.0]]).is_none(), "beyond the slanted wire's end");
    }
}
