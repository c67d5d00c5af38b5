//! The routes, and the checks that every request passes.

use axum::extract::{DefaultBodyLimit, State};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use axum::{Router, middleware};

use super::latest::{Report, STALE};
use super::served::Served;
use super::{access, api, hosts, metrics, origin, page, stream};

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
        .route(access::METRICS, get(prometheus))
        .route("/healthz", get(health))
        .fallback(nothing);
    guarded(routes, served)
}

/// Adds the checks that every request passes. The layer added last runs first.
pub(super) fn guarded(routes: Router<Served>, served: Served) -> Router {
    routes
        .layer(middleware::from_fn_with_state(served.gate.clone(), access::only_known))
        .layer(middleware::from_fn(origin::only_own_pages))
        .layer(middleware::from_fn_with_state(served.gate.clone(), hosts::only_own_names))
        .layer(DefaultBodyLimit::max(origin::MOST_BODY))
        .layer(middleware::map_response(headed))
        .with_state(served)
}

async fn status(State(served): State<Served>) -> Response {
    let latest = &served.session.latest;
    let report = latest.report();
    match serde_json::to_vec_pretty(&latest.statistics(&report)) {
        Ok(json) => ([(header::CONTENT_TYPE, "application/json")], json).into_response(),
        Err(error) => {
            (StatusCode::INTERNAL_SERVER_ERROR, format!("the status cannot be written: {error}\n")).into_response()
        }
    }
}

async fn prometheus(State(Served { session, gate, .. }): State<Served>) -> Response {
    let latest = &session.latest;
    let report = latest.report();
    let facts = metrics::Facts {
        basis: &report.basis,
        frame_age_s: latest.frame_age_s(&report),
        is_recorded: session.controller.status().records,
    };
    let text = metrics::text(&latest.statistics(&report), &facts) + &metrics::of_console(&gate.counts);
    ([(header::CONTENT_TYPE, "text/plain; version=0.0.4; charset=utf-8")], text).into_response()
}

async fn health(State(served): State<Served>) -> Response {
    let Report { at, still, .. } = served.session.latest.report();
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
