//! Planes of a volume, or of the slices it is made of, in a picture of a given size: three
//! orthogonal planes, or one free plane.
//!
//! Seen places are grey, unseen ones muted blue. A colour overlay can show the weight, or
//! highlight unseen places. Around the planes are titles, arrows along their axes and marks
//! where the other planes cross; a legend is below. All of these are left out if the user asks
//! for planes alone, or if the picture is small.

use glam::{DMat3, DVec3};
use image::{Rgb, RgbImage};

use render::classify::transfer::{Colour, TransferError};
use render::section::layout::{Room, three};
use render::section::{Box3, Plane, Sampled, Section, SectionError};

use super::legend::{self, Entry, Legend, short};
use super::lettering::{self, fill};
use super::panel::{Frame, GUTTER, grey};
use super::planes::AXES;
use super::style::{DOT, GAP, PAPER, UNSEEN};

/// Least side of a picture with labels, pixels; smaller ones show planes alone.
pub const LEAST_LETTERED: u32 = 320;
/// Distance from a title's top to its plane.
const TITLE: u32 = 24;
/// Colour of the marks where another plane crosses.
const CROSSING: Rgb<u8> = Rgb([255, 206, 64]);
/// Overlay colour of unseen places, where they are highlighted.
const MISSED: Rgb<u8> = Rgb([244, 138, 32]);
/// Opacities of the overlays.
const WEIGHT_WASH: f32 = 0.6;
const COVERAGE_WASH: f32 = 0.8;
/// Share of the colour map used for weights. The map ends in white; the largest weight is a pale
/// yellow, distinct from grey.
const MAP_END: f64 = 0.88;
/// Colours of a legend's range.
const STEPS: u32 = 96;

/// A colour overlay on planes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Wash {
    /// None.
    Clear,
    /// The weight, from 0 to the largest seen in the planes, in even steps of a perceptual map.
    Weight,
    /// Unseen places, as densely as the seen share is missing.
    Coverage,
}

/// A plane on a sheet.
#[derive(Debug, Clone, PartialEq)]
pub struct SheetPanel {
    /// Its first pixel in the picture.
    pub corner: [u32; 2],
    /// Its pixels.
    pub section: Section,
    /// Title of the plane.
    pub title: String,
    /// Names of its rightward and downward axis; `None` for a free plane.
    axes: Option<[String; 2]>,
    /// Positions where other planes cross it, pixels from its corner to the right and down.
    crossings: Option<[f64; 2]>,
}

/// Planes in a picture.
#[derive(Debug, Clone, PartialEq)]
pub struct Sheet {
    /// Pixels of the picture, right and down.
    pub size: [u32; 2],
    /// The planes.
    pub panels: Vec<SheetPanel>,
    /// Whether there are titles, arrows and a legend.
    pub lettered: bool,
}

impl Sheet {
    /// Creates three planes across the axes of a volume's box, through a point (world mm) or its
    /// middle.
    ///
    /// # Errors
    /// [`SectionError`], in the same cases as [`three`].
    pub fn three(place: &Box3, through: Option<DVec3>, size: [u32; 2], lettered: bool) -> Result<Self, SectionError> {
        let lettered = lettered && size.iter().all(|side| *side >= LEAST_LETTERED);
        let foot = GAP / 2 + legend::HEIGHT;
        let room = match lettered {
            true => Room { gap: GAP, above: TITLE, left: GUTTER, below: GUTTER, foot },
            false => Room { gap: 2, ..Room::default() },
        };
        let panels = three(place, through, size, room)?;
        let through = through.unwrap_or_else(|| place.middle());
        let panels = panels.map(|panel| {
            let [right, down, cut] = panel.axes;
            let Section { first, right: across, down: below, .. } = panel.section;
            let pixel = |axis: DVec3| (through - first).dot(axis) / axis.length_squared();
            SheetPanel {
                corner: panel.corner,
                section: panel.section,
                title: title(place, [right, down, cut], through, panel.at_voxel),
                axes: Some([right, down].map(|axis| AXES[axis].to_string())),
                crossings: Some([pixel(across), pixel(below)]),
            }
        });
        Ok(Self { size, panels: panels.into(), lettered })
    }

