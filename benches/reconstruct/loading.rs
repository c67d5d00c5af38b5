//! Loads recordings as posed slices, through the same stages as every source.

use std::error::Error;
use std::path::{Path, PathBuf};

use drivers::OpenSettings;
use drivers::replay::SequenceSettings;
use mask::{AutoMask, Mask, MaskPlan};
use sonoweave_core::slice::Slice;
use sonoweave_core::{Device, Next};
use sync::ingest::{Ingest, Sample};
use sync::{StampedPairing, survey};

/// Returns the folder of recordings: `SONOWEAVE_TEST_DATA` if set, else `../shared/data` beside
/// the project's folder.
pub(crate) fn folder(project: &Path) -> PathBuf {
    std::env::var_os("SONOWEAVE_TEST_DATA").map_or_else(|| project.join("../shared/data"), PathBuf::from)
}

/// Returns a recording's slices, and the mask of its data pixels: device, ingest, pairing,
/// automatic mask.
///
/// # Errors
/// If the recording or its configuration cannot be read, or a frame cannot be used.
pub(crate) fn load(sequence: &Path, config: &Path) -> Result<(Vec<Slice>, Mask), Box<dyn Error>> {
    let config = config::Settings::read(config, None)?;
    let options = config.pairing_options(None);
    let open =
        |images| drivers::open(&OpenSettings::Sequence(SequenceSettings { images, ..SequenceSettings::new(sequence) }));
    let survey = survey(open(false)?.as_mut(), &options, None)?;
    let mut pairing = StampedPairing::with_names(options, &survey.names)?;
    let mut ingest = Ingest::new();
    let mut slices = Vec::new();
    let mut device: Box<dyn Device> = open(true)?;
    device.start()?;
    loop {
        match device.next(sonoweave_core::NO_DEADLINE)? {
            Next::Reading(reading) => match ingest.take(reading) {
                Sample::Picture(picture) => slices.push(pairing.frame(picture).map_err(|r| r.to_string())?.slice),
                Sample::Transform(transform) => pairing.transform(transform),
                Sample::Refused(refusal) => return Err(refusal.to_string().into()),
                Sample::Unused(_) => {}
            },
            Next::Pending => {}
            Next::End => break,
        }
    }
    device.stop()?;
    let first = slices.first().ok_or("the recording holds no frame")?;
    let mask = match config.mask().plan(first.image.width(), first.image.height())? {
        MaskPlan::Fixed(mask) => mask,
        MaskPlan::Auto(mut auto) => find(&mut auto, &slices),
    };
    Ok((slices, mask))
}

fn find(auto: &mut AutoMask, slices: &[Slice]) -> Mask {
    let found = slices.iter().find_map(|slice| auto.push(&slice.image)).unwrap_or_else(|| auto.finish());
    (*found.mask).clone()
}
