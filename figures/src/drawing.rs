//! A figure as SVG, 800 pixels wide: title, panels, legend and caption below each other, so that
//! nothing covers the data.

use std::fmt::Write as _;

use crate::figure::{Axis, Figure, Panel, Series, SeriesStyle};
use crate::lettering::{FAMILY, SUBSCRIPT, subscript, width, width_bold, wrap};
use crate::raster::Raster;
use crate::scale::Tick;

/// Width of every figure, pixels.
pub const WIDTH: f64 = 800.0;
const MARGIN: f64 = 18.0;
/// Gap between panels of a row, and between rows.
const GAP: f64 = 22.0;
/// Font sizes.
const TITLE: f64 = 17.0;
const HEADING: f64 = 12.5;
const LABEL: f64 = 12.0;
const TICK: f64 = 11.0;
const CAPTION: f64 = 12.0;
/// Line height relative to the font size.
const LEADING: f64 = 1.4;
/// Approximate minimal distance of ticks.
const TICK_DISTANCE: f64 = 42.0;
const TEXT_INK: &str = "#222222";
const CAPTION_INK: &str = "#444444";
const GRID_INK: &str = "#e4e4e4";

/// Alignment of a text relative to its position.
#[derive(Clone, Copy)]
enum Anchor {
    Start,
    Middle,
    End,
}

/// Position of a raster image in a figure: left, top, width and height.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Placed<'a> {
    pub(crate) raster: &'a Raster,
    pub(crate) place: [f64; 4],
}

/// An SVG in construction.
struct Canvas<'a> {
    body: String,
    pictures: Vec<Placed<'a>>,
}

impl<'a> Canvas<'a> {
    /// Adds an image as large as fits, centred.
    fn picture(&mut self, raster: &'a Raster, [left, top]: [f64; 2], [wide, high]: [f64; 2]) {
        let size = [wide.min(high * raster.aspect()), high.min(wide / raster.aspect())];
        let at = [left + 0.5 * (wide - size[0]), top + 0.5 * (high - size[1])];
        let address = raster.address();
        self.push(&format!(
            r#"<image x="{:.2}" y="{:.2}" width="{:.2}" height="{:.2}" href="{address}"/>"#,
            at[0], at[1], size[0], size[1]
        ));
        self.pictures.push(Placed { raster, place: [at[0], at[1], size[0], size[1]] });
    }

    fn text(&mut self, [x, y]: [f64; 2], size: f64, anchor: Anchor, style: &str, text: &str) {
        let anchor = match anchor {
            Anchor::Start => "start",
            Anchor::Middle => "middle",
            Anchor::End => "end",
        };
        let text = subscripts(&escape(text), size);
        self.push(&format!(
            r#"<text x="{x:.2}" y="{y:.2}" font-size="{size}" text-anchor="{anchor}" {style}>{text}</text>"#
        ));
    }

    fn line(&mut self, [x1, y1]: [f64; 2], [x2, y2]: [f64; 2], stroke: &str, width: f64) {
        self.push(&format!(
            r#"<line x1="{x1:.2}" y1="{y1:.2}" x2="{x2:.2}" y2="{y2:.2}" stroke="{stroke}" stroke-width="{width}"/>"#
        ));
    }

    fn push(&mut self, element: &str) {
        self.body.push_str(element);
        self.body.push('\n');
    }
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('\'', "’")
}

/// Sets subscripts lower and smaller.
fn subscripts(text: &str, size: f64) -> String {
    let mut parts = text.split('_');
    let mut set = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        let (low, rest) = subscript(part);
        let (small, down) = (SUBSCRIPT * size, 0.2 * size);
        let _ = write!(set, r#"<tspan dy="{down:.1}" font-size="{small:.1}">{low}</tspan>"#);
        if !rest.is_empty() {
            let _ = write!(set, r#"<tspan dy="-{down:.1}">{rest}</tspan>"#);
        }
    }
    set
}

/// A panel with its ranges and ticks.
struct Prepared<'a> {
    panel: &'a Panel,
    x: [f64; 2],
    y: [f64; 2],
    x_ticks: Vec<Tick>,
    y_ticks: Vec<Tick>,
}

