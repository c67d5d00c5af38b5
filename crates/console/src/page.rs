//! The page, compiled into the program: it needs no file, no download and no other server.

use axum::extract::Path;
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};

/// The page may use its own script, style and connection, and nothing else; no site may frame
/// it.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// The same for answers that are not the page: they may load nothing.
pub(super) const NOTHING: &str = "default-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// A file of the page.
struct Asset {
    name: &'static str,
    kind: &'static str,
    text: &'static str,
}

macro_rules! asset {
    ($name:literal, $kind:literal) => {
        Asset { name: $name, kind: $kind, text: include_str!(concat!("page/", $name)) }
    };
}

const INDEX: Asset = asset!("index.html", "text/html; charset=utf-8");
const LOGIN: Asset = asset!("login.html", "text/html; charset=utf-8");
const ASSETS: &[Asset] = &[
    asset!("account.js", "text/javascript; charset=utf-8"),
    asset!("banner.js", "text/javascript; charset=utf-8"),
    asset!("coach.js", "text/javascript; charset=utf-8"),
    asset!("commands.js", "text/javascript; charset=utf-8"),
    asset!("favicon.svg", "image/svg+xml"),
    asset!("figures.js", "text/javascript; charset=utf-8"),
    asset!("fit.js", "text/javascript; charset=utf-8"),
    asset!("hand.js", "text/javascript; charset=utf-8"),
    asset!("header.js", "text/javascript; charset=utf-8"),
    asset!("keys.js", "text/javascript; charset=utf-8"),
    asset!("known.js", "text/javascript; charset=utf-8"),
    asset!("levels.js", "text/javascript; charset=utf-8"),
    asset!("login.js", "text/javascript; charset=utf-8"),
    asset!("main.js", "text/javascript; charset=utf-8"),
    asset!("marks.js", "text/javascript; charset=utf-8"),
    asset!("measure.js", "text/javascript; charset=utf-8"),
    asset!("measurements.js", "text/javascript; charset=utf-8"),
    asset!("picture.js", "text/javascript; charset=utf-8"),
    asset!("plane.js", "text/javascript; charset=utf-8"),
    asset!("planes.css", "text/css; charset=utf-8"),
    asset!("planes.js", "text/javascript; charset=utf-8"),
    asset!("replay.js", "text/javascript; charset=utf-8"),
    asset!("sight.js", "text/javascript; charset=utf-8"),
    asset!("slice.js", "text/javascript; charset=utf-8"),
    asset!("space.js", "text/javascript; charset=utf-8"),
    asset!("stream.js", "text/javascript; charset=utf-8"),
    asset!("style.css", "text/css; charset=utf-8"),
    asset!("tone.js", "text/javascript; charset=utf-8"),
    asset!("troubles.js", "text/javascript; charset=utf-8"),
    asset!("view.js", "text/javascript; charset=utf-8"),
    asset!("words.js", "text/javascript; charset=utf-8"),
];

pub(super) async fn index() -> Response {
    INDEX.response()
}

/// Returns the login page.
pub(super) fn login() -> Response {
    (StatusCode::UNAUTHORIZED, LOGIN.response()).into_response()
}

pub(super) async fn asset(Path(name): Path<String>) -> Response {
    match ASSETS.iter().find(|asset| asset.name == name) {
        Some(asset) => asset.response(),
        None => (StatusCode::NOT_FOUND, "the page has no such file\n").into_response(),
    }
}

impl Asset {
    fn response(&self) -> Response {
        let headers = [
            (header::CONTENT_TYPE, HeaderValue::from_static(self.kind)),
            (header::CONTENT_SECURITY_POLICY, HeaderValue::from_static(POLICY)),
        ];
        (headers, self.text).into_response()
    }
}
