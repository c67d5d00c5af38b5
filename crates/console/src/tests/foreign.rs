//! Actions refused to other sites' pages.

use super::*;

/// The server's checks, with routes of this test's own.
fn done(request: Request<Body>) -> (StatusCode, String) {
    let moves = |body: axum::body::Bytes| async move { format!("moved by {} bytes", body.len()) };
    let own = Router::new().route("/v1/move", post(moves)).route("/v1/look", get(|| async { "looked" }));
    let runtime = tokio::runtime::Builder::new_current_thread().build().unwrap();
    runtime.block_on(async {
        let service = TowerToHyperService::new(guarded(own, served(&session())));
        let response = service.call(request).await.unwrap();
        for (name, value) in [
            ("x-content-type-options", "nosniff"),
            ("referrer-policy", "no-referrer"),
            ("cross-origin-resource-policy", "same-origin"),
            ("content-security-policy", page::NOTHING),
            ("cache-control", "no-store"),
        ] {
            assert_eq!(response.headers()[name], value);
        }
        let (head, body) = response.into_parts();
        let body = to_bytes(body, usize::MAX).await.unwrap();
        (head.status, String::from_utf8(body.to_vec()).unwrap())
    })
}

fn moves(headers: &[(&str, &str)], body: impl Into<Body>) -> (StatusCode, String) {
    let mut request = Request::post("/v1/move").header("host", "localhost:9110");
    for (name, value) in headers {
        request = request.header(*name, *value);
    }
    done(request.body(body.into()).unwrap())
}

const JSON: (&str, &str) = ("content-type", "application/json");
const LENGTH: (&str, &str) = ("content-length", "2");

#[test]
fn only_own_pages_and_programs_may_act() {
    let own = ("origin", "http://localhost:9110");
    for headers in [
        &[JSON, LENGTH][..],
        &[JSON, LENGTH, own],
        &[JSON, LENGTH, own, ("sec-fetch-site", "same-origin")],
        &[("content-type", "application/json; charset=utf-8"), LENGTH, ("sec-fetch-site", "none")],
    ] {
        assert_eq!(moves(headers, "{}"), (StatusCode::OK, "moved by 2 bytes".into()), "{headers:?}");
    }
    // An empty body needs no content type.
    assert_eq!(moves(&[own], ""), (StatusCode::OK, "moved by 0 bytes".into()));
    assert_eq!(moves(&[("content-length", "0")], ""), (StatusCode::OK, "moved by 0 bytes".into()));
    for headers in [
        &[JSON, LENGTH, ("origin", "http://example.org")][..],
        &[JSON, LENGTH, ("origin", "null")],
        &[JSON, LENGTH, ("origin", "http://localhost:8080")],
        &[JSON, LENGTH, own, ("sec-fetch-site", "cross-site")],
        &[JSON, LENGTH, ("sec-fetch-site", "same-site")],
        &[("origin", "http://example.org")],
    ] {
        let (code, sentence) = moves(headers, "{}");
        assert_eq!(
            (code, sentence.as_str()),
            (StatusCode::FORBIDDEN, "only this server's own pages may send this request\n"),
            "{headers:?}"
        );
    }
    // Content types that a form of another site can send, if its browser sends no origin.
    for kind in
        ["text/plain", "application/x-www-form-urlencoded", "multipart/form-data", "text/plain; application/json", ""]
    {
        for length in [LENGTH, ("transfer-encoding", "chunked")] {
            let (code, sentence) = moves(&[("content-type", kind), length], "{}");
            assert_eq!(code, StatusCode::UNSUPPORTED_MEDIA_TYPE, "{kind} {length:?}");
            assert!(sentence.contains("application/json"), "{sentence}");
        }
    }
    assert_eq!(moves(&[LENGTH], "{}").0, StatusCode::UNSUPPORTED_MEDIA_TYPE);
    // Reading is not refused: other sites' pages cannot see the answer, and the host name is
    // always checked.
    let read_request = |host| Request::get("/v1/look").header("host", host).header("origin", "http://example.org");
    assert_eq!(done(read_request("localhost").body(Body::empty()).unwrap()), (StatusCode::OK, "looked".into()));
    assert_eq!(done(read_request("example.org").body(Body::empty()).unwrap()).0, StatusCode::FORBIDDEN);
    // A long-lived connection is more than reading.
    let stays = read_request("localhost").header("upgrade", "websocket").body(Body::empty()).unwrap();
    assert_eq!(done(stays).0, StatusCode::FORBIDDEN);
    for method in ["PUT", "DELETE", "PATCH", "OPTIONS"] {
        let request = Request::builder().method(method).uri("/v1/look").header("host", "localhost");
        let requested = |site| done(request_with(&request, "sec-fetch-site", site));
        assert_eq!(requested("cross-site").0, StatusCode::FORBIDDEN, "{method}");
        assert_eq!(requested("same-origin").0, StatusCode::METHOD_NOT_ALLOWED, "{method}");
    }
}

fn request_with(builder: &axum::http::request::Builder, name: &str, value: &str) -> Request<Body> {
    let mut request = Request::builder().method(builder.method_ref().unwrap()).uri(builder.uri_ref().unwrap());
    for (name, value) in builder.headers_ref().unwrap() {
        request = request.header(name, value);
    }
    request.header(name, value).body(Body::empty()).unwrap()
}

#[test]
fn body_over_64_kib_is_refused_with_or_without_length() {
    let body = |n: usize| "1".repeat(n);
    let (reported, without_host) = (|n: usize| n.to_string(), ("transfer-encoding", "chunked"));
    let most = origin::MOST_BODY;
    assert_eq!(moves(&[JSON, ("content-length", &reported(most))], body(most)).0, StatusCode::OK);
    assert_eq!(
        moves(&[JSON, ("content-length", &reported(most + 1))], body(most + 1)).0,
        StatusCode::PAYLOAD_TOO_LARGE
    );
    assert_eq!(
        moves(&[JSON, ("content-length", "99999999999999999999999")], "{}").0,
        StatusCode::OK,
        "hyper looks at that"
    );
    assert_eq!(moves(&[JSON, without_host], body(most)).0, StatusCode::OK);
    assert_eq!(moves(&[JSON, without_host], body(most + 1)).0, StatusCode::PAYLOAD_TOO_LARGE);
}
