//! Assigns rests to landmarks by their mutual distances.

use glam::{DAffine3, DMat3, DVec3};
use nalgebra::Matrix3;

/// Number of rests to consider, the longest ones; more rests are no landmarks.
pub(super) const MOST_RESTS: usize = 30;
/// Three landmarks nearer to a line than this share of their distances determine a rotation
/// badly.
const LEAST_ASIDE: f64 = 0.1;

/// An assignment of rests to landmarks.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Match {
    /// Maps landmarks to rests; rigid.
    pub(super) to_rests: DAffine3,
    /// Index of each rest's landmark.
    pub(super) landmark: Vec<Option<usize>>,
    /// Number of landmarks with a rest.
    pub(super) count: usize,
    /// Mean square distance, mm².
    pub(super) mean_square: f64,
    /// Number of neighbouring rests whose landmarks are in the list's order.
    ordered: usize,
}

impl Match {
    /// Returns whether distances do not decide between two matches: both have as many
    /// landmarks, and their distances differ by less than chance (a factor of two).
    fn is_like(&self, other: &Self) -> bool {
        let [one, two] = [self.mean_square, other.mean_square];
        self.count == other.count && one >= 0.25 * two && two >= 0.25 * one
    }

    /// Returns whether this match is better. A better match has more landmarks, then smaller
    /// distances. Among equal matches, the one closer to the list's order is better.
    fn is_better(&self, other: &Self) -> bool {
        if self.is_like(other) && self.ordered != other.ordered {
            return self.ordered > other.ordered;
        }
        (other.count, self.mean_square) < (self.count, other.mean_square)
    }
}

/// Result of a search: the best match.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Found {
    pub(super) best: Match,
    /// Another match is as good: the landmarks are symmetric, and the order of touching decided
    /// …
    pub(super) by_order: bool,
    /// … or could not decide.
    pub(super) tied: bool,
}

impl Found {
    /// Adds another match.
    fn and(self, other: Match) -> Self {
        if self.best.landmark == other.landmark {
            return self;
        }
        let (alike, tied) = (other.is_like(&self.best), other.ordered == self.best.ordered);
        match (other.is_better(&self.best), alike) {
            (better, true) => {
                let tied = tied || !better && self.tied;
                Self { best: if better { other } else { self.best }, by_order: true, tied }
            }
            (true, false) => Self { best: other, by_order: false, tied: false },
            (false, false) => self,
        }
    }
}

/// Finds the rigid motion that brings most landmarks to within `near_mm` of rests. It tries all
/// triples of rests that agree with three landmarks in their distances. Returns `None` if no
/// triple does.
pub(super) fn search(rests: &[DVec3], landmarks: &[DVec3], near_mm: f64) -> Option<Found> {
    let mut best = None;
    for a in 0..rests.len() {
        for b in a + 1..rests.len() {
            for c in b + 1..rests.len() {
                best = threes(rests, landmarks, [a, b, c], near_mm, best);
            }
        }
    }
    best
}

fn threes(rests: &[DVec3], landmarks: &[DVec3], abc: [usize; 3], near_mm: f64, best: Option<Found>) -> Option<Found> {
    let mut best = best;
    let [a, b, c] = abc.map(|k| rests[k]);
    let (ab, bc, ca) = (a.distance(b), b.distance(c), c.distance(a));
    let agrees = |one: f64, other: f64| (one - other).abs() <= 2.0 * near_mm;
    for i in 0..landmarks.len() {
        for j in (0..landmarks.len()).filter(|&j| j != i && agrees(ab, landmarks[i].distance(landmarks[j]))) {
            for k in (0..landmarks.len()).filter(|&k| k != i && k != j) {
                let [p, q, r] = [i, j, k].map(|k| landmarks[k]);
                if !(agrees(bc, q.distance(r)) && agrees(ca, r.distance(p))) {
                    continue;
                }
                let longest = p.distance(q).max(q.distance(r)).max(r.distance(p));
                if (q - p).cross(r - p).length() < LEAST_ASIDE * longest * longest {
                    continue;
                }
                let start = rigid(&[p, q, r], &[a, b, c]);
                let Some(found) = start.and_then(|start| settle(start, rests, landmarks, near_mm)) else { continue };
                best = Some(match best {
                    None => Found { best: found, by_order: false, tied: false },
                    Some(known) => known.and(found),
                });
            }
        }
    }
    best
}

