//! Measures writing of volumes with weights and pyramid: `make bench`, or
//! `cargo bench -p sonoweave-ome-zarr --bench write -- [--quick]`.
//!
//! A volume of real values, which hardly compress, and one eight times as large are written by one
//! thread and by two; three quarters of the voxels are seen. The bench prints megabytes of seen
//! values and weights (8 bytes a voxel) per second of processor time, and the most memory beyond
//! that at the beginning. The goals are 100 MB/s, and 6 shards a thread and 64 MB for either size.
//! Each volume is read again and compared with what was written.
//!
//! `out/bench/ome-zarr/figures.json` has the figures, for the records of `docs/numbers`.
#![allow(clippy::print_stdout, reason = "a bench speaks to its user")]

use std::error::Error;
use std::fs;
use std::path::Path;
use std::process::{Command, ExitCode};

use glam::{DMat3, DVec3};
use ome_zarr::{Extent, Meta, OmeZarr, OmeZarrWriter, Samples, Scalar, ShardIndex};
use rayon::prelude::*;
use serde_json::json;

/// Bytes of a voxel: value and weight.
const VOXEL_BYTES: usize = 8;
const GOAL_MB_S: f64 = 100.0;
/// Shards a thread, and megabytes beside them.
const GOAL_MEMORY: (usize, f64) = (6, 64.0);
const ROUNDS: usize = 3;

