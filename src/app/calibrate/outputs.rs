//! Outputs of calibrations: the calibration file, changed in one place, and reports.

mod options;

use std::path::{Path, PathBuf};

use glam::DAffine3;
use serde::Serialize;

use calibration::file::origin::{self, Origin};
use calibration::file::preset::Preset;
use calibration::file::record::Record;
use calibration::file::{CalibrationFile, Latency};
use formats::whole::write_whole;
use sonoweave_core::date::Date;
use sonoweave_core::frames::{Image, Probe, Transform};
use sonoweave_core::named::StaticTransform;

use crate::app::input;
use crate::app::json::document;
use crate::failure::Failure;
pub(crate) use options::Outputs;

/// A file that was read.
#[derive(Debug, Serialize)]
pub(crate) struct Input {
    path: PathBuf,
    sha256: String,
}

impl Input {
    pub(crate) fn of(path: &Path) -> Result<Self, Failure> {
        Ok(Self { path: path.to_owned(), sha256: input::hash(path)? })
    }

    /// Returns the form that calibration files list.
    fn listed(&self) -> origin::Input {
        let name = self.path.file_name().unwrap_or(self.path.as_os_str());
        origin::Input { file: name.to_string_lossy().into_owned(), sha256: self.sha256.clone() }
    }

    /// Returns the form that a calibration file uses as provenance.
    pub(crate) fn name(&self) -> String {
        let name = self.path.file_name().unwrap_or(self.path.as_os_str());
        format!("{} (sha256 {})", name.to_string_lossy(), &self.sha256[..16])
    }
}

/// A probe's calibration, for the calibration file.
pub(crate) struct ProbeResult {
    pub(crate) probe_from_image: Transform<Probe, Image>,
    pub(crate) provenance: String,
    pub(crate) record: Record,
    /// The same as a preset, which then takes the place of the file's own.
    pub(crate) preset: Option<Preset>,
    pub(crate) latency: Option<Latency>,
}

impl Outputs {
    /// Returns the origin of a result of today, from these files. The calibration file itself,
    /// which may be read for its other contents, is none of them: it is about to change.
    pub(crate) fn origin<'a>(&self, inputs: impl IntoIterator<Item = &'a Input>) -> Origin {
        let inputs = inputs.into_iter().filter(|input| !self.is_output(&input.path)).map(Input::listed);
        Origin { made: Some(Date::today()), inputs: inputs.collect() }
    }

    /// Whether a file is the calibration file that is written.
    pub(crate) fn is_output(&self, path: &Path) -> bool {
        self.output.as_deref() == Some(path)
    }

    /// Returns the paths of all files.
    fn paths(&self) -> impl Iterator<Item = &Path> {
        [self.output.as_deref(), self.json.file(), self.page.as_deref()].into_iter().flatten()
    }

    /// Checks before the work that the outputs can be written, are no inputs, and are distinct
    /// files.
    pub(crate) fn check(&self, inputs: &[&Path]) -> Result<(), Failure> {
        for output in self.paths() {
            input::check_output(output)?;
            for path in inputs {
                input::check_is_not(output, path)?;
            }
        }
        let mut names: Vec<&Path> = self.paths().collect();
        names.sort_unstable();
        if names.windows(2).any(|two| two[0] == two[1]) {
            return Err(Failure::new("two outputs have the same file; give different names"));
        }
        if let Some(page) = self.page.as_ref().filter(|path| !is_page(path)) {
            fail!(
                "--report {}: is no page; give a name that ends in .html, and --json=FILE for programs",
                page.display()
            );
        }
        self.before()?;
        Ok(())
    }

    /// Returns the calibration file before the change; an empty one if there is no file.
    pub(crate) fn before(&self) -> Result<CalibrationFile, Failure> {
        let there = self.output.as_ref().filter(|path| path.exists());
        Ok(there.map(|path| CalibrationFile::read(path)).transpose()?.unwrap_or_default())
    }

    /// Returns the calibration file to be written, if there is one.
    pub(crate) fn file(&self) -> Option<&Path> {
        self.output.as_deref()
    }

    /// Whether there is a calibration file to be written.
    pub(crate) fn wants_file(&self) -> bool {
        self.output.is_some()
    }

    /// Writes the requested files: the transform with its provenance into the calibration file,
    /// and the report. Returns the latter, as a JSON document.
    pub(crate) fn write(
        &self,
        transform: &StaticTransform,
        provenance: &str,
        origin: Origin,
        report: &impl Serialize,
    ) -> Result<String, Failure> {
        let change = |file: &mut CalibrationFile| {
            merge(file, transform, provenance);
            file.originates(&transform.name(), origin);
        };
        self.write_changed(change, report)
    }

    /// Writes a probe's calibration, the latencies if there are any, and the report. A new file
    /// begins with the contents `kept`. Returns the report, as a JSON document.
    pub(crate) fn write_probe(
        &self,
        kept: Option<CalibrationFile>,
        result: ProbeResult,
        report: &impl Serialize,
        page: impl FnOnce() -> Result<String, Failure>,
    ) -> Result<String, Failure> {
        let ProbeResult { probe_from_image, provenance, record, preset, latency } = result;
        let named = StaticTransform::image_to_probe(&probe_from_image);
        let change = |file: &mut CalibrationFile| {
            if let Some(kept) = kept {
                *file = kept;
            }
            if latency.is_some() {
                file.latency = latency;
                originates(file, "latency", &provenance);
                file.originates("latency", record.origin.clone());
            }
            if let Some(preset) = preset {
                file.presets.retain(|other| other.name != preset.name);
                file.presets.push(preset);
                return;
            }
            merge(file, &named, &provenance);
            // The transform has its own place in the file.
            file.transforms.retain(|other| !other.relates_same_frames(&named));
            file.probe_from_image = Some(probe_from_image);
            file.record = record;
        };
        self.write_with_page(change, report, page)
    }

    /// Whether a report was requested besides the text.
    pub(crate) fn wants_report(&self) -> bool {
        self.json.is_wanted() || self.page.is_some()
    }

    /// Writes the requested files: the changed calibration file, and the report, without a page.
    /// Returns the report, as a JSON document.
    pub(crate) fn write_changed(
        &self,
        change: impl FnOnce(&mut CalibrationFile),
        report: &impl Serialize,
    ) -> Result<String, Failure> {
        self.write_with_page(change, report, || Ok(String::new()))
    }

    fn write_with_page(
        &self,
        change: impl FnOnce(&mut CalibrationFile),
        report: &impl Serialize,
        page: impl FnOnce() -> Result<String, Failure>,
    ) -> Result<String, Failure> {
        // Everything that can fail comes before the first write.
        let document = document(report)?;
        let page = self.page.as_ref().map(|path| Ok::<_, Failure>((path, page()?))).transpose()?;
        if let Some(path) = &self.output {
            let mut file = self.before()?;
            change(&mut file);
            file.write(path)?;
        }
        if let Some((path, page)) = page {
            write_whole(path, |to| to.write_all(page.as_bytes())).map_err(|e| Failure::io(path, "writing", &e))?;
        }
        self.json.write_text(&document)?;
        Ok(document)
    }

    /// Returns the written files with their kinds.
    pub(crate) fn written(&self) -> impl Iterator<Item = (&'static str, &Path)> {
        let kinds =
            [("calibration", self.output.as_deref()), ("report", self.json.file()), ("report", self.page.as_deref())];
        kinds.into_iter().filter_map(|(kind, path)| Some((kind, path?)))
    }

    /// Returns the lines that list the written files.
    pub(crate) fn summary(&self) -> String {
        self.written().map(|(what, path)| format!("{what}: {}\n", path.display())).collect()
    }
}

