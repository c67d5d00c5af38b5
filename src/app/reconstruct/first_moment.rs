//! First-moment correction of the written values.

use reconstruct::kernel::Method;
use reconstruct::{Compounding, FirstMoment, PathReconstructor, Settings};
use statistics::MomentNumbers;

use crate::failure::Failure;

/// Refuses, before the work, a correction that is impossible, or without written values.
///
/// # Errors
/// [`Failure`] with the flag to change.
pub(crate) fn check(is_asked: bool, settings: &Settings, is_written: bool) -> Result<(), Failure> {
    if !is_asked {
        return Ok(());
    }
    if !is_written {
        fail_usage!("--first-moment: applies to written values, and none are written; give a volume or --planes");
    }
    let compounding = settings.compounding;
    if compounding != Compounding::Mean {
        fail_usage!(
            "--first-moment: is that of a mean; leave it out, or choose the compounding mean instead of {}",
            compounding.name()
        );
    }
    if settings.shadow_weights.is_some() {
        fail_usage!(
            "--first-moment: shadow weights change within the image, which shifts no slice; leave one of them out"
        );
    }
    if settings.method == Method::Nearest {
        fail_usage!(
            "--first-moment: the kernel nearest weighs all distances alike; leave it out, or choose another kernel"
        );
    }
    Ok(())
}

/// Returns the corrected volume with its numbers; `None` if it was not asked for, or if nothing was
/// seen.
pub(crate) fn correct(is_asked: bool, reconstructor: &PathReconstructor) -> Option<(FirstMoment<'_>, MomentNumbers)> {
    let corrected = reconstructor.first_moment().filter(|_| is_asked)?;
    let numbers = MomentNumbers::of(&corrected.correction()?);
    Some((corrected, numbers))
}

/// Returns the header field of a corrected volume.
pub(crate) fn field(numbers: &MomentNumbers) -> (String, String) {
    let MomentNumbers { distance_mm, change, .. } = numbers;
    ("SonoweaveFirstMoment".into(), format!("corrected: {distance_mm:.4} mm, {change:.4} grey levels (medians)"))
}

/// Describes the correction, in a line.
pub(crate) fn sentence(numbers: &MomentNumbers) -> String {
    let MomentNumbers { distance_mm, change, change_p95 } = numbers;
    format!(
        "first moment: slices lie {distance_mm:.3} mm beside their voxel on average, which changes its value by \
         {change:.2} grey levels (medians; p95 {change_p95:.2})"
    )
}
