//! Per-frame stage timings: a span per frame and stage, written to a file in Chrome's trace
//! format. The format is read by Perfetto (<https://ui.perfetto.dev>) and `chrome://tracing`,
//! and described at
//! <https://docs.google.com/document/d/1CvAClvFfyA5R-PhYUmmOOQtYMH4h6I0nSsKchNAySU0>.
//!
//! | span | thread | `frame` |
//! |---|---|---|
//! | `capture` | the device's | the frame's number: from its delivery until it is passed on |
//! | `pair` | pairing | into the ingest, and among the waiting frames |
//! | `wait for pose` | none: many wait at a time | until there are poses around it, or it is refused |
//! | `insert` | insertion | into the volume |
//! | `draw` | picture | the newest that the picture shows; `slices` is its number of slices |
//! | `record` | recorder | compressed and written |
//!
//! Spans have the target `stage` and the level TRACE. Without a subscriber, a span costs one
//! comparison of levels: some nanoseconds. With the file, it costs some microseconds. A test
//! prints both; run it alone, since other tests may enable spans meanwhile.
//!
//! A separate thread writes the file line by line, one event per line, several times a second.
//! If the program is killed, only the last line is missing, which the format permits. No stage
//! waits for the file: events that find its queue full are left out, and counted at the file's
//! end. tracing-chrome has an unbounded queue, flushes at the end, and writes no waits of frames
//! beside the threads' spans.

use std::cell::Cell;
use std::fmt;
use std::fs::File;
use std::io::{self, BufWriter, Write as _};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use crossbeam_channel::{Receiver, RecvTimeoutError, Sender, bounded};
use serde_json::{Map, Value, json};
use tracing::field::{Field, Visit};
use tracing::span::{Attributes, Id, Record};
use tracing::{Event, Level, Metadata, Subscriber};
use tracing_subscriber::Layer;
use tracing_subscriber::layer::Context;
use tracing_subscriber::registry::LookupSpan;

/// The target of the stages' spans.
pub const STAGE: &str = "stage";
/// The level of the stages' spans.
const LEVEL: Level = Level::TRACE;

/// Capacity of the queue of events.
const QUEUE: usize = 16_384;
/// Longest time an event waits before it is written.
const TURN: Duration = Duration::from_millis(200);

/// The layer that writes spans, warnings and errors to a file.
pub struct TraceLayer {
    begin: Instant,
    to: Sender<Line>,
    left_out: Arc<AtomicU64>,
}

/// The file; complete when this is dropped.
#[derive(Debug)]
pub struct TraceFile {
    path: PathBuf,
    end: Sender<Line>,
    thread: Option<JoinHandle<io::Result<()>>>,
}

enum Line {
    Event(Value),
    End,
}

/// An open span.
struct Open {
    at: Instant,
    /// The thread that entered it first, if any.
    thread: Option<i32>,
    /// Time when it was last exited; child spans may keep it open longer.
    left: Option<Instant>,
    fields: Map<String, Value>,
}

/// Begins a file, and returns the layer that fills it.
///
/// # Errors
/// If the file or its thread cannot be created.
pub fn begin(path: &Path) -> io::Result<(TraceLayer, TraceFile)> {
    let file = File::create(path)?;
    let (to, from) = bounded(QUEUE);
    let left_out = Arc::new(AtomicU64::new(0));
    let count = Arc::clone(&left_out);
    let thread = std::thread::Builder::new().name("trace".into()).spawn(move || write(file, &from, &count))?;
    let layer = TraceLayer { begin: Instant::now(), to: to.clone(), left_out };
    Ok((layer, TraceFile { path: path.to_owned(), end: to, thread: Some(thread) }))
}

impl Drop for TraceFile {
    fn drop(&mut self) {
        // The thread may have ended by an error; then nobody receives the message.
        let _ = self.end.send(Line::End);
        match self.thread.take().map(JoinHandle::join) {
            Some(Ok(Err(error))) => tracing::error!("{}: the trace is not complete: {error}", self.path.display()),
            Some(Err(_)) => tracing::error!("{}: the trace's thread has panicked", self.path.display()),
            Some(Ok(Ok(()))) | None => {}
        }
    }
}

/// Writes events until the end. Each line begins with its separator, so that a file that was cut
/// off between two lines lacks only its last bracket. Only whole lines are written at a time,
/// since they all fit the buffer.
fn write(file: File, from: &Receiver<Line>, left_out: &AtomicU64) -> io::Result<()> {
    let mut to = BufWriter::with_capacity(1 << 16, file);
    let pid = std::process::id();
    let name = json!({ "ph": "M", "name": "process_name", "pid": pid, "args": { "name": "sonoweave" } });
    to.write_all(format!("[\n{name}").as_bytes())?;
    let mut written = Instant::now();
    loop {
        match from.recv_timeout(TURN) {
            Ok(Line::Event(mut event)) => {
                event["pid"] = pid.into();
                to.write_all(format!(",\n{event}").as_bytes())?;
            }
            Ok(Line::End) | Err(RecvTimeoutError::Disconnected) => break,
            Err(RecvTimeoutError::Timeout) => {}
        }
        if written.elapsed() >= TURN {
            written = Instant::now();
            to.flush()?;
        }
    }
    let left_out = left_out.load(Ordering::Relaxed);
    let end = json!({ "ph": "M", "name": "left_out", "pid": pid, "args": { "events": left_out } });
    to.write_all(format!(",\n{end}\n]\n").as_bytes())?;
    to.flush()?;
    if left_out > 0 {
        tracing::error!("lost: {left_out} events of the trace, as the disk was too slow");
    }
    Ok(())
}

