//! A few planes of a volume change: measures the ray time that the caches save, and their memory.

use std::error::Error;

use glam::DVec3;

use render::{Cache, Picture, RenderSettings, RenderWork, Renderer};

use super::case::{Case, Ready, along};
use super::report::{Cell, Goal, Report, Table};
use super::snapshot::{PLANES, Snapshot};
use super::timing::{self, Contestant, Times};

/// Goal: speed-up of the two-level cache over casting every ray again.
const FASTER: f64 = 8.0;
/// Goal: time of the one-level cache relative to the two-level one, with this share of its
/// memory.
const SLOWER: f64 = 1.5;
const SMALLER: f64 = 0.1;

/// One way to update the picture.
#[derive(Clone, Copy, PartialEq)]
enum Way {
    /// Casts every ray again, to its end.
    Recast,
    /// Updates only the rays that the changed planes reach.
    Update(Cache),
}

impl Way {
    const ALL: [Self; 5] = [
        Self::Recast,
        Self::Update(Cache::None),
        Self::Update(Cache::Linear),
        Self::Update(Cache::TwoLevel),
        Self::Update(Cache::OneLevel),
    ];

    fn name(self) -> String {
        match self {
            Self::Recast => "all rays, to their ends".into(),
            Self::Update(Cache::None) => "rays that are reached".into(),
            Self::Update(cache) => cache.name().into(),
        }
    }
}

/// Results of one way.
#[derive(Default)]
struct Found {
    shade: Vec<f64>,
    work: RenderWork,
    bytes: u64,
    /// Changes after which the picture did not match the volume.
    wrong: usize,
    /// The largest difference from the picture with early ray termination.
    off: f64,
    fits: bool,
}

pub(crate) fn measure(case: &Case, ready: &Ready, rounds: usize, report: &mut Report) -> Result<(), Box<dyn Error>> {
    let Some(id) = case.slab else { return Ok(()) };
    let axis = ready.sweep_axis();
    let before = Snapshot::new(ready.whole.volume(), &ready.region);
    let volumes = [before.with_planes_changed(axis), before];
    let directions =
        ready.region.world_from_region().matrix3.to_cols_array_2d().map(|axis| DVec3::from_array(axis).normalize());
    let (normal, edge) = (directions[axis], directions[(axis + 1) % 3]);
    let names = [
        "the planes are seen",
        "way",
        "rays, ms",
        "shade, ms",
        "rays",
        "samples",
        "blocks folded",
        "cache MB",
        "times faster",
        "right",
        "goal",
        "verdict",
    ];
    let title = format!("{}: {PLANES} planes of voxels change", case.title);
    let mut table = Table::new(id, title, &names);
    for (seen, direction) in
        [("face on", normal), ("edge on", edge), ("obliquely", normal + edge + 0.3 * directions[(axis + 2) % 3])]
    {
        let view_settings = RenderSettings { view: along(direction), ..ready.view_settings.clone() };
        let (times, found) = turns(ready, &view_settings, &volumes, axis, rounds)?;
        report_all(seen, &times, &found, &mut table, report);
    }
    table.note("A change and its rays, the middle of all; shading is the same for all ways but the first, which shades everything.");
    table.note("Right: the picture is the bits of the one made at once of the same volume; of rays cast to their ends, the difference in grey levels.");
    report.add(table);
    Ok(())
}

