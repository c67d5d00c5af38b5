//! A server in place of a tracker or a grabber: OpenIGTLink, as used by PLUS.

use calibration::tracker::noise::TrackerNoise;
use drivers::OpenSettings;
use drivers::grabber::GrabberSettings;
use drivers::openigtlink::{RemotePictures, RemoteSettings, RemoteTransforms};

use super::frames::{PROBE_FRAME, REFERENCE_FRAME, STYLUS_FRAME};
use super::reader::Reader;
use super::schema;
use crate::Error;

/// Prefix of the address of an image server, in place of a grabber's name.
pub(super) const PREFIX: &str = "openigtlink:";

/// A server that sends the probe's poses.
#[derive(Debug, Clone, PartialEq)]
pub struct Remote {
    /// Address, `HOST:PORT`.
    pub address: String,
    /// Its transforms by their names there, and their source frames; their target is the
    /// tracker's frame. The probe's is the first.
    pub transforms: Vec<(String, &'static str)>,
    /// Shortest requested time between two messages, ms.
    pub interval_ms: u32,
    /// Noise of a sensor's pose, if the configuration gives it.
    pub noise: Option<TrackerNoise>,
    /// Latency of its times beyond the delay that the driver knows, ns.
    pub latency_ns: i64,
}

impl Remote {
    /// Returns the settings to open it.
    pub fn open_settings(&self) -> OpenSettings {
        let names = self.transforms.iter().map(|(name, _)| name.clone()).collect();
        let transforms = Some(RemoteTransforms { names, interval_ms: self.interval_ms });
        OpenSettings::Remote(RemoteSettings { address: self.address.clone(), pictures: None, transforms })
    }

    pub(super) fn read(mut keys: Reader<'_, '_>, latency_ms: f64) -> Result<Self, Error> {
        let given: schema::devices::Remote = keys.read()?;
        let address = keys.need("address", given.address)?;
        let mut transforms = vec![(given.probe, PROBE_FRAME)];
        let others = [("reference", given.reference, REFERENCE_FRAME), ("stylus", given.stylus, STYLUS_FRAME)];
        for (key, name, frame) in others {
            let Some(name) = name else { continue };
            if transforms.iter().any(|(other, _)| *other == name) {
                return Err(
                    keys.error(key, format!("{name} belongs to another sensor; give each sensor its own transform"))
                );
            }
            transforms.push((name, frame));
        }
        let latency_ns = keys.latency_ns(given.latency_ms, latency_ms);
        let noise = keys.noise(given.noise)?;
        let remote = Self { address, transforms, interval_ms: given.interval_ms, noise, latency_ns };
        drivers::open(&remote.open_settings()).map_err(|error| keys.refused(&error))?;
        Ok(remote)
    }
}

/// Returns the settings to open an image server, if the grabber's name is one.
pub(super) fn pictures(grabber: &GrabberSettings) -> Option<OpenSettings> {
    let address = grabber.device.strip_prefix(PREFIX)?.to_owned();
    let pictures = Some(RemotePictures { device: grabber.input.clone(), orientation: grabber.orientation });
    Some(OpenSettings::Remote(RemoteSettings { address, pictures, transforms: None }))
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::super::{Bedside, Tracking};
    use super::*;

    fn parse(text: &str) -> Result<Bedside, String> {
        Bedside::parse(Path::new("bed.toml"), text).map_err(|error| error.to_string())
    }

    #[test]
    fn example_gives_server_transforms_and_image() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/examples/plus-server.toml");
        let server = Bedside::read(&path).unwrap();
        let Tracking::Remote(remote) = &server.tracking else { panic!("a server") };
        let expected = [("ProbeToTracker".to_owned(), "Probe"), ("ReferenceToTracker".to_owned(), "Reference")];
        assert_eq!((remote.address.as_str(), &remote.transforms[..]), ("127.0.0.1:18944", &expected[..]));
        let names = [("Probe".to_owned(), "Tracker".to_owned()), ("Reference".to_owned(), "Tracker".to_owned())];
        assert_eq!(server.tracking.names(), names);
        let OpenSettings::Remote(pictures) = server.grabber.open_settings() else { panic!("a server's pictures") };
        assert_eq!((pictures.address.as_str(), pictures.transforms), ("127.0.0.1:18944", None));
        assert_eq!(pictures.pictures.unwrap().orientation, "MF");
    }

    #[test]
    fn unsupported_server_settings_named_by_key() {
        let with = |remote: &str, grabber: &str| {
            parse(&format!(
                "format = \"sonoweave-bedside\"\nversion = 1\n[remote]\n{remote}\n[grabber]\ndevice = \"{grabber}\"\n"
            ))
        };
        let good = "address = \"plus:18944\"";
        assert!(with(good, "openigtlink:plus:18944").is_ok());
        for (remote, grabber, expected) in [
            ("", "openigtlink:plus:18944", ["remote.address", "HOST:PORT"]),
            ("address = \"plus\"", "openigtlink:plus:18944", ["address", "is not an address"]),
            (good, "openigtlink:plus", ["device", "is not an address"]),
            (&*format!("{good}\nstylus = \"ProbeToTracker\""), "/dev/video0", ["stylus", "belongs to another sensor"]),
            (
                &*format!("{good}\nprobe = \"TransducerInTheHandToTracker\""),
                "/dev/video0",
                ["probe", "28 bytes, and 20 fit"],
            ),
            (
                &*format!("{good}\n[arm]\nkind = \"ea1\"\nport = \"virtual\""),
                "/dev/video0",
                ["remote", "[arm] is there too"],
            ),
        ] {
            let why = with(remote, grabber).unwrap_err();
            assert!(expected.iter().all(|part| why.contains(part)), "{why}");
        }
    }
}
