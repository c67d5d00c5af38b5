//! Records of runs: JSON files with figures, and what they were measured on.

use std::collections::BTreeMap;
use std::error::Error;
use std::fs;
use std::path::Path;

use serde::{Deserialize, Serialize};

/// A measured number.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Figure {
    /// A number alone.
    Value(f64),
    /// A median with its spread and the number of rounds: `median`, `p25`, `p75`, `p95`, `p99`,
    /// `least`, `most` and `rounds`, as far as they are known.
    Spread(BTreeMap<String, f64>),
}

impl Figure {
    /// Returns the number, or the median.
    pub fn value(&self) -> Option<f64> {
        match self {
            Self::Value(value) => Some(*value),
            Self::Spread(parts) => parts.get("median").copied(),
        }
    }

    /// Returns a named part of the spread.
    pub fn part(&self, name: &str) -> Option<f64> {
        match self {
            Self::Value(_) => None,
            Self::Spread(parts) => parts.get(name).copied(),
        }
    }

    /// Returns whether the parts are finite and in order.
    fn is_valid(&self) -> bool {
        let Self::Spread(parts) = self else { return self.value().is_some_and(f64::is_finite) };
        let ordered: Vec<f64> =
            ["least", "p25", "median", "p75", "p95", "p99", "most"].iter().filter_map(|n| self.part(n)).collect();
        !parts.is_empty() && parts.values().all(|v| v.is_finite()) && ordered.is_sorted()
    }
}

/// Figures of a run that have not been entered into a record yet.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Run {
    /// Whether the run was a smoke test, whose times measure nothing.
    pub quick: bool,
    /// Figures by their names.
    pub figures: BTreeMap<String, Figure>,
    /// Other programs that were measured in the same run, with the names of their sources.
    #[serde(default)]
    pub peers: BTreeMap<String, String>,
}

/// A machine.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Machine {
    /// Model of the processor.
    pub cpu: String,
    /// Cores available to the run.
    pub cores: usize,
    /// Operating system.
    pub os: String,
}

impl Machine {
    /// Returns this machine.
    pub fn this() -> Self {
        let value = |path: &str, key: &str, mark: char| {
            let text = fs::read_to_string(path).unwrap_or_default();
            let line = text.lines().find(|line| line.starts_with(key));
            line.and_then(|line| line.split_once(mark)).map(|(_, value)| value.trim().trim_matches('"').to_owned())
        };
        let unknown = || "unknown".to_owned();
        Self {
            cpu: value("/proc/cpuinfo", "model name", ':').unwrap_or_else(unknown),
            cores: std::thread::available_parallelism().map_or(1, usize::from),
            os: value("/etc/os-release", "PRETTY_NAME", '=').unwrap_or_else(unknown),
        }
    }
}

/// Figures of one run, and what they were measured on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Record {
    /// Commit of the measured sources, 7 to 40 hexadecimal digits.
    pub commit: String,
    /// Day of the measurement, `YYYY-MM-DD`.
    pub date: String,
    /// Command that measures.
    pub command: String,
    /// Machine of the measurement.
    pub machine: Machine,
    /// Hashes of git of the measured folders and files at the commit, by their paths.
    pub sources: BTreeMap<String, String>,
    /// Other programs that were measured in the same run, with the names of their sources.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub peers: BTreeMap<String, String>,
    /// Figures by their names.
    pub figures: BTreeMap<String, Figure>,
}

impl Record {
    /// Reads a record.
    ///
    /// # Errors
    /// If the file is unreadable, no JSON of a record, or has invalid values.
    pub fn read(path: &Path) -> Result<Self, Box<dyn Error>> {
        let text = fs::read_to_string(path)?;
        let record: Self = serde_json::from_str(&text)?;
        match record.fault() {
            Some(fault) => Err(fault.into()),
            None => Ok(record),
        }
    }

