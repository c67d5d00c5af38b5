//! A recorded session's configuration, with the defaults of the version that recorded it.

use std::path::Path;

use clap::ValueEnum;
use serde_json::Value;

use phantom::named::SceneName;

use super::reader::Effective;
use super::schema::values::Name;
use super::settings_override::set;
use super::{Bedside, Error};
use crate::texts::ByPath;

/// The key of the virtual scanner's transducer.
const PROBE: &str = "virtual.probe";

impl Bedside {
    /// Reads a recorded session's configuration from the texts of its files. `effective` has the
    /// session's effective values. Earlier versions had no key for the virtual scanner's
    /// transducer, and always used the scene's own; such a session keeps it.
    ///
    /// # Errors
    /// [`Error`], as for [`Self::of_texts`].
    pub fn recorded(path: &Path, mut texts: ByPath, effective: &Effective) -> Result<Self, Error> {
        let scene = effective.get("virtual.scene").and_then(Value::as_str);
        let scene =
            scene.filter(|_| !effective.contains_key(PROBE)).and_then(|name| SceneName::from_str(name, false).ok());
        if let Some(probe) = scene.and_then(SceneName::usual_probe)
            && let Some(text) = texts.get_mut(path)
        {
            let bare = text.trim_start_matches('\u{feff}');
            let mut root: toml::Table = toml::from_str(bare).map_err(|e| Error::Value(e.to_string()))?;
            set(&mut root, PROBE, &serde_json::to_value(Name(probe)).unwrap_or_default())?;
            *text = toml::to_string(&root).map_err(|e| Error::Value(e.to_string()))?;
        }
        Self::of_texts(path, texts)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEAD: &str = "format = \"sonoweave-bedside\"\nversion = 1\n[grabber]\ndevice = \"virtual\"\n";
    const ARM: &str = "[arm]\nkind = \"ea1\"\nport = \"virtual\"\n";
    const TRACKER: &str = "[tracker]\nmodel = \"fastrak\"\nport = \"virtual\"\n";

    fn read(text: &str) -> Bedside {
        Bedside::parse(Path::new("bed.toml"), text).unwrap()
    }

    #[test]
    fn linear_probe_is_default_of_arms_with_echoes() {
        for (more, probe) in [
            (ARM.to_owned(), Value::from("linear")),
            (format!("{ARM}[virtual]\nprobe = \"curvilinear\"\n"), "curvilinear".into()),
            (format!("{ARM}[virtual]\nscene = \"blobs\"\n"), Value::Null),
            (TRACKER.to_owned(), "curvilinear".into()),
            (format!("{TRACKER}[virtual]\nscene = \"n-wire\"\n"), "linear".into()),
            (format!("{TRACKER}[virtual]\nprobe = \"linear\"\n"), "linear".into()),
        ] {
            let bedside = read(&format!("{HEAD}{more}"));
            assert_eq!(bedside.effective[PROBE], probe, "{more}");
            assert_eq!(bedside.mask.fan.is_some(), probe == "curvilinear", "{more}");
        }
        let without_echoes = format!("{HEAD}{ARM}[virtual]\nscene = \"blobs\"\nprobe = \"linear\"\n");
        let error = Bedside::parse(Path::new("bed.toml"), &without_echoes).unwrap_err().to_string();
        assert!(error.contains("virtual.probe (line 10): the scene has no simulated echoes; "), "{error}");
    }

    #[test]
    fn sessions_of_earlier_versions_keep_their_probe() {
        let now = read(&format!("{HEAD}{ARM}"));
        let mut then = now.effective.clone();
        then.remove(PROBE);
        let recorded = |effective| Bedside::recorded(&now.path, now.texts.clone(), effective).unwrap();
        let (earlier, later) = (recorded(&then), recorded(&now.effective));
        assert_eq!((earlier.mask.fan.is_some(), later.mask.fan.is_some()), (true, false));
        assert_eq!((&earlier.effective[PROBE], &later.effective[PROBE]), (&"curvilinear".into(), &"linear".into()));
        // Its texts, too, so that the same session with other settings has the same probe.
        assert!(Bedside::of_texts(&earlier.path, earlier.texts).unwrap().mask.fan.is_some());
        // Without a virtual bedside nothing is changed.
        let real = read(&format!("{HEAD}{ARM}").replace("\"virtual\"", "\"/dev/null\""));
        let texts = real.texts.clone();
        assert_eq!(Bedside::recorded(&real.path, texts, &real.effective).unwrap().texts, real.texts);
    }
}
