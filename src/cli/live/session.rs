//! A session: the bedside's devices through the pipeline, and what is left of it.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use calibration::arm::{Arm, JOINTS};
use clap::Args;
use drivers::clock::{Clock, Monotonic};
use drivers::recording::session::{Crop, SessionWriter, WriterOptions};
use glam::DQuat;
use serde::Serialize;

use crate::cli::Failure;
use crate::cli::input;
use crate::cli::render::check_png;
use crate::cli::render::drawing::Over;
use crate::config::bedside::devices::{PROBE_FRAME, TRACKER_FRAME};
use crate::config::bedside::{Bedside, Picture, Tracking};
use crate::devices::{self, Devices};
use crate::export::volume::{DenseBox, Encoding, Scalar, write_values, write_weights};
use crate::ingest::live::Gives;
use crate::pipeline::live::{Account, Equipment, Finished, First, Looks, Quantiles, Record, Session, run};
use crate::pipeline::{Outcome, PixelKind};
use crate::render::RenderSettings;
use crate::statistics::write_json;
use crate::sync::history::Rigid;

/// What a session leaves, and how long it is.
#[derive(Debug, Args)]
pub(super) struct Outputs {
    /// A folder to record the session in; it is made if it is not there [default: the configuration's, or nowhere]
    #[arg(long, value_name = "DIR", requires = "config")]
    record: Option<PathBuf>,
    /// Ends the session after so many seconds [default: when it is told to end, by Ctrl-C or SIGTERM]
    #[arg(long, value_name = "S", requires = "config")]
    duration: Option<f64>,
    /// Where to write the volume at the end (.mha)
    #[arg(long, value_name = "VOL.mha", requires = "config")]
    volume: Option<PathBuf>,
    /// Where to write its weights (.mha)
    #[arg(long, value_name = "W.mha", requires = "config")]
    weights: Option<PathBuf>,
    /// Where to write the picture at the end
    #[arg(long, value_name = "IMG.png", requires = "config")]
    picture: Option<PathBuf>,
    /// Where to write what became of every frame, how each device was and how long things took, as JSON
    #[arg(long, value_name = "FILE.json", requires = "config")]
    stats: Option<PathBuf>,
    /// Says nothing on the way
    #[arg(long, requires = "config")]
    quiet: bool,
}

impl Looks for Picture {
    fn settings(&self, first: &First) -> Result<RenderSettings, Box<dyn std::error::Error + Send + Sync>> {
        Picture::settings(self, first.slice_axes)
            .map_err(|unfit| format!("picture.{}: {}", unfit.setting, unfit.problem).into())
    }
}

impl Outputs {
    fn check(&self) -> Result<(), Failure> {
        for path in [&self.volume, &self.weights].into_iter().flatten() {
            if path.extension().is_none_or(|e| !e.eq_ignore_ascii_case("mha")) {
                return Err(Failure(format!("{}: volumes are written as .mha; give such a name", path.display())));
            }
            input::check_output(path)?;
        }
        if let Some(path) = &self.picture {
            check_png(path)?;
            input::check_output(path)?;
        }
        if let Some(path) = &self.stats {
            input::check_output(path)?;
        }
        if let Some(seconds) = self.duration.filter(|seconds| !(0.1..=1e6).contains(seconds)) {
            return Err(Failure(format!("--duration {seconds}: must be 0.1 to 1000000 seconds")));
        }
        Ok(())
    }
}

/// Runs a session.
///
/// # Errors
/// [`Failure`] when it cannot begin, or what it leaves cannot be written.
pub(super) fn session(bedside: &Bedside, outputs: &Outputs) -> Result<(), Failure> {
    outputs.check()?;
    let ends = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        signal_hook::flag::register(signal, Arc::clone(&ends))?;
    }
    let folder = outputs.record.as_ref().or(bedside.record.folder.as_ref());
    let Devices { tracking, grabber, twins } = devices::open(bedside, Monotonic.now_ns(), folder.is_some())?;
    let record = folder.map(|folder| of_recording(bedside, folder)).transpose()?;
    if let (Some(record), false) = (&record, outputs.quiet) {
        say(&format!("recorded in {}", record.writer.path().display()));
    }
    let (gives, frames) = of_tracking(bedside)?;
    let equipment = vec![
        Equipment {
            name: "tracking".into(),
            device: tracking,
            gives,
            frames,
            latency_ns: bedside.tracking.latency_ns(),
            speech: None,
        },
        Equipment {
            name: "grabber".into(),
            device: grabber,
            gives: Gives::Pictures,
            frames: Vec::new(),
            latency_ns: bedside.grabber.latency_ns,
            speech: None,
        },
    ];
    let session = Session {
        equipment,
        pairing: bedside.pairing_options(),
        wait_ns: bedside.pairing.wait_ns,
        longest_gap_ns: bedside.pairing.longest_gap_ns,
        frozen_ns: bedside.scanner.frozen_ns,
        mask: bedside.mask,
        settings: bedside.volume.settings.clone(),
        path: bedside.volume.path,
        planar: bedside.volume.planar,
        looks: outputs.picture.is_some().then_some(&bedside.picture),
        record,
    };
    let began = Instant::now();
    let mut said = Instant::now();
    let finished = run(session, &Monotonic, &ends, |account| {
        if outputs.duration.is_some_and(|seconds| began.elapsed() >= Duration::from_secs_f64(seconds)) {
            ends.store(true, Ordering::Relaxed);
        }
        if !outputs.quiet && said.elapsed() >= Duration::from_secs(2) {
            said = Instant::now();
            say(&line(account));
        }
    })?;
    drop(twins);
    leave(bedside, outputs, &finished, began.elapsed())
}