impl TraceLayer {
    fn give(&self, event: Value) {
        if self.to.try_send(Line::Event(event)).is_err() {
            self.left_out.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Returns the time since the file's begin, µs.
    fn micros(&self, at: Instant) -> f64 {
        micros(at, self.begin)
    }

    /// Returns the calling thread's number; its first event writes its name to the file.
    fn thread(&self) -> i32 {
        thread_local!(static NUMBER: Cell<i32> = const { Cell::new(0) });
        let known = NUMBER.get();
        if known != 0 {
            return known;
        }
        let number = rustix::thread::gettid().as_raw_nonzero().get();
        NUMBER.set(number);
        let name = std::thread::current().name().unwrap_or_default().to_owned();
        self.give(json!({ "ph": "M", "name": "thread_name", "tid": number, "args": { "name": name } }));
        number
    }
}

fn micros(at: Instant, since: Instant) -> f64 {
    at.saturating_duration_since(since).as_nanos() as f64 / 1e3
}

impl fmt::Debug for TraceLayer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("TraceLayer").field("left_out", &self.left_out).finish_non_exhaustive()
    }
}

/// Returns whether an item goes to the file: stage spans, warnings and errors.
pub fn is_recorded(of: &Metadata<'_>) -> bool {
    if of.is_span() { of.target() == STAGE && *of.level() <= LEVEL } else { *of.level() <= Level::WARN }
}

impl<S: Subscriber + for<'span> LookupSpan<'span>> Layer<S> for TraceLayer {
    fn on_new_span(&self, attributes: &Attributes<'_>, id: &Id, context: Context<'_, S>) {
        let Some(span) = context.span(id) else { return };
        let mut open = Open { at: Instant::now(), thread: None, left: None, fields: Map::new() };
        attributes.record(&mut Fields(&mut open.fields));
        span.extensions_mut().insert(open);
    }

    fn on_record(&self, id: &Id, values: &Record<'_>, context: Context<'_, S>) {
        let Some(span) = context.span(id) else { return };
        if let Some(open) = span.extensions_mut().get_mut::<Open>() {
            values.record(&mut Fields(&mut open.fields));
        }
    }

    fn on_enter(&self, id: &Id, context: Context<'_, S>) {
        let Some(span) = context.span(id) else { return };
        if let Some(open) = span.extensions_mut().get_mut::<Open>()
            && open.thread.is_none()
        {
            (open.at, open.thread) = (Instant::now(), Some(self.thread()));
        }
    }

    fn on_exit(&self, id: &Id, context: Context<'_, S>) {
        let Some(span) = context.span(id) else { return };
        if let Some(open) = span.extensions_mut().get_mut::<Open>() {
            open.left = Some(Instant::now());
        }
    }

    fn on_close(&self, id: Id, context: Context<'_, S>) {
        let now = Instant::now();
        let Some(span) = context.span(&id) else { return };
        let Some(open) = span.extensions_mut().remove::<Open>() else { return };
        let left = open.left.unwrap_or(now);
        let (name, from, until) = (span.name(), self.micros(open.at), self.micros(left));
        match open.thread {
            Some(thread) => {
                self.give(json!({ "ph": "X", "cat": STAGE, "name": name, "ts": from, "dur": micros(left, open.at), "tid": thread, "args": open.fields }));
            }
            // No thread entered the span: it is a wait, concurrent with others. The number
            // distinguishes them.
            None => {
                let (thread, number) = (self.thread(), format!("{:x}", id.into_u64()));
                self.give(json!({ "ph": "b", "cat": STAGE, "name": name, "id": number, "ts": from, "tid": thread, "args": open.fields }));
                self.give(json!({ "ph": "e", "cat": STAGE, "name": name, "id": number, "ts": until, "tid": thread }));
            }
        }
    }

    fn on_event(&self, event: &Event<'_>, _: Context<'_, S>) {
        let mut fields = Map::new();
        event.record(&mut Fields(&mut fields));
        let at = self.micros(Instant::now());
        let level = event.metadata().level().as_str();
        self.give(json!({ "ph": "i", "s": "t", "cat": level, "name": level.to_lowercase(), "ts": at, "tid": self.thread(), "args": fields }));
    }
}

/// Fields as JSON.
struct Fields<'m>(&'m mut Map<String, Value>);

