//! Intermediate pictures.

use std::num::NonZeroU64;
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};

use config::bedside::Picture;
use pipeline::session::{Drawn, Every, First, ViewClient};
use render::RenderSettings;

use super::session_movie::{MovieRequest, SessionMovie};
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

/// A session's picture, and its intermediate pictures: as files or as a movie.
pub(crate) struct Gallery {
    picture: Picture,
    series: Option<Series>,
    movie: Option<MovieRequest>,
    written: Mutex<Written>,
}

#[derive(Default)]
struct Written {
    /// Slices of the picture that was shown last.
    slices: u64,
    pictures: u64,
    movie: Option<SessionMovie>,
    failed: Option<Failure>,
}

impl Gallery {
    /// Begins with no picture.
    ///
    /// # Errors
    /// [`Failure`] when the movie's file cannot be written.
    pub(crate) fn new(picture: Picture, series: Option<Series>, movie: Option<MovieRequest>) -> Result<Self, Failure> {
        let size = picture.view.image_size;
        let begun = movie.as_ref().map(|request| SessionMovie::create(request, size)).transpose()?;
        Ok(Self { picture, series, movie, written: Mutex::new(Written { movie: begun, ..Written::default() }) })
    }

    /// Completes the movie. Returns what was written, in words.
    ///
    /// # Errors
    /// [`Failure`]: the first file that could not be written.
    pub(crate) fn finish(&self) -> Result<Option<String>, Failure> {
        let mut written = self.written.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(failed) = written.failed.take() {
            return Err(failed);
        }
        if let Some(movie) = written.movie.take() {
            let path = self.movie.as_ref().map(|movie| movie.path.display());
            return movie.finish().map(|words| path.map(|path| format!("{path}: {words}")));
        }
        let folder = self.series.as_ref().map(|series| series.folder.display());
        Ok(folder.map(|folder| format!("{} pictures in {folder}", written.pictures)))
    }
}

impl ViewClient for Gallery {
    fn settings(&self, first: &First) -> Result<RenderSettings, Box<dyn std::error::Error + Send + Sync>> {
        ViewClient::settings(&self.picture, first)
    }

    fn shown(&self, drawn: &Drawn) {
        let mut written = self.written.lock().unwrap_or_else(PoisonError::into_inner);
        let over = Over::of(&drawn.renderer, self.picture.background, None);
        if let Some(movie) = &mut written.movie {
            if let Err(failure) = movie.add(drawn.time_ns, over.image(&self.picture.draw).0) {
                (written.movie, written.failed) = (None, Some(failure));
            }
            return;
        }
        let before = std::mem::replace(&mut written.slices, drawn.slices);
        let path = self.series.as_ref().and_then(|series| series.path(before, drawn.slices, drawn.item));
        let Some(path) = path.filter(|_| written.failed.is_none()) else { return };
        match over.write(&self.picture.draw, &path) {
            Ok(_) => written.pictures += 1,
            Err(failure) => written.failed = Some(failure),
        }
    }

    fn every(&self) -> Option<Every> {
        let of_movie = self.movie.as_ref().map(|movie| Every::Millihertz(movie.rate.millihertz()));
        of_movie.or(self.series.as_ref().map(|series| Every::Slices(series.every)))
    }
}
