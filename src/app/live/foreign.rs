//! Refusal of calibrations of another probe or image: examples, and those whose image size is not
//! the grabber's.

use config::bedside::Bedside;
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
/// [`Failure`] for a preset of another size, and for a rectangle beyond the image, unless that is
/// `accepted`.
pub(super) fn refuse_size(
    bedside: &Bedside,
    opened: Option<[u32; 2]>,
    accepted: bool,
    reporter: &dyn Reporter,
) -> Result<(), Failure> {
    let Some(size) = opened.or(bedside.grabber.settings.size).map(|size| bedside.grabber.turned(size)) else {
        return Ok(());
    };
    if let Some(preset) = &bedside.calibration.preset {
        preset.fits(Some(size), None)?;
    }
    match beyond(bedside, size) {
        Some(sentence) if accepted => reporter.say(&format!("accepted for a trial: {sentence}")),
        Some(sentence) => fail!("{sentence}; use --accept-example to try a session without"),
        None => {}
    }
    Ok(())
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
