//! Reads frames whose list is the first axis, as written by earlier versions of 3D Slicer. The
//! first pixel of all frames comes first, so that no frame is complete before the last byte.

use std::io::BufRead;
use std::path::Path;
use std::sync::Arc;

use crate::Error;
use crate::image::layout::{Layout, ListAxis};
use crate::image::stream::PixelStream;

/// Callback: receives the number of rows read and the number of all rows, of all frames.
pub type OnRows = Arc<dyn Fn(u64, u64) + Send + Sync>;

/// Side of the square of pixels transposed at once: its source and target fit into the fastest
/// cache.
const BLOCK: usize = 64;

/// Reads all frames, in sequence. `layout` has passed the limit on their total size.
///
/// # Errors
/// The errors of [`PixelStream::read`].
pub fn frames<R: BufRead>(
    reader: R,
    path: &Path,
    layout: &Layout,
    progress: Option<&OnRows>,
) -> Result<Vec<u8>, Error> {
    let [width, height] = layout.size.map(|n| n as usize);
    let frames = layout.layers as usize;
    let pixel = layout.pixel.bytes() * layout.channels as usize;
    // A layer of the stream is one row of all frames.
    let rows =
        Layout { list: ListAxis::Last, layers: height as u64, layer_bytes: frames * width * pixel, ..layout.clone() };
    let mut stream = PixelStream::new(reader, path, &rows);
    let mut all = Vec::new();
    all.try_reserve_exact(frames * layout.layer_bytes).map_err(|error| Error::Io {
        path: path.to_owned(),
        doing: "reading pixels",
        source: std::io::Error::other(error),
    })?;
    all.resize(frames * layout.layer_bytes, 0);
    let mut row = vec![0; rows.layer_bytes];
    for y in 0..height {
        stream.read(&mut row)?;
        for (first_x, first_frame) in blocks(width, frames) {
            for frame in first_frame..frames.min(first_frame + BLOCK) {
                let to = frame * layout.layer_bytes + y * width * pixel;
                for x in first_x..width.min(first_x + BLOCK) {
                    let from = (x * frames + frame) * pixel;
                    all[to + x * pixel..][..pixel].copy_from_slice(&row[from..from + pixel]);
                }
            }
        }
        if let Some(progress) = progress {
            progress(y as u64 + 1, height as u64);
        }
    }
    Ok(all)
}

fn blocks(width: usize, frames: usize) -> impl Iterator<Item = (usize, usize)> {
    (0..width).step_by(BLOCK).flat_map(move |x| (0..frames).step_by(BLOCK).map(move |frame| (x, frame)))
}
