//! Times pictures in parts of the world beside pictures of the same threads without parts: the
//! measurement behind [`render::partition::choice`], and its record in `docs/numbers`.

use std::error::Error;
use std::time::Instant;

use render::{Cache, RenderSettings, RenderWork, Renderer};

use super::case::{Case, Ready};
use super::report::{Cell, Report, Table};
use super::timing::{Contestant, Times, interleaved};

/// Threads, and numbers of parts on them; 1 is without parts.
const WAYS: [(usize, u32); 8] = [(2, 1), (2, 2), (2, 3), (2, 4), (2, 8), (1, 1), (1, 2), (1, 4)];
/// Edges of the whole pictures, pixels.
const EDGES: [u32; 4] = [32, 128, 256, 512];
/// Clock ticks of a millisecond of processor time, which Linux counts in hundredths of a second.
const TICK_MS: f64 = 10.0;

/// Results of one way.
#[derive(Default)]
struct Measured {
    work: RenderWork,
    processor_ms: f64,
    runs: usize,
    others: bool,
}

pub(crate) fn measure(case: &Case, ready: &Ready, rounds: usize, report: &mut Report) -> Result<(), Box<dyn Error>> {
    let names = [
        "picture",
        "threads",
        "parts",
        "median, ms",
        "× without parts",
        "lower quartile",
        "upper quartile",
        "processor, ms",
        "bricks read",
        "voxels shaded",
        "rays",
        "samples",
        "same bits",
    ];
    let (name, title) = (case.parts, format!("{}: in parts of the world, ms a picture", case.title));
    let mut table = Table::new(name, title, &names);
    for edge in EDGES {
        let settings = RenderSettings { size: [edge; 2], cache: Cache::None, ..ready.view_settings.clone() };
        let what = format!("whole, {edge}×{edge}");
        compare(&what, &settings, rounds.max(2), &mut table, report, |settings| {
            let began = Instant::now();
            let mut renderer = Renderer::new(settings, ready.region)?;
            renderer.update_all(ready.whole.volume());
            Ok((vec![began.elapsed().as_secs_f64() * 1e3], renderer))
        })?;
    }
    for cache in [Cache::OneLevel, Cache::TwoLevel] {
        let settings = RenderSettings { cache, ..ready.view_settings.clone() };
        let what = format!("each slice, {}", cache.name());
        compare(&what, &settings, rounds, &mut table, report, |settings| {
            let (mut reconstructor, mut renderer) = (ready.reconstructor()?, Renderer::new(settings, ready.region)?);
            let mut ms = Vec::new();
            for slice in &ready.slices {
                let touched = reconstructor.insert(slice)?;
                let began = Instant::now();
                match &touched.slab {
                    Some(slab) => renderer.update_within(reconstructor.volume(), &touched.bricks, slab),
                    None => renderer.update(reconstructor.volume(), &touched.bricks),
                };
                ms.push(began.elapsed().as_secs_f64() * 1e3);
            }
            Ok((ms, renderer))
        })?;
    }
    table.note(
        "Parts keep the one-level cache. Ratios are of the medians of runs that follow each other. Processor time is that of the whole process, of a run; in \
         \"each slice\" also that of the insertion.",
    );
    report.add(table);
    Ok(())
}

/// Measures all ways of one picture, and compares their bits.
fn compare(
    what: &str,
    base: &RenderSettings,
    rounds: usize,
    table: &mut Table,
    report: &mut Report,
    run: impl Fn(&RenderSettings) -> Result<(Vec<f64>, Renderer), Box<dyn Error>>,
) -> Result<(), Box<dyn Error>> {
    let with = |(threads, parts): (usize, u32)| RenderSettings { threads, parts: Some(parts), ..base.clone() };
    let (_, plain) = run(&with((1, 1)))?;
    let exact = plain.picture();
    let mut all: Vec<Measured> = WAYS.iter().map(|_| Measured::default()).collect();
    let mut turns: Vec<Contestant<'_>> = Vec::new();
    for (way, measured) in WAYS.into_iter().zip(&mut all) {
        let (run, exact, settings) = (&run, &exact, with(way));
        turns.push(Box::new(move || {
            let before = processor_ms();
            let (ms, renderer) = run(&settings)?;
            measured.processor_ms += processor_ms() - before;
            measured.runs += 1;
            measured.work = renderer.work();
            measured.others |= renderer.picture() != *exact;
            Ok(ms)
        }));
    }
    let times: Vec<Times> = interleaved(rounds, &mut turns)?;
    drop(turns);
    for (n, ((threads, parts), measured)) in WAYS.into_iter().zip(all).enumerate() {
        if measured.others {
            report.wrong(format!("{what}: {parts} parts on {threads} threads make other bits"));
        }
        // The way of the same threads without parts.
        let without = WAYS.iter().position(|way| *way == (threads, 1)).unwrap_or(n);
        let [low, middle, high] = times[n].over(&times[without]);
        let work = measured.work;
        let mut row = vec![Cell::text(what), Cell::count(threads as u64), Cell::count(u64::from(parts))];
        row.push(Cell::Number(times[n].median(), 2));
        row.push(Cell::spread([low, middle, high], 2));
        row.extend([low, high].map(|ratio| Cell::Number(ratio, 2)));
        row.push(Cell::Number(measured.processor_ms / measured.runs as f64, 1));
        row.extend([work.bricks_read, work.voxels_shaded, work.rays, work.samples].map(Cell::count));
        row.push(Cell::text(if measured.others { "NO" } else { "yes" }));
        table.row(row);
    }
    Ok(())
}

/// Returns the processor time of the process so far, ms; 0 where it is not known.
fn processor_ms() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    // Fields after the name, which may hold spaces: user and system time are the 12th and 13th.
    let fields = stat.rsplit(')').next().unwrap_or_default().split_whitespace().skip(11);
    fields.take(2).filter_map(|field| field.parse::<f64>().ok()).sum::<f64>() * TICK_MS
}
