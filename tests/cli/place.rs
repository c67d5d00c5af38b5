//! A temporary folder for a test, in which the program runs.

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::process::{Command, Output, Stdio};

use glam::{DMat4, DVec3};
use serde_json::Value;
use sha2::{Digest as _, Sha256};
use tempfile::TempDir;

use calibration::file::origin::{Input, Origin};
use calibration::file::record::Record;
use formats::Limits;
use formats::image::{VolumeHeader, VolumeReader};
use sonoweave_core::date::Date;
use sonoweave_core::reading::PixelType;

/// A virtual bedside with small frames, whose probe sweeps over a doll in two seconds without
/// disturbances.
pub(crate) const SMALL_BEDSIDE: &str = r#"format = "sonoweave-bedside"
version = 1
[tracker]
model = "fastrak"
port = "virtual"
reference_station = 2
[grabber]
device = "virtual"
size = "96x80"
[volume]
spacing_mm = 1.0
[virtual]
frames = 60
"#;

/// An empty folder in which the program runs; deleted when dropped.
pub(crate) struct Place(TempDir);

/// Result of a run.
pub(crate) struct Run {
    pub(crate) code: i32,
    pub(crate) stdout: String,
    pub(crate) stderr: String,
}

pub(crate) fn numbers(value: &toml::Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|x| x.as_float().unwrap()).collect()
}

/// Converts row-major numbers to a matrix.
pub(crate) fn matrix(value: &toml::Value) -> DMat4 {
    DMat4::from_cols_slice(&numbers(value)).transpose()
}

impl Place {
    pub(crate) fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    pub(crate) fn put(&self, name: &str, content: impl AsRef<[u8]>) {
        std::fs::write(self.path(name), content).unwrap();
    }

