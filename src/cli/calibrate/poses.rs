//! Poses of a stylus from a recording.

mod session;

pub(super) use session::poses;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use calibration::frames::{Reference, Stylus, Transform};
use clap::Args;
use drivers::reading::{Reading, Stamp, transform_name};
use drivers::recording::SequenceSettings;
use drivers::{Next, OpenSettings};
use serde::Serialize;

use super::super::{Failure, values};
use super::guide::Gathering;
use crate::ledger::Ledger;
use crate::refusal::{Reason, Refusal};
use crate::sync::pairing::RIGID_TOLERANCE;
use crate::sync::{Pairing, PairingOptions};

/// A recording of one kind or the other.
#[derive(Debug, Clone, Default, Args)]
#[group(required = true, multiple = false)]
pub struct Source {
    /// A tracked sequence (.mha, .mhd, .nrrd, .nhdr), with or without pictures
    #[arg(long, value_name = "SEQUENCE")]
    pub sequence: Option<PathBuf>,
    /// A session that `live --record` wrote, of a tracker with a stylus
    #[arg(long, value_name = "SESSION.mcap")]
    pub session: Option<PathBuf>,
    /// A bedside's configuration: records its devices now, says what to do, and ends when there is enough
    #[arg(long, value_name = "BEDSIDE.toml")]
    pub live: Option<PathBuf>,
}

/// Which recording, and what its frames are called.
#[derive(Debug, Clone, Args)]
pub struct Recording {
    /// Where it is
    #[command(flatten)]
    pub source: Source,
    /// How it is made where it is still to be made
    #[command(flatten)]
    pub gathering: Gathering,
    /// Name of the frame of the stylus's sensor
    #[arg(long, value_name = "NAME", default_value = "Stylus")]
    pub stylus: String,
    /// Name of the frame in which its poses are taken [default: Reference if the recording has one, else Tracker]
    #[arg(long, value_name = "NAME")]
    pub reference: Option<String>,
    /// Leave out what was recorded before: seconds from the recording's beginning
    #[arg(long, value_name = "S", value_parser = values::number)]
    pub from: Option<f64>,
    /// Leave out what was recorded after: seconds from the recording's beginning
    #[arg(long, value_name = "S", value_parser = values::number)]
    pub to: Option<f64>,
}

/// A stylus's poses.
#[derive(Debug)]
pub struct Poses {
    /// Name of the frame that they are in.
    pub frame: String,
    /// The transforms between: `Stylus → Tracker → Reference`.
    pub route: String,
    /// When, s from the recording's beginning, and where; rigid, in the order of the recording.
    pub poses: Vec<(f64, Transform<Reference, Stylus>)>,
    /// What became of what was recorded.
    pub counts: Counts,
}

/// What became of what was recorded.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Counts {
    /// Items of the recording within the time that was asked for.
    pub read: u64,
    /// Those with a pose.
    pub usable: u64,
    /// The others, by reason.
    pub refused: BTreeMap<Reason, u64>,
    /// Why the first of them was.
    pub first_refusal: Option<String>,
}

impl Recording {
    /// The file; the bedside's where the recording is still to be made.
    pub fn path(&self) -> &Path {
        let Source { sequence, session, live, .. } = &self.source;
        // One of them is there: the command line sees to it.
        sequence.as_ref().or(session.as_ref()).or(live.as_ref()).map_or(Path::new(""), PathBuf::as_path)
    }

    /// Reads the poses.
    ///
    /// # Errors
    /// [`Failure`] when the recording cannot be read, does not name the stylus, or has no way from it to the reference.
    pub fn read(&self) -> Result<Poses, Failure> {
        match &self.source.session {
            Some(path) => session::read(self, path),
            None => self.read_sequence(self.path()),
        }
    }

    fn read_sequence(&self, path: &Path) -> Result<Poses, Failure> {
        let within = |problem: String| Failure(format!("{}: {problem}", path.display()));
        let mut taken = self.taken()?;
        let readings = readings(path)?;
        let mut names: Vec<(String, String)> = Vec::new();
        for reading in &readings {
            if let Reading::NamedTransform(t) = reading
                && !names.iter().any(|(from, to)| *from == t.from && *to == t.to)
            {
                names.push((t.from.clone(), t.to.clone()));
            }
        }
        let known = |name: &str| names.iter().any(|(from, to)| from == name || to == name);
        if !known(&self.stylus) {
            let listed: Vec<String> = names.iter().map(|(from, to)| transform_name(from, to)).collect();
            let listed = if listed.is_empty() { "no transform".to_owned() } else { listed.join(", ") };
            return Err(within(format!(
                "nothing is called {} in it; it holds {listed}: name the stylus's frame with --stylus",
                self.stylus
            )));
        }
        let options = PairingOptions { image: self.stylus.clone(), world: self.reference.clone(), statics: Vec::new() };
        let mut pairing = Pairing::with_names(options, &names).map_err(|_| {
            within(format!(
                "no way leads from {} to {}; name another frame with --reference",
                self.stylus,
                match &self.reference {
                    Some(name) => name.as_str(),
                    None => "Reference or Tracker",
                }
            ))
        })?;

        let mut first_s = None;
        for reading in readings {
            let stamp = match reading {
                Reading::NamedTransform(transform) => {
                    pairing.transform(transform);
                    continue;
                }
                Reading::Frame(frame) => frame.stamp,
                _ => continue,
            };
            // A recording without times is one of readings that are a second apart.
            let time_s = stamp.source_s.unwrap_or(stamp.item as f64);
            taken.put(time_s - *first_s.get_or_insert(time_s), pose(&mut pairing, &stamp));
        }
        let route = pairing.route().map(|route| (route.world().to_owned(), route.describe()));
        let (frame, route) = route.unwrap_or_default();
        let (poses, counts) = taken.all(path)?;
        Ok(Poses { frame, route, poses, counts })
    }

