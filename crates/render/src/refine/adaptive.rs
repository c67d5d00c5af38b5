//! Adaptive ray casting: coarse rays where the picture is even, one ray a pixel elsewhere (after
//! Levoy 1990, "Volume rendering by adaptive refinement").
//!
//! The picture is divided into pixel regions of [`REGION`] pixels. The four corners and the
//! middle of each region are cast. A region is split into four, down to single pixels, if the
//! colours or transmittances of these rays differ by more than ε. It is also split if something
//! small may lie between them (see `features`). Regions that are not split are interpolated
//! bilinearly.
//!
//! Neighbouring regions share their edges. A pixel on a shared edge shows the ray that either
//! region has cast; otherwise the right or lower region interpolates it. The result depends only
//! on the volume, the view and ε, not on earlier pictures. A picture that follows its volume is
//! therefore bit for bit the one of the finished volume. Regions can also be held at a coarser
//! depth than they need; the refinement of a new view uses this.

use simd::sharing::Sharing;

use crate::rays::cast::Casting;
use crate::rays::composite::Accumulated;
use crate::rays::rows::Row;
use crate::work::RenderWork;

/// Pixels along an edge of a region, from one corner ray to the next.
pub(crate) const REGION: usize = 8;
/// Depths of cells in a region: edges of 8, 4, 2 and 1 pixels.
pub(crate) const DEPTHS: usize = 4;
/// Rays along the edge of a region, corners included.
const SIDE: usize = REGION + 1;
/// Index of the first cell of each depth; 1, 4 and 16 cells can be split.
const FIRST_CELL: [usize; DEPTHS - 1] = [0, 1, 5];

/// One pixel region.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
struct Region {
    /// Cells that are split, one bit each.
    split: u32,
    /// Rays that it needs, bit y·SIDE + x.
    rays: u128,
    /// Depths of cells that it has been refined to, at most [`DEPTHS`]; 0 before its first
    /// evaluation.
    depths: u8,
}

/// A cell of a region; at depth d, 2^d cells lie along the region's edge.
#[derive(Debug, Clone, Copy)]
struct Cell {
    depth: usize,
    at: [usize; 2],
}

impl Cell {
    const WHOLE: Self = Self { depth: 0, at: [0; 2] };

    /// Returns the first and last ray along an axis of a region that is `length` pixels long.
    fn span(self, axis: usize, length: usize) -> [usize; 2] {
        let edge = REGION >> self.depth;
        [self.at[axis] * edge, ((self.at[axis] + 1) * edge).min(length)]
    }

    fn bit(self) -> u32 {
        1 << (FIRST_CELL[self.depth] + (self.at[1] << self.depth) + self.at[0])
    }

    /// Returns the quarter with these bits of x and y.
    fn quarter(self, [x, y]: [usize; 2]) -> Self {
        Self { depth: self.depth + 1, at: [2 * self.at[0] + x, 2 * self.at[1] + y] }
    }

    /// Returns whether there are pixels between its corners.
    fn has_inside(self, size: [usize; 2]) -> bool {
        (0..2).any(|a| {
            let [first, last] = self.span(a, size[a]);
            last > first + 1
        })
    }
}

/// A picture divided into pixel regions.
pub(crate) struct Regions<const C: usize> {
    size: [usize; 2],
    count: [usize; 2],
    /// Largest difference between corners that causes no split.
    epsilon: f32,
    regions: Vec<Region>,
    /// The picture.
    pub(crate) seen: Vec<Accumulated<C>>,
    /// Rays to be cast in the next pass, a bit each, row by row.
    due: Vec<u64>,
    words: usize,
    /// Cells to be cast and tested, by region.
    cells: Vec<(usize, Cell)>,
    /// Regions to be drawn again.
    stale: Vec<bool>,
}

impl<const C: usize> Regions<C> {
    /// Creates an empty picture. If `settled`, the regions count as fully evaluated for an empty
    /// volume; otherwise no region has been evaluated.
    pub(crate) fn new(size: [u32; 2], epsilon: f32, settled: bool) -> Self {
        let size = size.map(|s| s as usize);
        let count = size.map(|s| (s - 1).div_ceil(REGION).max(1));
        let words = size[0].div_ceil(64);
        let mut regions = Self {
            size,
            count,
            epsilon,
            regions: vec![Region::default(); count[0] * count[1]],
            seen: vec![Accumulated::CLEAR; size[0] * size[1]],
            due: vec![0; words * size[1]],
            words,
            cells: Vec::new(),
            stale: vec![false; count[0] * count[1]],
        };
        if settled {
            for at in 0..regions.regions.len() {
                regions.regions[at].depths = DEPTHS as u8;
                let [x, y] = regions.middle(at, Cell::WHOLE).unwrap_or_default();
                regions.regions[at].rays = regions.corners(at, Cell::WHOLE) | 1 << (y * SIDE + x);
            }
        }
        regions
    }

