//! Times a new slice until its picture is finished, for every ray cache.

use std::error::Error;
use std::time::Instant;

use reconstruct::PathReconstructor;
use render::{Cache, Picture, RenderRegion, RenderSettings, RenderWork, Renderer, reference};
use sonoweave_core::slice::Slice;

use super::case::{Case, Ready};
use super::report::{Cell, Goal, Report, Table};
use super::timing::{self, Contestant, Times, interleaved};

/// One way to update the picture.
struct Way {
    name: String,
    settings: RenderSettings,
}

/// Results of following a scan.
struct Followed {
    /// Insertion, shading and rays of each slice, ms.
    ms: Vec<[f64; 3]>,
    work: RenderWork,
    cache: Cache,
    cache_bytes: u64,
    picture: Picture,
}

pub(crate) fn measure(case: &Case, ready: &Ready, rounds: usize, report: &mut Report) -> Result<(), Box<dyn Error>> {
    let (view_settings, region) = (&ready.view_settings, ready.region);
    let mut ways = Vec::new();
    for (cache, threads) in [
        (Cache::OneLevel, 2),
        (Cache::TwoLevel, 2),
        (Cache::Linear, 2),
        (Cache::None, 2),
        (Cache::OneLevel, 1),
        (Cache::TwoLevel, 1),
    ] {
        let settings = RenderSettings { cache, threads, ..view_settings.clone() };
        ways.push(Way {
            name: format!("{}, {threads} thread{}", cache.name(), if threads == 1 { "" } else { "s" }),
            settings,
        });
    }
    // The correct results, untimed.
    let mut plain = Renderer::new(&RenderSettings { cache: Cache::None, ..view_settings.clone() }, region)?;
    plain.update_all(ready.whole.volume());
    let exact = plain.picture();
    let apart = reference::render(ready.whole.volume(), view_settings, &region)?.difference(&exact);
    if apart[0] > 1.0 / 255.0 {
        report.wrong(format!("{}: {} from the equations", case.title, apart[0]));
    }
    let mut followed: Vec<Vec<Followed>> = ways.iter().map(|_| Vec::new()).collect();
    let mut turns: Vec<Contestant<'_>> = Vec::new();
    for (way, followed) in ways.iter().zip(&mut followed) {
        turns.push(Box::new(move || {
            let run = follow(&way.settings, region, &ready.slices, ready.reconstructor()?)?;
            let ms = run.ms.iter().map(|[insert, shade, rays]| insert + shade + rays).collect();
            followed.push(run);
            Ok(ms)
        }));
    }
    let times = interleaved(rounds, &mut turns)?;
    drop(turns);
    report_all(case, &ways, &followed, &times, apart, &exact, report);
    Ok(())
}

fn follow(
    settings: &RenderSettings,
    region: RenderRegion,
    slices: &[Slice],
    reconstructor: PathReconstructor,
) -> Result<Followed, Box<dyn Error>> {
    let (mut reconstructor, mut renderer) = (reconstructor, Renderer::new(settings, region)?);
    let mut ms = Vec::with_capacity(slices.len());
    for slice in slices {
        let began = Instant::now();
        let touched = reconstructor.insert(slice)?;
        let insert = began.elapsed();
        let updated = match &touched.slab {
            Some(slab) => renderer.update_within(reconstructor.volume(), &touched.bricks, slab),
            None => renderer.update(reconstructor.volume(), &touched.bricks),
        };
        ms.push([insert, updated.shade, updated.rays].map(|d| d.as_secs_f64() * 1e3));
    }
    let (work, cache, cache_bytes) = (renderer.work(), renderer.cache(), renderer.memory().rays);
    Ok(Followed { ms, work, cache, cache_bytes, picture: renderer.picture() })
}

fn report_all(
    case: &Case,
    ways: &[Way],
    followed: &[Vec<Followed>],
    times: &[Times],
    [most, rms]: [f64; 2],
    exact: &Picture,
    report: &mut Report,
) {
    let names = [
        "cache",
        "median",
        "p25",
        "p75",
        "p95",
        "p99",
        "insert",
        "shade",
        "rays",
        "voxels shaded",
        "rays cast",
        "samples",
        "cache MB",
        "same bits",
        "goal",
        "verdict",
    ];
    let mut table = Table::new(case.id, format!("{}: from the slice to its picture, ms a slice", case.title), &names);
    for (i, ((way, runs), times)) in ways.iter().zip(followed).zip(times).enumerate() {
        let Some(run) = runs.last() else { continue };
        let same = run.picture == *exact;
        if !same {
            report.wrong(format!("{}, {}: other bits than the whole volume's picture", case.title, way.name));
        }
        let region = |s: usize| {
            let all: Vec<f64> = runs.iter().flat_map(|run| run.ms.iter().map(|ms| ms[s])).collect();
            Cell::Number(timing::quantile(&all, 0.5), 2)
        };
        let each = |n: u64| Cell::count(n / run.ms.len() as u64);
        let kept = match run.cache == way.settings.cache {
            true => String::new(),
            false => format!(" (did not fit: {})", run.cache.name()),
        };
        let first = runs.iter().take(1).flat_map(|run| run.ms.iter().map(|ms| ms.iter().sum())).collect::<Vec<f64>>();
        let name = format!("{}/{}/first pass p99", case.id, way.name);
        report.figure(&name, timing::quantile(&first, 0.99), f64::max);
        let mut row = vec![Cell::text(format!("{}{kept}", way.name))];
        row.extend([0.5, 0.25, 0.75, 0.95, 0.99].map(|q| Cell::Number(times.quantile(q), 2)));
        row.extend([region(0), region(1), region(2)]);
        row.extend([each(run.work.voxels_shaded), each(run.work.rays), each(run.work.samples)]);
        row.extend([Cell::Number(run.cache_bytes as f64 / 1e6, 1), Cell::text(if same { "yes" } else { "NO" })]);
        let judged = match i {
            0 => {
                let what = format!("{}: median, ms", case.title);
                let cells = report.judge(what, Goal::AtMost(case.goals[0]), times.quantile(0.5));
                report.judge(format!("{}: p99, ms", case.title), Goal::AtMost(case.goals[1]), times.quantile(0.99));
                cells
            }
            _ => Report::no_goal(),
        };
        row.extend(judged);
        table.row(row);
    }
    report.figure("from the equations, at most", most * 255.0, f64::max);
    table.note(format!(
        "The picture is {:.4} grey levels of 255 at most from the equations in f64, {:.5} rms.",
        most * 255.0,
        rms * 255.0
    ));
    table.note("Counts are a slice's on average. Same bits: as a picture of the finished volume made at once.");
    report.add(table);
}
