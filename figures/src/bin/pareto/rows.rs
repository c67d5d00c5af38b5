//! All rows as CSV, and their summary as Markdown.

use std::error::Error;
use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use sonoweave_figures::files::field;

use crate::baselines::Drop;
use crate::contestant::{self, Contestant, DEFAULT_VOXEL_MM, Match};
use crate::correction::Correction;
use crate::front::{Measure, NEAR, Rival, SLACK, rivals};
use crate::measure::Row;
use crate::report::{Report, digits, markdown};

const COLUMNS: &str = "scan,contestant,method,voxel_mm,voxel_sigma_uv,threads,matched_width,rounds,ms_p25,ms_median,ms_p75,\
    over_default_p25,over_default_median,over_default_p75,voxels_updated_per_slice,node_px,coverage,compared,truth_rmse,truth_max,truth_bias,\
    blurred_rmse,blurred_max,blurred_bias,oracle_rmse,oracle_max,gradient_rmse_per_mm,boundary_rmse,boundary_max,boundary_places,\
    boundary_unseen,own_equations_rms,own_equations_max";

/// Writes all rows with all digits.
///
/// # Errors
/// If the file cannot be written.
pub(crate) fn write_csv(rows: &[Row], folder: &Path) -> Result<(), Box<dyn Error>> {
    let mut text = format!("{COLUMNS}\n");
    for row in rows {
        let (c, s) = (&row.contestant, &row.score);
        let mut cells = vec![row.stage.to_owned(), field(&c.name()), field(&c.method()), c.voxel_mm.to_string()];
        cells.extend([c.voxel_sigmas().to_string(), c.threads.to_string(), matched(c).to_owned()]);
        cells.push(row.rounds.to_string());
        cells.extend(row.ms.iter().chain(&row.over_default).map(f64::to_string));
        cells.extend([row.updated, row.node_px].map(|v| v.map_or_else(String::new, |v| v.to_string())));
        cells.extend([s.coverage().to_string(), row.comparable.to_string()]);
        for errors in [&s.truth, &s.blurred] {
            cells.extend([errors.rmse, errors.max, errors.bias].map(|v| v.to_string()));
        }
        cells.extend([s.oracle.rmse, s.oracle.max, s.slope, s.boundary.rmse, s.boundary.max].map(|v| v.to_string()));
        cells.extend([s.boundary.voxels, s.boundary.unseen].map(|n| n.to_string()));
        cells.extend(row.deviation.map_or([String::new(), String::new()], |d| d.map(|v| v.to_string())));
        let _ = writeln!(text, "{}", cells.join(","));
    }
    Ok(fs::write(folder.join("rows.csv"), text)?)
}

fn matched(contestant: &Contestant) -> &'static str {
    match contestant.matching() {
        Match::Whole => "all axes",
        Match::AcrossPlane => "across the plane",
        Match::InPlane => "in the plane",
        Match::None => "none",
    }
}

/// Reports the default beside the baselines, its rivals, two threads, and the contestants that
/// are not compared.
pub(crate) fn print_verdicts(rows: &[Row], report: &mut Report) {
    let scans = scans(rows);
    report.section(format!(
        "## Run time against error\n\nEach cell: ms a slice / RMSE against the truth, grey levels. One thread; inside the sweep, read between voxels; what a method \
         does after the last slice is spread over all.\n\n{}",
        beside_baselines(&scans)
    ));
    let (table, counts) = verdicts(&scans);
    let lines: Vec<String> = Measure::ALL
        .iter()
        .zip(counts)
        .map(|(m, [on, near])| format!("{}: on the front of {on} of {}, near it on {near} more", m.name(), scans.len()))
        .collect();
    report.section(format!(
        "### Whether the default configuration lies on the Pareto front\n\n- {}\n\nA rival is at least as fast and as near to the truth, and more than {} % better in \
         one of both; the best is named with its part of the default's time and of its error. The default is near the front where no rival gains more than \
         {} %. The first three columns compare contestants of the default's effective width on all axes; pixel-following kernels (that width across the plane \
         only), splats (the voxels' width) and `--sigma auto` (the scan's) are in the last.\n\n{table}",
        lines.join("\n- "),
        100.0 * SLACK,
        100.0 * NEAR
    ));
    report.section(format!(
        "### Two threads\n\nThese slices are small, a tenth of a millisecond each, which leaves little to share; `make bench` shares large ones.\n\n{}",
        threads(rows)
    ));
    let left_out: Vec<String> = rows
        .iter()
        .filter(|row| !row.comparable)
        .map(|row| {
            format!(
                "- {}: {} covers {} of the places inside",
                row.title,
                row.contestant.name(),
                digits(row.score.coverage(), 4)
            )
        })
        .collect();
    if !left_out.is_empty() {
        report.section(format!("### Not compared, because they cover less\n\n{}\n", left_out.join("\n")));
    }
}