    pub(crate) fn count(&self) -> [usize; 2] {
        self.count
    }

    pub(crate) fn len(&self) -> usize {
        self.regions.len()
    }

    /// Returns the number of depths a region has been refined to.
    pub(crate) fn depths(&self, region: usize) -> usize {
        usize::from(self.regions[region].depths)
    }

    /// Returns the first and last row of pixels that hold rays of a row of regions.
    pub(crate) fn rows_of(&self, row: usize) -> [usize; 2] {
        [row * REGION, ((row + 1) * REGION).min(self.size[1] - 1)]
    }

    /// Marks in `reached` the regions whose closed square holds pixels `first` to `end`
    /// (exclusive) of a row.
    pub(crate) fn reach(&self, row: usize, [first, end]: [usize; 2], reached: &mut [bool]) {
        if first >= end {
            return;
        }
        let of = |first: usize, last: usize, a: usize| {
            first.saturating_sub(1) / REGION..=(last / REGION).min(self.count[a] - 1)
        };
        for y in of(row, row, 1) {
            reached[y * self.count[0]..][..self.count[0]][of(first, end - 1, 0)].fill(true);
        }
    }

    /// Returns the number of pixels from the first to the last corner of a region.
    fn extent(&self, region: usize) -> [usize; 2] {
        let at = self.place(region);
        std::array::from_fn(|a| (self.size[a] - 1 - at[a] * REGION).min(REGION))
    }

    fn place(&self, region: usize) -> [usize; 2] {
        [region % self.count[0], region / self.count[0]]
    }

    /// Returns the rays at the corners of a cell.
    fn corners(&self, region: usize, cell: Cell) -> u128 {
        let size = self.extent(region);
        let ([x0, x1], [y0, y1]) = (cell.span(0, size[0]), cell.span(1, size[1]));
        [y0 * SIDE + x0, y0 * SIDE + x1, y1 * SIDE + x0, y1 * SIDE + x1].iter().fold(0, |rays, at| rays | 1 << at)
    }

    /// Evaluates the regions in `which` again, each to its given depth (1 to [`DEPTHS`]). Casts
    /// those of their rays that have changed and draws the result. The rows that hold rays of
    /// these regions must be ready; `small` returns whether something small may lie in a region.
    pub(crate) fn evaluate(
        &mut self,
        which: &[(usize, usize)],
        small: impl Fn(usize) -> bool,
        rows: &mut [Row<C>],
        casting: Casting<'_, C>,
    ) -> RenderWork {
        let (Some(low), Some(high)) = (which.iter().map(|w| w.0).min(), which.iter().map(|w| w.0).max()) else {
            return RenderWork::default();
        };
        let range = self.rows_of(low / self.count[0])[0]..self.rows_of(high / self.count[0])[1] + 1;
        rows[range.clone()].iter_mut().for_each(|row| row.work = RenderWork::default());
        self.cells.clear();
        let mut work = RenderWork { regions: which.len() as u64, ..RenderWork::default() };
        for (region, depths) in which {
            self.regions[*region] = Region { split: 0, rays: 0, depths: *depths as u8 };
            self.cells.push((*region, Cell::WHOLE));
        }
        while !self.cells.is_empty() {
            let mut at = 0;
            while let Some((region, cell)) = self.cells.get(at).copied() {
                // A cell that is split whatever its corners show needs no test of them first.
                if small(region) {
                    work.regions_small += u64::from(cell.depth == 0 && self.may_split(region, cell));
                    self.split(region, cell);
                }
                at += 1;
            }
            self.cast(range.clone(), rows, casting);
            let tested = std::mem::take(&mut self.cells);
            for (region, cell) in tested {
                let is_split = cell.depth + 1 < DEPTHS && self.regions[region].split & cell.bit() != 0;
                if !is_split && self.may_split(region, cell) && self.range(region, cell, rows) > self.epsilon {
                    self.split(region, cell);
                }
            }
        }
        rows[range.clone()].iter().for_each(|row| work += row.work);
        work.regions_split = which.iter().filter(|(region, _)| self.regions[*region].split != 0).count() as u64;
        // The rays on a region's right and lower edge are drawn by the regions there.
        for (region, _) in which {
            let [x, y] = self.place(*region);
            for y in y..=(y + 1).min(self.count[1] - 1) {
                self.stale[y * self.count[0]..][x..=(x + 1).min(self.count[0] - 1)].fill(true);
            }
        }
        work.pixels_changed = 0;
        let end = self.rows_of((high / self.count[0] + 1).min(self.count[1] - 1))[1] + 1;
        work += self.draw(range.start..end, rows, casting.sharing);
        work
    }

