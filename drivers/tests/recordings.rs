//! Reads recordings of real scanners and trackers completely. They are not part of the project:
//! a test looks for them in `../shared/data` beside the workspace or in the folder named by
//! `SONOWEAVE_TEST_DATA`. A test with an absent recording is reported as ignored, by name; with
//! `SONOWEAVE_REQUIRE_RECORDINGS=1` it fails.

use std::collections::{BTreeMap, BTreeSet};
use std::io::Write as _;
use std::path::{Path, PathBuf};

use libtest_mimic::{Arguments, Completion, Failed, Trial};

use drivers::replay::{Replay, SequenceSettings};
use formats::Limits;
use formats::image::write::VolumeWriter;
use formats::image::{Content, VolumeReader, content};
use sonoweave_core::reading::{Frame, PixelType, Reading, Status};
use sonoweave_core::{Device, Next};

fn folder() -> PathBuf {
    std::env::var_os("SONOWEAVE_TEST_DATA")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data"), PathBuf::from)
}

/// Known properties of a sequence file, determined by other means.
struct Known {
    file: &'static str,
    items: u64,
    /// Size of an image; 0×0 without images.
    size: [u32; 2],
    pixel: PixelType,
    /// Source and target frame of each transform, and the number of its items that are not OK.
    transforms: &'static [(&'static str, &'static str, usize)],
    /// First and last time, s.
    times: [f64; 2],
    /// Number of items with an unfiltered time and a frame number.
    numbered: usize,
    images_not_ok: usize,
    orientation: &'static str,
    image_type: &'static str,
    /// Checksum of all pixels as little-endian bytes.
    adler: u32,
}

const PRS: &[(&str, &str, usize)] = &[("Probe", "Tracker", 0), ("Reference", "Tracker", 0), ("Stylus", "Tracker", 0)];

const PLAIN: Known = Known {
    file: "",
    items: 0,
    size: [820, 616],
    pixel: PixelType::U8,
    transforms: &[],
    times: [0.0; 2],
    numbered: 0,
    images_not_ok: 0,
    orientation: "MFA",
    image_type: "",
    adler: 1,
};

const KNOWN: [Known; 14] = [
    Known {
        file: "freehand/SpinePhantomFreehand.igs.mha",
        items: 21,
        transforms: PRS,
        times: [215.102_186, 216.947_186],
        adler: 0xaecf_96db,
        ..PLAIN
    },
    Known {
        file: "freehand/NwirePhantomFreehand.igs.mha",
        items: 97,
        transforms: &[("Probe", "Tracker", 0), ("Reference", "Tracker", 0), ("Stylus", "Tracker", 97)],
        times: [345.627_957, 355.783_014],
        adler: 0x756d_1985,
        ..PLAIN
    },
    Known {
        file: "nwire/fCal_Test_Calibration_3NWires.igs.mha",
        items: 188,
        transforms: PRS,
        times: [425.398_686, 440.246_214],
        adler: 0xc8b2_33d1,
        ..PLAIN
    },
    Known {
        file: "nwire/fCal_Test_Validation_3NWires.igs.mha",
        items: 94,
        transforms: PRS,
        times: [440.323_414, 447.829_025],
        adler: 0x63f4_986c,
        ..PLAIN
    },
    Known {
        file: "latency/WaterTankBottomTranslationVideoBuffer.igs.mha",
        items: 201,
        times: [7_417.731_3, 7_435.148_643],
        numbered: 201,
        image_type: "BRIGHTNESS",
        adler: 0xa89f_6a0b,
        ..PLAIN
    },
    Known {
        file: "latency/WaterTankBottomTranslationTrackerBuffer.igs.mha",
        items: 5000,
        size: [0, 0],
        transforms: PRS,
        times: [7_356.711_7, 7_481.374_443],
        numbered: 5000,
        images_not_ok: 5000,
        ..PLAIN
    },
    Known {
        file: "tracking/EightLandmarkPointsTrackedForPhantomRegistration.igs.mha",
        items: 1000,
        size: [0, 0],
        transforms: &[("Reference", "Tracker", 0), ("Stylus", "Tracker", 0)],
        times: [280.461_142_857_226_4, 347.066_871_428_749_2],
        images_not_ok: 1000,
        orientation: "XX",
        image_type: "XX",
        ..PLAIN
    },
    Known {
        file: "tracking/TransformInterpolationTest.igs.mha",
        items: 500,
        size: [1, 1],
        transforms: &[("Probe", "Tracker", 1), ("Reference", "Tracker", 0), ("Stylus", "", 0)],
        times: [1_898_165.1, 1_898_175.172_497],
        numbered: 500,
        adler: 0x5bb2_f8e9,
        ..PLAIN
    },
    Known {
        file: "tracking/TimestampFilteringTest.igs.mha",
        items: 500,
        size: [1, 1],
        transforms: &[("Identity", "Identity", 0)],
        times: [1_840_749.750_288, 1_840_781.950_475],
        numbered: 500,
        adler: 0x01f4_0001,
        ..PLAIN
    },
    Known {
        file: "formats/BkCurvilinearScanConvertedData.igs.mha",
        items: 1,
        size: [600, 400],
        transforms: &[("Reference", "Tracker", 0), ("Stylus", "Tracker", 0)],
        times: [15.462_571; 2],
        image_type: "BRIGHTNESS",
        adler: 0x4ab4_92e0,
        ..PLAIN
    },
    Known {
        file: "formats/NwirePhantomFreehandCropped.igs.mha",
        items: 20,
        size: [200, 150],
        transforms: &[
            ("Image", "CroppedImage", 0),
            ("Probe", "Tracker", 0),
            ("Reference", "Tracker", 0),
            ("Stylus", "Tracker", 20),
        ],
        times: [345.627_957, 347.658_686],
        image_type: "BRIGHTNESS",
        adler: 0x257d_a5fa,
        ..PLAIN
    },
    Known {
        file: "formats/SyntheticVideoBuffer20.igs.mha",
        items: 20,
        size: [320, 240],
        transforms: &[("Tool", "Tracker", 0)],
        times: [0.5, 10.0],
        numbered: 20,
        adler: 0xb388_59ed,
        ..PLAIN
    },
    Known {
        file: "formats/UltrasonixCurvilinearScanConvertedData.igs.mha",
        items: 5,
        times: [98.0, 99.04],
        image_type: "BRIGHTNESS",
        adler: 0xf420_b9d3,
        ..PLAIN
    },
    Known {
        file: "formats/UltrasonixLinearRfData.igs.mha",
        items: 1,
        size: [2080, 256],
        pixel: PixelType::I16,
        times: [116.045_605; 2],
        orientation: "NM",
        image_type: "RF_I_LINE_Q_LINE",
        adler: 0x4e33_d180,
        ..PLAIN
    },
];

