//! Shows the advice of `--live` to the operator.

use std::cell::OnceCell;
use std::io::{IsTerminal as _, stderr};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use pipeline::session::SessionStatus;

use crate::app::calibrate::guide::{Advice, Advisor};
use crate::app::live::outputs::troubles;
use crate::cli::progress::say;

/// Time between two lines of output without a terminal.
const PRINTED_EVERY: Duration = Duration::from_secs(2);
/// Steps of the progress bar.
const STEPS: f64 = 1000.0;

/// Output of the advice: a progress bar in a terminal, lines elsewhere.
#[derive(Default)]
pub(super) struct AdviceDisplay {
    /// Made when the first advice is shown; `None` in it without a terminal.
    bar: OnceCell<Option<ProgressBar>>,
    printed: Option<(String, Instant)>,
}

impl AdviceDisplay {
    fn bar(&self) -> Option<&ProgressBar> {
        let bar = self.bar.get_or_init(|| {
            stderr().is_terminal().then(|| {
                let bar = ProgressBar::with_draw_target(Some(STEPS as u64), ProgressDrawTarget::stderr());
                if let Ok(style) = ProgressStyle::with_template("{wide_bar} {percent:>3}%\n{wide_msg}") {
                    bar.set_style(style);
                }
                bar
            })
        });
        bar.as_ref()
    }
}

impl Advisor for AdviceDisplay {
    fn say(&self, sentence: &str) {
        say(sentence);
    }

    fn show(&mut self, advice: &Advice, status: &SessionStatus) {
        let text = advice.message.clone() + &troubles(status);
        if let Some(bar) = self.bar() {
            bar.set_position((advice.share.clamp(0.0, 1.0) * STEPS) as u64);
            bar.set_message(text);
            return;
        }
        let is_due = |(printed, at): &(String, Instant)| *printed != text && at.elapsed() >= PRINTED_EVERY;
        if self.printed.as_ref().is_none_or(is_due) {
            say(&format!("{:3.0} %: {text}", 100.0 * advice.share.clamp(0.0, 1.0)));
            self.printed = Some((text, Instant::now()));
        }
    }

    fn end(&mut self, last: &Advice) {
        if let Some(bar) = self.bar() {
            bar.finish_and_clear();
        }
        say(&if last.share >= 1.0 { format!("enough: {}", last.message) } else { format!("ended: {}", last.message) });
    }
}
