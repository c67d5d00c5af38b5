//! Contact detection of the scan guidance: in a tank, where a frame is black except for some
//! wires, and in a phantom that absorbs everything beyond its middle.

use std::path::Path;

use libtest_mimic::Failed;

use drivers::OpenSettings;
use drivers::replay::SequenceSettings;
use guidance::contact::{Depth, LEAST_OUT};
use mask::Mask;
use sonoweave_core::Next;
use sonoweave_core::reading::Reading;
use sonoweave_core::slice::{Image, Pixels};

use crate::Test;

pub(crate) const TESTS: &[Test] = &[
    Test::of_file("spine", "freehand/SpinePhantomFreehand.igs.mha", answers),
    Test::of_file("wires_by_hand", "freehand/NwirePhantomFreehand.igs.mha", answers),
    Test::of_file("wires", "nwire/fCal_Test_Calibration_3NWires.igs.mha", answers),
    Test::of_file("a_curved_probe", "formats/UltrasonixCurvilinearScanConvertedData.igs.mha", answers),
    Test::of_file("a_floor_that_goes", "latency/WaterTankBottomTranslationVideoBuffer.igs.mha", floor),
];

/// Returns the depth analysis of each frame.
fn depths(path: &Path) -> Result<Vec<Depth>, Failed> {
    let mut device = drivers::open(&OpenSettings::Sequence(SequenceSettings::new(path)))?;
    device.start()?;
    let mut all = Vec::new();
    while let Next::Reading(reading) = device.next(sonoweave_core::NO_DEADLINE)? {
        let Reading::Frame(frame) = reading else { continue };
        let [width, height] = frame.size;
        all.push(Depth::of(&Image::new(width, height, Pixels::U8(frame.pixels)), &Mask::full(width, height)));
    }
    device.stop()?;
    Ok(all)
}

fn answers(path: &Path) -> Result<(), Failed> {
    let all = depths(path)?;
    let least = all.iter().map(|depth| depth.out).min().ok_or("no frames")?;
    println!("{} frames; at least {least} samples stand out", all.len());
    assert!(all.iter().all(Depth::answers), "{least}");
    // The margin is clear.
    assert!(least >= 2 * LEAST_OUT, "{least}");
    Ok(())
}

/// The floor moves up into the near field, and down out of the frame: then there is no echo.
fn floor(path: &Path) -> Result<(), Failed> {
    let all = depths(path)?;
    let silent = all.iter().filter(|depth| !depth.answers()).count();
    println!("{} frames, {silent} without an answer", all.len());
    assert!(silent > all.len() / 10 && silent < all.len() / 2, "{silent} of {}", all.len());
    assert!(all.iter().filter(|depth| !depth.answers()).all(|depth| depth.means[1] < 1.0));
    Ok(())
}
