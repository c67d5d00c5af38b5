//! Figures 9 to 11 of the paper: times of the stages, ray caches, and block sizes.

use std::error::Error;
use std::path::Path;

use sonoweave_figures::{Axis, Figure, Ink, Panel, Series, SeriesStyle};

use render::camera::Camera;
use render::{Cache, Picture, RenderSettings, RenderWork};

use crate::doll::{Doll, Followed};
use crate::incremental::{meeting, within};
use crate::report::Report;
use crate::timing::quantile;

/// Returns the paper's name of a cache.
fn name(cache: Cache) -> &'static str {
    match cache {
        Cache::None => "none",
        Cache::Linear => "linear (LRC)",
        Cache::TwoLevel => "2-level (HRC)",
        Cache::OneLevel => "1-level (HRC)",
    }
}

/// The caches, from the smallest to the largest.
const KEPT: [Cache; 4] = [Cache::None, Cache::OneLevel, Cache::Linear, Cache::TwoLevel];
/// Permitted difference of neighbouring rays with adaptive rays.
const EPSILON: f32 = 2.0 / 255.0;
/// Bytes of a cached sample or block of grey light: colour and opacity, or colour and
/// transmittance.
const ENTRY_BYTES: u64 = 8;
/// Largest size of a block's stale mark, and of a pixel's entries in the tables of its row,
/// bytes.
const MARK_BYTES: u64 = 4;
const TABLE_BYTES: u64 = 16;

/// Draws all three figures.
pub(crate) fn draw(report: &mut Report, folder: &Path, doll: &Doll, rounds: u32) -> Result<(), Box<dyn Error>> {
    let (exact, _) = doll.at_once(&doll.view_settings)?;
    let all_settings = |adaptive| KEPT.map(|cache| RenderSettings { cache, adaptive, ..doll.view_settings.clone() });
    let followed = follow_all(doll, &[all_settings(0.0), all_settings(EPSILON)].concat(), rounds)?;
    let (sparse, _) = doll.at_once(&RenderSettings { adaptive: EPSILON, ..doll.view_settings.clone() })?;
    let (full, adaptive) = followed.split_at(KEPT.len());
    for (exact, followed) in [(&exact, full), (&sparse, adaptive)] {
        for (cache, runs) in KEPT.iter().zip(followed) {
            same_bits(report, exact, runs, name(*cache));
        }
    }
    stages(report, folder, full)?;
    kept(report, folder, [full, adaptive])?;
    memory(report, doll, full)?;
    arity(report, folder, doll, &exact, rounds)
}

/// Runs every setting in every round.
fn follow_all(doll: &Doll, all_settings: &[RenderSettings], rounds: u32) -> Result<Vec<Vec<Followed>>, Box<dyn Error>> {
    let mut followed: Vec<Vec<Followed>> = all_settings.iter().map(|_| Vec::new()).collect();
    for _ in 0..rounds {
        for (view_settings, runs) in all_settings.iter().zip(&mut followed) {
            runs.push(doll.follow(view_settings)?);
        }
    }
    Ok(followed)
}

fn same_bits(report: &mut Report, exact: &Picture, runs: &[Followed], what: &str) {
    let same = runs.iter().all(|run| run.picture == *exact);
    report.check(same, format!("the picture that {what} followed is not the one made at once"));
}

/// Returns the median time of a stage, ms, over all slices of all runs.
fn middle(runs: &[Followed], stage: usize) -> f64 {
    quantile(&runs.iter().flat_map(|run| run.ms.iter().map(|ms| ms[stage])).collect::<Vec<_>>(), 0.5)
}

fn work(runs: &[Followed]) -> RenderWork {
    runs.first().map_or_else(RenderWork::default, |run| run.work)
}

const STAGES: [(&str, Ink); 3] = [("reconstruction", Ink::Green), ("shading", Ink::Orange), ("ray casting", Ink::Blue)];

