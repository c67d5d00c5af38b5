//! The chart of run time against error: `docs/speed.svg`, drawn from the records.

use std::fmt::Write as _;

use crate::template::{Records, lookup};

/// The chart's path, from the repository's root.
pub const PATH: &str = "docs/speed.svg";

/// A program's configuration on the chart.
struct Mark {
    label: [&'static str; 2],
    record: &'static str,
    /// Figures: time for a frame, ms; RMSE, grey levels.
    figures: [&'static str; 2],
    colour: &'static str,
    /// Place of its label: right of the mark, or above it.
    is_above: bool,
}

const OURS: &str = "#0072b2";
const BASELINES: &str = "#56a0d3";
const OTHERS: &str = "#d55e00";

const MARKS: [Mark; 5] = [
    Mark {
        label: ["sonoweave", "Gaussian kernel, σ 0.3 mm"],
        record: "igsio",
        figures: ["scan-speed/sonoweave, σ 0.3 mm/1/median", "scan-accuracy/sonoweave, σ 0.3 mm/1/f32/RMSE"],
        colour: OURS,
        is_above: false,
    },
    Mark {
        label: ["our baseline", "nearest voxel, f32"],
        record: "igsio",
        figures: [
            "scan-speed/nearest voxel, mean in f32/1/median",
            "scan-accuracy/nearest voxel, mean in f32/1/f32/RMSE",
        ],
        colour: BASELINES,
        is_above: false,
    },
    Mark {
        label: ["our baseline", "trilinear, f32"],
        record: "igsio",
        figures: ["scan-speed/trilinear, mean in f32/1/median", "scan-accuracy/trilinear, mean in f32/1/f32/RMSE"],
        colour: BASELINES,
        is_above: false,
    },
    Mark {
        label: ["IGSIO", "nearest voxel"],
        record: "igsio",
        figures: ["scan-speed/IGSIO, nearest/1/median", "scan-accuracy/IGSIO, nearest/1/u8/RMSE"],
        colour: OTHERS,
        is_above: false,
    },
    Mark {
        label: ["IGSIO", "linear"],
        record: "igsio",
        figures: ["scan-speed/IGSIO, linear/1/median", "scan-accuracy/IGSIO, linear/1/u8/RMSE"],
        colour: OTHERS,
        is_above: true,
    },
];

/// Whole picture, and the plot's area within it: left, top, right, bottom.
const SIZE: [f64; 2] = [760.0, 400.0];
const PLOT: [f64; 4] = [76.0, 54.0, 736.0, 338.0];
/// Ranges of the axes, ms and grey levels, and their numbers. Both axes are logarithmic.
const RANGES: [[f64; 2]; 2] = [[0.2, 60.0], [0.3, 10.0]];
const NUMBERS: [&[&str]; 2] = [&["0.2", "0.5", "1", "2", "5", "10", "20", "50"], &["0.3", "0.5", "1", "2", "5", "10"]];

/// Returns the place of a value along an axis, in the picture.
fn along(axis: usize, value: f64) -> f64 {
    let [low, high] = RANGES[axis];
    let share = (value / low).ln() / (high / low).ln();
    match axis {
        0 => PLOT[0] + share * (PLOT[2] - PLOT[0]),
        _ => PLOT[3] - share * (PLOT[3] - PLOT[1]),
    }
}

/// Returns the chart as SVG.
///
/// # Errors
/// If a record has no such figure, or a figure is outside of the axes.
pub fn drawn(records: &Records) -> Result<String, String> {
    let [width, height] = SIZE;
    let [left, top, right, bottom] = PLOT;
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" width=\"{width}\" height=\"{height}\" \
        font-family=\"DejaVu Sans, Verdana, sans-serif\" font-size=\"14\" role=\"img\">\n\
        <title>Time and error of inserting a frame: sonoweave, its baselines and IGSIO</title>\n\
        <rect width=\"{width}\" height=\"{height}\" fill=\"#ffffff\"/>\n"
    );
    let mut line = |text: String| {
        svg += &text;
        svg.push('\n');
    };
    line(format!(
        "<text x=\"{left}\" y=\"30\" font-size=\"17\" font-weight=\"bold\" fill=\"#222222\">Time and error of a frame \
        <tspan font-weight=\"normal\" font-size=\"14\" fill=\"#555555\">one thread; lower left is better</tspan></text>"
    ));
    for (axis, numbers) in NUMBERS.into_iter().enumerate() {
        for number in numbers {
            let at = along(axis, number.parse().map_err(|e| format!("{number}: {e}"))?);
            let (ends, text) = match axis {
                0 => {
                    ([at, top, at, bottom], format!("x=\"{at:.1}\" y=\"{:.1}\" text-anchor=\"middle\"", bottom + 20.0))
                }
                _ => {
                    let (x, y) = (left - 8.0, at + 5.0);
                    ([left, at, right, at], format!("x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"end\""))
                }
            };
            let [x1, y1, x2, y2] = ends;
            line(format!("<path d=\"M{x1:.1} {y1:.1}L{x2:.1} {y2:.1}\" stroke=\"#e4e4e4\"/>"));
            line(format!("<text {text} fill=\"#333333\">{number}</text>"));
        }
    }
    line(format!("<path d=\"M{left} {top}V{bottom}H{right}\" fill=\"none\" stroke=\"#777777\"/>"));
    let [middle, foot] = [(left + right) / 2.0, height - 18.0];
    line(format!("<text x=\"{middle}\" y=\"{foot}\" text-anchor=\"middle\" fill=\"#222222\">ms a frame</text>"));
    let middle = (top + bottom) / 2.0;
    line(format!(
        "<text transform=\"translate(22 {middle}) rotate(-90)\" text-anchor=\"middle\" fill=\"#222222\">RMSE, grey \
        levels</text>"
    ));
    for mark in &MARKS {
        let figures = records.get(mark.record).map(|record| &record.figures);
        let mut at = [0.0; 2];
        for (axis, name) in mark.figures.into_iter().enumerate() {
            let (_, value) =
                figures.and_then(|f| lookup(f, name)).ok_or_else(|| format!("there is no figure {name:?}"))?;
            let [low, high] = RANGES[axis];
            if !(low..=high).contains(&value) {
                return Err(format!("{name:?} is {value}, outside of the chart's axis from {low} to {high}"));
            }
            at[axis] = along(axis, value);
        }
        let ([x, y], colour) = (at, mark.colour);
        line(format!("<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"7\" fill=\"{colour}\"/>"));
        let (x, y, anchor) = if mark.is_above { (x, y - 30.0, "middle") } else { (x + 14.0, y - 2.0, "start") };
        let mut text = String::new();
        // Writing to a string does not fail.
        let _ = write!(
            text,
            "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\" font-weight=\"bold\" fill=\"{colour}\">{}</text>\n\
            <text x=\"{x:.1}\" y=\"{:.1}\" text-anchor=\"{anchor}\" font-size=\"12\" fill=\"#555555\">{}</text>",
            mark.label[0],
            y + 16.0,
            mark.label[1]
        );
        line(text);
    }
    svg += "</svg>\n";
    Ok(svg)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::{Figure, Machine, Record};

    fn records(change: impl Fn(&str) -> f64) -> Records {
        let figures = |record: &str| {
            let marks = MARKS.iter().filter(|mark| mark.record == record);
            marks.flat_map(|mark| mark.figures).map(|name| (name.to_owned(), Figure::Value(change(name)))).collect()
        };
        let of = |name: &str| Record {
            peers: [].into(),
            commit: "0123abc".into(),
            date: String::new(),
            command: String::new(),
            machine: Machine { cpu: String::new(), cores: 2, os: String::new() },
            sources: [].into(),
            figures: figures(name),
        };
        ["igsio"].map(|name| (name.to_owned(), of(name))).into()
    }

    #[test]
    fn marks_lie_at_their_figures() {
        // The axes' middles, as geometric means.
        let svg =
            drawn(&records(|name| if name.ends_with("RMSE") { 3.0_f64.sqrt() } else { 12.0_f64.sqrt() })).unwrap();
        assert_eq!(svg.matches("<circle cx=\"406.0\" cy=\"196.0\"").count(), MARKS.len(), "{svg}");
    }

    #[test]
    fn missing_figure_and_one_outside_are_refused() {
        let mut less = records(|_| 1.0);
        less.get_mut("igsio").unwrap().figures.remove("scan-speed/IGSIO, nearest/1/median");
        assert!(drawn(&less).is_err_and(|fault| fault.contains("no figure \"scan-speed/IGSIO, nearest/1/median\"")));
        assert!(drawn(&records(|_| 61.0)).is_err_and(|fault| fault.contains("outside of the chart's axis")));
    }
}
