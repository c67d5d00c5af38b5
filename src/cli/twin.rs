//! `sonoweave twin`: simulates a tracker or an arm on a pseudo-terminal.

use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, PoisonError};
use std::time::Duration;

use clap::Args;

use drivers::simulated::{Faults, Joints, Motion, Pty, Tally, trembling};
use sonoweave_core::clock::{Clock, MS, Monotonic, SECOND};

mod units;

use units::{Found, Left, Port, Unit, name};

use super::Failure;
use super::phantom::choices::tracker_noise;
use phantom::bedside::arm::{BedsideArm, standard_arm};
use phantom::named::{MotionOptions, TrajectoryName};
use phantom::{Bedside, Scan, ScanSettings, Scene, TrackerNoise};

/// Duration of an unplugging, ns.
const OUT: i64 = 2 * SECOND;
/// Polling interval.
const TURN: Duration = Duration::from_millis(20);
/// Largest number of commands listed in the summary; others are counted together.
const MOST_COMMANDS: usize = 20;

/// Flags of `twin`.
#[derive(Debug, Args)]
#[command(after_long_help = "\
The pseudo-terminal is a serial line for every program: for our drivers, for other programs, for `cat`. It accepts \
any rate, and a unit does not restart when a program opens the line. The hand moves to and fro without end; the same \
flags give the same data. All other settings of `phantom` for a trajectory have their defaults.

An arm moves its probe in a plane, so its trajectory must be arm, parallel, jittered, fan, rotation, dwell or \
out-and-back. The arm's home position is the trajectory's first pose.

Examples: sonoweave twin fastrak --link /tmp/fastrak
          sonoweave twin liberty --found inches --noise 0.3,0.1 --garble 0.001 --dropout 0.01
          sonoweave twin qsb --link /tmp/arm --unplug-every 30   # /tmp/arm1 to /tmp/arm3")]
pub struct Arguments {
    /// Unit to simulate
    #[arg(value_enum, value_name = "UNIT")]
    unit: Unit,
    /// Link to the terminal with this name, also after reconnection; three axes append 1, 2 and
    /// 3
    #[arg(long, value_name = "PATH")]
    link: Option<PathBuf>,
    /// Initial state of the unit
    #[arg(long, value_enum, default_value_t)]
    found: Found,
    /// Motion of the probe [default: freehand; for an arm arm]
    #[arg(long, value_enum)]
    trajectory: Option<TrajectoryName>,
    /// Poses of the trajectory, 30 a second
    #[arg(long, value_name = "N", default_value_t = 120)]
    frames: u32,
    /// Mean distance between two of them, mm
    #[arg(long, value_name = "MM", default_value_t = 0.35)]
    gap: f64,
    /// Seed of the walk and of all faults
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Sensors in use: the first is on the probe, all others on the breathing patient [default:
    /// 2, or as many as it has]
    #[arg(long, value_name = "N")]
    stations: Option<u8>,
    /// Initial rate, readings a second; a driver may set others
    #[arg(long, value_name = "HZ")]
    rate: Option<u32>,
    /// Counts a turn of an arm's encoders [default: 40000; of a MicroScribe 16384]
    #[arg(long, value_name = "N")]
    counts_per_turn: Option<u32>,
    /// Standard deviations of a sensor's noise: position along each axis, mm, and rotation about
    /// each, degrees
    #[arg(long, help_heading = "Faults", value_name = "MM,DEG", value_parser = tracker_noise)]
    noise: Option<TrackerNoise>,
    /// Share of bytes that are lost on the line
    #[arg(long, help_heading = "Faults", value_name = "P", value_parser = share, default_value_t = 0.0)]
    drop: f64,
    /// Share of bytes that arrive as another
    #[arg(long, help_heading = "Faults", value_name = "P", value_parser = share, default_value_t = 0.0)]
    garble: f64,
    /// Share of records that are not sent
    #[arg(long, help_heading = "Faults", value_name = "P", value_parser = share, default_value_t = 0.0)]
    dropout: f64,
    /// Rate error of the unit's clock, parts in a million; positive runs faster than the host's
    #[arg(long, help_heading = "Faults", value_name = "PPM", default_value_t = 0.0, allow_hyphen_values = true)]
    drift: f64,
    /// Delay everything by this, ms
    #[arg(long, help_heading = "Faults", value_name = "MS", default_value_t = 0.0)]
    latency: f64,
    /// Delay further by a random time up to this, ms; the order is kept
    #[arg(long, help_heading = "Faults", value_name = "MS", default_value_t = 0.0)]
    jitter: f64,
    /// Deliver bytes in packets, one every so many ms, as from an adapter that collects them
    /// (FTDI's: 16)
    #[arg(long, help_heading = "Faults", value_name = "MS", default_value_t = 0.0)]
    packets: f64,
    /// Pull the plug after every so many s, for 2 s
    #[arg(long, help_heading = "Faults", value_name = "S")]
    unplug_every: Option<f64>,
    /// End after so many s [default: at SIGINT or SIGTERM]
    #[arg(long, value_name = "S")]
    duration: Option<f64>,
}

/// Parses a share of 0 to 1.
fn share(text: &str) -> Result<f64, String> {
    match text.trim().parse() {
        Ok(share) if (0.0..=1.0).contains(&share) => Ok(share),
        _ => Err("must be a fraction from 0 to 1".into()),
    }
}

/// Converts a duration to ns. Refuses durations that are negative, or longer than 1e6 units.
fn ns(flag: &str, value: f64, unit_ns: i64) -> Result<i64, Failure> {
    if !(0.0..=1e6).contains(&value) {
        fail_usage!("--{flag} {value}: must lie between 0 and 1000000");
    }
    Ok((value * unit_ns as f64).round() as i64)
}

/// Runs the command.
///
/// # Errors
/// [`Failure`] when there is no such unit, or no pseudo-terminal is available.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let ends = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        signal_hook::flag::register(signal, Arc::clone(&ends))?;
    }
    play(arguments, Monotonic.now_ns(), &ends, &mut std::io::stdout().lock())
}

