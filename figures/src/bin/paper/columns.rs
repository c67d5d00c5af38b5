//! One weight per column against one per voxel: equal under full coverage, wrong under a fan;
//! and 1D + 2D stages against three dimensions.

use std::error::Error;
use std::path::Path;

use sonoweave_figures::{Axis, Figure, Ink, Panel, Series, SeriesStyle, order};

use reconstruct::planar::Departure;
use reconstruct::{Path as Paths, SettingsError};

use crate::columns_reconstructed::{self, general, refusal, upgrading};
use crate::report::Report;
use crate::speed::Agreement;
use crate::weights::{Coverage, SIZE, apart, means};

const VOXEL: &str = "1D + 2D stages, a weight a voxel";
const COLUMN: &str = "1D + 2D stages, a weight a column";
const PLANAR: &str = "ours: the planar path";
const GENERAL: &str = "ours: the general path, which takes over from it";

/// Draws the comparison. `doll` and `ages` are the differences of both paths on the doll's scan
/// and under decay.
pub(crate) fn draw(report: &mut Report, folder: &Path, doll: &Agreement, ages: f64) -> Result<(), Box<dyn Error>> {
    let [full, parts, fan] = [Coverage::Full, Coverage::Parts, Coverage::Fan].map(means);
    let reconstructed = [full?, parts?, fan?];
    let columns = reconstructed.each_ref().map(|w| apart(&w.column, &w.direct));
    let stages = reconstructed.each_ref().map(|w| apart(&w.staged, &w.direct));
    let worst = stages.into_iter().fold(0.0, f64::max);
    report.check(worst < 1e-12, format!("C10: 1D and 2D stages are {worst} from three dimensions"));
    report.check(columns[0] < 1e-12, format!("C9: one weight a column is {} off under full coverage", columns[0]));
    report.check(
        columns[1] > 0.01 && columns[2] > 0.01,
        format!("C9: partial coverage makes no difference: {columns:?}"),
    );
    // The reconstructor on the same slices.
    let by_planar = upgrading(Coverage::Full)?;
    let by_general = general(Coverage::Full)?;
    let under_fan = upgrading(Coverage::Fan)?;
    let fan_values = columns_reconstructed::values(&under_fan);
    let planar_off = apart(&columns_reconstructed::values(&by_planar), &reconstructed[0].direct);
    let general_off = apart(&columns_reconstructed::values(&by_general), &reconstructed[0].direct);
    let fan_off = apart(&fan_values, &reconstructed[2].direct);
    report.check(
        by_planar.path() == Paths::Planar && by_planar.upgraded().is_none(),
        "C9: the planar path gave full coverage away",
    );
    report.check(planar_off < 1e-5, format!("C10: the planar path is {planar_off} from three dimensions"));
    report.check(
        general_off < 1e-3 && fan_off < 1e-3,
        format!("C9: the general path is {general_off} and {fan_off} off"),
    );
    let handed_over = under_fan.path() == Paths::General
        && matches!(under_fan.upgraded(), Some(Departure::Mask { .. }))
        && matches!(refusal(Coverage::Fan), Some(SettingsError::Planar(Departure::Mask { .. })));
    report.check(handed_over, "C9: the planar path does not give a fan away");
    let seen = fan_values.iter().flatten().count();
    report.check(seen > 2000, format!("C9: only {seen} voxels under the fan"));
    report.check(
        doll.max <= doll.stated,
        format!("C9: the paths are {} grey levels apart, and the general one states {}", doll.max, doll.stated),
    );
    report.check(
        doll.same > 1_000_000 && 50 * doll.differ < doll.same,
        format!("C9: {} of {} voxels got other slices", doll.differ, doll.same),
    );
    report.claim(
        ["C9", "with 3 degrees of freedom weight and age are two-dimensional; with 6 each voxel has its own", "2D buffers"],
        format!(
            "largest relative difference of 2D from 3D weights: {} under full coverage; {:.0} % where slices see parts of u in turn, {:.0} % under a fan. \
             The reconstructor's planar path, full coverage: {} from three dimensions; a fan it refuses or leaves to the general path, which is {} from them. \
             Doll scan of C18: both paths' values are {:.4} grey levels rms and {:.2} at most apart over {:.1} million voxels (the general path states ±{:.2}). \
             An age a column: {ages:.2} grey levels at most from an age a voxel, over all rules of decay",
            order(columns[0]),
            100.0 * columns[1],
            100.0 * columns[2],
            order(planar_off),
            order(fan_off),
            doll.rms,
            doll.max,
            doll.same as f64 / 1e6,
            doll.stated
        ),
        columns.iter().all(|c| *c < 1e-6),
        ["holds", "holds under full coverage; a fan or partial coverage needs a weight a voxel"],
    );
    report.claim(
        ["C10", "3D convolution is a 1D and a 2D stage", "“separate stages”"],
        format!(
            "largest relative difference {} in f64, with masks too; {} by the planar path in single precision",
            order(worst),
            order(planar_off)
        ),
        worst <= 1e-6 && planar_off <= 1e-6,
        ["holds", "does not hold"],
    );
    // The column with the largest difference is shown.
    let [nx, ny, nz] = SIZE;
    let fan = &reconstructed[2];
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
        caption: "A small volume, slices upright as the arm holds them, image axis u along z. Left: largest relative difference from the equations in three \
                  dimensions, in f64. The two-stage sum is exact to rounding in every case, the column's weight only under full coverage. Of the reconstructor, \
                  in single precision: its planar path is exact to rounding where it works; a fan's mask is none for it, and the general path takes over. (One \
                  mask goes for all slices: parts in turn do not occur.) Right: a column under the fan. Where part of the kernel lies beyond the fan's edge a \
                  weight that does not know it darkens the value; the general path stops where less than a fifth of the kernel lies on data."
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
                    Series::bars(PLANAR, Ink::Green, &[planar_off]),
                    Series::bars(GENERAL, Ink::Purple, &[general_off, f64::NAN, fan_off]),
                ],
            ),
            Panel::new(
                "A column of voxels under the fan",
                Axis::linear("position along u, voxels").from_to(0.0, nz as f64 - 1.0),
                Axis::linear("value, grey levels").from_to(0.0, 140.0),
                vec![
                    Series::new("three dimensions, pixel by pixel", SeriesStyle::Line, Ink::Black, profile(&fan.direct)),
                    Series::new(VOXEL, SeriesStyle::Dashed, Ink::Blue, profile(&fan.staged)),
                    Series::new(COLUMN, SeriesStyle::Squares, Ink::Vermilion, profile(&fan.column)),
                    Series::new(GENERAL, SeriesStyle::Crosses, Ink::Purple, profile(&fan_values)),
                ],
            ),
        ],
    };
    report.figure(figure, folder)
}
