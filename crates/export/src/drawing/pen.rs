//! Lines and letters of a drawing in mm.

use std::fmt::Write as _;

use glam::DVec2;

/// The drawing so far.
#[derive(Debug, Clone, Default)]
pub(super) struct Pen(String);

impl Pen {
    /// Returns the document, of a size.
    pub(super) fn svg(&self, size: DVec2) -> String {
        let DVec2 { x, y } = size;
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{x}mm\" height=\"{y}mm\" viewBox=\"0 0 {x} {y}\" font-family=\"Helvetica,Arial,sans-serif\" fill=\"#000\">\n\
             <rect width=\"{x}\" height=\"{y}\" fill=\"#fff\"/>\n{}</svg>\n",
            self.0
        )
    }

    /// Draws a dimension line between two places, and its length.
    pub(super) fn dimension_of(&mut self, from: DVec2, to: DVec2, length: f64) {
        self.line(from, to, 0.15, "");
        let aside = (to - from).normalize().perp();
        for end in [from, to] {
            self.line(end - aside * 1.2, end + aside * 1.2, 0.15, "");
        }
        let middle = 0.5 * (from + to);
        let turn = if (to - from).x.abs() > (to - from).y.abs() { 0.0 } else { -90.0 };
        let (x, y) = (mm(middle.x), mm(middle.y));
        self.put(format_args!(
            "<text transform=\"translate({x} {y}) rotate({turn})\" y=\"-.7\" font-size=\"2.8\" text-anchor=\"middle\">{}</text>\n",
            number(length)
        ));
    }

    /// Draws a hole with its cross hairs.
    pub(super) fn ring(&mut self, at: DVec2, diameter: f64, wide: f64, reach: f64) {
        let DVec2 { x, y } = at;
        self.put(format_args!(
            "<circle cx=\"{}\" cy=\"{}\" r=\"{}\" fill=\"none\" stroke=\"#000\" stroke-width=\"{wide}\"/>\
             <path d=\"M{} {}h{}M{} {}v{}\" stroke=\"#000\" stroke-width=\".1\"/>\n",
            mm(x),
            mm(y),
            mm(0.5 * diameter),
            mm(x - reach),
            mm(y),
            mm(2.0 * reach),
            mm(x),
            mm(y - reach),
            mm(2.0 * reach)
        ));
    }

    pub(super) fn line(&mut self, from: DVec2, to: DVec2, wide: f64, more: &str) {
        self.put(format_args!(
            "<path d=\"M{} {}L{} {}\" stroke=\"#000\" stroke-width=\"{wide}\" {more}/>\n",
            mm(from.x),
            mm(from.y),
            mm(to.x),
            mm(to.y)
        ));
    }

    /// Writes a text: `rest` is the rest of its tag and the text itself.
    pub(super) fn text(&mut self, at: DVec2, size: f64, anchor: &str, rest: &str) {
        let space = if rest.starts_with('>') { "" } else { " " };
        self.put(format_args!(
            "<text x=\"{}\" y=\"{}\" font-size=\"{size}\" text-anchor=\"{anchor}\"{space}{rest}</text>\n",
            mm(at.x),
            mm(at.y)
        ));
    }

    pub(super) fn put(&mut self, text: std::fmt::Arguments<'_>) {
        // Writing to a string does not fail.
        let _ = self.0.write_fmt(text);
    }
}

/// Formats a length for SVG: to a thousandth of a mm.
pub(super) fn mm(length: f64) -> String {
    number((length * 1000.0).round() / 1000.0)
}

/// Formats a length for people: to a thousandth of a mm, without trailing zeros.
pub(super) fn number(length: f64) -> String {
    let rounded = (length * 1000.0).round() / 1000.0;
    // Avoids -0.
    (rounded + 0.0).to_string()
}
