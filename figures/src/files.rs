//! The three files of a figure, and the page that shows several.

use std::error::Error;
use std::fmt::Write as _;
use std::fs;
use std::path::Path;
use std::sync::Arc;

use resvg::tiny_skia::{FilterQuality, Pixmap, PixmapPaint, Transform};
use resvg::usvg::{Options, Tree, fontdb};

use crate::drawing::{Placed, drawn};
use crate::figure::Figure;

/// Pixels of the PNG per pixel of the SVG.
const PNG_SCALE: f32 = 2.0;

/// Writes `id.svg`, `id.png` and `id.csv` to an existing folder.
///
/// # Errors
/// If a file cannot be written, or the image is larger than memory.
pub fn write(figure: &Figure, folder: &Path) -> Result<(), Box<dyn Error>> {
    let (svg, pictures) = drawn(figure);
    let named = |ending: &str| folder.join(format!("{}.{ending}", figure.id));
    fs::write(named("png"), png_with(&svg, &pictures)?)?;
    fs::write(named("svg"), svg)?;
    fs::write(named("csv"), csv(figure))?;
    Ok(())
}

/// Converts an SVG to PNG, with only the compiled-in font.
///
/// # Errors
/// If the SVG is invalid, or the image is larger than memory.
pub fn png(svg: &str) -> Result<Vec<u8>, Box<dyn Error>> {
    png_with(svg, &[])
}

/// Same as [`png`], with raster images at their positions, because the SVG renderer reads no
/// image files.
fn png_with(svg: &str, pictures: &[Placed<'_>]) -> Result<Vec<u8>, Box<dyn Error>> {
    let mut fonts = fontdb::Database::new();
    fonts.load_font_data(dejavu::sans::regular().to_vec());
    fonts.load_font_data(dejavu::sans::bold().to_vec());
    let options = Options { fontdb: Arc::new(fonts), ..Options::default() };
    let tree = Tree::from_str(svg, &options)?;
    let size = tree.size().to_int_size().scale_by(PNG_SCALE).ok_or("the figure has no size")?;
    let mut pixels = Pixmap::new(size.width(), size.height()).ok_or("the figure is larger than memory")?;
    resvg::render(&tree, Transform::from_scale(PNG_SCALE, PNG_SCALE), &mut pixels.as_mut());
    let paint = PixmapPaint { quality: FilterQuality::Bilinear, ..PixmapPaint::default() };
    for Placed { raster, place: [x, y, wide, _] } in pictures {
        let scale = PNG_SCALE * (*wide / f64::from(raster.width())) as f32;
        let [x, y] = [x, y].map(|at| PNG_SCALE * *at as f32);
        let place = Transform::from_row(scale, 0.0, 0.0, scale, x, y);
        pixels.draw_pixmap(0, 0, raster.pixmap()?.as_ref(), &paint, place, None);
    }
    Ok(pixels.encode_png()?)
}

/// Returns the plotted data, one point per line, with all digits.
pub fn csv(figure: &Figure) -> String {
    let mut text = String::from("panel,series,x,y\n");
    for panel in &figure.panels {
        for series in &panel.series {
            let name = if series.name.is_empty() { "unnamed" } else { &series.name };
            for ([x, y], i) in series.points.iter().zip(0..) {
                let x = panel.x.categories.get(i).map_or_else(|| x.to_string(), |name| field(name));
                let _ = writeln!(text, "{},{},{x},{y}", field(&panel.title), field(name));
            }
        }
    }
    text
}

/// Returns a field of a CSV file, quoted if necessary.
pub fn field(text: &str) -> String {
    if text.contains([',', '"', '\n']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text.to_owned() }
}

/// Returns a page of figures, with introductory HTML before them.
pub fn page(title: &str, introduction: &str, figures: &[Figure]) -> String {
    let mut text = format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<meta charset=\"utf-8\">\n<title>{title}</title>\n<style>\n\
         body {{ font: 15px/1.5 \"DejaVu Sans\", Verdana, sans-serif; color: #222; max-width: 62rem; margin: 2rem auto; padding: 0 1rem }}\n\
         table {{ border-collapse: collapse; font-size: 13px }} td, th {{ border-bottom: 1px solid #ddd; padding: .35rem .5rem; text-align: left; \
         vertical-align: top }}\nsub {{ line-height: 0 }} figure {{ margin: 2.5rem 0 }} img {{ max-width: 100%; border: 1px solid #ddd }}\n</style>\n<h1>{title}</h1>\n{introduction}\n"
    );
    for figure in figures {
        let alt = format!("{} {}", figure.title, figure.caption)
            .replace('&', "&amp;")
            .replace('"', "&quot;")
            .replace('<', "&lt;")
            .replace('>', "&gt;");
        let id = figure.id;
        let _ = writeln!(
            text,
            "<figure id=\"{id}\"><img src=\"{id}.svg\" alt=\"{alt}\"><figcaption><a href=\"{id}.svg\">SVG</a>, \
             <a href=\"{id}.png\">PNG</a>, <a href=\"{id}.csv\">numbers</a></figcaption></figure>"
        );
    }
    text + "</html>\n"
}