/// Refines a first motion: fits all rests near a landmark until the assignment no longer
/// changes.
fn settle(start: DAffine3, rests: &[DVec3], landmarks: &[DVec3], near_mm: f64) -> Option<Match> {
    let mut to_rests = start;
    let mut landmark = assign(&to_rests, rests, landmarks, near_mm);
    for _ in 0..10 {
        let (from, to): (Vec<_>, Vec<_>) = pairs(&landmark, rests, landmarks).unzip();
        to_rests = rigid(&from, &to)?;
        let next = assign(&to_rests, rests, landmarks, near_mm);
        if next == landmark {
            break;
        }
        landmark = next;
    }
    let squares: Vec<f64> =
        pairs(&landmark, rests, landmarks).map(|(p, q)| to_rests.transform_point3(p).distance_squared(q)).collect();
    let mut touched: Vec<usize> = landmark.iter().flatten().copied().collect();
    let ordered = touched.windows(2).filter(|two| two[0] <= two[1]).count();
    touched.sort_unstable();
    touched.dedup();
    let mean_square = squares.iter().sum::<f64>() / squares.len().max(1) as f64;
    (touched.len() >= 3).then_some(Match { to_rests, count: touched.len(), landmark, mean_square, ordered })
}

/// Returns each rest's nearest landmark, if within `near_mm`.
fn assign(to_rests: &DAffine3, rests: &[DVec3], landmarks: &[DVec3], near_mm: f64) -> Vec<Option<usize>> {
    let there: Vec<DVec3> = landmarks.iter().map(|p| to_rests.transform_point3(*p)).collect();
    let nearest = |rest: &DVec3| {
        let distances = there.iter().map(|p| p.distance(*rest)).enumerate();
        distances.min_by(|a, b| a.1.total_cmp(&b.1)).filter(|(_, mm)| *mm <= near_mm).map(|(index, _)| index)
    };
    rests.iter().map(nearest).collect()
}

fn pairs<'a>(
    landmark: &'a [Option<usize>],
    rests: &'a [DVec3],
    landmarks: &'a [DVec3],
) -> impl Iterator<Item = (DVec3, DVec3)> + 'a {
    landmark.iter().zip(rests).filter_map(|(index, rest)| Some((landmarks[(*index)?], *rest)))
}

/// Returns the rigid motion of points to others by least squares (Kabsch, Acta Crystallogr. A
/// 32, 1976; Umeyama, IEEE PAMI 13, 1991). `None` for fewer than three points, and for points
/// on a line.
pub(super) fn rigid(from: &[DVec3], to: &[DVec3]) -> Option<DAffine3> {
    let n = from.len() as f64;
    if from.len() < 3 {
        return None;
    }
    let (centre, there) = (from.iter().sum::<DVec3>() / n, to.iter().sum::<DVec3>() / n);
    let mut products = DMat3::ZERO;
    for (p, q) in from.iter().zip(to) {
        let (p, q) = (*p - centre, *q - there);
        products += DMat3::from_cols(q * p.x, q * p.y, q * p.z);
    }
    let svd = Matrix3::from_column_slice(&products.to_cols_array()).svd(true, true);
    let values = svd.singular_values;
    if values[1] <= 1e-9 * values[0] {
        return None;
    }
    let matrix = |m: Matrix3<f64>| DMat3::from_cols_slice(m.as_slice());
    let (u, v_t) = (matrix(svd.u?), matrix(svd.v_t?));
    let sign = (u.determinant() * v_t.determinant()).signum();
    let rotation = u * DMat3::from_diagonal(DVec3::new(1.0, 1.0, sign)) * v_t;
    Some(DAffine3 { matrix3: rotation, translation: there - rotation * centre })
}