impl<'a> Prepared<'a> {
    /// Prepares a panel for a coordinate system of about this size.
    fn new(panel: &'a Panel, [wide, high]: [f64; 2]) -> Self {
        let range = |axis: &Axis, c: usize| {
            let all = panel.series.iter().flat_map(|s| s.points.iter().map(move |p| p[c]));
            axis.range.unwrap_or_else(|| axis.scale.range(all))
        };
        let (x, y) = (range(&panel.x, 0), range(&panel.y, 1));
        let ticks = |axis: &Axis, range, length: f64| match axis.categories.len() {
            0 => axis.scale.ticks(range, length / TICK_DISTANCE),
            _ => (0..).map(f64::from).zip(&axis.categories).map(|(at, t)| Tick { at, text: Some(t.clone()) }).collect(),
        };
        Self { panel, x, y, x_ticks: ticks(&panel.x, x, wide), y_ticks: ticks(&panel.y, y, high) }
    }

    /// Returns the space left of the coordinate system.
    fn gutter(&self) -> f64 {
        if self.panel.raster.is_some() {
            return 0.0;
        }
        let ticks = self.y_ticks.iter().filter_map(|t| t.text.as_ref()).map(|t| width(t, TICK)).fold(0.0, f64::max);
        LABEL * LEADING + ticks + 10.0
    }

    fn heading(&self, wide: f64) -> Vec<String> {
        wrap(&self.panel.title, HEADING * width_bold("n", 1.0) / width("n", 1.0), wide)
    }

    /// Returns the text at a tick of x, in lines.
    fn x_lines(&self, text: &str, wide: f64) -> Vec<String> {
        match self.panel.x.categories.len() {
            0 => vec![text.to_owned()],
            n => wrap(text, TICK, wide / n as f64 - 4.0),
        }
    }

    /// Returns the space below the coordinate system.
    fn footer(&self, wide: f64) -> f64 {
        if self.panel.raster.is_some() {
            return 8.0;
        }
        let lines = self.x_ticks.iter().filter_map(|t| t.text.as_ref()).map(|t| self.x_lines(t, wide).len()).max();
        let label = if self.panel.x.label.is_empty() { 0.0 } else { LABEL * LEADING };
        8.0 + TICK * LEADING * lines.unwrap_or(0) as f64 + label
    }

