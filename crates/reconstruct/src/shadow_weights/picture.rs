//! The weights of one picture after the other, on the nodes of its filtered values.

use mask::Mask;
use simd::Simd;
use simd::sharing::Sharing;
use sonoweave_core::slice::{Image, Pixels};

use super::ShadowWeights;
use super::beams::Beams;
use crate::nodes::Nodes;

/// Beams, and rows of nodes, that one task processes.
const BEAMS_PER_TASK: usize = 16;
const ROWS_PER_TASK: usize = 16;
/// Share of the samples in shadow from which a picture tells nothing.
const MOST_DARK: f64 = 0.6;
/// Entries of the table of weights for each median grey, and its end in such.
const ENTRIES: usize = 512;
const TABLE_END: usize = 2;

/// Weighs pictures of one size, mask and pixel size.
#[derive(Clone)]
pub(crate) struct PictureWeights {
    beams: Beams,
    /// Weights by the tail's part of the median grey, linear in between.
    table: Vec<f32>,
    /// The weight at which c is a half.
    half: f32,
    /// Grey levels of the samples; 0 outside of the data.
    greys: Vec<f32>,
    ordered: Vec<f32>,
    weights: Vec<f32>,
    nodes: Nodes,
}

impl PictureWeights {
    /// Prepares for a mask with data, and for values on nodes of the shape of `like`, which lie
    /// `step_px` apart.
    pub(crate) fn new(
        settings: &ShadowWeights,
        mask: &Mask,
        pixel_mm: [f64; 2],
        like: &Nodes,
        step_px: [f64; 2],
    ) -> Option<Self> {
        let beams = Beams::new(settings, mask, pixel_mm, like, step_px)?;
        let table = (0..=ENTRIES * TABLE_END + 1).map(|at| settings.weight(at as f64 / ENTRIES as f64) as f32);
        let samples = beams.pixels.len();
        Some(Self {
            table: table.collect(),
            half: settings.weight(settings.level) as f32,
            greys: vec![0.0; samples],
            ordered: Vec::with_capacity(samples),
            weights: vec![1.0; samples],
            nodes: Nodes::new(like.first, like.columns, like.rows, like.stride),
            beams,
        })
    }

    /// Returns the weights of a picture; `None` if it tells nothing and all its pixels count in
    /// full.
    pub(crate) fn of(&mut self, image: &Image, simd: Simd, sharing: Sharing) -> Option<&Nodes> {
        match image.pixels() {
            Pixels::U8(p) => self.read(p, |x| f32::from(*x), sharing),
            Pixels::U16(p) => self.read(p, |x| f32::from(*x), sharing),
            Pixels::F32(p) => self.read(p, |x| *x, sharing),
        }
        let median = self.median()?;
        self.weigh(1.0 / median, sharing);
        if self.tells_nothing() {
            return None;
        }
        let Self { beams, weights, nodes, .. } = self;
        let (stride, depths) = (nodes.stride, beams.depths);
        sharing.chunks(&mut nodes.data, stride * ROWS_PER_TASK, |index, rows| {
            let places = &beams.places[index * stride * ROWS_PER_TASK..];
            for (node, (at, [beam, depth])) in rows.iter_mut().zip(places) {
                let at = *at as usize;
                // The next one has no part in it where there is none.
                let along = |at: usize| {
                    let [this, next] = [at, at + 1].map(|at| weights.get(at).copied().unwrap_or(1.0));
                    this + depth * (next - this)
                };
                let this = along(at);
                *node = if *beam > 0.0 { this + beam * (along(at + depths) - this) } else { this };
            }
        });
        nodes.pack(simd, 1.0, sharing);
        Some(nodes)
    }

    fn read<T: Sync>(&mut self, pixels: &[T], grey: impl Fn(&T) -> f32 + Sync, sharing: Sharing) {
        let samples = self.beams.depths * BEAMS_PER_TASK;
        let places = &self.beams.pixels;
        sharing.chunks(&mut self.greys, samples, |index, greys| {
            for (to, at) in greys.iter_mut().zip(&places[index * samples..]) {
                *to = at.map_or(0.0, |at| grey(&pixels[at as usize]));
            }
        });
    }

    /// Returns the median grey level of the data; `None` if it is not positive.
    fn median(&mut self) -> Option<f32> {
        self.ordered.clear();
        let data = self.beams.pixels.iter().zip(&self.greys).filter(|(pixel, _)| pixel.is_some());
        self.ordered.extend(data.map(|(_, grey)| *grey));
        let middle = self.ordered.len() / 2;
        if self.ordered.is_empty() {
            return None;
        }
        let (_, median, _) = self.ordered.select_nth_unstable_by(middle, f32::total_cmp);
        Some(*median).filter(|median| *median > 0.0 && median.is_finite())
    }

    /// Weighs all samples by their tails.
    fn weigh(&mut self, per_median: f32, sharing: Sharing) {
        let Self { beams, table, greys, weights, .. } = self;
        let (beams, table, greys, depths) = (&*beams, table.as_slice(), greys.as_slice(), beams.depths);
        // Sums from the beam's beginning, in f64, as their differences are taken.
        let sums = || vec![0.0_f64; depths + 1];
        sharing.chunks_with(weights, depths, sums, |sums, beam, weights| {
            let mut sum = 0.0;
            for depth in 0..depths {
                sums[depth] = sum;
                sum += beams.beside(beam).map(|beam| f64::from(greys[beam * depths + depth])).sum::<f64>();
            }
            sums[depths] = sum;
            let shares = &beams.shares[beam * depths..];
            for (depth, (weight, share)) in weights.iter_mut().zip(shares).enumerate() {
                let tail = beams.tail(beam, depth);
                let mean = (sums[tail.end] - sums[tail.start]) as f32 * share;
                *weight = looked_up(table, mean * per_median);
            }
        });
    }

    /// Whether most samples lie in shadow, or the last ones of all beams.
    fn tells_nothing(&self) -> bool {
        let (mut data, mut dark) = (0_u64, 0_u64);
        let mut is_any_end_bright = false;
        let depths = self.beams.depths;
        for (pixels, weights) in self.beams.pixels.chunks(depths).zip(self.weights.chunks(depths)) {
            let mut last = None;
            for (_, weight) in pixels.iter().zip(weights).filter(|(pixel, _)| pixel.is_some()) {
                data += 1;
                dark += u64::from(*weight < self.half);
                last = Some(*weight);
            }
            is_any_end_bright |= last.is_some_and(|weight| weight >= self.half);
        }
        !is_any_end_bright || dark as f64 > MOST_DARK * data as f64
    }
}

/// Returns the entry of a table at a tail's part of the median grey.
fn looked_up(table: &[f32], tail: f32) -> f32 {
    // The comparisons of `clamp` leave NaN, which is 0 as an integer.
    let at = (tail * ENTRIES as f32).clamp(0.0, (ENTRIES * TABLE_END) as f32);
    let [this, next] = [at as usize, at as usize + 1].map(|at| table[at]);
    let part = at.fract();
    this + if part.is_nan() { 0.0 } else { part } * (next - this)
}
