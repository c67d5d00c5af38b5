//! The page, compiled into the program: it needs no file, no download and no other server.

use axum::extract::Path;
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use include_dir::{Dir, include_dir};

/// The page may use its own script, style and connection, and nothing else; no site may frame
/// it.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// The same for answers that are not the page: they may load nothing.
pub(super) const NOTHING: &str = "default-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// The files of the page.
static FILES: Dir<'static> = include_dir!("$CARGO_MANIFEST_DIR/src/page");

pub(super) async fn index() -> Response {
    file("index.html")
}

/// Returns the login page.
pub(super) fn login() -> Response {
    (StatusCode::UNAUTHORIZED, file("login.html")).into_response()
}

pub(super) async fn asset(Path(name): Path<String>) -> Response {
    // The two documents have addresses of their own.
    if name.ends_with(".html") { missing() } else { file(&name) }
}

fn file(name: &str) -> Response {
    let kind = match name.rsplit_once('.') {
        Some((_, "css")) => "text/css; charset=utf-8",
        Some((_, "html")) => "text/html; charset=utf-8",
        Some((_, "js")) => "text/javascript; charset=utf-8",
        Some((_, "svg")) => "image/svg+xml",
        _ => return missing(),
    };
    let Some(file) = FILES.get_file(name) else { return missing() };
    let headers = [
        (header::CONTENT_TYPE, HeaderValue::from_static(kind)),
        (header::CONTENT_SECURITY_POLICY, HeaderValue::from_static(POLICY)),
    ];
    (headers, file.contents()).into_response()
}

fn missing() -> Response {
    (StatusCode::NOT_FOUND, "the page has no such file\n").into_response()
}