    /// Returns whether a cell has pixels between its corners and its region is refined that
    /// deep.
    fn may_split(&self, region: usize, cell: Cell) -> bool {
        cell.depth + 1 < usize::from(self.regions[region].depths) && cell.has_inside(self.extent(region))
    }

    /// Splits a cell, if allowed, and adds its quarters to the cells to be cast and tested.
    fn split(&mut self, region: usize, cell: Cell) {
        if !self.may_split(region, cell) {
            return;
        }
        self.regions[region].split |= cell.bit();
        let size = self.extent(region);
        for quarter in [[0, 0], [1, 0], [0, 1], [1, 1]].map(|q| cell.quarter(q)) {
            // Quarters beyond the picture's end have no pixels of their own.
            if (0..2).all(|a| quarter.at[a] == 0 || quarter.span(a, size[a])[0] < size[a]) {
                self.cells.push((region, quarter));
            }
        }
    }

    /// Casts the corners of the cells.
    fn cast(&mut self, range: std::ops::Range<usize>, rows: &mut [Row<C>], casting: Casting<'_, C>) {
        for at in 0..self.cells.len() {
            let (region, cell) = self.cells[at];
            let mut rays = self.corners(region, cell);
            if let Some([x, y]) = self.middle(region, cell) {
                rays |= 1 << (y * SIDE + x);
            }
            rays &= !self.regions[region].rays;
            self.regions[region].rays |= rays;
            let [x, y] = self.place(region).map(|at| at * REGION);
            while rays != 0 {
                let ray = rays.trailing_zeros() as usize;
                rays &= rays - 1;
                let [i, j] = [x + ray % SIDE, y + ray / SIDE];
                self.due[j * self.words + i / 64] |= 1 << (i % 64);
            }
        }
        let mut words: Vec<&mut [u64]> = self.due.chunks_mut(self.words).skip(range.start).take(range.len()).collect();
        let first = range.start;
        casting.sharing.chunks_beside(&mut rows[range], 1, &mut words, |words, j, rows| {
            let tiles = casting.visible.of_row(first + j);
            for (place, word) in words.iter_mut().enumerate() {
                let mut left = std::mem::take(word);
                while left != 0 {
                    let at = place * 64 + left.trailing_zeros() as usize;
                    left &= left - 1;
                    rows[0].cast(at, tiles, casting);
                }
            }
        });
    }

    /// Returns the pixels at the corners of a cell: upper left and right, lower left and right.
    fn pixels(&self, region: usize, cell: Cell, rows: &[Row<C>]) -> [Accumulated<C>; 4] {
        let size = self.extent(region);
        let [x, y] = self.place(region).map(|at| at * REGION);
        let ([x0, x1], [y0, y1]) = (cell.span(0, size[0]), cell.span(1, size[1]));
        [[x0, y0], [x1, y0], [x0, y1], [x1, y1]].map(|[i, j]| rows[y + j].pixels[x + i])
    }

    /// Returns the ray in the middle of a whole region that may be split. A peak, or an arc
    /// between the corners, shows there first.
    fn middle(&self, region: usize, cell: Cell) -> Option<[usize; 2]> {
        let tested = cell.depth == 0 && self.regions[region].depths > 1;
        tested.then(|| self.extent(region).map(|size| size.min(REGION / 2)))
    }

    /// Returns the largest difference between a cell's corners, and its middle if any, over
    /// colours and transmittance.
    fn range(&self, region: usize, cell: Cell, rows: &[Row<C>]) -> f32 {
        let [first, rest @ ..] = self.pixels(region, cell, rows);
        let (mut low, mut high) = (first, first);
        let [x, y] = self.place(region).map(|at| at * REGION);
        let middle = self.middle(region, cell).map(|[i, j]| rows[y + j].pixels[x + i]);
        for pixel in rest.into_iter().chain(middle) {
            for c in 0..C {
                low.colour[c] = low.colour[c].min(pixel.colour[c]);
                high.colour[c] = high.colour[c].max(pixel.colour[c]);
            }
            low.transmittance = low.transmittance.min(pixel.transmittance);
            high.transmittance = high.transmittance.max(pixel.transmittance);
        }
        let colours = (0..C).map(|c| high.colour[c] - low.colour[c]);
        colours.fold(high.transmittance - low.transmittance, f32::max)
    }