/// Runs the simulation until a signal or its duration ends it; the trajectory begins at
/// `begin_ns`.
fn play(arguments: &Arguments, begin_ns: i64, ends: &AtomicBool, out: &mut impl Write) -> Result<(), Failure> {
    let out_of = |name: &str, value: Option<f64>| value.map(|s| ns(name, s, SECOND)).transpose();
    let duration = out_of("duration", arguments.duration)?;
    let every = out_of("unplug-every", arguments.unplug_every)?;
    if every.is_some_and(|every| every < SECOND / 10) {
        fail_usage!("--unplug-every: must be 0.1 s or more");
    }
    let ports = arguments.ports(begin_ns)?;
    let mut links: Vec<Option<Link>> = (1..)
        .zip(&ports)
        .map(|(number, _)| {
            let path = arguments.link.as_ref()?;
            let mut path = path.clone().into_os_string();
            if ports.len() > 1 {
                path.push(number.to_string());
            }
            Some(Link { path: path.into(), target: None })
        })
        .collect();
    for link in links.iter().flatten() {
        link.check()?;
    }
    let mut lines = open(&ports, &mut links, out)?;
    writeln!(out, "{}", arguments.describe()?)?;
    if duration.is_none() {
        writeln!(out, "Ctrl-C ends it.")?;
    }
    out.flush()?;
    let mut commands: BTreeMap<String, u64> = BTreeMap::new();
    let mut turns_ns = every.map(|every| begin_ns + every);
    while !ends.load(Ordering::Relaxed) && duration.is_none_or(|ns| Monotonic.now_ns() < begin_ns + ns) {
        std::thread::sleep(TURN);
        note_commands(&ports, &mut commands);
        let now_ns = Monotonic.now_ns();
        let (Some(at), Some(every)) = (turns_ns, every) else { continue };
        if now_ns < at {
            continue;
        }
        if lines.is_empty() {
            for Port { machine, .. } in &ports {
                machine.lock().unwrap_or_else(PoisonError::into_inner).plug_in(now_ns);
            }
            lines = open(&ports, &mut links, out)?;
            turns_ns = Some(now_ns + every);
        } else {
            // The terminals close first: an unplugged unit must not reach its host.
            lines.clear();
            for Port { machine, .. } in &ports {
                machine.lock().unwrap_or_else(PoisonError::into_inner).unplug();
            }
            writeln!(out, "unplugged for {} s", OUT / SECOND)?;
            turns_ns = Some(now_ns + OUT);
        }
        out.flush()?;
    }
    drop(lines);
    note_commands(&ports, &mut commands);
    let tally = ports.iter().map(|port| port.machine.lock().unwrap_or_else(PoisonError::into_inner).wire().tally());
    let seconds = (Monotonic.now_ns() - begin_ns) as f64 / SECOND as f64;
    out.write_all(summary(seconds, tally.fold(Tally::default(), |sum, each| sum + each), &commands).as_bytes())?;
    Ok(())
}