/// Draws figure 9.
fn stages(report: &mut Report, folder: &Path, followed: &[Vec<Followed>]) -> Result<(), Box<dyn Error>> {
    let panels = [0, KEPT.len() - 1].map(|c| {
        let runs = &followed[c];
        let slices = runs.first().map_or(0, |run| run.ms.len());
        let series = STAGES.iter().enumerate().map(|(stage, (name, ink))| {
            let at = |slice: usize| {
                let ms: Vec<f64> = runs.iter().map(|run| run.ms[slice][stage]).collect();
                [slice as f64 + 1.0, quantile(&ms, 0.5)]
            };
            Series::new(*name, SeriesStyle::Line, *ink, (0..slices).map(at).collect())
        });
        let title = if KEPT[c] == Cache::None { "no ray cache" } else { "2-level ray cache" };
        let x = Axis::linear("slice").from_to(0.0, slices as f64 + 1.0);
        Panel::new(title, x, Axis::log("ms, 1 thread"), series.collect())
    });
    let last = &followed[KEPT.len() - 1];
    let of = |stage| middle(last, stage);
    let dearest = (0..STAGES.len()).max_by(|a, b| of(*a).total_cmp(&of(*b))).map_or("none", |stage| STAGES[stage].0);
    let figure = Figure {
        id: "figure-9-stages",
        title: "Figure 9: the time of each stage, slice by slice".into(),
        caption: format!(
            "From a slice to its picture of 256×256 pixels, one thread, medians of {} runs. The paper adds copies between its virtual processors, which there are none of \
             here. With the 2-level cache the middle slice takes {:.2} ms for reconstruction, {:.2} for shading and {:.2} for rays; the dearest stage is {dearest}.",
            last.len(),
            of(0),
            of(1),
            of(2)
        ),
        columns: 2,
        height: 230.0,
        panels: panels.into(),
    };
    report.figure(figure, folder)
}

/// Draws figure 10.
fn kept(report: &mut Report, folder: &Path, [full, adaptive]: [&[Vec<Followed>]; 2]) -> Result<(), Box<dyn Error>> {
    let names = || KEPT.map(name).into_iter().flat_map(|name| [name.to_owned(), format!("{name}, adaptive")]);
    let all = || full.iter().zip(adaptive).flat_map(|(full, adaptive)| [full, adaptive]);
    let stages = STAGES.iter().enumerate().map(|(stage, (name, ink))| {
        let heights: Vec<f64> = all().map(|runs| middle(runs, stage)).collect();
        Series::bars(*name, *ink, &heights)
    });
    let counted = |of: fn(RenderWork) -> u64| -> Vec<f64> {
        let each =
            |runs: &Vec<Followed>| of(work(runs)) as f64 / runs.first().map_or(1, |run| run.ms.len()) as f64 / 1e3;
        all().map(each).collect()
    };
    let (sampled, folded) = (counted(|work| work.samples), counted(|work| work.blocks_folded + work.blocks_resolved));
    let [none, one, linear, two] = [0, 1, 2, 3].map(|c| work(&full[c]).samples);
    report.check(two == linear, "C13: what two levels and one line keep is not sampled alike");
    report.check(linear < one && one < none, "C14: who keeps more samples more");
    for (kept, (full, adaptive)) in KEPT.iter().zip(full.iter().zip(adaptive)) {
        let [full, adaptive] = [full, adaptive].map(|runs| work(runs).rays);
        report.check(adaptive < full, format!("C14: {} casts {adaptive} rays adaptively, {full} else", name(*kept)));
    }
    let [plain, sparse] = [full, adaptive].map(|followed| [0, 1, 2, 3].map(|c| middle(&followed[c], 2)));
    let part = |ms: f64| 100.0 * ms / plain[0];
    let figure = Figure {
        id: "figure-10-caches",
        title: "Figure 10: what is kept of rays, and adaptive rays".into(),
        caption: format!(
            "The middle slice, one thread; adaptive rays with ε = 2/255. Of the time of rays that are cast whole where a slice reaches them, ray casting takes {:.0} % with one \
             level, {:.0} % with samples alone, {:.0} % with two levels; with adaptive rays besides {:.0}, {:.0} and {:.0} %, and {:.0} % with these alone. The paper has 70 % with two \
             levels and adaptive rays together, and hardly a gain with one level. Every picture is the bits of one made at once.",
            part(plain[1]),
            part(plain[2]),
            part(plain[3]),
            part(sparse[1]),
            part(sparse[2]),
            part(sparse[3]),
            part(sparse[0])
        ),
        columns: 1,
        height: 190.0,
        panels: vec![
            Panel::new(
                "time of each stage",
                Axis::categories("", names()),
                Axis::linear("ms a slice"),
                stages.collect(),
            ),
            Panel::new(
                "work of ray casting",
                Axis::categories("", names()),
                Axis::linear("thousands a slice"),
                vec![
                    Series::bars("samples interpolated", Ink::Purple, &sampled),
                    Series::bars("blocks folded", Ink::Vermilion, &folded),
                ],
            ),
        ],
    };
    report.claim(
        ["C14", "2-level cache and adaptive rays cut ray casting by 30 %", "30 %; 1-level “did not gain much”; half of the best case is resampling"],
        format!(
            "of {:.1} ms {:.0} % with 2 levels, {:.0} % with 1 level, {:.0} % with adaptive rays alone, {:.0} % with these and 2 levels; samples {none} → {two} with 2 levels, {} with both",
            plain[0],
            part(plain[3]),
            part(plain[1]),
            part(sparse[0]),
            part(sparse[3]),
            work(&adaptive[3]).samples
        ),
        plain[3].min(sparse[3]) <= 0.7 * plain[0],
        [if sparse[3] < plain[3] { "surpassed" } else { "surpassed by the cache alone" }, "not reached in this run"],
    );
    report.figure(figure, folder)
}

