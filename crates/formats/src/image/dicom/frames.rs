//! Per-frame data of an ultrasound multi-frame image.
//!
//! Our own files have it in private elements. Others have times at most: the steps between
//! frames, or one step for all.

use dicom_dictionary_std::tags;

use sonoweave_core::reading::Status;

use super::attributes::Attributes;
use super::private;
use crate::image::fault::Fault;
use crate::image::layout::Layout;
use crate::image::sequence::{Item, ItemTransform, Sequence};

const IDENTITY: [f64; 16] = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0];

/// Returns the sequence of an image's frames.
///
/// # Errors
/// [`Fault`] for attributes that do not fit the frames.
pub(super) fn sequence(attributes: &Attributes<'_>, layout: &Layout) -> Result<Sequence, Fault> {
    let count = usize::try_from(layout.layers).unwrap_or(usize::MAX);
    let mut items = vec![Item::bare(); count];
    let times = match attributes.private_doubles(private::TIMES, count)? {
        Some(times) => Some(times),
        None => steps(attributes, count)?,
    };
    let given = |time: f64| (!time.is_nan()).then_some(time);
    for (item, time) in items.iter_mut().zip(times.into_iter().flatten()) {
        item.source_s = given(time);
    }
    let unfiltered = attributes.private_doubles(private::UNFILTERED_TIMES, count)?;
    for (item, time) in items.iter_mut().zip(unfiltered.into_iter().flatten()) {
        item.unfiltered_s = given(time);
    }
    let numbers = attributes.private_lines(private::NUMBERS, count)?;
    for (item, number) in items.iter_mut().zip(numbers.into_iter().flatten()) {
        item.frame_number = number.parse().ok();
    }
    let mut transforms = Vec::new();
    if let Some(poses) = poses(attributes, count)? {
        let world = attributes.private_text(private::WORLD).filter(|world| !world.is_empty());
        transforms.push(("Image".to_owned(), world.unwrap_or_else(|| "World".into())));
        for (item, transform) in items.iter_mut().zip(poses) {
            item.transforms.push(transform);
        }
    }
    // The written image is in MF orientation; others show the depth downwards, too.
    Ok(Sequence::of_items(transforms, "MF", items))
}

/// Returns the poses of the frames; `None` if the image has none.
fn poses(attributes: &Attributes<'_>, count: usize) -> Result<Option<Vec<ItemTransform>>, Fault> {
    let Some(poses) = attributes.private_doubles(private::POSES, count.saturating_mul(16))? else { return Ok(None) };
    let words = attributes.private_lines(private::STATUSES, count)?;
    let transforms = poses.as_chunks::<16>().0.iter().enumerate().map(|(frame, matrix)| {
        let word = words.as_ref().map_or("OK", |words| &words[frame]);
        let is_known = matrix.iter().all(|number| number.is_finite());
        let status = match (word, is_known) {
            ("OK" | "", true) => Status::Ok,
            ("OK" | "", false) => Status::Other("MISSING".into()),
            (word, _) => Status::Other(word.to_owned().into()),
        };
        ItemTransform { name: 0, matrix: if is_known { *matrix } else { IDENTITY }, status }
    });
    Ok(Some(transforms.collect()))
}

/// Returns the frames' times from their steps, s; `None` if the image gives no step.
fn steps(attributes: &Attributes<'_>, count: usize) -> Result<Option<Vec<f64>>, Fault> {
    let vector = attributes.numbers(tags::FRAME_TIME_VECTOR)?;
    let steps = match (vector, attributes.array::<1>(tags::FRAME_TIME)?) {
        // The first step leads to the first frame.
        (Some(steps), _) if steps.len() == count => steps,
        (None, Some([step])) => vec![step; count],
        (None, None) => return Ok(None),
        (Some(steps), _) => {
            let problem = format!("holds {} steps for {count} frames; correct one of them", steps.len());
            return Err(attributes.fault(tags::FRAME_TIME_VECTOR, problem));
        }
    };
    let mut time_ms = 0.0;
    Ok(Some(
        (0..count)
            .map(|frame| {
                time_ms += if frame == 0 { 0.0 } else { steps[frame] };
                time_ms * 1e-3
            })
            .collect(),
    ))
}
