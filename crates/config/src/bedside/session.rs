//! Session settings: pairing of frames with poses, recording, status, and viewers.

use std::net::{IpAddr, SocketAddr};
use std::path::PathBuf;

use ipnet::IpNet;

use calibration::file::preset::{Preset, Ruler};
use calibration::tracker::noise::{LEAST_FAST, RestNoise};
use sync::smoothing::Smoothing;

use super::reader::Reader;
use super::schema::{self, values::ns};
use crate::{Error, values};

pub use super::schema::session::{MarkerEdge, MarkerInput, Realtime};

/// Pairing of frames with poses.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Pairing {
    /// Longest time that a frame waits for poses around its time, ns.
    pub wait_ns: i64,
    /// Longest time between two poses for interpolation, ns.
    pub longest_gap_ns: i64,
    /// Smoothing of a tracker's poses; `None` if they are interpolated.
    pub smoothing: Option<Smoothing>,
}

impl Pairing {
    /// Reads the section. Smoothing is refused for an arm, and for a resting sensor's noise that it
    /// would not lower.
    pub(super) fn read(mut keys: Reader<'_, '_>, is_arm: bool, noise: Option<RestNoise>) -> Result<Self, Error> {
        const KEY: &str = "smoothing_ms";
        let schema::session::Pairing { wait_ms, longest_gap_ms, smoothing_ms, smoothing_ahead_ms } = keys.read()?;
        let smoothing = (smoothing_ms > 0.0)
            .then(|| Smoothing { half_width_ns: ns(smoothing_ms), ahead_ns: ns(smoothing_ahead_ms) });
        if smoothing.is_some() && is_arm {
            let why = "an arm's encoders have no noise that smoothing would average out; delete the key";
            return Err(keys.error(KEY, why));
        }
        let [least, _] = values::SMOOTHING_MS;
        if smoothing.is_some() && smoothing_ms < least {
            let why = format!("must be 0 or at least {least}: fewer poses average nothing out");
            return Err(keys.error(KEY, why));
        }
        let [position, rotation] = noise.map_or([1.0; 2], |noise| noise.fast_shares());
        if smoothing.is_some() && position.min(rotation) < LEAST_FAST {
            let why = format!(
                "the calibration file says that the resting sensor's noise is slow: from one pose to the next are \
                 only {:.0} % of the position's and {:.0} % of the rotation's. Smoothing would leave the rest, and \
                 state too small an error; delete the key",
                100.0 * position,
                100.0 * rotation
            );
            return Err(keys.error(KEY, why));
        }
        Ok(Self { wait_ns: ns(wait_ms), longest_gap_ns: ns(longest_gap_ms), smoothing })
    }
}

/// The ultrasound scanner.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Scanner {
    /// Time of equal images at changing poses after which the scanner counts as stuck, ns.
    pub stuck_after_ns: i64,
}

impl Scanner {
    pub(super) fn read(mut keys: Reader<'_, '_>, preset: Option<&Preset>) -> Result<Self, Error> {
        let schema::session::Scanner { frozen_s, ruler } = keys.read()?;
        let ruler = ruler.and_then(|ruler| Ruler::new(ruler.px, ruler.mm));
        keys.note("ruler", &ruler.map(|Ruler { px, mm }| [px, mm]));
        if let Some(Err(misfit)) = preset.map(|preset| preset.fits(None, ruler)) {
            return Err(keys.error("ruler", misfit.to_string()));
        }
        Ok(Self { stuck_after_ns: (frozen_s * 1e9).round() as i64 })
    }
}

/// The recording.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Record {
    /// Folder for recorded sessions, if they are recorded.
    pub folder: Option<PathBuf>,
    /// Keep the whole video frame.
    pub full_frame: bool,
    /// Free disk space at which the recording ends, bytes.
    pub keep_free_bytes: u64,
}

impl Record {
    pub(super) fn read(mut keys: Reader<'_, '_>) -> Result<Self, Error> {
        let schema::session::Record { folder, full_frame, keep_free_mb } = keys.read()?;
        Ok(Self { folder: keys.path_if(folder), full_frame, keep_free_bytes: u64::from(keep_free_mb) * 1_000_000 })
    }
}

/// Publication of the session's status.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Status {
    /// Address; `None` if it is not published.
    pub listen: Option<SocketAddr>,
    /// Access control.
    pub access: Access,
}

/// Access control and names of the browser console. Its files are read when the session begins,
/// and are not part of the recording.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Access {
    /// The server's certificate, and those between it and one that browsers know; PEM.
    pub certificate: Option<PathBuf>,
    /// Its private key, PEM.
    pub key: Option<PathBuf>,
    /// The file of the token that clients must present.
    pub token_file: Option<PathBuf>,
    /// The file of a token that gives the metrics and nothing else.
    pub metrics_token_file: Option<PathBuf>,
    /// Names and addresses of this machine besides those of the certificate, in lower case.
    pub names: Vec<String>,
}