fn of_tracking(bedside: &Bedside) -> Result<(Gives, Vec<[String; 2]>), Failure> {
    let to_tracker = |frame: &str| [frame.to_owned(), TRACKER_FRAME.to_owned()];
    match &bedside.tracking {
        Tracking::Tracker(tracker) => {
            let (stations, frames) = tracker.roles.all().map(|(station, frame)| (station, to_tracker(frame))).unzip();
            Ok((Gives::Stations(stations), frames))
        }
        Tracking::Arm(_) => {
            let Some(arm) = bedside.calibration.arm.clone() else {
                return Err(Failure(
                    "the calibration has no [[arm.joint]]: without lengths and zeros counts lead nowhere; give a calibration file that has them".into(),
                ));
            };
            let kinematics = move |counts: &[f64]| placed(&arm, counts);
            Ok((Gives::Arm { joints: JOINTS, kinematics: Box::new(kinematics) }, vec![to_tracker(PROBE_FRAME)]))
        }
    }
}

/// Where the arm's last link is by counts, whole or between two.
fn placed(arm: &Arm, counts: &[f64]) -> Option<Rigid> {
    let counts: [f64; JOINTS] = counts.get(..JOINTS)?.try_into().ok()?;
    let mut values = [0.0; JOINTS];
    for ((value, joint), count) in values.iter_mut().zip(arm.joints()).zip(counts) {
        *value = joint.value(count);
    }
    let affine = arm.pose(&values).tracker_from_probe().affine();
    Some(Rigid { rotation: DQuat::from_mat3(&affine.matrix3).normalize(), position_mm: affine.translation })
}

fn of_recording(bedside: &Bedside, folder: &Path) -> Result<Record, Failure> {
    let writer = SessionWriter::create(folder, WriterOptions::new(concat!("sonoweave ", env!("CARGO_PKG_VERSION"))))?;
    let crop = match (bedside.record.full_frame, bedside.mask.clip) {
        (false, crate::mask::Clip::Rect(rect) | crate::mask::Clip::RectOrAuto(rect)) => {
            Some(Crop { offset: [rect.x, rect.y], size: [rect.width, rect.height] })
        }
        _ => None,
    };
    Ok(Record { writer, crop, notes: vec![("configuration", serde_json::to_value(&bedside.effective)?)] })
}

/// A line on the way.
fn line(account: &Account) -> String {
    let frames = &account.ledger.frames;
    let mut text = format!("{} slices of {} frames", frames.used, frames.total);
    for device in account.devices.iter().filter(|device| device.state != "running" || !device.why.is_empty()) {
        text += &format!("; {} is {}: {}", device.name, device.state, device.why);
    }
    if let Some(seconds) = account.frozen_s {
        text += &format!("; scanner frozen for {seconds:.1} s");
    }
    if let Some(written) = account.recording.as_ref().filter(|written| !written.trouble.is_empty()) {
        text += &format!("; not recorded: {}", written.trouble);
    }
    text
}

#[allow(clippy::print_stderr, reason = "the command's output on the way")]
fn say(line: &str) {
    eprintln!("sonoweave: {line}");
}

/// What a session did, in numbers.
#[derive(Serialize)]
struct Numbers<'a> {
    version: &'static str,
    wall_s: f64,
    #[serde(flatten)]
    ledger: &'a crate::ledger::Ledger,
    devices: &'a [crate::pipeline::live::DeviceBoard],
    capture_to_volume: Option<Quantiles>,
    pose_to_volume: Option<Quantiles>,
    capture_to_picture: Option<Quantiles>,
    pictures: u64,
    pictures_skipped: u64,
    recording: Option<Recorded<'a>>,
    notes: &'a [String],
    config: &'a crate::config::bedside::Effective,
}

