//! Compares VTK's ray caster with ours on the same volume, from the same side, with the same
//! classification, in turns.
//!
//! VTK runs in a process of its own (`scripts/peers/vtk_caster.py`, in the environment that `make
//! peers` creates), controlled line by line. Both receive a volume of bytes. VTK classifies
//! between voxels and in 15 bits; we classify voxels and interpolate. The pictures therefore
//! differ; the difference is measured, and an excessive one fails the run.

use std::error::Error;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use glam::DVec3;
use serde_json::json;

use render::camera::{Camera, View};
use render::classify::light::Light;
use render::classify::transfer::{Opacity, Transfer};
use render::{Picture, RenderRegion, RenderSettings, Renderer};

use super::case::{Case, Ready, THREADS};
use super::process::Process;
use super::report::{Cell, Goal, Report, Table};
use super::snapshot::{PLANES, Snapshot};
use super::timing::{self, Contestant, Times};

const SIDES: u32 = 6;
/// Parts of the light, and the highlight's exponent: those of [`Light::default`] that VTK
/// supports too.
const LIT: ([f64; 3], u32) = ([0.3, 0.7, 0.2], 16);
/// Maximum root mean square difference of the two pictures, grey values of 255.
const APART: f64 = 2.0;
/// Pixels beside the silhouette that are not compared: the size of a voxel in the picture, and a
/// pixel.
const BORDER: i64 = 3;

/// One comparison.
struct Setting {
    what: &'static str,
    preset: &'static str,
    lit: bool,
    size: [u32; 2],
}

/// Returns the comparisons of one case.
fn settings(case: &Case) -> Vec<Setting> {
    let lit = |size| Setting { what: "lit", preset: "phantom", lit: true, size };
    match case.id {
        "paper" => vec![
            lit([256; 2]),
            lit([512; 2]),
            Setting { what: "flat, nothing empty", preset: "xray", lit: false, size: [256; 2] },
        ],
        "cube" => vec![lit([512; 2])],
        _ => Vec::new(),
    }
}

/// Returns the project's folder.
fn project() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Returns the Python with VTK, if `make peers` was run.
pub(crate) fn environment() -> Option<PathBuf> {
    Some(project().join("out/peers/bin/python")).filter(|python| python.exists())
}

/// Returns the empty table that all cases share.
pub(crate) fn table() -> Table {
    let names = [
        "volume",
        "picture",
        "light",
        "VTK, ms",
        "ours, ms",
        "p25",
        "times faster",
        "p75",
        "rms apart",
        "most",
        "goal",
        "verdict",
    ];
    let mut table =
        Table::new("peers", format!("VTK's ray caster on the CPU and ours, {THREADS} threads each, in turns"), &names);
    table.note("A new view: of a volume that both have, to the exact picture; every visible voxel is lit again. Changed: from the voxels to the picture, VTK's share of handing them over left out.");
    table.note(
        "Apart: of colours and opacity of pixels of the new views but those beside the silhouette, grey levels of 255.",
    );
    table
}

