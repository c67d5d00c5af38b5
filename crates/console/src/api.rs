//! The console's HTTP interface for programs: the same commands and status that pages use.

use std::fmt::Display;
use std::sync::Arc;
use std::time::Duration;

use axum::extract::{Path, State};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use serde_json::{Value, json};
use tokio::sync::watch;
use tokio::time::timeout;

use glam::DVec3;

use measure::{Place, Request};

use super::encoded_frame::{EncodedFrame, Kind};
use super::message::ClientMessage;
use super::request_error::RequestError;
use super::served::Served;
use super::{snapshot, status};

/// Longest wait for a picture that no other client is viewing.
const PATIENCE: Duration = Duration::from_secs(2);
/// Key that tells whether the volume keeps standard errors.
const KEEPS_ERRORS: &str = "volume.standard_error";
/// Longest wait for the session's threads to answer a question.
const POINTING: Duration = Duration::from_secs(1);
/// The OpenAPI description of this interface.
const DESCRIPTION: &str = include_str!("openapi.json");

/// Executes the message in the request's body.
pub(super) async fn execute(State(served): State<Served>, body: String) -> Response {
    let message = match ClientMessage::parse(&body) {
        Ok(ClientMessage::Page(_)) => return refused(StatusCode::UNPROCESSABLE_ENTITY, &RequestError::PagesOnly),
        Ok(message) => message,
        Err(why) => return refused(StatusCode::UNPROCESSABLE_ENTITY, &why),
    };
    match message.execute(&served) {
        Ok(text) => {
            let text = text.unwrap_or_else(|| "the view has changed".into());
            json_response(StatusCode::OK, &json!({ "done": text }))
        }
        Err(why) => refused(StatusCode::CONFLICT, &why),
    }
}

fn refused(status: StatusCode, why: &(impl Display + ?Sized)) -> Response {
    json_response(status, &json!({ "refused": why.to_string() }))
}

fn json_response(status: StatusCode, value: &Value) -> Response {
    (status, [(header::CONTENT_TYPE, "application/json")], value.to_string()).into_response()
}

/// Returns a measurement between places.
pub(super) async fn measure(State(served): State<Served>, body: String) -> Response {
    let mut request: Request = match serde_json::from_str(&body) {
        Ok(request) => request,
        Err(error) => {
            return refused(StatusCode::UNPROCESSABLE_ENTITY, &format!("this measurement is invalid: {error}"));
        }
    };
    if let Err(why) = request.check() {
        return refused(StatusCode::UNPROCESSABLE_ENTITY, &why.to_string());
    }
    find_edges(&served, &mut request).await;
    let (basis, slices) = (served.session.latest.report().basis, Arc::clone(&served.session.slices));
    // Many places among many slices take a while.
    let measured = tokio::task::spawn_blocking(move || measure::measure(&request, &basis.uncertainty, &slices)).await;
    match measured {
        Ok(Ok(measured)) => json_response(StatusCode::OK, &json!(measured)),
        Ok(Err(why)) => refused(StatusCode::UNPROCESSABLE_ENTITY, &why.to_string()),
        Err(error) => refused(StatusCode::INTERNAL_SERVER_ERROR, &error.to_string()),
    }
}

/// Finds the edges at a measurement's places, if the session keeps standard errors.
async fn find_edges(served: &Served, request: &mut Request) {
    let report = served.session.latest.report();
    let keeps_errors = report.basis.config.get(KEEPS_ERRORS).is_some_and(|key| key.as_bool() == Some(true));
    if !keeps_errors || report.ended {
        return;
    }
    let places = request.places().map(|place| DVec3::from_array(place.point)).collect();
    // Without an answer, the measurement does not know the noise.
    if let Ok(Ok(edges)) = timeout(POINTING, served.session.broadcaster.edges(places)).await {
        request.places_mut().zip(edges).for_each(|(place, edge)| place.edge = edge);
    }
}

/// A point of the volume's picture: fraction of the width from the left, of the height from the
/// top.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Pointed {
    at: [f64; 2],
}

