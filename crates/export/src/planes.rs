//! A picture of a volume's three middle planes, side by side at equal mm per pixel.
//!
//! From left to right the planes xy, xz and yz of the volume's index axes; the first axis of
//! each runs right, the second down. Below them are a scale bar, the range of grey levels and
//! the colour of unseen voxels, which differs from black. Filled voxels are tinted.

mod plane;

use std::path::Path;

use image::RgbImage;

use super::ExportError;
use super::legend::{self, Entry, Legend, short};
use super::lettering;
use super::panel::{Frame, GUTTER};
use super::picture::write_rgb;
pub use super::shades::{Shades, VoxelValue};
pub use super::style::UNSEEN;
use super::style::{DOT, GAP, PAPER};
pub use plane::Panel;
use volume::Grid;

/// Largest drawn edge of a plane, pixels.
const LARGEST: u32 = 1600;

pub(super) const AXES: [char; 3] = ['x', 'y', 'z'];
/// Rightward axis, downward axis, axis that the plane cuts.
const PLANES: [[usize; 3]; 3] = [[0, 1, 2], [0, 2, 1], [1, 2, 0]];

/// The values shown as black and white.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Window {
    /// From the 1st to the 99.5th percentile of the seen voxels in the three planes.
    Percentiles,
    /// From `low`, black, to `high`, white.
    Range {
        /// Black.
        low: f32,
        /// White.
        high: f32,
    },
}

/// Options of the picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlanesOptions {
    /// The values shown as black and white.
    pub window: Window,
    /// The voxel through which the planes pass; `None` is the middle.
    pub through: Option<[u64; 3]>,
    /// Length of the volume's longest edge in the picture, pixels (at most 1600); raised to one
    /// pixel a voxel if that fits.
    pub edge_px: u32,
    /// Colour scheme.
    pub shades: Shades,
}

impl Default for PlanesOptions {
    fn default() -> Self {
        Self { window: Window::Percentiles, through: None, edge_px: 400, shades: Shades::Greys }
    }
}

/// The picture, and the positions of the planes in it.
#[derive(Debug, Clone)]
pub struct PlanesPicture {
    /// The picture.
    pub picture: RgbImage,
    /// xy, xz, yz.
    pub panels: [Panel; 3],
    /// The values shown as black and white.
    pub window: [f32; 2],
}

impl PlanesPicture {
    /// Writes a PNG file, whole or not at all; replaces an existing file.
    ///
    /// # Errors
    /// [`ExportError::Write`] with the file system's reason.
    pub fn write_png(&self, path: &Path) -> Result<(), ExportError> {
        write_rgb(&self.picture, path)
    }
}

/// Draws the three planes of a volume.
///
/// `voxel` gives the grey level of a seen or filled voxel, or `None` if it is unseen; values
/// that are not finite count as unseen.
///
/// # Errors
/// [`ExportError`] when the volume is empty, the window has no width or the planes lie outside.
pub fn planes<V: Into<VoxelValue>>(
    grid: &Grid,
    voxel: impl Fn([u64; 3]) -> Option<V>,
    options: &PlanesOptions,
) -> Result<PlanesPicture, ExportError> {
    let spacing = grid.spacing.to_array();
    if grid.size.contains(&0) || !spacing.iter().all(|s| s.is_finite() && *s > 0.0) {
        return Err(ExportError::Grid { size: grid.size, spacing });
    }
    let through = options.through.unwrap_or(grid.size.map(|n| n / 2));
    if through.iter().zip(grid.size).any(|(at, n)| *at >= n) {
        return Err(ExportError::Outside { through, size: grid.size });
    }
    let px_per_mm = scale(grid, options.edge_px);
    let pixels: [u32; 3] =
        std::array::from_fn(|k| ((grid.size[k] as f64 * spacing[k] * px_per_mm).round() as u32).max(1));

    let titles = PLANES.map(|axes| title(grid, axes, through[axes[2]]));
    let top = GAP + lettering::height(DOT) + GAP / 2;
    let mut left = GAP;
    let panels: [Panel; 3] = std::array::from_fn(|n| {
        let axes = PLANES[n];
        let panel = Panel {
            axes,
            at: through[axes[2]],
            corner: [left + GUTTER, top],
            size: [pixels[axes[0]], pixels[axes[1]]],
            voxels: [grid.size[axes[0]], grid.size[axes[1]]],
        };
        left += GUTTER + panel.size[0].max(lettering::width(&titles[n], DOT)) + GAP;
        panel
    });
    let values = panels.map(|panel| panel.sample(&|at| voxel(at).map(V::into)));
    let window = resolve(options.window, &values)?;

    let mut entries: Vec<Entry> = Entry::bar(px_per_mm, u32::MAX).into_iter().collect();
    entries.extend(options.shades.entries(window));
    if values.iter().flatten().flatten().any(|shown| matches!(shown, VoxelValue::Filled(_))) {
        entries.push(options.shades.filled(window));
    }
    let legend = Legend::new(entries);
    let tallest = panels.iter().map(|p| p.size[1]).max().unwrap_or(1);
    let legend_top = top + tallest + GUTTER + GAP;
    let size = [left.max(legend.width() + 2 * GAP + GUTTER), legend_top + legend::HEIGHT + GAP];
    let mut picture = RgbImage::from_pixel(size[0], size[1], PAPER);
    for ((panel, values), title) in panels.iter().zip(&values).zip(&titles) {
        draw_panel(&mut picture, panel, values, (options.shades, window), title);
    }
    legend.draw(&mut picture, GAP + GUTTER, legend_top);
    Ok(PlanesPicture { picture, panels, window })
}

