//! The line on which a chest belt or an ECG marks moments of a recorded session.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use config::bedside::{MarkerEdge, MarkerInput, MarkerLine};
use drivers::transport::input_line::{Edge, Input, InputLine};
use pipeline::command::{Command, Marker, MarkerSource};
use pipeline::control::{Progress, SessionController};
use sonoweave_core::clock::Monotonic;

use crate::failure::Failure;

/// Time after which a line that was unplugged is opened again.
const AGAIN: Duration = Duration::from_secs(1);

/// Marks the moments of the line's edges while a session is recorded, until it is dropped.
pub(super) struct Markers {
    ends: Arc<AtomicBool>,
    sentences: Arc<Mutex<Vec<(Progress, String)>>>,
    thread: Option<JoinHandle<()>>,
}

impl Markers {
    /// Opens the line.
    ///
    /// # Errors
    /// [`Failure`] when it cannot be opened.
    pub(super) fn open(line: &MarkerLine, controller: &Arc<SessionController>) -> Result<Self, Failure> {
        let open = {
            let (path, input) = (line.port.clone(), input(line.input));
            move || InputLine::open(&path, input)
        };
        let name = line.port.display().to_string();
        let mut opened = Some(open().map_err(|why| Failure::new(format!("the line of markers, {name}, {why}")))?);
        let edge = edge(line.edge);
        let (ends, sentences): (Arc<AtomicBool>, Arc<Mutex<Vec<_>>>) = Default::default();
        let (ended, said, controller) = (Arc::clone(&ends), Arc::clone(&sentences), Arc::clone(controller));
        let watch = move || {
            let say = |how, text| said.lock().unwrap_or_else(PoisonError::into_inner).push((how, text));
            // Without a recording there is nothing to mark.
            let mark = |at_ns| drop(controller.execute(Command::Mark(Marker { at_ns, by: MarkerSource::Line })));
            while !ended.load(Ordering::Relaxed) {
                let Some(mut line) = opened.take() else {
                    std::thread::sleep(AGAIN);
                    opened = open().ok();
                    if opened.is_some() {
                        say(Progress::Done, format!("the line of markers, {name}, is there again"));
                    }
                    continue;
                };
                if let Err(why) = line.watch(edge, &Monotonic, &ended, mark) {
                    let lost = format!("the line of markers, {name}, {why}; no moments are marked until it is back");
                    say(Progress::Failed, lost);
                }
            }
        };
        let thread = std::thread::Builder::new().name("markers".into()).spawn(watch)?;
        Ok(Self { ends, sentences, thread: Some(thread) })
    }

    /// Takes the sentences for the user since the last call.
    pub(super) fn sentences(&self) -> Vec<(Progress, String)> {
        std::mem::take(&mut *self.sentences.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

impl Drop for Markers {
    fn drop(&mut self) {
        self.ends.store(true, Ordering::Relaxed);
        self.thread.take().map(JoinHandle::join);
    }
}

fn input(of: MarkerInput) -> Input {
    match of {
        MarkerInput::Cts => Input::ClearToSend,
        MarkerInput::Dcd => Input::CarrierDetect,
    }
}

fn edge(of: MarkerEdge) -> Edge {
    match of {
        MarkerEdge::Rising => Edge::Rising,
        MarkerEdge::Falling => Edge::Falling,
    }
}
