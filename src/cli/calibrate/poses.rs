//! Poses of a stylus from a recording.

mod session;

pub(super) use session::poses;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use clap::Args;
use serde::Serialize;

use drivers::OpenSettings;
use drivers::replay::SequenceSettings;
use sonoweave_core::Next;
use sonoweave_core::frames::{Reference, Stylus, Transform};
use sonoweave_core::ledger::Ledger;
use sonoweave_core::reading::{Reading, Stamp, transform_name};
use sonoweave_core::refusal::{Reason, Refusal};
use sync::pairing::stamped::RIGID_TOLERANCE;
use sync::{PairingOptions, StampedPairing};

use super::super::{Failure, values};
use super::guide::Gathering;

/// A recording, of one kind or the other.
#[derive(Debug, Clone, Default, Args)]
#[group(required = true, multiple = false)]
pub struct Source {
    /// Tracked sequence (.mha, .mhd, .nrrd, .nhdr), with or without images
    #[arg(long, value_name = "SEQUENCE")]
    pub sequence: Option<PathBuf>,
    /// Session of a tracker with a stylus, recorded by `live --record`
    #[arg(long, value_name = "SESSION.mcap")]
    pub session: Option<PathBuf>,
    /// Session configuration: record its devices now, show instructions, and end when there is
    /// enough
    #[arg(long, value_name = "BEDSIDE.toml")]
    pub live: Option<PathBuf>,
}

/// A recording, and the names of its frames.
#[derive(Debug, Clone, Args)]
pub struct Recording {
    /// Source of the recording
    #[command(flatten)]
    pub source: Source,
    /// Flags for a recording that is made now
    #[command(flatten)]
    pub gathering: Gathering,
    /// Name of the frame of the stylus's sensor
    #[arg(long, value_name = "NAME", default_value = "Stylus")]
    pub stylus: String,
    /// Name of the frame in which its poses are taken [default: Reference if the recording has
    /// one, else Tracker]
    #[arg(long, value_name = "NAME")]
    pub reference: Option<String>,
    /// Leave out everything recorded before: seconds from the recording's beginning
    #[arg(long, value_name = "S", value_parser = values::number)]
    pub from: Option<f64>,
    /// Leave out everything recorded after: seconds from the recording's beginning
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
    /// Time, s from the recording's beginning, and rigid pose, in the order of the recording.
    pub poses: Vec<(f64, Transform<Reference, Stylus>)>,
    /// Counts of used and refused items.
    pub counts: Counts,
}

/// Counts of used and refused items of a recording.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Counts {
    /// Items of the recording within the requested time.
    pub read: u64,
    /// Items with a pose.
    pub usable: u64,
    /// The other items, by reason.
    pub refused: BTreeMap<Reason, u64>,
    /// Reason of the first refusal.
    pub first_refusal: Option<String>,
}

impl Recording {
    /// Returns the file; the session configuration if the recording is still to be made.
    pub fn path(&self) -> &Path {
        let Source { sequence, session, live, .. } = &self.source;
        // The command line guarantees that one of them is present.
        sequence.as_ref().or(session.as_ref()).or(live.as_ref()).map_or(Path::new(""), PathBuf::as_path)
    }

    /// Reads the poses.
    ///
    /// # Errors
    /// [`Failure`] when the recording cannot be read, does not name the stylus, or has no way
    /// from it to the reference.
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
                "holds no frame {}, only {listed}; name the stylus's frame with --stylus",
                self.stylus
            )));
        }
        let options = PairingOptions { image: self.stylus.clone(), world: self.reference.clone(), statics: Vec::new() };
        let mut pairing = StampedPairing::with_names(options, &names).map_err(|_| {
            within(format!(
                "no transforms lead from {} to {}; name another frame with --reference",
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
            // Items without times are taken as a second apart.
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

/// Collects samples, and counts the refused ones.
pub(super) struct Taken<T> {
    /// Name of the samples, in words that follow a number.
    what: String,
    within_s: [f64; 2],
    ledger: Ledger,
    samples: Vec<(f64, T)>,
    first_refusal: Option<String>,
}

impl<T> Taken<T> {
    /// Takes the samples between two times from the recording's beginning, s.
    ///
    /// # Errors
    /// [`Failure`] if `from` is not before `to`.
    pub(super) fn new(what: &str, from: Option<f64>, to: Option<f64>) -> Result<Self, Failure> {
        let within_s = [from.unwrap_or(f64::NEG_INFINITY), to.unwrap_or(f64::INFINITY)];
        let [begin, end] = within_s;
        if begin >= end {
            return Err(Failure(format!("--from {begin} is not before --to {end}; give an earlier begin")));
        }
        let (ledger, samples) = (Ledger::default(), Vec::new());
        Ok(Self { what: what.to_owned(), within_s, ledger, samples, first_refusal: None })
    }

    /// Takes a sample, or its refusal, at a time from the recording's beginning, s.
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

    /// Returns all samples; at least one.
    ///
    /// # Errors
    /// [`Failure`] with the reason if there is none.
    pub(super) fn all(self, path: &Path) -> Result<(Vec<(f64, T)>, Counts), Failure> {
        let Self { what, ledger, samples, first_refusal, .. } = self;
        let read = ledger.frames.total;
        if samples.is_empty() {
            let why = match first_refusal {
                Some(why) => format!("none of {read} {what} is usable; the first: {why}"),
                None => "holds nothing from the given time; change --from or --to".to_owned(),
            };
            return Err(Failure(format!("{}: {why}", path.display())));
        }
        let counts = Counts { read, usable: samples.len() as u64, refused: ledger.frames.refused, first_refusal };
        Ok((samples, counts))
    }
}

/// Returns the stylus's pose at a stamp.
fn pose(pairing: &mut StampedPairing, stamp: &Stamp) -> Result<Transform<Reference, Stylus>, Refusal> {
    let affine = pairing.pose_of(stamp)?.world_from_image.affine();
    let pose = Transform::<Reference, Stylus>::from_affine(affine);
    let rigid = pose.nearest_rigid(RIGID_TOLERANCE);
    rigid.map(|(rigid, _)| rigid).map_err(|bad| Refusal::new(stamp.item, Reason::PoseNotRigid, bad.to_string()))
}

/// Reads all readings of a sequence, without images.
fn readings(path: &Path) -> Result<Vec<Reading>, Failure> {
    let settings = SequenceSettings { images: false, ..SequenceSettings::new(path) };
    let mut device = drivers::open(&OpenSettings::Sequence(settings))?;
    device.start()?;
    let mut readings = Vec::new();
    loop {
        match device.next(sonoweave_core::NO_DEADLINE)? {
            Next::Reading(reading) => readings.push(reading),
            Next::Pending => {}
            Next::End => break,
        }
    }
    device.stop()?;
    Ok(readings)
}

impl Counts {
    /// Lists the refused items by reason, for a line of text; empty without any.
    pub(super) fn refusals(&self) -> String {
        let listed: Vec<String> = self.refused.iter().map(|(reason, n)| format!("{n} {reason}")).collect();
        if listed.is_empty() { String::new() } else { format!(", refused: {}", listed.join(", ")) }
    }

    /// Notes the unusable items, for the end of a refusal.
    pub(super) fn also(&self) -> String {
        match &self.first_refusal {
            Some(why) if self.usable < self.read => {
                format!(" ({} of {} poses could not be used; the first: {why})", self.read - self.usable, self.read)
            }
            _ => String::new(),
        }
    }
}
