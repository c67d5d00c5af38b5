//! Fills the holes of the spine recording's volume at 0.5 mm: measures the time, checks the
//! result, and compares it with omitted data.

use std::error::Error;
use std::path::Path;
use std::time::Instant;

use glam::DVec3;

use export::fill::{FILLED, FillMethod, Filled, Filling};
use export::volume::DenseBox;
use reconstruct::{Reconstructor, Settings};
use volume::Voxels;
use volume::brick_volume::SEEN;

use crate::Effort;
use crate::check::Deviation;
use crate::loading::{folder, load};
use crate::recording::{CONFIG, SEQUENCE, SPACING_MM};
use crate::report::{Cell, Goal, Report, Table};
use crate::timing::{Contestant, Times, arithmetic, interleaved, reconstructed};

const RADIUS_MM: f64 = 1.5;
const THREADS: [usize; 2] = [1, 2];
const GOAL: Goal = Goal::AtMost(40.0);
/// One in this many holes is also filled by a plain search.
const SAMPLED: usize = 97;
/// Error bounds of f32 sums of a hundred terms of up to 255, as rms and as maximum; the nearest
/// is exact.
const BOUNDS: [f64; 2] = [1e-4, 1e-3];

fn goal(law: FillMethod) -> String {
    format!("holes of the spine volume, {}, 2 threads: ms", law.name())
}

pub(crate) fn bench(effort: Effort, report: &mut Report) -> Result<(), Box<dyn Error>> {
    let folder = folder(Path::new(env!("CARGO_MANIFEST_DIR")));
    let (sequence, config) = (folder.join(SEQUENCE), folder.join(CONFIG));
    let laws = [FillMethod::Nearest, FillMethod::Gaussian];
    if !(sequence.is_file() && config.is_file()) {
        println!(
            "\nHoles of the spine recording: skipped, because {SEQUENCE} or its configuration is not in the folder of recordings"
        );
        for law in laws {
            report.skipped(goal(law), GOAL);
        }
        return Ok(());
    }
    let (slices, mask) = load(&sequence, &config)?;
    let settings = Settings::new(DVec3::splat(SPACING_MM));
    let whole = reconstructed(&settings, &mask, &slices)?;
    let half: Vec<_> = slices.iter().step_by(2).cloned().collect();
    let half = reconstructed(&settings, &mask, &half)?;
    let space = space(&whole)?;

    let jobs: Vec<(FillMethod, usize)> =
        laws.into_iter().flat_map(|law| THREADS.map(|threads| (law, threads))).collect();
    let mut contestants: Vec<Contestant<'_>> = Vec::new();
    for (law, threads) in &jobs {
        let (whole, space) = (&whole, &space);
        contestants.push(Box::new(move || {
            let start = Instant::now();
            let filled = fill(*law, *threads, whole, space)?;
            let ms = start.elapsed().as_secs_f64() * 1e3;
            drop(filled);
            Ok(vec![ms])
        }));
    }
    contestants.extend([arithmetic(1), arithmetic(2)]);
    let times = interleaved(effort.rounds, &mut contestants)?;

    let [nx, ny, nz] = space.grid.size;
    let columns = [
        "law", "threads", "median", "p25", "p75", "min", "filled", "bricks", "of", "max dev", "left out", "rms off",
        "goal", "verdict",
    ];
    let title = format!(
        "Holes of the spine volume, {nx}×{ny}×{nz} voxels of {SPACING_MM} mm, filled within {RADIUS_MM} mm; ms"
    );
    let mut table = Table::new("filling", title, &columns);
    for ((law, threads), t) in jobs.iter().zip(&times) {
        let filled = fill(*law, *threads, &whole, &space)?;
        let deviation = deviation(*law, &filled, &whole, &space);
        deviation.note(&format!("holes of the spine volume, {}, {threads} threads", law.name()), report);
        let (left_out, off) = left_out(&fill(*law, *threads, &half, &space)?, &whole, &space);
        let work = filled.work();
        let verdict = if *threads == 2 { report.judge(goal(*law), GOAL, t.median()) } else { Report::no_goal() };
        let mut row = vec![Cell::text(law.name()), Cell::count(*threads as u64), Cell::Number(t.median(), 2)];
        row.extend([0.25, 0.75, 0.0].map(|q| Cell::Number(t.quantile(q), 2)));
        row.extend([work.filled, work.bricks_touched, work.bricks_considered].map(Cell::count));
        row.extend([Cell::Number(deviation.max, 6), Cell::count(left_out), Cell::Number(off, 2)]);
        row.extend(verdict);
        table.row(row);
    }
    table.note("\"max dev\" is from a plain search in f64 at sampled holes. \"rms off\" is, in grey levels, how far holes that are left when every other slice is left out");
    table.note("are filled from what those slices saw there: \"left out\" voxels. IGSIO fills the same volume in 104–812 ms on one thread (commit 9caba694).");
    report.add(table);
    for (law, t) in laws.iter().zip(times.chunks(2)) {
        let threads: [&Times; 2] = [&t[0], &t[1]];
        report.threads(&format!("holes of the spine volume, {}", law.name()), threads, [&times[4], &times[5]]);
    }
    Ok(())
}

