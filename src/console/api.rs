//! For programs: what pages say and are told, over plain HTTP.

use std::sync::Arc;
use std::time::Duration;

use axum::extract::{Path, State};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use serde_json::{Value, json};
use tokio::sync::watch;
use tokio::time::timeout;

use super::screen::{Kind, Shot};
use super::wish::Wish;
use super::{Served, snapshot};
use crate::measure::Place;

/// For how long a picture is waited for that nobody else looks at.
const PATIENCE: Duration = Duration::from_secs(2);
/// For how long somebody who points at a place is kept waiting by who draws.
const POINTING: Duration = Duration::from_secs(1);
/// The description of all this.
const DESCRIPTION: &str = include_str!("openapi.json");

/// A wish as the request's body.
pub(super) async fn wish(State(served): State<Served>, body: String) -> Response {
    let act = match Wish::parse(&body) {
        Ok(Wish::Act(act)) => act,
        Ok(_) => return refused(StatusCode::UNPROCESSABLE_ENTITY, "only a page's own connection can want this"),
        Err(why) => return refused(StatusCode::UNPROCESSABLE_ENTITY, &why),
    };
    match act.act(&served) {
        Ok(says) => {
            let says = says.unwrap_or_else(|| "the view is another one".into());
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

/// A figure between places.
pub(super) async fn measure(State(served): State<Served>, body: String) -> Response {
    let asked = match serde_json::from_str(&body) {
        Ok(asked) => asked,
        Err(error) => {
            return refused(StatusCode::UNPROCESSABLE_ENTITY, &format!("this is nothing to be measured: {error}"));
        }
    };
    match crate::measure::measure(&asked, &served.shown.latest.told().basis.doubt) {
        Ok(measured) => told(StatusCode::OK, &json!(measured)),
        Err(why) => refused(StatusCode::UNPROCESSABLE_ENTITY, &why),
    }
}

/// A place of the volume's picture, by its share of the width from the left and of the height from above.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Pointed {
    at: [f64; 2],
}

/// The place that is seen there. A picture is drawn for who asks, if nobody else looks.
pub(super) async fn pick(State(served): State<Served>, body: String) -> Response {
    let screen = &served.shown.screen;
    let asked = serde_json::from_str::<Pointed>(&body)
        .map_err(|error| format!("this is no place of the picture: {error}"))
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

/// A place of the world, mm.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct At {
    at: [f64; 3],
}

/// The slices that a place was made of.
pub(super) async fn slices(State(served): State<Served>, body: String) -> Response {
    let found = serde_json::from_str::<At>(&body)
        .map_err(|error| format!("this is no place of the world: {error}"))
        .and_then(|At { at }| served.shown.slices.of(at));
    match found {
        Ok(found) => told(StatusCode::OK, &json!(found)),
        Err(why) => refused(StatusCode::UNPROCESSABLE_ENTITY, &why),
    }
}

/// What a recording can be run again by.
pub(super) async fn settings(State(served): State<Served>) -> Response {
    match served.shown.desk.replayed() {
        Some(replayed) => told(StatusCode::OK, &json!({ "settings": replayed.settings() })),
        None => {
            refused(StatusCode::NOT_FOUND, "this session is live; only a recorded one is run again by other settings")
        }
    }
}

/// How the session is at this moment; without rates, which take two moments.
pub(super) async fn account(State(served): State<Served>) -> Response {
    let mut account = super::told::Teller::default().tell(&served);
    if let Some(account) = account["account"].as_object_mut() {
        account.remove("rates");
    }
    told(StatusCode::OK, &account["account"])
}

/// What does not change while the session runs.
pub(super) async fn about(State(served): State<Served>) -> Response {
    told(StatusCode::OK, &super::told::about(&served)["about"])
}

/// The newest picture of a kind. It is made for who asks, if nobody else looks.
pub(super) async fn picture(State(served): State<Served>, Path(name): Path<String>) -> Response {
    let kind = match name.as_str() {
        "slice.png" => Kind::Slice,
        "view.png" => Kind::View,
        "across-z.png" => Kind::AcrossZ,
        "across-y.png" => Kind::AcrossY,
        "across-x.png" => Kind::AcrossX,
        "free.png" => Kind::Free,
        _ => return refused(StatusCode::NOT_FOUND, "there are slice, view, across-z, across-y, across-x and free.png"),
    };
    let mut glance = served.shown.screen.glance(kind);
    // One that was made before may be long past.
    glance.pictures.mark_unchanged();
    let newest = match timeout(PATIENCE, next(&mut glance.pictures)).await {
        Ok(shot) => shot,
        Err(_) => served.shown.screen.newest(kind),
    };
    drop(glance);
    let Some(shot) = newest else { return refused(StatusCode::NOT_FOUND, "there is no such picture yet") };
    match tokio::task::spawn_blocking(move || snapshot::png(&shot)).await {
        Ok(Ok(bytes)) => ([(header::CONTENT_TYPE, "image/png")], bytes).into_response(),
        Ok(Err(why)) => refused(StatusCode::INTERNAL_SERVER_ERROR, &why),
        Err(error) => refused(StatusCode::INTERNAL_SERVER_ERROR, &error.to_string()),
    }
}

async fn next(pictures: &mut watch::Receiver<Option<Arc<Shot>>>) -> Option<Arc<Shot>> {
    pictures.changed().await.ok()?;
    pictures.borrow_and_update().clone()
}

/// All of this, for programs that make clients of it.
pub(super) async fn description() -> Response {
    ([(header::CONTENT_TYPE, "application/json")], DESCRIPTION).into_response()
}
