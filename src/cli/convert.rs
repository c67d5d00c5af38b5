//! `sonoweave convert`: sequences, sessions and volumes from one file to another.

use std::path::{Path, PathBuf};

use calibration::region::ClipRect;
use clap::Args;
use drivers::recording::image::{About, Container, Content};
use drivers::recording::session::SessionSettings;
use drivers::recording::{Limits, Progress, SequenceSettings};
use drivers::{Device, OpenSettings};

use super::dicom::flags::is_dicom;
use super::live::stages::{Kept, instruments};
use super::{Failure, input, values};
use crate::config::bedside::devices::TRACKER_FRAME;
use crate::convert::pictures::Pictures;
use crate::convert::placing::{self, Delivered, Placing, Rules};
use crate::convert::{Changes, sequence, write};
use crate::ingest::live::Gives;
use crate::pipeline::live::{Instrument, Precedent};

/// Flags of `convert`.
#[derive(Debug, Args)]
#[command(after_help = "\
The name of OUT says what is written. Of a sequence or a session: .mha, .mhd, .nrrd, .seq.nrrd (3D Slicer), .nhdr; .mcap, a session; a folder that is there or a name \
such as frame%04d.png, pictures. Of a volume: .mha, .mhd, .nrrd, .nhdr, .nii, .nii.gz.

Numbered pictures become a sequence without poses, and without times but by --rate. A session becomes a sequence with one pose of each sensor a frame: the one that a replay \
pairs the frame with, between two poses that were received, latencies taken off; an arm's is made by its kinematics. What else was received has no place in a sequence.

--anonymize leaves out all fields but those that place and time need (transforms, their status, times, frame numbers, orientation, the image's type, how far pixels are apart) and \
says which; what is written into the pictures is cut off by --crop.

Examples:
  sonoweave convert sweep.igs.mha sweep.seq.nrrd --compress
  sonoweave convert SESSION-20261121-213000.mcap sweep.igs.mha
  sonoweave convert sweep.igs.mha frame%04d.png --frames 10..20
  sonoweave convert frame%04d.png pictures.mha --rate 30
  sonoweave convert volume.mha volume.nii.gz")]
pub struct Arguments {
    /// A tracked sequence, a session, a volume, or numbered pictures (a folder, or frame%04d.png)
    input: PathBuf,
    /// What is written
    output: PathBuf,
    /// Take frames A up to, but not including, B
    #[arg(long, value_name = "A..B", value_parser = values::frames)]
    frames: Option<FrameRange>,
    /// Keep a part of the picture, in pixels of the picture in MF orientation
    #[arg(long, value_name = "X,Y,W,H", value_parser = values::rectangle)]
    crop: Option<ClipRect>,
    /// Write pictures in this orientation (MF, UN, FM, …) [default: as they are; of .png MF]
    #[arg(long, value_name = "CODE")]
    orientation: Option<String>,
    /// Leave out every field that may tell of whom, by whom or where it was recorded
    #[arg(long)]
    anonymize: bool,
    /// Compress pixels
    #[arg(long)]
    compress: bool,
    /// What a tracker's station is called in the sequence made of a session [default: as in the session's settings, else Sensor1, Sensor2, …]
    #[arg(long = "station", value_name = "N=NAME", value_parser = station)]
    stations: Vec<(u8, String)>,
    /// How many numbered pictures were taken a second [default: they have no times]
    #[arg(long, value_name = "HZ", value_parser = values::positive)]
    rate: Option<f64>,
}

// A named type is a single value to clap.
type FrameRange = std::ops::Range<u64>;

fn station(text: &str) -> Result<(u8, String), String> {
    let help = "must be N=NAME: the station's number, and a name of letters and digits that begins with a capital";
    let (number, name) = text.split_once('=').ok_or(help)?;
    let is_name = name.starts_with(|c: char| c.is_ascii_uppercase()) && name.chars().all(|c| c.is_ascii_alphanumeric());
    // `To` parts the two frames of a transform's name.
    if !is_name || name.contains("To") {
        return Err(help.into());
    }
    Ok((number.parse().map_err(|_| help)?, name.to_owned()))
}

/// Runs the command.
///
/// # Errors
/// [`Failure`]: the output is not there then, but pictures before the one that failed.
#[allow(clippy::print_stdout, reason = "the command's output")]
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let Arguments { input, output, .. } = arguments;
    input::check_is_not(output, input)?;
    if is_dicom(output) {
        return Err(Failure(format!(
            "{}: DICOM is written by `sonoweave dicom`, which asks for a patient's and a study's names",
            output.display()
        )));
    }
    let is_numbered = Pictures::are_at(input);
    let is_session = !is_numbered && input::is_session(input)?;
    let about = if is_session || is_numbered { None } else { Some(About::read(input, &Limits::default())?) };
    if arguments.rate.is_some() && !is_numbered {
        return Err(Failure(format!("{}: has times of its own; --rate is of numbered pictures", input.display())));
    }
    let changes = Changes {
        frames: arguments.frames.clone(),
        crop: arguments.crop,
        orientation: arguments.orientation.clone(),
        anonymize: arguments.anonymize,
        compressed: arguments.compress,
    };
    let (what, removed) = match about {
        Some(About { content: Content::Volume, .. }) => ("volume".to_owned(), arguments.volume(&changes)?),
        _ => arguments.recording(changes, is_session)?,
    };
    println!("{}: {what} of {}", output.display(), input.display());
    if arguments.anonymize {
        let names = if removed.is_empty() { "no field".to_owned() } else { removed.join(", ") };
        println!("left out: {names}");
    }
    Ok(())
}

