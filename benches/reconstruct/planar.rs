//! A 3-DOF arm's scan with both insertion paths, turning as it sweeps: 128×128 pixels into
//! 128×128×256 voxels, u along the 256; and a scan with a scanner's fine pixels.
//!
//! Both insert the same slices into the same lattice, in turns, so that times and errors are
//! comparable.

use std::error::Error;

use glam::DVec3;

use mask::Mask;
use phantom::{Errors, Motion, Scan, ScanSettings, truth};
use reconstruct::planar::{PlanarReconstructor, PlanarSettings, reference};
use reconstruct::{Reconstructor, Settings};
use sonoweave_core::slice::Slice;
use volume::brick_volume::SEEN;
use volume::{Grid, Voxels};

use crate::Effort;
use crate::check::{Deviation, against_equations, against_sums};
use crate::report::{Cell, Goal, Report, Table};
use crate::timing::{Contestant, arithmetic, each, interleaved, ours, reconstructed};

/// A scan.
struct Case {
    id: &'static str,
    name: &'static str,
    pixels: [u32; 2],
    pixel_mm: [f64; 2],
    spacing_mm: f64,
    /// Whether goals apply to it.
    goals: bool,
}

const CASES: [Case; 2] = [
    // Along u almost two voxels per pixel, so that columns have 256 voxels including the kernel
    // support at the ends; along v one.
    Case { id: "planar", name: "128²", pixels: [128; 2], pixel_mm: [0.99, 0.5], spacing_mm: 0.5, goals: true },
    // Pixels finer than voxels, as scanners give them. Here every pixel is a product, where the
    // general path samples a decimated frame.
    Case { id: "planar-fine", name: "512×480", pixels: [512, 480], pixel_mm: [0.1; 2], spacing_mm: 0.5, goals: false },
];
/// Gap between slices: about the volume's 128 voxels between the middles of the first and the
/// last slice, mm.
const GAP_MM: f64 = 0.5;
const SLICES: u32 = 128;
/// Distance of the axis in which the slices' planes meet, mm: the sweep turns by 36°.
const AXIS_DISTANCE_MM: f64 = 100.0;
/// Error bounds of the planar path, relative to the range of grey values: root mean square, and
/// maximum over voxels.
const ROUNDING: [f64; 2] = [2e-6, 1e-5];

fn by_columns(settings: &Settings, mask: &Mask, slices: &[Slice]) -> Result<PlanarReconstructor, Box<dyn Error>> {
    let mut reconstructor = PlanarReconstructor::new(settings.clone(), PlanarSettings::default(), mask.clone())?;
    for slice in slices {
        reconstructor.insert(slice)?;
    }
    Ok(reconstructor)
}

fn planar<'a>(settings: &'a Settings, mask: &'a Mask, slices: &'a [Slice]) -> Contestant<'a> {
    Box::new(move || {
        let mut reconstructor = PlanarReconstructor::new(settings.clone(), PlanarSettings::default(), mask.clone())?;
        each(slices, |slice| reconstructor.insert(slice).map(drop))
    })
}

/// Truth at the voxels that both paths have seen.
struct Truth {
    grid: Grid,
    first: [i64; 3],
    values: Vec<f32>,
    counts: Vec<bool>,
}

impl Truth {
    fn voxel(&self, i: usize) -> [i64; 3] {
        let [nx, ny, _] = self.grid.size.map(|n| n as usize);
        let at = [i % nx, i / nx % ny, i / (nx * ny)];
        [0, 1, 2].map(|a| self.first[a] + at[a] as i64)
    }

    fn errors(&self, volume: &dyn Voxels) -> Errors {
        let value = |i: usize| {
            let (r, w) = volume.voxel(self.voxel(i));
            (w > SEEN).then(|| r / w)
        };
        Errors::over(&self.values, value, |i| self.counts[i])
    }
}

pub(crate) fn bench(effort: Effort, report: &mut Report) -> Result<(), Box<dyn Error>> {
    CASES.iter().try_for_each(|case| bench_case(case, effort, report))
}

