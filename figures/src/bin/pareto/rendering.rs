//! Pictures: ms against error, by ray cache, ray termination, step length and block size of
//! compositing.
//!
//! The paper's test size: most of 90 slices of 128² are inserted first. Then the others follow
//! one by one, and the picture of 128×128×256 voxels is updated after each. Errors are those of
//! the picture before these followed, against the equations in f64 with a step finer than any
//! contestant's.

use std::error::Error;
use std::fs;
use std::ops::Range;
use std::path::Path;
use std::time::Duration;

use sonoweave_figures::{Figure, Ink, Panel, Series, SeriesStyle};

use reconstruct::PathReconstructor;
use render::classify::transfer::Transfer;
use render::reference::{self, ReferencePicture};
use render::settings::{STOP, usual_arity};
use render::{Cache, Picture, RenderRegion, RenderSettings, Renderer, Updated};

use crate::doll::{Doll, SLICES, show};
use crate::front::{SLACK, front};
use crate::pictures::{axis, range, steps};
use crate::report::{Report, digits, markdown};
use crate::timing::{Contestant as Turn, interleaved, quantile};

/// Step lengths in voxels: of the reference, and of the contestants.
const FINEST: f64 = 0.25;
const STEPS: [f64; 3] = [0.5, 1.0, 2.0];
const STOPS: [f32; 3] = [0.0, 1e-3, 1e-2];
/// ε of adaptive rays, besides 0.
const EPSILONS: [f32; 3] = [1.0 / 255.0, 2.0 / 255.0, 8.0 / 255.0];
const ARITIES: [u32; 5] = [4, 8, 16, 32, 64];

/// Extent of a run.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Extent {
    pub(crate) rounds: usize,
    /// Slices that follow.
    pub(crate) followed: u32,
    /// Pixels along a side.
    pub(crate) side: u32,
    /// Whether all combinations are tried.
    pub(crate) whole: bool,
}

/// Settings of a rendering.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Way {
    cache: Cache,
    stop: f32,
    step: f64,
    /// `None` for the default.
    arity: Option<u32>,
    /// ε of adaptive rays; 0 casts all.
    epsilon: f32,
}

impl Way {
    const DEFAULT: Self = Self { cache: Cache::OneLevel, stop: STOP, step: 1.0, arity: None, epsilon: 0.0 };

    fn name(&self) -> String {
        let arity = self.arity.map_or_else(|| "usual".into(), |p| p.to_string());
        let stop = digits(f64::from(self.stop), 2);
        let rays = match self.epsilon > 0.0 {
            true => format!(", ε {:.0}/255", 255.0 * self.epsilon),
            false => String::new(),
        };
        format!("{}, p {arity}, stop {stop}, step {}{rays}", self.cache.name(), self.step)
    }

    fn of(self, view_settings: &RenderSettings) -> RenderSettings {
        let Self { cache, stop, step, arity, epsilon: adaptive } = self;
        RenderSettings { cache, stop, step, arity, adaptive, ..view_settings.clone() }
    }

    /// Returns all settings, the default first.
    fn all(whole: bool) -> Vec<Self> {
        let default = Self::DEFAULT;
        let mut ways = vec![default];
        if !whole {
            let others = Cache::ALL.into_iter().filter(|cache| *cache != default.cache);
            ways.extend(others.map(|cache| Self { cache, ..default }));
            ways.extend([0.5, 2.0].map(|step| Self { step, ..default }));
            ways.extend([0.0, 1e-2].map(|stop| Self { stop, ..default }));
            ways.extend([4, 64].map(|p| Self { arity: Some(p), ..default }));
            ways.push(Self { epsilon: EPSILONS[1], ..default });
            return ways;
        }
        for step in STEPS {
            for stop in STOPS {
                for cache in Cache::ALL {
                    // A cache that does not reuse blocks depends on the block size only by where
                    // rays end.
                    let folds = matches!(cache, Cache::TwoLevel | Cache::OneLevel);
                    let arities = if folds { &ARITIES[..] } else { &ARITIES[2..3] };
                    ways.extend(arities.iter().map(|p| Self { cache, stop, step, arity: Some(*p), epsilon: 0.0 }));
                    ways.extend(EPSILONS.map(|epsilon| Self { cache, stop, step, arity: None, epsilon }));
                }
            }
        }
        ways
    }
}