impl Arguments {
    fn volume(&self, changes: &Changes) -> Result<Vec<String>, Failure> {
        if self.frames.is_some() || self.crop.is_some() || self.orientation.is_some() || !self.stations.is_empty() {
            return Err(Failure(format!(
                "{}: is a volume; --frames, --crop, --orientation and --station are of recordings",
                self.input.display()
            )));
        }
        input::check_volume(&self.output)?;
        input::check_output(&self.output)?;
        self.check_pixels()?;
        Ok(write::volume(&self.input, &self.output, changes, &|_| {})?)
    }

    /// What was written, and the fields that were left out.
    fn recording(&self, mut changes: Changes, is_session: bool) -> Result<(String, Vec<String>), Failure> {
        let name = self.output.file_name().map_or_else(String::new, |name| name.to_string_lossy().to_ascii_lowercase());
        let pictures = self.output.is_dir() || (name.ends_with(".png") && write::number_in(&name).is_some());
        let session = name.ends_with(".mcap");
        if pictures {
            changes.orientation.get_or_insert("MF".into());
        } else if !session {
            let named = Container::of_sequence(&self.output);
            named.map_err(|why| {
                Failure(format!("{}: {why}, or frame%04d.png, a folder, or .mcap", self.output.display()))
            })?;
        }
        if !self.output.is_dir() {
            input::check_output(&self.output)?;
        }
        self.check_pixels()?;
        if !self.stations.is_empty() && !is_session {
            return Err(Failure(format!(
                "{}: is no session; --station names a session's sensors",
                self.input.display()
            )));
        }
        let placing = if is_session { self.placing()? } else { Placing::default() };
        let mut gathered = sequence::gather(&mut *self.open(is_session, false)?, &self.input, &changes, &placing)?;
        if let Some(arrangement) = &gathered.arrangement {
            arrangement.turn_spacing(&mut gathered.header.fields);
        }
        let count = gathered.header.items.len();
        let bar = input::progress("converting", count as u64);
        let told = |done| bar.set_position(done);
        let mut device = self.open(is_session, true)?;
        let what = if pictures {
            write::pictures(&mut *device, &gathered, &self.output, &told)?;
            format!("{count} pictures")
        } else if session {
            write::session(&mut *device, &gathered, &self.output, &told)?;
            format!("session with {count} frames")
        } else {
            write::sequence(&mut *device, &gathered, &self.output, &told)?;
            format!("sequence of {count} frames")
        };
        bar.finish_and_clear();
        Ok((what, gathered.removed))
    }

