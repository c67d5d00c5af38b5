//! `sonoweave convert`: converts sequences, sessions and volumes between file formats.

mod volume;

use std::path::{Path, PathBuf};

use clap::Args;
use serde::Serialize;

use config::bedside::devices::TRACKER_FRAME;
use drivers::OpenSettings;
use drivers::replay::{Progress, SequenceSettings, SessionSettings};
use formats::Limits;
use formats::image::{Container, Content, content};
use formats::session::SessionReader;
use mask::Clip;
use pipeline::session::{DeviceRole, RecordedDecisions};
use sonoweave_core::Device;
use sonoweave_core::date::Second;
use sonoweave_core::region::ClipRect;
use sync::ingest::live::Gives;

use super::progress::{progress, say, turning};
use super::{Failure, values};
use crate::app::convert::anonymous::Subject;
use crate::app::convert::arrange::Arrangement;
use crate::app::convert::blacken::{self, Blackening};
use crate::app::convert::pictures::Pictures;
use crate::app::convert::placing::{self, Delivered, Placing, Rules};
use crate::app::convert::sequence::Gathered;
use crate::app::convert::volume::Converted;
use crate::app::convert::{Changes, sequence, write};
use crate::app::input;
use crate::app::json::JsonFlag;
use crate::app::live::stages::{Kept, roles};
use crate::app::pseudonym::PseudonymKey;
use crate::app::reconstruct::zarr::is_ome_zarr;
use volume::VolumeFlags;

/// Flags of `convert`.
#[derive(Debug, Args)]
#[command(after_long_help = "\
The name of OUT selects the format. From a sequence or a session: .mha, .mhd, .nrrd, .seq.nrrd (3D Slicer) or .nhdr \
for a sequence; .mcap for a session; an existing folder or a name such as frame%04d.png for pictures. From a volume: \
.mha, .mhd, .nrrd, .nhdr, .nii, .nii.gz, .ome.zarr.

Numbered pictures become a sequence without poses; --rate gives it times. A session becomes a sequence with one pose \
of each sensor for each frame. The pose is the same as in a replay: interpolated between two received poses, with \
latencies subtracted. An arm's pose comes from its kinematics. A sequence contains no other data of the session.

--anonymize keeps only the fields for position and time: transforms, their status, times, frame numbers, \
orientation, image type and pixel spacing. It lists the fields that it leaves out. Times and frame numbers begin at 0. \
Pixels beside the scanner's picture become black: outside --clip, of which --crop takes the place, or outside the \
picture's edge if that is recognised. If it is not, nothing is written. --subject and --key write the subject's \
pseudonym, by a secret key, and move the time of --acquired (of a session, its own) by as much for each recording of \
the subject.

Examples:
  sonoweave convert sweep.igs.mha -o sweep.seq.nrrd --compress
  sonoweave convert SESSION-20261121-213000.mcap -o sweep.igs.mha
  sonoweave convert sweep.igs.mha -o frame%04d.png --frames 10..20
  sonoweave convert frame%04d.png -o pictures.mha --rate 30
  sonoweave convert sweep.igs.mha -o 1.igs.mha --anonymize --clip 192,16,420,580 --subject anna --key ~/study.key
  sonoweave convert volume.mha -o volume.nii.gz
  sonoweave convert volume.mha --weights weights.mha -o volume.ome.zarr
  sonoweave convert volume.ome.zarr -o filled.mha --fill gaussian --fill-radius 3")]