/// Returns the place that is visible at a point of the picture. Renders a picture for this
/// request if no other client is viewing.
pub(super) async fn pick(State(served): State<Served>, body: String) -> Response {
    let broadcaster = &served.session.broadcaster;
    let request = serde_json::from_str::<Pointed>(&body)
        .map_err(|error| format!("this is not a point of the picture: {error}"))
        .and_then(|Pointed { at }| broadcaster.pick(at).map_err(|why| why.to_string()));
    let answer = match request {
        Ok(answer) => answer,
        Err(why) => return refused(StatusCode::UNPROCESSABLE_ENTITY, &why),
    };
    let subscribe_briefly = broadcaster.subscribe_briefly(Kind::View);
    let answer = timeout(POINTING, answer).await;
    drop(subscribe_briefly);
    match answer {
        Ok(Ok(Ok(picked))) => json_response(StatusCode::OK, &json!(Place::from(picked))),
        Ok(Ok(Err(why))) => refused(StatusCode::UNPROCESSABLE_ENTITY, &why),
        Ok(Err(_)) | Err(_) => {
            refused(StatusCode::SERVICE_UNAVAILABLE, "the picture is still being drawn: point at it again in a moment")
        }
    }
}

/// A place in world coordinates, mm.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct At {
    at: [f64; 3],
}

/// Returns the slices that contributed to a place.
pub(super) async fn slices(State(served): State<Served>, body: String) -> Response {
    let found = serde_json::from_str::<At>(&body)
        .map_err(|error| format!("this is not a point of the world: {error}"))
        .and_then(|At { at }| served.session.slices.of(at).map_err(|error| error.to_string()));
    match found {
        Ok(found) => json_response(StatusCode::OK, &json!(found)),
        Err(why) => refused(StatusCode::UNPROCESSABLE_ENTITY, &why),
    }
}

/// Returns the settings with which a recording can be replayed.
pub(super) async fn settings(State(served): State<Served>) -> Response {
    match served.session.controller.replayed() {
        Some(replayed) => json_response(StatusCode::OK, &json!({ "settings": replayed.settings() })),
        None => refused(StatusCode::NOT_FOUND, "this session is live; run a recorded one with other settings"),
    }
}

/// Returns the present session status, without rates, which need two readings.
pub(super) async fn account(State(served): State<Served>) -> Response {
    let mut account = status::PagePublisher::default().status(&served);
    if let Some(account) = account["account"].as_object_mut() {
        account.remove("rates");
    }
    json_response(StatusCode::OK, &account["account"])
}

/// Returns the facts that do not change while the session runs.
pub(super) async fn about(State(served): State<Served>) -> Response {
    json_response(StatusCode::OK, &status::about(&served)["about"])
}

/// Returns the newest picture of a kind. Renders it for this request if no other client is
/// viewing.
pub(super) async fn picture(State(served): State<Served>, Path(name): Path<String>) -> Response {
    let kind = match name.as_str() {
        "slice.png" => Kind::Slice,
        "view.png" => Kind::View,
        "across-z.png" => Kind::AcrossZ,
        "across-y.png" => Kind::AcrossY,
        "across-x.png" => Kind::AcrossX,
        "free.png" => Kind::Free,
        _ => {
            return refused(
                StatusCode::NOT_FOUND,
                "this picture is unknown; ask for slice, view, across-z, across-y, across-x or free.png",
            );
        }
    };
    let mut subscribe_briefly = served.session.broadcaster.subscribe_briefly(kind);
    // A picture rendered before this request may be old.
    subscribe_briefly.pictures.mark_unchanged();
    let newest = match timeout(PATIENCE, next(&mut subscribe_briefly.pictures)).await {
        Ok(shot) => shot,
        Err(_) => served.session.broadcaster.newest(kind),
    };
    drop(subscribe_briefly);
    let Some(shot) = newest else {
        return refused(StatusCode::NOT_FOUND, "there is no such picture yet; wait for the first slices");
    };
    match tokio::task::spawn_blocking(move || snapshot::png(&shot)).await {
        Ok(Ok(bytes)) => ([(header::CONTENT_TYPE, "image/png")], bytes).into_response(),
        Ok(Err(why)) => refused(StatusCode::INTERNAL_SERVER_ERROR, &why),
        Err(error) => refused(StatusCode::INTERNAL_SERVER_ERROR, &error.to_string()),
    }
}

async fn next(pictures: &mut watch::Receiver<Option<Arc<EncodedFrame>>>) -> Option<Arc<EncodedFrame>> {
    pictures.changed().await.ok()?;
    pictures.borrow_and_update().clone()
}

/// Returns the OpenAPI description, from which programs can generate clients.
pub(super) async fn description() -> Response {
    ([(header::CONTENT_TYPE, "application/json")], DESCRIPTION).into_response()
}
