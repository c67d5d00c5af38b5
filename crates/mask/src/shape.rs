//! Shapes of sets of pixels: runs, the largest connected component, its convex hull.

/// Consecutive live pixels `start..end` of row `row`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Run {
    pub(super) row: usize,
    pub(super) start: usize,
    pub(super) end: usize,
}

impl Run {
    pub(super) fn len(&self) -> usize {
        self.end - self.start
    }
}

/// The runs of a map of `width` columns, row by row, left to right.
pub(super) fn runs(live: &[bool], width: usize) -> Vec<Run> {
    let mut runs = Vec::new();
    for (row, pixels) in live.chunks_exact(width).enumerate() {
        let mut at = 0;
        while let Some(start) = pixels[at..].iter().position(|&p| p).map(|offset| at + offset) {
            let end = pixels[start..].iter().position(|&p| !p).map_or(width, |offset| start + offset);
            runs.push(Run { row, start, end });
            at = end;
        }
    }
    runs
}

/// Returns the runs of the largest 8-connected component, in the order given (that of
/// [`runs`]). Among equal components, the first.
pub(super) fn largest_component(runs: &[Run]) -> Vec<Run> {
    let mut parent: Vec<usize> = (0..runs.len()).collect();
    // Two pointers: `above` walks the previous row while `below` walks its row.
    let mut above = 0;
    for below in 0..runs.len() {
        let run = runs[below];
        while above < below
            && (runs[above].row + 1 < run.row || (runs[above].row + 1 == run.row && runs[above].end < run.start))
        {
            above += 1;
        }
        let mut other = above;
        // Touching at a corner counts: ends are exclusive, so equality is one column apart
        // diagonally.
        while other < below && runs[other].row + 1 == run.row && runs[other].start <= run.end {
            let (a, b) = (root(&mut parent, other), root(&mut parent, below));
            // The smaller index becomes the root, so that results do not depend on the walk.
            parent[a.max(b)] = a.min(b);
            other += 1;
        }
    }
    let mut size = vec![0_usize; runs.len()];
    for (index, run) in runs.iter().enumerate() {
        size[root(&mut parent, index)] += run.len();
    }
    let Some(best) = (0..runs.len()).rev().max_by_key(|&index| size[index]) else { return Vec::new() };
    (0..runs.len()).filter(|&index| root(&mut parent, index) == best).map(|index| runs[index]).collect()
}

fn root(parent: &mut [usize], mut index: usize) -> usize {
    while parent[index] != index {
        parent[index] = parent[parent[index]];
        index = parent[index];
    }
    index
}

/// Returns the convex hull of the pixels' centres, rasterised: the first row, and for each row
/// the columns `start..end` whose centres it holds. `component` is a non-empty, connected set
/// in the order of [`runs`].
pub(super) fn hull_rows(component: &[Run]) -> (usize, Vec<(usize, usize)>) {
    let first_row = component.first().map_or(0, |run| run.row);
    let mut left: Vec<(i64, i64)> = Vec::new();
    let mut right: Vec<(i64, i64)> = Vec::new();
    for run in component {
        let (row, first, last) = (signed(run.row), signed(run.start), signed(run.end) - 1);
        match left.last_mut() {
            Some(point) if point.0 == row => point.1 = point.1.min(first),
            _ => left.push((row, first)),
        }
        match right.last_mut() {
            // Mirrored, so that both sides are lower hulls.
            Some(point) if point.0 == row => point.1 = point.1.min(-last),
            _ => right.push((row, -last)),
        }
    }
    let (left, right) = (lower_hull(&left), lower_hull(&right));
    let rows = left
        .iter()
        .zip(&right)
        .map(|(&from, &to)| (usize::try_from(from).unwrap_or(0), usize::try_from(1 - to).unwrap_or(0)))
        .collect();
    (first_row, rows)
}

fn signed(n: usize) -> i64 {
    i64::try_from(n).unwrap_or(i64::MAX)
}

/// Returns, for each row between the first and the last point, the smallest integer not below
/// the points' greatest convex minorant. Points ascend by row. Exact in integers.
fn lower_hull(points: &[(i64, i64)]) -> Vec<i64> {
    let mut corners: Vec<(i64, i64)> = Vec::new();
    for &point in points {
        while let [.., a, b] = corners[..] {
            // b stays only when it lies strictly below the line from a to the new point.
            if (b.1 - a.1) * (point.0 - a.0) < (point.1 - a.1) * (b.0 - a.0) {
                break;
            }
            corners.pop();
        }
        corners.push(point);
    }
    let mut values = Vec::new();
    for pair in corners.windows(2) {
        let (a, b) = (pair[0], pair[1]);
        let run = b.0 - a.0;
        // -(x div_euclid) of the negative rounds up.
        values.extend((a.0..b.0).map(|row| a.1 - ((a.1 - b.1) * (row - a.0)).div_euclid(run)));
    }
    values.extend(corners.last().map(|corner| corner.1));
    values
}

