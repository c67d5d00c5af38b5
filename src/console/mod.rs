//! What a session tells and shows of itself while it runs, over HTTP on this machine, and over HTTPS to others.
//!
//! | path | what |
//! |---|---|
//! | `GET /` | the page: the scanner's picture, the volume's and planes through it, live |
//! | `GET /v1/stream` | the page's connection (WebSocket), see `stream` |
//! | `POST /v1/do` | a wish, as pages say them: to record, stop, freeze, clear, save, turn the view, …, see `wish` |
//! | `POST /v1/measure` | a length, angle, area or volume between places, and how far it may be off |
//! | `POST /v1/pick` | the place of the volume that is seen at a place of its picture, see `pick` |
//! | `POST /v1/slices` | the slices that a place was made of |
//! | `GET /v1/account`, `/v1/about` | what pages are told |
//! | `GET /v1/pictures/slice.png`, `view.png` | the newest picture |
//! | `GET /v1/openapi.json` | all of this in OpenAPI's form |
//! | `GET /status` | everything, as JSON: what `--stats` writes at the end |
//! | `GET /metrics` | the same in Prometheus' text form |
//! | `POST /v1/login` | where a token is wanted: a browser shows it, see `gate` |
//! | `GET /healthz` | 200 while the session moves, 503 and who stands still when it does not |
//!
//! Handlers read the [`Latest`] account and what stages leave on the [`Screen`], so that no client, slow or stuck as it may be, is waited for by a stage. They work without a socket ([`routes`]);
//! [`Console`] gives them one. Who asks passes four doors, whatever is asked for: it must call this machine by a name of its own ([`hosts`]), must be no page of others where
//! more than reading is asked for ([`origin`]), must have the token where there is one (`gate`), and gives way to others while it asks for nothing (`crowd`) or
//! is a page that nobody looks at (`places`).

mod api;
mod counts;
mod crowd;
pub mod dress;
mod gate;
pub mod hosts;
mod listen;
mod marks;
mod metrics;
pub mod origin;
mod page;
mod pick;
mod places;
pub mod planes;
mod quality;
pub mod screen;
mod server;
pub mod sight;
mod snapshot;
pub mod stream;
#[cfg(test)]
mod tests;
pub mod token;
mod told;
mod wish;

use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use axum::Router;
use axum::extract::{DefaultBodyLimit, State};
use axum::http::{StatusCode, header};
use axum::middleware;
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};

pub use counts::Counts;
pub use listen::{AccessError, Listen};
pub use screen::Screen;
pub use server::{Console, ConsoleError};
use tokio::sync::watch;
pub use told::About;

use gate::Gate;
use places::Places;
use quality::Shelf;

use crate::coach::CoachTold;
use crate::config::bedside::Effective;
use crate::desk::Desk;
use crate::measure::{Doubt, Slices};
use crate::pipeline::live::Account;
use crate::statistics::LiveStatistics;

/// An account that is older tells of a session that does not move.
const STALE: Duration = Duration::from_secs(5);

/// What a session runs by.
#[derive(Debug, Clone, Default)]
pub struct Basis {
    /// Its settings, key by key.
    pub config: Effective,
    /// How far places may be off that are measured.
    pub doubt: Doubt,
    /// What there is to say of its pictures.
    pub about: About,
}

/// The newest account of a session, for whoever asks.
#[derive(Debug)]
pub struct Latest {
    began: Instant,
    told: Mutex<Told>,
}

/// What was told last.
#[derive(Debug, Clone)]
struct Told {
    at: Instant,
    account: Arc<Account>,
    coach: Option<Arc<CoachTold>>,
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
    /// Of a session that begins now, with these settings.
    pub fn new(basis: Basis) -> Self {
        let began = Instant::now();
        let told = Told {
            at: began,
            account: Arc::default(),
            coach: None,
            basis: Arc::new(basis),
            still: Vec::new(),
            ended: false,
        };
        Self { began, told: Mutex::new(told) }
    }

    /// The account of this moment, and the stages that stand still.
    pub fn tell(&self, account: &Account, still: &[String]) {
        let (account, still) = (Arc::new(account.clone()), still.to_vec());
        let mut told = self.lock();
        (told.at, told.account, told.still) = (Instant::now(), account, still);
    }

    /// What the coach tells at this moment.
    pub fn coached(&self, coach: CoachTold) {
        self.lock().coach = Some(Arc::new(coach));
    }

    /// The session is told to end, or ends by itself: what follows is only written.
    pub fn end(&self) {
        self.lock().ended = true;
    }

    /// These settings hold from now on.
    pub fn adopt(&self, basis: Basis) {
        self.lock().basis = Arc::new(basis);
    }

    fn lock(&self) -> MutexGuard<'_, Told> {
        self.told.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn told(&self) -> Told {
        self.lock().clone()
    }