/// Opens terminals for all ports, prints their names, and links to them.
fn open(ports: &[Port], links: &mut [Option<Link>], out: &mut impl Write) -> Result<Vec<Pty>, Failure> {
    let mut lines = Vec::new();
    for (Port { name, machine }, link) in ports.iter().zip(links) {
        let pty = Pty::run(Arc::clone(machine))
            .map_err(|e| Failure::new(format!("cannot open a pseudo-terminal: {e}; check that /dev/pts is mounted")))?;
        match link {
            Some(link) => {
                link.point_to(pty.path())?;
                writeln!(out, "{}  {name}, linked from {}", pty.path().display(), link.path.display())?;
            }
            None => writeln!(out, "{}  {name}", pty.path().display())?,
        }
        lines.push(pty);
    }
    Ok(lines)
}

/// Counts the commands obeyed since the last call.
fn note_commands(ports: &[Port], commands: &mut BTreeMap<String, u64>) {
    for Port { machine, .. } in ports {
        for command in machine.lock().unwrap_or_else(PoisonError::into_inner).take_obeyed() {
            let text = words(&command);
            let known = commands.len() < MOST_COMMANDS || commands.contains_key(&text);
            *commands.entry(if known { text } else { "others".into() }).or_default() += 1;
        }
    }
}

/// Formats a command for people.
fn words(command: &[u8]) -> String {
    // VIPER commands begin with a marker and a length; the command word follows the unit's
    // number.
    let word = |at: usize| {
        command.get(at..at + 4).and_then(|word| word.try_into().ok()).map(u32::from_le_bytes).unwrap_or_default()
    };
    if command.starts_with(b"VPRC") {
        let action = ["set", "get", "reset"].get(word(16) as usize).unwrap_or(&"do");
        return format!("{action} {}", word(12));
    }
    let text: String = command
        .trim_ascii_end()
        .iter()
        .map(|byte| match byte {
            0..0x20 => format!("^{}", char::from(byte + 0x40)),
            0x20..0x7f => char::from(*byte).to_string(),
            _ => format!("{byte:02x}"),
        })
        .collect();
    if text.is_empty() { "end of line".into() } else { text }
}

/// Summarises the simulation.
fn summary(seconds: f64, tally: Tally, commands: &BTreeMap<String, u64>) -> String {
    let Tally { bytes, dropped, garbled, withheld } = tally;
    let mut text = format!(
        "{seconds:.1} s: {bytes} bytes sent, {dropped} of them lost and {garbled} garbled; {withheld} records not \
        sent\n"
    );
    text += &match commands.is_empty() {
        true => "no program sent a command\n".to_owned(),
        false => {
            let list: Vec<String> = commands.iter().map(|(what, times)| format!("{what} ×{times}")).collect();
            format!("obeyed: {}\n", list.join("; "))
        }
    };
    text
}

/// A stable name for terminals that come and go.
struct Link {
    path: PathBuf,
    /// Its target, as set by this program.
    target: Option<PathBuf>,
}

