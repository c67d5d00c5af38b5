//! `sonoweave init`: writes a session configuration for the devices of this machine.

use std::io::{BufRead, Write as _};
use std::path::{Path, PathBuf};

use clap::Args;

use config::bedside::{Bedside, VIRTUAL};
use drivers::Listing;
use formats::whole::{persist_new, temporary, write_whole};

use super::Failure;
use super::print::print;
use super::progress::say;
use crate::app::init::{Answers, Found, arms, trackers};
use crate::app::input;
use crate::app::json::JsonFlag;
use crate::app::live::check;

/// Flags of `init`.
#[derive(Debug, Args)]
#[command(after_long_help = "\
The command lists the devices that are plugged in, and asks for what the flags do not say: an empty answer takes the \
value in brackets. It writes a commented configuration, and checks it as `live --check` does. The exit code is 0 if \
only the calibration is missing, which is the next step.

Examples:
  sonoweave init
  sonoweave init --tracker fastrak --port /dev/ttyUSB0 --grabber /dev/video0 --yes
  sonoweave init --tracker fastrak --port virtual --grabber virtual --yes -o virtual.toml")]
pub struct Arguments {
    /// Write the configuration to this file
    #[arg(short, long, value_name = "FILE.toml", default_value = "bedside.toml")]
    output: PathBuf,
    /// Model of the tracker or kind of the arm [default: that of a tracker on USB]
    #[arg(long, value_name = "MODEL", value_parser = trackers().into_iter().chain(arms()).collect::<Vec<_>>())]
    tracker: Option<String>,
    /// Its serial line, usb, or virtual; three lines of an arm with one for each joint [default:
    /// the only one that is plugged in]
    #[arg(long, value_name = "PORT[,PORT,PORT]", value_delimiter = ',')]
    port: Vec<String>,
    /// Station of the sensor on the patient [default: none]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(1..=16))]
    reference_station: Option<u8>,
    /// Frame grabber, by its name in `sonoweave devices`, or virtual [default: the only one that
    /// is plugged in]
    #[arg(long, value_name = "DEVICE")]
    grabber: Option<String>,
    /// Calibration file of the probe [default: none yet]
    #[arg(long, value_name = "CAL.toml")]
    calibration: Option<String>,
    /// Record sessions in this folder; it is created if missing [default: not recorded]
    #[arg(long, value_name = "DIR")]
    record: Option<String>,
    /// Ask nothing: take flags and defaults
    #[arg(long)]
    yes: bool,
    /// Overwrite an existing configuration
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    json: JsonFlag,
}

/// Runs the command.
///
/// # Errors
/// [`Failure`] when an answer is missing, the file exists or cannot be written, or the check finds
/// more than a missing calibration. The configuration exists in the last case.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let Arguments { output, force, json, .. } = arguments;
    input::check_output(output)?;
    json.check([output.as_path()])?;
    if output.exists() && !force {
        fail!("{}: exists; give another name by -o, or overwrite it by --force", output.display());
    }
    let text = arguments.answers(&Found::now())?.text();
    // A wrong answer leaves no file.
    Bedside::parse(output, &text).map_err(Failure::configuration)?;
    save(output, &text, *force).map_err(|error| Failure::io(output, "writing", &error))?;
    say(&format!("{} is written; its devices are checked now", output.display()));
    let bedside = Bedside::read(output).map_err(Failure::configuration)?;
    if let Some(folder) = &bedside.record.folder {
        std::fs::create_dir_all(folder).map_err(|error| Failure::io(folder, "making the folder", &error))?;
    }
    let report = check::check(&bedside, false)?;
    print(&report.text())?;
    json.write(&report)?;
    if bedside.calibrated().is_err() {
        print_line!(
            "next: sonoweave calibrate probe --live {0} -o probe.toml, then file = \"probe.toml\" under [calibration] in {0}",
            output.display()
        );
    } else if report.verdict().is_none() {
        print_line!("next: sonoweave live --config {}", output.display());
    }
    report.verdict_but("calibration").map_or(Ok(()), |sentence| Err(Failure::new(sentence)))
}

/// Writes the file; an existing one is only replaced by `force`.
fn save(path: &Path, text: &str, force: bool) -> std::io::Result<()> {
    if force {
        return write_whole(path, |to| to.write_all(text.as_bytes()));
    }
    let mut file = temporary(path)?;
    file.write_all(text.as_bytes())?;
    persist_new(file, path)
}

