//! IGSIO's reconstruction (the engine of PLUS and of 3D Slicer's live reconstruction) on the same
//! frames, taking turns with ours.
//!
//! It runs in a process of its own (`scripts/peers/igsio/contestant.cpp`, which `make peers
//! IGSIO=FOLDER` compiles with IGSIO's source in that folder). Its volume has 8 bits, and the axes
//! of the world. It takes a rectangle of every frame; a mask of another shape cannot be given.

use std::cell::RefCell;
use std::error::Error;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use glam::DMat4;

use sonoweave_core::region::ClipRect;
use sonoweave_core::slice::{Pixels, Slice};
use volume::Grid;

use crate::baselines::Drop;
use crate::process::Process;

/// Folder of the program, in the project's.
const FOLDER: &str = "out/igsio";

/// IGSIO's process with the frames of one scan.
pub(crate) struct Igsio {
    process: RefCell<Process>,
    folder: PathBuf,
    voxels: usize,
}

impl Igsio {
    /// Starts the program, if it was compiled, and hands the frames over.
    ///
    /// # Errors
    /// If the frames do not have 8 bits, the files cannot be written, or the program fails.
    pub(crate) fn start(scan: &str, grid: &Grid, slices: &[Slice]) -> Result<Option<Self>, Box<dyn Error>> {
        let project = Path::new(env!("CARGO_MANIFEST_DIR"));
        let program = project.join(FOLDER).join("igsio");
        if !program.exists() {
            println!("\nIGSIO is left out of the {scan}: make peers IGSIO=FOLDER compiles it from its source");
            return Ok(None);
        }
        let folder = project.join("out/bench/igsio").join(scan.replace(' ', "-"));
        fs::create_dir_all(&folder)?;
        let first = &slices.first().ok_or("there is no frame")?.image;
        let numbers = |values: &[f64]| values.iter().map(ToString::to_string).collect::<Vec<_>>().join(" ");
        let job = [
            grid.size.map(|n| n.to_string()).join(" "),
            numbers(&grid.origin.to_array()),
            numbers(&grid.spacing.to_array()),
            format!("{} {} {}", first.width(), first.height(), slices.len()),
        ];
        fs::write(folder.join("job.txt"), job.join("\n") + "\n")?;
        let (mut frames, mut poses) = (Vec::new(), Vec::new());
        for slice in slices {
            let Pixels::U8(pixels) = slice.image.pixels() else {
                return Err("IGSIO takes pictures of 8 bits here".into());
            };
            frames.extend_from_slice(pixels);
            let rows = DMat4::from(slice.world_from_image.affine()).transpose().to_cols_array();
            poses.extend(rows.iter().flat_map(|x| x.to_ne_bytes()));
        }
        fs::write(folder.join("frames.raw"), frames)?;
        fs::write(folder.join("poses.raw"), poses)?;
        let process = Process::start("IGSIO", Command::new(program).arg(&folder), &folder.join("igsio.log"))?;
        let voxels = usize::try_from(grid.voxels().ok_or("the grid has too many voxels")?)?;
        Ok(Some(Self { process: RefCell::new(process), folder, voxels }))
    }

    /// Inserts the rectangle of every frame into a new volume, on one thread, and returns the
    /// milliseconds of each frame.
    ///
    /// # Errors
    /// If the method is none of IGSIO's, or the program fails.
    pub(crate) fn insert(&self, drop: Drop, rectangle: ClipRect) -> Result<Vec<f64>, Box<dyn Error>> {
        let method = match drop {
            Drop::Nearest => "nearest",
            Drop::Trilinear => "linear",
            Drop::NearestInBytes => return Err("IGSIO has one method for the nearest voxel".into()),
        };
        let ClipRect { x, y, width, height } = rectangle;
        let answer = self.process.borrow_mut().ask(&format!("insert {method} 1 {x} {y} {width} {height}"))?;
        answer.split_whitespace().map(|ms| Ok(ms.parse()?)).collect()
    }

    /// Returns the values of the volume that was inserted last, x fastest; `None` where no pixel
    /// was inserted.
    ///
    /// # Errors
    /// If the program fails.
    pub(crate) fn values(&self) -> Result<Vec<Option<f32>>, Box<dyn Error>> {
        let path = self.folder.join("volume.raw");
        self.process.borrow_mut().ask(&format!("save {}", path.display()))?;
        let bytes = fs::read(&path)?;
        if bytes.len() != 3 * self.voxels {
            return Err(format!("{}: {} bytes", path.display(), bytes.len()).into());
        }
        let (values, weights) = bytes.split_at(self.voxels);
        let pairs = values.iter().zip(weights.chunks_exact(2));
        Ok(pairs.map(|(value, weight)| (weight != [0, 0]).then(|| f32::from(*value))).collect())
    }
}

/// Returns the name of IGSIO's source: its commit, or the hash of the compiled files.
///
/// # Errors
/// If the file beside the program cannot be read.
pub(crate) fn source() -> Result<String, Box<dyn Error>> {
    Ok(fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(FOLDER).join("source"))?.trim().to_owned())
}