pub struct Arguments {
    /// Tracked sequence, session, volume, or numbered images (a folder, or frame%04d.png)
    input: PathBuf,
    /// Write to this file, folder of images, or numbered images
    #[arg(short, long, value_name = "OUT")]
    output: PathBuf,
    #[command(flatten)]
    json: JsonFlag,
    /// Take frames A up to, but not including, B
    #[arg(long, value_name = "A..B", value_parser = values::frames)]
    frames: Option<FrameRange>,
    /// Keep a part of the image, in pixels of the image in MF orientation
    #[arg(long, value_name = "X,Y,W,H", value_parser = values::rectangle)]
    crop: Option<ClipRect>,
    /// Write images in this orientation (MF, UN, FM, …) [default: unchanged; for .png MF]
    #[arg(long, value_name = "CODE")]
    orientation: Option<String>,
    /// Leave out everything that may identify the patient, the operator or the place: fields,
    /// pixels beside the picture, dates
    #[arg(long)]
    anonymize: bool,
    /// Picture of an anonymous recording: a rectangle in pixels of the image in MF orientation,
    /// all, or found in the first frames [default: what --crop keeps, else auto]
    #[arg(long, value_name = "X,Y,W,H|auto|none", requires = "anonymize")]
    clip: Option<Clip>,
    /// Subject's ID, of which an anonymous file gets the pseudonym
    #[arg(long, value_name = "ID", requires = "anonymize", requires = "key")]
    subject: Option<String>,
    /// Secret key of pseudonyms: a file of 32 random bytes or more, kept apart from the data
    #[arg(long, value_name = "FILE", requires = "subject")]
    key: Option<PathBuf>,
    /// Time of the recording, as fourteen digits; the file gets it moved by the subject's shift
    /// [default: a session's own, else none]
    #[arg(long, value_name = "YYYYMMDDHHMMSS", requires = "subject", value_parser = second)]
    acquired: Option<Second>,
    /// Compress pixels
    #[arg(long)]
    compress: bool,
    /// Name of a tracker's station in the sequence made from a session [default: from the
    /// session's settings, else Sensor1, Sensor2, …]
    #[arg(long = "station", value_name = "N=NAME", value_parser = station)]
    stations: Vec<(u8, String)>,
    /// Rate at which the numbered images were taken, images a second [default: they have no
    /// times]
    #[arg(long, value_name = "HZ", value_parser = values::positive)]
    rate: Option<f64>,
    #[command(flatten)]
    volume: VolumeFlags,
}

// clap treats a named type as a single value.
type FrameRange = std::ops::Range<u64>;

fn station(text: &str) -> Result<(u8, String), String> {
    let help = "must be N=NAME: the station's number, and a name of letters and digits that begins with a capital";
    let (number, name) = text.split_once('=').ok_or(help)?;
    let is_name = name.starts_with(|c: char| c.is_ascii_uppercase()) && name.chars().all(|c| c.is_ascii_alphanumeric());
    // `To` separates the two frames of a transform's name.
    if !is_name || name.contains("To") {
        return Err(help.into());
    }
    Ok((number.parse().map_err(|_| help)?, name.to_owned()))
}

fn second(text: &str) -> Result<Second, &'static str> {
    Second::parse(text).ok_or("must be a date and time of fourteen digits, such as 20261121213000")
}

/// A finished conversion.
#[derive(Debug, Serialize)]
struct Report<'a> {
    /// Absent with --anonymize, as names of files often identify a person.
    #[serde(skip_serializing_if = "Option::is_none")]
    input: Option<&'a Path>,
    output: &'a Path,
    /// Content of the output, in words.
    content: &'a str,
    /// Fields that --anonymize left out.
    left_out: &'a [String],
    /// Pixels that --anonymize made black.
    #[serde(skip_serializing_if = "Option::is_none")]
    blackened: Option<Blackened>,
    /// Pseudonym of --subject.
    #[serde(skip_serializing_if = "Option::is_none")]
    subject: Option<&'a str>,
    /// Time of the recording, moved by the subject's shift.
    #[serde(skip_serializing_if = "Option::is_none")]
    acquired: Option<String>,
    /// Description of the filling of holes.
    #[serde(skip_serializing_if = "Option::is_none")]
    filled: Option<&'a str>,
    notes: &'a [String],
}

/// Pixels of all frames that became black.
#[derive(Debug, Clone, Copy, Serialize)]
struct Blackened {
    /// Pixels of each frame.
    pixels: u64,
    /// Pixels of all frames that were not black before.
    changed: u64,
}

/// A written file.
#[derive(Default)]
struct Written {
    /// Its content, in words.
    content: String,
    left_out: Vec<String>,
    blackened: Option<Blackened>,
    filled: Option<String>,
    notes: Vec<String>,
}