/// Runs all ways over both volumes in turns.
fn turns(
    ready: &Ready,
    view_settings: &RenderSettings,
    volumes: &[Snapshot; 2],
    axis: usize,
    rounds: usize,
) -> Result<(Vec<Times>, Vec<Found>), Box<dyn Error>> {
    let mut expected: Vec<Picture> = Vec::new();
    for volume in volumes {
        let mut renderer =
            Renderer::new(&RenderSettings { cache: Cache::None, ..view_settings.clone() }, ready.region)?;
        renderer.update_all(volume);
        expected.push(renderer.picture());
    }
    let bricks = volumes[0].bricks_of_planes(axis);
    // Memory of pixels and rays without a cache.
    let bare =
        Renderer::new(&RenderSettings { cache: Cache::None, ..view_settings.clone() }, ready.region)?.memory().rays;
    let mut found: Vec<Found> = Way::ALL.iter().map(|_| Found::default()).collect();
    let mut turns: Vec<Contestant<'_>> = Vec::new();
    for (way, found) in Way::ALL.into_iter().zip(&mut found) {
        let (expected, bricks) = (&expected, &bricks);
        let settings = match way {
            Way::Recast => RenderSettings { cache: Cache::None, stop: 0.0, ..view_settings.clone() },
            Way::Update(cache) => RenderSettings { cache, ..view_settings.clone() },
        };
        let mut kept = Renderer::new(&settings, ready.region)?;
        found.fits = kept.cache() == settings.cache;
        kept.update_all(&volumes[1]);
        turns.push(Box::new(move || {
            let mut rays = Vec::new();
            for (volume, expected) in volumes.iter().zip(expected) {
                let (updated, picture) = match way {
                    Way::Recast => {
                        let mut anew = Renderer::new(&settings, ready.region)?;
                        (anew.update_all(volume), anew.picture())
                    }
                    Way::Update(_) => (kept.update(volume, bricks), kept.picture()),
                };
                rays.push(updated.rays.as_secs_f64() * 1e3);
                found.shade.push(updated.shade.as_secs_f64() * 1e3);
                found.work = updated.work;
                let [most, _] = picture.difference(expected);
                found.off = found.off.max(most);
                found.wrong += usize::from(picture != *expected);
            }
            found.bytes = kept.memory().rays - bare;
            Ok(rays)
        }));
    }
    let times = timing::interleaved(rounds, &mut turns)?;
    drop(turns);
    Ok((times, found))
}

fn report_all(seen: &str, times: &[Times], found: &[Found], table: &mut Table, report: &mut Report) {
    let of =
        |way: Way| Way::ALL.into_iter().zip(times.iter().zip(found)).find(|(w, _)| *w == way).map(|(_, both)| both);
    let Some((recast, _)) = of(Way::Recast) else { return };
    for (way, (times, found)) in Way::ALL.into_iter().zip(times.iter().zip(found)) {
        let [_, faster, _] = recast.over(times);
        let right = match way {
            // The difference comes from behind the point of early termination.
            Way::Recast => {
                if found.off > f64::from(render::settings::STOP) + 1e-5 {
                    report.wrong(format!("{seen}: {} between rays to their ends and those that end early", found.off));
                }
                Cell::Number(found.off * 255.0, 3)
            }
            Way::Update(_) => {
                if found.wrong > 0 {
                    report.wrong(format!("{seen}, {}: other bits than a picture made at once", way.name()));
                }
                Cell::text(if found.wrong == 0 { "same bits" } else { "NO" })
            }
        };
        let mut row = vec![Cell::text(seen), Cell::text(way.name()), Cell::Number(times.median(), 2)];
        row.push(Cell::Number(timing::quantile(&found.shade, 0.5), 2));
        row.extend([found.work.rays, found.work.samples, found.work.blocks_folded].map(Cell::count));
        row.extend([Cell::Number(found.bytes as f64 / 1e6, 2), Cell::Number(faster, 1), right]);
        row.extend(match way {
            Way::Update(Cache::TwoLevel) if found.fits => report.judge(
                format!("planes {seen}: two-level, times faster than all rays"),
                Goal::AtLeast(FASTER),
                faster,
            ),
            Way::Update(Cache::OneLevel) => match of(Way::Update(Cache::TwoLevel)) {
                Some((two, kept)) if kept.fits => {
                    let memory = found.bytes as f64 / kept.bytes as f64;
                    report.judge(
                        format!("planes {seen}: one-level, of two-level's memory"),
                        Goal::AtMost(SMALLER),
                        memory,
                    );
                    let what = format!("planes {seen}: one-level, of two-level's time");
                    report.judge(what, Goal::AtMost(SLOWER), times.over(two)[1])
                }
                _ => Report::no_goal(),
            },
            _ => Report::no_goal(),
        });
        table.row(row);
    }
}
