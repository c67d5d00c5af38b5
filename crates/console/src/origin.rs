//! Cross-site protection: only this server's own pages, and programs that are not browsers, may
//! change anything.
//!
//! A browser also sends requests on behalf of other sites' pages, with the user's cookies.
//! `Origin` names the requesting page, and `Sec-Fetch-Site` says whether it is of the same
//! site. Requests that do more than read are refused to other sites: the page's own connection,
//! and all methods but GET and HEAD. Their bodies must be JSON, which no form of another site
//! can send, and small. tower-http's `csrf` admits every GET, and so foreign WebSockets.

use axum::RequestExt as _;
use axum::extract::Request;
use axum::http::{HeaderMap, HeaderName, Method, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

use super::connection_info::ConnectionInfo;

/// Largest request body, bytes.
pub(super) const MOST_BODY: usize = 64 << 10;

const FETCH_SITE: HeaderName = HeaderName::from_static("sec-fetch-site");

/// Refuses requests from other sites' pages, and bodies that are too long or not JSON.
pub(super) async fn only_own_pages(request: Request, next: Next) -> Response {
    let headers = request.headers();
    let only_reads = matches!(*request.method(), Method::GET | Method::HEAD) && !headers.contains_key(header::UPGRADE);
    if only_reads {
        return next.run(request).await;
    }
    let secured = request.extensions().get::<ConnectionInfo>().is_some_and(|line| line.secured);
    if !comes_from_own(headers, secured) {
        return (StatusCode::FORBIDDEN, "only this server's own pages may send this request\n").into_response();
    }
    let length = text(headers, &header::CONTENT_LENGTH).map(|length| length.parse::<u64>());
    let has_body = headers.contains_key(header::TRANSFER_ENCODING) || length.as_ref().is_some_and(|n| *n != Ok(0));
    if length.is_some_and(|length| length.is_ok_and(|length| length > MOST_BODY as u64)) {
        let sentence = format!("the request is too large; the limit is {MOST_BODY} bytes\n");
        return (StatusCode::PAYLOAD_TOO_LARGE, sentence).into_response();
    }
    if has_body && !text(headers, &header::CONTENT_TYPE).is_some_and(is_json) {
        let sentence = "the request's body must be JSON; send content-type: application/json\n";
        return (StatusCode::UNSUPPORTED_MEDIA_TYPE, sentence).into_response();
    }
    next.run(request.with_limited_body()).await
}

/// Whether a request with these headers comes from a page of this server, or from no page.
fn comes_from_own(headers: &HeaderMap, secured: bool) -> bool {
    // A header given twice is contradictory.
    let is_repeated = |name: &HeaderName| headers.get_all(name).iter().nth(1).is_some();
    if [header::ORIGIN, header::HOST, FETCH_SITE].iter().any(is_repeated) {
        return false;
    }
    is_own(text(headers, &header::ORIGIN), text(headers, &header::HOST), text(headers, &FETCH_SITE), secured)
}

/// Whether a request with these headers (`None` if absent) comes from a page of this server, or
/// from no page. `secured`: this server speaks TLS.
pub fn is_own(origin: Option<&str>, host: Option<&str>, site: Option<&str>, secured: bool) -> bool {
    let same = match (origin, host) {
        (None, _) => true,
        (Some(origin), Some(host)) => origin.split_once("://").is_some_and(|(scheme, own)| {
            let scheme_is_fine = scheme == "https" || scheme == "http" && !secured;
            scheme_is_fine && !own.is_empty() && own.eq_ignore_ascii_case(host)
        }),
        (Some(_), None) => false,
    };
    same && site.is_none_or(|site| matches!(site, "same-origin" | "none"))
}

/// Returns a header's text; empty if it is not text.
fn text<'h>(headers: &'h HeaderMap, name: &HeaderName) -> Option<&'h str> {
    headers.get(name).map(|value| value.to_str().unwrap_or_default())
}

/// Whether a content type is JSON, with any parameters.
pub fn is_json(kind: &str) -> bool {
    kind.split(';').next().is_some_and(|kind| kind.trim().eq_ignore_ascii_case("application/json"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn headers_of(pairs: &[(&'static str, &'static str)]) -> HeaderMap {
        let mut headers = HeaderMap::new();
        for (name, value) in pairs {
            headers.append(*name, value.parse().unwrap());
        }
        headers
    }

    #[test]
    fn own_pages_and_programs_are_distinguished_from_foreign_pages() {
        let host = ("host", "localhost:9110");
        for own in [
            &[host][..],
            &[host, ("origin", "http://localhost:9110")],
            &[host, ("origin", "https://LOCALHOST:9110"), ("sec-fetch-site", "same-origin")],
            &[host, ("sec-fetch-site", "none")],
        ] {
            assert!(comes_from_own(&headers_of(own), false), "{own:?}");
        }
        for foreign in [
            &[host, ("origin", "http://example.org")][..],
            &[host, ("origin", "null")],
            &[host, ("origin", "http://localhost")],
            &[host, ("origin", "http://localhost:9111")],
            &[host, ("origin", "ftp://localhost:9110")],
            &[host, ("origin", "http://localhost:9110"), ("sec-fetch-site", "cross-site")],
            &[host, ("sec-fetch-site", "same-site")],
            &[host, ("origin", "http://localhost:9110"), ("origin", "http://example.org")],
            &[("host", ""), ("origin", "http://")],
            &[("origin", "http://localhost:9110")],
        ] {
            assert!(!comes_from_own(&headers_of(foreign), false), "{foreign:?}");
        }
        assert!(
            !comes_from_own(&headers_of(&[host, ("origin", "http://localhost:9110")]), true),
            "not by TLS, as this server is"
        );
        assert!(comes_from_own(&headers_of(&[host, ("origin", "https://localhost:9110")]), true));
        assert!(is_json("application/json") && is_json("Application/JSON ; charset=utf-8"));
        assert!(!is_json("text/plain") && !is_json("text/plain;application/json") && !is_json(""));
    }
}