/// Runs the command.
///
/// # Errors
/// [`Failure`]: no output remains then, except images before the one that failed.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let Arguments { input, output, .. } = arguments;
    input::check_is_not(output, input)?;
    arguments.json.check([input.as_path()])?;
    if input::is_dicom(output) {
        fail!("{}: use `sonoweave dicom` to write DICOM, with names of patient and study", output.display());
    }
    let is_numbered = Pictures::are_at(input);
    let is_session = !is_numbered && !is_ome_zarr(input) && input::is_session(input)?;
    let is_volume =
        is_ome_zarr(input) || !is_session && !is_numbered && content(input, &Limits::default())? == Content::Volume;
    if arguments.rate.is_some() && !is_numbered {
        fail!("{}: has its own times; leave out --rate, which is for numbered pictures", input.display());
    }
    let changes = Changes {
        frames: arguments.frames.clone(),
        crop: arguments.crop,
        orientation: arguments.orientation.clone(),
        anonymize: arguments.anonymize,
        subject: arguments.pseudonym(is_session)?,
        compressed: arguments.compress,
    };
    let subject = changes.subject.clone();
    let made = if is_volume { arguments.volume(&changes)? } else { arguments.recording(changes, is_session)? };
    let Written { content, left_out, blackened, filled, notes } = made;
    for note in &notes {
        say(&format!("note: {note}"));
    }
    if arguments.anonymize {
        print_line!("{}: anonymous {content}", output.display());
        print_line!("left out: {}", if left_out.is_empty() { "no field".to_owned() } else { left_out.join(", ") });
    } else {
        print_line!("{}: {content} of {}", output.display(), input.display());
    }
    if let Some(Blackened { pixels, changed }) = blackened {
        print_line!("black: {pixels} pixels of each frame; {changed} of all frames were not black before");
    }
    if let Some(subject) = &subject {
        let time = subject.acquired.map_or_else(String::new, |time| format!(", at {time} after the subject's shift"));
        print_line!("subject: {}{time}", subject.pseudonym);
    }
    if let Some(filled) = &filled {
        print_line!("{filled}");
    }
    arguments.json.write(&Report {
        input: (!arguments.anonymize).then_some(input),
        output,
        content: &content,
        left_out: &left_out,
        blackened,
        subject: subject.as_ref().map(|subject| subject.pseudonym.as_str()),
        acquired: subject.as_ref().and_then(|subject| subject.acquired).map(|time| time.to_string()),
        filled: filled.as_deref(),
        notes: &notes,
    })
}

impl Arguments {
    /// Returns the subject of an anonymous file, under its pseudonym.
    fn pseudonym(&self, is_session: bool) -> Result<Option<Subject>, Failure> {
        let (Some(subject), Some(key)) = (&self.subject, &self.key) else { return Ok(None) };
        let key = PseudonymKey::read(key)?;
        let acquired = match self.acquired {
            None if is_session => {
                Some(Second::of_unix_ns(SessionReader::open(&self.input, &Limits::default())?.about().realtime_ns))
            }
            given => given,
        };
        let shifted = acquired.map(|time| {
            let early =
                || Failure::usage(format!("--acquired {time}: is too early to be moved; give the recording's time"));
            key.shifted(subject, time).ok_or_else(early)
        });
        Ok(Some(Subject { pseudonym: key.pseudonym("subject", subject), acquired: shifted.transpose()? }))
    }

    fn volume(&self, changes: &Changes) -> Result<Written, Failure> {
        let is_clipped = self.crop.is_some() || self.clip.is_some();
        if self.frames.is_some() || is_clipped || self.orientation.is_some() || !self.stations.is_empty() {
            fail!(
                "{}: is a volume; leave out --frames, --crop, --clip, --orientation and --station, which are for recordings",
                self.input.display()
            );
        }
        self.check_pixels()?;
        let Converted { removed, filled, notes } = self.volume.run(&self.input, &self.output, changes)?;
        Ok(Written { content: "volume".into(), left_out: removed, filled, notes, ..Written::default() })
    }

    /// Returns the pixels that an anonymous recording makes black.
    fn blackening(&self, gathered: &Gathered, is_session: bool) -> Result<Option<Blackening>, Failure> {
        // A crop leaves nothing beside the picture.
        let is_cropped = self.crop.is_some() && self.clip.is_none();
        if !self.anonymize || is_cropped || gathered.arrangement.is_none() {
            return Ok(None);
        }
        let (size, orientation) = &gathered.stored;
        let within = |why: String| Failure::new(format!("{}: {why}", self.input.display()));
        let mf = Arrangement::new(*size, orientation, None, Some("MF")).map_err(within)?.size;
        let mut device = self.open(is_session, true)?;
        let mask = blacken::find(&mut *device, &self.input, mf, self.clip.unwrap_or_default())?;
        Blackening::new(&mask, *size, orientation).map(Some).map_err(within)
    }