fn beside_baselines(scans: &[Vec<&Row>]) -> String {
    let paths = [
        ("brute force, f64", contestant::Path::BruteForce),
        ("nearest voxel + holes", contestant::Path::Splat(Drop::Nearest)),
        ("trilinear + holes", contestant::Path::Splat(Drop::Trilinear)),
        ("ours, auto σ", contestant::Path::AutoSigma),
        ("ours, smoothed poses", contestant::Path::Corrected(Correction::Smoothing)),
        ("ours, poses by neighbours", contestant::Path::Corrected(Correction::Jitter)),
    ];
    let cell = |row: Option<&&Row>| {
        row.map_or_else(
            || "–".into(),
            |row| {
                let mark = if row.comparable { "" } else { " (covers less)" };
                format!("{} / {}{mark}", digits(row.ms[1], 3), digits(row.score.truth.rmse, 3))
            },
        )
    };
    let lines: Vec<Vec<String>> = scans
        .iter()
        .map(|scan| {
            let of = |path| scan.iter().find(|row| row.contestant.does_as(&Contestant::new(path, DEFAULT_VOXEL_MM)));
            let mut line = vec![scan[0].title.to_owned(), cell(scan.first())];
            line.extend(paths.map(|(_, path)| cell(of(path))));
            line.push(digits(scan[0].score.blurred.rmse, 3));
            line.push(digits(scan[0].score.boundary.rmse, 3));
            line
        })
        .collect();
    let mut columns = vec!["scan", "ours, default"];
    columns.extend(paths.map(|(name, _)| name));
    columns.extend(["default's RMSE, blurred truth", "at the boundary"]);
    markdown(&columns, &lines)
}

/// Returns one line per scan; and for each criterion on how many scans the default is on the
/// front, and near it.
fn verdicts(scans: &[Vec<&Row>]) -> (String, [[usize; 2]; Measure::ALL.len()]) {
    let mut counts = [[0; 2]; Measure::ALL.len()];
    let mut lines = Vec::new();
    for scan in scans {
        let mut line = vec![scan[0].title.to_owned()];
        for (measure, [on, near]) in Measure::ALL.into_iter().zip(&mut counts) {
            let rivals = rivals(scan, measure);
            let is_near = rivals.iter().all(Rival::is_near);
            *on += usize::from(rivals.is_empty());
            *near += usize::from(is_near && !rivals.is_empty());
            line.push(rivals.first().map_or_else(
                || "on the front".into(),
                |r| {
                    let verdict = if is_near { "near" } else { "beaten" };
                    let more =
                        if rivals.len() > 1 { format!(" (and {} more)", rivals.len() - 1) } else { String::new() };
                    let [time, error] = r.parts.map(|part| digits(part, 3));
                    format!("{verdict}: {} takes {time} of the time at {error} of the error{more}", r.name)
                },
            ));
        }
        lines.push(line);
    }
    let columns: Vec<&str> = std::iter::once("scan").chain(Measure::ALL.map(Measure::name)).collect();
    (markdown(&columns, &lines), counts)
}

fn threads(rows: &[Row]) -> String {
    let mut lines = Vec::new();
    for row in rows.iter().filter(|row| row.contestant.threads > 1) {
        let alone = row.contestant.on_threads(1);
        let Some(one) = rows.iter().find(|other| other.stage == row.stage && other.contestant == alone) else {
            continue;
        };
        lines.push(vec![
            row.title.to_owned(),
            row.contestant.method(),
            digits(one.ms[1], 3),
            digits(row.ms[1], 3),
            digits(one.over_default[1] / row.over_default[1], 3),
        ]);
    }
    markdown(&["scan", "method", "1 thread, ms", "2 threads, ms", "gain"], &lines)
}

/// Returns the rows of each scan, in the order of the first of each.
pub(crate) fn scans(rows: &[Row]) -> Vec<Vec<&Row>> {
    let mut scans: Vec<Vec<&Row>> = Vec::new();
    for row in rows {
        match scans.iter_mut().find(|scan| scan[0].stage == row.stage) {
            Some(scan) => scan.push(row),
            None => scans.push(vec![row]),
        }
    }
    scans
}