    /// Returns the unsplit cell of a region that holds a pixel.
    fn leaf(&self, region: usize, [x, y]: [usize; 2]) -> Cell {
        let size = self.extent(region);
        let mut cell = Cell::WHOLE;
        while cell.depth + 1 < DEPTHS && self.regions[region].split & cell.bit() != 0 {
            let half = REGION >> (cell.depth + 1);
            // The last pixel belongs to the last cell.
            let part = |a: usize, at: usize| {
                let middle = cell.span(a, size[a])[0] + half;
                usize::from(at >= middle && middle < size[a])
            };
            cell = cell.quarter([part(0, x), part(1, y)]);
        }
        cell
    }

    /// Returns whether a pixel, relative to the region that draws it, was cast by this region or
    /// a preceding one.
    fn is_cast(&self, region: usize, [x, y]: [usize; 2]) -> bool {
        let has = |region: usize, x: usize, y: usize| self.regions[region].rays >> (y * SIDE + x) & 1 != 0;
        let [left, above] = [x == 0 && !region.is_multiple_of(self.count[0]), y == 0 && region >= self.count[0]];
        has(region, x, y) || left && has(region - 1, REGION, y) || above && has(region - self.count[0], x, REGION)
    }

    /// Draws the stale regions, which lie within the given rows. Returns the numbers of
    /// interpolated and of changed pixels.
    fn draw(&mut self, range: std::ops::Range<usize>, rows: &[Row<C>], sharing: Sharing) -> RenderWork {
        let mut seen = std::mem::take(&mut self.seen);
        let mut work = vec![RenderWork::default(); range.len()];
        let drawn = &*self;
        let pixels = range.start * self.size[0]..range.end * self.size[0];
        sharing.chunks_beside(&mut seen[pixels], self.size[0], &mut work, |work, j, seen| {
            drawn.draw_row(range.start + j, rows, seen, work);
        });
        self.seen = seen;
        self.stale.fill(false);
        work.into_iter().fold(RenderWork::default(), |mut sum, work| {
            sum += work;
            sum
        })
    }

    fn draw_row(&self, j: usize, rows: &[Row<C>], seen: &mut [Accumulated<C>], work: &mut RenderWork) {
        let row = (j / REGION).min(self.count[1] - 1);
        let y = j - row * REGION;
        for column in 0..self.count[0] {
            let region = row * self.count[0] + column;
            if !self.stale[region] || self.regions[region].depths == 0 {
                continue;
            }
            let first = column * REGION;
            let end = if column + 1 == self.count[0] { self.size[0] } else { first + REGION };
            for (x, seen) in seen[first..end].iter_mut().enumerate() {
                let pixel = match self.is_cast(region, [x, y]) {
                    true => rows[j].pixels[first + x],
                    false => {
                        work.pixels_interpolated += 1;
                        let cell = self.leaf(region, [x, y]);
                        let size = self.extent(region);
                        let part = |a: usize, at: usize| {
                            let [from, to] = cell.span(a, size[a]);
                            (at - from) as f32 / (to - from).max(1) as f32
                        };
                        bilinear(self.pixels(region, cell, rows), [part(0, x), part(1, y)])
                    }
                };
                work.pixels_changed += u64::from(!pixel.same_bits(seen));
                *seen = pixel;
            }
        }
    }

    pub(crate) fn bytes(&self) -> u64 {
        (size_of_val(&*self.regions) + size_of_val(&*self.seen) + size_of_val(&*self.due)) as u64
    }
}

/// Interpolates bilinearly between four corners: upper left and right, lower left and right.
pub(crate) fn bilinear<const C: usize>(corners: [Accumulated<C>; 4], [x, y]: [f32; 2]) -> Accumulated<C> {
    let of = |[a, b, c, d]: [f32; 4]| {
        let (upper, lower) = (a + (b - a) * x, c + (d - c) * x);
        upper + (lower - upper) * y
    };
    Accumulated {
        colour: std::array::from_fn(|channel| of(corners.map(|pixel| pixel.colour[channel]))),
        transmittance: of(corners.map(|pixel| pixel.transmittance)),
    }
}