impl Link {
    /// Refuses to replace anything but a link.
    fn check(&self) -> Result<(), Failure> {
        match std::fs::symlink_metadata(&self.path) {
            Ok(there) if !there.is_symlink() => Err(Failure::usage(format!(
                "--link {}: exists and is not a link; give another name",
                self.path.display()
            ))),
            _ => Ok(()),
        }
    }

    /// Replaces the link atomically, so that it always points to the old terminal or to the new
    /// one.
    fn point_to(&mut self, target: &Path) -> Result<(), Failure> {
        self.check()?;
        let path = self.path.display().to_string();
        let failed = |e: std::io::Error| {
            Failure::usage(format!("--link {path}: cannot make the link: {e}; give a name in your own folder"))
        };
        let mut beside = self.path.clone().into_os_string();
        beside.push(format!(".{}", std::process::id()));
        std::os::unix::fs::symlink(target, &beside).map_err(failed)?;
        std::fs::rename(&beside, &self.path).map_err(failed)?;
        self.target = Some(target.to_owned());
        Ok(())
    }
}

impl Drop for Link {
    fn drop(&mut self) {
        // Another twin may have taken the name meanwhile, and keeps it.
        if self.target.is_some() && std::fs::read_link(&self.path).ok() == self.target {
            let _ = std::fs::remove_file(&self.path);
        }
    }
}

impl Arguments {
    fn faults(&self) -> Result<Faults, Failure> {
        if !(-1e5..=1e5).contains(&self.drift) {
            fail_usage!("--drift {}: must be at most 100000 parts in a million", self.drift);
        }
        Ok(Faults {
            seed: self.seed,
            drop: self.drop,
            noise: self.garble,
            dropout: self.dropout,
            drift_ppm: self.drift,
            latency_ns: ns("latency", self.latency, MS)?,
            jitter_ns: ns("jitter", self.jitter, MS)?,
            packet_ns: ns("packets", self.packets, MS)?,
        })
    }

    fn stations(&self) -> Result<u8, Failure> {
        let (unit, most) = (name(self.unit), self.unit.most_stations());
        match self.stations {
            Some(_) if self.unit.is_arm() => {
                Err(Failure::usage(format!("--stations: {unit} is an arm and has no stations; leave it out")))
            }
            Some(stations) if !(1..=most).contains(&stations) => {
                Err(Failure::usage(format!("--stations {stations}: {unit} has {most}; give 1 to {most}")))
            }
            stations => Ok(stations.unwrap_or(most.min(2))),
        }
    }

    /// Refuses settings that the unit does not support.
    fn check(&self) -> Result<(), Failure> {
        let (unit, rates) = (name(self.unit), self.unit.rates());
        let states = self.unit.states();
        if !states.contains(&self.found) {
            let states: Vec<String> = states.iter().map(|found| name(*found)).collect();
            fail_usage!("--found {}: is not possible for {unit}; give one of {}", name(self.found), states.join(", "));
        }
        match self.rate {
            Some(_) if rates.is_empty() => {
                fail_usage!("--rate: {unit} has a fixed rate; leave it out");
            }
            Some(rate) if !rates.contains(&rate) => {
                fail_usage!("--rate {rate}: {unit} supports {rates:?} readings a second; give one of these");
            }
            _ => {}
        }
        match (self.unit.is_arm(), self.noise.is_some(), self.counts_per_turn) {
            (true, true, _) => Err(Failure::usage(format!(
                "--noise: does not apply to {unit}, whose counts have no noise; leave it out"
            ))),
            (false, _, Some(_)) => {
                Err(Failure::usage(format!("--counts-per-turn: {unit} is a tracker and has no counts; leave it out")))
            }
            (true, _, Some(0)) => Err(Failure::usage("--counts-per-turn 0: must be at least 1")),
            _ => Ok(()),
        }
    }

    fn trajectory(&self) -> TrajectoryName {
        let usual = if self.unit.is_arm() { TrajectoryName::Arm } else { TrajectoryName::Freehand };
        self.trajectory.unwrap_or(usual)
    }