fn main() -> Result<ExitCode, Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    if let Some(at) = arguments.iter().position(|word| word == "--one") {
        println!("{}", write_once(arguments[at + 1].parse()?, arguments[at + 2].parse()?)?);
        return Ok(ExitCode::SUCCESS);
    }
    let is_quick = arguments.iter().any(|word| word == "--quick");
    let (edges, rounds) = if is_quick { ([128, 256], 1) } else { ([256, 512], ROUNDS) };
    println!("voxels    threads   MB a CPU s   MB/s   most memory, MB   shards at once");
    let mut figures = serde_json::Map::new();
    let mut is_within = true;
    for edge in edges {
        for threads in [1_usize, 2] {
            // The most memory is that of a process, so that each round has its own.
            let mut rows = Vec::new();
            for _ in 0..rounds {
                let mut command = Command::new(std::env::current_exe()?);
                let output = command.args(["--one", &edge.to_string(), &threads.to_string()]).output()?;
                if !output.status.success() {
                    return Err(String::from_utf8_lossy(&output.stderr).into_owned().into());
                }
                rows.push(serde_json::from_slice::<serde_json::Value>(&output.stdout)?);
            }
            let number = |row: &serde_json::Value, name: &str| row[name].as_f64().unwrap_or(f64::NAN);
            let sorted = |name: &str| {
                let mut all: Vec<f64> = rows.iter().map(|row| number(row, name)).collect();
                all.sort_by(f64::total_cmp);
                all
            };
            let [cpu, wall, memory, shards] = ["mb_cpu_s", "mb_s", "memory_mb", "shards"].map(sorted);
            let middle = rounds / 2;
            println!(
                "{edge}³      {threads}       {:10.0} {:6.0}  {:14.0}   {:10.0}",
                cpu[middle],
                wall[middle],
                memory[rounds - 1],
                shards[rounds - 1]
            );
            let shard_mb = number(&rows[0], "shard_mb");
            is_within &= memory[rounds - 1] <= (GOAL_MEMORY.0 * threads) as f64 * shard_mb + GOAL_MEMORY.1;
            for (name, all) in [("MB a CPU s", &cpu), ("memory, MB", &memory)] {
                let (least, most) = (all[0], all[rounds - 1]);
                let figure = json!({"median": all[middle], "least": least, "most": most, "rounds": rounds});
                figures.insert(format!("{edge}/{threads}/{name}"), figure);
            }
        }
    }
    println!("goals: {GOAL_MB_S} MB a CPU s; {} shards a thread and {} MB", GOAL_MEMORY.0, GOAL_MEMORY.1);
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../out/bench");
    let folder = folder.join(if is_quick { "quick-ome-zarr" } else { "ome-zarr" });
    fs::create_dir_all(&folder)?;
    let figures = json!({"quick": is_quick, "figures": figures});
    fs::write(folder.join("figures.json"), serde_json::to_string_pretty(&figures)?)?;
    if !is_within {
        println!("more memory was taken than the goal");
    }
    Ok(if is_within { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// Writes a volume in this process, checks it, and returns its figures.
fn write_once(edge: u64, threads: usize) -> Result<serde_json::Value, Box<dyn Error>> {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("v.ome.zarr");
    let extent = Extent { first: [0; 3], size: [edge; 3], shard: 128, chunk: 32 };
    let meta = Meta {
        extent,
        origin: DVec3::ZERO,
        spacing: DVec3::ONE,
        direction: DMat3::IDENTITY,
        scalar: Scalar::F32,
        unseen: 0.0,
        label: false,
        range: None,
        slices_box: None,
        fields: Vec::new(),
        content_key: "bench".into(),
    };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
    let (before, cpu, began) = (memory_mb("VmRSS")?, cpu_s()?, std::time::Instant::now());
    let (writer, _) = OmeZarrWriter::create(&path, &meta)?;
    let shards: Vec<ShardIndex> = extent.shard_indices(0).collect();
    let made = cpu_s_of(|| shards.iter().take(1).for_each(|shard| drop(voxels(*shard))))?;
    pool.install(|| {
        shards.par_iter().try_for_each(|shard| {
            let (values, weights) = voxels(*shard);
            writer.shards().write_shard(*shard, Samples::F32(&values), &weights)
        })
    })?;
    let most = writer.shards().most_shards_in_memory();
    pool.install(|| writer.finish())?;
    // The scene's own time is not that of writing.
    let cpu = cpu_s()? - cpu - made * (shards.len() + 1) as f64;
    let (wall, peak) = (began.elapsed().as_secs_f64(), memory_mb("VmHWM")?);
    let volume = OmeZarr::open(&path)?;
    let mut seen = 0;
    for shard in &shards {
        let (values, weights) = voxels(*shard);
        let first = extent.shard_first(*shard);
        let (found, found_weights) = volume.read(0, first, [128; 3])?;
        if (values, &weights) != (found, &found_weights) {
            return Err(format!("shard {shard:?} has other voxels").into());
        }
        seen += weights.iter().filter(|weight| **weight > 0.0).count();
    }
    let mb = (seen * VOXEL_BYTES) as f64 / 1e6;
    let shard_mb = (128_usize.pow(3) * VOXEL_BYTES) as f64 / 1e6;
    Ok(json!({
        "mb_cpu_s": mb / cpu, "mb_s": mb / wall, "memory_mb": peak - before, "shards": most, "shard_mb": shard_mb,
    }))
}

/// Returns values and weights of a shard: noise on a slow wave, as weighted means have it. A
/// quarter of the voxels is unseen, in slabs.
fn voxels([sz, sy, sx]: ShardIndex) -> (Vec<f32>, Vec<f32>) {
    let mut random = fastrand::Rng::with_seed(sz << 40 | sy << 20 | sx);
    let (mut values, mut weights) = (Vec::new(), Vec::new());
    for z in 0..128 {
        for y in 0..128 {
            for x in 0..128 {
                let is_seen = (z / 16 + y / 32) % 4 != 0;
                let wave = ((x + y) as f32 * 0.05).sin();
                values.push(if is_seen { 100.0 + 50.0 * wave + 20.0 * random.f32() } else { 0.0 });
                weights.push(if is_seen { 1.5 + wave + 0.1 * random.f32() } else { 0.0 });
            }
        }
    }
    (values, weights)
}

/// Returns a field of the process's status, MB.
fn memory_mb(name: &str) -> Result<f64, Box<dyn Error>> {
    let status = fs::read_to_string("/proc/self/status")?;
    let line = status.lines().find(|line| line.starts_with(name)).ok_or("no such field")?;
    Ok(line.split_whitespace().nth(1).ok_or("no number")?.parse::<f64>()? * 1.024e-3)
}

/// Returns the processor time of the process so far, s.
fn cpu_s() -> Result<f64, Box<dyn Error>> {
    let stat = fs::read_to_string("/proc/self/stat")?;
    let fields: Vec<&str> = stat.rsplit(") ").next().ok_or("no fields")?.split(' ').collect();
    // User and system time, in hundredths of a second.
    Ok((fields[11].parse::<f64>()? + fields[12].parse::<f64>()?) / 100.0)
}

/// Returns the processor time of some work, s.
fn cpu_s_of(work: impl Fn()) -> Result<f64, Box<dyn Error>> {
    let before = cpu_s()?;
    (0..4).for_each(|_| work());
    Ok((cpu_s()? - before) / 4.0)
}
