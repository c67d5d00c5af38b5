//! Configurations and first frames of real recordings: values read from PLUS's files, and the
//! pixels that the automatic mask keeps.

use std::io::Read as _;
use std::path::Path;
use std::sync::Arc;

use libtest_mimic::Failed;

use config::{Settings, SourceKind};
use mask::{AutoMask, Clip, MaskFound, MaskPlan, MaskShape};
use sonoweave_core::slice::{Image, Pixels};

use crate::Test;

const SPINE_XML: &str = "freehand/PlusDeviceSet_VolumeReconstructionOnly_SpinePhantom_NN_MEAN.xml";
const FAN_XML: &str = "freehand/PlusDeviceSet_VolumeReconstructionOnly_SonixRP_TRUS_D70mm_LN_MEAN.xml";

pub(crate) const TESTS: &[Test] = &[
    Test::of_file("spine_configuration", SPINE_XML, spine_configuration),
    Test::of_file("fan_configuration", FAN_XML, fan_configuration),
    Test::of_file(
        "nwire_configuration",
        "nwire/PlusDeviceSet_fCal_Sim_SpatialCalibration_1.2.xml",
        nwire_configuration,
    ),
    Test::of_file("nwire_results", "nwire/FreehandCalibration3NWires.results.xml", nwire_results),
    Test::of_file("landmark_results", "tracking/PhantomRegistrationLandmarkDetection.results.xml", landmark_results),
    Test::of_file("stylus_results", "tracking/StylusCalibration.results.xml", stylus_results),
    Test::of_file("other_xml_is_refused", "latency/TemporalCalibrationResultsBaseline.xml", other_xml_is_refused),
    Test::of_file("a_sequence_is_no_configuration", "freehand/SpinePhantomFreehand.igs.mha", sequence_is_refused),
    Test::of_file("spine_mask", "freehand/SpinePhantomFreehand.igs.mha", spine_mask),
    Test::of_file("spine_mask_by_grabber", "freehand/SpinePhantomFreehand.igs.mha", spine_mask_by_grabber),
    Test::of_file(
        "bk_curvilinear_mask_by_grabber",
        "formats/BkCurvilinearScanConvertedData.igs.mha",
        curvilinear_mask_by_grabber,
    ),
    Test::of_file(
        "ultrasonix_curvilinear_mask_by_grabber",
        "formats/UltrasonixCurvilinearScanConvertedData.igs.mha",
        curvilinear_mask_by_grabber,
    ),
    Test::of_file("nwire_freehand_mask", "freehand/NwirePhantomFreehand.igs.mha", nothing_is_cut),
    Test::of_file("nwire_calibration_mask", "nwire/fCal_Test_Calibration_3NWires.igs.mha", nothing_is_cut),
    Test::of_file("nwire_validation_mask", "nwire/fCal_Test_Validation_3NWires.igs.mha", nothing_is_cut),
    Test::of_file("bk_curvilinear_mask", "formats/BkCurvilinearScanConvertedData.igs.mha", curvilinear_mask),
    Test::of_file(
        "ultrasonix_curvilinear_mask",
        "formats/UltrasonixCurvilinearScanConvertedData.igs.mha",
        curvilinear_mask,
    ),
];

fn spine_configuration(path: &Path) -> Result<(), Failed> {
    let settings = Settings::read(path, None)?;
    assert_eq!(settings.source, SourceKind::Plus);
    let names: Vec<_> = settings.transforms.iter().map(|t| t.name()).collect();
    assert_eq!(names, ["ImageToProbe", "PhantomToReference"]);
    assert_eq!(settings.transforms[0].rows()[..4], [-0.00157821, 0.0785919, -0.00803285, 15.3978]);
    assert_eq!(settings.spacing_mm, Some([0.5; 3]));
    assert!(matches!(settings.mask().plan(820, 616)?, MaskPlan::Auto(_)), "the rectangle is the whole frame");
    assert!(settings.notes[0].contains("Interpolation=\"NEAREST_NEIGHBOR\""));
    Ok(())
}

