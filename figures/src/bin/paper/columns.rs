//! One weight a column against one a voxel: the same under full coverage, wrong under a fan; and 1D + 2D stages against three dimensions.

use std::error::Error;
use std::path::Path;

use sonoweave_figures::{Axis, Figure, Ink, Look, Panel, Series};

use crate::report::Report;
use crate::weights::{Coverage, SIZE, apart, weave};

const VOXEL: &str = "1D + 2D stages, a weight a voxel";
const COLUMN: &str = "1D + 2D stages, a weight a column";

pub(crate) fn draw(report: &mut Report, folder: &Path) -> Result<(), Box<dyn Error>> {
    let [full, parts, fan] = [Coverage::Full, Coverage::Parts, Coverage::Fan].map(weave);
    let woven = [full?, parts?, fan?];
    let columns = woven.each_ref().map(|w| apart(&w.column, &w.direct));
    let stages = woven.each_ref().map(|w| apart(&w.staged, &w.direct));
    let worst = stages.into_iter().fold(0.0, f64::max);
    report.check(worst < 1e-12, format!("C10: 1D and 2D stages are {worst} from three dimensions"));
    report.check(columns[0] < 1e-12, format!("C9: one weight a column is {} off under full coverage", columns[0]));
    report.check(
        columns[1] > 0.01 && columns[2] > 0.01,
        format!("C9: partial coverage makes no difference: {columns:?}"),
    );
    report.claim(
        ["C9", "with 3 degrees of freedom weight and age are two-dimensional; with 6 each voxel has its own", "2D buffers"],
        format!(
            "largest relative difference of 2D from 3D weights: {:.0e} under full coverage; {:.0} % where slices see parts of u in turn, {:.0} % under a fan",
            columns[0],
            100.0 * columns[1],
            100.0 * columns[2]
        ),
        columns.iter().all(|c| *c < 1e-6),
        ["holds", "holds under full coverage; a fan or partial coverage needs a weight a voxel"],
    );
    report.claim(
        ["C10", "3D convolution is a 1D and a 2D stage", "“separate stages”"],
        format!("largest relative difference {worst:.0e}, with masks too"),
        worst <= 1e-6,
        ["holds", "does not hold"],
    );
    // The column where the difference is largest tells most.
    let [nx, ny, nz] = SIZE;
    let fan = &woven[2];
    let off = |c: usize| apart(&fan.column[c * nz..(c + 1) * nz], &fan.direct[c * nz..(c + 1) * nz]);
    let column =
        (0..nx * ny).filter(|c| c / ny == nx / 2).max_by(|a, b| off(*a).total_cmp(&off(*b))).ok_or("no column")?;
    let profile = |values: &[Option<f64>]| -> Vec<[f64; 2]> {
        (0..nz).map(|z| [z as f64, values[column * nz + z].unwrap_or(f64::NAN)]).collect()
    };
    let bars = |values: [f64; 3]| values.map(|v| v.max(1e-17));
    let figure = Figure {
        id: "weights",
        title: "One weight a column, or one a voxel".into(),
        caption: "A small volume in f64, slices upright as the arm holds them, image axis u along z. Left: largest relative difference from the equations in three \
                  dimensions; the two-stage sum is exact to rounding in every case, the column's weight only under full coverage. Right: a column under the fan. \
                  Where part of the kernel lies beyond the fan's edge a weight that does not know it darkens the value."
            .into(),
        columns: 2,
        height: 260.0,
        panels: vec![
            Panel::new(
                "Largest relative difference from 3D",
                Axis::categories("what of each slice is data", ["everything", "parts of u in turn", "a fan"]),
                Axis::log("relative difference").from_to(1e-17, 10.0),
                vec![
                    Series::bars(VOXEL, Ink::Blue, &bars(stages)),
                    Series::bars(COLUMN, Ink::Vermilion, &bars(columns)),
                ],
            ),
            Panel::new(
                "A column of voxels under the fan",
                Axis::linear("position along u, voxels").from_to(0.0, nz as f64 - 1.0),
                Axis::linear("value, grey levels").from_to(0.0, 140.0),
                vec![
                    Series::new("three dimensions, pixel by pixel", Look::Line, Ink::Black, profile(&fan.direct)),
                    Series::new(VOXEL, Look::Discs, Ink::Blue, profile(&fan.staged)),
                    Series::new(COLUMN, Look::Squares, Ink::Vermilion, profile(&fan.column)),
                ],
            ),
        ],
    };
    report.figure(figure, folder)
}
