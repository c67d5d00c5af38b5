//! Error against time: one panel per scan, the sweeps, and all scans in one.

use std::error::Error;
use std::path::Path as Folder;

use sonoweave_figures::{Axis, Figure, Ink, Panel, Series, SeriesStyle};

use reconstruct::kernel::Method;

use crate::contestant::{Contestant, DEFAULT_VOXEL_MM, Path, USUAL, USUAL_ACROSS, short_list};
use crate::front::{Measure, front};
use crate::measure::Row;
use crate::report::Report;
use crate::rows::scans;

/// Draws all pictures.
///
/// # Errors
/// If a file cannot be written.
pub(crate) fn draw(rows: &[Row], report: &mut Report, folder: &Folder) -> Result<(), Box<dyn Error>> {
    let scans = scans(rows);
    report.findings.figure(summary(&scans), folder)?;
    let captions = [
        (
            Measure::Anyone,
            "error-against-truth",
            "Run time against error: what a reader of the volume gets",
            "RMSE against the scene itself, inside the sweep, read between voxels. Every kernel has the default's effective width, but those that follow the \
             pixels, and the fourth order, have it across the plane only, and what drops pixels into voxels has the voxels'. Where the scene is finer than the kernel, blur is most of the \
             error and all of one width are alike; where it is smooth, noise is, and whoever averages less is above.",
        ),
        (
            Measure::Blurred,
            "error-against-blurred-truth",
            "Run time against error: what is lost beside the blur that was asked for",
            "RMSE against the scene under the default's effective width: noise, sampling, the read between voxels, and what a kernel's shape does to the scene. \
             The baselines have another width and are shown for comparison only; the front is that of matched kernels.",
        ),
        (
            Measure::Slope,
            "error-of-gradient",
            "Run time against error: the gradient, which shading follows",
            "Root mean square of the difference between the volume's gradient (central differences over a voxel to either side) and that of the scene under \
             the default's effective width. Over voxels of half a σ and more, central differences hide most of the steps that a cut kernel makes. The front is that of \
             matched kernels.",
        ),
    ];
    for (measure, id, title, caption) in captions {
        let figure = Figure {
            id,
            title: title.into(),
            caption: format!(
                "{caption} One thread; axes are logarithmic, but for errors that differ by less than a factor of two. The line is the Pareto front."
            ),
            columns: 3,
            height: 190.0,
            panels: scans.iter().map(|scan| panel(scan, measure)).collect(),
        };
        report.findings.figure(figure, folder)?;
    }
    if let Some(figure) = sweeps(&scans) {
        report.findings.figure(figure, folder)?;
    }
    Ok(())
}

/// Returns name and style of a contestant.
fn family(contestant: &Contestant) -> (&'static str, SeriesStyle, Ink) {
    match contestant.path {
        _ if contestant.is_default() => ("default configuration", SeriesStyle::Triangles, Ink::Black),
        Path::Kernel(Method::Gaussian, _) => ("gaussian less pedestal", SeriesStyle::Discs, Ink::Blue),
        Path::Kernel(Method::GaussianTruncated, _) => ("gaussian, cut", SeriesStyle::Discs, Ink::Sky),
        Path::Kernel(Method::Gaussian4, _) => ("gaussian of fourth order", SeriesStyle::Discs, Ink::Vermilion),
        Path::Kernel(Method::BSpline3, _) => ("B-spline", SeriesStyle::Squares, Ink::Green),
        Path::Kernel(Method::Linear, _) => ("linear in plane", SeriesStyle::Squares, Ink::Purple),
        Path::Kernel(Method::Nearest, _) => ("nearest pixel", SeriesStyle::Triangles, Ink::Orange),
        Path::FirstMoment(_) => ("first moment corrected", SeriesStyle::Discs, Ink::Green),
        Path::Corrected(_) => ("poses corrected", SeriesStyle::Squares, Ink::Vermilion),
        Path::AutoSigma => ("default, auto σ", SeriesStyle::Squares, Ink::Black),
        Path::Splat(_) => ("pixels dropped into voxels, holes filled", SeriesStyle::Crosses, Ink::Vermilion),
        Path::BruteForce => ("brute force, f64", SeriesStyle::Crosses, Ink::Grey),
    }
}

const ORDER: [&str; 11] = [
    "brute force, f64",
    "pixels dropped into voxels, holes filled",
    "nearest pixel",
    "linear in plane",
    "B-spline",
    "gaussian, cut",
    "gaussian of fourth order",
    "gaussian less pedestal",
    "first moment corrected",
    "default, auto σ",
    "default configuration",
];

/// Groups points into series by family; the default is last and so on top.
pub(crate) fn by_family(points: impl Iterator<Item = (Contestant, [f64; 2])>) -> Vec<Series> {
    let mut families: Vec<Series> = Vec::new();
    for (contestant, point) in points {
        let (name, view_settings, ink) = family(&contestant);
        match families.iter_mut().find(|s| s.name == name) {
            Some(series) => series.points.push(point),
            None => families.push(Series::new(name, view_settings, ink, vec![point])),
        }
    }
    families.sort_by_key(|series| ORDER.iter().position(|name| *name == series.name));
    families
}