/// The scan, in two parts.
struct FollowedVolume {
    doll: Doll,
    /// The slices that follow: from the middle, where most is visible.
    followed: Range<usize>,
}

impl FollowedVolume {
    fn new(followed: u32) -> Result<Self, Box<dyn Error>> {
        let first = (SLICES - followed) / 2;
        Ok(Self { doll: Doll::new(SLICES)?, followed: first as usize..(first + followed) as usize })
    }

    /// Returns the volume without the slices that follow.
    fn begun(&self) -> Result<PathReconstructor, Box<dyn Error>> {
        let mut reconstructor = self.doll.reconstructor(1)?;
        let Range { start, end } = self.followed;
        for slice in self.doll.slices[..start].iter().chain(&self.doll.slices[end..]) {
            reconstructor.insert(slice)?;
        }
        Ok(reconstructor)
    }

    /// Returns for each following slice the time of shading and rays, and of rays alone; then
    /// the time of the first picture, ms.
    fn follow(&self, settings: &RenderSettings) -> Result<[Vec<f64>; 3], Box<dyn Error>> {
        let (mut reconstructor, mut renderer) = (self.begun()?, Renderer::new(settings, self.doll.region)?);
        let ms = |took: Duration| took.as_secs_f64() * 1e3;
        let Updated { shade, rays, .. } = renderer.update_all(reconstructor.volume());
        let mut found = [Vec::new(), Vec::new(), vec![ms(shade + rays)]];
        for slice in &self.doll.slices[self.followed.clone()] {
            let touched = reconstructor.insert(slice)?;
            let Updated { shade, rays, .. } = show(&mut renderer, &reconstructor, &touched);
            found[0].push(ms(shade + rays));
            found[1].push(ms(rays));
        }
        Ok(found)
    }
}

/// Times of some settings, and the picture's deviation from the equations.
struct Row {
    way: Way,
    /// Time per slice, of its rays alone, and of a new view.
    ms: [f64; 3],
    /// Root mean square and maximum, grey levels of 255.
    error: [f64; 2],
}

/// Judges and times all settings over a thin and a dense scene.
///
/// # Errors
/// If a file cannot be written.
pub(crate) fn measure(extent: Extent, report: &mut Report, folder: &Path) -> Result<(), Box<dyn Error>> {
    let scene = FollowedVolume::new(extent.followed)?;
    let mut csv =
        String::from("preset,cache,arity,stop,step_voxels,epsilon,ms_slice,ms_slice_rays,ms_new_view,rms,max\n");
    let (mut panels, mut lines) = (Vec::new(), Vec::new());
    for (preset, title) in [("phantom", "bodies in clear water"), ("xray", "everything visible")] {
        let transfer = Transfer::preset(preset, [0.0, 255.0])?;
        let view_settings = RenderSettings { size: [extent.side; 2], transfer, ..scene.doll.view_settings.clone() };
        let rows = rows(&scene, &view_settings, extent, preset, report)?;
        for Row { way, ms, error } in &rows {
            let arity = way.arity.map_or_else(|| "usual".into(), |p| p.to_string());
            let numbers = [ms[0], ms[1], ms[2], error[0], error[1]].map(|x| x.to_string()).join(",");
            csv +=
                &format!("{preset},{},{arity},{},{},{},{numbers}\n", way.cache.name(), way.stop, way.step, way.epsilon);
        }
        for (which, name) in ["a slice", "a slice, rays alone", "a new view"].into_iter().enumerate() {
            panels.push(panel(&rows, which, title, &format!("ms {name}")));
            lines.push(verdict(&rows, which, name, title));
        }
    }
    fs::write(folder.join("rendering.csv"), csv)?;
    report.section(format!(
        "## Pictures: run time against error\n\n128×128×256 voxels, {0}×{0} pixels, one thread. Errors are against the equations in f64 with a step of {FINEST} voxels, root mean square \
         over colours and transmittance, grey levels of 255; ms are shading and rays of the middle slice, its rays alone, and both of a whole new view. The default keeps two levels, ends rays at {1} \
         and samples every voxel.\n\n{2}",
        extent.side,
        digits(f64::from(STOP), 2),
        markdown(&["measure", "front, from the fastest", "default: ms, RMSE", "its place"], &lines)
    ));
    let figure = Figure {
        id: "rendering",
        title: "Pictures: run time against error".into(),
        caption: "One thread; the line is the Pareto front. Where rays end at a thousandth or later the step decides the error: half a voxel, one, two from below. What is kept of rays changes no bit of a picture, only its \
                  time; where rays end, and the samples of a block after which they may, moves the error by less than the stop. Adaptive rays with ε from 1 to 8 of 255."
            .into(),
        columns: 3,
        height: 190.0,
        panels,
    };
    report.findings.figure(figure, folder)
}

