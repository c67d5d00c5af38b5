//! A session configuration as its file contains it, section by section.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use calibration::file::{Latency, record};
use calibration::probe::plane_covariance::PlaneCovariance;
use mask::{Clip, MaskError, MaskSettings};
use phantom::{self, Scan};
use sonoweave_core::date::Date;
use sonoweave_core::keys::{FileError, Source, Table};
use sonoweave_core::named::StaticTransform;
use sonoweave_core::region::{ClipRect, Fan};

use super::devices::{Arm, Grabber, Tracker, Tracking};
use super::frames::PROBE_FRAME;
use super::reader::{Effective, Reader};
use super::remote::Remote;
use super::schema::values::TextOr;
use super::schema::{self, FORMAT, VERSION};
use super::session::{Igtl, MarkerLine, Pairing, Process, Record, Scanner, Status};
use super::virtual_bedside::{self, VirtualBedside};
use super::volume::{Picture, Volume};
use crate::error::Error;
use crate::kind::Kind;
use crate::settings::{Settings, SourceKind};
use crate::texts::{ByPath, Texts};

/// A session configuration as its file contains it.
#[derive(Debug, Clone)]
pub struct Bedside {
    /// The file.
    pub path: PathBuf,
    /// Kind of the file.
    pub kind: Kind,
    /// Transform from image to probe, and further constant transforms; none before the
    /// calibration.
    pub calibration: Settings,
    /// Image data.
    pub mask: MaskSettings,
    /// The device that carries the probe.
    pub tracking: Tracking,
    /// The frame grabber.
    pub grabber: Grabber,
    /// Pairing of frames with poses.
    pub pairing: Pairing,
    /// The ultrasound scanner.
    pub scanner: Scanner,
    /// The volume that slices are inserted into.
    pub volume: Volume,
    /// The picture that follows it.
    pub picture: Picture,
    /// The recording.
    pub record: Record,
    /// Publication of the session's status.
    pub status: Status,
    /// The OpenIGTLink server.
    pub igtl: Igtl,
    /// The line that marks moments, if there is one.
    pub marker_line: Option<MarkerLine>,
    /// The session among other programs.
    pub process: Process,
    /// The virtual bedside, if a device belongs to it.
    pub virtual_bedside: Option<VirtualBedside>,
    /// Effective values by dotted key, including defaults.
    pub effective: Effective,
    /// Sentences for the user.
    pub notes: Vec<String>,
    /// The texts of its files: its own, the calibration's, a transfer function's, a crop's.
    pub texts: ByPath,
}

impl Bedside {
    pub(super) fn parse_own(path: &Path, text: &str, texts: &Texts) -> Result<Self, Error> {
        let source = Source { path, text };
        let parsed = source.parse()?;
        let headings = schema::SECTIONS.iter().map(|section| section.name).filter(|name| !name.contains('.'));
        let known: Vec<&str> = ["format", "version"].into_iter().chain(headings).collect();
        let root = Table::root(source, &parsed, &known);
        // Checks the format first: for a file of another kind, errors on unknown keys would be
        // misleading.
        let format = Table::bare(source, &parsed).need("format")?;
        if format.text()? != FORMAT {
            return Err(format.error(format!("must be \"{FORMAT}\" for a session configuration")).into());
        }
        let root = root?;
        check_version(&root)?;
        Self::of_root(path, &root, texts)
    }

