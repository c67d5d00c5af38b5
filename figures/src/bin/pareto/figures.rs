//! The figures that the documents show, by their names, for the records of `docs/numbers`.

use std::collections::BTreeSet;
use std::error::Error;
use std::fs;
use std::path::Path as Folder;

use serde_json::{Map, Value, json};

use crate::contestant::{Contestant, DEFAULT_VOXEL_MM, Path};
use crate::front::{Measure, SLACK, rivals};
use crate::measure::Row;
use crate::pictures;
use crate::rows::scans;

/// Figures of one run.
#[derive(Debug, Default)]
pub(crate) struct Figures(Map<String, Value>);

impl Figures {
    /// Adds a number, unless it could not be measured.
    pub(crate) fn add(&mut self, name: &str, value: f64) {
        if value.is_finite() {
            self.0.insert(name.to_owned(), json!(value));
        }
    }

    /// Adds the time of a row relative to the default's, with its quartiles.
    fn add_time(&mut self, name: &str, row: Option<&&Row>) {
        let Some(row) = row else { return };
        let [p25, median, p75] = row.over_default;
        self.0.insert(name.to_owned(), json!({ "median": median, "p25": p25, "p75": p75, "rounds": row.rounds }));
    }

    /// Adds the figures of all scans.
    pub(crate) fn add_rows(&mut self, rows: &[Row]) {
        let scans = scans(rows);
        let phantoms: BTreeSet<&str> = scans.iter().filter_map(|scan| scan[0].title.split(',').next()).collect();
        self.add("scans", scans.len() as f64);
        self.add("phantoms", phantoms.len() as f64);
        let others = pictures::medians(&scans, Measure::Blurred);
        let others = others.iter().filter(|(contestant, _)| !contestant.is_default());
        if let Some((_, [time, error])) = others.min_by(|(_, a), (_, b)| a[1].total_cmp(&b[1])) {
            self.add("best other/time, ×", *time);
            self.add("best other/error below, %", 100.0 * (1.0 - error));
        }
        let of = |scan: &[&Row], path| {
            let wanted = Contestant::new(path, DEFAULT_VOXEL_MM);
            rows.iter().find(|row| row.stage == scan[0].stage && row.contestant.does_as(&wanted))
        };
        let mut brute: Vec<&Row> = scans.iter().filter_map(|scan| of(scan, Path::BruteForce)).collect();
        brute.sort_by(|a, b| a.over_default[1].total_cmp(&b.over_default[1]));
        self.add_time("brute force/time, least ×", brute.first());
        self.add_time("brute force/time, most ×", brute.last());
        self.add_rivals(&scans);
        let better: Vec<[f64; 2]> = scans
            .iter()
            .filter_map(|scan| {
                let auto = of(scan, Path::AutoSigma)?;
                Some([auto.over_default[1], Measure::Anyone.of(auto) / Measure::Anyone.of(scan[0])])
            })
            .filter(|parts| parts.iter().all(|part| *part < 1.0 - SLACK))
            .collect();
        self.add("auto σ/scans", better.len() as f64);
        for (part, name) in ["time", "error"].into_iter().enumerate() {
            let range = |pick: fn(f64, f64) -> f64| better.iter().map(|parts| parts[part]).fold(f64::NAN, pick);
            self.add(&format!("auto σ/{name}, least ×"), range(f64::min));
            self.add(&format!("auto σ/{name}, most ×"), range(f64::max));
        }
    }

    /// Adds the scans on whose front the default is, and the best rivals of the others.
    fn add_rivals(&mut self, scans: &[Vec<&Row>]) {
        let best = |id: &str| {
            let scan = scans.iter().find(|scan| scan[0].stage == id)?;
            Some(rivals(scan, Measure::Blurred).first()?.parts)
        };
        let on = scans.iter().filter(|scan| rivals(scan, Measure::Blurred).is_empty()).count();
        self.add("front/on", on as f64);
        // Nothing beats the default where there is no rival.
        let part = |id: &str, part: usize| best(id).map_or(1.0, |parts| parts[part]);
        let tracker = "sphere-tracker-large";
        self.add("large tracker error/within, %", 100.0 * (1.0 - part(tracker, 0).min(part(tracker, 1))));
        self.add("ramp, constant/time, ×", part("ramp-jittered", 0).min(part("constant-arm", 0)));
        self.add("zone plate/time, ×", part("zone-plate-sparse", 0));
        self.add("zone plate/error, ×", part("zone-plate-sparse", 1));
        self.add("edge/time, ×", part("edge-fan", 0));
    }

    /// Writes `figures.json`. `quick` is whether the run was a smoke test.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub(crate) fn write(&self, quick: bool, folder: &Folder) -> Result<(), Box<dyn Error>> {
        let run = json!({ "quick": quick, "figures": self.0 });
        Ok(fs::write(folder.join("figures.json"), serde_json::to_string_pretty(&run)? + "\n")?)
    }
}
