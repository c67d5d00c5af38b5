//! Noise of the tracker's sensors, from the best source that states it.

use calibration::tracker::noise::TrackerNoise;

use super::devices::Tracking;
use super::file::Bedside;

impl Bedside {
    /// Returns the noise of a sensor's pose: by the configuration, the virtual bedside, the
    /// calibration file, or the residuals of the probe's calibration. `None` if all are silent, and
    /// for an arm, which has no sensors.
    pub fn sensor_noise(&self) -> Option<TrackerNoise> {
        let given = match &self.tracking {
            Tracking::Tracker(tracker) => tracker.noise,
            Tracking::Remote(remote) => remote.noise,
            Tracking::Arm(_) => return None,
        };
        let simulated = self.virtual_bedside.as_ref().filter(|_| self.tracking.is_virtual()).map(|virtual_bedside| {
            let noise = virtual_bedside.scan.settings().tracker_noise;
            TrackerNoise { position_mm: noise.position_mm, rotation_deg: noise.rotation_degrees }
        });
        given.or(simulated).or_else(|| self.calibration.sensor_noise())
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    const VIRTUAL: &str =
        "[grabber]\ndevice = \"virtual\"\n[virtual]\ntracker_noise_mm = 0.2\ntracker_noise_deg = 0.1\n";
    const PROBE: &str = "format = \"sonoweave-calibration\"\nversion = 1\n[image_to_probe]\nmatrix = [0.1, 0, 0, 0, \
        0, 0.1, 0, 0, 0, 0, 0.1, 0, 0, 0, 0, 1]\nmade = \"2001-02-03\"\npicture_px = [64, 48]\n[image_to_probe.quality]\n\
        frames = 90\nerror_mm = [0.4, 0.2]\ncentre_mm = 0.1\ncorner_mm = 0.2\nsensor_mm = 0.3\nsensor_deg = 0.2\n";
    const REST: &str = "[tracker_noise]\nposition_mm = 0.05\nrotation_deg = 0.03\n";

    fn read(tracker: &str, more: &str, probe: &str) -> Result<Bedside, String> {
        let bed =
            format!("format = \"sonoweave-bedside\"\nversion = 1\n[tracker]\nmodel = \"fastrak\"\n{tracker}\n{more}");
        let texts = [("bed.toml".into(), bed), ("probe.toml".into(), probe.into())];
        Bedside::of_texts(Path::new("bed.toml"), texts.into_iter().collect()).map_err(|e| e.to_string())
    }

    #[test]
    fn noise_is_that_of_best_source() {
        let noise = |tracker: &str, more: &str, probe: &str| {
            read(tracker, more, probe).unwrap().sensor_noise().map(|noise| [noise.position_mm, noise.rotation_deg])
        };
        let real = "port = \"/dev/ttyUSB0\"";
        let file = "[grabber]\ndevice = \"/dev/video0\"\n[calibration]\nfile = \"probe.toml\"\n";
        let both = format!("{PROBE}{REST}");
        assert_eq!(noise("port = \"virtual\"", VIRTUAL, ""), Some([0.2, 0.1]));
        assert_eq!(noise(real, file, PROBE), Some([0.3, 0.2]), "by the residuals");
        assert_eq!(noise(real, file, &both), Some([0.05, 0.03]), "at rest");
        let given = format!("{real}\nnoise = {{ mm = 0.07, deg = 0.0 }}");
        assert_eq!(noise(&given, file, &both), Some([0.07, 0.0]));
        let bare = &PROBE[..PROBE.find("[image_to_probe.quality]").unwrap()];
        assert_eq!(noise(real, file, bare), None);
        for (noise, says) in [("{ mm = 0.07 }", "deg"), ("{ mm = -1, deg = 0 }", "between 0 and 10")] {
            let refused = read(&format!("{real}\nnoise = {noise}"), file, PROBE).unwrap_err();
            assert!(refused.contains("tracker.noise") && refused.contains(says), "{refused}");
        }
    }

    #[test]
    fn own_calibration_has_age_and_size_and_virtual_one_is_exact() {
        let file = "[grabber]\ndevice = \"/dev/video0\"\n[calibration]\nfile = \"probe.toml\"\n";
        let bedside = read("port = \"/dev/ttyUSB0\"", file, PROBE).unwrap();
        assert!(
            bedside.notes.iter().any(|note| note.starts_with("the probe's calibration was made")),
            "{:?}",
            bedside.notes
        );
        assert_eq!((bedside.mask.picture_px, bedside.calibration.record.covariance), (Some([64, 48]), None));
        let simulated = read("port = \"virtual\"", VIRTUAL, "").unwrap().calibration.record.covariance.unwrap();
        assert!(simulated.components().is_empty());
    }
}
