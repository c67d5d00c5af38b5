//! C16: adaptive rays, and their error.

use std::error::Error;
use std::path::Path;

use sonoweave_figures::{Axis, Figure, Ink, Panel, Series, SeriesStyle};

use render::RenderSettings;

use crate::doll::Doll;
use crate::report::Report;

/// Permitted differences ε of neighbouring rays, in grey levels of 255.
const LEVELS: [f32; 6] = [0.25, 0.5, 1.0, 2.0, 4.0, 8.0];

/// Result for one ε.
struct Sparse {
    /// Share of all rays that were cast.
    rays: f64,
    /// Root mean square and largest difference from the picture with all rays, grey levels.
    rms: f64,
    most: f64,
}

/// Side lengths of the pictures, pixels: the paper's first.
const SIDES: [u32; 2] = [256, 512];

/// Permitted rms differences by side and ε, grey levels: twice the larger of those that 20 and 90
/// slices have. Pictures have the same bits on every machine, so that only a change of the method
/// exceeds them. They are below ε/50, because most pixels are those of rays that are cast.
const MOST_RMS: [[f64; LEVELS.len()]; SIDES.len()] =
    [[0.0021, 0.0037, 0.0038, 0.011, 0.029, 0.11], [0.002, 0.004, 0.012, 0.029, 0.057, 0.14]];

/// Draws error and rays over ε.
pub(crate) fn draw(report: &mut Report, folder: &Path, doll: &Doll) -> Result<(), Box<dyn Error>> {
    let found = [0, 1].map(|i| sparse(report, doll, SIDES[i], &MOST_RMS[i]));
    let mut panels = [Vec::new(), Vec::new()];
    let mut summaries = Vec::new();
    for ((side, found), (view_settings, ink)) in
        SIDES.into_iter().zip(found).zip([(SeriesStyle::Discs, Ink::Blue), (SeriesStyle::Squares, Ink::Vermilion)])
    {
        let found = found?;
        let line = |of: fn(&Sparse) -> f64| -> Vec<[f64; 2]> {
            LEVELS.iter().zip(&found).map(|(level, sparse)| [f64::from(*level), of(sparse)]).collect()
        };
        panels[0].push(Series::new(format!("{side}×{side} pixels"), view_settings, ink, line(|of| 100.0 * of.rays)));
        panels[1].push(Series::new(format!("{side}×{side} pixels"), view_settings, ink, line(|of| of.rms)));
        panels[1].push(Series::new(
            format!("{side}×{side} pixels, largest"),
            SeriesStyle::Dashed,
            ink,
            line(|of| of.most),
        ));
        let summary = |level: f32| {
            LEVELS
                .iter()
                .zip(&found)
                .filter(|(l, _)| **l == level)
                .map(|(level, of)| {
                    format!(
                        "ε = {level}/255 {:.0} % of the rays, {:.2} grey levels rms, {:.1} at most",
                        100.0 * of.rays,
                        of.rms,
                        of.most
                    )
                })
                .collect::<String>()
        };
        summaries.push(format!("{side}×{side} pixels: {}, {}", summary(2.0), summary(8.0)));
    }
    panels[1].push(Series::new("ε", SeriesStyle::Dotted, Ink::Grey, vec![[0.2, 0.2], [10.0, 10.0]]));
    let [rays, errors] = panels;
    let x = || Axis::log("ε, grey levels of 255").from_to(0.2, 10.0);
    let figure = Figure {
        id: "adaptive-rays",
        title: "Adaptive rays: what they save, and what they cost".into(),
        caption: "The whole picture at once against one ray a pixel, of those that meet anything. A region of 8 pixels is split where its corners or its middle differ by more than ε, or \
                  where something small lies between them: noise counts as small. Dotted: ε itself."
            .into(),
        columns: 2,
        height: 220.0,
        panels: vec![
            Panel::new("rays cast", x(), Axis::linear("% of all").from_to(0.0, 105.0), rays),
            Panel::new("difference from all rays", x(), Axis::log("grey levels, root mean square"), errors),
        ],
    };
    report.checked_claim(
        ["C16", "image-adaptive rays (Levoy 1990)", "the density of rays follows the change of the image; no count"],
        format!("{}; ε = 0 is every ray", summaries.join("; ")),
        "confirmed; every picture is the bits of one made at once",
    );
    report.figure(figure, folder)
}

/// Measures error and rays of each ε, for one picture size.
fn sparse(
    report: &mut Report,
    doll: &Doll,
    side: u32,
    most_rms: &[f64; LEVELS.len()],
) -> Result<Vec<Sparse>, Box<dyn Error>> {
    let view_settings = RenderSettings { size: [side; 2], ..doll.view_settings.clone() };
    let (exact, all) = doll.at_once(&view_settings)?;
    let mut found: Vec<Sparse> = Vec::new();
    for (level, most_rms) in LEVELS.into_iter().zip(most_rms) {
        let view_settings = RenderSettings { adaptive: level / 255.0, ..view_settings.clone() };
        let (picture, work) = doll.at_once(&view_settings)?;
        if view_settings.size == doll.view_settings.size {
            let followed = doll.follow(&view_settings)?;
            report
                .check(followed.picture == picture, format!("C16: following with ε = {level}/255 ends in other bits"));
        }
        let [most, rms] = picture.difference(&exact).map(|off| 255.0 * off);
        let what = format!("C16: {rms} grey levels rms with ε = {level}/255 at {side}×{side}, of at most {most_rms}");
        report.check(rms <= *most_rms, what);
        report
            .check(work.rays < all.rays, format!("C16: {} rays with ε = {level}/255, {} without", work.rays, all.rays));
        found.push(Sparse { rays: work.rays as f64 / all.rays as f64, rms, most });
    }
    report.check(found.windows(2).all(|pair| pair[1].rays <= pair[0].rays), "C16: a larger ε casts more rays");
    Ok(found)
}
