//! State of the handlers: the session, who is admitted, and the viewers.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use axum::extract::FromRef;
use tokio::sync::watch;

use measure::Slices;
use pipeline::control::SessionController;

use super::access::Gate;
use super::broadcast::FrameBroadcaster;
use super::latest::Latest;
use super::quality::EncodeCache;
use super::viewer_slots::{self, ViewerSlots};

/// The parts of a session that the console shows and controls.
#[derive(Debug, Clone, Default)]
pub struct ConsoleSession {
    /// The session status.
    pub latest: Arc<Latest>,
    /// The pictures.
    pub broadcaster: Arc<FrameBroadcaster>,
    /// The session controller.
    pub controller: Arc<SessionController>,
    /// The slices that contributed to places.
    pub slices: Arc<Slices>,
}

/// State of the handlers.
#[derive(Debug, Clone)]
pub struct Served {
    /// The session.
    pub session: ConsoleSession,
    /// Whether a snapshot is being saved.
    pub(super) snapping: Arc<AtomicBool>,
    pub(super) viewer_slots: Arc<ViewerSlots>,
    /// Ends long-lived connections.
    pub(super) stopped: watch::Receiver<()>,
    pub(super) gate: Arc<Gate>,
    pub(super) jpeg_cache: Arc<EncodeCache>,
}

impl Served {
    /// Serves until `stopped` changes or its sender is gone.
    pub fn new(session: ConsoleSession, stopped: watch::Receiver<()>) -> Self {
        let (viewer_slots, gate, jpeg_cache) =
            (Arc::new(ViewerSlots::new(viewer_slots::PATIENCE)), Arc::default(), Arc::default());
        Self { session, snapping: Arc::default(), viewer_slots, stopped, gate, jpeg_cache }
    }

    /// Sets the time after which inactive pages make room for new ones.
    pub(super) fn patient_for(self, patience: Duration) -> Self {
        Self { viewer_slots: Arc::new(ViewerSlots::new(patience)), ..self }
    }

    /// Serves only requests that `gate` admits.
    pub(super) fn behind(self, gate: Gate) -> Self {
        Self { gate: Arc::new(gate), ..self }
    }
}

impl FromRef<Served> for Arc<Gate> {
    fn from_ref(served: &Served) -> Self {
        Self::clone(&served.gate)
    }
}
