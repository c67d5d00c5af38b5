//! Refusal of calibrations of another probe or image: examples, and those whose image size is not
//! the grabber's.

use config::Settings;
use config::bedside::Bedside;
use drivers::grabber::Interlace;
use mask::Clip;

use crate::app::reporter::Reporter;
use crate::failure::Failure;

/// Refuses an example before a session opens its devices; a trial only reports it.
///
/// # Errors
/// [`Failure`] for an example, unless it is `accepted`.
pub(super) fn refuse_example(bedside: &Bedside, accepted: bool, reporter: &dyn Reporter) -> Result<(), Failure> {
    match bedside.no_example() {
        Err(error) if accepted => {
            reporter.say(&format!("accepted for a trial: {error}"));
            Ok(())
        }
        other => other.map_err(Failure::configuration),
    }
}

/// Refuses a calibration of another image size, as far as the grabber's is known before its first
/// frame.
///
/// # Errors
/// [`Failure`] for a preset or a file of another size, and for a rectangle beyond the image, unless
/// that is `accepted`.
pub(super) fn refuse_size(
    bedside: &Bedside,
    opened: Option<[u32; 2]>,
    accepted: bool,
    reporter: &dyn Reporter,
) -> Result<(), Failure> {
    let sizes = sizes(bedside, opened);
    let Some(&largest) = sizes.first() else { return Ok(()) };
    if let Some(preset) = &bedside.calibration.preset
        && sizes.iter().all(|size| preset.fits(Some(*size), None).is_err())
    {
        preset.fits(Some(largest), None)?;
    }
    if let Some(sentence) = other_size(bedside, &sizes) {
        return Err(Failure::new(sentence));
    }
    match beyond(bedside, largest) {
        Some(sentence) if accepted => reporter.say(&format!("accepted for a trial: {sentence}")),
        Some(sentence) => fail!("{sentence}; use --accept-example to try a session without"),
        None => {}
    }
    Ok(())
}

/// Returns the possible sizes of the grabber's frames, the largest first; none if they are unknown.
/// Until a grabber is opened, its video may be interlaced, and a frame be a field.
fn sizes(bedside: &Bedside, opened: Option<[u32; 2]>) -> Vec<[u32; 2]> {
    let settings = &bedside.grabber.settings;
    let sizes = match (opened, settings.size) {
        (None, Some([width, height])) if settings.interlace != Interlace::Whole => {
            vec![[width, height], [width, height / 2]]
        }
        (opened, given) => Vec::from_iter(opened.or(given)),
    };
    sizes.into_iter().map(|size| bedside.grabber.turned(size)).collect()
}

/// Reports a calibration file that was made with frames of another size than any of these. Presets
/// have a sentence of their own.
pub(super) fn other_size(bedside: &Bedside, sizes: &[[u32; 2]]) -> Option<String> {
    let Settings { path: Some(path), preset: None, record, .. } = &bedside.calibration else { return None };
    let (calibrated, [width, height]) = (record.picture_px?, *sizes.first()?);
    (!sizes.contains(&calibrated)).then(|| {
        format!(
            "{}: picture_px: the calibration was made with pictures of {}×{} pixels, and the grabber's have \
            {width}×{height}; set [grabber] size and the scanner as they were then, or calibrate anew",
            path.display(),
            calibrated[0],
            calibrated[1]
        )
    })
}

/// Reports a rectangle that extends beyond the image: it belongs to another image size.
pub(super) fn beyond(bedside: &Bedside, [width, height]: [u32; 2]) -> Option<String> {
    let (Clip::Rect(rect) | Clip::RectOrAuto(rect)) = bedside.mask.clip else { return None };
    let fits = |first: u32, count: u32, all: u32| first.checked_add(count).is_some_and(|end| end <= all);
    if rect.covers(width, height) || (fits(rect.x, rect.width, width) && fits(rect.y, rect.height, height)) {
        return None;
    }
    Some(format!(
        "the rectangle of {}×{} pixels from {}, {} reaches beyond the picture of {width}×{height}: the calibration is of \
        another picture; give [grabber] size, or calibrate anew",
        rect.width, rect.height, rect.x, rect.y
    ))
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    struct Silent;

    impl Reporter for Silent {
        fn say(&self, _: &str) {}
        fn status(&self, _: &dyn Fn() -> String) {}
    }

    /// Compares a calibration with a grabber that is told to have 720×576 pixels.
    fn refused(calibration: &str, preset: &str, interlace: &str, opened: Option<[u32; 2]>) -> Option<String> {
        let bed = format!(
            "format = \"sonoweave-bedside\"\nversion = 1\n[tracker]\nmodel = \"fastrak\"\nport = \"/dev/ttyUSB0\"\n\
             [grabber]\ndevice = \"/dev/video0\"\nsize = \"720x576\"\ninterlace = \"{interlace}\"\n\
             [calibration]\nfile = \"probe.toml\"\n{preset}"
        );
        let texts = [("b.toml".into(), bed), ("probe.toml".into(), calibration.into())];
        let bedside = Bedside::of_texts(Path::new("b.toml"), texts.into_iter().collect()).unwrap();
        refuse_size(&bedside, opened, true, &Silent).err().map(|failure| failure.0.sentence)
    }

    #[test]
    fn field_of_interlaced_video_has_half_the_lines() {
        const HEAD: &str = "format = \"sonoweave-calibration\"\nversion = 1\n";
        const MATRIX: &str = "[0.1, 0, 0, 0, 0, 0.1, 0, 0, 0, 0, 0.1, 0, 0, 0, 0, 1]";
        let file = |size: [u32; 2]| format!("{HEAD}[image_to_probe]\nmatrix = {MATRIX}\npicture_px = {size:?}\n");
        let preset = |size: [u32; 2]| {
            format!("{HEAD}[[preset]]\nname = \"40 mm\"\npicture_px = {size:?}\nimage_to_probe = {MATRIX}\n")
        };
        for is_preset in [false, true] {
            let of = |size, interlace, opened| match is_preset {
                true => refused(&preset(size), "preset = \"40 mm\"\n", interlace, opened),
                false => refused(&file(size), "", interlace, opened),
            };
            // The video of a grabber that is not opened yet may be interlaced or not.
            for interlace in ["one-field", "both-fields"] {
                assert_eq!(of([720, 576], interlace, None), None);
                assert_eq!(of([720, 288], interlace, None), None);
                assert!(of([720, 480], interlace, None).is_some_and(|why| why.contains("720×480")));
            }
            assert!(of([720, 288], "whole", None).is_some());
            assert!(of([720, 288], "one-field", Some([720, 576])).is_some());
            assert_eq!(of([720, 288], "one-field", Some([720, 288])), None);
        }
    }
}