fn rows(
    scene: &FollowedVolume,
    view_settings: &RenderSettings,
    extent: Extent,
    preset: &str,
    report: &mut Report,
) -> Result<Vec<Row>, Box<dyn Error>> {
    let begun = scene.begun()?;
    let fine = RenderSettings { step: FINEST, ..view_settings.clone() };
    let exact = reference::render(begun.volume(), &fine, &scene.doll.region)?;
    let ways = Way::all(extent.whole);
    let mut rows = Vec::new();
    let mut pictures: Vec<Picture> = Vec::new();
    for way in &ways {
        let (picture, samples) = made(&begun, way.of(view_settings), scene.doll.region)?;
        judge(way, &picture, samples, &ways[..pictures.len()], &pictures, &format!("{preset}, {}", way.name()), report);
        let [most, rms] = exact.difference(&picture).map(|d| 255.0 * d);
        report.findings.check(rms < 4.0, format!("{preset}, {}: {rms} grey levels rms from f64", way.name()));
        rows.push(Row { way: *way, ms: [f64::NAN; 3], error: [rms, most] });
        pictures.push(picture);
    }
    let of_step = |step: f64| {
        let alike = move |row: &&Row| row.way.step == step && row.way.stop <= STOPS[1] && row.way.epsilon == 0.0;
        rows.iter().filter(alike).map(|row| row.error[0])
    };
    for pair in STEPS.windows(2) {
        let (fine, coarse) = (of_step(pair[0]).fold(0.0, f64::max), of_step(pair[1]).fold(f64::INFINITY, f64::min));
        report
            .findings
            .check(fine <= coarse, format!("{preset}: {fine} with a step of {}, {coarse} with {}", pair[0], pair[1]));
    }
    against_own_equations(&begun, view_settings, &pictures, scene.doll.region, preset, report)?;
    let mut all: Vec<[Vec<f64>; 3]> = ways.iter().map(|_| Default::default()).collect();
    let mut turns: Vec<Turn<'_>> = Vec::new();
    for (way, all) in ways.iter().zip(&mut all) {
        turns.push(Box::new(move || {
            let found = scene.follow(&way.of(view_settings))?;
            all.iter_mut().zip(&found).for_each(|(all, found)| all.extend(found));
            Ok(found[0].clone())
        }));
    }
    interleaved(extent.rounds, &mut turns)?;
    drop(turns);
    for (row, all) in rows.iter_mut().zip(&all) {
        row.ms = all.each_ref().map(|all| quantile(all, 0.5));
    }
    Ok(rows)
}

/// Returns the picture for some settings, and the number of samples per ray.
fn made(
    begun: &PathReconstructor,
    settings: RenderSettings,
    region: RenderRegion,
) -> Result<(Picture, u32), Box<dyn Error>> {
    let mut renderer = Renderer::new(&settings, region)?;
    renderer.update_all(begun.volume());
    Ok((renderer.picture(), renderer.samples()))
}

/// Checks pictures. They must be bit-identical for different caches. For different ray
/// termination, they may differ by the stop, if all rays are cast.
fn judge(
    way: &Way,
    picture: &Picture,
    samples: u32,
    before: &[Way],
    pictures: &[Picture],
    what: &str,
    report: &mut Report,
) {
    let arity = |way: &Way| way.arity.unwrap_or_else(|| usual_arity(samples));
    for (other, theirs) in
        before.iter().zip(pictures).filter(|(other, _)| other.step == way.step && other.epsilon == way.epsilon)
    {
        if arity(other) == arity(way) && other.stop == way.stop {
            report.findings.check(picture == theirs, format!("{what}: other bits than {}", other.name()));
        } else if way.epsilon == 0.0 {
            let [most, _] = picture.difference(theirs);
            let stop = f64::from(way.stop.max(other.stop));
            report.findings.check(most <= stop + 1e-4, format!("{what}: {most} from {}", other.name()));
        }
    }
}