#[derive(Serialize)]
struct Recorded<'a> {
    path: &'a Path,
    messages: u64,
    stored: u64,
    lost: u64,
    lost_frames_before_writer: u64,
    lost_others_before_writer: u64,
    bytes: u64,
    trouble: &'a str,
}

/// Writes what was asked for, and says what was done.
#[allow(clippy::print_stdout, reason = "the command's output")]
fn leave(bedside: &Bedside, outputs: &Outputs, finished: &Finished, wall: Duration) -> Result<(), Failure> {
    let Finished { outcome, drawn, account, recording } = finished;
    println!("{}", account.ledger);
    if let (Some(outcome), Some(quantiles)) = (outcome, account.capture_to_volume.quantiles()) {
        println!(
            "{:.1} ms from capture to volume (median; p99 {:.1}, most {:.1}), {} voxels updated",
            quantiles.median_ms, quantiles.p99_ms, quantiles.most_ms, outcome.voxels_updated
        );
    }
    if let Some(outcome) = outcome {
        write_volumes(outputs, outcome)?;
    } else if outputs.volume.is_some() || outputs.weights.is_some() || outputs.picture.is_some() {
        say("no slice was woven: there is no volume and no picture");
    }
    if let (Some(path), Some(drawn)) = (&outputs.picture, drawn) {
        let over = Over { renderer: &drawn.renderer, background: bedside.picture.background, slice: None };
        over.write(&bedside.picture.draw, path)?;
        println!("picture: {} ({} on the way)", path.display(), drawn.pictures);
    }
    if let Some(recording) = recording {
        let lost = recording.account.lost + recording.lost_frames + recording.lost_others;
        println!(
            "session: {} ({:.1} MB, {} messages{})",
            recording.path.display(),
            recording.account.file_bytes as f64 / 1e6,
            recording.account.stored,
            if lost > 0 { format!(", {lost} LOST") } else { String::new() }
        );
    }
    for note in &account.notes {
        say(&format!("note: {note}"));
    }
    let Some(path) = &outputs.stats else { return Ok(()) };
    let numbers = Numbers {
        version: env!("CARGO_PKG_VERSION"),
        wall_s: wall.as_secs_f64(),
        ledger: &account.ledger,
        devices: &account.devices,
        capture_to_volume: account.capture_to_volume.quantiles(),
        pose_to_volume: account.pose_to_volume.quantiles(),
        capture_to_picture: drawn.as_ref().and_then(|drawn| drawn.capture_to_picture.quantiles()),
        pictures: drawn.as_ref().map_or(0, |drawn| drawn.pictures),
        pictures_skipped: drawn.as_ref().map_or(0, |drawn| drawn.skipped),
        recording: recording.as_ref().map(|recording| Recorded {
            path: &recording.path,
            messages: recording.account.messages,
            stored: recording.account.stored,
            lost: recording.account.lost,
            lost_frames_before_writer: recording.lost_frames,
            lost_others_before_writer: recording.lost_others,
            bytes: recording.account.file_bytes,
            trouble: &recording.account.trouble,
        }),
        notes: &account.notes,
        config: &bedside.effective,
    };
    Ok(write_json(path, &numbers)?)
}

#[allow(clippy::print_stdout, reason = "the command's output")]
fn write_volumes(outputs: &Outputs, outcome: &Outcome) -> Result<(), Failure> {
    if outputs.volume.is_none() && outputs.weights.is_none() {
        return Ok(());
    }
    let weaver = &outcome.reconstructor;
    let Some((low, high)) = weaver.volume().seen_bounds() else {
        say("no voxel was seen: the slices' kernel fell between the voxels; choose a finer volume.spacing_mm");
        return Ok(());
    };
    let space = DenseBox::around([low, high], weaver.world_from_lattice(), weaver.settings());
    let scalar = match outcome.pixels {
        PixelKind::U8 => Scalar::U8,
        PixelKind::U16 => Scalar::U16,
        PixelKind::F32 => Scalar::F32,
    };
    let encoding = Encoding { scalar, window: None, unseen: 0.0 };
    let fields = [
        ("SonoweaveVersion".to_owned(), env!("CARGO_PKG_VERSION").to_owned()),
        ("SonoweaveFrame".to_owned(), format!("{} (mm, not anatomical)", outcome.world)),
        ("SonoweaveRoute".to_owned(), outcome.route.clone()),
    ];
    if let Some(path) = &outputs.volume {
        write_values(weaver.volume(), &space, path, &encoding, &fields)?;
        let [x, y, z] = space.grid.size;
        println!("volume: {} ({x}×{y}×{z} voxels in {})", path.display(), outcome.world);
    }
    if let Some(path) = &outputs.weights {
        write_weights(weaver.volume(), &space, path, &fields)?;
        println!("weights: {}", path.display());
    }
    Ok(())
}