/// Volumes reconstructed by another program: file, size, origin in mm.
const VOLUMES: [(&str, [u32; 3], [f64; 3]); 2] = [
    ("freehand/vtkVolumeReconstructorTestNNMEANvolumeRef.mha", [147, 106, 105], [-74.5217, 165.573, 29.072]),
    ("freehand/vtkVolumeReconstructorTestLNMEANvolumeRef.mha", [80, 93, 98], [-57.0272, 168.545, 30.5384]),
];

const NRRDS: [&str; 3] =
    ["freehand/NwirePhantomFreehand.igs.nrrd", "formats/ColorNrrdSample.igs.nrrd", "formats/NrrdSample.igs.nrrd"];

/// Adler checksums of the NRRDs' pixels, computed with zlib in Python.
const COLOUR: u32 = 0xf839_f03b;
const SINGLE: u32 = 0x7a6b_8156;

/// The same sweep in both containers.
const TWICE: &str = "freehand/NwirePhantomFreehand.igs";

fn main() {
    let args = Arguments::from_args();
    let mut trials: Vec<Trial> =
        KNOWN.into_iter().map(|known| trial(known.file, move |path| sequence(path, &known))).collect();
    trials.extend(VOLUMES.map(|(file, size, origin)| trial(file, move |path| volume(path, size, origin))));
    trials.push(trial("freehand/NwirePhantomFreehand.igs.nrrd", the_same_twice));
    trials.push(trial("formats/ColorNrrdSample.igs.nrrd", colour));
    trials.push(trial("formats/NrrdSample.igs.nrrd", single));
    trials.push(Trial::ignorable_test("every image file of the recordings is known here", all_known));
    libtest_mimic::run(&args, trials).exit();
}

fn trial(file: &'static str, test: impl FnOnce(&Path) -> Result<(), Failed> + Send + 'static) -> Trial {
    Trial::ignorable_test(file, move || {
        let path = folder().join(file);
        if !path.exists() {
            return absent(&path);
        }
        test(&path).map(|()| Completion::Completed)
    })
}

/// Ignores a test without its file or folder, or fails it if all are required.
fn absent(path: &Path) -> Result<Completion, Failed> {
    let sentence = format!("{} is absent", path.display());
    match std::env::var_os("SONOWEAVE_REQUIRE_RECORDINGS").is_some_and(|value| value == "1") {
        true => Err(format!("{sentence}, and SONOWEAVE_REQUIRE_RECORDINGS requires it").into()),
        false => Ok(Completion::ignored_with(sentence)),
    }
}

struct Adler(u32, u32);

