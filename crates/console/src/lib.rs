//! The console: reports and shows a running session over HTTP on this machine, over HTTPS to
//! others.
//!
//! | path | content |
//! |---|---|
//! | `GET /` | the page: live B-mode images, the volume, and planes through it |
//! | `GET /v1/stream` | the page's connection (WebSocket), see `stream` |
//! | `POST /v1/do` | a command: record, stop, freeze, clear, save, turn the view, …, see `message` |
//! | `POST /v1/measure` | a length, angle, area or volume between places, with its uncertainty |
//! | `POST /v1/pick` | the place of the volume that is visible at a point of its picture, see `pick` |
//! | `POST /v1/slices` | the slices that contributed to a place |
//! | `GET /v1/account`, `/v1/about` | the status that pages receive |
//! | `GET /v1/pictures/slice.png`, `view.png` | the newest picture |
//! | `GET /v1/openapi.json` | this interface in OpenAPI's format |
//! | `GET /status` | the full status as JSON: the file that `--stats` writes at the end |
//! | `GET /metrics` | the same in Prometheus' text format |
//! | `POST /v1/login` | exchanges a token for a cookie, if a token is configured, see `gate` |
//! | `GET /healthz` | 200 while the session progresses; else 503 and the stalled stages |
//!
//! Handlers read the [`Latest`] status and the pictures that stages leave on the
//! [`FrameBroadcaster`]. No stage ever waits for a client, however slow or stuck. Handlers work
//! without a socket ([`routes`]); [`Console`] adds one. Every request must name this machine
//! ([`hosts`]) and carry the token, if one is configured (`gate`). Requests that do more than read
//! must not come from another site's page ([`origin`]). Connections make room for others while they
//! are idle (`crowd`) or belong to a page that is not being viewed (`places`).

mod access;
mod api;
pub mod broadcast;
mod connections;
mod counts;
mod error;
pub mod hosts;
mod listen;
mod marks;
mod message;
mod metrics;
pub mod orbit_camera;
pub mod origin;
mod page;
mod pick;
pub mod planes;
mod quality;
mod server;
mod snapshot;
mod status;
pub mod stream;
pub mod style;
#[cfg(test)]
mod tests;
pub mod token;
mod viewer_slots;

use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use axum::extract::{DefaultBodyLimit, State};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use axum::{Router, middleware};

pub use broadcast::FrameBroadcaster;
pub use counts::Counts;
pub use error::ConsoleError;
pub use listen::Listen;
pub use server::Console;
pub use status::About;
use tokio::sync::watch;

use access::Gate;
use quality::EncodeCache;
use viewer_slots::ViewerSlots;

use config::bedside::Effective;
use guidance::GuidanceStatus;
use measure::{Slices, Uncertainty};
use pipeline::control::SessionController;
use pipeline::live::SessionStatus;
use statistics::LiveStatistics;

/// A session whose status is older than this has stalled.
const STALE: Duration = Duration::from_secs(5);

/// Settings of a session that clients can query.
#[derive(Debug, Clone, Default)]
pub struct Basis {
    /// The session's settings, key by key.
    pub config: Effective,
    /// Uncertainty of measured places.
    pub doubt: Uncertainty,
    /// Description of the session's pictures.
    pub about: About,
}

/// The newest status of a session, for clients.
#[derive(Debug)]
pub struct Latest {
    began: Instant,
    told: Mutex<Report>,
}

/// The last report.
#[derive(Debug, Clone)]
struct Report {
    at: Instant,
    account: Arc<SessionStatus>,
    coach: Option<Arc<GuidanceStatus>>,
    basis: Arc<Basis>,
    still: Vec<String>,
    ended: bool,
}

impl Default for Latest {
    fn default() -> Self {
        Self::new(Basis::default())
    }
}

impl Latest {
    /// Starts the status of a session that begins now, with these settings.
    pub fn new(basis: Basis) -> Self {
        let began = Instant::now();
        let told = Report {
            at: began,
            account: Arc::default(),
            coach: None,
            basis: Arc::new(basis),
            still: Vec::new(),
            ended: false,
        };
        Self { began, told: Mutex::new(told) }
    }

    /// Stores the present status and the stalled stages.
    pub fn tell(&self, account: &SessionStatus, still: &[String]) {
        let (account, still) = (Arc::new(account.clone()), still.to_vec());
        let mut told = self.lock();
        (told.at, told.account, told.still) = (Instant::now(), account, still);
    }

    /// Stores the present scan guidance.
    pub fn coached(&self, coach: GuidanceStatus) {
        self.lock().coach = Some(Arc::new(coach));
    }

    /// Records that the session is ending: from now on it only finishes its output.
    pub fn end(&self) {
        self.lock().ended = true;
    }

    /// Replaces the settings from now on.
    pub fn adopt(&self, basis: Basis) {
        self.lock().basis = Arc::new(basis);
    }

    fn lock(&self) -> MutexGuard<'_, Report> {
        self.told.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn told(&self) -> Report {
        self.lock().clone()
    }

    fn statistics<'a>(&'a self, told: &'a Report) -> LiveStatistics<'a> {
        LiveStatistics::new(&told.account, told.at.duration_since(self.began), &told.basis.config)
            .with_coach(told.coach.as_deref())
    }
}

