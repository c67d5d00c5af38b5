//! Who is let in: where a token is configured, whoever has it, or a browser that has shown it.
//!
//! Programs say it with every request (`Authorization: Bearer …`). A browser that asks for the page without it gets one that asks for it (`page/login.html`), and for the token
//! (`POST /v1/login`) a cookie, which no script can read, which goes to this server only, and which ends with the session. Wrong tokens are counted and told in the log, and an
//! address that has shown some is not listened to for a while.

use std::net::{IpAddr, Ipv4Addr};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use axum::body::Bytes;
use axum::extract::{Request, State};
use axum::http::{Extensions, HeaderMap, HeaderValue, Method, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use tokio_rustls::rustls::crypto::{SecureRandom, ring};

use super::counts::Counts;
use super::server::Line;
use super::token::{Attempts, Browsers, Token, bearer, cookies};
use super::{Served, page};

/// Where a token is exchanged for a cookie.
pub(super) const LOGIN: &str = "/v1/login";
/// What the page that asks for it consists of: it says nothing of the session.
const OPEN: [&str; 4] = [LOGIN, "/page/login.js", "/page/style.css", "/page/favicon.svg"];

/// By what is decided who is let in, and by which names this machine is called.
#[derive(Debug)]
pub(super) struct Gate {
    /// Nobody is asked for one where it is none.
    token: Option<Token>,
    /// Names beside the addresses that connections come in at.
    pub(super) names: Vec<String>,
    /// Whether what is said is kept from others by TLS.
    secured: bool,
    /// Cookies are of a machine, whatever the port: two sessions have two.
    cookie: String,
    attempts: Mutex<Attempts>,
    browsers: Mutex<Browsers>,
    pub(super) counts: Arc<Counts>,
}

impl Default for Gate {
    fn default() -> Self {
        Self::new(None, Vec::new(), false, 0)
    }
}

/// What becomes of a token that is shown.
enum Shown {
    Right,
    Wrong,
    TooOften(Duration),
}

impl Gate {
    pub(super) fn new(token: Option<Token>, names: Vec<String>, secured: bool, port: u16) -> Self {
        // A browser takes a cookie of such a name only if nobody else can have made it.
        let prefix = if secured { "__Host-" } else { "" };
        let cookie = format!("{prefix}sonoweave-{port}");
        let (attempts, browsers, counts) = Default::default();
        Self { token, names, secured, cookie, attempts, browsers, counts }
    }

    fn is_known(&self, headers: &HeaderMap) -> bool {
        let told = headers.get_all(header::COOKIE).iter().filter_map(|value| value.to_str().ok());
        let mut ids = told.flat_map(|cookie| cookies(cookie, &self.cookie));
        let browsers = self.browsers.lock().unwrap_or_else(PoisonError::into_inner);
        ids.any(|id| browsers.knows(id))
    }

    fn show(&self, token: &Token, told: &str, from: IpAddr) -> Shown {
        let mut attempts = self.attempts.lock().unwrap_or_else(PoisonError::into_inner);
        let now = Instant::now();
        if let Some(wait) = attempts.waits(from, now) {
            Counts::add(&self.counts.tokens_unheard);
            return Shown::TooOften(wait);
        }
        if token.is(told) {
            return Shown::Right;
        }
        attempts.failed(from, now);
        Counts::add(&self.counts.tokens_wrong);
        tracing::warn!(
            "console: {from} has shown a wrong token; if that is nobody you know, look who can reach this address"
        );
        Shown::Wrong
    }

    /// What a browser keeps that has shown the token.
    fn admit(&self) -> Option<HeaderValue> {
        let chance: &dyn SecureRandom = ring::default_provider().secure_random;
        let id = self.browsers.lock().unwrap_or_else(PoisonError::into_inner).admit(chance)?;
        let secure = if self.secured { "; Secure" } else { "" };
        format!("{}={id}; Path=/; HttpOnly; SameSite=Strict{secure}", self.cookie).parse().ok()
    }
}

/// Lets those pass who have the token, where there is one.
pub(super) async fn only_known(State(served): State<Served>, request: Request, next: Next) -> Response {
    let gate = &served.gate;
    let Some(token) = &gate.token else { return next.run(request).await };
    if OPEN.contains(&request.uri().path()) || gate.is_known(request.headers()) {
        return next.run(request).await;
    }
    let told = request.headers().get(header::AUTHORIZATION).and_then(|told| bearer(told.to_str().ok()?));
    match told.map(|told| gate.show(token, told, peer(request.extensions()))) {
        Some(Shown::Right) => next.run(request).await,
        Some(Shown::TooOften(wait)) => too_often(wait),
        None if request.uri().path() == "/" && matches!(*request.method(), Method::GET | Method::HEAD) => page::login(),
        _ => {
            let sentence =
                "this needs the session's token: say it as `Authorization: Bearer …`, or open / in a browser\n";
            (StatusCode::UNAUTHORIZED, [(header::WWW_AUTHENTICATE, "Bearer")], sentence).into_response()
        }
    }
}

/// What the page that asks for it sends.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Login {
    token: String,
}

/// A token for a cookie.
pub(super) async fn login(State(served): State<Served>, extensions: Extensions, body: Bytes) -> Response {
    let gate = &served.gate;
    let Some(token) = &gate.token else {
        return (StatusCode::NOT_FOUND, "nobody is asked for a token here\n").into_response();
    };
    let Ok(Login { token: told }) = serde_json::from_slice(&body) else {
        return (StatusCode::BAD_REQUEST, "a token is shown as {\"token\": \"…\"}\n").into_response();
    };
    match gate.show(token, told.trim(), peer(&extensions)) {
        Shown::Right => match gate.admit() {
            Some(cookie) => (StatusCode::NO_CONTENT, [(header::SET_COOKIE, cookie)]).into_response(),
            None => (StatusCode::INTERNAL_SERVER_ERROR, "this machine gives no random numbers\n").into_response(),
        },
        Shown::Wrong => (StatusCode::UNAUTHORIZED, "this is not the session's token\n").into_response(),
        Shown::TooOften(wait) => too_often(wait),
    }
}

fn too_often(wait: Duration) -> Response {
    let seconds = wait.as_secs() + 1;
    let sentence = format!("too many wrong tokens came from this address; try again in {seconds} s\n");
    (StatusCode::TOO_MANY_REQUESTS, [(header::RETRY_AFTER, seconds.to_string())], sentence).into_response()
}

/// Who asks, where it is a machine.
fn peer(extensions: &Extensions) -> IpAddr {
    extensions.get::<Line>().map_or(Ipv4Addr::UNSPECIFIED.into(), |line| line.peer.ip())
}
