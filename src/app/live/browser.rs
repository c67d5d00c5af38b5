//! Opens the console's page in the desktop's browser.

use std::os::unix::process::CommandExt as _;
use std::process::{Command, Stdio};

/// Program that opens an address in the user's browser.
const OPENER: &str = "xdg-open";

/// Opens a page where there is a display, and returns a sentence about the result. The browser
/// outlives this program, and Ctrl-C does not end it.
pub(super) fn open(url: &str) -> String {
    let has_display =
        ["DISPLAY", "WAYLAND_DISPLAY"].iter().any(|name| std::env::var_os(name).is_some_and(|value| !value.is_empty()));
    if !has_display {
        return format!("there is no display here; open {url} in a browser");
    }
    let mut command = Command::new(OPENER);
    command.arg(url).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).process_group(0);
    match command.spawn() {
        Ok(mut browser) => {
            // Its end is of no interest, but must be received.
            std::thread::spawn(move || browser.wait());
            "the page opens in the browser".to_owned()
        }
        Err(error) => format!("{OPENER} cannot be started ({error}); open {url} in a browser"),
    }
}
