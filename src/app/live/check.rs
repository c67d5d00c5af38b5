//! Checks that everything that a session configuration names is present and works.

use std::fmt::Write as _;
use std::net::TcpListener;
use std::path::PathBuf;

use serde::Serialize;
use serde_json::{Map, Value, json};

use calibration::tracker::zones::Zones;
use config::bedside::devices::{PROBE_FRAME, REFERENCE_FRAME, TRACKER_FRAME};
use config::bedside::{Bedside, Tracking, pixel_mm};
use console::Listen;
use sonoweave_core::clock::{Clock, Monotonic};
use sync::StampedPairing;

use super::device::{PATIENCE, Tried, try_out};
use super::foreign::{beyond, other_size};
use crate::app::devices;
use crate::failure::{Failure, with_remedy};

/// Shares of the configured rate: below USELESS a device is unusable, below SLOW it gets a
/// warning.
const USELESS: f64 = 0.5;
const SLOW: f64 = 0.9;

/// Results and problems.
#[derive(Debug, Serialize)]
pub(crate) struct Report {
    config: PathBuf,
    well: bool,
    checks: Vec<Checked>,
    notes: Vec<String>,
}

/// A checked item.
#[derive(Debug, Serialize)]
struct Checked {
    what: &'static str,
    /// Without errors.
    well: bool,
    /// Description of the item.
    says: Vec<String>,
    /// Warnings.
    doubts: Vec<String>,
    /// Errors, with remedies.
    wrong: Vec<String>,
    /// The same for programs.
    numbers: Value,
}

impl Checked {
    fn new(what: &'static str) -> Self {
        Self { what, well: true, says: Vec::new(), doubts: Vec::new(), wrong: Vec::new(), numbers: Value::Null }
    }

    fn say(&mut self, sentence: impl Into<String>) {
        self.says.push(sentence.into());
    }

    fn doubt(&mut self, sentence: impl Into<String>) {
        self.doubts.push(sentence.into());
    }

    fn wrong(&mut self, sentence: impl Into<String>) {
        self.well = false;
        self.wrong.push(sentence.into());
    }
}

/// Opens all devices at the same time, and checks the rest of the configuration. For a trial, an
/// example of a calibration is `accepted`, with a warning.
///
/// # Errors
/// [`Failure`] when the devices cannot be created.
pub(crate) fn check(bedside: &Bedside, accepted: bool) -> Result<Report, Failure> {
    let mut devices = devices::open(bedside, Monotonic.now_ns(), false)?;
    let (tracking, grabber) = std::thread::scope(|scope| {
        let other = std::thread::Builder::new().name("grabber".into());
        let grabber = other.spawn_scoped(scope, || try_out(devices.grabber.as_mut()));
        let tracking = try_out(devices.tracking.as_mut());
        (tracking, grabber.map(|thread| thread.join()))
    });
    let grabber = match grabber {
        Ok(Ok(tried)) => tried,
        Ok(Err(_)) => return Err(Failure::new("the grabber's driver has panicked; report this to the project")),
        Err(error) => {
            return Err(Failure::new(format!(
                "cannot start the grabber's thread: {error}; close other programs, then try again"
            )));
        }
    };
    drop(devices);
    let mut checks = vec![
        of_tracking(bedside, &tracking),
        of_grabber(bedside, &grabber),
        of_calibration(bedside, &grabber, accepted),
    ];
    checks.extend(bedside.record.folder.is_some().then(|| of_recording(bedside, &grabber)));
    checks.extend(bedside.status.listen.is_some().then(|| of_status(bedside)));
    Ok(Report {
        config: bedside.path.clone(),
        well: checks.iter().all(|checked| checked.well),
        checks,
        notes: bedside.notes.clone(),
    })
}

