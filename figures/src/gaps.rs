//! Gaps between the slices of a sweep.

use std::error::Error;

use sonoweave_core::slice::Slice;
use sync::FramePose;
use sync::survey::gap;

/// Returns the 90th percentile of the gaps between neighbouring slices, mm.
///
/// # Errors
/// If there are fewer than two slices.
pub fn widest_gap(slices: &[Slice]) -> Result<f64, Box<dyn Error>> {
    let pose = |(slice, item): (&Slice, u32)| FramePose {
        item: item.into(),
        time_ns: slice.time_ns,
        size: [slice.image.width(), slice.image.height()],
        world_from_image: slice.world_from_image,
    };
    let poses: Vec<FramePose> = slices.iter().zip(0..).map(pose).collect();
    Ok(gap(&poses).ok_or("the slices have no gap")?)
}
