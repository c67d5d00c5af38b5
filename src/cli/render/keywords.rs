//! The flags of `render` as keywords of a program: the same names, values and defaults.

use clap::Args;

use config::view_settings::Draw;

use super::arguments::MAX_MEMORY;
use super::gibibytes;
use super::view_flags::ViewFlags;
use crate::app::input;
use crate::app::render::look::Look;
use crate::cli::keywords::{self, Keyword};
use crate::cli::values;
use crate::failure::Failure;

#[derive(Debug, Args)]
struct Keywords {
    #[arg(long, value_parser = values::window, allow_hyphen_values = true)]
    window: Option<WindowValue>,
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    #[arg(long, default_value_t = MAX_MEMORY)]
    max_memory: f64,
    #[arg(long)]
    level: Option<usize>,
    #[command(flatten)]
    view_flags: ViewFlags,
}

// clap takes an array for its own notation of repeated values; a named type is a single value to
// it.
type WindowValue = [f32; 2];

/// Settings of a picture.
pub(crate) struct Picture {
    pub(crate) look: Look,
    /// Grey values that are black and white; `None` for the volume's.
    pub(crate) window: Option<[f32; 2]>,
    pub(crate) threads: usize,
    /// Memory limit of a volume on the disk, bytes.
    pub(crate) memory_bytes: u64,
    /// Level of an OME-Zarr volume; `None` for the finest.
    pub(crate) level: Option<usize>,
}

/// Parses keywords, such as `image_size` and `512x512`, as the flags of their names.
///
/// # Errors
/// [`Failure`] names the keyword, its value and the values that it takes.
pub(crate) fn parse(keywords: &[Keyword]) -> Result<Picture, Failure> {
    let Keywords { window, threads, max_memory, level, view_flags } = keywords::parse(keywords)?;
    if let Some(what) = view_flags.planar.drawn().into_iter().find(|w| matches!(w, Draw::Slice | Draw::Probe)) {
        fail!("draw {}: a volume has no current slice; draw scale or cube", what.name());
    }
    let (threads, memory_bytes) = (input::threads(threads), gibibytes(max_memory)?);
    Ok(Picture { look: view_flags.look()?, window, threads, memory_bytes, level })
}
