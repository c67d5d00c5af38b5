//! Renders the growing volume in the terminal: two pixels a character, in the terminal's
//! colours.

use std::fmt::Write as _;
use std::io::IsTerminal as _;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use terminal::Term;

use config::bedside::Picture;
use pipeline::session::Drawn;

use crate::app::live::viewers::Display;
use crate::app::reporter::Reporter;
use crate::cli::log::has_colours;

/// Time between two pictures in the terminal.
const SHOWN_EVERY: Duration = Duration::from_millis(200);
/// Largest width of a picture, columns.
const MOST_COLUMNS: usize = 72;
/// Lines that are left for text.
const WORDS: usize = 3;

/// A picture of the growing volume in the terminal, with a line below.
pub(super) struct Terminal {
    picture: Mutex<Picture>,
    bar: ProgressBar,
    shown: Mutex<PrintedPicture>,
}

#[derive(Default)]
struct PrintedPicture {
    at: Option<Instant>,
    said: Option<Instant>,
    art: String,
    line: String,
}

impl Terminal {
    /// Returns `None` if standard error is not a terminal with colours, or it is too small.
    pub(super) fn of(picture: &Picture) -> Option<Arc<Self>> {
        if !std::io::stderr().is_terminal() || !has_colours() || size().is_none() {
            return None;
        }
        let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::stderr());
        bar.set_style(ProgressStyle::with_template("{msg}").unwrap_or_else(|_| ProgressStyle::default_spinner()));
        Some(Arc::new(Self { picture: Mutex::new(picture.clone()), bar, shown: Mutex::default() }))
    }

    /// Keeps the last picture; later output goes below it.
    pub(super) fn leave(&self) {
        self.bar.abandon();
        // The bar does not end its line.
        let _ = Term::stderr().write_line("");
    }

    fn picture(&self) -> std::sync::MutexGuard<'_, Picture> {
        self.picture.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn shown(&self) -> std::sync::MutexGuard<'_, PrintedPicture> {
        self.shown.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Reporter for Terminal {
    fn say(&self, sentence: &str) {
        self.bar.println(format!("sonoweave: {sentence}"));
    }

    /// Sets the line below the next picture. Updates it now if there was no picture for a while.
    fn status(&self, line: &dyn Fn() -> String) {
        let line = line();
        let mut shown = self.shown();
        if shown.line == line {
            return;
        }
        shown.line = line;
        if shown.said.is_none_or(|at| at.elapsed() >= SHOWN_EVERY) {
            shown.said = Some(Instant::now());
            self.bar.set_message(format!("{}{}", shown.art, shown.line));
        }
    }
}

impl Display for Terminal {
    fn set_picture(&self, picture: &Picture) {
        picture.clone_into(&mut self.picture());
    }

    fn shown(&self, drawn: &Drawn) {
        let now = Instant::now();
        if self.shown().at.is_some_and(|at| now.duration_since(at) < SHOWN_EVERY) {
            return;
        }
        let Some(cells) = size() else { return };
        let picture = drawn.renderer.picture();
        let art = art(&picture.over(self.picture().background), picture.size, cells);
        let mut shown = self.shown();
        (shown.at, shown.said, shown.art) = (Some(now), Some(now), art);
        self.bar.set_message(format!("{}{}", shown.art, shown.line));
    }
}

/// Returns the columns and rows of characters for a picture; `None` if the terminal is too
/// small.
fn size() -> Option<[usize; 2]> {
    let (rows, columns) = Term::stderr().size_checked()?;
    let cells = [usize::from(columns).min(MOST_COLUMNS), usize::from(rows).checked_sub(WORDS)?];
    (cells[0] >= 16 && cells[1] >= 8).then_some(cells)
}

/// Converts a picture of three bytes a pixel to characters. Each character has an upper and a
/// lower half, with the mean of the pixels that it covers.
fn art(pixels: &[u8], [width, height]: [u32; 2], [columns, rows]: [usize; 2]) -> String {
    let (width, height) = (width as usize, height as usize);
    if width == 0 || height == 0 {
        return String::new();
    }
    // Characters are about twice as high as wide, so their halves are square.
    let columns = columns.min(2 * rows * width / height).max(1);
    let lines = (columns * height / width).next_multiple_of(2).max(2);
    let mean = |column: usize, line: usize| {
        let span = |at: usize, of: usize, length: usize| {
            let begin = at * length / of;
            begin..((at + 1) * length / of).max(begin + 1).min(length)
        };
        let (xs, ys) = (span(column, columns, width), span(line, lines, height));
        let (mut sum, mut count) = ([0_usize; 3], 0);
        for y in ys {
            for pixel in pixels[3 * (y * width + xs.start)..3 * (y * width + xs.end)].as_chunks::<3>().0 {
                (0..3).for_each(|c| sum[c] += usize::from(pixel[c]));
                count += 1;
            }
        }
        sum.map(|sum| sum / count.max(1))
    };
    let mut text = String::new();
    for line in (0..lines).step_by(2) {
        let mut last = None;
        for column in 0..columns {
            let halves = [mean(column, line), mean(column, line + 1)];
            if last != Some(halves) {
                let [[r, g, b], [s, h, c]] = halves;
                // Writing to a string does not fail.
                let _ = write!(text, "\x1b[38;2;{r};{g};{b};48;2;{s};{h};{c}m");
                last = Some(halves);
            }
            text.push('▀');
        }
        text.push_str("\x1b[0m\n");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn art_half_character_is_mean_of_its_pixels() {
        // Four columns of two pixels: white over black left, grey right.
        let row = |left: u8, right: u8| [[left; 3]; 2].concat().into_iter().chain([[right; 3]; 2].concat());
        let pixels: Vec<u8> = row(255, 100).chain(row(255, 50)).chain(row(0, 100)).chain(row(0, 50)).collect();
        assert_eq!(
            art(&pixels, [4, 4], [2, 8]),
            "\x1b[38;2;255;255;255;48;2;0;0;0m▀\x1b[38;2;75;75;75;48;2;75;75;75m▀\x1b[0m\n"
        );
        // A colour equal to its neighbour's is not written again.
        assert_eq!(art(&[9; 48], [4, 4], [4, 8]).matches("38;2").count(), 2);
    }

    #[test]
    fn art_keeps_aspect_ratio_within_size() {
        for (size, cells, expected) in [
            ([512, 512], [72, 20], (40, 20)),
            ([640, 320], [72, 40], (72, 18)),
            ([100, 400], [72, 20], (10, 20)),
            ([1, 1], [16, 8], (16, 8)),
        ] {
            let text = art(&vec![0; 3 * (size[0] * size[1]) as usize], size, cells);
            let lines: Vec<&str> = text.lines().collect();
            assert_eq!((lines[0].matches('▀').count(), lines.len()), expected, "{size:?}");
        }
        assert_eq!(art(&[], [0, 5], [16, 8]), "");
    }
}