impl Adler {
    fn add(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.0 = (self.0 + u32::from(byte)) % 65_521;
            self.1 = (self.1 + self.0) % 65_521;
        }
    }
}

/// Sums over the readings of a whole replay.
#[derive(Default)]
struct Seen {
    frames: u64,
    numbered: usize,
    images_not_ok: usize,
    times: Vec<f64>,
    /// For each pair of frames: the number of transforms, and of those that are not OK.
    transforms: BTreeMap<(String, String), (u64, usize)>,
}

fn sequence(path: &Path, known: &Known) -> Result<(), Failed> {
    let mut device = Replay::open(&SequenceSettings::new(path))?;
    let about = device.describe().clone();
    assert_eq!(about.items, Some(known.items));
    let images = known.size != [0, 0];
    assert_eq!(about.image_size, images.then_some(known.size));
    assert_eq!(about.pixel, images.then_some((known.pixel, 1)));
    device.start()?;
    let mut seen = Seen::default();
    let mut adler = Adler(1, 0);
    loop {
        match device.next(sonoweave_core::NO_DEADLINE)? {
            Next::Reading(Reading::Frame(frame)) => {
                check_frame(&frame, known, &mut seen);
                // The file's byte order; no recording here is big-endian.
                let mut stored = frame.pixels.to_vec();
                if cfg!(target_endian = "big") {
                    stored.chunks_exact_mut(frame.pixel.bytes()).for_each(<[u8]>::reverse);
                }
                adler.add(&stored);
            }
            Next::Reading(Reading::NamedTransform(transform)) => {
                assert_eq!(transform.stamp.item, seen.frames, "before its frame");
                assert_eq!(transform.matrix[12..], [0.0, 0.0, 0.0, 1.0]);
                let sums = seen.transforms.entry((transform.from, transform.to)).or_default();
                sums.0 += 1;
                if transform.status != Status::Ok {
                    assert_eq!(transform.status, Status::Other("INVALID".into()));
                    sums.1 += 1;
                }
            }
            Next::End => break,
            other => return Err(format!("unexpected {other:?}").into()),
        }
    }
    assert_eq!((seen.frames, seen.numbered, seen.images_not_ok), (known.items, known.numbered, known.images_not_ok));
    assert_eq!([seen.times[0], seen.times[seen.times.len() - 1]], known.times);
    assert!(seen.times.is_sorted());
    let expected = known.transforms.iter().map(|&(from, to, not_ok)| ((from.into(), to.into()), (known.items, not_ok)));
    assert_eq!(seen.transforms, expected.collect());
    assert_eq!(adler.1 << 16 | adler.0, known.adler, "the pixels are those that another program reads");
    assert_eq!(content(path, &Limits::default())?, Content::Sequence);
    Ok(())
}

fn check_frame(frame: &Frame, known: &Known, seen: &mut Seen) {
    assert_eq!(frame.stamp.item, seen.frames);
    seen.frames += 1;
    seen.times.extend(frame.stamp.source_s);
    assert_eq!(frame.stamp.unfiltered_s.is_some(), frame.frame_number.is_some());
    seen.numbered += usize::from(frame.frame_number.is_some());
    seen.images_not_ok += usize::from(frame.status != Status::Ok);
    assert_eq!((frame.size, frame.channels), (known.size, 1));
    assert_eq!(frame.pixels.len(), known.size[0] as usize * known.size[1] as usize * known.pixel.bytes());
    assert_eq!((&*frame.orientation, &*frame.image_type), (known.orientation, known.image_type));
    assert!(frame.fields.is_empty(), "{:?}", frame.fields);
}

fn volume(path: &Path, size: [u32; 3], origin: [f64; 3]) -> Result<(), Failed> {
    assert_eq!(content(path, &Limits::default())?, Content::Volume);
    let refused = Replay::open(&SequenceSettings::new(path)).err().map(|error| error.to_string()).unwrap_or_default();
    assert!(refused.contains("field Kinds (byte ") && refused.contains("makes this a volume"), "{refused}");
    let mut volume = VolumeReader::open(path, &Limits::default())?;
    let header = volume.header().clone();
    assert_eq!((header.size, header.origin, header.spacing), (size, origin, [0.5; 3]));
    assert_eq!((header.pixel, header.channels, header.compressed), (PixelType::U8, 1, false));
    let mut voxels = Vec::new();
    while let Some(slice) = volume.next_slice()? {
        voxels.extend_from_slice(slice);
    }
    let count: usize = size.iter().map(|&n| n as usize).product();
    assert_eq!(voxels.len(), count);
    let stored = std::fs::read(path)?;
    assert_eq!(voxels, stored[stored.len() - count..]);

    let folder = tempfile::tempdir()?;
    let copy = folder.path().join("copy.mha");
    let compressed = formats::image::VolumeHeader { compressed: true, ..header };
    let mut writer = VolumeWriter::create(&copy, &compressed)?;
    writer.write_all(&voxels)?;
    writer.finish()?;
    let mut again = VolumeReader::open(&copy, &Limits::default())?;
    assert_eq!(again.header(), &compressed);
    let mut back = Vec::new();
    while let Some(slice) = again.next_slice()? {
        back.extend_from_slice(slice);
    }
    assert_eq!(back, voxels);
    Ok(())
}

