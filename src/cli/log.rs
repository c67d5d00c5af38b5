//! The log: its level, its filter, and its colours.

use std::path::PathBuf;

use clap::Args;
use clap_verbosity_flag::{LogLevel, Verbosity, VerbosityFilter};
use tracing_subscriber::filter::FilterFn;
use tracing_subscriber::layer::SubscriberExt as _;
use tracing_subscriber::util::SubscriberInitExt as _;
use tracing_subscriber::{EnvFilter, Layer as _};

use pipeline::trace::{self, TraceFile};

use super::Failure;
use crate::app::input;

/// Flags for the log and the trace, which every command takes.
#[derive(Debug, Args)]
#[command(next_help_heading = "Log")]
pub(super) struct LogFlags {
    #[command(flatten)]
    verbosity: Verbosity<Usual>,
    /// Log to stderr with this filter instead of -v or -q: error, warn, info, debug, trace, off, or
    /// a tracing filter [default: warn]
    #[arg(long, global = true, value_name = "FILTER", hide_short_help = true)]
    log: Option<String>,
    /// Write per-frame stage timings, for Perfetto (ui.perfetto.dev) or chrome://tracing
    #[arg(long, global = true, value_name = "FILE.json", hide_short_help = true)]
    trace: Option<PathBuf>,
}

/// Level without flags, and help.
#[derive(Debug, Clone, Copy)]
struct Usual;

impl LogLevel for Usual {
    fn default_filter() -> VerbosityFilter {
        VerbosityFilter::Warn
    }

    fn verbose_help() -> Option<&'static str> {
        Some("Log more: -v info, -vv debug, -vvv everything")
    }

    fn quiet_help() -> Option<&'static str> {
        Some("Print no progress, and log errors only; -qq logs nothing")
    }
}

impl LogFlags {
    /// Whether progress is left out.
    pub(super) fn is_quiet(&self) -> bool {
        matches!(self.verbosity.filter(), VerbosityFilter::Off | VerbosityFilter::Error)
    }

    /// Starts logging, and tracing if requested. Returns the trace's file.
    pub(super) fn begin(&self) -> Result<Option<TraceFile>, Failure> {
        let filter = filter(&self.log.clone().unwrap_or_else(|| self.verbosity.to_string()))?;
        // The layer's own errors would be printed with a panic where standard error is closed.
        let log = tracing_subscriber::fmt::layer()
            .with_ansi(has_colours())
            .with_writer(std::io::stderr)
            .log_internal_errors(false)
            .with_filter(filter);
        let (layer, file) = match &self.trace {
            Some(path) => {
                input::check_output(path)?;
                let begun = trace::begin(path).map_err(|e| Failure::io(path, "beginning the trace", &e))?;
                (Some(begun.0.with_filter(FilterFn::new(trace::is_recorded))), Some(begun.1))
            }
            None => (None, None),
        };
        // A second subscriber in one process (tests) is no failure.
        let _ = tracing_subscriber::registry().with(log).with(layer).try_init();
        Ok(file)
    }
}

/// Whether standard error shows colours: not in pipes and files, on dumb terminals and by NO_COLOR.
pub(super) fn has_colours() -> bool {
    anstream::AutoStream::choice(&std::io::stderr()) != anstream::ColorChoice::Never
}

/// Returns the log's filter.
fn filter(text: &str) -> Result<EnvFilter, Failure> {
    let refused = |why: &str| {
        Failure::usage(format!(
            "--log {text}: {why}; give error, warn, info, debug, trace or off, or a filter such as warn,drivers=debug"
        ))
    };
    // A lone word that is no level would be taken for the name of a module.
    let lone = text
        .split(',')
        .map(str::trim)
        .find(|part| !part.contains(['=', '[']) && part.parse::<tracing_subscriber::filter::LevelFilter>().is_err());
    if let Some(lone) = lone {
        return Err(refused(&format!("{lone:?} is no level")));
    }
    EnvFilter::try_new(text).map_err(|e| refused(&e.to_string()))
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Parser)]
    struct Command {
        #[command(flatten)]
        log: LogFlags,
    }

    fn flags(words: &str) -> LogFlags {
        Command::parse_from(std::iter::once("x").chain(words.split_whitespace())).log
    }

    #[test]
    fn verbosity_moves_level_quiet_leaves_out_progress() {
        for (words, level, quiet) in [
            ("", "warn", false),
            ("-v", "info", false),
            ("-vv", "debug", false),
            ("--verbose -v -v", "trace", false),
            ("-q", "error", true),
            ("--quiet --quiet", "off", true),
        ] {
            let flags = flags(words);
            assert_eq!((flags.verbosity.to_string().as_str(), flags.is_quiet()), (level, quiet), "{words}");
        }
        assert!(Command::try_parse_from(["x", "-v", "-q"]).is_err());
    }

    #[test]
    fn filter_without_level_refused() {
        for text in ["bogus", "warn,bogus", "drivers=loud"] {
            let Failure(crate::failure::Reason { sentence, .. }) = filter(text).unwrap_err();
            assert!(sentence.starts_with(&format!("--log {text}: ")) && sentence.contains("give error"), "{sentence}");
        }
        assert!(filter("warn,drivers=debug").is_ok() && filter("off").is_ok());
    }
}