/// Measures one case and adds its rows.
pub(crate) fn measure(
    case: &Case,
    ready: &Ready,
    python: &Path,
    [rounds, sides]: [usize; 2],
    folder: &Path,
    table: &mut Table,
    report: &mut Report,
) -> Result<(), Box<dyn Error>> {
    let axis = ready.sweep_axis();
    let before = Snapshot::new(ready.whole.volume(), &ready.region);
    let volumes = [before.with_planes_changed(axis), before];
    for setting in settings(case) {
        let name = format!("{}-{}-{}", case.id, setting.size[0], setting.preset);
        let job = Job::new(&setting, ready, &volumes, &folder.join("peers").join(name))?;
        let mut vtk = Vtk::start(python, &job.folder)?;
        let apart = compare(&job, &volumes[1], &ready.region, &mut vtk, sides)?;
        if apart.rms > APART {
            report.wrong(format!(
                "{}, {}: VTK's picture is {:.2} grey levels rms from ours, not the {APART} of the same picture; both are in {}",
                case.title,
                setting.what,
                apart.rms,
                job.folder.display()
            ));
        }
        let new_view = new_views(&job, &volumes[1], ready, &mut vtk, [rounds, sides])?;
        let changed = changes(&job, &volumes, axis, ready, &mut vtk, rounds * sides)?;
        let size = setting.size.map(|n| n.to_string()).join("×");
        let voxels = volumes[1].size().map(|n| n.to_string()).join("×");
        for (what, times) in [("new view".to_owned(), new_view), (format!("{PLANES} slices changed"), changed)] {
            let [theirs, ours] = &times[..] else { continue };
            let ratio = theirs.over(ours);
            let mut row = vec![Cell::text(&voxels), Cell::text(format!("{size}, {what}")), Cell::text(setting.what)];
            row.extend([theirs, ours].map(|times| Cell::spread(times.quartiles(), 2)));
            row.extend([Cell::Number(ratio[0], 2), Cell::spread(ratio, 2), Cell::Number(ratio[2], 2)]);
            row.extend([apart.rms, apart.most].map(|r| Cell::Number(r, 2)));
            let goal = format!("{voxels}, {size}, {}, {what}: times faster than VTK", setting.what);
            row.extend(report.judge(goal, Goal::AtLeast(1.0), ratio[1]));
            table.row(row);
            report.figure("peers/rms apart, least", apart.rms, f64::min);
            report.figure("peers/rms apart, most", apart.rms, f64::max);
        }
    }
    Ok(())
}

/// Input of both renderers.
struct Job {
    folder: PathBuf,
    all_settings: Vec<RenderSettings>,
}

impl Job {
    fn new(setting: &Setting, ready: &Ready, volumes: &[Snapshot; 2], folder: &Path) -> Result<Self, Box<dyn Error>> {
        let transfer = Transfer::preset(setting.preset, [0.0, 255.0])?;
        let ([ambient, diffuse, specular], shininess) = LIT;
        let light = match setting.lit {
            true => Light::default().with_parts(ambient, diffuse, specular, shininess)?,
            false => Light::default().with_parts(1.0, 0.0, 0.0, 1)?,
        };
        let view_settings = |side: u32| RenderSettings {
            view: View { azimuth: 30.0 + f64::from(360 / SIDES * side), elevation: 20.0, ..View::default() },
            size: setting.size,
            transfer: transfer.clone(),
            light,
            ..ready.view_settings.clone()
        };
        let all_settings: Vec<RenderSettings> = (0..SIDES).map(view_settings).collect();
        let views = all_settings
            .iter()
            .map(|view_settings| seen(view_settings, &ready.region))
            .collect::<Result<Vec<_>, _>>()?;
        let spacing = ready.region.spacing_mm();
        let Opacity::Curve(curve) = transfer.opacity() else { return Err("VTK has opacity curves only".into()) };
        // 0 marks unseen voxels.
        let mut opacity = vec![[0.0, 0.0], [1.0, curve.value(1.0)]];
        opacity.extend(curve.points().filter(|(at, _)| *at > 1.0).map(|(at, [alpha])| [at, alpha]));
        let lit = json!({ "ambient": ambient, "diffuse": diffuse, "specular": specular, "shininess": shininess });
        let grey = [0.0, 255.0].map(|value| [value, transfer.intensity(value)]);
        let job = json!({
            "volumes": ["changed.raw", "volume.raw"],
            "dimensions": volumes[1].size(),
            "spacing_mm": spacing.to_array(),
            "size": setting.size,
            "step_mm": Camera::new(&all_settings[0].view, setting.size, all_settings[0].step, &ready.region)?.step_mm(),
            "threads": THREADS,
            "opacity": opacity,
            "unit_mm": transfer.unit_mm(),
            "grey": grey,
            "light": setting.lit.then_some(lit),
            "views": views,
        });
        fs::create_dir_all(folder)?;
        for (name, volume) in ["changed.raw", "volume.raw"].iter().zip(volumes) {
            fs::write(folder.join(name), volume.bytes())?;
        }
        fs::write(folder.join("job.json"), serde_json::to_string_pretty(&job)?)?;
        Ok(Self { folder: folder.to_owned(), all_settings })
    }
}