/// C13: compares the memory of each cache with the formula.
fn memory(report: &mut Report, doll: &Doll, followed: &[Vec<Followed>]) -> Result<(), Box<dyn Error>> {
    let bytes: Vec<u64> = followed.iter().filter_map(|runs| Some(runs.first()?.memory.rays)).collect();
    let arity = followed.first().and_then(|runs| Some(u64::from(runs.first()?.arity))).ok_or("nothing was followed")?;
    let [none, one, linear, two] = bytes[..] else { return Err("four caches are followed".into()) };
    let camera = Camera::new(&doll.view_settings.view, doll.view_settings.size, doll.view_settings.step, &doll.region)?;
    // Samples reach one voxel beyond the region's, where it fades.
    let [rays, samples] = meeting(&camera, within(&doll.region, 1.01));
    let [width, height] = doll.view_settings.size.map(u64::from);
    // Two bits a block say what must be done again, in whole words a ray.
    let words = u64::from(camera.samples()).div_ceil(arity).div_ceil(u64::from(u64::BITS));
    let tables = (TABLE_BYTES + 2 * size_of::<u64>() as u64 * words) * width * height;
    // N samples lie in N/p blocks, plus parts of two more if they do not begin and end with one.
    let blocks = [samples / arity, samples / arity + 2 * rays];
    let marks = MARK_BYTES * blocks[1];
    for (what, found, [least, most]) in [
        ("linear", linear - none, [ENTRY_BYTES * (samples - rays), ENTRY_BYTES * (samples + rays) + tables + marks]),
        ("1-level", one - none, [ENTRY_BYTES * blocks[0], ENTRY_BYTES * blocks[1] + tables + marks]),
        ("2-level", two - linear, [ENTRY_BYTES * blocks[0], ENTRY_BYTES * blocks[1] + tables + marks]),
    ] {
        report.check(
            (least..=most).contains(&found),
            format!("C13: {what} takes {found} bytes, not {least} to {most} for {samples} samples of {rays} rays in blocks of {arity}"),
        );
    }
    let mb = |bytes: u64| bytes as f64 / 1e6;
    report.checked_claim(
        ["C13", "linear: N samples; 2-level: N + N/p; 1-level: N/p, p resampled for one", "three schemes, N from 16 to 256"],
        format!(
            "{samples} samples of {rays} rays in blocks of {arity}: {:.1} MB, {:.1} and {:.2} MB; the formula has {:.1}, {:.1} and {:.2}, ends of rays and tables apart; all pictures \
             the same bits",
            mb(linear - none),
            mb(two - none),
            mb(one - none),
            mb(ENTRY_BYTES * samples),
            mb(ENTRY_BYTES * (samples + samples / arity)),
            mb(ENTRY_BYTES * samples / arity)
        ),
        "confirmed, and made exact",
    );
    Ok(())
}

/// Block sizes that are tried, samples.
const ARITIES: [u32; 9] = [1, 2, 4, 8, 16, 32, 64, 128, 256];

