//! Pictures on the way.

use std::num::NonZeroU64;
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};

use crate::cli::Failure;
use crate::cli::render::drawing::Over;
use crate::config::bedside::Picture;
use crate::pipeline::live::{Drawn, First, Looks};
use crate::render::RenderSettings;

/// A folder, and of how many slices one is pictured there.
#[derive(Debug, Clone)]
pub(super) struct Series {
    pub(super) folder: PathBuf,
    pub(super) every: NonZeroU64,
}

impl Series {
    /// Where the picture of so many slices goes, the last of them a frame's; `None` where it is of none since there were `before`.
    pub(super) fn path(&self, before: u64, slices: u64, item: u64) -> Option<PathBuf> {
        (slices / self.every > before / self.every).then(|| self.folder.join(format!("frame-{item:05}.png")))
    }
}

/// A session's picture, and its pictures on the way.
pub(super) struct Gallery {
    pub(super) picture: Picture,
    pub(super) series: Option<Series>,
    written: Mutex<Written>,
}

#[derive(Default)]
struct Written {
    /// Slices of the picture that was shown last.
    slices: u64,
    pictures: u64,
    failed: Option<Failure>,
}

impl Gallery {
    pub(super) fn new(picture: Picture, series: Option<Series>) -> Self {
        Self { picture, series, written: Mutex::default() }
    }

    /// How many pictures were written on the way.
    ///
    /// # Errors
    /// [`Failure`]: the first that could not be.
    pub(super) fn written(&self) -> Result<u64, Failure> {
        let mut written = self.written.lock().unwrap_or_else(PoisonError::into_inner);
        written.failed.take().map_or(Ok(written.pictures), Err)
    }
}

impl Looks for Gallery {
    fn settings(&self, first: &First) -> Result<RenderSettings, Box<dyn std::error::Error + Send + Sync>> {
        Looks::settings(&self.picture, first)
    }

    fn shown(&self, drawn: &Drawn) {
        let mut written = self.written.lock().unwrap_or_else(PoisonError::into_inner);
        let before = std::mem::replace(&mut written.slices, drawn.slices);
        let path = self.series.as_ref().and_then(|series| series.path(before, drawn.slices, drawn.item));
        let Some(path) = path.filter(|_| written.failed.is_none()) else { return };
        let over = Over { renderer: &drawn.renderer, background: self.picture.background, slice: None };
        match over.write(&self.picture.draw, &path) {
            Ok(_) => written.pictures += 1,
            Err(failure) => written.failed = Some(failure),
        }
    }

    fn every(&self) -> Option<NonZeroU64> {
        self.series.as_ref().map(|series| series.every)
    }
}
