//! The console: reports and shows a running session over HTTP on this machine, over HTTPS to
//! others.
//!
//! | path | content |
//! |---|---|
//! | `GET /` | the page: live B-mode images, the volume, and planes through it |
//! | `GET /v1/stream` | the page's connection (WebSocket), see `stream` |
//! | `POST /v1/do` | a command: record, stop, freeze, clear, save, turn the view, …, see `message` |
//! | `POST /v1/measure` | a length, angle, area or volume between places, with its uncertainty |
//! | `POST /v1/pick` | the place of the volume that is visible at a point of its picture, see `pick` |
//! | `POST /v1/slices` | the slices that contributed to a place |
//! | `GET /v1/account`, `/v1/about` | the status that pages receive |
//! | `GET /v1/pictures/slice.png`, `view.png` | the newest picture |
//! | `GET /v1/openapi.json` | this interface in OpenAPI's format |
//! | `GET /status` | the full status as JSON: the document that `--json` writes at the end |
//! | `GET /metrics` | the same in Prometheus' text format |
//! | `POST /v1/login` | exchanges a token for a cookie, if a token is configured, see `access` |
//! | `GET /healthz` | 200 while the session progresses; else 503 and the stalled stages |
//!
//! Handlers read the [`Latest`] status and the pictures that stages leave on the
//! [`FrameBroadcaster`]. No stage ever waits for a client, however slow or stuck. Handlers work
//! without a socket ([`routes()`]); [`Console`] adds one. Every request must name this machine
//! ([`hosts`]) and carry the token, if one is configured (`access`). Requests that do more than
//! read must not come from another site's page ([`origin`]). Idle connections make room for
//! others (`connection_limiter`), and so do inactive pages (`viewer_slots`). Pages may draw the
//! volume themselves, from its `bricks`.

mod access;
mod api;
mod bricks;
pub mod broadcast;
mod connection_info;
mod connection_limiter;
mod counts;
mod encoded_frame;
mod error;
pub mod hosts;
mod latest;
mod listen;
mod marks;
mod message;
mod metrics;
pub mod orbit_camera;
pub mod origin;
mod page;
mod pick;
mod plane_colours;
pub mod planes;
mod quality;
mod questions;
mod request_error;
mod routes;
mod served;
mod server;
mod snapshot;
mod status;
pub mod stream;
pub mod style;
#[cfg(test)]
mod tests;
pub mod token;
mod viewer_slots;

pub use broadcast::FrameBroadcaster;
pub use counts::Counts;
pub use encoded_frame::{EncodedFrame, Kind, Pixmap};
pub use error::ConsoleError;
pub use latest::{About, Basis, Identity, Latest};
pub use listen::Listen;
pub use routes::routes;
pub use served::{ConsoleSession, Served};
pub use server::Console;