fn bench_case(case: &Case, effort: Effort, report: &mut Report) -> Result<(), Box<dyn Error>> {
    let scan = Scan::new(ScanSettings {
        motion: Motion::Fan { axis_distance_mm: AXIS_DISTANCE_MM },
        frames: SLICES,
        gap_mm: GAP_MM,
        image_size: case.pixels,
        pixel_mm: case.pixel_mm,
        ..ScanSettings::default()
    })?;
    let slices = scan.slices(0..scan.frames());
    let mask = &Mask::full(case.pixels[0], case.pixels[1]);
    let columns = by_columns(&Settings::new(DVec3::splat(case.spacing_mm)), mask, &slices)?;
    // Uses the lattice that the planar path selects itself.
    let one = columns.settings().clone();
    let two = Settings { threads: 2, ..one.clone() };
    let bricks = reconstructed(&one, mask, &slices)?;

    let truth = common(&scan, &columns, &bricks)?;
    let kernels = columns.kernels().ok_or("nothing was inserted")?;
    let world_from_lattice = columns.world_from_lattice();
    let pairs = against_sums(columns.volume(), &one, world_from_lattice, 0.0, |sums| {
        slices.iter().for_each(|slice| reference::insert(sums, slice, mask, kernels));
    });
    let exact = Deviation::over(pairs, ROUNDING.map(|part| part * 255.0));
    exact.note(&format!("planar scan, {}, planar path", case.name), report);
    let general = against_equations(&bricks, &slices, mask)?;
    general.note(&format!("planar scan, {}, general path", case.name), report);

    let mut contestants = [
        ours(&one, mask, &slices),
        planar(&one, mask, &slices),
        ours(&two, mask, &slices),
        planar(&two, mask, &slices),
        arithmetic(1),
        arithmetic(2),
    ];
    let times = interleaved(effort.rounds, &mut contestants)?;

    let volume = columns.volume();
    let title = format!(
        "Planar scan: {SLICES} slices of {}×{} pixels of {}×{} mm, {GAP_MM} mm and 0.3° apart; {} tiles of 8×8×{} voxels of {} mm; {}; ms a slice",
        case.pixels[0],
        case.pixels[1],
        case.pixel_mm[0],
        case.pixel_mm[1],
        volume.tiles(),
        volume.depth(),
        case.spacing_mm,
        one.simd.name()
    );
    let names = [
        "path",
        "threads",
        "median",
        "p25",
        "p75",
        "p95",
        "first",
        "voxels",
        "ns/voxel",
        "RMSE",
        "rms dev",
        "max dev",
        "bytes/voxel",
    ];
    let mut table = Table::new(case.id, title, &names);
    let held = [
        bricks.volume().bytes() as f64 / (bricks.volume().len() * 512) as f64,
        volume.bytes() as f64 / volume.voxels() as f64,
    ];
    let errors = [truth.errors(bricks.volume()), truth.errors(volume)];
    let voxels = [bricks.work().voxels_updated, columns.work().voxels_updated].map(|n| n as f64 / slices.len() as f64);
    for (i, t) in times[..4].iter().enumerate() {
        let (path, threads, deviation) = (i % 2, 1 + i / 2, [general, exact][i % 2]);
        let mut row =
            vec![Cell::text(["general", "planar"][path]), Cell::count(threads as u64), Cell::Number(t.median(), 3)];
        row.extend([0.25, 0.75, 0.95].map(|q| Cell::Number(t.quantile(q), 3)));
        row.extend([Cell::Number(t.first(), 2), Cell::Number(voxels[path], 0)]);
        row.extend([Cell::Number(t.median() * 1e6 / voxels[path], 3), Cell::Number(errors[path].rmse, 3)]);
        row.extend([Cell::Number(deviation.rms, 6), Cell::Number(deviation.max, 5), Cell::Number(held[path], 3)]);
        table.row(row);
    }
    table.note("RMSE, grey levels, is from the scene itself, at the voxels that both paths have seen: the kernel's blur and the pictures' noise.");
    table.note("Deviations, grey levels, are from each path's own equations in f64 at sampled voxels.");
    report.add(table);
    let [low, ratio, high] = times[0].over(&times[1]);
    println!("  general over planar, 1 thread: {ratio:.2} (quartiles over rounds {low:.2} to {high:.2})");
    if case.goals {
        report.judge("planar scan: general over planar, 1 thread", Goal::AtLeast(4.0), ratio);
        report.judge("planar scan, planar path: ms a slice on 1 thread", Goal::AtMost(0.25), times[1].median());
        report.judge("planar scan, planar path: bytes a voxel", Goal::AtMost(4.2), held[1]);
    }
    // Some tens of microseconds are close to the cost of waking a thread: the ratio is printed,
    // not judged.
    let gained = times[1].over(&times[3])[1];
    println!("  planar, 2 threads over 1: {gained:.2}; arithmetic {:.2}", times[4].over(&times[5])[1]);
    Ok(())
}

/// Returns the scene at the voxels that both paths have seen.
fn common(scan: &Scan, columns: &PlanarReconstructor, bricks: &Reconstructor) -> Result<Truth, Box<dyn Error>> {
    let (low, high) = columns.volume().seen_bounds().ok_or("nothing was seen")?;
    let settings = columns.settings();
    let grid = Grid {
        origin: columns.world_from_lattice().point(DVec3::from_array(low.map(|x| x as f64))),
        spacing: settings.spacing_mm,
        direction: settings.lattice_direction,
        size: [0, 1, 2].map(|a| (high[a] - low[a] + 1) as u64),
    };
    let values = truth::sample(&scan.settings().scene, &grid)?;
    let mut truth = Truth { grid, first: low, values, counts: Vec::new() };
    let seen = |i: usize| {
        let voxel = truth.voxel(i);
        columns.volume().voxel(voxel).1 > SEEN && bricks.volume().voxel(voxel).1 > SEEN
    };
    truth.counts = (0..truth.values.len()).map(seen).collect();
    Ok(truth)
}