    /// Converts a recording.
    fn recording(&self, mut changes: Changes, is_session: bool) -> Result<Written, Failure> {
        if self.volume.are_given() {
            fail_usage!(
                "{}: is a recording; leave out --weights, --write-weights, --fill and --seen-label, which are for \
                 volumes",
                self.input.display()
            );
        }
        let name = self.output.file_name().map_or_else(String::new, |name| name.to_string_lossy().to_ascii_lowercase());
        let pictures = self.output.is_dir() || (name.ends_with(".png") && write::number_in(&name).is_some());
        let session = name.ends_with(".mcap");
        if pictures {
            changes.orientation.get_or_insert("MF".into());
        } else if !session {
            let named = Container::of_sequence(&self.output);
            named.map_err(|why| {
                Failure::new(format!(
                    "{}: {why}; give frame%04d.png or a folder for pictures, .mcap for a session",
                    self.output.display()
                ))
            })?;
        }
        if !self.output.is_dir() {
            input::check_output(&self.output)?;
        }
        self.check_pixels()?;
        if !self.stations.is_empty() && !is_session {
            fail!("{}: is not a session; leave out --station, which is for sessions", self.input.display());
        }
        let placing = if is_session { self.placing()? } else { Placing::default() };
        let mut gathered = sequence::gather(&mut *self.open(is_session, false)?, &self.input, &changes, &placing)?;
        if let Some(arrangement) = &gathered.arrangement {
            arrangement.turn_spacing(&mut gathered.header.fields);
        }
        gathered.blackening = self.blackening(&gathered, is_session)?;
        let count = gathered.header.items.len();
        let bar = progress("converting", count as u64);
        let progress = |done| bar.set_position(done);
        let mut device = self.open(is_session, true)?;
        let what = if pictures {
            write::pictures(&mut *device, &gathered, &self.output, &progress)?;
            format!("{count} pictures")
        } else if session {
            write::session(&mut *device, &gathered, &self.output, &progress)?;
            format!("session with {count} frames")
        } else {
            write::sequence(&mut *device, &gathered, &self.output, &progress)?;
            format!("sequence of {count} frames")
        };
        bar.finish_and_clear();
        let black = |black: &Blackening| Blackened { pixels: black.in_a_frame(), changed: black.changed() };
        let blackened = gathered.blackening.as_ref().map(black);
        Ok(Written { content: what, left_out: gathered.removed, blackened, ..Written::default() })
    }

    /// Reads the session's sensor poses, by its own configuration if it holds one.
    fn placing(&self) -> Result<Placing, Failure> {
        let decisions = RecordedDecisions::read(&self.input)?;
        let bedside = Kept::at_first(&self.input, &decisions).ok();
        let rules = bedside.as_ref().map_or_else(Rules::default, |bedside| Rules {
            wait_ns: bedside.pairing.wait_ns,
            longest_gap_ns: bedside.pairing.longest_gap_ns,
        });
        let mut roles: Vec<DeviceRole> =
            bedside.as_ref().and_then(|bedside| roles(bedside).ok()).map_or_else(Vec::new, Vec::from);
        for Delivered { device, stations, pictures } in placing::delivered(&self.input)? {
            if roles.iter().all(|one| one.name != device) && !stations.is_empty() {
                say(&format!(
                    "note: {}: the latencies of {device} and of the frames are unknown; times of reception \
                    are used",
                    self.input.display()
                ));
            }
            let at = roles.iter().position(|one| one.name == device).unwrap_or_else(|| {
                let gives = if pictures { Gives::Pictures } else { Gives::Stations(Vec::new()) };
                roles.push(DeviceRole { name: device, gives, frames: Vec::new(), latency_ns: 0 });
                roles.len() - 1
            });
            let DeviceRole { gives: Gives::Stations(known), frames, .. } = &mut roles[at] else { continue };
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
        // A session made from a sequence already contains the sequence's transforms and times.
        if roles.iter().all(|role| role.frames.is_empty()) {
            return Ok(Placing::default());
        }
        Ok(Placing::read(&self.input, roles, rules)?)
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
        let progress = if images { turning() } else { Progress::default() };
        let settings = SequenceSettings { images, progress, ..SequenceSettings::new(path) };
        Ok(drivers::open(&OpenSettings::Sequence(settings))?)
    }

    /// Refuses a separate pixel file that would overwrite one of the input's.
    fn check_pixels(&self) -> Result<(), Failure> {
        let Some(data) = Container::of(&self.output).and_then(|kind| kind.data_path(&self.output, self.compress))
        else {
            return Ok(());
        };
        let stem = |path: &Path| path.file_stem().map(std::ffi::OsStr::to_owned);
        if data.exists() && stem(&self.input) == stem(&self.output) {
            fail!(
                "{}: {} exists and may hold the input's pixels; give another name",
                self.output.display(),
                data.display()
            );
        }
        input::check_output(&data)?;
        input::check_is_not(&data, &self.input)
    }
}
