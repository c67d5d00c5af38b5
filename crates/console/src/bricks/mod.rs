//! Bricks of the volume for pages that draw it themselves.
//!
//! - `dirty_set`: the bricks that a page does not have as they are.
//! - `message`: bricks as bytes.
//! - `page_bricks`: a page's dirty set, and its messages on their way.
//! - `brick_pages`: all such pages; connects them to the session's brick viewer.
//! - `drawing`: what a page must know to draw the session's picture.
//!
//! A brick is read and encoded when a page has room for a message. Nothing is queued behind it: a
//! slow page gets fewer bricks, each as it was then, and no stage waits for a page.

mod brick_pages;
mod dirty_set;
mod drawing;
mod message;
mod page_bricks;
#[cfg(test)]
mod tests;

pub(super) use brick_pages::BrickPages;
pub(super) use drawing::{Drawing, view_json};
pub(super) use message::KIND;
pub(super) use page_bricks::PageBricks;