fn of_tracking(bedside: &Bedside, tried: &Tried) -> Checked {
    let (what, stations) = match &bedside.tracking {
        Tracking::Tracker(tracker) => {
            let station = |(n, frame): (u8, &str)| (Some(n), frame.to_lowercase(), format!("station {n}"));
            ("tracker", tracker.roles.all().map(station).collect())
        }
        Tracking::Arm(_) => ("arm", Vec::new()),
        Tracking::Remote(remote) => (
            "server",
            remote
                .transforms
                .iter()
                .map(|(name, frame)| (tried.station(name), frame.to_lowercase(), name.clone()))
                .collect(),
        ),
    };
    let is_virtual = bedside.tracking.is_virtual();
    let mut checked = of_device(what, tried, is_virtual, bedside.tracking.latency_ns());
    if tried.ran_after.is_none() {
        return checked;
    }
    for (station, frame, called) in &stations {
        let Some(stream) = station.and_then(|station| tried.streams.get(&station)) else {
            checked.wrong(format!("{frame}: {called} sends nothing; plug in its sensor"));
            continue;
        };
        let hz = stream.seen_hz.map_or(String::new(), |hz| format!(", {hz:.1} a second"));
        checked.say(format!("{frame:<10} {called} at {}{hz}", stream.first));
        rate(&mut checked, &format!("{frame}: "), stream.seen_hz, tried, is_virtual);
        if stream.doubtful > 0 {
            let why = stream.doubt.as_deref().unwrap_or_default();
            let sentence = format!("{frame}: {} of {} poses are doubtful: {why}", stream.doubtful, stream.readings);
            if stream.doubtful == stream.readings { checked.wrong(sentence) } else { checked.doubt(sentence) }
        }
    }
    if let Tracking::Arm(_) = &bedside.tracking {
        for stream in tried.streams.values() {
            let hz = stream.seen_hz.map_or(String::new(), |hz| format!(", {hz:.1} a second"));
            checked.say(format!("counts {}{hz}", stream.first));
            rate(&mut checked, "", stream.seen_hz, tried, is_virtual);
            if stream.doubtful > 0 {
                let why = stream.doubt.as_deref().unwrap_or_default();
                checked.doubt(format!("{} of {} samples are doubtful: {why}", stream.doubtful, stream.readings));
            }
        }
        if tried.streams.is_empty() {
            checked.wrong("it runs but sends no counts; switch its power on");
        }
    }
    checked
}

fn of_grabber(bedside: &Bedside, tried: &Tried) -> Checked {
    let mut checked = of_device("grabber", tried, bedside.grabber.is_virtual, bedside.grabber.latency_ns);
    if tried.ran_after.is_none() {
        return checked;
    }
    let Some(stream) = tried.streams.get(&0) else {
        checked.wrong("it runs but delivers no frames; check the cable and the scanner's output");
        return checked;
    };
    let hz = stream.seen_hz.map_or(String::new(), |hz| format!(", {hz:.1} frames a second"));
    checked.say(format!("{}{hz}", stream.first));
    rate(&mut checked, "", stream.seen_hz, tried, bedside.grabber.is_virtual);
    if stream.doubtful > 0 {
        let why = stream.doubt.as_deref().unwrap_or_default();
        let sentence = format!("{} of {} frames are doubtful: {why}", stream.doubtful, stream.readings);
        if stream.doubtful == stream.readings { checked.wrong(sentence) } else { checked.doubt(sentence) }
    } else if tried.flat {
        checked.doubt("every frame has one grey level only; check that the scanner is on, and that this is its output");
    }
    if let (Some([w, h]), Some([aw, ah])) = (tried.picture, bedside.grabber.settings.size)
        && [w, h] != [aw, ah]
    {
        checked.say(format!("of frames of {aw}×{ah}, by [grabber] interlace"));
    }
    checked
}

