//! Flags of movies.

use std::path::{Path, PathBuf};

use clap::Args;

use export::ExportError;
use export::movie::{Format, Rate};

use super::Failure;
use crate::app::input;
use crate::app::replay::session_movie::MovieRequest;

/// Pictures a second, unless given.
const RATE_HZ: f64 = 20.0;

/// The rate of a movie's pictures.
#[derive(Debug, Args)]
pub(super) struct MovieRate {
    /// Pictures a second of the movie [default: 20]
    #[arg(long, value_name = "HZ", help_heading = "Outputs", hide_short_help = true)]
    movie_rate: Option<f64>,
}

impl MovieRate {
    /// Returns the rate of the movie in a file.
    ///
    /// # Errors
    /// [`Failure`] for a name that is none of a movie, and a rate that it cannot have.
    pub(super) fn of(&self, path: &Path) -> Result<Rate, Failure> {
        let Some(format) = Format::of(path) else {
            return Err(ExportError::MovieName { path: path.to_owned() }.into());
        };
        Rate::new(self.movie_rate.unwrap_or(RATE_HZ), format)
            .map_err(|error| Failure::usage(format!("--movie-rate: {error}")))
    }

    /// Refuses a rate where no movie is written.
    ///
    /// # Errors
    /// [`Failure`] if one is given.
    pub(super) fn check_none(&self, instead: &str) -> Result<(), Failure> {
        if self.movie_rate.is_some() {
            fail_usage!("--movie-rate: no movie is written; {instead}, or leave it out");
        }
        Ok(())
    }
}

/// A movie of slices, in their time.
#[derive(Debug, Args)]
pub(super) struct MovieFlags {
    /// Write a movie to this file (.apng, .gif, .avi): at each of its times, the picture of the
    /// slices until then
    #[arg(
        long,
        value_name = "MOVIE.apng",
        conflicts_with = "pictures",
        help_heading = "Outputs",
        hide_short_help = true
    )]
    movie: Option<PathBuf>,
    #[command(flatten)]
    rate: MovieRate,
}

impl MovieFlags {
    /// Returns the movie, if one is wanted, after a check that it can be written.
    ///
    /// # Errors
    /// [`Failure`] for an impossible file or rate.
    pub(super) fn request(&self) -> Result<Option<MovieRequest>, Failure> {
        let Some(path) = &self.movie else {
            self.rate.check_none("give --movie")?;
            return Ok(None);
        };
        let rate = self.rate.of(path)?;
        input::check_output(path)?;
        Ok(Some(MovieRequest { path: path.clone(), rate }))
    }
}