/// Compares the default's picture with the equations at its own step: this shows the arithmetic,
/// and the part behind the rays' ends.
fn against_own_equations(
    begun: &PathReconstructor,
    view_settings: &RenderSettings,
    pictures: &[Picture],
    region: RenderRegion,
    preset: &str,
    report: &mut Report,
) -> Result<(), Box<dyn Error>> {
    let own: ReferencePicture = reference::render(begun.volume(), view_settings, &region)?;
    let default = pictures.first().ok_or("the default comes first")?;
    let [most, _] = own.difference(default);
    report.findings.check(most <= 1.0 / 255.0, format!("{preset}: the default is {most} from its equations"));
    Ok(())
}

fn points(rows: &[Row], which: usize) -> Vec<[f64; 2]> {
    rows.iter().map(|row| [row.ms[which], row.error[0]]).collect()
}

fn panel(rows: &[Row], which: usize, title: &str, label: &str) -> Panel {
    let all = points(rows, which);
    let [x, y] = [0, 1].map(|c| range(all.iter().map(|p| p[c])));
    let mut series = vec![Series::new("Pareto front", SeriesStyle::Line, Ink::Grey, steps(&all, x, 2.0 * y[1]))];
    for (cache, view_settings, ink) in [
        (Cache::None, SeriesStyle::Crosses, Ink::Grey),
        (Cache::Linear, SeriesStyle::Squares, Ink::Green),
        (Cache::OneLevel, SeriesStyle::Squares, Ink::Vermilion),
        (Cache::TwoLevel, SeriesStyle::Discs, Ink::Blue),
    ] {
        let of =
            |(row, _): &(&Row, &[f64; 2])| row.way.cache == cache && row.way.epsilon == 0.0 && row.way != Way::DEFAULT;
        let marks = rows.iter().zip(&all).filter(of).map(|(_, point)| *point).collect();
        let name = if cache == Cache::None { "no" } else { cache.name() };
        series.push(Series::new(format!("{name} cache"), view_settings, ink, marks));
    }
    let sparse = rows.iter().zip(&all).filter(|(row, _)| row.way.epsilon > 0.0).map(|(_, point)| *point).collect();
    series.push(Series::new("adaptive rays, any cache", SeriesStyle::Triangles, Ink::Purple, sparse));
    series.push(Series::new("default configuration", SeriesStyle::Triangles, Ink::Black, all[..1].to_vec()));
    Panel::new(title, axis(label, x), axis("RMSE, grey levels", y), series)
}

/// Reports the front, and the default's position.
fn verdict(rows: &[Row], which: usize, name: &str, title: &str) -> Vec<String> {
    let all = points(rows, which);
    let shown = |place: &usize| {
        format!("{} ({} ms, {})", rows[*place].way.name(), digits(all[*place][0], 3), digits(all[*place][1], 3))
    };
    let [ms, error] = all[0];
    let mut rivals: Vec<usize> = (1..all.len())
        .filter(|i| {
            let [time, off] = [all[*i][0] / ms, all[*i][1] / error];
            // A way that equals the default except for single bits is not better.
            time <= 1.0 && off <= 1.0 + 1e-3 && (time < 1.0 - SLACK || off < 1.0 - SLACK)
        })
        .collect();
    rivals.sort_by(|a, b| (all[*a][0] * all[*a][1]).total_cmp(&(all[*b][0] * all[*b][1])));
    let place = match rivals.first() {
        None => "on the front".to_owned(),
        Some(best) => format!("beaten by {}: best is {}", rivals.len(), shown(best)),
    };
    // A point whose error hardly differs from that of a faster one is not listed.
    let mut least = f64::INFINITY;
    let mut lines = front(&all);
    lines.retain(|place| {
        let better = all[*place][1] < (1.0 - SLACK) * least;
        least = if better { all[*place][1] } else { least };
        better
    });
    vec![
        format!("{name}, {title}"),
        lines.iter().map(shown).collect::<Vec<_>>().join("; "),
        format!("{}, {}", digits(ms, 3), digits(error, 3)),
        place,
    ]
}