/// Returns a view in mm along the volume's own axes from its first voxel.
fn seen(view_settings: &RenderSettings, region: &RenderRegion) -> Result<serde_json::Value, Box<dyn Error>> {
    let camera = Camera::new(&view_settings.view, view_settings.size, view_settings.step, region)?;
    let [low, _] = region.bounds();
    let corner = DVec3::from_array(std::array::from_fn(|a| (low[a] - region.first()[a]) as f64));
    let mm = |at: DVec3| (at - corner) * region.spacing_mm();
    let [width, height] = view_settings.size;
    let (first, last) = (camera.ray(0, 0), camera.ray(width - 1, height - 1));
    let middle = |k: f64| mm(0.5 * (first.base + last.base) + first.step * k);
    let below = mm(camera.ray(0, height - 1).base) - mm(first.base);
    let pixel = below.length() / f64::from(height - 1);
    let samples = f64::from(camera.samples());
    Ok(json!({
        "centre": middle(0.5 * samples).to_array(),
        // Before the first sample.
        "eye": middle(-0.1 * samples).to_array(),
        "up": (-below.normalize()).to_array(),
        "half_height_mm": 0.5 * pixel * f64::from(height),
    }))
}

/// Difference of two pictures, grey values of 255.
struct Apart {
    rms: f64,
    most: f64,
}

fn compare(
    job: &Job,
    volume: &Snapshot,
    region: &RenderRegion,
    vtk: &mut Vtk,
    sides: usize,
) -> Result<Apart, Box<dyn Error>> {
    let mut apart = Apart { rms: 0.0, most: 0.0 };
    vtk.ms("change")?;
    for (side, view_settings) in job.all_settings.iter().take(sides).enumerate() {
        vtk.ms(&format!("view {side}"))?;
        let theirs = vtk.picture(&job.folder.join(format!("vtk-{side}.rgba16")), view_settings.size)?;
        let mut renderer = Renderer::new(view_settings, *region)?;
        renderer.update_all(volume);
        let ours = renderer.picture();
        for (name, picture) in [("vtk", &theirs), ("ours", &ours)] {
            let [width, height] = view_settings.size;
            let bytes = picture.over([0.0; 3]);
            image::save_buffer(
                job.folder.join(format!("{name}-{side}.png")),
                &bytes,
                width,
                height,
                image::ColorType::Rgb8,
            )?;
        }
        let (ours, theirs) = within(ours, theirs);
        let [most, rms] = ours.difference(&theirs);
        apart.most = apart.most.max(255.0 * most);
        apart.rms = apart.rms.max(255.0 * rms);
    }
    Ok(apart)
}

/// Removes the pixels next to the silhouette from both pictures. VTK's volume ends at its last
/// voxels, ours fades over one more. Along an axis, a pixel there is a whole face of the volume
/// seen edge-on.
fn within(mut ours: Picture, mut theirs: Picture) -> (Picture, Picture) {
    let [width, height] = theirs.size.map(i64::from);
    let empty: Vec<bool> = theirs.pixels.iter().map(|[.., through]| *through >= 1.0).collect();
    let at = |x: i64, y: i64| (y * width + x) as usize;
    for y in 0..height {
        for x in 0..width {
            let around = (-BORDER..=BORDER).flat_map(|dy| (-BORDER..=BORDER).map(move |dx| [x + dx, y + dy]));
            let mut inside = around.filter(|[x, y]| (0..width).contains(x) && (0..height).contains(y));
            if inside.any(|[i, j]| empty[at(i, j)] != empty[at(x, y)]) {
                ours.pixels[at(x, y)] = [0.0; 4];
                theirs.pixels[at(x, y)] = [0.0; 4];
            }
        }
    }
    (ours, theirs)
}