    /// Where a session's sensors were, by its own configuration if it holds one.
    #[allow(clippy::print_stderr, reason = "the command's output on the way")]
    fn placing(&self) -> Result<Placing, Failure> {
        let told = Precedent::read(&self.input)?;
        let bedside = Kept::at_first(&self.input, &told).ok();
        let rules = bedside.as_ref().map_or_else(Rules::default, |bedside| Rules {
            wait_ns: bedside.pairing.wait_ns,
            longest_gap_ns: bedside.pairing.longest_gap_ns,
        });
        let mut instruments: Vec<Instrument> =
            bedside.as_ref().and_then(|bedside| instruments(bedside).ok()).map_or_else(Vec::new, Vec::from);
        for Delivered { device, stations, pictures } in placing::delivered(&self.input)? {
            if instruments.iter().all(|one| one.name != device) && !stations.is_empty() {
                eprintln!(
                    "sonoweave: note: {}: no configuration tells of {device}'s latency or the pictures': both are taken as of when they were received",
                    self.input.display()
                );
            }
            let at = instruments.iter().position(|one| one.name == device).unwrap_or_else(|| {
                let gives = if pictures { Gives::Pictures } else { Gives::Stations(Vec::new()) };
                instruments.push(Instrument { name: device, gives, frames: Vec::new(), latency_ns: 0 });
                instruments.len() - 1
            });
            let Instrument { gives: Gives::Stations(known), frames, .. } = &mut instruments[at] else { continue };
            for station in stations.into_iter().filter(|station| !known.contains(station)).collect::<Vec<_>>() {
                known.push(station);
                frames.push([format!("Sensor{station}"), TRACKER_FRAME.to_owned()]);
            }
            for (station, [from, _]) in known.iter().zip(frames) {
                if let Some((_, name)) = self.stations.iter().find(|(named, _)| named == station) {
                    name.clone_into(from);
                }
            }
        }
        // Of a sequence that became a session the transforms and times are its own.
        if instruments.iter().all(|instrument| instrument.frames.is_empty()) {
            return Ok(Placing::default());
        }
        Ok(Placing::read(&self.input, instruments, rules)?)
    }

    fn open(&self, is_session: bool, images: bool) -> Result<Box<dyn Device>, Failure> {
        let path = &self.input;
        if Pictures::are_at(path) {
            return Ok(Box::new(Pictures::open(path, images, self.rate)?));
        }
        if is_session {
            let settings = SessionSettings { images, ..SessionSettings::new(path) };
            return Ok(drivers::open(&OpenSettings::Session(settings))?);
        }
        let told = if images { input::turning() } else { Progress::default() };
        let settings = SequenceSettings { images, told, ..SequenceSettings::new(path) };
        Ok(drivers::open(&OpenSettings::Sequence(settings))?)
    }

    /// The pixels' file beside the output is not one of the input's.
    fn check_pixels(&self) -> Result<(), Failure> {
        let Some(data) = Container::of(&self.output).and_then(|kind| kind.data_path(&self.output, self.compress))
        else {
            return Ok(());
        };
        let stem = |path: &Path| path.file_stem().map(std::ffi::OsStr::to_owned);
        if data.exists() && stem(&self.input) == stem(&self.output) {
            return Err(Failure(format!(
                "{}: {} is there already and may be the input's pixels; give another name",
                self.output.display(),
                data.display()
            )));
        }
        input::check_output(&data)?;
        input::check_is_not(&data, &self.input)
    }
}