/// Draws figure 11.
fn arity(report: &mut Report, folder: &Path, doll: &Doll, exact: &Picture, rounds: u32) -> Result<(), Box<dyn Error>> {
    let mut panels = Vec::new();
    let (mut times, mut counts) = (Vec::new(), Vec::new());
    let mut best = [0; 2];
    let (mut usual, mut length) = (0, 0.0);
    for (c, (cache, view_settings, ink)) in
        [(Cache::TwoLevel, SeriesStyle::Discs, Ink::Blue), (Cache::OneLevel, SeriesStyle::Squares, Ink::Vermilion)]
            .into_iter()
            .enumerate()
    {
        // A different block size changes the bits of a picture, by rounding: each is compared
        // with its own.
        let all_settings: Vec<RenderSettings> =
            ARITIES.iter().map(|p| RenderSettings { cache, arity: Some(*p), ..doll.view_settings.clone() }).collect();
        let followed = follow_all(doll, &all_settings, rounds)?;
        for (view_settings, runs) in all_settings.iter().zip(&followed) {
            let (own, _) = doll.at_once(view_settings)?;
            same_bits(report, &own, runs, &format!("{} of {:?} samples", name(cache), view_settings.arity));
            // Each ray may end up to a block later, and so differ by up to the stop threshold.
            let [most, _] = own.difference(exact);
            report.check(most <= f64::from(view_settings.stop) + 1e-5, format!("C13: {most} between arities"));
        }
        let operations = |runs: &[Followed], p: u32| {
            let work = work(runs);
            let kept = if cache == Cache::TwoLevel { work.blocks_resolved * u64::from(p) } else { 0 };
            (work.samples + kept + work.blocks_folded) as f64 / work.rays.max(1) as f64
        };
        let points: Vec<[f64; 3]> = ARITIES
            .iter()
            .zip(&followed)
            .map(|(p, runs)| [f64::from(*p), middle(runs, 2), operations(runs, *p)])
            .collect();
        let least = points.iter().min_by(|a, b| a[2].total_cmp(&b[2])).copied().unwrap_or([f64::NAN; 3]);
        best[c] = least[0] as u32;
        let line = |y: usize| points.iter().map(|p| [p[0], p[y]]).collect::<Vec<_>>();
        for (series, y) in [(&mut times, 1), (&mut counts, 2)] {
            series.push(Series::new(name(cache), SeriesStyle::Line, ink, line(y)).unlisted());
            series.push(Series::new(name(cache), view_settings, ink, line(y)));
        }
        if cache == Cache::TwoLevel {
            let mut plain = render::Renderer::new(&doll.view_settings, doll.region)?;
            plain.update_all(doll.whole.volume());
            usual = plain.arity();
            length = f64::from(plain.samples());
        }
    }
    let x = || Axis::log("samples of a block, p").from_to(0.8, 320.0);
    panels.push(Panel::new("ray casting", x(), Axis::linear("ms a slice"), times));
    panels.push(Panel::new("counted", x(), Axis::log("operations a ray"), counts));
    let root = length.sqrt();
    let near = |p: u32| (0.25..=4.0).contains(&(f64::from(p) / root));
    report.check(near(best[0]), format!("C15: two levels count least at {} of √{length}", best[0]));
    let figure = Figure {
        id: "figure-11-arity",
        title: "Figure 11: samples of a block".into(),
        caption: format!(
            "Ray casting of the middle slice, one thread. Rays have up to N = {length} samples; √N = {root:.0}. With two levels the operations (samples interpolated, folds of \
             samples and of blocks) are fewest at p = {}, with one level at {}; by default p = {usual}, the power of two nearest to √N, on every machine: which p is fastest is never tried out at run \
             time, because the picture's last bits depend on it.",
            best[0], best[1]
        ),
        columns: 2,
        height: 230.0,
        panels,
    };
    report.claim(
        ["C15", "there is an optimal arity", "depends on support width and machine; figure 11"],
        format!(
            "2 levels: fewest operations at p = {}, √N = {root:.0}; 1 level: at {}; default {usual}",
            best[0], best[1]
        ),
        near(best[0]),
        ["confirmed, flat around √N", "elsewhere"],
    );
    report.figure(figure, folder)
}
