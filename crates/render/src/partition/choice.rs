//! The number of parts in which a picture is rendered.
//!
//! Parts read, light and store their voxels side by side, of which a renderer without parts does
//! some on one thread. For this, they light voxels near the cuts twice, keep a table of rays each,
//! and cast rays that another part hides. `make render-parts` measures this: two parts gain where a
//! picture is small beside its volume, and lose at 512×512 pixels and after each slice of a
//! freehand scan. More than two never gain more on two threads.
//!
//! A picture is therefore cut by itself only if it is small beside its volume, is drawn at once,
//! and two threads render it. Other numbers of threads were not measured. One thread never gains.

use volume::brick::VOXELS;

use crate::RenderError;
use crate::region::RenderRegion;
use crate::settings::{Cache, RenderSettings};

/// Threads for which parts were faster, and the number of parts.
const THREADS: usize = 2;
const PARTS: u32 = 2;
/// Voxels of the render region a pixel from which parts were faster: 32×32 pixels of 128×128×256
/// voxels.
const VOXELS_PER_PIXEL: u64 = 4096;

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
    let Some(parts) = settings.parts else {
        return Ok((if fits { usual(settings, region).min(layers) } else { 1 }, None));
    };
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

/// Returns the number of parts that is fastest; 1 for none. A picture that keeps nothing of its
/// rays counts as one that is drawn at once.
pub fn usual(settings: &RenderSettings, region: &RenderRegion) -> u32 {
    let pixels: u64 = settings.size.map(u64::from).iter().product();
    let voxels = region.bricks().map(u64::from).iter().product::<u64>() * VOXELS as u64;
    let is_at_once = settings.cache == Cache::None && settings.adaptive == 0.0;
    match is_at_once && settings.threads == THREADS && pixels * VOXELS_PER_PIXEL <= voxels {
        true => PARTS,
        false => 1,
    }
}