fn fan_configuration(path: &Path) -> Result<(), Failed> {
    let settings = Settings::read(path, None)?;
    let fan = settings.fan.ok_or("no fan")?;
    assert_eq!((fan.origin_px(), fan.radii_px(), fan.angles_deg()), ([380.0, 20.0], [120.0, 360.0], [-45.0, 45.0]));
    assert!(
        matches!(settings.mask().clip, Clip::RectOrAuto(r) if (r.x, r.y, r.width, r.height) == (192, 16, 420, 580))
    );
    let MaskPlan::Fixed(mask) = settings.mask().plan(820, 616)? else { return Err("a search".into()) };
    assert!(mask.contains(380, 380) && !mask.contains(380, 139) && !mask.contains(191, 240));
    Ok(())
}

fn nwire_configuration(path: &Path) -> Result<(), Failed> {
    let names: Vec<_> = Settings::read(path, None)?.transforms.iter().map(|t| t.name()).collect();
    assert_eq!(names, ["ImageToTransducerOriginPixel", "PhantomToReference", "StylusTipToStylus"]);
    Ok(())
}

fn nwire_results(path: &Path) -> Result<(), Failed> {
    let settings = Settings::read(path, None)?;
    assert_eq!(settings.transforms.len(), 1);
    assert_eq!(settings.transforms[0].name(), "ImageToProbe");
    assert_eq!(settings.transforms[0].rows()[8..12], [0.008793, 0.00953226, 0.0747944, -7.35909]);
    Ok(())
}

fn landmark_results(path: &Path) -> Result<(), Failed> {
    let names: Vec<_> = Settings::read(path, None)?.transforms.iter().map(|t| t.name()).collect();
    assert_eq!(names, ["PhantomToReference", "ReferenceToTracker", "StylusTipToStylus"]);
    Ok(())
}

fn stylus_results(path: &Path) -> Result<(), Failed> {
    assert_eq!(Settings::read(path, None)?.transforms[0].name(), "StylusTipToStylus");
    Ok(())
}

fn other_xml_is_refused(path: &Path) -> Result<(), Failed> {
    let error = Settings::read(path, None).expect_err("no configuration").to_string();
    assert!(error.contains("holds no CoordinateDefinitions"), "{error}");
    Ok(())
}

fn sequence_is_refused(path: &Path) -> Result<(), Failed> {
    let error = Settings::read(path, None).expect_err("no configuration").to_string();
    assert!(error.contains("SpinePhantomFreehand.igs.mha: "), "{error}");
    Ok(())
}

/// Returns the first eight frames' automatic mask, and those frames.
fn look(path: &Path) -> Result<(MaskFound, Vec<Image>), Failed> {
    let images = first_frames(path)?;
    Ok((find(&images), images))
}

fn find(images: &[Image]) -> MaskFound {
    let mut auto = AutoMask::new(images[0].width(), images[0].height());
    images.iter().find_map(|image| auto.push(image)).unwrap_or_else(|| auto.finish())
}

/// Returns the images as an analogue grabber delivers them: lifted by a level, with noise.
fn through_grabber(images: &[Image]) -> Vec<Image> {
    let mut state = 1_u32;
    let mut noise = || {
        // A sum of uniform numbers is nearly normal; its standard deviation is 2 levels.
        let sum: i32 = (0..12)
            .map(|_| {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                (state >> 24) as i32 - 128
            })
            .sum();
        sum * 2 / 256
    };
    let frame = |image: &Image| {
        let Pixels::U8(pixels) = image.pixels() else { return image.clone() };
        let pixels = pixels.iter().map(|p| (i32::from(*p) + 14 + noise()).clamp(0, 255) as u8).collect();
        Image::new(image.width(), image.height(), Pixels::U8(pixels))
    };
    images.iter().map(frame).collect()
}

fn spine_mask(path: &Path) -> Result<(), Failed> {
    let (found, _) = look(path)?;
    assert!(found.recognised);
    let bounds = found.mask.bounds().ok_or("empty")?;
    assert_eq!((bounds.x, bounds.y, bounds.width, bounds.height), (187, 12, 445, 590));
    assert_eq!(found.mask.area(), 445 * 590);
    Ok(())
}