/// Whether a path's extension names a page for a browser.
fn is_page(path: &Path) -> bool {
    path.extension()
        .is_some_and(|extension| extension.eq_ignore_ascii_case("html") || extension.eq_ignore_ascii_case("htm"))
}

/// Replaces the transform between the same frames, if there is one, and its provenance.
fn merge(file: &mut CalibrationFile, transform: &StaticTransform, provenance: &str) {
    for other in file.transforms.iter().filter(|other| other.relates_same_frames(transform)) {
        file.origins.remove(&other.name());
    }
    file.transforms.retain(|other| !other.relates_same_frames(transform));
    file.transforms.push(transform.clone());
    originates(file, &transform.name(), provenance);
}

/// Replaces the provenance of one item of the file.
pub(crate) fn originates(file: &mut CalibrationFile, what: &str, provenance: &str) {
    let mark = format!("{what}: ");
    let others = file.provenance.split("; ").filter(|part| !part.is_empty() && !part.starts_with(&mark));
    let parts: Vec<String> = others.map(str::to_owned).chain([mark.clone() + provenance]).collect();
    file.provenance = parts.join("; ");
}

/// Returns a rigid transform between frames, with the recording's names.
pub(crate) fn named<To, From>(from: &str, to: &str, transform: &Transform<To, From>) -> StaticTransform {
    StaticTransform { from: from.to_owned(), to: to.to_owned(), affine: transform.affine() }
}

/// Returns 16 numbers, row major.
pub(crate) fn rows(affine: DAffine3) -> [f64; 16] {
    Transform::<(), ()>::from_affine(affine).to_rows()
}

/// Formats the coordinates of a point, mm.
pub(crate) fn place(point: glam::DVec3) -> String {
    point.to_array().map(|x| format!("{x:.3}")).join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn result_replaces_predecessor_keeps_rest() {
        let moved = |x: f64| DAffine3::from_translation(glam::DVec3::new(x, 0.0, 0.0));
        let tip = |x: f64| StaticTransform { from: "StylusTip".into(), to: "Stylus".into(), affine: moved(x) };
        let other = StaticTransform { from: "Phantom".into(), to: "Reference".into(), affine: moved(9.0) };
        let mut file = CalibrationFile {
            provenance: "N-wire phantom".into(),
            spacing_mm: Some([0.5; 3]),
            transforms: vec![tip(1.0), other.clone()],
            ..CalibrationFile::default()
        };
        merge(&mut file, &tip(100.0), "200 poses of a.mha");
        assert_eq!(file.provenance, "N-wire phantom; StylusTipToStylus: 200 poses of a.mha");
        merge(&mut file, &tip(110.0), "300 poses of b.mha");
        assert_eq!(file.provenance, "N-wire phantom; StylusTipToStylus: 300 poses of b.mha");
        assert_eq!((file.transforms.clone(), file.spacing_mm), (vec![other, tip(110.0)], Some([0.5; 3])));
        // The same two frames in the opposite direction.
        let back = StaticTransform { from: "Stylus".into(), to: "StylusTip".into(), affine: moved(-1.0) };
        merge(&mut file, &back, "c");
        assert_eq!(file.transforms.len(), 2);
    }
}