/// Returns pixels per mm, the same for all planes and axes.
fn scale(grid: &Grid, edge_px: u32) -> f64 {
    let spacing = grid.spacing.to_array();
    let edge_mm = (0..3).map(|k| grid.size[k] as f64 * spacing[k]).fold(0.0, f64::max);
    let finest = spacing.into_iter().fold(f64::INFINITY, f64::min);
    // Pixels wider than a voxel would skip voxels.
    let per_voxel = (edge_mm / finest).min(f64::from(LARGEST));
    f64::from(edge_px.clamp(16, LARGEST)).max(per_voxel) / edge_mm
}

/// Formats "xy at z = −3.5 mm"; gives the voxel's index if the volume's axes are not the
/// world's.
fn title(grid: &Grid, axes: [usize; 3], at: u64) -> String {
    let [right, down, cut] = axes.map(|k| AXES[k]);
    if grid.direction == glam::DMat3::IDENTITY {
        let k = axes[2];
        let mm = grid.origin[k] + grid.spacing[k] * at as f64;
        format!("{right}{down} at {cut} = {} mm", short(mm))
    } else {
        format!("{right}{down} at {cut} voxel {at}")
    }
}

fn resolve(window: Window, values: &[Vec<Option<VoxelValue>>; 3]) -> Result<[f32; 2], ExportError> {
    if let Window::Range { low, high } = window {
        let good = low.is_finite() && high.is_finite() && low < high;
        return if good { Ok([low, high]) } else { Err(ExportError::Window { low, high }) };
    }
    let mut seen: Vec<f32> = values.iter().flatten().flatten().filter_map(|shown| shown.seen()).collect();
    if seen.is_empty() {
        return Ok([0.0, 1.0]);
    }
    seen.sort_unstable_by(f32::total_cmp);
    let percentile = |p: f64| seen[((seen.len() - 1) as f64 * p / 100.0).round() as usize];
    let (low, high) = (percentile(1.0), percentile(99.5));
    // A single grey level is drawn as the middle of the range.
    Ok(if low < high { [low, high] } else { [low - 1.0, high + 1.0] })
}

