//! Samples between voxels that are classified and lit where they lie, from interpolated
//! intensity and gradient.

use crate::classify::shade::{Lit, Shader};
use crate::rays::line::Line;
use crate::rays::run::{Reader, Run};
use crate::real::Real;
use crate::shaded::Shaded;
use crate::work::RenderWork;

/// Interpolates intensity and gradient between voxels, together with the share that was seen.
pub(crate) trait SampleClassifier<T> {
    /// Returns seen · (intensity, gradient along the lattice's axes) as colour and seen as
    /// opacity, trilinear at a region position; `None` if certainly nothing was seen.
    fn between(&self, at: [T; 3]) -> Option<Lit<T, 4>>;
}

/// There is no surface where less than this share was seen.
const SEEN: f64 = 0.5;
/// Iterations of the search for a surface between two samples. Regula falsi leaves less than
/// 10⁻⁴ of a step in a smooth field, bisection a 64th at the end of coverage.
const ITERATIONS: u32 = 6;

/// Takes samples from intensity and gradient.
#[derive(Clone, Copy)]
pub(crate) struct SampleReader<'a> {
    /// Reads only bricks in which a sample may be anything but transparent.
    visible: Reader<'a, 4>,
    /// Reads all bricks, for the surroundings of a sample.
    all: Reader<'a, 4>,
    shader: &'a Shader<f32>,
}

impl SampleClassifier<f32> for Reader<'_, 4> {
    #[inline(always)]
    fn between(&self, at: [f32; 3]) -> Option<Lit<f32, 4>> {
        self.at(at)
    }
}

impl<'a> SampleReader<'a> {
    pub(crate) fn new(voxels: &'a Shaded<4>, shader: &'a Shader<f32>) -> Self {
        Self { visible: Reader::of_visible(voxels), all: Reader::of_all(voxels), shader }
    }

    /// Same as [`Reader::run`].
    #[inline(always)]
    pub(crate) fn run<const C: usize>(
        &self,
        line: &Line,
        k: u32,
        n: u32,
        run: &mut Run<C>,
        work: &mut RenderWork,
    ) -> bool {
        let mut interpolated = Run::new();
        if !self.visible.run(line, k, n, &mut interpolated, work) {
            return false;
        }
        for i in 0..n {
            let (at, before) = (line.at(k + i), line.before(k + i));
            run.put(i as usize, sample(self.shader, &self.all, interpolated.sample(i as usize), at, before));
        }
        true
    }

    /// Returns the position along a line, in samples, of the surface that sample `k` belongs to;
    /// `None` if samples are classified.
    pub(crate) fn surface(&self, line: &Line, k: u32) -> Option<f64> {
        let isovalue = self.shader.isovalue()?;
        let (field, ends) = (self.all, [line.before(k), line.at(k)]);
        let heights = ends.map(|at| height(field.between(at), isovalue));
        let share = if is_inside(heights[0]) { 1.0 } else { crossing(&field, isovalue, ends, heights) };
        Some(f64::from(k) - 1.0 + f64::from(share))
    }
}

/// Returns the visible light of a sample, including a surface between it and the sample before.
#[inline(always)]
pub(crate) fn sample<T: Real, const C: usize>(
    shader: &Shader<T>,
    field: &impl SampleClassifier<T>,
    interpolated: Lit<T, 4>,
    at: [T; 3],
    before: [T; 3],
) -> Lit<T, C> {
    match shader.isovalue() {
        None => classified(shader, interpolated, at),
        Some(isovalue) => surface(shader, field, isovalue, interpolated, at, before),
    }
}