/// Returns the front as steps: the time needed for an error below a limit.
pub(crate) fn steps(points: &[[f64; 2]], [low, high]: [f64; 2], top: f64) -> Vec<[f64; 2]> {
    let front = front(points);
    let mut line = Vec::new();
    let mut error = top;
    for place in front {
        let [time, next] = points[place];
        line.extend([[time.max(low), error], [time.max(low), next]]);
        error = next;
    }
    line.push([2.0 * high, error]);
    line
}

/// Returns a range with a margin, for a logarithmic axis.
pub(crate) fn range(values: impl Iterator<Item = f64>) -> [f64; 2] {
    let (low, high) = values
        .filter(|v| v.is_finite() && *v > 0.0)
        .fold((f64::INFINITY, 0.0_f64), |(low, high), v| (low.min(v), high.max(v)));
    if high == 0.0 {
        return [0.1, 10.0];
    }
    // A twelfth of the range, but at least room for a mark if all values are equal.
    let room = (high / low).powf(1.0 / 12.0).max(1.03);
    [low / room, high * room]
}

/// Returns an axis over a range. Below a factor of two, a logarithm is almost linear and has few
/// round numbers, so the axis is linear. Below a factor of three, the range is widened.
pub(crate) fn axis(label: &str, [low, high]: [f64; 2]) -> Axis {
    let spanned = high / low;
    if spanned < 2.0 {
        return Axis::linear(label).from_to(low, high);
    }
    let room = (3.0 / spanned).max(1.0).sqrt();
    Axis::log(label).from_to(low / room, high * room)
}

fn panel(scan: &[&Row], measure: Measure) -> Panel {
    let shown: Vec<(&Row, [f64; 2])> = scan
        .iter()
        .filter(|row| row.contestant.threads == 1 && row.comparable)
        .map(|row| (*row, [row.ms[1], measure.of(row)]))
        .collect();
    let compared: Vec<[f64; 2]> =
        shown.iter().filter(|(row, _)| measure.compares(row)).map(|(_, point)| *point).collect();
    let x = range(shown.iter().map(|(_, p)| p[0]));
    let y = range(shown.iter().map(|(_, p)| p[1]));
    let mut series = vec![Series::new("Pareto front", SeriesStyle::Line, Ink::Grey, steps(&compared, x, 2.0 * y[1]))];
    series.extend(by_family(shown.into_iter().map(|(row, point)| (row.contestant, point))));
    let unit = if measure == Measure::Slope { "RMSE, levels/mm" } else { "RMSE, grey levels" };
    Panel::new(scan.first().map_or("", |row| row.title), axis("ms a slice", x), axis(unit, y), series)
}

/// Draws cost and benefit of supports and voxel sizes, for the scans with full sweeps.
fn sweeps(scans: &[Vec<&Row>]) -> Option<Figure> {
    let mut panels = Vec::new();
    for scan in scans.iter().filter(|scan| scan.len() > 2 * short_list(false).len()) {
        for measure in [Measure::Blurred, Measure::Slope] {
            let place = |row: &&Row| [row.ms[1], measure.of(row)];
            let beside = |row: &&&Row| row.contestant.threads == 1 && row.contestant.goes_with(&scan[0].contestant);
            let energies = |method: Method| -> Vec<[f64; 2]> {
                let mut rows: Vec<(f64, [f64; 2])> = scan
                    .iter()
                    .filter(|row| row.contestant.voxel_mm == DEFAULT_VOXEL_MM)
                    .filter(beside)
                    .filter_map(|row| match row.contestant.path {
                        Path::Kernel(m, [None, across]) if m == method => {
                            Some((across.unwrap_or(USUAL_ACROSS), place(row)))
                        }
                        _ => None,
                    })
                    .collect();
                rows.sort_by(|a, b| a.0.total_cmp(&b.0));
                rows.into_iter().map(|(_, p)| p).collect()
            };
            let voxels = |method: Method| -> Vec<[f64; 2]> {
                let mut rows: Vec<(f64, [f64; 2])> = scan
                    .iter()
                    .filter(|row| row.contestant.path == Path::Kernel(method, USUAL))
                    .filter(beside)
                    .map(|row| (row.contestant.voxel_mm, place(row)))
                    .collect();
                rows.sort_by(|a, b| a.0.total_cmp(&b.0));
                rows.into_iter().map(|(_, p)| p).collect()
            };
            let default: Vec<[f64; 2]> = scan.iter().take(1).map(place).collect();
            let [less, cut] = [energies(Method::Gaussian), energies(Method::GaussianTruncated)];
            let [ours, spline] = [voxels(Method::default()), voxels(Method::BSpline3)];
            let every = || [&less, &cut, &ours, &spline].into_iter().flatten().copied();
            let [x, y] = [0, 1].map(|c| range(every().map(|p| p[c])));
            let unit = if measure == Measure::Slope { "gradient, levels/mm" } else { "RMSE, grey levels" };
            panels.push(Panel::new(
                scan[0].title,
                axis("ms a slice", x),
                axis(unit, y),
                vec![
                    Series::new("voxels of .5 to 1.5 σ, default kernel", SeriesStyle::Line, Ink::Blue, ours.clone()),
                    Series::new("", SeriesStyle::Discs, Ink::Blue, ours),
                    Series::new("voxels of .5 to 1.5 σ, B-spline", SeriesStyle::Line, Ink::Green, spline.clone()),
                    Series::new("", SeriesStyle::Squares, Ink::Green, spline),
                    Series::new("E_e .1 to 1e-4, cut", SeriesStyle::Dashed, Ink::Vermilion, cut.clone()),
                    Series::new("", SeriesStyle::Squares, Ink::Vermilion, cut),
                    Series::new("E_e .1 to 1e-4, less pedestal", SeriesStyle::Dashed, Ink::Purple, less.clone()),
                    Series::new("", SeriesStyle::Discs, Ink::Purple, less),
                    Series::new("default configuration", SeriesStyle::Triangles, Ink::Black, default),
                ],
            ));
        }
    }
    (!panels.is_empty()).then(|| Figure {
        id: "sweeps",
        title: "What voxels and supports cost and save".into(),
        caption: "Left against the scene under the default’s effective width, right its gradient. σ is the default’s in the plane, 0.375 mm; default voxels are of \
                  1.33 σ. Supports are those across the plane. The cut kernel is nearer to the Gaussian that it is for the same reach as the one less its pedestal, \
                  down to a share of about .01; cut earlier, its step tells. Finer voxels help where the scene has edges, and let noise into the gradient where it \
                  has none."
            .into(),
        columns: 2,
        height: 200.0,
        panels,
    })
}

