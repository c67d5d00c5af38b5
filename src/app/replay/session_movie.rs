//! A movie of a session, in the time of its slices.

use std::path::PathBuf;
use std::sync::Arc;

use export::movie::{Movie, Rate};
use image::RgbImage;

use crate::failure::Failure;

/// A movie to be written.
#[derive(Debug, Clone)]
pub(crate) struct MovieRequest {
    pub(crate) path: PathBuf,
    pub(crate) rate: Rate,
}

/// A movie that shows at each of its times what was known then: the picture of all slices until
/// that time after the first one.
pub(crate) struct SessionMovie {
    movie: Movie,
    /// Time of the first picture's last slice, ns.
    first_ns: Option<i64>,
    /// The last picture, and its time after the first, ns.
    last: Option<(u64, Arc<RgbImage>)>,
}

impl SessionMovie {
    /// Begins a movie of pictures of a size.
    ///
    /// # Errors
    /// [`Failure`] when the file cannot be written.
    pub(crate) fn create(request: &MovieRequest, size: [u32; 2]) -> Result<Self, Failure> {
        Ok(Self { movie: Movie::create(&request.path, size, request.rate)?, first_ns: None, last: None })
    }

    /// Adds a picture, whose last slice has a time, ns.
    ///
    /// # Errors
    /// [`Failure`] when the file cannot be written.
    pub(crate) fn add(&mut self, time_ns: i64, picture: RgbImage) -> Result<(), Failure> {
        let first_ns = *self.first_ns.get_or_insert(time_ns);
        let time_ns = time_ns.saturating_sub(first_ns).max(0).unsigned_abs();
        if let Some((_, before)) = &self.last {
            while self.movie.rate().start_ns(self.movie.pictures()) < time_ns {
                self.movie.push(before.clone())?;
            }
        }
        self.last = Some((time_ns, Arc::new(picture)));
        Ok(())
    }

    /// Completes the file with the last picture. Returns its outcome in words.
    ///
    /// # Errors
    /// [`Failure`] when it cannot be written, or there is no picture.
    pub(crate) fn finish(mut self) -> Result<String, Failure> {
        if let Some((time_ns, picture)) = self.last.take() {
            loop {
                let start_ns = self.movie.rate().start_ns(self.movie.pictures());
                self.movie.push(picture.clone())?;
                if start_ns >= time_ns {
                    break;
                }
            }
        }
        let (pictures, rate) = (self.movie.pictures(), self.movie.rate());
        let bytes = self.movie.finish()?;
        Ok(format!(
            "{pictures} pictures, {:.1} s, {:.1} MB",
            rate.start_ns(pictures) as f64 * 1e-9,
            bytes as f64 * 1e-6
        ))
    }
}
