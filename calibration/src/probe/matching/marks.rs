//! Dots assigned to wires, and the image plane that these give.

use glam::{DAffine3, DVec2, DVec3};

use super::scale::{ASPECT, BEYOND, NEAR_MM, STEEPEST, Scale, best};
use crate::probe::dots::Dot;
use crate::probe::layout::Layout;
use crate::probe::plane::{ImagePlane, PlaneSum};

/// Largest cosine between u and v as computed from one image.
const SKEW: f64 = 0.4;
/// Usual tilt of the plane against the posts: standard deviation of its tangent.
const USUAL_TILT: f64 = 0.4;

/// A dot assigned to a wire.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mark {
    /// Index of the phantom's wire.
    pub wire: usize,
    /// Its centre, pixels.
    pub at_px: DVec2,
    /// Height above its surroundings, grey levels.
    pub contrast: f32,
}

/// The recognised dots of an image.
#[derive(Debug, Clone, PartialEq)]
pub struct Match {
    /// The dots, by wire.
    pub marks: Vec<Mark>,
    /// The image plane in the phantom's frame, from these dots only.
    pub plane: ImagePlane,
    /// Root mean square of the dots' distances from their wires, mm.
    pub rms_mm: f64,
    /// Whether u points to the right as defined by the phantom's file.
    pub rightwards: bool,
    /// Cost for comparing readings of equally many dots: unusual misfit, pixels that are not
    /// square, and faint dots.
    pub(super) cost: f64,
}

impl Mark {
    pub(super) fn of(wire: usize, dot: &Dot) -> Self {
        Self { wire, at_px: dot.at_px, contrast: dot.contrast }
    }
}

impl Match {
    /// Returns the plane of these marks, if a scanner can have it. Marks off the plane are left
    /// out.
    pub(super) fn of(mut marks: Vec<Mark>, scale: &Scale, layout: &Layout) -> Option<Self> {
        let wires = layout.geometry().wires();
        let along = wires[layout.posts()[0].wire].direction();
        loop {
            if marks.len() < layout.least_dots() {
                return None;
            }
            let mut sum = PlaneSum::new(scale.unit);
            for mark in &marks {
                sum.add_dot(mark.at_px, &wires[mark.wire], &DAffine3::IDENTITY, 1.0);
            }
            // The slanted wires' dots may be in line or too few. Then only this prior fixes the
            // plane's angle to the posts.
            let across = sum.solve(true)?.pixel_mm();
            sum.add_tilt(along, USUAL_TILT * across[0].max(across[1]), NEAR_MM / 3.0);
            let plane = if layout.is_flat() { upright(&sum.solve(true)?, &marks, along)? } else { sum.solve(false)? };
            let off: Vec<(f64, f64)> =
                marks.iter().map(|mark| wires[mark.wire].nearest(plane.point(mark.at_px))).collect();
            let is_on =
                |(distance, share): &(f64, f64)| *distance <= NEAR_MM && (-BEYOND..=1.0 + BEYOND).contains(share);
            if !off.iter().all(is_on) {
                let worst = (0..marks.len()).max_by(|&a, &b| off[a].0.total_cmp(&off[b].0))?;
                marks.remove(worst);
                continue;
            }
            let [u, v] = plane.pixel_mm();
            let sizes = scale.pixel_mm[0]..=scale.pixel_mm[1];
            let steep = plane.u.cross(plane.v).normalize_or_zero().dot(along).abs();
            let fits = sizes.contains(&u) && sizes.contains(&v) && u <= ASPECT * v && v <= ASPECT * u;
            if !fits || plane.skew().abs() > SKEW || steep < STEEPEST {
                return None;
            }
            let rightwards = plane.u.dot(layout.rightwards()) > 0.0;
            let squares: f64 = off.iter().map(|(distance, _)| distance * distance).sum();
            let rms_mm = (squares / marks.len() as f64).sqrt();
            let (misfit, aspect, skew) = (rms_mm / NEAR_MM, (u / v).ln() / ASPECT.ln(), plane.skew() / SKEW);
            let faint: f64 = marks.iter().map(|mark| scale.faint(mark.contrast).powi(2)).sum();
            let cost = misfit * misfit + aspect * aspect + skew * skew + faint;
            return Some(Self { marks, plane, rms_mm, rightwards, cost });
        }
    }
}

/// Returns a plane through the line of the dots for the usual pose of a probe: straight down on
/// the N's, with square pixels. Only that line is taken from the open plane.
fn upright(open: &ImagePlane, marks: &[Mark], along: DVec3) -> Option<ImagePlane> {
    let first = marks.first()?.at_px;
    let far = |a: &&Mark, b: &&Mark| a.at_px.distance(first).total_cmp(&b.at_px.distance(first));
    let line_px = (marks.iter().max_by(far)?.at_px - first).try_normalize()?;
    let way = open.u * line_px.x + open.v * line_px.y;
    let pixel_mm = way.length();
    let (way, down) = (way.try_normalize()?, way.cross(along).try_normalize()?);
    let u = pixel_mm * (line_px.x * way - line_px.y * down);
    let v = pixel_mm * (line_px.y * way + line_px.x * down);
    Some(ImagePlane { u, v, origin: open.point(first) - u * first.x - v * first.y })
}

/// Fits a plane to the marks, then reassigns dots by that plane until nothing changes.
pub(super) fn settle(marks: Vec<Mark>, dots: &[Dot], scale: &Scale, layout: &Layout) -> Option<Match> {
    let wires = layout.geometry().wires();
    let mut found = Match::of(marks, scale, layout)?;
    for _ in 0..4 {
        let mut marks: Vec<Mark> = Vec::new();
        for (number, wire) in wires.iter().enumerate() {
            let Some((px, share)) = found.plane.cut(wire) else { continue };
            if !(-BEYOND..=1.0 + BEYOND).contains(&share) {
                continue;
            }
            let of_dot = |dot: &Dot| scale.against(found.plane.point(dot.at_px).distance(found.plane.point(px)), dot);
            let free = |dot: usize| marks.iter().all(|mark| mark.at_px != dots[dot].at_px);
            let nearest = best(dots.iter().map(of_dot).enumerate().filter(|(dot, _)| free(*dot)));
            if let Some((dot, _)) = nearest {
                marks.push(Mark::of(number, &dots[dot]));
            }
        }
        if marks == found.marks {
            break;
        }
        found = Match::of(marks, scale, layout)?;
    }
    Some(found)
}
