//! What a slice costs until its picture is finished: `make bench`, or `cargo bench --bench render -- [--quick]`.
//!
//! A scan like that of Ohbuchi, Chen & Fuchs (1992), 90 slices of 128×128 pixels into 128×128×256 voxels at a picture of 256×256, and one of 256³ voxels at
//! 512×512. Every timed picture is compared with the one of the whole volume, bit for bit, and with the equations in f64; a wrong one fails the run, a goal
//! that is not met is printed and fails nothing.
#![allow(clippy::print_stdout, clippy::print_stderr, reason = "a bench speaks to its user")]

#[path = "../reconstruct/report.rs"]
#[allow(dead_code, reason = "shared with the bench of the reconstruction, which also compares threads")]
mod report;
#[path = "../reconstruct/timing.rs"]
#[allow(dead_code, reason = "shared with the bench of the reconstruction, which times inserts alone")]
mod timing;

use std::error::Error;
use std::path::Path;
use std::process::ExitCode;
use std::time::Instant;

use glam::DVec3;
use serde_json::json;
use sonoweave::phantom::scene::{Blobs, Scene};
use sonoweave::phantom::{Motion, Scan, ScanSettings};
use sonoweave::reconstruct::planar::PlanarSettings;
use sonoweave::reconstruct::{Settings, Simd, Weaver};
use sonoweave::render::camera::View;
use sonoweave::render::transfer::Transfer;
use sonoweave::render::{Cache, Picture, RenderSettings, RenderWork, Renderer, Stage, reference};
use sonoweave::slice::Slice;

use report::{Cell, Goal, Report, Table};
use timing::{Contestant, Times, interleaved};

/// A scan and its picture.
struct Case {
    id: &'static str,
    /// The same, of the table of whole pictures.
    still: &'static str,
    title: &'static str,
    slices: u32,
    pixels: [u32; 2],
    pixel_mm: [f64; 2],
    gap_mm: f64,
    motion: Motion,
    image: [u32; 2],
    /// Transfer function.
    preset: &'static str,
    /// Median and 99th percentile of a slice to its picture, and the whole picture from another side, ms.
    goals: [f64; 3],
}

const SPACING_MM: f64 = 0.5;

// Along u, which becomes the columns' axis, two voxels to the pixel.
const PAPER: Case = Case {
    id: "paper",
    still: "paper-still",
    title: "90 slices of 128×128 pixels, 128×128×256 voxels, picture of 256×256",
    slices: 90,
    pixels: [128; 2],
    pixel_mm: [0.99, 0.5],
    gap_mm: 64.0 / 90.0,
    motion: Motion::Jittered,
    image: [256; 2],
    preset: "phantom",
    goals: [8.0, 15.0, 57.0],
};

const CASES: [Case; 3] = [
    PAPER,
    // No voxel is empty, and no ray ends early.
    Case {
        id: "paper-dense",
        still: "paper-dense-still",
        title: "90 slices of 128×128 pixels, 128×128×256 voxels, picture of 256×256, everything visible",
        preset: "xray",
        ..PAPER
    },
    Case {
        id: "cube",
        still: "cube-still",
        title: "90 slices of 256×256 pixels by hand, 256³ voxels, picture of 512×512",
        slices: 90,
        pixels: [256; 2],
        pixel_mm: [0.5; 2],
        gap_mm: 1.4,
        motion: Motion::Freehand,
        image: [512; 2],
        preset: "phantom",
        goals: [15.0, 33.0, 477.0],
    },
];