/// Returns the contestants of all scans on one thread, with the medians over the scans of time and
/// error relative to the default's.
pub(crate) fn medians(scans: &[Vec<&Row>], measure: Measure) -> Vec<(Contestant, [f64; 2])> {
    let middle = |mut values: Vec<f64>| {
        values.sort_by(f64::total_cmp);
        values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
    };
    let mut contestants = short_list(false);
    contestants.push(Contestant::new(Path::BruteForce, DEFAULT_VOXEL_MM));
    contestants.retain(|c| c.threads == 1);
    let mut shown: Vec<(Contestant, [f64; 2])> = Vec::new();
    for contestant in &contestants {
        let compared: Vec<[f64; 2]> = scans
            .iter()
            .filter_map(|scan| {
                // On planar scans the same kernels use the planar path.
                let is = |row: &&&Row| match contestant.is_default() {
                    true => row.contestant.is_default(),
                    false => row.contestant.does_as(contestant),
                };
                let row = scan.iter().filter(|row| measure.compares(row)).find(is)?;
                Some([row.over_default[1], measure.of(row) / measure.of(scan[0])])
            })
            .collect();
        if !compared.is_empty() {
            shown.push((*contestant, [0, 1].map(|c| middle(compared.iter().map(|p| p[c]).collect()))));
        }
    }
    shown
}

/// Draws medians over all scans of times and errors relative to the default's.
fn summary(scans: &[Vec<&Row>]) -> Figure {
    let mut panels = Vec::new();
    for measure in [Measure::Blurred, Measure::Slope, Measure::Anyone] {
        let shown = medians(scans, measure);
        let points: Vec<[f64; 2]> = shown.iter().map(|(_, p)| *p).collect();
        let [x, y] = [0, 1].map(|c| range(points.iter().map(|p| p[c])));
        let mut series = vec![Series::new("Pareto front", SeriesStyle::Line, Ink::Grey, steps(&points, x, 2.0 * y[1]))];
        series.extend(by_family(shown.into_iter()));
        let title = match measure {
            Measure::Anyone | Measure::Truth => "Value, any width, against the truth",
            Measure::Blurred => "Value, one width, against the truth so blurred",
            Measure::Slope => "Gradient, one width, against the truth so blurred",
        };
        panels.push(Panel::new(title, axis("× the default’s time", x), axis("× the default’s error", y), series));
    }
    Figure {
        id: "summary",
        title: "Run time against error, over all phantoms".into(),
        caption: format!(
            "Each mark is a configuration: medians over {} scans of its time and of its error as multiples of the default’s on the same scan. On the left and in \
             the middle all have the default’s effective width. On the right also those that have another: what follows pixels, what drops them into voxels, the \
             fourth order, which has none, and σ chosen for the scan’s own gaps; on these sharp phantoms a narrower kernel is nearer to the truth, as long as noise and gaps allow it.",
            scans.len()
        ),
        columns: 3,
        height: 200.0,
        panels,
    }
}
