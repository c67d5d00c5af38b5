//! The console's HTTP interface for programs: the same commands and status that pages use.

use std::sync::Arc;
use std::time::Duration;

use axum::extract::{Path, State};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use serde_json::{Value, json};
use tokio::sync::watch;
use tokio::time::timeout;

use measure::Place;

use super::encoded_frame::{EncodedFrame, Kind};
use super::message::{ClientMessage, ONLY_PAGES};
use super::served::Served;
use super::{snapshot, status};

/// Longest wait for a picture that no other client is viewing.
const PATIENCE: Duration = Duration::from_secs(2);
/// Longest wait for the render thread to answer a pick.
const POINTING: Duration = Duration::from_secs(1);
/// The OpenAPI description of this interface.
const DESCRIPTION: &str = include_str!("openapi.json");

/// Executes the message in the request's body.
pub(super) async fn execute(State(served): State<Served>, body: String) -> Response {
    let message = match ClientMessage::parse(&body) {
        Ok(ClientMessage::Page(_)) => return refused(StatusCode::UNPROCESSABLE_ENTITY, ONLY_PAGES),
        Ok(message) => message,
        Err(why) => return refused(StatusCode::UNPROCESSABLE_ENTITY, &why),
    };
    match message.execute(&served) {
        Ok(says) => {
            let says = says.unwrap_or_else(|| "the view has changed".into());
            told(StatusCode::OK, &json!({ "done": says }))
        }
        Err(why) => refused(StatusCode::CONFLICT, &why),
    }
}

fn refused(status: StatusCode, why: &str) -> Response {
    told(status, &json!({ "refused": why }))
}

fn told(status: StatusCode, value: &Value) -> Response {
    (status, [(header::CONTENT_TYPE, "application/json")], value.to_string()).into_response()
}

/// Returns a measurement between places.
pub(super) async fn measure(State(served): State<Served>, body: String) -> Response {
    let asked = match serde_json::from_str(&body) {
        Ok(asked) => asked,
        Err(error) => {
            return refused(StatusCode::UNPROCESSABLE_ENTITY, &format!("this measurement is invalid: {error}"));
        }
    };
    match measure::measure(&asked, &served.session.latest.report().basis.doubt) {
        Ok(measured) => told(StatusCode::OK, &json!(measured)),
        Err(why) => refused(StatusCode::UNPROCESSABLE_ENTITY, &why.to_string()),
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
    let screen = &served.session.screen;
    let asked = serde_json::from_str::<Pointed>(&body)
        .map_err(|error| format!("this is not a point of the picture: {error}"))
        .and_then(|Pointed { at }| screen.pick(at));
    let answered = match asked {
        Ok(answered) => answered,
        Err(why) => return refused(StatusCode::UNPROCESSABLE_ENTITY, &why),
    };
    let glance = screen.glance(Kind::View);
    let answer = timeout(POINTING, answered).await;
    drop(glance);
    match answer {
        Ok(Ok(Ok(picked))) => told(StatusCode::OK, &json!(Place::from(picked))),
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
        Ok(found) => told(StatusCode::OK, &json!(found)),
        Err(why) => refused(StatusCode::UNPROCESSABLE_ENTITY, &why),
    }
}

/// Returns the settings with which a recording can be replayed.
pub(super) async fn settings(State(served): State<Served>) -> Response {
    match served.session.desk.replayed() {
        Some(replayed) => told(StatusCode::OK, &json!({ "settings": replayed.settings() })),
        None => refused(
            StatusCode::NOT_FOUND,
            "this session is live; only a recorded session can be run again with other settings",
        ),
    }
}

/// Returns the present session status, without rates, which need two readings.
pub(super) async fn account(State(served): State<Served>) -> Response {
    let mut account = status::PagePublisher::default().tell(&served);
    if let Some(account) = account["account"].as_object_mut() {
        account.remove("rates");
    }
    told(StatusCode::OK, &account["account"])
}

/// Returns the facts that do not change while the session runs.
pub(super) async fn about(State(served): State<Served>) -> Response {
    told(StatusCode::OK, &status::about(&served)["about"])
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
    let mut glance = served.session.screen.glance(kind);
    // A picture rendered before this request may be old.
    glance.pictures.mark_unchanged();
    let newest = match timeout(PATIENCE, next(&mut glance.pictures)).await {
        Ok(shot) => shot,
        Err(_) => served.session.screen.newest(kind),
    };
    drop(glance);
    let Some(shot) = newest else { return refused(StatusCode::NOT_FOUND, "there is no such picture yet") };
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