/// Times each new view of VTK and of ours, ms.
fn new_views(
    job: &Job,
    volume: &Snapshot,
    ready: &Ready,
    vtk: &mut Vtk,
    [rounds, sides]: [usize; 2],
) -> Result<Vec<Times>, Box<dyn Error>> {
    // Two sides at least, so that each view differs from the one before.
    let sides = sides.max(2);
    let mut ours = Renderer::new(&job.all_settings[0], ready.region)?;
    ours.update_all(volume);
    let mut turns: Vec<Contestant<'_>> = Vec::new();
    turns.push(Box::new(|| (0..sides).rev().map(|side| vtk.ms(&format!("view {side}"))).collect()));
    turns.push(Box::new(|| {
        let mut each = |view_settings: &RenderSettings| -> Result<f64, Box<dyn Error>> {
            let began = Instant::now();
            ours.set_view(view_settings.view)?;
            while !ours.refine(Duration::from_secs(1)).finished {}
            Ok(began.elapsed().as_secs_f64() * 1e3)
        };
        // Starts with the last side, so that each view differs from the one before.
        job.all_settings.iter().take(sides).rev().map(&mut each).collect()
    }));
    timing::interleaved(rounds, &mut turns)
}

/// Times each picture of VTK and of ours after some planes changed, ms; the view is static.
fn changes(
    job: &Job,
    volumes: &[Snapshot; 2],
    axis: usize,
    ready: &Ready,
    vtk: &mut Vtk,
    rounds: usize,
) -> Result<Vec<Times>, Box<dyn Error>> {
    let bricks = volumes[0].bricks_of_planes(axis);
    let mut ours = Renderer::new(&job.all_settings[0], ready.region)?;
    ours.update_all(&volumes[1]);
    vtk.ms("view 0")?;
    let mut turns: Vec<Contestant<'_>> = Vec::new();
    turns.push(Box::new(|| (0..2).map(|_| vtk.ms("change")).collect()));
    turns.push(Box::new(|| {
        let each = |volume: &Snapshot| {
            let began = Instant::now();
            ours.update(volume, &bricks);
            began.elapsed().as_secs_f64() * 1e3
        };
        Ok(volumes.iter().map(each).collect())
    }));
    timing::interleaved(rounds, &mut turns)
}

/// The VTK process.
struct Vtk(Process);

impl Vtk {
    fn start(python: &Path, job: &Path) -> Result<Self, Box<dyn Error>> {
        let script = project().join("scripts/peers/vtk_caster.py");
        // VTK's warnings about a missing display are irrelevant; its errors show as a missing
        // answer.
        let mut process = Process::start("VTK", Command::new(python).arg(script).arg(job), &job.join("vtk.log"))?;
        process.answer()?;
        Ok(Self(process))
    }

    fn ms(&mut self, command: &str) -> Result<f64, Box<dyn Error>> {
        Ok(self.0.ask(command)?.parse()?)
    }

    fn picture(&mut self, path: &Path, size: [u32; 2]) -> Result<Picture, Box<dyn Error>> {
        self.0.ask(&format!("picture {}", path.display()))?;
        let bytes = fs::read(path)?;
        let number = |pair: &[u8]| f32::from(u16::from_ne_bytes([pair[0], pair[1]])) / 32767.0;
        let pixel = |eight: &[u8]| {
            let [r, g, b, a] = [0, 2, 4, 6].map(|at| number(&eight[at..at + 2]));
            [r, g, b, 1.0 - a]
        };
        let pixels: Vec<[f32; 4]> = bytes.chunks_exact(8).map(pixel).collect();
        if pixels.len() != (size[0] * size[1]) as usize {
            return Err(format!("{}: {} pixels", path.display(), pixels.len()).into());
        }
        Ok(Picture { size, pixels })
    }
}
