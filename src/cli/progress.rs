//! Progress on standard error: sentences, lines of a session's status, and bars.

use std::cell::Cell;
use std::io::Write as _;
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use drivers::replay::Progress;

use crate::app::reporter::Reporter;

/// Time between two lines of a session's status.
const STATUS_EVERY: Duration = Duration::from_secs(2);

/// Says a sentence. A closed pipe, or a terminal that is gone, ends no session: `eprintln!` would
/// panic.
pub(super) fn say(line: &str) {
    let _ = writeln!(std::io::stderr().lock(), "sonoweave: {line}");
}

/// Lines on standard error.
pub(super) struct Lines {
    /// Whether the status is not shown.
    quiet: bool,
    /// Time of the last line of status.
    printed: Cell<Option<Instant>>,
}

impl Lines {
    pub(super) fn new(quiet: bool) -> Self {
        Self { quiet, printed: Cell::new(None) }
    }
}

impl Reporter for Lines {
    fn say(&self, sentence: &str) {
        say(sentence);
    }

    fn status(&self, line: &dyn Fn() -> String) {
        // The first line is due after a while.
        let is_due = self.printed.get().is_some_and(|printed| printed.elapsed() >= STATUS_EVERY);
        if is_due && !self.quiet {
            say(&line());
        }
        if is_due || self.printed.get().is_none() {
            self.printed.set(Some(Instant::now()));
        }
    }
}

/// A bar that is removed when this is dropped.
struct Removed(ProgressBar);

impl Drop for Removed {
    fn drop(&mut self) {
        self.0.finish_and_clear();
    }
}

/// Shows the progress of an activity as a bar, until the returned function is dropped.
pub(super) fn steps(activity: &'static str, count: u64) -> Box<dyn Fn(u64)> {
    let bar = Removed(progress(activity, count));
    Box::new(move |done| bar.0.set_position(done))
}

/// Returns a progress bar on a terminal; it is hidden in a pipe.
pub(super) fn progress(doing: &'static str, total: u64) -> ProgressBar {
    let bar = ProgressBar::with_draw_target(Some(total), ProgressDrawTarget::stderr());
    if let Ok(style) = ProgressStyle::with_template("{msg:12} {wide_bar} {pos}/{len} {eta:>4}") {
        bar.set_style(style);
    }
    bar.set_message(doing);
    bar.enable_steady_tick(Duration::from_millis(200));
    bar
}

/// Returns a progress bar for files whose list is the first axis. All their frames are read
/// before the first one is available.
pub(super) fn turning() -> Progress {
    // No bar is shown for other files.
    let bar = OnceLock::new();
    Progress(Some(Arc::new(move |done, of| {
        let bar: &ProgressBar = bar.get_or_init(|| progress("turning", of));
        bar.set_position(done);
        if done == of {
            bar.finish_and_clear();
        }
    })))
}
