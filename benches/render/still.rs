//! Times the whole picture from new view directions.

use std::error::Error;
use std::time::{Duration, Instant};

use render::camera::View;
use render::{Cache, RenderSettings, RenderWork, Renderer, reference};

use super::case::{Case, Ready, THREADS};
use super::report::{Cell, Goal, Report, Table};
use super::timing;

/// Number of view directions.
const SIDES: u32 = 6;

/// Goals while the view is static, ms: a coarse picture, and the exact one.
const RESTING: [f64; 2] = [20.0, 300.0];
/// Time after which a caller with a waiting slice gets control.
const TURN: Duration = Duration::from_millis(10);

pub(crate) fn measure(case: &Case, ready: &Ready, rounds: usize, report: &mut Report) -> Result<(), Box<dyn Error>> {
    let (id, sizes) = case.stills;
    let names = [
        "picture",
        "all, ms",
        "shade",
        "rays",
        "voxels shaded",
        "samples",
        "samples skipped",
        "from f64, grey levels",
        "goal",
        "verdict",
        "half of it",
        "coarse, ms",
        "refined, ms",
    ];
    let mut table = Table::new(id, format!("{}: the whole from {SIDES} sides, ms a picture", case.title), &names);
    for &(size, goal) in sizes {
        let settings = |side: u32| {
            let view = View { azimuth: f64::from(360 / SIDES * side), elevation: 25.0, ..View::default() };
            RenderSettings { view, size, cache: Cache::None, ..ready.view_settings.clone() }
        };
        let mut ms = Vec::new();
        let mut work = RenderWork::default();
        for side in 0..SIDES {
            for _ in 0..rounds {
                let updated = Renderer::new(&settings(side), ready.region)?.update_all(ready.whole.volume());
                ms.push([updated.shade, updated.rays].map(|d| d.as_secs_f64() * 1e3));
                work = updated.work;
            }
        }
        // The equations in f64 take seconds per picture, so only the last side is checked.
        let last = settings(SIDES - 1);
        let mut timed = Renderer::new(&last, ready.region)?;
        timed.update_all(ready.whole.volume());
        let [most, _] = reference::render(ready.whole.volume(), &last, &ready.region)?.difference(&timed.picture());
        if most > 1.0 / 255.0 {
            report.wrong(format!("{}, {}×{} pixels: {most} from the equations", case.title, size[0], size[1]));
        }
        let of = |part: fn(&[f64; 2]) -> f64| timing::quantile(&ms.iter().map(part).collect::<Vec<_>>(), 0.5);
        let all = of(|[shade, rays]| shade + rays);
        let all_ms: Vec<f64> = ms.iter().map(|[shade, rays]| shade + rays).collect();
        let mut row = vec![Cell::text(format!("{}×{}", size[0], size[1])), quartiles(&all_ms)];
        row.extend([of(|ms| ms[0]), of(|ms| ms[1])].map(|ms| Cell::Number(ms, 1)));
        row.extend([work.voxels_shaded, work.samples, work.samples_skipped].map(Cell::count));
        row.push(Cell::Number(most * 255.0, 4));
        let what = format!("{}: a new view of {}×{} pixels, ms", case.title, size[0], size[1]);
        row.extend(report.judge(what, Goal::AtMost(goal), all));
        row.push(Cell::text(if all <= 0.5 * goal { "met" } else { "not met" }));
        let resting = resting(ready, &settings, rounds, report)?;
        row.extend(resting.each_ref().map(|ms| quartiles(ms)));
        let medians = resting.map(|ms| timing::quantile(&ms, 0.5));
        for ((ms, goal), what) in medians.into_iter().zip(RESTING).zip(["coarse", "refined"]) {
            let what = format!("{}: a {what} picture of {}×{} pixels, ms", case.title, size[0], size[1]);
            report.judge(what, Goal::AtMost(goal), ms);
        }
        table.row(row);
    }
    table.note(format!(
        "{THREADS} threads, nothing kept of another view: every voxel is read, classified and lit again. \"From f64\" is the largest difference of a pixel from the \
         equations, of the last side. Coarse and refined: of a renderer that has followed the volume from another side, from the moment of looking elsewhere; refined to the bits of the \
         one made at once."
    ));
    report.add(table);
    Ok(())
}

/// Returns the cell of a median with its quartiles.
fn quartiles(ms: &[f64]) -> Cell {
    Cell::spread([0.25, 0.5, 0.75].map(|q| timing::quantile(ms, q)), 1)
}

/// Returns the ms until a coarse picture of a new view, and until the exact one, of each turn.
fn resting(
    ready: &Ready,
    settings: &dyn Fn(u32) -> RenderSettings,
    rounds: usize,
    report: &mut Report,
) -> Result<[Vec<f64>; 2], Box<dyn Error>> {
    let kept = |side: u32| RenderSettings { cache: Cache::default(), ..settings(side) };
    let mut renderer = Renderer::new(&kept(SIDES - 1), ready.region)?;
    renderer.update_all(ready.whole.volume());
    let mut ms = [Vec::new(), Vec::new()];
    for _ in 0..rounds {
        for side in 0..SIDES {
            let began = Instant::now();
            renderer.set_view(settings(side).view)?;
            ms[0].push(began.elapsed().as_secs_f64() * 1e3);
            while !renderer.refine(TURN).finished {}
            ms[1].push(began.elapsed().as_secs_f64() * 1e3);
        }
    }
    let mut direct = Renderer::new(&settings(SIDES - 1), ready.region)?;
    direct.update_all(ready.whole.volume());
    if direct.picture() != renderer.picture() {
        report.wrong("a refined picture has other bits than one made at once");
    }
    Ok(ms)
}
