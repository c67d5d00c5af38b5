//! Intermediate pictures.

use std::num::NonZeroU64;
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};

use config::bedside::Picture;
use pipeline::session::{Drawn, First, ViewClient};
use render::RenderSettings;

use crate::app::render::drawing::Over;
use crate::failure::Failure;

/// A folder, and the number of slices between two pictures in it.
#[derive(Debug, Clone)]
pub(crate) struct Series {
    pub(crate) folder: PathBuf,
    pub(crate) every: NonZeroU64,
}

impl Series {
    /// Returns the file for the picture after `slices` slices, the last of which is frame
    /// `item`. Returns `None` if no picture is due since `before` slices.
    pub(crate) fn path(&self, before: u64, slices: u64, item: u64) -> Option<PathBuf> {
        (slices / self.every > before / self.every).then(|| self.folder.join(format!("frame-{item:05}.png")))
    }
}

/// A session's picture, and its intermediate pictures.
pub(crate) struct Gallery {
    pub(crate) picture: Picture,
    pub(crate) series: Option<Series>,
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
    pub(crate) fn new(picture: Picture, series: Option<Series>) -> Self {
        Self { picture, series, written: Mutex::default() }
    }

    /// Returns the number of intermediate pictures that were written.
    ///
    /// # Errors
    /// [`Failure`]: the first that could not be written.
    pub(crate) fn written(&self) -> Result<u64, Failure> {
        let mut written = self.written.lock().unwrap_or_else(PoisonError::into_inner);
        written.failed.take().map_or(Ok(written.pictures), Err)
    }
}

impl ViewClient for Gallery {
    fn settings(&self, first: &First) -> Result<RenderSettings, Box<dyn std::error::Error + Send + Sync>> {
        ViewClient::settings(&self.picture, first)
    }

    fn shown(&self, drawn: &Drawn) {
        let mut written = self.written.lock().unwrap_or_else(PoisonError::into_inner);
        let before = std::mem::replace(&mut written.slices, drawn.slices);
        let path = self.series.as_ref().and_then(|series| series.path(before, drawn.slices, drawn.item));
        let Some(path) = path.filter(|_| written.failed.is_none()) else { return };
        let over = Over::of(&drawn.renderer, self.picture.background, None);
        match over.write(&self.picture.draw, &path) {
            Ok(_) => written.pictures += 1,
            Err(failure) => written.failed = Some(failure),
        }
    }

    fn every(&self) -> Option<NonZeroU64> {
        self.series.as_ref().map(|series| series.every)
    }
}