impl Visit for Fields<'_> {
    fn record_u64(&mut self, field: &Field, value: u64) {
        self.0.insert(field.name().into(), value.into());
    }

    fn record_i64(&mut self, field: &Field, value: i64) {
        self.0.insert(field.name().into(), value.into());
    }

    fn record_str(&mut self, field: &Field, value: &str) {
        self.0.insert(field.name().into(), value.into());
    }

    fn record_debug(&mut self, field: &Field, value: &dyn fmt::Debug) {
        self.0.insert(field.name().into(), format!("{value:?}").into());
    }
}

#[cfg(test)]
mod tests {
    use std::hint::black_box;

    use tracing::trace_span;
    use tracing_subscriber::filter::{FilterFn, LevelFilter};
    use tracing_subscriber::layer::SubscriberExt as _;
    use tracing_subscriber::{Registry, registry};

    use super::*;

    fn into(path: &Path) -> (impl Subscriber + Send + Sync + use<>, TraceFile) {
        let (layer, file) = begin(path).unwrap();
        (registry().with(layer.with_filter(FilterFn::new(is_recorded))), file)
    }

    fn events(path: &Path) -> Vec<Value> {
        serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
    }

    #[test]
    fn spans_have_time_thread_frame_and_waits_have_no_thread() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("t.json");
        let (subscriber, file) = into(&path);
        tracing::subscriber::with_default(subscriber, || {
            let waits = trace_span!(target: STAGE, "wait for pose", frame = 7_u64);
            let insert = trace_span!(target: STAGE, "insert", frame = 7_u64, by = "test").entered();
            std::thread::sleep(Duration::from_millis(5));
            drop(insert);
            trace_span!("of another kind").in_scope(|| ());
            tracing::error!(count = 3, "lost \"some\"");
            tracing::info!("nothing of note");
            drop(waits);
        });
        drop(file);
        let events = events(&path);
        let of = |name: &str| events.iter().filter(|event| event["name"] == name).collect::<Vec<_>>();
        let [insert] = of("insert")[..] else { panic!("{events:?}") };
        assert_eq!((&insert["ph"], &insert["args"]), (&"X".into(), &json!({ "frame": 7, "by": "test" })));
        assert!(insert["dur"].as_f64().unwrap() >= 5000.0 && insert["pid"] == std::process::id());
        let [begin, end] = of("wait for pose")[..] else { panic!("{events:?}") };
        assert_eq!((&begin["ph"], &end["ph"], &begin["id"]), (&"b".into(), &"e".into(), &end["id"]));
        assert!(begin["ts"].as_f64() < insert["ts"].as_f64());
        let after = insert["ts"].as_f64().unwrap() + insert["dur"].as_f64().unwrap();
        assert!(end["ts"].as_f64().unwrap() > after);
        assert_eq!(of("error")[0]["args"]["message"], "lost \"some\"");
        assert_eq!(of("left_out")[0]["args"]["events"], 0);
        let threads = of("thread_name");
        assert_eq!((threads.len(), &threads[0]["tid"]), (1, &insert["tid"]));
        assert_eq!(events.len(), 7, "{events:?}");
    }

    #[test]
    fn killed_program_leaves_file_without_last_bracket() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("t.json");
        let (subscriber, file) = into(&path);
        tracing::subscriber::with_default(subscriber, || {
            for frame in 0..5_000_u64 {
                trace_span!(target: STAGE, "insert", frame).in_scope(|| ());
            }
            let begin = Instant::now();
            // The events reach the disk without an orderly end.
            let text = loop {
                let text = std::fs::read_to_string(&path).unwrap();
                if text.contains("\"frame\":4999") || begin.elapsed() > Duration::from_secs(60) {
                    break text;
                }
                std::thread::sleep(TURN);
            };
            let events: Vec<Value> = serde_json::from_str(&format!("{text}]")).unwrap();
            assert_eq!(events.iter().filter(|event| event["ph"] == "X").count(), 5_000);
        });
        drop(file);
        assert_eq!(events(&path).iter().filter(|event| event["ph"] == "X").count(), 5_000);
    }

    #[test]
    #[allow(clippy::print_stdout, reason = "what is measured is for people")]
    fn span_cost_is_printed() {
        const SPANS: u64 = 100_000;
        let spans = || {
            let begin = Instant::now();
            for frame in 0..SPANS {
                let _span = trace_span!(target: STAGE, "insert", frame = black_box(frame)).entered();
            }
            begin.elapsed().as_nanos() as f64 / SPANS as f64
        };
        let warnings = Registry::default().with(tracing_subscriber::fmt::layer().with_filter(LevelFilter::WARN));
        let off = tracing::subscriber::with_default(warnings, || [spans(), spans()][1]);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("t.json");
        let (subscriber, file) = into(&path);
        let on = tracing::subscriber::with_default(subscriber, spans);
        drop(file);
        let events = events(&path);
        let left_out = events.last().unwrap()["args"]["events"].as_u64().unwrap();
        println!("a span costs {off:.1} ns while nobody asks, {on:.0} ns into a file ({left_out} of {SPANS} left out)");
        let written = events.iter().filter(|event| event["ph"] == "X").count() as u64;
        assert!(written + left_out >= SPANS, "every span is written or counted: {written} + {left_out}");
    }
}