/// Checks the properties that every device has.
fn of_device(what: &'static str, tried: &Tried, is_virtual: bool, latency_ns: i64) -> Checked {
    let mut checked = Checked::new(what);
    let Tried { description, health, .. } = tried;
    let latency_ms = latency_ns as f64 * 1e-6;
    match tried.ran_after {
        Some(after) => checked.say(format!("{}; runs after {:.1} s", description.name, after.as_secs_f64())),
        None => {
            checked.say(description.name.clone());
            let seconds = PATIENCE / 1_000_000_000;
            checked.wrong(match (&tried.refused, health.why.as_str()) {
                (Some(refused), _) => refused.clone(),
                (None, "") => format!("{} after {seconds} s, without a reason", health.state.word()),
                (None, why) => format!("{} after {seconds} s: {}", health.state.word(), with_remedy(why)),
            });
        }
    }
    if !description.fields.is_empty() {
        let fields: Vec<String> = description.fields.iter().map(|(name, value)| format!("{name} {value}")).collect();
        checked.say(fields.join("; "));
    }
    if tried.ran_after.is_some() {
        checked.say(match tried.known_delay_ms() {
            known if known > 0.0 => format!(
                "{}; {known:.1} ms of known delay and {latency_ms} ms of configured latency are subtracted",
                tried.clock()
            ),
            _ => format!("{}; {latency_ms} ms of configured latency are subtracted", tried.clock()),
        });
        let [lost, refused, skipped] = tried.harmed;
        if lost > 0 {
            checked.doubt(format!(
                "{lost} readings were lost during the check, by the device's count; end other programs if this machine \
                is busy"
            ));
        }
        if refused + skipped > 0 {
            checked.doubt(format!(
                "{refused} records were refused, and {skipped} bytes belonged to no record; check the cable"
            ));
        }
    }
    let fields: Map<String, Value> =
        description.fields.iter().map(|(k, v)| (k.clone(), Value::from(v.clone()))).collect();
    let received = &health.received;
    checked.numbers = json!({
        "name": description.name,
        "virtual": is_virtual,
        "state": health.state.word(),
        "ran_after_s": tried.ran_after.map(|after| after.as_secs_f64()),
        "fields": fields,
        "rate_hz": description.timing.rate_hz,
        "streams": tried.streams,
        "picture_size": tried.picture,
        "clock": tried.clock(),
        "known_delay_ms": tried.known_delay_ms(),
        "latency_ms": latency_ms,
        "received": {
            "bytes": received.bytes, "readings": received.readings, "lost": received.lost,
            "refused": received.refused, "skipped": received.skipped, "opened": received.opened, "set_up": received.set_up,
        },
    });
    checked
}

/// Reports a rate below the configured one. For a virtual device, the cause is this machine or
/// simulated loss.
fn rate(checked: &mut Checked, head: &str, seen_hz: Option<f64>, tried: &Tried, is_virtual: bool) {
    let (Some(seen), Some(wanted)) = (seen_hz, tried.description.timing.rate_hz) else { return };
    let sentence = format!("{head}only {seen:.1} of the configured {wanted:.1} a second arrive");
    if seen < USELESS * wanted && !is_virtual {
        checked.wrong(format!("{sentence}; end other programs, or use a faster line"));
    } else if seen < SLOW * wanted {
        checked.doubt(sentence);
    }
}

