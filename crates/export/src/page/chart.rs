//! A series of numbers, as bars from a zero line.

use std::fmt::Write as _;

use super::escaped;

/// Width and height of the bars' area, and the space to its left and below it for labels.
const FIELD: [f64; 2] = [720.0, 170.0];
const BESIDE: [f64; 2] = [56.0, 34.0];

/// A bar chart.
#[derive(Debug, Clone, Copy)]
pub struct Bars<'a> {
    /// One bar each; none for values that are not finite.
    pub values: &'a [f64],
    /// Their unit.
    pub unit: &'a str,
    /// Label of the horizontal axis.
    pub along: &'a str,
    /// A horizontal line, and its label.
    pub limit: Option<(f64, &'a str)>,
}

impl Bars<'_> {
    /// Returns the drawing; `about` is a short description for readers who cannot see it.
    pub fn svg(&self, about: &str) -> String {
        let Self { values, unit, along, limit } = *self;
        let known = values.iter().copied().filter(|value| value.is_finite());
        let top = nice(known.chain(limit.map(|(at, _)| at)).fold(0.0, f64::max));
        let ([width, height], [left, below]) = (FIELD, BESIDE);
        let y = |value: f64| height - value / top * (height - 12.0);
        let step = width / values.len().max(1) as f64;
        let mut body = String::new();
        for tick in 0..=4 {
            let value = top * f64::from(tick) / 4.0;
            // Writing to a string does not fail.
            let _ = writeln!(
                body,
                "<path d=\"M{left} {:.1}h{width}\" stroke=\"currentColor\" stroke-opacity=\".18\"/><text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
                y(value),
                left - 6.0,
                y(value) + 4.0,
                number(value)
            );
        }
        for (index, value) in values.iter().enumerate().filter(|(_, value)| value.is_finite()) {
            let _ = writeln!(
                body,
                "<rect x=\"{:.2}\" y=\"{:.2}\" width=\"{:.2}\" height=\"{:.2}\" fill=\"#306cb0\"/>",
                left + index as f64 * step,
                y(*value),
                (0.85 * step).max(0.4),
                height - y(*value)
            );
        }
        if let Some((at, name)) = limit {
            let _ = writeln!(
                body,
                "<path d=\"M{left} {0:.1}h{width}\" stroke=\"#e5484d\" stroke-dasharray=\"5 4\"/><text x=\"{1:.1}\" y=\"{2:.1}\" text-anchor=\"end\" fill=\"#e5484d\">{3}</text>",
                y(at),
                left + width,
                y(at) - 4.0,
                escaped(name)
            );
        }
        format!(
            "<svg viewBox=\"0 0 {} {}\" role=\"img\" aria-label=\"{}\" font-family=\"system-ui,sans-serif\" font-size=\"12\" fill=\"currentColor\">\n{body}\
             <text x=\"{left}\" y=\"{:.1}\">{} →</text><text x=\"4\" y=\"{:.1}\">{}</text></svg>",
            left + width + 8.0,
            height + below,
            escaped(about),
            height + 22.0,
            escaped(along),
            height + 22.0,
            escaped(unit)
        )
    }
}

/// Returns the next number at or above with one digit of 1, 2, 4 or 8, so that its quarters are
/// short.
fn nice(most: f64) -> f64 {
    if !(most > 0.0 && most.is_finite()) {
        return 1.0;
    }
    let decade = 10_f64.powf(most.log10().floor());
    [1.0, 2.0, 4.0, 8.0, 10.0]
        .map(|digit| digit * decade)
        .into_iter()
        .find(|top| *top >= most * 0.999_999)
        .unwrap_or(10.0 * decade)
}

fn number(value: f64) -> String {
    let text = format!("{value:.3}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bar_height_is_proportional_to_value() {
        let values = [0.5, f64::NAN, 1.0, 0.0];
        let svg = Bars { values: &values, unit: "mm", along: "frames", limit: Some((1.6, "limit")) }.svg("errors");
        let document = roxmltree::Document::parse(&svg).unwrap();
        let heights: Vec<f64> = document
            .descendants()
            .filter(|node| node.has_tag_name("rect"))
            .map(|bar| bar.attribute("height").unwrap().parse().unwrap())
            .collect();
        assert_eq!(heights.len(), 3);
        assert!((heights[1] - 2.0 * heights[0]).abs() < 0.02 && heights[2] == 0.0, "{heights:?}");
        assert!(svg.contains(">limit<") && svg.contains("mm"));
    }

    #[test]
    fn axis_ends_at_short_number() {
        for (most, top) in [(0.0, 1.0), (0.93, 1.0), (1.0, 1.0), (1.01, 2.0), (3.0, 4.0), (27.0, 40.0), (90.0, 100.0)] {
            assert!((nice(most) - top).abs() < 1e-9, "{most}: {}", nice(most));
        }
        assert_eq!([number(0.25), number(3.0), number(0.0)], ["0.25", "3", "0"]);
    }
}