    fn statistics<'a>(&'a self, told: &'a Told) -> LiveStatistics<'a> {
        LiveStatistics::new(&told.account, told.at.duration_since(self.began), &told.basis.config)
            .with_coach(told.coach.as_deref())
    }
}

/// What is shown of a session, and by whom it is told what to do.
#[derive(Debug, Clone, Default)]
pub struct Shown {
    /// What is told.
    pub latest: Arc<Latest>,
    /// What is seen.
    pub screen: Arc<Screen>,
    /// What may be wished.
    pub desk: Arc<Desk>,
    /// The slices that places were made of.
    pub slices: Arc<Slices>,
}

/// What handlers have to do with.
#[derive(Debug, Clone)]
pub struct Served {
    /// What it is all about.
    pub shown: Shown,
    /// Pictures are just being kept.
    snapping: Arc<AtomicBool>,
    places: Arc<Places>,
    /// Tells connections that last to end.
    stopped: watch::Receiver<()>,
    gate: Arc<Gate>,
    shelf: Arc<Shelf>,
}

impl Served {
    /// Until `stopped` says otherwise, or nobody is left who could.
    pub fn new(shown: Shown, stopped: watch::Receiver<()>) -> Self {
        let (places, gate, shelf) = (Arc::new(Places::new(places::PATIENCE)), Arc::default(), Arc::default());
        Self { shown, snapping: Arc::default(), places, stopped, gate, shelf }
    }

    /// Pages that rest for longer than that give way to newcomers.
    fn patient_for(self, patience: Duration) -> Self {
        Self { places: Arc::new(Places::new(patience)), ..self }
    }

    /// To those only who pass.
    fn behind(self, gate: Gate) -> Self {
        Self { gate: Arc::new(gate), ..self }
    }
}

/// Everything that there is to ask for.
pub fn routes(served: Served) -> Router {
    let routes = Router::new()
        .route("/", get(page::index))
        .route("/page/{name}", get(page::asset))
        .route("/v1/stream", get(stream::stream))
        .route("/v1/do", post(api::wish))
        .route("/v1/measure", post(api::measure))
        .route("/v1/pick", post(api::pick))
        .route("/v1/slices", post(api::slices))
        .route("/v1/account", get(api::account))
        .route("/v1/about", get(api::about))
        .route("/v1/settings", get(api::settings))
        .route("/v1/pictures/{name}", get(api::picture))
        .route("/v1/openapi.json", get(api::description))
        .route(gate::LOGIN, post(gate::login))
        .route("/status", get(status))
        .route("/metrics", get(prometheus))
        .route("/healthz", get(health))
        .fallback(nothing);
    guarded(routes, served)
}

/// Routes behind the doors that whoever asks must pass. The last one here is the first that is come to.
fn guarded(routes: Router<Served>, served: Served) -> Router {
    routes
        .layer(middleware::from_fn_with_state(served.clone(), gate::only_known))
        .layer(middleware::from_fn(origin::only_own_pages))
        .layer(middleware::from_fn_with_state(served.clone(), hosts::only_own_names))
        .layer(DefaultBodyLimit::max(origin::MOST_BODY))
        .layer(middleware::map_response(headed))
        .with_state(served)
}

async fn status(State(served): State<Served>) -> Response {
    let latest = &served.shown.latest;
    let told = latest.told();
    match serde_json::to_vec_pretty(&latest.statistics(&told)) {
        Ok(json) => ([(header::CONTENT_TYPE, "application/json")], json).into_response(),
        Err(error) => {
            (StatusCode::INTERNAL_SERVER_ERROR, format!("the status cannot be told: {error}\n")).into_response()
        }
    }
}

async fn prometheus(State(Served { shown, gate, .. }): State<Served>) -> Response {
    let latest = &shown.latest;
    let told = latest.told();
    let text = metrics::text(&latest.statistics(&told)) + &metrics::of_console(&gate.counts);
    ([(header::CONTENT_TYPE, "text/plain; version=0.0.4; charset=utf-8")], text).into_response()
}

async fn health(State(served): State<Served>) -> Response {
    let Told { at, still, .. } = served.shown.latest.told();
    let age = at.elapsed();
    if !still.is_empty() {
        return (StatusCode::SERVICE_UNAVAILABLE, format!("stands still: {}\n", still.join(", "))).into_response();
    }
    if age >= STALE {
        let sentence = format!("nothing was heard of the session for {:.0} s\n", age.as_secs_f64());
        return (StatusCode::SERVICE_UNAVAILABLE, sentence).into_response();
    }
    "moves\n".into_response()
}

async fn nothing() -> Response {
    (StatusCode::NOT_FOUND, "there is nothing here; ask for /, /status, /metrics or /healthz\n").into_response()
}

/// What holds for every answer: it is of this moment, no browser guesses what it is, and no page of others shows it or has it as its own.
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