fn of_calibration(bedside: &Bedside, grabber: &Tried, accepted: bool) -> Checked {
    let mut checked = Checked::new("calibration");
    let calibration = &bedside.calibration;
    let options = bedside.pairing_options();
    match StampedPairing::with_names(options, &bedside.tracking.names()) {
        Ok(pairing) => {
            let way = pairing.route().map_or(String::new(), |route| route.describe());
            checked.say(match &calibration.path {
                Some(path) => format!("{way}, by {}", path.display()),
                None => way,
            });
        }
        Err(_) => checked.wrong(match bedside.calibrated() {
            Ok(()) => no_way(bedside),
            Err(missing) => Failure::configuration(missing).0.sentence,
        }),
    }
    let foreign = |checked: &mut Checked, sentence: String| match accepted {
        true => checked.doubt(sentence),
        false => checked.wrong(sentence),
    };
    if let Err(error) = bedside.no_example() {
        foreign(&mut checked, Failure::configuration(error).0.sentence);
    }
    let made = calibration.record.origin.made.map(|made| format!("made {made}"));
    let preset = calibration.preset.as_ref().map(|preset| format!("preset \"{}\"", preset.name));
    let words: Vec<String> = preset.into_iter().chain(made).collect();
    if !words.is_empty() {
        checked.say(words.join(", "));
    }
    match (calibration.record.quality, &calibration.record.covariance) {
        (Some(quality), Some(_)) => checked.say(format!(
            "the uncertainty of a point is {:.2} mm at the image's centre and {:.2} mm at the worst corner",
            quality.centre_mm, quality.corner_mm
        )),
        (None, Some(_)) => {}
        (_, None) => checked.say("calibration error unknown: measurements are without it; `calibrate probe` finds it"),
    }
    let pixel = pixel_mm(calibration);
    if let Some([u, v]) = pixel {
        checked.say(format!("a pixel is {u:.4}×{v:.4} mm"));
        if let Err(error) = bedside.volume.settings.kernels([u, v]) {
            checked.wrong(error.to_string());
        }
    }
    let zones = calibration.distortion.as_ref().filter(|_| !matches!(bedside.tracking, Tracking::Arm(_)));
    checked.says.extend(zones.map(ToString::to_string));
    if let Tracking::Arm(_) = &bedside.tracking {
        match &calibration.arm {
            Some(arm) => arm.joints().iter().for_each(|joint| checked.say(joint.to_string())),
            None => checked
                .wrong("it holds no joints, so counts cannot become poses; give a calibration file with [[arm.joint]]"),
        }
    }
    if let Some([w, h]) = grabber.picture.map(|size| bedside.grabber.turned(size)) {
        match (other_size(bedside, &[[w, h]]), bedside.mask.plan(w, h)) {
            (Some(sentence), _) => checked.wrong(sentence),
            (None, Ok(plan)) => {
                checked.say(region(bedside, &plan));
                if let Some(sentence) = beyond(bedside, [w, h]) {
                    foreign(&mut checked, sentence);
                }
            }
            (None, Err(error)) => checked.wrong(error.to_string()),
        }
    }
    checked.numbers = json!({
        "pixel_mm": pixel, "mask": bedside.mask, "transforms": calibration.transforms, "zones": zones.map(Zones::count),
    });
    checked
}

/// Describes the part of the image that is data.
fn region(bedside: &Bedside, plan: &mask::MaskPlan) -> String {
    let fan = if bedside.mask.fan.is_some() { " in a sector" } else { "" };
    match plan {
        mask::MaskPlan::Auto(_) => "the part of the image that is data is detected in the first frames".into(),
        mask::MaskPlan::Fixed(mask) if mask.is_full() => "the whole image is data".into(),
        mask::MaskPlan::Fixed(mask) => format!("{} pixels are data{fan}", mask.area()),
    }
}

/// Explains why no transforms lead from the image to the world.
fn no_way(bedside: &Bedside) -> String {
    let names = |all: Vec<String>| if all.is_empty() { "nothing".to_owned() } else { all.join(", ") };
    let delivered = bedside.tracking.names().into_iter().map(|(from, to)| format!("{from}To{to}")).collect();
    let told = bedside.calibration.transforms.iter().map(|t| t.name()).collect();
    let image = bedside.calibration.image_frame.as_deref().unwrap_or("Image");
    let world = bedside.pairing_options().world.unwrap_or_else(|| format!("{REFERENCE_FRAME} or {TRACKER_FRAME}"));
    format!(
        "no way leads from {image} to {world}: the devices deliver {}, the calibration has {}; give \
        {image}To{PROBE_FRAME}, and a reachable frame as [volume] world",
        names(delivered),
        names(told)
    )
}

