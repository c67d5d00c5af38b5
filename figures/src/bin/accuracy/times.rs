//! Times of insertion with the methods on, as multiples of those without. They are reported and not
//! checked, as other work on the machine changes them.

use std::error::Error;
use std::thread::available_parallelism;

use glam::DVec3;
use serde_json::{Map, Value, json};

use phantom::scene::{Blobs, Scene};
use phantom::{Motion, Scan, ScanSettings};
use reconstruct::kernel::Method;
use reconstruct::{Reconstructor, Settings};
use sync::smoothing::Smoothing;

use crate::poses;
use crate::report::{Report, digits, markdown};
use crate::smoothing::LIVE;
use crate::sweep::Sweep;
use crate::timing::{Contestant, each, interleaved};
use crate::tracker::Noise;

/// Slices of a run.
const FRAMES: u32 = 80;
/// Runs of each contestant, and of a quick comparison.
const ROUNDS: [usize; 2] = [15, 3];

/// The methods compared: their names, the kernel, whether standard errors are kept, and smoothing
/// of the poses.
const CONTESTANTS: [(&str, Method, bool, Option<Smoothing>); 4] = [
    ("none", Method::GaussianTruncated, false, None),
    ("fourth order", Method::Gaussian4, false, None),
    ("standard errors", Method::GaussianTruncated, true, None),
    ("standard errors, smoothed poses", Method::GaussianTruncated, true, Some(LIVE)),
];

/// Times the slices of a sweep with each method, in turns: the pose of a frame, and its insertion.
///
/// # Errors
/// If a slice is refused, or a frame has no pose.
pub(crate) fn compare(
    hand: &Sweep,
    is_quick: bool,
    report: &mut Report,
    figures: &mut Map<String, Value>,
) -> Result<(), Box<dyn Error>> {
    let scan = Scan::new(ScanSettings {
        scene: Scene::Blobs(Blobs::draw(1)),
        motion: Motion::Freehand,
        frames: FRAMES,
        gap_mm: 0.35,
        image_size: [512, 480],
        pixel_mm: [0.1; 2],
        noise_sd: 6.0,
        ..ScanSettings::default()
    })?;
    let (slices, measured) = (scan.slices(0..FRAMES), Noise::white(0.3).measured(hand, 1));
    let mut lines = Vec::new();
    for (sharing, threads) in [("one thread", 1), ("all threads", available_parallelism()?.get())] {
        let contestant = |(_, method, standard_error, smoothing)| -> Contestant<'_> {
            let usual = Settings { threads, ..Settings::new(DVec3::splat(0.3)) };
            let settings = Settings { method, standard_error, sigma_mm: [Some(0.3); 3], ..usual };
            let (mask, slices, measured) = (scan.mask(), &slices, &measured);
            Box::new(move || {
                let mut volume = Reconstructor::new(settings.clone(), mask.clone())?;
                let inserted = each(slices, |slice| volume.insert(slice).map(drop))?;
                let posed = poses::times(smoothing, hand, measured)?;
                Ok(inserted.iter().zip(posed).map(|(inserted, posed)| inserted + posed).collect())
            })
        };
        let all = interleaved(ROUNDS[usize::from(is_quick)], &mut CONTESTANTS.map(contestant))?;
        for ((name, ..), times) in CONTESTANTS.iter().zip(&all) {
            let mut line = vec![sharing.to_owned(), (*name).to_owned()];
            for (what, q) in [("median", 0.5), ("99th percentile", 0.99)] {
                let [low, middle, high] = times.over_at(q, &all[0]);
                let key = format!("times/{sharing}/{name}/{what}");
                figures.insert(format!("{key}, ms"), json!(times.quantile(q)));
                figures.insert(format!("{key}, ×"), json!(middle));
                line.push(digits(times.quantile(q), 3));
                line.push(format!("{low:.2}, {middle:.2}, {high:.2}"));
            }
            lines.push(line);
        }
    }
    println!("insertion times");
    let columns = ["threads", "methods", "median, ms", "× of none", "99th percentile, ms", "× of none"];
    report.section(format!(
        "# Times of a slice\n\nPose and insertion of 512×480 pixels of 0.1 mm into voxels of 0.3 mm, σ 0.3 mm. \
         Multiples: quartiles over {} runs of {FRAMES} slices, in turns.\n\n{}",
        ROUNDS[usize::from(is_quick)],
        markdown(&columns, &lines)
    ));
    Ok(())
}