fn draw_panel(
    picture: &mut RgbImage,
    panel: &Panel,
    values: &[Option<VoxelValue>],
    (shades, window): (Shades, [f32; 2]),
    title: &str,
) {
    let frame = Frame { corner: panel.corner, size: panel.size };
    frame.border(picture);
    frame.fill(picture, values.iter().map(|value| value.map_or(shades.nothing(), |shown| shades.of(shown, window))));
    frame.title(picture, panel.corner[1] - GAP, DOT, title);
    let [right, down, _] = panel.axes.map(|k| AXES[k].to_string());
    frame.arrows(picture, [&right, &down]);
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DMat3, DVec3};

    fn grid(size: [u64; 3], spacing: [f64; 3]) -> Grid {
        Grid { origin: DVec3::ZERO, spacing: DVec3::from_array(spacing), direction: DMat3::IDENTITY, size }
    }

    fn pixel(drawn: &PlanesPicture, panel: usize, voxel: [u64; 2]) -> [u8; 3] {
        let [x, y] = drawn.panels[panel].pixel_of(voxel);
        drawn.picture.get_pixel(x, y).0
    }

    const RANGE: PlanesOptions = PlanesOptions {
        window: Window::Range { low: 0.0, high: 255.0 },
        through: None,
        edge_px: 400,
        shades: Shades::Greys,
    };

    #[test]
    fn voxel_appears_at_its_indices_in_each_plane() {
        // Middle: [6, 4, 3].
        let grid = grid([12, 8, 6], [1.0, 2.0, 3.0]);
        for (panel, lit, at) in [(0, [9, 2, 3], [9, 2]), (1, [1, 4, 5], [1, 5]), (2, [6, 7, 0], [7, 0])] {
            let drawn = planes(&grid, |v| Some(if v == lit { 255.0_f32 } else { 20.0 }), &RANGE).unwrap();
            let [nx, ny] = drawn.panels[panel].voxels;
            for voxel in (0..ny).flat_map(|v| (0..nx).map(move |u| [u, v])) {
                let grey = pixel(&drawn, panel, voxel)[0];
                assert_eq!(grey > 200, voxel == at, "panel {panel}, voxel {voxel:?}: {grey}");
            }
        }
    }

    #[test]
    fn planes_share_scale_and_do_not_overlap() {
        let drawn = planes(&grid([40, 10, 30], [0.5, 1.0, 3.0]), |_| Some(1.0_f32), &RANGE).unwrap();
        // 20 × 10 × 90 mm; 90 mm are 400 pixels, and a voxel's 0.5 mm at least one.
        assert_eq!(drawn.panels.map(|p| p.size), [[89, 44], [89, 400], [44, 400]]);
        for pair in drawn.panels.windows(2) {
            assert!(pair[0].corner[0] + pair[0].size[0] < pair[1].corner[0]);
        }
        let last = drawn.panels[2];
        assert!(last.corner[0] + last.size[0] < drawn.picture.width());
        let fine = planes(&grid([900, 10, 10], [0.1; 3]), |_| Some(1.0_f32), &RANGE).unwrap();
        assert_eq!(fine.panels[0].size, [900, 10]);
    }

    #[test]
    fn unseen_voxels_have_own_colour() {
        let drawn = planes(
            &grid([8, 8, 8], [1.0; 3]),
            |[x, ..]| (x >= 4).then_some(if x == 7 { 0.0_f32 } else { 200.0 }),
            &RANGE,
        );
        let drawn = drawn.unwrap();
        assert_eq!(pixel(&drawn, 0, [2, 3]), UNSEEN.0);
        assert_eq!(pixel(&drawn, 0, [7, 3]), [0; 3]);
        let panel = drawn.panels[0];
        let row = panel.corner[1] + 200;
        for x in 0..400 {
            let colour = drawn.picture.get_pixel(panel.corner[0] + x, row).0;
            let voxel = f64::from(x) / 50.0;
            if voxel < 4.0 {
                assert_eq!(colour, UNSEEN.0, "pixel {x}");
            } else if voxel < 6.5 {
                assert_eq!(colour, [200; 3], "pixel {x}");
            }
        }
        assert!(UNSEEN.0[0] != UNSEEN.0[2]);
        let poisoned = planes(&grid([4; 3], [1.0; 3]), |_| Some(f32::NAN), &PlanesOptions::default()).unwrap();
        assert_eq!(pixel(&poisoned, 2, [1, 1]), UNSEEN.0);
    }

    #[test]
    fn filled_voxels_are_tinted_and_in_legend() {
        let grid = grid([8, 8, 8], [1.0; 3]);
        let seen = |[x, ..]: [u64; 3]| (x >= 4).then_some(200.0_f32);
        let plain = planes(&grid, seen, &RANGE).unwrap();
        let voxel = |at: [u64; 3]| match at {
            [2..4, ..] => Some(VoxelValue::Filled(100.0)),
            at => seen(at).map(VoxelValue::Seen),
        };
        let filled = planes(&grid, voxel, &RANGE).unwrap();
        let [r, g, b] = pixel(&filled, 0, [2, 3]);
        assert!(r > g && g > b, "{r} {g} {b}");
        assert_eq!((pixel(&filled, 0, [0, 3]), pixel(&filled, 0, [5, 3])), (UNSEEN.0, [200; 3]));
        let panel = filled.panels[0];
        let row = panel.corner[1] + 200;
        for x in (200..400).map(|x| panel.corner[0] + x) {
            assert_eq!(filled.picture.get_pixel(x, row), plain.picture.get_pixel(x, row), "pixel {x}");
        }
        assert!(filled.picture.width() >= plain.picture.width());
        let legend = |drawn: &PlanesPicture| {
            let top = panel.corner[1] + panel.size[1] + GUTTER;
            let tinted = |[r, g, b]: [u8; 3]| r > g && g > b && r - b > 40;
            let below = drawn.picture.enumerate_pixels().filter(|(_, y, _)| *y > top);
            below.filter(|(.., colour)| tinted(colour.0)).count()
        };
        assert_eq!((legend(&plain), legend(&filled) > 100), (0, true), "the legend tells the tint where there is any");
        let only = planes(&grid, |_| Some(VoxelValue::Filled(7.0)), &PlanesOptions::default()).unwrap();
        assert_eq!(only.window, [0.0, 1.0], "what was filled has no say in what is black");
    }

    #[test]
    fn percentiles_ignore_outliers_and_unseen() {
        let options = PlanesOptions::default();
        let voxel = |[x, y, z]: [u64; 3]| match (x, y, z) {
            (0, 0, 10) => Some(1e6_f32),
            (_, y, _) if y < 5 => None,
            (x, ..) => Some(100.0 + x as f32),
        };
        let drawn = planes(&grid([20; 3], [1.0; 3]), voxel, &options).unwrap();
        let [low, high] = drawn.window;
        assert!((100.0..101.0).contains(&low) && (118.0..=119.0).contains(&high), "{low} {high}");
        let flat = planes(&grid([4; 3], [1.0; 3]), |_| Some(7.0_f32), &options).unwrap();
        assert_eq!(pixel(&flat, 0, [1, 1]), [128; 3]);
    }

    #[test]
    fn titles_name_plane_and_position() {
        let mut grid = grid([11, 11, 11], [0.5; 3]);
        grid.origin = DVec3::new(-2.5, -2.6, 1.0);
        assert_eq!(title(&grid, PLANES[0], 5), "xy at z = 3.5 mm");
        assert_eq!(title(&grid, PLANES[2], 5), "yz at x = 0 mm");
        grid.direction = DMat3::from_cols(DVec3::Y, DVec3::NEG_X, DVec3::Z);
        assert_eq!(title(&grid, PLANES[1], 5), "xz at y voxel 5");
    }

    #[test]
    fn invalid_input_is_refused_and_files_are_whole() {
        let voxel = |_| Some(1.0_f32);
        let good = grid([4; 3], [1.0; 3]);
        assert!(matches!(planes(&grid([4, 0, 4], [1.0; 3]), voxel, &RANGE), Err(ExportError::Grid { .. })));
        let empty = PlanesOptions { window: Window::Range { low: 3.0, high: 3.0 }, ..RANGE };
        assert!(matches!(planes(&good, voxel, &empty), Err(ExportError::Window { .. })));
        let beside = PlanesOptions { through: Some([1, 4, 1]), ..RANGE };
        assert!(matches!(planes(&good, voxel, &beside), Err(ExportError::Outside { .. })));

        let folder = tempfile::tempdir().unwrap();
        let drawn = planes(&good, voxel, &RANGE).unwrap();
        let path = folder.path().join("planes.png");
        drawn.write_png(&path).unwrap();
        assert_eq!(image::open(&path).unwrap().to_rgb8(), drawn.picture);
        let missing = folder.path().join("missing/planes.png");
        assert!(matches!(drawn.write_png(&missing), Err(ExportError::Write { path, .. }) if path == missing));
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }
}