    /// Creates one free plane.
    ///
    /// # Errors
    /// [`SectionError::Misses`].
    pub fn free(place: &Box3, plane: &Plane, size: [u32; 2], lettered: bool) -> Result<Self, SectionError> {
        let lettered = lettered && size.iter().all(|side| *side >= LEAST_LETTERED);
        let (corner, room) = match lettered {
            true => {
                let below = legend::HEIGHT + 2 * GAP;
                ([GAP, GAP + TITLE], [size[0] - 2 * GAP, size[1] - GAP - TITLE - below])
            }
            false => ([0, 0], size),
        };
        let section = plane.fit(place, room)?;
        let three = |v: DVec3| v.to_array().map(short).join(", ");
        let title = format!("through {} mm, across {}", three(plane.point), three(plane.normal));
        let panel = SheetPanel { corner, section, title, axes: None, crossings: None };
        Ok(Self { size, panels: vec![panel], lettered })
    }

    /// Returns the mm per pixel, the same for all panels.
    pub fn mm_per_px(&self) -> f64 {
        self.panels.first().map_or(0.0, |panel| panel.section.mm_per_px())
    }

    /// Draws the picture from the panels' pixels in their order; `window` gives black and white.
    ///
    /// # Errors
    /// [`TransferError`] if the weights do not give a colour range.
    ///
    /// # Panics
    /// When a panel has not all of its pixels.
    pub fn draw(&self, sampled: &[Vec<Sampled>], window: [f32; 2], wash: Wash) -> Result<RgbImage, TransferError> {
        let palette = Palette::new(sampled, window, wash)?;
        let mut picture = RgbImage::from_pixel(self.size[0], self.size[1], PAPER);
        let dot = self.title_dot();
        for (panel, sampled) in self.panels.iter().zip(sampled) {
            assert_eq!(sampled.len(), panel.section.pixels(), "a value a pixel");
            let frame = Frame { corner: panel.corner, size: panel.section.size };
            if self.lettered {
                frame.border(&mut picture);
                letter(&mut picture, panel, &frame, dot);
            }
            frame.fill(&mut picture, sampled.iter().map(|s| palette.colour(s)));
        }
        if self.lettered {
            let entries = Entry::bar(1.0 / self.mm_per_px(), self.size[0]).into_iter().chain(palette.legend());
            let left = self.panels.iter().map(|panel| panel.corner[0]).min().unwrap_or(GAP);
            let legend = Legend::within(entries.collect(), self.size[0] - 2 * GAP);
            let left = left.min(self.size[0] - GAP - legend.width());
            let bottom = self.panels.iter().map(|panel| panel.corner[1] + panel.section.size[1]).max().unwrap_or(0);
            let arrows = self.panels.iter().any(|panel| panel.axes.is_some());
            let below = if arrows { GUTTER + GAP / 2 } else { GAP };
            legend.draw(&mut picture, left, bottom + below);
        }
        Ok(picture)
    }

    /// Returns the pixels per dot with which all titles fit; `None` if they do not.
    fn title_dot(&self) -> Option<u32> {
        let fits = |dot: &u32| {
            self.panels.iter().all(|panel| {
                // A title may extend to the next plane, or to the picture's edge.
                let beside =
                    self.panels.iter().filter(|p| p.corner[1] == panel.corner[1] && p.corner[0] > panel.corner[0]);
                let end = beside.map(|p| p.corner[0] - GUTTER).min().unwrap_or(self.size[0]) - GAP / 2;
                panel.corner[0] + lettering::width(&panel.title, *dot) <= end
            })
        };
        [DOT, 1].into_iter().find(fits)
    }
}

/// Draws the labels around a plane.
fn letter(picture: &mut RgbImage, panel: &SheetPanel, frame: &Frame, title_dot: Option<u32>) {
    let [right, top] = [panel.corner[0] + panel.section.size[0], panel.corner[1]];
    if let Some(dot) = title_dot {
        frame.title(picture, 8 + lettering::height(dot), dot, &panel.title);
    }
    if let Some([right, down]) = &panel.axes {
        frame.arrows(picture, [right, down]);
    }
    if let Some(crossing) = panel.crossings {
        let at = |k: usize| {
            let pixel = crossing[k].round().clamp(0.0, f64::from(panel.section.size[k] - 1));
            panel.corner[k] + pixel as u32
        };
        fill(picture, [at(0), top - 6], [1, 5], CROSSING);
        fill(picture, [right + 1, at(1)], [5, 1], CROSSING);
    }
}