/// Returns all readings, and the device's description.
fn all(path: &Path) -> Result<(sonoweave_core::Description, Vec<Reading>), Failed> {
    let mut device = Replay::open(&SequenceSettings::new(path))?;
    device.start()?;
    let mut readings = Vec::new();
    loop {
        match device.next(sonoweave_core::NO_DEADLINE)? {
            Next::Reading(reading) => readings.push(reading),
            Next::End => return Ok((device.describe().clone(), readings)),
            Next::Pending => return Err("a file never waits".into()),
        }
    }
}

/// PLUS wrote the image type into only one of the files; all else is equal, bit for bit.
fn the_same_twice(path: &Path) -> Result<(), Failed> {
    let (about, readings) = all(path)?;
    let (other_about, others) = all(&folder().join(format!("{TWICE}.mha")))?;
    assert_eq!(
        (about.items, about.image_size, about.pixel),
        (other_about.items, other_about.image_size, other_about.pixel)
    );
    assert_eq!(readings.len(), others.len());
    assert_eq!(readings.len(), 97 * 4);
    for (got, other) in readings.iter().zip(&others) {
        match (got, other) {
            (Reading::NamedTransform(got), Reading::NamedTransform(other)) => {
                assert_eq!(got, other);
                assert_eq!(got.matrix.map(f64::to_bits), other.matrix.map(f64::to_bits));
            }
            (Reading::Frame(got), Reading::Frame(other)) => {
                assert_eq!(
                    (got.stamp, got.frame_number, &got.status),
                    (other.stamp, other.frame_number, &other.status)
                );
                assert_eq!((got.size, got.channels, got.pixel), (other.size, other.channels, other.pixel));
                assert_eq!((&got.orientation, &got.fields), (&other.orientation, &other.fields));
                assert_eq!((&*got.image_type, &*other.image_type), ("BRIGHTNESS", ""));
                assert!(got.pixels == other.pixels, "frame {}", got.stamp.item);
            }
            other => return Err(format!("in another order: {other:?}").into()),
        }
    }
    Ok(())
}

/// Checks the only frame of a file against another program's checksum of its pixels.
fn only_frame(path: &Path, size: [u32; 2], pixel: PixelType, channels: u32, adler: u32) -> Result<(), Failed> {
    let (about, readings) = all(path)?;
    assert_eq!((about.items, about.image_size, about.pixel), (Some(1), Some(size), Some((pixel, channels))));
    let [Reading::Frame(frame)] = &readings[..] else { return Err(format!("{} readings", readings.len()).into()) };
    assert_eq!((&*frame.orientation, &*frame.image_type, &frame.status), ("MFA", "BRIGHTNESS", &Status::Ok));
    let mut sum = Adler(1, 0);
    sum.add(&frame.pixels);
    assert_eq!(sum.1 << 16 | sum.0, adler);
    assert_eq!(content(path, &Limits::default())?, Content::Sequence);
    Ok(())
}

fn colour(path: &Path) -> Result<(), Failed> {
    only_frame(path, [1152, 648], PixelType::U8, 3, COLOUR)
}

fn single(path: &Path) -> Result<(), Failed> {
    only_frame(path, [256, 256], PixelType::I16, 1, SINGLE)
}

/// Checks that every recording in the folder is listed here.
fn all_known() -> Result<Completion, Failed> {
    let known: BTreeSet<PathBuf> =
        KNOWN.iter().map(|k| k.file).chain(VOLUMES.map(|v| v.0)).chain(NRRDS).map(|file| folder().join(file)).collect();
    if !folder().exists() {
        return absent(&folder());
    }
    let mut found = BTreeSet::new();
    for kind in ["freehand", "nwire", "latency", "tracking", "formats"] {
        for entry in std::fs::read_dir(folder().join(kind))? {
            found
                .extend(Some(entry?.path()).filter(|path| path.extension().is_some_and(|e| e == "mha" || e == "nrrd")));
        }
    }
    let unknown: Vec<_> = found.difference(&known).collect();
    assert!(unknown.is_empty(), "{unknown:?}");
    Ok(Completion::Completed)
}