fn main() -> ExitCode {
    let mut quick = false;
    for argument in std::env::args().skip(1) {
        match argument.as_str() {
            // What cargo passes to every bench.
            "--bench" => {}
            "--quick" => quick = true,
            other => {
                eprintln!("unknown argument {other}; this bench takes --quick or nothing");
                return ExitCode::from(2);
            }
        }
    }
    let folder =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("out/bench").join(if quick { "quick-render" } else { "render" });
    match run(quick, &folder) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("the bench broke off: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(quick: bool, folder: &Path) -> Result<bool, Box<dyn Error>> {
    let mut report = Report::new();
    for case in if quick { &CASES[..1] } else { &CASES[..] } {
        bench(case, quick, &mut report)?;
    }
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let load = std::fs::read_to_string("/proc/loadavg").unwrap_or_default();
    report.finish(json!({ "cores": cores, "simd": Simd::detect().name(), "load_average_after": load.trim() }), folder)
}

/// One way to keep the picture.
struct Way {
    name: String,
    settings: RenderSettings,
}

fn bench(case: &Case, quick: bool, report: &mut Report) -> Result<(), Box<dyn Error>> {
    let scan = Scan::new(ScanSettings {
        scene: Scene::Blobs(Blobs::draw(2)),
        motion: case.motion,
        frames: case.slices,
        gap_mm: case.gap_mm,
        image_size: case.pixels,
        pixel_mm: case.pixel_mm,
        noise_sd: 6.0,
        ..ScanSettings::default()
    })?;
    let slices = scan.slices(0..case.slices);
    let weave = Settings { threads: 2, ..Settings::new(DVec3::splat(SPACING_MM)) };
    let weaver = || match case.motion {
        Motion::Freehand => Weaver::general(weave.clone(), scan.mask().clone()),
        _ => Weaver::planar(weave.clone(), PlanarSettings::default(), scan.mask().clone()),
    };
    let mut whole = weaver()?;
    for slice in &slices {
        whole.insert(slice)?;
    }
    let (low, high) = whole.volume().seen_bounds().ok_or("nothing was seen")?;
    let stage = Stage::new(whole.world_from_lattice(), low, high)?;
    let look = RenderSettings {
        view: View { azimuth: 30.0, elevation: 20.0, ..View::default() },
        threads: 2,
        ..RenderSettings::new(case.image, Transfer::preset(case.preset, [0.0, 255.0])?)
    };
    let mut ways = Vec::new();
    for (cache, threads) in [
        (Cache::TwoLevel, 2),
        (Cache::Linear, 2),
        (Cache::OneLevel, 2),
        (Cache::None, 2),
        (Cache::TwoLevel, 1),
        (Cache::OneLevel, 1),
    ] {
        let settings = RenderSettings { cache, threads, ..look.clone() };
        ways.push(Way {
            name: format!("{}, {threads} thread{}", cache.name(), if threads == 1 { "" } else { "s" }),
            settings,
        });
    }
    // Untimed: the right answers.
    let mut plain = Renderer::new(&RenderSettings { cache: Cache::None, ..look.clone() }, stage)?;
    plain.update_all(whole.volume());
    let exact = plain.picture();
    let [most, rms] = reference::render(whole.volume(), &look, &stage)?.difference(&exact);
    if most > 1.0 / 255.0 {
        report.wrong(format!("{}: {most} from the equations", case.title));
    }

    let rounds = if quick { 1 } else { 5 };
    let mut followed: Vec<Vec<Followed>> = ways.iter().map(|_| Vec::new()).collect();
    {
        let mut turns: Vec<Contestant<'_>> = Vec::new();
        for (way, followed) in ways.iter().zip(&mut followed) {
            let (slices, weaver) = (&slices, &weaver);
            turns.push(Box::new(move || {
                let run = follow(&way.settings, stage, slices, weaver()?)?;
                let ms = run.ms.iter().map(|[insert, shade, rays]| insert + shade + rays).collect();
                followed.push(run);
                Ok(ms)
            }));
        }
        let times = interleaved(rounds, &mut turns)?;
        drop(turns);
        tell(case, &ways, &followed, &times, [most, rms], &exact, report);
    }
    still(case, &look, stage, &whole, rounds, report)
}

/// What following a scan took and made.
struct Followed {
    /// Insert, shading, rays of each slice.
    ms: Vec<[f64; 3]>,
    work: RenderWork,
    cache: Cache,
    cache_bytes: u64,
    picture: Picture,
}

fn follow(
    settings: &RenderSettings,
    stage: Stage,
    slices: &[Slice],
    weaver: Weaver,
) -> Result<Followed, Box<dyn Error>> {
    let (mut weaver, mut renderer) = (weaver, Renderer::new(settings, stage)?);
    let mut ms = Vec::with_capacity(slices.len());
    for slice in slices {
        let began = Instant::now();
        let touched = weaver.insert(slice)?;
        let insert = began.elapsed();
        let updated = match &touched.slab {
            Some(slab) => renderer.update_within(weaver.volume(), &touched.bricks, slab),
            None => renderer.update(weaver.volume(), &touched.bricks),
        };
        ms.push([insert, updated.shade, updated.rays].map(|d| d.as_secs_f64() * 1e3));
    }
    let (work, cache, cache_bytes) = (renderer.work(), renderer.cache(), renderer.memory().rays);
    Ok(Followed { ms, work, cache, cache_bytes, picture: renderer.picture() })
}

fn tell(
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
        let stage = |s: usize| {
            let all: Vec<f64> = runs.iter().flat_map(|run| run.ms.iter().map(|ms| ms[s])).collect();
            Cell::Number(timing::quantile(&all, 0.5), 2)
        };
        let each = |n: u64| Cell::count(n / u64::from(case.slices));
        let kept = match run.cache == way.settings.cache {
            true => String::new(),
            false => format!(" (did not fit: {})", run.cache.name()),
        };
        let mut row = vec![Cell::text(format!("{}{kept}", way.name))];
        row.extend([0.5, 0.95, 0.99].map(|q| Cell::Number(times.quantile(q), 2)));
        row.extend([stage(0), stage(1), stage(2)]);
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
    table.note(format!(
        "The picture is {:.4} grey levels of 255 at most from the equations in f64, {:.5} rms.",
        most * 255.0,
        rms * 255.0
    ));
    table.note("Counts are a slice's on average. Same bits: as a picture of the finished volume made at once.");
    report.add(table);
}

/// The whole picture from other sides.
fn still(
    case: &Case,
    look: &RenderSettings,
    stage: Stage,
    weaver: &Weaver,
    rounds: usize,
    report: &mut Report,
) -> Result<(), Box<dyn Error>> {
    let mut ms = Vec::new();
    let mut work = RenderWork::default();
    for side in 0..6_u32 {
        let view = View { azimuth: 60.0 * f64::from(side), elevation: 25.0, ..View::default() };
        for _ in 0..rounds {
            let mut renderer = Renderer::new(&RenderSettings { view, cache: Cache::None, ..look.clone() }, stage)?;
            let updated = renderer.update_all(weaver.volume());
            ms.push([updated.shade, updated.rays].map(|d| d.as_secs_f64() * 1e3));
            work = updated.work;
        }
    }
    let of = |s: usize| timing::quantile(&ms.iter().map(|ms| ms[s]).collect::<Vec<_>>(), 0.5);
    let names = ["what", "shade", "rays", "voxels shaded", "samples", "samples skipped", "goal", "verdict"];
    let mut table = Table::new(case.still, format!("{}: the whole from six sides, ms a picture", case.title), &names);
    let mut row = vec![Cell::text("2 threads, no cache"), Cell::Number(of(0), 1), Cell::Number(of(1), 1)];
    row.extend([work.voxels_shaded, work.samples, work.samples_skipped].map(Cell::count));
    row.extend(report.judge(format!("{}: rays of a new view, ms", case.title), Goal::AtMost(case.goals[2]), of(1)));
    table.row(row);
    report.add(table);
    Ok(())
}
