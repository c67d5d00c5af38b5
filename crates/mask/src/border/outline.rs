//! The outline of a component: its first and last pixel in each row and column.

use super::plane::Map;

/// Ends of a component's lines. Ends on the map's border are left out: the component goes on
/// beyond it.
#[derive(Debug, Default)]
pub(super) struct Ends {
    /// Lines and their ends.
    pub(super) ends: Vec<[usize; 2]>,
    /// Lines that end on the border.
    pub(super) cut: usize,
}

impl Ends {
    fn add(&mut self, line: usize, end: usize, border: usize) {
        if end == border {
            self.cut += 1;
        } else {
            self.ends.push([line, end]);
        }
    }

    /// Whether the component mostly goes on beyond the border.
    pub(super) fn is_cut(&self) -> bool {
        self.cut > self.ends.len()
    }
}

/// The outline of a component.
#[derive(Debug, Default)]
pub(super) struct Outline {
    /// First and last column of the rows.
    pub(super) left: Ends,
    pub(super) right: Ends,
    /// First and last row of the columns.
    pub(super) top: Ends,
    pub(super) bottom: Ends,
}

impl Outline {
    /// Returns the outline of a component's map.
    pub(super) fn new(component: &Map) -> Self {
        let (width, height) = (component.width, component.height);
        let mut outline = Self::default();
        for (v, row) in component.set.chunks_exact(width).enumerate() {
            let (first, last) = (row.iter().position(|&set| set), row.iter().rposition(|&set| set));
            if let (Some(first), Some(last)) = (first, last) {
                outline.left.add(v, first, 0);
                outline.right.add(v, last, width - 1);
            }
        }
        for u in 0..width {
            let mut rows = (0..height).filter(|v| component.set[v * width + u]);
            if let Some(first) = rows.next() {
                outline.top.add(u, first, 0);
                outline.bottom.add(u, rows.next_back().unwrap_or(first), height - 1);
            }
        }
        outline
    }
}