    fn draw(&self, canvas: &mut Canvas<'a>, clip: &str, [left, top]: [f64; 2], [wide, high]: [f64; 2]) {
        if let Some(raster) = &self.panel.raster {
            canvas.picture(raster, [left, top], [wide, high]);
            return;
        }
        let at_x = |v: f64| left + wide * self.panel.x.scale.place(v, self.x);
        let at_y = |v: f64| top + high * (1.0 - self.panel.y.scale.place(v, self.y));
        let bottom = top + high;
        for tick in &self.y_ticks {
            let y = at_y(tick.at);
            let Some(text) = &tick.text else {
                canvas.line([left - 2.5, y], [left, y], "#777777", 0.7);
                continue;
            };
            canvas.line([left, y], [left + wide, y], GRID_INK, 1.0);
            canvas.line([left - 4.0, y], [left, y], "#555555", 1.0);
            canvas.text([left - 7.0, y + 0.36 * TICK], TICK, Anchor::End, "", text);
        }
        let named = self.panel.x.categories.is_empty();
        for tick in &self.x_ticks {
            let x = at_x(tick.at);
            let Some(text) = &tick.text else {
                canvas.line([x, bottom], [x, bottom + 2.5], "#777777", 0.7);
                continue;
            };
            if named {
                canvas.line([x, top], [x, bottom], GRID_INK, 1.0);
                canvas.line([x, bottom], [x, bottom + 4.0], "#555555", 1.0);
            }
            for (line, n) in self.x_lines(text, wide).iter().zip(1..) {
                let y = bottom + 4.0 + f64::from(n) * TICK * LEADING - 2.0;
                canvas.text([x, y], TICK, Anchor::Middle, "", line);
            }
        }
        canvas.push(&format!(
            r##"<rect x="{left:.2}" y="{top:.2}" width="{wide:.2}" height="{high:.2}" fill="none" stroke="#555555" stroke-width="1"/>"##
        ));
        canvas.push(&format!(
            r#"<clipPath id="{clip}"><rect x="{left:.2}" y="{top:.2}" width="{wide:.2}" height="{high:.2}"/></clipPath>"#
        ));
        canvas.push(&format!(r#"<g clip-path="url(#{clip})">"#));
        let bars = self.panel.series.iter().filter(|s| s.style == SeriesStyle::Bars).count();
        let mut before = 0.0;
        for series in &self.panel.series {
            if series.style == SeriesStyle::Bars {
                let thick = 0.76 * wide / (self.x[1] - self.x[0]) / bars as f64;
                let shift = (before - 0.5 * bars as f64) * thick;
                before += 1.0;
                for [x, y] in series.points.iter().filter(|p| self.panel.y.scale.places(p[1])) {
                    let (x, y) = (at_x(*x) + shift, at_y(*y));
                    let (upper, lower) = (y.min(bottom), y.max(bottom).min(bottom));
                    canvas.push(&format!(
                        r#"<rect x="{:.2}" y="{upper:.2}" width="{:.2}" height="{:.2}" fill="{}"/>"#,
                        x + 1.0,
                        thick - 2.0,
                        lower - upper,
                        series.ink.hex()
                    ));
                }
                continue;
            }
            let place = |p: &[f64; 2]| {
                let exists = self.panel.x.scale.places(p[0]) && self.panel.y.scale.places(p[1]);
                exists.then(|| [at_x(p[0]), at_y(p[1])])
            };
            draw_series(canvas, series, &series.points.iter().map(place).collect::<Vec<_>>());
        }
        canvas.push("</g>");
        let label_y = bottom + self.footer(wide) - 3.0;
        canvas.text([left + 0.5 * wide, label_y], LABEL, Anchor::Middle, "", &self.panel.x.label);
        let (x, y) = (left - self.gutter() + 0.8 * LABEL, top + 0.5 * high);
        let turn = format!(r#"transform="rotate(-90 {x:.2} {y:.2})""#);
        canvas.text([x, y], LABEL, Anchor::Middle, &turn, &self.panel.y.label);
    }
}

/// Draws lines and marks at positions in pixels; a missing position breaks the line.
fn draw_series(canvas: &mut Canvas<'_>, series: &Series, places: &[Option<[f64; 2]>]) {
    let ink = series.ink.hex();
    let dash = match series.style {
        SeriesStyle::Line => "",
        SeriesStyle::Dashed => r#" stroke-dasharray="7 4""#,
        SeriesStyle::Dotted => r#" stroke-dasharray="1.5 3""#,
        _ => {
            places.iter().flatten().for_each(|at| mark(canvas, series.style, ink, *at));
            return;
        }
    };
    let mut path = String::new();
    let mut joined = false;
    for place in places {
        if let Some([x, y]) = place {
            // Avoids very large numbers far outside the panel.
            let y = y.clamp(-1e4, 1e4);
            let _ = write!(path, "{}{x:.2} {y:.2}", if joined { "L" } else { "M" });
        }
        joined = place.is_some();
    }
    canvas.push(&format!(
        r#"<path d="{path}" fill="none" stroke="{ink}" stroke-width="1.8" stroke-linejoin="round"{dash}/>"#
    ));
}

fn mark(canvas: &mut Canvas<'_>, style: SeriesStyle, ink: &str, [x, y]: [f64; 2]) {
    let shape = match style {
        SeriesStyle::Squares => format!(r#"<rect x="{:.2}" y="{:.2}" width="6.4" height="6.4""#, x - 3.2, y - 3.2),
        SeriesStyle::Triangles => {
            let (upper, lower, left, right) = (y - 4.2, y + 3.2, x - 4.0, x + 4.0);
            format!(r#"<path d="M{x:.2} {upper:.2}L{left:.2} {lower:.2}L{right:.2} {lower:.2}Z""#)
        }
        SeriesStyle::Crosses => {
            canvas.line([x - 3.6, y], [x + 3.6, y], ink, 1.6);
            canvas.line([x, y - 3.6], [x, y + 3.6], ink, 1.6);
            return;
        }
        _ => format!(r#"<circle cx="{x:.2}" cy="{y:.2}" r="3.3""#),
    };
    canvas.push(&format!(r#"{shape} fill="{ink}" stroke="white" stroke-width="0.6"/>"#));
}

/// Returns the entries of the legend, each name once.
fn entries(figure: &Figure) -> Vec<&Series> {
    let mut entries: Vec<&Series> = Vec::new();
    for series in figure.panels.iter().flat_map(|p| &p.series) {
        if series.listed && !series.name.is_empty() && entries.iter().all(|e| e.name != series.name) {
            entries.push(series);
        }
    }
    entries
}

/// Draws the legend from `top` on; returns its height.
fn draw_legend(canvas: &mut Canvas<'_>, figure: &Figure, top: f64) -> f64 {
    const SAMPLE: f64 = 28.0;
    let (mut x, mut y) = (MARGIN, top + 8.0);
    let entries = entries(figure);
    for series in &entries {
        let wide = SAMPLE + 6.0 + width(&series.name, TICK) + 20.0;
        if x + wide - 20.0 > WIDTH - MARGIN && x > MARGIN {
            (x, y) = (MARGIN, y + TICK * 1.6);
        }
        match series.style {
            SeriesStyle::Bars => canvas.push(&format!(
                r#"<rect x="{:.2}" y="{:.2}" width="14" height="9" fill="{}"/>"#,
                x + 7.0,
                y - 4.5,
                series.ink.hex()
            )),
            SeriesStyle::Line | SeriesStyle::Dashed | SeriesStyle::Dotted => {
                draw_series(canvas, series, &[Some([x, y]), Some([x + SAMPLE, y])]);
            }
            style => mark(canvas, style, series.ink.hex(), [x + 0.5 * SAMPLE, y]),
        }
        canvas.text([x + SAMPLE + 6.0, y + 0.36 * TICK], TICK, Anchor::Start, "", &series.name);
        x += wide;
    }
    if entries.is_empty() { 0.0 } else { y - top + 14.0 }
}

/// Returns the figure as an SVG document.
pub fn svg(figure: &Figure) -> String {
    drawn(figure).0
}

/// Same as [`svg`], with the positions of raster images.
pub(crate) fn drawn(figure: &Figure) -> (String, Vec<Placed<'_>>) {
    let mut canvas = Canvas { body: String::new(), pictures: Vec::new() };
    let mut y = MARGIN;
    for line in wrap(&figure.title, TITLE * width_bold("n", 1.0) / width("n", 1.0), WIDTH - 2.0 * MARGIN) {
        y += TITLE;
        canvas.text([MARGIN, y], TITLE, Anchor::Start, r#"font-weight="bold""#, &line);
        y += (LEADING - 1.0) * TITLE;
    }
    y += 6.0;
    let columns = figure.columns.max(1);
    let cell = (WIDTH - 2.0 * MARGIN - GAP * (columns as f64 - 1.0)) / columns as f64;
    let prepared: Vec<Prepared<'_>> = figure.panels.iter().map(|p| Prepared::new(p, [cell, figure.height])).collect();
    // Panels above each other share their left edge.
    let gutter =
        |column: usize| prepared.iter().skip(column).step_by(columns).map(Prepared::gutter).fold(0.0, f64::max);
    // The last tick's text may reach beyond the axis.
    let inner = |column: usize| cell - gutter(column) - 8.0;
    for (row, panels) in prepared.chunks(columns).enumerate() {
        let headings: Vec<Vec<String>> = panels.iter().map(|p| p.heading(cell)).collect();
        let lines = headings.iter().map(Vec::len).max().unwrap_or(0);
        let top = y + HEADING * LEADING * lines as f64 + 8.0;
        let footer = panels.iter().enumerate().map(|(c, p)| p.footer(inner(c))).fold(0.0, f64::max);
        for (column, panel) in panels.iter().enumerate() {
            let left = MARGIN + column as f64 * (cell + GAP);
            for (line, n) in headings[column].iter().zip(1..) {
                let at = [left, y + f64::from(n) * HEADING * LEADING - 4.0];
                canvas.text(at, HEADING, Anchor::Start, r#"font-weight="bold""#, line);
            }
            let clip = format!("{}-{}", figure.id, row * columns + column);
            panel.draw(&mut canvas, &clip, [left + gutter(column), top], [inner(column), figure.height]);
        }
        y = top + figure.height + footer + GAP - 8.0;
    }
    y += draw_legend(&mut canvas, figure, y) + 4.0;
    let style = format!(r#"fill="{CAPTION_INK}""#);
    for line in wrap(&figure.caption, CAPTION, WIDTH - 2.0 * MARGIN) {
        y += CAPTION * LEADING;
        canvas.text([MARGIN, y], CAPTION, Anchor::Start, &style, &line);
    }
    let height = (y + MARGIN).ceil();
    let svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{WIDTH}\" height=\"{height}\" viewBox=\"0 0 {WIDTH} {height}\" \
         font-family=\"{FAMILY}\" fill=\"{TEXT_INK}\">\n<title>{}</title>\n<rect width=\"{WIDTH}\" height=\"{height}\" fill=\"white\"/>\n{}</svg>\n",
        escape(&figure.title),
        canvas.body
    );
    (svg, canvas.pictures)
}