/// Classifies and lights a sample, weighted by the share that was seen.
#[inline(always)]
fn classified<T: Real, const C: usize>(
    shader: &Shader<T>,
    Lit { colour: [value, x, y, z], alpha: seen }: Lit<T, 4>,
    at: [T; 3],
) -> Lit<T, C> {
    if seen <= T::ZERO {
        return Lit { colour: [T::ZERO; C], alpha: T::ZERO };
    }
    let lit: Lit<T, C> = shader.light(true, value / seen, [x / seen, y / seen, z / seen], at);
    let mut colour = lit.colour;
    for c in &mut colour {
        *c = *c * seen;
    }
    Lit { colour, alpha: lit.alpha * seen }
}

/// Returns the intensity above the isovalue; `None` if too little was seen.
#[inline(always)]
fn height<T: Real>(interpolated: Option<Lit<T, 4>>, isovalue: T) -> Option<T> {
    match interpolated {
        Some(Lit { colour: [value, ..], alpha: seen }) if seen >= T::from_f64(SEEN) => Some(value / seen - isovalue),
        _ => None,
    }
}

#[inline(always)]
fn is_inside<T: Real>(height: Option<T>) -> bool {
    match height {
        Some(height) => height >= T::ZERO,
        None => false,
    }
}

/// Returns the surface between the sample before (exclusive) and this one (inclusive);
/// transparent if this one is not inside. If the one before is inside too, the surface lies at
/// this one.
#[inline(always)]
fn surface<T: Real, const C: usize>(
    shader: &Shader<T>,
    field: &impl SampleClassifier<T>,
    isovalue: T,
    interpolated: Lit<T, 4>,
    at: [T; 3],
    before: [T; 3],
) -> Lit<T, C> {
    let inside = height(Some(interpolated), isovalue);
    if !is_inside(inside) {
        return Lit { colour: [T::ZERO; C], alpha: T::ZERO };
    }
    let outside = height(field.between(before), isovalue);
    let mut hit = at;
    if !is_inside(outside) {
        hit = along(before, at, crossing(field, isovalue, [before, at], [outside, inside]));
    }
    let gradient = match field.between(hit) {
        Some(Lit { colour: [_, x, y, z], alpha: seen }) if seen > T::ZERO => [x / seen, y / seen, z / seen],
        _ => [T::ZERO; 3],
    };
    shader.surface(isovalue, gradient, hit)
}

/// Returns the position of the surface from outside to inside, 0 to 1, given the heights of both
/// ends.
#[inline(always)]
fn crossing<T: Real>(
    field: &impl SampleClassifier<T>,
    isovalue: T,
    [before, at]: [[T; 3]; 2],
    [mut outside, mut inside]: [Option<T>; 2],
) -> T {
    let (mut near, mut far) = (T::ZERO, T::ONE);
    let mut last = None;
    for _ in 0..ITERATIONS {
        let share = between(near, far, outside, inside);
        let found = height(field.between(along(before, at, share)), isovalue);
        let ends_inside = is_inside(found);
        let stays = if ends_inside {
            (far, inside) = (share, found);
            &mut outside
        } else {
            (near, outside) = (share, found);
            &mut inside
        };
        // An end that stays twice counts half (the Illinois rule); convergence would be slow
        // otherwise.
        if let (true, Some(height)) = (last == Some(ends_inside), stays) {
            *height = *height * T::from_f64(0.5);
        }
        last = Some(ends_inside);
    }
    between(near, far, outside, inside)
}

/// Returns the zero of a line through both heights, or the middle if a height is missing.
#[inline(always)]
fn between<T: Real>(near: T, far: T, outside: Option<T>, inside: Option<T>) -> T {
    match (outside, inside) {
        // The first is below 0, the second 0 or above.
        (Some(outside), Some(inside)) => near + (far - near) * (outside / (outside - inside)).unit(),
        _ => near + (far - near) * T::from_f64(0.5),
    }
}

#[inline(always)]
fn along<T: Real>(from: [T; 3], to: [T; 3], share: T) -> [T; 3] {
    let mut at = from;
    for a in 0..3 {
        at[a] = share.mul_add(to[a] - from[a], from[a]);
    }
    at
}