impl Status {
    pub(super) fn read(mut keys: Reader<'_, '_>) -> Result<Self, Error> {
        let given: schema::session::Status = keys.read()?;
        let listen = given.listen.map(|listen| values::address(&listen)).transpose();
        let listen = listen.map_err(|why| keys.error("listen", why.to_string()))?;
        let [certificate, key, token_file, metrics_token_file] =
            [given.certificate, given.key, given.token_file, given.metrics_token_file].map(|path| keys.path_if(path));
        let names = given.names.iter().enumerate();
        let names = names.map(|(n, name)| host_name(name).map_err(|why| keys.error(&format!("names[{n}]"), why)));
        let names = names.collect::<Result<Vec<_>, _>>()?;
        keys.note("names", &names);
        Ok(Self { listen, access: Access { certificate, key, token_file, metrics_token_file, names } })
    }
}

/// A line that marks moments.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MarkerLine {
    /// The serial port.
    pub port: PathBuf,
    /// Its input.
    pub input: MarkerInput,
    /// The edge that marks a moment.
    pub edge: MarkerEdge,
}

impl MarkerLine {
    pub(super) fn read(mut keys: Reader<'_, '_>) -> Result<Option<Self>, Error> {
        let schema::session::Markers { port, input, edge } = keys.read()?;
        Ok(port.map(|port| Self { port: port.into(), input: input.0, edge: edge.0 }))
    }
}

/// The OpenIGTLink server.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Igtl {
    /// Networks of other machines that may connect; none: only this machine.
    pub allow: Vec<IpNet>,
}

impl Igtl {
    pub(super) fn read(mut keys: Reader<'_, '_>) -> Result<Self, Error> {
        let schema::session::Igtl { allow } = keys.read()?;
        let networks = allow
            .iter()
            .enumerate()
            .map(|(n, text)| values::network(text).map_err(|why| keys.error(&format!("allow[{n}]"), why.to_string())));
        let allow = networks.collect::<Result<Vec<_>, _>>()?;
        keys.note("allow", &allow.iter().map(IpNet::to_string).collect::<Vec<_>>());
        Ok(Self { allow })
    }
}

/// Parses a machine's name or address, as browsers write it.
fn host_name(text: &str) -> Result<String, String> {
    let name = text.to_ascii_lowercase();
    let is_name = name.len() <= 253
        && name.split('.').all(|part| {
            (1..=63).contains(&part.len())
                && part.bytes().all(|b| b.is_ascii_alphanumeric() || matches!(b, b'-' | b'_'))
        });
    let is_address = name.parse::<IpAddr>().is_ok();
    if is_name || is_address {
        return Ok(name);
    }
    Err(format!(
        "\"{text}\" is not a machine's name; give the name in the browser's address, without a port, such as \
        \"bedside-3.local\""
    ))
}

/// The session among the machine's other programs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Process {
    /// Whether it runs with real-time scheduling.
    pub realtime: Realtime,
}

