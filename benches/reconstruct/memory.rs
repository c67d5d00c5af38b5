//! Bytes per voxel: as the volume reports them, and as the growth of the process.

use std::error::Error;
use std::sync::Arc;
use volume::Voxels;

use glam::{DAffine3, DMat3, DVec3};

use mask::Mask;
use reconstruct::{Reconstructor, Settings};
use sonoweave_core::frames::Transform;
use sonoweave_core::slice::{Image, Pixels, Slice};
use volume::brick::VOXELS;

use crate::Effort;
use crate::report::{Cell, Goal, Report, Table};

const PIXELS: u32 = 512;
const PIXEL_MM: f64 = 0.25;
const GAP_MM: f64 = 0.5;
/// Memory allowance beside the voxels, in bytes.
const FIXED_BYTES: f64 = 64.0 * 1024.0 * 1024.0;
const MIB: f64 = 1024.0 * 1024.0;

/// Memory of a sweep.
pub(crate) struct Memory {
    slices: u32,
    voxels: u64,
    held: u64,
    /// Growth of the process's resident memory, in bytes; `None` if the system does not report
    /// it.
    grown: Option<f64>,
}

/// Sweeps two frames along (1, 1, 1) through a cube: oblique, so that bricks are touched in part
/// at the sweep's whole surface.
///
/// # Errors
/// If a slice is refused.
pub(crate) fn measure(effort: Effort) -> Result<Memory, Box<dyn Error>> {
    let pictures = [0_u32, 1].map(|seed| {
        // A multiplicative hash: the content does not matter, and computing it leaves no freed
        // memory for later use.
        let pixels: Arc<[u8]> =
            (0..PIXELS * PIXELS).map(|i| ((i + seed).wrapping_mul(2_654_435_761) >> 24) as u8).collect();
        Image::new(PIXELS, PIXELS, Pixels::U8(pixels))
    });
    let n = DVec3::ONE.normalize();
    let (u, v) = n.any_orthonormal_pair();
    let half = 0.5 * f64::from(PIXELS - 1) * PIXEL_MM;
    let before = resident();
    let settings = Settings { sigma_mm: [None, None, Some(1.0)], ..Settings::new(DVec3::splat(0.5)) };
    let mut reconstructor = Reconstructor::new(settings, Mask::full(PIXELS, PIXELS))?;
    for i in 0..effort.memory_slices {
        let along = GAP_MM * (f64::from(i) - 0.5 * f64::from(effort.memory_slices));
        let world_from_image = Transform::from_affine(DAffine3 {
            matrix3: DMat3::from_cols(u * PIXEL_MM, v * PIXEL_MM, n),
            translation: n * along - (u + v) * half,
        });
        let image = pictures[i as usize % 2].clone();
        reconstructor.insert(&Slice { image, time_ns: i64::from(i), world_from_image })?;
    }
    let volume = reconstructor.volume();
    Ok(Memory {
        slices: effort.memory_slices,
        voxels: (volume.len() * VOXELS) as u64,
        held: volume.bytes(),
        grown: resident().zip(before).map(|(after, before)| after - before),
    })
}

/// Returns the resident memory of the process, in bytes.
fn resident() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
    line.split_whitespace().next()?.parse::<f64>().ok().map(|kib| kib * 1024.0)
}

pub(crate) fn report(memory: &Memory, report: &mut Report) {
    let title = format!(
        "Memory after {} slices of {PIXELS}×{PIXELS} pixels of {PIXEL_MM} mm, {GAP_MM} mm apart along (1,1,1), voxels of 0.5 mm",
        memory.slices
    );
    let columns = ["what", "MiB", "voxels of touched bricks", "bytes/voxel", "less 64 MiB", "goal", "verdict"];
    let mut table = Table::new("memory", title, &columns);
    let voxels = memory.voxels as f64;
    let mut row = |what: &str, bytes: f64| {
        let beyond = (bytes - FIXED_BYTES).max(0.0) / voxels;
        let verdict = report.judge(format!("memory, {what}: bytes a voxel beyond 64 MiB"), Goal::AtMost(12.0), beyond);
        let mut cells = vec![Cell::text(what), Cell::Number(bytes / MIB, 1), Cell::count(memory.voxels)];
        cells.extend([Cell::Number(bytes / voxels, 2), Cell::Number(beyond, 2)]);
        cells.extend(verdict);
        table.row(cells);
    };
    row("held by the volume", memory.held as f64);
    match memory.grown {
        Some(grown) => row("growth of the process", grown),
        None => table.note("The system does not say how much memory the process takes."),
    }
    report.add(table);
}