/// The parts of a session that the console shows and controls.
#[derive(Debug, Clone, Default)]
pub struct ConsoleSession {
    /// The session status.
    pub latest: Arc<Latest>,
    /// The pictures.
    pub screen: Arc<FrameBroadcaster>,
    /// The session controller.
    pub desk: Arc<SessionController>,
    /// The slices that contributed to places.
    pub slices: Arc<Slices>,
}

/// State of the handlers.
#[derive(Debug, Clone)]
pub struct Served {
    /// The session.
    pub session: ConsoleSession,
    /// Whether a snapshot is being saved.
    snapping: Arc<AtomicBool>,
    places: Arc<ViewerSlots>,
    /// Ends long-lived connections.
    stopped: watch::Receiver<()>,
    gate: Arc<Gate>,
    shelf: Arc<EncodeCache>,
}

impl Served {
    /// Serves until `stopped` changes or its sender is gone.
    pub fn new(session: ConsoleSession, stopped: watch::Receiver<()>) -> Self {
        let (places, gate, shelf) =
            (Arc::new(ViewerSlots::new(viewer_slots::PATIENCE)), Arc::default(), Arc::default());
        Self { session, snapping: Arc::default(), places, stopped, gate, shelf }
    }

    /// Sets the time after which inactive pages make room for new ones.
    fn patient_for(self, patience: Duration) -> Self {
        Self { places: Arc::new(ViewerSlots::new(patience)), ..self }
    }

    /// Serves only requests that `gate` admits.
    fn behind(self, gate: Gate) -> Self {
        Self { gate: Arc::new(gate), ..self }
    }
}

/// Returns all routes.
pub fn routes(served: Served) -> Router {
    let routes = Router::new()
        .route("/", get(page::index))
        .route("/page/{name}", get(page::asset))
        .route("/v1/stream", get(stream::stream))
        .route("/v1/do", post(api::execute))
        .route("/v1/measure", post(api::measure))
        .route("/v1/pick", post(api::pick))
        .route("/v1/slices", post(api::slices))
        .route("/v1/account", get(api::account))
        .route("/v1/about", get(api::about))
        .route("/v1/settings", get(api::settings))
        .route("/v1/pictures/{name}", get(api::picture))
        .route("/v1/openapi.json", get(api::description))
        .route(access::LOGIN, post(access::login))
        .route("/status", get(status))
        .route("/metrics", get(prometheus))
        .route("/healthz", get(health))
        .fallback(nothing);
    guarded(routes, served)
}

/// Adds the checks that every request passes. The layer added last runs first.
fn guarded(routes: Router<Served>, served: Served) -> Router {
    routes
        .layer(middleware::from_fn_with_state(served.clone(), access::only_known))
        .layer(middleware::from_fn(origin::only_own_pages))
        .layer(middleware::from_fn_with_state(served.clone(), hosts::only_own_names))
        .layer(DefaultBodyLimit::max(origin::MOST_BODY))
        .layer(middleware::map_response(headed))
        .with_state(served)
}

async fn status(State(served): State<Served>) -> Response {
    let latest = &served.session.latest;
    let told = latest.told();
    match serde_json::to_vec_pretty(&latest.statistics(&told)) {
        Ok(json) => ([(header::CONTENT_TYPE, "application/json")], json).into_response(),
        Err(error) => {
            (StatusCode::INTERNAL_SERVER_ERROR, format!("the status cannot be written: {error}\n")).into_response()
        }
    }
}

async fn prometheus(State(Served { session, gate, .. }): State<Served>) -> Response {
    let latest = &session.latest;
    let told = latest.told();
    let text = metrics::text(&latest.statistics(&told)) + &metrics::of_console(&gate.counts);
    ([(header::CONTENT_TYPE, "text/plain; version=0.0.4; charset=utf-8")], text).into_response()
}

async fn health(State(served): State<Served>) -> Response {
    let Report { at, still, .. } = served.session.latest.told();
    let age = at.elapsed();
    if !still.is_empty() {
        return (StatusCode::SERVICE_UNAVAILABLE, format!("stands still: {}\n", still.join(", "))).into_response();
    }
    if age >= STALE {
        let sentence = format!("the session has not reported for {:.0} s\n", age.as_secs_f64());
        return (StatusCode::SERVICE_UNAVAILABLE, sentence).into_response();
    }
    "moves\n".into_response()
}

async fn nothing() -> Response {
    (StatusCode::NOT_FOUND, "this path does not exist; ask for /, /status, /metrics or /healthz\n").into_response()
}

/// Adds the headers of every answer: no caching, no content sniffing, no use by other sites'
/// pages.
async fn headed(mut response: Response) -> Response {
    let headers = response.headers_mut();
    for (name, value) in [
        (header::CACHE_CONTROL, "no-store"),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::REFERRER_POLICY, "no-referrer"),
        (header::HeaderName::from_static("cross-origin-resource-policy"), "same-origin"),
        (header::HeaderName::from_static("cross-origin-opener-policy"), "same-origin"),
    ] {
        headers.insert(name, header::HeaderValue::from_static(value));
    }
    headers.entry(header::CONTENT_SECURITY_POLICY).or_insert(header::HeaderValue::from_static(page::NOTHING));
    response
}