    /// Returns the simulated scan with its trajectory; no image is rendered.
    fn bedside(&self, begin_ns: i64) -> Result<Arc<Bedside>, Failure> {
        let scene = Scene::Constant(0.0);
        let scan = Scan::new(ScanSettings {
            motion: self.trajectory().motion(&MotionOptions::default(), &scene),
            scene,
            frames: self.frames,
            gap_mm: self.gap,
            seed: self.seed,
            ..ScanSettings::default()
        })?;
        Ok(Arc::new(Bedside::new(scan, begin_ns)))
    }

    fn arm_counts(&self) -> u32 {
        self.counts_per_turn.unwrap_or(if self.unit == Unit::Microscribe { 16_384 } else { 40_000 })
    }

    /// Returns the motion that a tracker's sensors measure.
    fn motion(&self, begin_ns: i64) -> Result<Motion, Failure> {
        let motion = self.bedside(begin_ns)?.motion();
        Ok(match self.noise {
            None => motion,
            Some(TrackerNoise { position_mm, rotation_degrees }) => {
                if ![position_mm, rotation_degrees].iter().all(|sd| (0.0..=100.0).contains(sd)) {
                    fail_usage!("--noise: both standard deviations must lie between 0 and 100");
                }
                trembling(motion, position_mm, rotation_degrees, self.seed)
            }
        })
    }

    /// Returns the motion that an arm's encoders measure.
    fn joints(&self, begin_ns: i64) -> Result<Joints, Failure> {
        let arm = standard_arm(self.arm_counts().into())?;
        Ok(Arc::new(BedsideArm::new(self.bedside(begin_ns)?, arm)?).joints())
    }

    fn ports(&self, begin_ns: i64) -> Result<Vec<Port>, Failure> {
        self.check()?;
        let stations = self.stations()?;
        let faults = self.faults()?;
        let left = Left { found: self.found, stations, rate_hz: self.rate, faults, now_ns: begin_ns };
        if self.unit.is_arm() {
            self.unit.arm(&self.joints(begin_ns)?, self.arm_counts(), &left)
        } else {
            self.unit.tracker(self.motion(begin_ns)?, &left)
        }
    }

    /// Describes the simulation.
    fn describe(&self) -> Result<String, Failure> {
        let of = match (self.unit.is_arm(), self.stations()?) {
            (true, _) => format!("arm of 3 joints, {} counts a turn", self.arm_counts()),
            (false, 1) => "1 sensor".into(),
            (false, sensors) => format!("{sensors} sensors"),
        };
        let mut text = format!(
            "{}, {of}, found {}: {} sweep of {} poses, {} mm apart, to and fro; seed {}",
            name(self.unit),
            name(self.found),
            name(self.trajectory()),
            self.frames,
            self.gap,
            self.seed
        );
        let percent = |share: f64| format!("{} %", share * 100.0);
        let faults = [
            (self.drop > 0.0, format!("{} of bytes lost", percent(self.drop))),
            (self.garble > 0.0, format!("{} garbled", percent(self.garble))),
            (self.dropout > 0.0, format!("{} of records not sent", percent(self.dropout))),
            (self.drift != 0.0, format!("clock off by {} parts in a million", self.drift)),
            (self.latency > 0.0, format!("{} ms late", self.latency)),
            (self.jitter > 0.0, format!("up to {} ms of jitter", self.jitter)),
            (self.packets > 0.0, format!("packets every {} ms", self.packets)),
        ];
        let noise =
            self.noise.map(|noise| format!("noise of {} mm and {}°", noise.position_mm, noise.rotation_degrees));
        let plug = self.unplug_every.map(|s| format!("unplugged every {s} s"));
        let faults: Vec<String> =
            noise.into_iter().chain(faults.into_iter().filter(|f| f.0).map(|f| f.1)).chain(plug).collect();
        if !faults.is_empty() {
            text += &format!("\nfaults: {}", faults.join(", "));
        }
        Ok(text)
    }
}

#[cfg(test)]
mod tests;