    /// Writes the record.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), Box<dyn Error>> {
        if let Some(folder) = path.parent() {
            fs::create_dir_all(folder)?;
        }
        Ok(fs::write(path, serde_json::to_string_pretty(self)? + "\n")?)
    }

    /// Returns the first invalid value, in a sentence.
    fn fault(&self) -> Option<String> {
        let hexadecimal = |text: &str| text.bytes().all(|b| b.is_ascii_hexdigit());
        if !(7..=40).contains(&self.commit.len()) || !hexadecimal(&self.commit) {
            return Some(format!("commit {:?} is not 7 to 40 hexadecimal digits", self.commit));
        }
        if chrono::NaiveDate::parse_from_str(&self.date, "%Y-%m-%d").is_err() {
            return Some(format!("date {:?} is not YYYY-MM-DD", self.date));
        }
        if self.sources.is_empty() {
            return Some("sources is empty: name the folders that the figures measure".into());
        }
        let hash = |hash: &&String| hash.len() != 40 || !hexadecimal(hash);
        if let Some(hash) = self.sources.values().find(hash) {
            return Some(format!("{hash:?} in sources is not a hash of git"));
        }
        let (name, _) = self.figures.iter().find(|(_, figure)| !figure.is_valid())?;
        Some(format!("figure {name:?}: numbers must be finite, and quantiles in order"))
    }

    /// Returns the sentence's beginning that states the measurement. `current` is whether the
    /// sources of today are the measured ones.
    pub fn statement(&self, current: bool) -> String {
        let Self { commit, date, command, machine, .. } = self;
        let commit = &commit[..7];
        let cores = if machine.cores == 1 { "core" } else { "cores" };
        let beginning = if current { "The present sources, commit" } else { "Measured at" };
        let mut text = format!("{beginning} {commit}, {date}");
        if !command.is_empty() {
            text += &format!(", by `{command}`");
        }
        text += &format!(", on {} {cores} of {}", machine.cores, machine.cpu);
        let peers: Vec<String> = self.peers.iter().map(|(name, source)| format!("{name} ({source})")).collect();
        if !peers.is_empty() {
            text += &format!(", beside {}", peers.join(" and "));
        }
        text
    }
}

/// Reads all records of a folder, by their names.
///
/// # Errors
/// If the folder cannot be read; or the first invalid record, by its file.
pub fn read_all(folder: &Path) -> Result<BTreeMap<String, Record>, Box<dyn Error>> {
    let mut records = BTreeMap::new();
    for entry in fs::read_dir(folder).map_err(|e| format!("{}: {e}", folder.display()))? {
        let path = entry?.path();
        if path.extension().is_some_and(|end| end == "json") {
            let record = Record::read(&path).map_err(|e| format!("{}: {e}", path.display()))?;
            records.insert(path.file_stem().unwrap_or_default().to_string_lossy().into_owned(), record);
        }
    }
    Ok(records)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample() -> Record {
        let text = format!(
            r#"{{"commit": "0123abc", "date": "2026-11-21", "command": "make bench",
                "machine": {{"cpu": "Xeon", "cores": 2, "os": "Debian"}}, "sources": {{"crates/a": "{}"}},
                "figures": {{"a/ms": {{"median": 1.5, "p25": 1.0, "p75": 2.0, "rounds": 10}}, "b": -2}}}}"#,
            "0".repeat(40)
        );
        serde_json::from_str(&text).expect("a record")
    }

    #[test]
    fn record_survives_writing_and_reading() {
        let folder = tempfile::tempdir().expect("a folder");
        sample().write(&folder.path().join("of/run.json")).expect("written");
        let all = read_all(&folder.path().join("of")).expect("read");
        assert_eq!(all["run"], sample());
        assert_eq!(all["run"].figures["a/ms"].part("p75"), Some(2.0));
    }

    #[test]
    fn invalid_values_are_named() {
        let fault = |change: fn(&mut Record)| {
            let mut record = sample();
            change(&mut record);
            record.fault().unwrap_or_default()
        };
        assert_eq!(fault(|_| ()), "");
        assert!(fault(|r| r.commit = "HEAD".into()).contains("commit"));
        assert!(fault(|r| r.date = "yesterday".into()).contains("date"));
        assert!(fault(|r| r.sources.clear()).contains("sources"));
        assert!(fault(|r| r.sources = [("a".into(), "0".into())].into()).contains("hash of git"));
        assert!(fault(|r| r.figures = [("c".into(), Figure::Value(f64::NAN))].into()).contains("\"c\""));
        let unordered = |r: &mut Record| {
            let parts = [("median".into(), 3.0), ("p75".into(), 2.0)];
            r.figures = [("d".into(), Figure::Spread(parts.into()))].into();
        };
        assert!(fault(unordered).contains("\"d\""));
    }

    #[test]
    fn statement_tells_present_from_past_sources() {
        assert!(
            sample().statement(true).starts_with("The present sources, commit 0123abc, 2026-11-21, by `make bench`")
        );
        assert!(sample().statement(false).starts_with("Measured at 0123abc"));
        let peers = [("IGSIO".into(), "commit 0123abc".into())].into();
        let beside = Record { peers, command: String::new(), ..sample() };
        assert_eq!(
            beside.statement(false),
            "Measured at 0123abc, 2026-11-21, on 2 cores of Xeon, beside IGSIO (commit 0123abc)"
        );
    }
}