impl Process {
    pub(super) fn read(mut keys: Reader<'_, '_>) -> Result<Self, Error> {
        let schema::session::Process { realtime } = keys.read()?;
        Ok(Self { realtime: realtime.0 })
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use sync::smoothing::Smoothing;

    use super::super::Bedside;

    fn with_allow(list: &str) -> Result<Bedside, String> {
        let text = format!(
            "format = \"sonoweave-bedside\"\nversion = 1\n[tracker]\nmodel = \"fastrak\"\nport = \"virtual\"\n\
             [grabber]\ndevice = \"virtual\"\n[igtl]\nallow = {list}\n"
        );
        Bedside::parse(Path::new("bed.toml"), &text).map_err(|error| error.to_string())
    }

    /// A session with a real tracker, this pairing, and this noise of a resting sensor in its
    /// calibration file.
    fn smoothed(pairing: &str, noise: &str) -> Result<Option<Smoothing>, String> {
        let text = format!(
            "format = \"sonoweave-bedside\"\nversion = 1\n[tracker]\nmodel = \"fastrak\"\nport = \"/dev/ttyUSB0\"\n\
             [grabber]\ndevice = \"/dev/video0\"\n[calibration]\nfile = \"probe.toml\"\n[pairing]\n{pairing}\n"
        );
        let probe = format!(
            "format = \"sonoweave-calibration\"\nversion = 1\n[image_to_probe]\nmatrix = [0.1, 0, 0, 0, 0, 0.1, 0, 0, 0, 0, \
             0.1, 0, 0, 0, 0, 1]\n{noise}"
        );
        let texts = [("bed.toml".into(), text), ("probe.toml".into(), probe)];
        let read = Bedside::of_texts(Path::new("bed.toml"), texts.into_iter().collect());
        read.map(|bedside| bedside.pairing.smoothing).map_err(|error| error.to_string())
    }

    #[test]
    fn smoothing_is_off_by_default_and_read_in_ms() {
        assert_eq!(smoothed("", ""), Ok(None));
        assert_eq!(smoothed("smoothing_ms = 0\nsmoothing_ahead_ms = 100", ""), Ok(None));
        let found = smoothed("smoothing_ms = 250", "").unwrap().unwrap();
        assert_eq!(found, Smoothing { half_width_ns: 250_000_000, ahead_ns: 33_000_000 });
        let found = smoothed("smoothing_ms = 250\nsmoothing_ahead_ms = 250", "").unwrap().unwrap();
        assert_eq!(found.ahead_ns, 250_000_000);
        let fast = "[tracker_noise]\nposition_mm = 0.1\nrotation_deg = 0.1\nfast_position_mm = 0.06\nfast_rotation_deg = 0.09\n";
        assert!(smoothed("smoothing_ms = 250", fast).unwrap().is_some());
    }

    #[test]
    fn smoothing_that_would_be_wrong_is_refused_with_reason() {
        let slow = "[tracker_noise]\nposition_mm = 0.2\nrotation_deg = 0.1\nfast_position_mm = 0.05\nfast_rotation_deg = 0.09\n";
        assert_eq!(smoothed("", slow), Ok(None), "without smoothing it does not matter");
        let refused = smoothed("smoothing_ms = 250", slow).unwrap_err();
        assert!(
            refused.starts_with("bed.toml: pairing.smoothing_ms (line 11): the calibration file says that the resting")
                && refused.contains("only 25 % of the position's and 90 % of the rotation's")
                && refused.ends_with("delete the key"),
            "{refused}"
        );
        let refused = smoothed("smoothing_ms = 49", "").unwrap_err();
        assert!(refused.contains("pairing.smoothing_ms (line 11): must be 0 or at least 50"), "{refused}");
        let refused = smoothed("smoothing_ms = 5000", "").unwrap_err();
        assert!(refused.contains("pairing.smoothing_ms (line 11)") && refused.contains("1000"), "{refused}");
        let arm = "format = \"sonoweave-bedside\"\nversion = 1\n[arm]\nkind = \"ea1\"\nport = \"virtual\"\n[grabber]\n\
                   device = \"virtual\"\n[pairing]\nsmoothing_ms = 250\n";
        let refused = Bedside::parse(Path::new("bed.toml"), arm).unwrap_err().to_string();
        assert!(refused.contains("pairing.smoothing_ms (line 9): an arm's encoders have no noise"), "{refused}");
    }

    #[test]
    fn allowed_networks_are_read_in_any_notation() {
        let read =
            |list: &str| with_allow(list).unwrap().igtl.allow.iter().map(ToString::to_string).collect::<Vec<_>>();
        assert_eq!(read("[]"), [""; 0]);
        let all = "[\"192.168.0.0/24\", \" 10.1.2.3 \", \"fd00:0:0:1::/64\", \"::ffff:172.16.0.0/108\", \"::1\"]";
        assert_eq!(read(all), ["192.168.0.0/24", "10.1.2.3/32", "fd00:0:0:1::/64", "172.16.0.0/12", "::1/128"]);
        assert_eq!(read("[\"0.0.0.0/1\"]"), ["0.0.0.0/1"]);
    }

    #[test]
    fn wrong_networks_are_refused_with_remedy() {
        for (text, expected) in [
            ("the ward", "\"the ward\" is not a network; give an address and the number of its leading bits, such as"),
            ("192.168.0.0/33", "is not a network"),
            ("192.168.0.0/255.255.255.0", "is not a network"),
            ("192.168.0", "is not a network"),
            ("", "\"\" is not a network"),
            ("192.168.0.7/24", "give \"192.168.0.0/24\" for the network, or \"192.168.0.7\" for the one machine"),
            ("fd00::7/64", "give \"fd00::/64\" for the network, or \"fd00::7\""),
            ("0.0.0.0/0", "\"0.0.0.0/0\" holds all addresses, so that everybody would be admitted"),
            ("::/0", "holds all addresses"),
            ("::ffff:0.0.0.0/96", "holds all addresses"),
        ] {
            let error = with_allow(&format!("[\"127.0.0.1\", \"{text}\"]")).err().unwrap_or_else(|| panic!("{text}"));
            assert!(error.starts_with("bed.toml: igtl.allow[1] (line 9): ") && error.contains(expected), "{error}");
        }
        for (list, expected) in [("\"10.0.0.0/8\"", "must be a list of texts"), ("[10]", "must be a text")] {
            let error = with_allow(list).err().unwrap();
            assert!(error.contains(expected), "{error}");
        }
    }

    #[test]
    fn changed_networks_are_adopted_at_once() {
        let [mut running, same, other] =
            ["[\"10.1.2.3\"]", "[\"10.1.2.3/32\"]", "[\"10.0.0.0/8\"]"].map(|list| with_allow(list).unwrap());
        assert!(running.changes(&same).is_empty(), "another notation is no change");
        let changes = running.changes(&other);
        assert_eq!((changes.at_once[0].key.as_str(), changes.next_session.len()), ("igtl.allow", 0));
        running.adopt(&other);
        assert_eq!(running.igtl, other.igtl);
    }
}