    fn of_root(path: &Path, root: &Table<'_>, texts: &Texts) -> Result<Self, Error> {
        let mut effective = Effective::new();
        let mut notes = Vec::new();
        let calibration_keys = Reader::new(path, Some(root), "calibration", &mut effective)?;
        let (given_calibration, clip, fan) = read_calibration(calibration_keys, texts)?;

        let calibrated = given_calibration.as_ref().and_then(|settings| settings.latency);
        let [of_tracking_ms, of_grabber_ms] = calibrated.map_or([0.0; 2], |ms| [ms.tracker_ms, ms.video_ms]);
        let given = |name: &str| root.get(name);
        let carriers = ["tracker", "arm", "remote"].map(|name| given(name).map(|entry| (name, entry)));
        let mut carriers = carriers.into_iter().flatten();
        let tracking = match (carriers.next(), carriers.next()) {
            (Some((name, _)), None) => {
                let keys = Reader::new(path, Some(root), name, &mut effective)?;
                match name {
                    "tracker" => Tracking::Tracker(Tracker::read(keys, of_tracking_ms)?),
                    "arm" => Tracking::Arm(Arm::read(keys, of_tracking_ms)?),
                    _ => Tracking::Remote(Remote::read(keys, of_tracking_ms)?),
                }
            }
            (Some((first, _)), Some((_, other))) => {
                let problem = format!(
                    "[{first}] is there too, but only one device can locate the probe; delete the other section"
                );
                return Err(other.error(problem).into());
            }
            (None, _) => {
                return Err(whole_file(
                    path,
                    "tracker",
                    "neither [tracker] nor [arm] nor [remote] is there; add the section of the device that locates the \
                    probe",
                ));
            }
        };
        if given("grabber").is_none() {
            return Err(whole_file(
                path,
                "grabber",
                "[grabber] is missing; add the section of the device that supplies the scanner's frames",
            ));
        }
        let grabber = Grabber::read(Reader::new(path, Some(root), "grabber", &mut effective)?, of_grabber_ms)?;
        notes.extend(calibrated.and_then(|calibrated| other_lag(&calibrated, &tracking, &grabber)));

        let virtual_bedside = if tracking.is_virtual() || grabber.is_virtual {
            let (hand, inner) =
                VirtualBedside::read(Reader::new(path, Some(root), "virtual", &mut effective)?, &tracking, &grabber)?;
            let line = virtual_bedside::of_line(Reader::new(path, inner.as_ref(), "virtual.line", &mut effective)?)?;
            let of_grabber =
                virtual_bedside::of_grabber(Reader::new(path, inner.as_ref(), "virtual.grabber", &mut effective)?)?;
            Some(hand.with_faults(line, of_grabber))
        } else {
            if given("virtual").is_some() {
                notes.push("[virtual] has no effect: no device is \"virtual\"".into());
            }
            None
        };

        let own = match (&virtual_bedside, &tracking) {
            (Some(virtual_bedside), Tracking::Arm(arm)) if arm.ports.is_none() => {
                let hand = Arc::new(phantom::Bedside::new(Scan::clone(&virtual_bedside.scan), 0));
                let carried = VirtualBedside::carried(hand, arm.twin_counts_per_turn());
                let carried = carried.map_err(|unfit| whole_file(path, "virtual", &unfit.to_string()))?;
                if given_calibration.is_some() {
                    return Err(whole_file(
                        path,
                        "calibration",
                        "a virtual arm has its own joints and zeros; delete file and image_to_probe",
                    ));
                }
                Some(exact(Settings::of_file(&carried.calibration())))
            }
            (Some(virtual_bedside), _) if grabber.is_virtual => Some(exact(of_scan(&virtual_bedside.scan))),
            _ => None,
        };
        let calibration = given_calibration.or(own).unwrap_or_default();
        notes.extend(calibration.notes.iter().cloned());
        let mut mask = calibration.mask();
        mask.clip = clip.unwrap_or(mask.clip);
        mask.fan = fan.or(mask.fan);

        let is_arm = matches!(tracking, Tracking::Arm(_));
        let pairing = Reader::new(path, Some(root), "pairing", &mut effective)?;
        let pairing = Pairing::read(pairing, is_arm, calibration.tracker_noise)?;
        let scanner =
            Scanner::read(Reader::new(path, Some(root), "scanner", &mut effective)?, calibration.preset.as_ref())?;
        let volume = Volume::read(Reader::new(path, Some(root), "volume", &mut effective)?, &calibration)?;
        let picture = Picture::read(Reader::new(path, Some(root), "picture", &mut effective)?, texts)?;
        let record = Record::read(Reader::new(path, Some(root), "record", &mut effective)?)?;
        let status = Status::read(Reader::new(path, Some(root), "status", &mut effective)?)?;
        let igtl = Igtl::read(Reader::new(path, Some(root), "igtl", &mut effective)?)?;
        let marker_line = MarkerLine::read(Reader::new(path, Some(root), "markers", &mut effective)?)?;
        let process = Process::read(Reader::new(path, Some(root), "process", &mut effective)?)?;
        let (path, kind) = (path.to_owned(), Kind::Bedside);
        Ok(Self {
            path,
            kind,
            calibration,
            mask,
            tracking,
            grabber,
            pairing,
            scanner,
            volume,
            picture,
            record,
            status,
            igtl,
            marker_line,
            process,
            virtual_bedside,
            effective,
            notes,
            texts: ByPath::new(),
        })
    }
}