    pub(crate) fn get(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.path(name)).unwrap_or_else(|e| panic!("{name}: {e}"))
    }

    pub(crate) fn json(&self, name: &str) -> Value {
        serde_json::from_slice(&self.get(name)).unwrap()
    }

    /// Asserts that a result is of today, from exactly these files.
    pub(crate) fn knows_origin(&self, origin: &Origin, files: &[&str]) {
        // The day may end during the test.
        assert!((0..=1).contains(&Date::today().days_since(origin.made.unwrap())), "{origin:?}");
        let hash = |name: &&str| Sha256::digest(self.get(name)).iter().map(|byte| format!("{byte:02x}")).collect();
        let input = |name: &&str| Input { file: name.rsplit('/').next().unwrap().into(), sha256: hash(name) };
        assert_eq!(origin.inputs, files.iter().map(input).collect::<Vec<_>>());
    }

    /// Asserts that a probe's calibration has day, inputs, quality and covariance, which agree.
    pub(crate) fn is_recorded(&self, record: &Record, files: &[&str]) {
        self.knows_origin(&record.origin, files);
        let (quality, covariance) = (record.quality.unwrap(), record.covariance.as_ref().unwrap());
        assert_eq!((covariance.listed().0.len(), record.picture_px), (8, Some([320, 240])));
        assert!(quality.frames > 20 && quality.corner_mm > quality.centre_mm && quality.centre_mm > 0.0, "{quality:?}");
        assert!(
            quality.sensors.is_some_and(|noise| noise.position_mm > 0.0 && noise.rotation_deg > 0.0),
            "{quality:?}"
        );
    }

    /// Returns the names of all files, including hidden ones.
    pub(crate) fn names(&self) -> BTreeSet<String> {
        let entries = std::fs::read_dir(self.0.path()).unwrap();
        entries.map(|e| e.unwrap().file_name().to_string_lossy().into_owned()).collect()
    }

    /// Runs the program with words separated by spaces, without a terminal.
    pub(crate) fn run(&self, words: &str) -> Run {
        self.output(crate::program().args(words.split_whitespace()))
    }

    /// The same with a limited address space, kB.
    pub(crate) fn run_within(&self, kilobytes: u64, words: &str) -> Run {
        let script = format!("ulimit -v {kilobytes}; exec \"$0\" {words}");
        self.output(Command::new("sh").args(["-c", &script]).arg(crate::program().get_program()))
    }

    pub(crate) fn output(&self, command: &mut Command) -> Run {
        let Output { status, stdout, stderr } =
            command.current_dir(self.0.path()).stdin(Stdio::null()).output().expect("the program starts");
        let text = |bytes| String::from_utf8(bytes).unwrap();
        Run { code: status.code().expect("the program was not killed"), stdout: text(stdout), stderr: text(stderr) }
    }

    /// Runs the program, which must succeed without messages on stderr; returns stdout.
    pub(crate) fn does(&self, words: &str) -> String {
        let run = self.run(words);
        assert_eq!((run.code, run.stderr.as_str()), (0, ""), "{words}");
        run.stdout
    }

    /// Same as [`Self::does`], but the program must note that the kernel is narrow for the
    /// voxels, and nothing else.
    pub(crate) fn does_narrowly(&self, words: &str) -> String {
        let run = self.run(words);
        let narrow = run.stderr.starts_with("sonoweave: note: the kernel's σ is below 0.75 voxel");
        assert!(run.code == 0 && narrow && run.stderr.lines().count() == 1, "{words}: {} {}", run.code, run.stderr);
        run.stdout
    }

    /// Runs the program, which must refuse with one sentence that contains all of `says`, and
    /// leave the folder unchanged.
    pub(crate) fn refuses(&self, words: &str, says: &[&str]) {
        let before: Vec<_> = self.names().into_iter().map(|name| (self.get(&name), name)).collect();
        let run = self.run(words);
        self.check_refusal(&run, words, says);
        let after: Vec<_> = self.names().into_iter().map(|name| (self.get(&name), name)).collect();
        assert!(before == after, "{words}: the folder has changed, it holds {:?}", self.names());
    }

    pub(crate) fn check_refusal(&self, run: &Run, words: &str, says: &[&str]) {
        // The exit code tells the kind, which `failures.rs` tests.
        assert!((1..=10).contains(&run.code), "{words}: {}{}", run.stdout, run.stderr);
        assert_eq!(run.stdout, "", "{words}");
        let sentence = run.stderr.strip_prefix("sonoweave: ").unwrap_or_else(|| panic!("{words}: {}", run.stderr));
        for part in says {
            assert!(sentence.contains(part), "{words}: {sentence:?} does not say {part:?}");
        }
        assert!(!sentence.contains("panicked"), "{sentence}");
    }

    /// The same if the folder contains folders.
    pub(crate) fn refuses_with(&self, words: &str, says: &[&str]) {
        let before = self.names();
        let run = self.run(words);
        if says.is_empty() {
            assert_eq!(run.code, 2, "{words}: {}{}", run.stdout, run.stderr);
        } else {
            self.check_refusal(&run, words, says);
        }
        assert_eq!(before, self.names(), "{words}");
    }

    /// Runs a virtual bedside for `seconds`; returns the recorded session, the only one in the
    /// folder.
    pub(crate) fn recorded(&self, bedside: &str, seconds: u32) -> String {
        self.put("bedside.toml", bedside);
        let run = self.run(&format!("live --config bedside.toml --duration {seconds} --record sessions --quiet"));
        assert_eq!(run.code, 0, "{} {}", run.stdout, run.stderr);
        let entry = std::fs::read_dir(self.path("sessions")).unwrap().next().unwrap().unwrap();
        format!("sessions/{}", entry.file_name().to_string_lossy())
    }

    pub(crate) fn toml(&self, name: &str) -> toml::Value {
        toml::Value::Table(std::str::from_utf8(&self.get(name)).unwrap().parse().unwrap())
    }

    /// Returns the difference between two calibration files, mm: at the middle of a frame of
    /// that size, and the maximum at its corners.
    pub(crate) fn pixels_apart(&self, files: [&str; 2], size: [u32; 2]) -> [f64; 2] {
        let [one, other] = files.map(|name| matrix(&self.toml(name)["image_to_probe"]["matrix"]));
        let [width, height] = size.map(|side| f64::from(side - 1));
        let at = |u: f64, v: f64| {
            let pixel = DVec3::new(u * width, v * height, 0.0);
            one.transform_point3(pixel).distance(other.transform_point3(pixel))
        };
        let corners = [at(0.0, 0.0), at(1.0, 0.0), at(0.0, 1.0), at(1.0, 1.0)];
        [at(0.5, 0.5), corners.into_iter().fold(0.0, f64::max)]
    }

    /// Reads a volume that the program wrote.
    pub(crate) fn volume(&self, name: &str) -> Volume {
        let mut reader = VolumeReader::open(&self.path(name), &Limits::default()).unwrap();
        let header = reader.header().clone();
        let mut values = Vec::new();
        while let Some(slice) = reader.next_slice().unwrap() {
            match header.pixel {
                PixelType::U8 => values.extend(slice.iter().map(|v| f32::from(*v))),
                PixelType::U16 => {
                    values.extend(slice.as_chunks().0.iter().map(|v| f32::from(u16::from_ne_bytes(*v))));
                }
                PixelType::F32 => values.extend(slice.as_chunks().0.iter().map(|v| f32::from_ne_bytes(*v))),
                other => panic!("{name} has voxels of {other:?}"),
            }
        }
        Volume { header, values }
    }
}

/// A volume as read back.
pub(crate) struct Volume {
    pub(crate) header: VolumeHeader,
    pub(crate) values: Vec<f32>,
}

impl Volume {
    /// Returns the value at a voxel, `None` outside.
    pub(crate) fn at(&self, voxel: [i64; 3]) -> Option<f32> {
        let size = self.header.size.map(i64::from);
        let inside = (0..3).all(|a| (0..size[a]).contains(&voxel[a]));
        inside.then(|| self.values[((voxel[2] * size[1] + voxel[1]) * size[0] + voxel[0]) as usize])
    }

    /// Returns the value of another volume at the world position of this one's value `i`; `None`
    /// outside.
    pub(crate) fn of_other(&self, i: usize, other: &Volume) -> Option<f32> {
        let VolumeHeader { size, origin, spacing, .. } = &self.header;
        let [nx, ny] = [size[0] as usize, size[1] as usize];
        let index = [i % nx, i / nx % ny, i / nx / ny];
        other.at(std::array::from_fn(|a| {
            let mm = origin[a] + index[a] as f64 * spacing[a] - other.header.origin[a];
            (mm / spacing[a]).round() as i64
        }))
    }

    pub(crate) fn field(&self, name: &str) -> &str {
        let field = self.header.fields.iter().find(|(n, _)| n == name);
        field.map_or_else(|| panic!("no field {name} in {:?}", self.header.fields), |(_, value)| value)
    }
}
