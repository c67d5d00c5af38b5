//! Matter between voxels: intensity and gradient where a sample lies, classified and lit there.

use super::cast::Line;
use super::real::Real;
use super::run::{Reader, Run};
use super::shade::{Lit, Shader};
use super::shaded::Shaded;
use super::work::RenderWork;

/// Intensity and gradient of voxels, and how much of them was seen, between their places.
pub(super) trait Matter<T> {
    /// Seen · (intensity, gradient along the lattice's axes) as colour and seen as opacity, trilinear at a stage place; `None` where certainly nothing was seen.
    fn between(&self, at: [T; 3]) -> Option<Lit<T, 4>>;
}

/// Of what less than half was seen there is no surface.
const SEEN: f64 = 0.5;
/// Places between two samples at which a surface is looked for: regula falsi leaves less than 10⁻⁴ of a step of a smooth field, bisection of a 64th at the end
/// of coverage.
const LOOKS: u32 = 6;

/// Takes samples of matter.
#[derive(Clone, Copy)]
pub(super) struct MatterReader<'a> {
    /// Where a sample may be anything but transparent.
    visible: Reader<'a, 4>,
    /// And what is around it, where none may be.
    all: Reader<'a, 4>,
    shader: &'a Shader<f32>,
}

impl Matter<f32> for Reader<'_, 4> {
    #[inline(always)]
    fn between(&self, at: [f32; 3]) -> Option<Lit<f32, 4>> {
        self.at(at)
    }
}

impl<'a> MatterReader<'a> {
    pub(super) fn new(voxels: &'a Shaded<4>, shader: &'a Shader<f32>) -> Self {
        Self { visible: Reader::of_visible(voxels), all: Reader::of_all(voxels), shader }
    }

    /// As [`Reader::run`].
    #[inline(always)]
    pub(super) fn run<const C: usize>(
        &self,
        line: &Line,
        k: u32,
        n: u32,
        run: &mut Run<C>,
        work: &mut RenderWork,
    ) -> bool {
        let mut matter = Run::new();
        if !self.visible.run(line, k, n, &mut matter, work) {
            return false;
        }
        for i in 0..n {
            let (at, before) = (line.at(k + i), line.before(k + i));
            run.put(i as usize, sample(self.shader, &self.all, matter.sample(i as usize), at, before));
        }
        true
    }

    /// Where along a line the surface lies that its sample `k` is of, in samples; `None` where samples are classified.
    pub(super) fn surface(&self, line: &Line, k: u32) -> Option<f64> {
        let isovalue = self.shader.isovalue()?;
        let (field, ends) = (self.all, [line.before(k), line.at(k)]);
        let heights = ends.map(|at| height(field.between(at), isovalue));
        let share = if is_inside(heights[0]) { 1.0 } else { crossing(&field, isovalue, ends, heights) };
        Some(f64::from(k) - 1.0 + f64::from(share))
    }
}

/// What is seen of the matter at a sample, and of that between it and the sample before.
#[inline(always)]
pub(super) fn sample<T: Real, const C: usize>(
    shader: &Shader<T>,
    field: &impl Matter<T>,
    matter: Lit<T, 4>,
    at: [T; 3],
    before: [T; 3],
) -> Lit<T, C> {
    match shader.isovalue() {
        None => classified(shader, matter, at),
        Some(isovalue) => surface(shader, field, isovalue, matter, at, before),
    }
}

/// A sample of matter as it is seen, as opaque as it was seen.
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

/// The intensity above the surface's; `None` where nothing was seen.
#[inline(always)]
fn height<T: Real>(matter: Option<Lit<T, 4>>, isovalue: T) -> Option<T> {
    match matter {
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

/// The surface that lies between the sample before, not included, and this one, included; transparent where this one is not inside. Where the one before is
/// inside too, it is at this one.
#[inline(always)]
fn surface<T: Real, const C: usize>(
    shader: &Shader<T>,
    field: &impl Matter<T>,
    isovalue: T,
    matter: Lit<T, 4>,
    at: [T; 3],
    before: [T; 3],
) -> Lit<T, C> {
    let inside = height(Some(matter), isovalue);
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

/// How far from outside to inside the surface lies, 0 to 1, given the heights of both.
#[inline(always)]
fn crossing<T: Real>(
    field: &impl Matter<T>,
    isovalue: T,
    [before, at]: [[T; 3]; 2],
    [mut outside, mut inside]: [Option<T>; 2],
) -> T {
    let (mut near, mut far) = (T::ZERO, T::ONE);
    let mut last = None;
    for _ in 0..LOOKS {
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
        // An end that stays twice counts by half (the Illinois rule), or convergence would be slow.
        if let (true, Some(height)) = (last == Some(ends_inside), stays) {
            *height = *height * T::from_f64(0.5);
        }
        last = Some(ends_inside);
    }
    between(near, far, outside, inside)
}

/// Where a line through both heights is 0; the middle where there is no line.
#[inline(always)]
fn between<T: Real>(near: T, far: T, outside: Option<T>, inside: Option<T>) -> T {
    match (outside, inside) {
        // Below 0, and 0 or above.
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