/// Difference above which two lags are not equal, ms. A hand at 50 mm/s moves by 0.05 mm in this
/// time.
const SAME_LAG_MS: f64 = 1.0;

/// Returns a warning if the difference of the effective latencies is not the calibrated one.
fn other_lag(calibrated: &Latency, tracking: &Tracking, grabber: &Grabber) -> Option<String> {
    let lag_ms = (tracking.latency_ns() - grabber.latency_ns) as f64 * 1e-6;
    let of_file_ms = calibrated.tracker_ms - calibrated.video_ms;
    ((lag_ms - of_file_ms).abs() > SAME_LAG_MS).then(|| {
        format!(
            "poses lag the frames by {lag_ms:.1} ms with latency_ms of this file, but by {of_file_ms:.1} ms in the \
            calibration file; this file is used. Delete both latency_ms to use the calibration's"
        )
    })
}

/// A calibration, and overrides of its clip and fan.
type GivenCalibration = (Option<Settings>, Option<Clip>, Option<Fan>);

/// Reads the section's calibration, and its overrides of the calibration's clip and fan.
fn read_calibration(mut keys: Reader<'_, '_>, texts: &Texts) -> Result<GivenCalibration, Error> {
    let given: schema::session::Calibration = keys.read()?;
    let (file, preset) = (keys.path_if(given.file), given.preset);
    let clip = given.clip_px.map(|clip| match clip {
        TextOr::Text(text) => text.parse::<Clip>(),
        TextOr::Other([x, y, width, height]) => {
            ClipRect::new(x, y, width, height).map(Clip::Rect).map_err(MaskError::from)
        }
    });
    let clip = clip.transpose().map_err(|e| keys.error("clip_px", e.to_string()))?;
    let fan = given.fan.map(|fan| Fan::new(fan.origin_px, fan.radii_px, fan.angles_deg));
    let fan = fan.transpose().map_err(|e| keys.error("fan", e.to_string()))?;
    let settings = match (file, given.image_to_probe) {
        (Some(_), Some(_)) => {
            return Err(keys
                .error("image_to_probe", "file is there too and also gives the image's position; delete one of them"));
        }
        (Some(file), None) => {
            let mut settings = Settings::parse(&file, &keys.named("file", &file, texts)?, preset.as_deref())?;
            let name = match &settings.preset {
                Some(preset) => format!("the preset \"{}\"", preset.name),
                None => "the probe's calibration".into(),
            };
            let warning = settings.record.age_warning(&name, Date::today(), given.warn_after_days.into());
            settings.notes.extend(warning);
            Some(settings)
        }
        _ if preset.is_some() => {
            return Err(keys.error("preset", "applies to a calibration file only; give file, too"));
        }
        (None, Some(rows)) => {
            let transform = StaticTransform::new("Image", PROBE_FRAME, &rows);
            let transform = transform.map_err(|e| keys.error("image_to_probe", e.to_string()))?;
            Some(Settings { source: SourceKind::Sonoweave, transforms: vec![transform], ..Settings::default() })
        }
        (None, None) => None,
    };
    Ok((settings, clip, fan))
}

/// Returns the settings with an exact calibration: the simulation itself uses its transform.
fn exact(settings: Settings) -> Settings {
    let record = record::Record { covariance: Some(PlaneCovariance::exact()), ..settings.record };
    Settings { record, ..settings }
}

/// Returns the virtual bedside's own calibration.
fn of_scan(scan: &Scan) -> Settings {
    let layout = scan.bmode().map(|bmode| bmode.layout());
    Settings {
        transforms: vec![StaticTransform::image_to_probe(&scan.probe_from_image())],
        clip: layout.and_then(|layout| layout.clip()),
        fan: scan.settings().fan.or(layout.and_then(|layout| layout.fan())),
        ..Settings::default()
    }
}

fn check_version(root: &Table<'_>) -> Result<(), FileError> {
    let version = root.need("version")?;
    match version.whole()? {
        VERSION => Ok(()),
        newer if newer > VERSION => Err(version.error(format!(
            "version {newer} is newer than this program reads ({VERSION}); use a newer sonoweave, or convert the file \
            to version {VERSION}"
        ))),
        _ => Err(version.error(format!("the first version is {VERSION}"))),
    }
}

fn whole_file(path: &Path, key: &str, problem: &str) -> Error {
    FileError::Key { path: path.to_owned(), line: 1, key: format!("[{key}]"), problem: problem.into() }.into()
}