/// Formats "xy at z = -3.5 mm"; gives the voxel's index if the volume's axes are not the
/// world's.
fn title(place: &Box3, axes: [usize; 3], through: DVec3, at_voxel: f64) -> String {
    let [right, down, cut] = axes.map(|axis| AXES[axis]);
    let matrix = place.world_from_lattice.matrix3;
    let unit = DMat3::from_cols(matrix.x_axis.normalize(), matrix.y_axis.normalize(), matrix.z_axis.normalize());
    match unit.abs_diff_eq(DMat3::IDENTITY, 1e-9) {
        true => format!("{right}{down} at {cut} = {} mm", short(through[axes[2]])),
        false => format!("{right}{down} at {cut} voxel {}", short(at_voxel)),
    }
}

/// Maps samples to colours.
struct Palette {
    window: [f32; 2],
    wash: Wash,
    /// The largest weight in the planes, and the colour map of weights.
    most: f32,
    map: Colour,
}

impl Palette {
    fn new(sampled: &[Vec<Sampled>], window: [f32; 2], wash: Wash) -> Result<Self, TransferError> {
        let seen = sampled.iter().flatten().filter(|s| s.is_seen());
        let most = seen.map(|s| s.weight).fold(0.0, f32::max);
        // Any range works if nothing was seen.
        let most = if most > 0.0 { most } else { 1.0 };
        Ok(Self { window, wash, most, map: Colour::perceptual([0.0, f64::from(most) / MAP_END])? })
    }

    fn colour(&self, sampled: &Sampled) -> Rgb<u8> {
        let ground = match sampled.is_seen() {
            true => Rgb([grey(sampled.value, self.window); 3]),
            false => UNSEEN,
        };
        match self.wash {
            Wash::Clear => ground,
            Wash::Weight if sampled.is_seen() => mix(ground, self.weight(sampled.weight), WEIGHT_WASH),
            Wash::Weight => ground,
            Wash::Coverage => mix(ground, MISSED, COVERAGE_WASH * (1.0 - sampled.share)),
        }
    }

    fn weight(&self, weight: f32) -> Rgb<u8> {
        Rgb(self.map.at(weight).map(|c| (c * 255.0).round().clamp(0.0, 255.0) as u8))
    }

    fn legend(&self) -> Vec<Entry> {
        match self.wash {
            Wash::Clear => vec![Entry::greys(self.window), Entry::unseen()],
            Wash::Coverage => {
                let colour = mix(UNSEEN, MISSED, COVERAGE_WASH);
                vec![Entry::greys(self.window), Entry::Swatch { colour, label: "not seen" }]
            }
            Wash::Weight => {
                let middle = Rgb([128; 3]);
                let colours = (0..STEPS)
                    .map(|n| mix(middle, self.weight(self.most * n as f32 / (STEPS - 1) as f32), WEIGHT_WASH));
                let (low, high) = ("weight 0".to_owned(), short(f64::from(self.most)));
                vec![Entry::Ramp { low, high, colours: colours.collect() }, Entry::unseen(), Entry::greys(self.window)]
            }
        }
    }
}

/// Mixes `above` over `below`, with opacity `dense` from 0 to 1.
fn mix(below: Rgb<u8>, above: Rgb<u8>, dense: f32) -> Rgb<u8> {
    let channel = |c: usize| {
        let (below, above) = (f32::from(below.0[c]), f32::from(above.0[c]));
        (below + dense * (above - below)).round().clamp(0.0, 255.0) as u8
    };
    Rgb([channel(0), channel(1), channel(2)])
}

#[cfg(test)]
mod tests {
    use glam::DAffine3;
    use sonoweave_core::frames::Transform;

    use super::*;

    /// 20 × 16 × 12 voxels of 1 mm about the origin.
    fn place() -> Box3 {
        let lattice = DAffine3::from_translation(DVec3::new(-9.5, -7.5, -5.5));
        Box3::new(Transform::from_affine(lattice), [[0; 3], [19, 15, 11]])
    }

    fn all(sheet: &Sheet, of: impl Fn(DVec3) -> Sampled) -> Vec<Vec<Sampled>> {
        let panel = |panel: &SheetPanel| {
            let [width, height] = panel.section.size;
            (0..height).flat_map(|j| (0..width).map(move |i| (i, j))).map(|(i, j)| of(panel.section.at(i, j))).collect()
        };
        sheet.panels.iter().map(panel).collect()
    }

