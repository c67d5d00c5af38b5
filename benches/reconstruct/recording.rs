//! A real freehand recording: PLUS's spine phantom, 21 frames of 820×616, at 0.5 mm, with no
//! settings beyond its configuration.

use std::error::Error;
use std::path::Path;

use glam::DVec3;

use mask::Mask;
use phantom::truth::covering_grid;
use reconstruct::Settings;
use sonoweave_core::region::ClipRect;

use crate::Effort;
use crate::baselines::{Drop, Splat, plain};
use crate::check::{Deviation, against_equations};
use crate::igsio::{self, Igsio};
use crate::loading::{folder, load};
use crate::report::{Cell, Goal, Report, Table};
use crate::timing::{Contestant, arithmetic, each, interleaved, ours, reconstructed};

pub(crate) const SEQUENCE: &str = "freehand/SpinePhantomFreehand.igs.mha";
pub(crate) const CONFIG: &str = "freehand/PlusDeviceSet_VolumeReconstructionOnly_SpinePhantom_NN_MEAN.xml";
pub(crate) const SPACING_MM: f64 = 0.5;
const GOAL: (&str, Goal) = ("spine recording, 0.5 mm, defaults, 1 thread: ms a frame", Goal::AtMost(1.0));

/// Sums in f32 keep seven digits, and trilinear weights are exact to 1e-7. Voxels with less
/// weight than this would mainly show these errors.
const BASELINE_WEIGHT: f32 = 0.05;
const BASELINE_BOUNDS: [f64; 2] = [0.001, 0.01];

pub(crate) fn bench(effort: Effort, report: &mut Report) -> Result<(), Box<dyn Error>> {
    let folder = folder(Path::new(env!("CARGO_MANIFEST_DIR")));
    let (sequence, config) = (folder.join(SEQUENCE), folder.join(CONFIG));
    if !(sequence.is_file() && config.is_file()) {
        println!(
            "\nSpine recording: skipped, because {SEQUENCE} or its configuration is not in the folder of recordings \
             (../shared/data, or the one that SONOWEAVE_TEST_DATA names)"
        );
        report.skipped(GOAL.0, GOAL.1);
        report.skipped("spine recording: 2 threads over 1", Goal::AtLeast(1.7));
        return Ok(());
    }
    let (slices, mask) = load(&sequence, &config)?;

    let one = Settings::new(DVec3::splat(SPACING_MM));
    let two = Settings { threads: 2, ..one.clone() };
    let size = [mask.width(), mask.height()];
    let grid = covering_grid(slices.iter().map(|s| (s.world_from_image, size)), one.spacing_mm, 2.0)?;
    let drops = [Drop::Nearest, Drop::Trilinear];
    let igsio = Igsio::start("spine recording", &grid, &slices)?;
    let mut contestants: Vec<Contestant<'_>> = vec![ours(&one, &mask, &slices), ours(&two, &mask, &slices)];
    for drop in drops {
        let (grid, mask, slices) = (&grid, &mask, &slices);
        contestants.push(Box::new(move || {
            let mut splat = Splat::new(drop, grid)?;
            each(slices, |slice| splat.insert(slice, mask))
        }));
    }

    let mut deviations = Vec::new();
    for settings in [&one, &two] {
        deviations.push(against_equations(&reconstructed(settings, &mask, &slices)?, &slices, &mask)?);
    }
    for drop in drops {
        let mut splat = Splat::new(drop, &grid)?;
        for slice in &slices {
            splat.insert(slice, &mask)?;
        }
        let expected = plain(drop, &grid, &slices, &mask)?;
        let pairs = expected.iter().enumerate().map(|(i, [sum, weight])| {
            let firm = *weight > f64::from(BASELINE_WEIGHT);
            (splat.value(i, BASELINE_WEIGHT).map(f64::from), firm.then(|| sum / weight))
        });
        deviations.push(Deviation::over(pairs, BASELINE_BOUNDS));
    }
    contestants.extend([arithmetic(1), arithmetic(2)]);
    // IGSIO pastes whole frames, as the recording's configuration says, and the data alone.
    let whole = ClipRect { x: 0, y: 0, width: size[0], height: size[1] };
    let data = mask.bounds().ok_or("the recording has no data")?;
    let mut theirs = Vec::new();
    if let Some(igsio) = &igsio {
        report.peer("IGSIO", igsio::source()?);
        for (drop, method) in drops.into_iter().zip(["nearest", "linear"]) {
            for (part, rectangle) in [("whole frames", whole), ("data alone", data)] {
                igsio.insert(drop, rectangle)?;
                let expected = plain(drop, &grid, &slices, &Mask::rect(size[0], size[1], rectangle))?;
                theirs.push((format!("IGSIO, {method}, {part}"), apart(&igsio.values()?, &expected)));
                contestants.push(Box::new(move || igsio.insert(drop, rectangle)));
            }
        }
    }
    let times = interleaved(effort.rounds, &mut contestants)?;

    let mut table = Table::new(
        "spine",
        format!(
            "Spine recording: {} frames of {}×{}, of which {} pixels are data (automatic mask); 0.5 mm, defaults; ms a frame",
            slices.len(),
            size[0],
            size[1],
            mask.area()
        ),
        &[
            "method",
            "threads",
            "median",
            "p25",
            "p75",
            "p95",
            "min",
            "first",
            "× of ours",
            "× p25",
            "× p75",
            "rms dev",
            "max dev",
            "goal",
            "verdict",
        ],
    );
    let names = ["sonoweave", "sonoweave", drops[0].name(), drops[1].name()].map(str::to_owned);
    for (name, deviation) in names.iter().zip(&deviations) {
        deviation.note(&format!("spine recording, {name}"), report);
    }
    let methods = names.into_iter().zip(deviations).zip(&times);
    let methods = methods.chain(theirs.into_iter().zip(&times[6..]));
    for (c, ((name, deviation), t)) in methods.enumerate() {
        let verdict = if c == 0 { report.judge(GOAL.0, GOAL.1, t.median()) } else { Report::no_goal() };
        let mut row = vec![Cell::text(&name), Cell::count(if c == 1 { 2 } else { 1 }), Cell::Number(t.median(), 3)];
        row.extend([0.25, 0.75, 0.95, 0.0].map(|q| Cell::Number(t.quantile(q), 3)));
        row.push(Cell::Number(t.first(), 3));
        let [low, ratio, high] = t.over(&times[0]);
        row.extend([ratio, low, high].map(|times| Cell::Number(times, 2)));
        row.extend([Cell::Number(deviation.rms, 4), Cell::Number(deviation.max, 3)]);
        row.extend(verdict);
        table.row(row);
    }
    table.note("All in: in-plane filtering, new bricks, insertion; file reading excluded. \"first\" is the first frame of a run,");
    table.note("which also designs the filter. Deviations, grey levels: ours from the equations in f64 at sampled voxels, the others'");
    table.note("from each pixel by itself in f64 at all voxels. IGSIO keeps running means in 8 bits.");
    report.add(table);
    report.threads("spine recording", [&times[0], &times[1]], [&times[4], &times[5]]);
    Ok(())
}

/// Returns the deviation of IGSIO's values from the method's sums in f64, which nothing bounds.
fn apart(values: &[Option<f32>], expected: &[[f64; 2]]) -> Deviation {
    let pairs = values.iter().zip(expected).map(|(value, [sum, weight])| {
        let firm = *weight > f64::from(BASELINE_WEIGHT);
        (value.filter(|_| firm).map(f64::from), firm.then(|| sum / weight))
    });
    Deviation::over(pairs, [f64::INFINITY; 2])
}