    fn taken(&self) -> Result<Taken<Transform<Reference, Stylus>>, Failure> {
        Taken::new(&format!("poses of {}", self.stylus), self.from, self.to)
    }
}

/// Samples as they come, and what became of them.
pub(super) struct Taken<T> {
    /// What they are, in words that follow a number.
    what: String,
    within_s: [f64; 2],
    ledger: Ledger,
    samples: Vec<(f64, T)>,
    first_refusal: Option<String>,
}

impl<T> Taken<T> {
    /// Of those between two times from the recording's beginning, s.
    ///
    /// # Errors
    /// [`Failure`] where nothing lies between.
    pub(super) fn new(what: &str, from: Option<f64>, to: Option<f64>) -> Result<Self, Failure> {
        let within_s = [from.unwrap_or(f64::NEG_INFINITY), to.unwrap_or(f64::INFINITY)];
        let [begin, end] = within_s;
        if begin >= end {
            return Err(Failure(format!("--from {begin} is not before --to {end}")));
        }
        let (ledger, samples) = (Ledger::default(), Vec::new());
        Ok(Self { what: what.to_owned(), within_s, ledger, samples, first_refusal: None })
    }

    /// One, or why there is none, at a time from the recording's beginning, s.
    pub(super) fn put(&mut self, time_s: f64, sample: Result<T, Refusal>) {
        if time_s < self.within_s[0] || time_s > self.within_s[1] {
            return;
        }
        self.ledger.arrived();
        match sample {
            Ok(sample) => {
                self.ledger.used();
                self.samples.push((time_s, sample));
            }
            Err(refusal) => {
                self.ledger.refused(&refusal);
                self.first_refusal.get_or_insert_with(|| refusal.to_string());
            }
        }
    }

    /// All of them; one at least.
    ///
    /// # Errors
    /// [`Failure`] where there is none, and why.
    pub(super) fn all(self, path: &Path) -> Result<(Vec<(f64, T)>, Counts), Failure> {
        let Self { what, ledger, samples, first_refusal, .. } = self;
        let read = ledger.frames.total;
        if samples.is_empty() {
            let why = match first_refusal {
                Some(why) => format!("none of {read} {what} can be used; the first: {why}"),
                None => "nothing was recorded in the time that is asked for".to_owned(),
            };
            return Err(Failure(format!("{}: {why}", path.display())));
        }
        let counts = Counts { read, usable: samples.len() as u64, refused: ledger.frames.refused, first_refusal };
        Ok((samples, counts))
    }
}

/// The stylus's pose at a stamp.
fn pose(pairing: &mut Pairing, stamp: &Stamp) -> Result<Transform<Reference, Stylus>, Refusal> {
    let affine = pairing.pose_of(stamp)?.world_from_image.affine();
    let pose = Transform::<Reference, Stylus>::from_affine(affine);
    let rigid = pose.nearest_rigid(RIGID_TOLERANCE);
    rigid.map(|(rigid, _)| rigid).map_err(|bad| Refusal::new(stamp.item, Reason::PoseNotRigid, bad.to_string()))
}

/// All readings of a sequence, without pictures.
fn readings(path: &Path) -> Result<Vec<Reading>, Failure> {
    let settings = SequenceSettings { images: false, ..SequenceSettings::new(path) };
    let mut device = drivers::open(&OpenSettings::Sequence(settings))?;
    device.start()?;
    let mut readings = Vec::new();
    loop {
        match device.next(drivers::NO_DEADLINE)? {
            Next::Reading(reading) => readings.push(reading),
            Next::Pending => {}
            Next::End => break,
        }
    }
    device.stop()?;
    Ok(readings)
}

impl Counts {
    /// For a line: those that could not be used, by reason; empty without any.
    pub(super) fn refusals(&self) -> String {
        let listed: Vec<String> = self.refused.iter().map(|(reason, n)| format!("{n} {reason}")).collect();
        if listed.is_empty() { String::new() } else { format!(", refused: {}", listed.join(", ")) }
    }

    /// For the end of a refusal: that there was more, which could not be used.
    pub(super) fn also(&self) -> String {
        match &self.first_refusal {
            Some(why) if self.usable < self.read => {
                format!(" ({} of {} poses could not be used; the first: {why})", self.read - self.usable, self.read)
            }
            _ => String::new(),
        }
    }
}