fn of_recording(bedside: &Bedside, grabber: &Tried) -> Checked {
    let mut checked = Checked::new("recording");
    let Some(folder) = &bedside.record.folder else { return checked };
    checked.say(folder.display().to_string());
    if let Err(error) = tempfile::tempfile_in(folder) {
        checked
            .wrong(format!("cannot write a file there: {error}; make the folder, or give another in [record] folder"));
        return checked;
    }
    let Ok(disk) = rustix::fs::statvfs(folder) else { return checked };
    let free = disk.f_bavail.saturating_mul(disk.f_frsize);
    let room = free.saturating_sub(bedside.record.keep_free_bytes);
    let rate = grabber.streams.get(&0).and_then(|stream| stream.seen_hz).zip(grabber.picture);
    let minutes = rate.map(|(hz, [w, h])| room as f64 / (hz * f64::from(w) * f64::from(h)) / 60.0);
    let gb = |bytes: u64| bytes as f64 * 1e-9;
    let lasts =
        minutes.map_or(String::new(), |minutes| format!(", enough for {minutes:.0} minutes of whole frames or more"));
    checked.say(format!(
        "{:.1} GB may be used{lasts}; {:.1} GB stay free",
        gb(room),
        gb(bedside.record.keep_free_bytes)
    ));
    if room == 0 {
        checked.wrong(format!(
            "{:.1} GB are free, less than [record] keep_free_mb; delete files, or lower keep_free_mb",
            gb(free)
        ));
    } else if minutes.is_some_and(|minutes| minutes < 10.0) {
        checked.doubt("the disk may be full before a session ends; delete files");
    }
    checked.numbers = json!({ "folder": folder, "free_bytes": free, "room_bytes": room, "minutes": minutes });
    checked
}

fn of_status(bedside: &Bedside) -> Checked {
    let mut checked = Checked::new("status");
    let Some(address) = bedside.status.listen else { return checked };
    checked.say(format!("http://{address}"));
    if let Err(error) = TcpListener::bind(address) {
        checked.wrong(format!("cannot listen there: {error}; give another port in [status] listen"));
    }
    let listen = Listen { address, access: bedside.status.access.clone() };
    if let Err(error) = listen.check() {
        checked.wrong(error.to_string());
    }
    checked.numbers = json!({ "listen": address });
    checked
}

impl Report {
    /// Formats the report for people.
    pub(crate) fn text(&self) -> String {
        let mut text = format!("{}\n", self.config.display());
        for checked in &self.checks {
            let mark = match (checked.well, checked.doubts.is_empty()) {
                (false, _) => '✗',
                (true, false) => '!',
                (true, true) => '✓',
            };
            let says = checked.says.iter().map(|line| (' ', line));
            let doubts = checked.doubts.iter().map(|line| ('!', line));
            let wrong = checked.wrong.iter().map(|line| ('✗', line));
            for (n, (own, line)) in says.chain(doubts).chain(wrong).enumerate() {
                let head = if n == 0 { format!("{mark} {:<12}", checked.what) } else { " ".repeat(14) };
                let own = if own == ' ' { String::new() } else { format!("{own} ") };
                // Writing to a string does not fail.
                let _ = writeln!(text, "{head}{own}{line}");
            }
        }
        for note in &self.notes {
            let _ = writeln!(text, "  note        {note}");
        }
        if self.well {
            let doubted = self.checks.iter().any(|checked| !checked.doubts.is_empty());
            text += if doubted { "all devices work; read the lines marked with !\n" } else { "all is well\n" };
        }
        text
    }

    /// Returns the failed checks in one sentence.
    pub(crate) fn verdict(&self) -> Option<String> {
        self.verdict_but("")
    }

    /// Returns the same, without the problems of one item.
    pub(crate) fn verdict_but(&self, item: &str) -> Option<String> {
        let wrong = self.checks.iter().filter(|checked| !checked.well && checked.what != item);
        let wrong: Vec<&str> = wrong.map(|checked| checked.what).collect();
        (!wrong.is_empty()).then(|| format!("{}: not well: {}", self.config.display(), wrong.join(", ")))
    }
}