/// Grey opening of a profile with a flat window of `2·radius + 1`: valleys stay, and peaks
/// narrower than the window are lowered to their surroundings. The result never exceeds the
/// profile.
pub(super) fn opened(profile: &[usize], radius: usize) -> Vec<usize> {
    let window = |values: &[usize], pick: fn(usize, usize) -> usize| -> Vec<usize> {
        (0..values.len())
            .map(|at| {
                let around = &values[at.saturating_sub(radius)..(at + radius + 1).min(values.len())];
                around.iter().copied().reduce(pick).unwrap_or_default()
            })
            .collect()
    };
    let eroded = window(profile, usize::min);
    window(&eroded, usize::max)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn map(rows: &[&str]) -> (Vec<bool>, usize) {
        (rows.iter().flat_map(|row| row.bytes().map(|b| b == b'#')).collect(), rows[0].len())
    }

    #[test]
    fn components_join_at_corners_largest_taken() {
        let (live, width) = map(&["##...#", "..#..#", ".#...#", "......", "#.#.##"]);
        let all = runs(&live, width);
        assert_eq!(all.len(), 9);
        let largest = largest_component(&all);
        assert_eq!(largest.iter().map(Run::len).sum::<usize>(), 4);
        assert_eq!(largest[0], Run { row: 0, start: 0, end: 2 });
        let (live, width) = map(&["#.#.#", "#.#.#", "#####"]);
        assert_eq!(largest_component(&runs(&live, width)).iter().map(Run::len).sum::<usize>(), 11);
        assert!(largest_component(&[]).is_empty());
    }

    #[test]
    fn opening_removes_narrow_peaks_and_never_rises() {
        assert_eq!(opened(&[3, 3, 9, 3, 3, 1, 3, 3], 1), [3, 3, 3, 3, 3, 1, 3, 3]);
        assert_eq!(opened(&[9, 7, 5, 3, 5, 7, 9], 1), [7, 7, 5, 3, 5, 7, 7]);
    }

    proptest! {
        #[test]
        fn component_matches_flood_fill(bits in prop::collection::vec(any::<bool>(), 96)) {
            let (width, height) = (12_usize, 8_usize);
            let mut label = vec![0_usize; 96];
            let mut sizes = vec![0_usize];
            for begin in 0..96 {
                if bits[begin] && label[begin] == 0 {
                    sizes.push(0);
                    let name = sizes.len() - 1;
                    let mut stack = vec![begin];
                    label[begin] = name;
                    while let Some(at) = stack.pop() {
                        sizes[name] += 1;
                        let (u, v) = (at % width, at / width);
                        for y in v.saturating_sub(1)..(v + 2).min(height) {
                            for x in u.saturating_sub(1)..(u + 2).min(width) {
                                let next = y * width + x;
                                if bits[next] && label[next] == 0 {
                                    label[next] = name;
                                    stack.push(next);
                                }
                            }
                        }
                    }
                }
            }
            let found = largest_component(&runs(&bits, width)).iter().map(Run::len).sum::<usize>();
            prop_assert_eq!(found, sizes.into_iter().max().unwrap_or(0));
        }

        #[test]
        fn hull_is_smallest_convex_set_of_rows(points in prop::collection::vec(-40_i64..40, 1..20)) {
            let points: Vec<(i64, i64)> = points.into_iter().enumerate().map(|(row, x)| (signed(row), x)).collect();
            let hull = lower_hull(&points);
            prop_assert_eq!(hull.len(), points.len());
            for (value, &(row, x)) in hull.iter().zip(&points) {
                prop_assert!(*value <= x);
                // By definition, the minorant at a row is the least over all chords of points
                // left and right of it.
                let mut least = x * 1_000;
                for &(r0, x0) in points.iter().filter(|p| p.0 <= row) {
                    for &(r1, x1) in points.iter().filter(|p| p.0 > row) {
                        let chord = 1_000 * x0 + (1_000 * (x1 - x0) * (row - r0)).div_euclid(r1 - r0);
                        least = least.min(chord);
                    }
                }
                // In thousandths, rounded down: the integer above may be hit exactly.
                let ceiling = -((-least).div_euclid(1_000));
                prop_assert!(*value == ceiling || (least.rem_euclid(1_000) == 0 && *value == ceiling + 1)
                    , "{} {}", value, least);
            }
        }
    }
}