fn space(whole: &Reconstructor) -> Result<DenseBox, Box<dyn Error>> {
    let (low, high) = whole.volume().seen_bounds().ok_or("nothing was seen")?;
    Ok(DenseBox::around([low, high], whole.world_from_lattice(), whole.settings()))
}

fn fill<'a>(
    law: FillMethod,
    threads: usize,
    whole: &'a Reconstructor,
    space: &DenseBox,
) -> Result<Filled<'a>, Box<dyn Error>> {
    Ok(Filling { method: law, radius_mm: RADIUS_MM }.fill(whole.volume(), space, threads, u64::MAX)?)
}

fn voxels(space: &DenseBox) -> impl Iterator<Item = [i64; 3]> {
    let ([x0, y0, z0], [nx, ny, nz]) = (space.first, space.grid.size.map(|n| n as i64));
    (0..nx * ny * nz).map(move |i| [x0 + i % nx, y0 + i / nx % ny, z0 + i / (nx * ny)])
}

/// Compares with a plain search of the ball around sampled holes.
fn deviation(law: FillMethod, filled: &Filled<'_>, whole: &Reconstructor, space: &DenseBox) -> Deviation {
    let steps = (RADIUS_MM / SPACING_MM).floor() as i64;
    let holes = voxels(space).filter(|at| whole.volume().voxel(*at).1 <= SEEN).step_by(SAMPLED);
    let pairs = holes.map(|at| {
        let (mut nearest, mut sum, mut weights) = (None, 0.0, 0.0);
        for z in -steps..=steps {
            for y in -steps..=steps {
                for x in -steps..=steps {
                    let square = x * x + y * y + z * z;
                    let (r, w) = whole.volume().voxel([at[0] + x, at[1] + y, at[2] + z]);
                    if square > steps * steps || w <= SEEN {
                        continue;
                    }
                    let (value, weight) = (f64::from(r / w), (-2.0 * square as f64 / (steps * steps) as f64).exp());
                    sum += weight * value;
                    weights += weight;
                    // Z is the outermost loop, so the first of equals is the one that the rule
                    // selects.
                    if nearest.is_none_or(|(least, _)| square < least) {
                        nearest = Some((square, value));
                    }
                }
            }
        }
        let (r, w) = filled.voxel(at);
        let expected = nearest.map(|(_, value)| if law == FillMethod::Nearest { value } else { sum / weights });
        ((w == FILLED).then(|| f64::from(r / w)), expected)
    });
    Deviation::over(pairs, BOUNDS)
}

/// Returns the number of voxels that are filled in `filled` and seen in `whole`, and their rms
/// difference.
fn left_out(filled: &Filled<'_>, whole: &Reconstructor, space: &DenseBox) -> (u64, f64) {
    let (mut count, mut squares) = (0, 0.0);
    for at in voxels(space) {
        let ((r, w), (truth, weight)) = (filled.voxel(at), whole.volume().voxel(at));
        if w == FILLED && weight > SEEN {
            count += 1;
            squares += f64::from(r / w - truth / weight).powi(2);
        }
    }
    (count, (squares / count as f64).sqrt())
}
