//! Authentication: if a token is configured, admits requests with it, or browsers that have
//! shown it.
//!
//! Programs send the token with every request (`Authorization: Bearer …`). A browser that
//! requests the page without it receives the login page (`page/login.html`). In exchange for
//! the token (`POST /v1/login`) the browser receives a cookie. No script can read this cookie,
//! it goes to this server only, and it expires with the session. Wrong tokens are counted and
//! logged. After some wrong tokens, the server ignores tokens from that address for a while.
//!
//! A second token, if configured, gives the metrics only: a server that watches many sessions
//! sees no images and steers none.

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

use super::connection_info::ConnectionInfo;
use super::counts::Counts;
use super::page;
use super::token::{Attempts, Browsers, Token, bearer, cookies};

/// Path at which a browser exchanges the token for a cookie.
pub(super) const LOGIN: &str = "/v1/login";
/// Path of the metrics, for which their own token suffices.
pub(super) const METRICS: &str = "/metrics";
/// Files of the login page; they reveal nothing about the session.
const OPEN: [&str; 4] = [LOGIN, "/page/login.js", "/page/style.css", "/page/favicon.svg"];

/// Decides which requests are admitted, and holds the names of this machine.
#[derive(Debug)]
pub(super) struct Gate {
    /// `None` admits every request.
    token: Option<Token>,
    /// Gives the metrics only.
    metrics_token: Option<Token>,
    /// Accepted host names, besides the addresses at which connections arrive.
    pub(super) names: Vec<String>,
    /// Whether connections are encrypted by TLS.
    secured: bool,
    /// Cookie name, with the port: cookies belong to a host whatever the port, so two sessions
    /// need two.
    cookie: String,
    attempts: Mutex<Attempts>,
    browsers: Mutex<Browsers>,
    pub(super) counts: Arc<Counts>,
}

impl Default for Gate {
    fn default() -> Self {
        Self::new(None, None, Vec::new(), false, 0)
    }
}

/// Result of checking a token.
enum TokenCheck {
    Right,
    Wrong,
    TooOften(Duration),
}

impl Gate {
    pub(super) fn new(
        token: Option<Token>,
        metrics_token: Option<Token>,
        names: Vec<String>,
        secured: bool,
        port: u16,
    ) -> Self {
        // Browsers accept a `__Host-` cookie only if no other host can have set it.
        let prefix = if secured { "__Host-" } else { "" };
        let cookie = format!("{prefix}sonoweave-{port}");
        let (attempts, browsers, counts) = Default::default();
        Self { token, metrics_token, names, secured, cookie, attempts, browsers, counts }
    }

    fn is_known(&self, headers: &HeaderMap) -> bool {
        let sent = headers.get_all(header::COOKIE).iter().filter_map(|value| value.to_str().ok());
        let mut ids = sent.flat_map(|cookie| cookies(cookie, &self.cookie));
        let browsers = self.browsers.lock().unwrap_or_else(PoisonError::into_inner);
        ids.any(|id| browsers.knows(id))
    }

    /// Compares with the token, and with `other` if there is one.
    fn check(&self, token: &Token, other: Option<&Token>, sent: &str, from: IpAddr) -> TokenCheck {
        let mut attempts = self.attempts.lock().unwrap_or_else(PoisonError::into_inner);
        let now = Instant::now();
        if let Some(wait) = attempts.waits(from, now) {
            Counts::add(&self.counts.tokens_unchecked);
            return TokenCheck::TooOften(wait);
        }
        if token.is(sent) | other.is_some_and(|other| other.is(sent)) {
            return TokenCheck::Right;
        }
        attempts.failed(from, now);
        Counts::add(&self.counts.tokens_wrong);
        tracing::warn!(
            "console: {from} has sent a wrong token; if you do not know this address, check which machines can reach \
            this port"
        );
        TokenCheck::Wrong
    }

    /// Creates the cookie for a browser that has shown the token.
    fn admit(&self) -> Option<HeaderValue> {
        let chance: &dyn SecureRandom = ring::default_provider().secure_random;
        let id = self.browsers.lock().unwrap_or_else(PoisonError::into_inner).admit(chance)?;
        let secure = if self.secured { "; Secure" } else { "" };
        format!("{}={id}; Path=/; HttpOnly; SameSite=Strict{secure}", self.cookie).parse().ok()
    }
}

/// Admits only requests with the token, if one is configured.
pub(super) async fn only_known(State(gate): State<Arc<Gate>>, request: Request, next: Next) -> Response {
    let Some(token) = &gate.token else { return next.run(request).await };
    if OPEN.contains(&request.uri().path()) || gate.is_known(request.headers()) {
        return next.run(request).await;
    }
    let sent = request.headers().get(header::AUTHORIZATION).and_then(|sent| bearer(sent.to_str().ok()?));
    let metrics_token = gate.metrics_token.as_ref().filter(|_| request.uri().path() == METRICS);
    match sent.map(|sent| gate.check(token, metrics_token, sent, peer(request.extensions()))) {
        Some(TokenCheck::Right) => next.run(request).await,
        Some(TokenCheck::TooOften(wait)) => too_often(wait),
        None if request.uri().path() == "/" && matches!(*request.method(), Method::GET | Method::HEAD) => page::login(),
        _ => {
            let sentence = "this request needs the session's token: send it as `Authorization: Bearer …`, or open / in a \
                browser\n";
            (StatusCode::UNAUTHORIZED, [(header::WWW_AUTHENTICATE, "Bearer")], sentence).into_response()
        }
    }
}

/// Body of the login page's request.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Login {
    token: String,
}

/// Exchanges a token for a cookie.
pub(super) async fn login(State(gate): State<Arc<Gate>>, extensions: Extensions, body: Bytes) -> Response {
    let Some(token) = &gate.token else {
        return (StatusCode::NOT_FOUND, "this session has no token; none is needed\n").into_response();
    };
    let Ok(Login { token: sent }) = serde_json::from_slice(&body) else {
        return (StatusCode::BAD_REQUEST, "send the token as {\"token\": \"…\"}\n").into_response();
    };
    match gate.check(token, None, sent.trim(), peer(&extensions)) {
        TokenCheck::Right => match gate.admit() {
            Some(cookie) => (StatusCode::NO_CONTENT, [(header::SET_COOKIE, cookie)]).into_response(),
            None => {
                (StatusCode::INTERNAL_SERVER_ERROR, "the machine's random numbers are not available\n").into_response()
            }
        },
        TokenCheck::Wrong => (StatusCode::UNAUTHORIZED, "this is not the session's token\n").into_response(),
        TokenCheck::TooOften(wait) => too_often(wait),
    }
}

fn too_often(wait: Duration) -> Response {
    let seconds = wait.as_secs() + 1;
    let sentence = format!("too many wrong tokens came from this address; try again in {seconds} s\n");
    (StatusCode::TOO_MANY_REQUESTS, [(header::RETRY_AFTER, seconds.to_string())], sentence).into_response()
}

/// Returns the client's address; unspecified for requests without a socket.
fn peer(extensions: &Extensions) -> IpAddr {
    extensions.get::<ConnectionInfo>().map_or(Ipv4Addr::UNSPECIFIED.into(), |line| line.peer.ip())
}
