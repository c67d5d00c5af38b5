//! Samples of the picture's rays that a change may have reached, row by row.
//!
//! There are two conservative descriptions of a change: its boxes one by one, or one body that
//! encloses them all. That body is the slab of the slice or, if no slab is known, the bounding
//! box. A few boxes concern fewer pixels. Many boxes overlap in the picture, and an oblique slab
//! holds fewer samples than they do. Each row uses the cheaper description.

use volume::prism::Faces;

use crate::camera::Camera;
use crate::rays::line::Line;
use crate::rays::slab::{Body, Footprint, ViewRays, whole};
use crate::shaded::Dirty;
use crate::work::RenderWork;

/// The bounding box is used only if the separate boxes have this many times as many pixels. Most
/// of a ray in the bounding box may be unchanged.
const BOXES_TO_ONE: i64 = 8;

/// Boxes of changed voxels and the body around them, as seen by the rays of one view.
pub(crate) struct Marks {
    rays: ViewRays,
    /// Samples behind a place that depend on it.
    reach: u32,
    footprints: Vec<Footprint>,
    /// The footprints of each row, row after row; and the start index of each row.
    of_rows: Vec<u32>,
    begins: Vec<u32>,
    around: Option<Body<12>>,
    /// The enclosing body is used only if the separate boxes have this many times as many
    /// pixels.
    boxes_to_one: i64,
}

impl Marks {
    /// Creates an empty set for the rays of a camera. `reach` is the number of samples behind a
    /// place that depend on it.
    pub(crate) fn new(camera: &Camera, reach: u32) -> Self {
        let begins = vec![0; camera.size()[1] as usize + 1];
        Self {
            rays: ViewRays::new(camera),
            reach,
            footprints: Vec::new(),
            of_rows: Vec::new(),
            begins,
            around: None,
            boxes_to_one: 1,
        }
    }

    /// Sets the boxes, all of which lie in a slab if one is given; region coordinates.
    pub(crate) fn set(&mut self, dirty: &[Dirty], within: Option<&[Faces; 3]>) {
        let Self { rays, footprints, of_rows, begins, .. } = self;
        footprints.clear();
        footprints.extend(dirty.iter().filter_map(|d| Footprint::new(d, rays)));
        // Counting sort, filled from the end.
        begins.fill(0);
        for Footprint { rows: [first, last], .. } in footprints.iter() {
            (*first..=*last).for_each(|j| begins[j as usize] += 1);
        }
        let mut sum = 0;
        for begin in begins.iter_mut() {
            sum += *begin;
            *begin = sum;
        }
        of_rows.clear();
        of_rows.resize(sum as usize, 0);
        for (number, Footprint { rows: [first, last], .. }) in footprints.iter().enumerate() {
            for begin in &mut begins[*first as usize..=*last as usize] {
                *begin -= 1;
                of_rows[*begin as usize] = number as u32;
            }
        }
        let around = dirty.iter().copied().reduce(|a, b| Dirty {
            low: std::array::from_fn(|axis| a.low[axis].min(b.low[axis])),
            high: std::array::from_fn(|axis| a.high[axis].max(b.high[axis])),
        });
        self.around = around.map(|around| Body::around(&around, within, rays));
        self.boxes_to_one = if within.is_some() { 1 } else { BOXES_TO_ONE };
    }

    /// Returns the footprints of the boxes.
    pub(crate) fn footprints(&self) -> &[Footprint] {
        &self.footprints
    }

    /// Adds the possibly changed samples of the rays of row `j` to those already noted. Returns
    /// the first pixel concerned and the one after the last.
    #[inline(always)]
    pub(crate) fn note(&self, j: u32, lines: &[Line], noted: &mut [[u32; 2]], work: &mut RenderWork) -> [usize; 2] {
        let mut pixels = [lines.len(), 0];
        let of_row = &self.of_rows[self.begins[j as usize] as usize..self.begins[j as usize + 1] as usize];
        let mut of_boxes = 0;
        let mut range = [u32::MAX, 0];
        for number in of_row {
            let [first, last] = self.footprints[*number as usize].columns;
            of_boxes += i64::from(last - first) + 1;
            range = [range[0].min(first), range[1].max(last)];
        }
        if of_boxes == 0 {
            return pixels;
        }
        let mut note = Note { rays: &self.rays, reach: self.reach, lines, noted, pixels: &mut pixels, work };
        if let Some(around) = &self.around {
            let row = around.row(j);
            let [first, last] = row.columns(range);
            if (last - first + 1) * self.boxes_to_one <= of_boxes {
                for i in first..=last {
                    // Not negative: within the range.
                    note.pixel(i as u32, row.samples(note.rays, i as u32));
                }
                return pixels;
            }
        }
        for number in of_row {
            let footprint = &self.footprints[*number as usize];
            let row = footprint.row(j);
            for i in footprint.columns[0]..=footprint.columns[1] {
                note.pixel(i, row.samples(note.rays, i));
            }
        }
        pixels
    }
}

/// Target of the noted samples.
struct Note<'a> {
    rays: &'a ViewRays,
    reach: u32,
    lines: &'a [Line],
    noted: &'a mut [[u32; 2]],
    pixels: &'a mut [usize; 2],
    work: &'a mut RenderWork,
}

impl Note<'_> {
    #[inline(always)]
    fn pixel(&mut self, i: u32, samples: [f64; 2]) {
        let at = i as usize;
        let Line { first, end, .. } = self.lines[at];
        let [from, to] = whole(samples, [first, end], self.reach);
        self.work.pixels_met += 1;
        if from < to {
            let known = &mut self.noted[at];
            let before = u64::from(known[1].saturating_sub(known[0]));
            *known = [known[0].min(from), known[1].max(to)];
            self.work.samples_marked += u64::from(known[1] - known[0]) - before;
            *self.pixels = [self.pixels[0].min(at), self.pixels[1].max(at + 1)];
        }
    }
}