/// The picture that exact zeros show is found within two pixels in a border with noise, too.
fn spine_mask_by_grabber(path: &Path) -> Result<(), Failed> {
    let (_, images) = look(path)?;
    let found = find(&through_grabber(&images));
    let MaskShape::Rectangle(rect) = found.shape else { return Err(found.to_string().into()) };
    let sides = [rect.x, rect.y, rect.x + rect.width, rect.y + rect.height];
    assert!(sides.iter().zip([187_u32, 12, 632, 602]).all(|(side, truth)| side.abs_diff(truth) <= 2), "{found}");
    Ok(())
}

/// A curved picture is found within two pixels of the outline that exact zeros show, or not at all.
fn curvilinear_mask_by_grabber(path: &Path) -> Result<(), Failed> {
    let (exact, images) = look(path)?;
    let found = find(&through_grabber(&images));
    if found.recognised {
        let common = found.mask.intersect(&exact.mask).area();
        let most = found.mask.area().max(exact.mask.area());
        assert!(common * 100 >= most * 98, "{found}: {common} of {most}");
    } else {
        assert!(found.mask.is_full(), "{found}");
    }
    Ok(())
}

/// Water is exactly 0 inside these frames: a mask that cut anything would lose later echoes.
fn nothing_is_cut(path: &Path) -> Result<(), Failed> {
    let (found, _) = look(path)?;
    assert!(found.mask.is_full(), "{:?}", found.mask.bounds());
    assert!(found.notes()[0].starts_with("no picture edge found"), "{:?}", found.reasons);
    Ok(())
}

fn curvilinear_mask(path: &Path) -> Result<(), Failed> {
    let (found, images) = look(path)?;
    assert!(found.recognised, "{:?}", found.reasons);
    let (width, height) = (images[0].width(), images[0].height());
    let middle = width / 2;
    let first_row = |u: u32| (0..height).find(|&v| found.mask.contains(u, v));
    let top = first_row(middle).ok_or("the middle is empty")?;
    let shoulder = (0..width).filter_map(first_row).min().ok_or("empty")?;
    assert!(top > shoulder + 5, "the top is concave: {top} in the middle, {shoulder} at the shoulders");
    assert!(!found.mask.is_full());
    // All pixels that are ever seen are kept, and hardly any others.
    let (mut seen, mut kept) = (0_u64, 0_u64);
    for v in 0..height {
        for u in 0..width {
            let at = (v * width + u) as usize;
            if images.iter().any(|image| matches!(image.pixels(), Pixels::U8(p) if p[at] != 0)) {
                seen += 1;
                kept += u64::from(found.mask.contains(u, v));
            }
        }
    }
    assert_eq!(kept, seen);
    assert!(found.mask.area() * 100 <= seen * 102, "{} for {seen}", found.mask.area());
    Ok(())
}

/// Reads up to eight 8-bit frames of a MetaImage with its data after the header. The test has
/// its own reader to be independent.
fn first_frames(path: &Path) -> Result<Vec<Image>, Failed> {
    let bytes = std::fs::read(path)?;
    let mark = b"ElementDataFile = LOCAL\n";
    let end = bytes.windows(mark.len()).position(|w| w == mark).ok_or("no local data")? + mark.len();
    let header = String::from_utf8_lossy(&bytes[..end]).into_owned();
    let field = |name: &str| {
        header
            .lines()
            .find_map(|line| line.split_once('=').filter(|(key, _)| key.trim() == name).map(|(_, value)| value.trim()))
    };
    let size: Vec<u32> =
        field("DimSize").ok_or("no size")?.split_whitespace().map(str::parse).collect::<Result<_, _>>()?;
    let frame = (size[0] * size[1]) as usize;
    let frames = size.get(2).copied().unwrap_or(1).min(8) as usize;
    let mut pixels = vec![0; frame * frames];
    if field("CompressedData") == Some("True") {
        flate2::read::ZlibDecoder::new(&bytes[end..]).read_exact(&mut pixels)?;
    } else {
        pixels.copy_from_slice(&bytes[end..end + frame * frames]);
    }
    Ok(pixels.chunks_exact(frame).map(|p| Image::new(size[0], size[1], Pixels::U8(Arc::from(p)))).collect())
}