impl Arguments {
    /// Completes the flags with answers, or with defaults.
    fn answers(&self, found: &Found) -> Result<Answers, Failure> {
        let mut stdin = std::io::stdin().lock();
        let mut asker = Asker { answers: &mut stdin, asks: !self.yes };
        let tracker = match &self.tracker {
            Some(tracker) => tracker.clone(),
            None => asker.ask("--tracker", &models(), found.model())?,
        };
        if !trackers().contains(&tracker.as_str()) && !arms().contains(&tracker.as_str()) {
            fail_usage!(
                "--tracker {tracker}: is unknown; give one of {}, {}",
                trackers().join(", "),
                arms().join(", ")
            );
        }
        let ports = match self.port.as_slice() {
            [] => {
                let answer = asker.ask("--port", &listed("port", &found.ports), only(&found.ports))?;
                answer.split(',').map(|port| port.trim().to_owned()).collect()
            }
            ports => ports.to_vec(),
        };
        let grabber = match &self.grabber {
            Some(grabber) => grabber.clone(),
            None => asker.ask("--grabber", &listed("frame grabber", &found.grabbers), only(&found.grabbers))?,
        };
        let reference_station = match self.reference_station {
            None if trackers().contains(&tracker.as_str()) => {
                let answer = asker.ask("--reference-station", "station of the sensor on the patient", Some(""))?;
                let station = |text: &str| text.parse().ok().filter(|n| (1..=16).contains(n));
                match answer.as_str() {
                    "" => None,
                    text => Some(
                        station(text).ok_or_else(|| Failure::new(format!("{text}: is no station; give 1 to 16")))?,
                    ),
                }
            }
            station => station,
        };
        let mut optional = |given: &Option<String>, flag, question| match given {
            Some(given) => Ok(Some(given.clone())),
            None => Ok::<_, Failure>(Some(asker.ask(flag, question, Some(""))?).filter(|answer| !answer.is_empty())),
        };
        let calibration = optional(&self.calibration, "--calibration", "calibration file of the probe")?;
        let record = optional(&self.record, "--record", "folder for recordings")?;
        Ok(Answers { tracker, ports, reference_station, grabber, calibration, record })
    }
}

fn models() -> String {
    format!("tracker ({}) or arm ({})", trackers().join(", "), arms().join(", "))
}

/// Returns a question with the devices to choose from.
fn listed(what: &str, found: &[Listing]) -> String {
    let devices = found.iter().map(|device| {
        let trouble = device.unavailable.as_ref().map_or(String::new(), |why| format!("; cannot be opened: {why}"));
        format!("  {}: {}{trouble}\n", device.id, device.description)
    });
    format!("{}{what}, or {VIRTUAL}", devices.collect::<String>())
}

/// Returns the only device, if there is one.
fn only(found: &[Listing]) -> Option<&str> {
    match found {
        [device] => Some(&device.id),
        _ => None,
    }
}

/// Asks questions on stderr, and reads the answers.
struct Asker<'a> {
    answers: &'a mut dyn BufRead,
    /// Whether there is somebody to ask.
    asks: bool,
}

impl Asker<'_> {
    /// Returns the answer; the default for an empty one, or if nobody is asked.
    fn ask(&mut self, flag: &str, question: &str, default: Option<&str>) -> Result<String, Failure> {
        let mut answer = String::new();
        if self.asks {
            let shown = default.filter(|text| !text.is_empty()).map_or(String::new(), |text| format!(" [{text}]"));
            let mut stderr = std::io::stderr();
            // A closed stderr shows no question, but the answers count.
            let _ = write!(stderr, "{question}{shown}: ").and_then(|()| stderr.flush());
            self.answers.read_line(&mut answer)?;
        }
        match (answer.trim(), default) {
            ("", Some(default)) => Ok(default.to_owned()),
            ("", None) => {
                Err(Failure::new(format!("{flag}: is missing, and this machine does not say it; {question}")))
            }
            (answer, _) => Ok(answer.to_owned()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn empty_answer_is_default_missing_one_names_flag() {
        let mut typed = std::io::Cursor::new("fastrak\n\n");
        let mut asker = Asker { answers: &mut typed, asks: true };
        assert_eq!(asker.ask("--tracker", "tracker", None).unwrap(), "fastrak");
        assert_eq!(asker.ask("--port", "port", Some("/dev/ttyS0")).unwrap(), "/dev/ttyS0");
        let Failure(crate::failure::Reason { sentence, .. }) =
            asker.ask("--grabber", "frame grabber", None).unwrap_err();
        assert!(sentence.starts_with("--grabber: is missing"), "{sentence}");
        asker.asks = false;
        assert_eq!(asker.ask("--record", "folder", Some("")).unwrap(), "");
    }
}
