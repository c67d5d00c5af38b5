//! The number of parts in which a picture is rendered.
//!
//! Parts light voxels near the cuts twice, keep a table of rays each, and cast rays that another
//! part hides. In `make render-parts` no picture of a whole volume gained by them on one or two
//! threads, so a picture is cut only where the settings ask for it.

use crate::RenderError;
use crate::region::RenderRegion;
use crate::settings::RenderSettings;

/// Returns the number of parts of a picture, 1 for none, and a note for the user if fewer are
/// made than the settings ask for. `one_level` are the bytes of the one-level cache of its rays,
/// which parts keep.
///
/// # Errors
/// [`RenderError::Part`] for no part at all, [`RenderError::AdaptiveParts`] for adaptive rays.
pub(crate) fn choose(
    settings: &RenderSettings,
    region: &RenderRegion,
    one_level: u64,
) -> Result<(u32, Option<String>), RenderError> {
    let layers = region.bricks()[2];
    let fits = one_level <= settings.cache_bytes;
    let Some(parts) = settings.parts else { return Ok((1, None)) };
    if parts == 0 {
        return Err(RenderError::Part { part: 0, parts, layers });
    }
    if parts > 1 && settings.adaptive > 0.0 {
        return Err(RenderError::AdaptiveParts { parts });
    }
    if parts > 1 && !fits {
        let note = format!(
            "{parts} parts would keep {:.0} MB of composited blocks, more than the {:.0} MB of the ray cache: the \
             picture is rendered without parts; raise its limit, or ask for a smaller picture or a longer step",
            one_level as f64 / 1e6,
            settings.cache_bytes as f64 / 1e6
        );
        return Ok((1, Some(note)));
    }
    let note = (parts > layers).then(|| {
        format!(
            "{parts} parts were asked for, and the volume has {layers} layers of 8 voxels: {layers} parts are rendered"
        )
    });
    Ok((parts.min(layers), note))
}