    const SEEN: Sampled = Sampled { value: 51.0, weight: 2.0, share: 1.0 };

    #[test]
    fn seen_is_grey_and_unseen_is_blue() {
        let sheet = Sheet::three(&place(), None, [420, 400], true).unwrap();
        let titles: Vec<&str> = sheet.panels.iter().map(|panel| panel.title.as_str()).collect();
        assert_eq!(titles, ["xy at z = 0 mm", "xz at y = 0 mm", "zy at x = 0 mm"]);
        // Seen at x < 0.
        let sampled = all(&sheet, |at| if at.x < 0.0 { SEEN } else { Sampled::UNSEEN });
        let picture = sheet.draw(&sampled, [0.0, 255.0], Wash::Clear).unwrap();
        assert_eq!(picture.dimensions(), (420, 400));
        for panel in &sheet.panels[..2] {
            let [x, y] = panel.corner;
            let [width, height] = panel.section.size;
            for j in [0, height / 2, height - 1] {
                assert_eq!(picture.get_pixel(x, y + j).0, [51; 3]);
                assert_eq!(picture.get_pixel(x + width - 1, y + j), &UNSEEN);
            }
        }
        // The legend shows both.
        let below = sheet.panels.iter().map(|p| p.corner[1] + p.section.size[1]).max().unwrap() + GUTTER;
        assert!((0..420).any(|x| (below..400).any(|y| picture.get_pixel(x, y) == &UNSEEN)));
        // Planes without labels are larger.
        let alone = Sheet::three(&place(), None, [420, 400], false).unwrap();
        assert!(alone.mm_per_px() < sheet.mm_per_px() && !alone.lettered);
        let small = Sheet::three(&place(), None, [64, 48], true).unwrap();
        assert!(!small.lettered);
        small.draw(&all(&small, |_| SEEN), [0.0, 255.0], Wash::Weight).unwrap();
    }

    #[test]
    fn overlays_show_weight_and_unseen() {
        let plane = Plane::new(DVec3::ZERO, DVec3::new(0.3, -1.0, 0.2), None).unwrap();
        let sheet = Sheet::free(&place(), &plane, [300, 260], true).unwrap();
        assert!(sheet.panels[0].title.starts_with("through 0, 0, 0 mm, across 0.28, -0.94, 0.19"));
        let of = |at: DVec3| match at.x {
            x if x < -5.0 => SEEN,
            x if x < 0.0 => Sampled { weight: 4.0, ..SEEN },
            x if x < 5.0 => Sampled { share: 0.25, ..SEEN },
            _ => Sampled::UNSEEN,
        };
        let sampled = all(&sheet, of);
        let draw = |wash| sheet.draw(&sampled, [0.0, 255.0], wash).unwrap();
        let colours = |picture: &RgbImage| {
            let (panel, mut found) = (&sheet.panels[0], [Rgb([0; 3]); 4]);
            for (n, _) in sampled[0].iter().enumerate() {
                let (i, j) = (n as u32 % panel.section.size[0], n as u32 / panel.section.size[0]);
                let band = ((panel.section.at(i, j).x + 10.0) / 5.0).clamp(0.0, 3.0) as usize;
                found[band] = *picture.get_pixel(panel.corner[0] + i, panel.corner[1] + j);
            }
            found
        };
        let clear = colours(&draw(Wash::Clear));
        assert_eq!(clear, [Rgb([51; 3]), Rgb([51; 3]), UNSEEN, UNSEEN]);
        let weight = colours(&draw(Wash::Weight));
        // Half of the largest weight is darker than the largest, which is pale; unseen places
        // have no weight to show.
        let bright = |c: Rgb<u8>| c.0.iter().map(|c| u32::from(*c)).sum::<u32>();
        assert!(bright(weight[0]) + 60 < bright(weight[1]) && weight[0] != clear[0], "{weight:?}");
        assert_eq!(&weight[2..], &clear[2..]);
        let coverage = colours(&draw(Wash::Coverage));
        assert_eq!(coverage[..2], clear[..2]);
        assert_eq!(coverage[3], mix(UNSEEN, MISSED, COVERAGE_WASH));
        assert!(coverage[2].0[0] < coverage[3].0[0] && coverage[2].0[0] > UNSEEN.0[0], "in parts: {coverage:?}");
    }
}
