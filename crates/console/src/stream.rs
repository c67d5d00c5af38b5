//! A page's connection: pictures and status to the page, commands from it.
//!
//! Binary messages are pictures, a header of 40 bytes (little-endian) before the pixels:
//!
//! | at | type | content |
//! |---|---|---|
//! | 0 | u8 | 1 B-mode image, 2 volume, 3 to 5 planes across the volume's z, y, x axis, 6 free plane |
//! | 1 | u8 | 0 grey, 1 RGB, 8 bits each; 2 JPEG, which may have half as many pixels a side |
//! | 2 | u16 | bit 0: a finer picture follows; bit 1: the capture time is unknown |
//! | 4, 8 | u32 | pixels to the right and down |
//! | 12 | u32 | sequence number among pictures of its kind, from 1 |
//! | 16, 24 | f64 | capture time of its frame, and sending time, ms since the UNIX epoch |
//! | 32 | u64 | number of its frame |
//!
//! Messages of kind 7 are bricks of the volume (`bricks`), for pages that draw it themselves and
//! have asked for them. `drawing` and `view` precede them: the settings of the picture, and its
//! view with each change. A page answers them like pictures.
//!
//! Text messages are JSON: the session status; the marks in the volume's picture, when changed;
//! and descriptions that precede pictures. `sight` precedes a picture of the volume if it has
//! changed; it gives the projection from world to pixels. `plane` precedes each picture of a
//! plane, with its kind, number and position. A page answers each picture after drawing it, and
//! at most two pictures of a kind are unanswered. A slow page therefore gets fewer pictures,
//! always the newest, and none pile up. A page with a slow connection gets JPEGs (`quality`).
//! Its last picture is sent again with better quality if no newer one comes.

use std::sync::Arc;
use std::time::Duration;

use axum::extract::State;
use axum::extract::ws::{CloseFrame, Message, WebSocket, WebSocketUpgrade, close_code};
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use tokio::sync::watch;
use tokio::time::{Instant, MissedTickBehavior, interval, interval_at, timeout};

use listener::MessageRate;
use sonoweave_core::clock::{Clock as _, Monotonic};

use super::bricks::{self, Drawing, PageBricks, view_json};
use super::broadcast::Subscription;
use super::counts::Counts;
use super::encoded_frame::{EncodedFrame, KINDS, Kind, Pixmap, unix_ms};
use super::marks::Marks;
use super::message::{ClientMessage, PageMessage, ViewMessage};
use super::quality::{Grade, Quality};
use super::served::Served;
use super::status;
use super::viewer_slots::ViewerSlot;

/// Largest number of unanswered pictures of a kind per page.
const ON_THEIR_WAY: u32 = 2;
/// A page's pictures count as lost if it answers none of them for this long.
const FORGIVEN: Duration = Duration::from_secs(2);
/// Interval of status messages.
const OFTEN: Duration = Duration::from_millis(250);
/// Interval of status messages for a page without subscription: it needs them only to know that
/// the connection works.
const SELDOM: Duration = Duration::from_secs(1);
/// Interval at which marks in the view are checked for changes.
const MARKED: Duration = Duration::from_millis(100);
/// Time limit for a page to take a message.
const SENDING: Duration = Duration::from_secs(5);
/// Largest message of a page, bytes.
const MOST_BYTES: usize = 4096;
/// Interval of pings, which the browser answers by itself, and the silence after which a page
/// counts as gone.
const PING_EVERY: Duration = Duration::from_secs(10);
const SILENT: Duration = Duration::from_secs(30);

pub(super) async fn stream(State(served): State<Served>, upgrade: WebSocketUpgrade) -> Response {
    let Some((slot, has_evicted)) = served.viewer_slots.enter().await else {
        Counts::add(&served.gate.counts.pages_refused);
        let sentence = "all viewer slots are in use; close another page\n";
        return (StatusCode::SERVICE_UNAVAILABLE, sentence).into_response();
    };
    if has_evicted {
        Counts::add(&served.gate.counts.evictions);
    }
    upgrade.max_message_size(MOST_BYTES).max_frame_size(MOST_BYTES).write_buffer_size(0).on_upgrade(
        async move |socket| {
            let end = Page::new(&served, socket, slot).run(served.stopped.clone()).await;
            if let End::CutOff(_) = end {
                Counts::add(&served.gate.counts.pages_cut_off);
            }
            tracing::debug!("a page has disconnected: {}", end.reason());
        },
    )
}

/// Returns whether a text is a valid command of a page.
pub fn understood(text: &str) -> bool {
    ClientMessage::parse(text).is_ok()
}

/// Unanswered pictures of a kind.
struct Channel {
    kind: Kind,
    is_viewed: bool,
    pictures: watch::Receiver<Option<Arc<EncodedFrame>>>,
    sent: u32,
    /// Sequence number and sending time of the last picture sent.
    last: u32,
    since: Instant,
    /// Quality of that picture.
    quality: Quality,
    grade: Grade,
    /// Description that preceded the last picture.
    description: Option<serde_json::Value>,
}

impl Channel {
    fn new(kind: Kind, subscription: &Subscription) -> Self {
        Self {
            kind,
            is_viewed: false,
            pictures: subscription.pictures(kind),
            sent: 0,
            last: 0,
            since: Instant::now(),
            quality: Quality::Whole,
            grade: Grade::default(),
            description: None,
        }
    }

    /// Returns the next picture and its quality, once there is room for it.
    async fn next(&mut self) -> (Arc<EncodedFrame>, Quality) {
        loop {
            // All pictures are answered, and the last one could be better.
            let again = if self.is_viewed && self.sent == 0 { self.grade.again(self.quality) } else { None };
            if self.is_viewed && self.sent < ON_THEIR_WAY {
                let newest = self.pictures.borrow_and_update().clone();
                match (newest, again) {
                    (Some(shot), _) if shot.sequence != self.last => return (shot, self.grade.quality()),
                    (Some(shot), Some((quality, wait))) if self.since.elapsed() >= wait => return (shot, quality),
                    _ => {}
                }
            } else if self.is_viewed && self.since.elapsed() >= FORGIVEN {
                self.sent = 0;
                self.grade.forgiven(Instant::now());
                continue;
            }
            let waits = async {
                if self.is_viewed && self.sent >= ON_THEIR_WAY {
                    tokio::time::sleep_until(self.since + FORGIVEN).await;
                } else if let Some((_, wait)) = again {
                    let _ = tokio::time::timeout_at(self.since + wait, self.pictures.changed()).await;
                } else if self.pictures.changed().await.is_err() {
                    std::future::pending::<()>().await;
                }
            };
            waits.await;
        }
    }

    fn answered(&mut self, sequence: u32, had: Duration) {
        if sequence <= self.last {
            self.sent = self.sent.saturating_sub(1);
            self.grade.answered(sequence, Instant::now(), had);
        }
    }
}

/// Reason why a page is no longer served.
enum End {
    /// The page left, or the session ended.
    Gone(&'static str),
    /// The server disconnected the page.
    CutOff(&'static str),
}

impl End {
    const TOOK_NOTHING: Self = Self::CutOff("the page was too slow");

    fn reason(&self) -> &'static str {
        let (Self::Gone(reason) | Self::CutOff(reason)) = self;
        reason
    }
}

struct Page<'a> {
    served: &'a Served,
    socket: WebSocket,
    slot: ViewerSlot,
    /// Time of the page's last message, pings included.
    received: Instant,
    subscription: Subscription,
    channels: [Channel; KINDS],
    messages: MessageRate,
    /// The page's bricks, if it draws the volume.
    bricks: Option<Arc<PageBricks>>,
    /// Commands to the camera from this page, also refused ones.
    steered: u64,
}

impl Drop for Page<'_> {
    fn drop(&mut self) {
        self.draw(false);
    }
}

impl<'a> Page<'a> {
    fn new(served: &'a Served, socket: WebSocket, slot: ViewerSlot) -> Self {
        let subscription = served.session.broadcaster.enter();
        let channels = Kind::ALL.map(|kind| Channel::new(kind, &subscription));
        let now = Instant::now();
        let messages = MessageRate::new(now);
        Self { served, socket, slot, received: now, subscription, channels, messages, bricks: None, steered: 0 }
    }

    /// Serves until the page or the server is gone; returns the reason.
    async fn run(mut self, mut stopped: watch::Receiver<()>) -> End {
        let mut turns = self.subscription.turns();
        let mut accounts = interval(OFTEN);
        accounts.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut questions = interval_at(Instant::now() + PING_EVERY, PING_EVERY);
        questions.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut marking = interval(MARKED);
        marking.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut marked: Option<Marks> = None;
        let mut account = status::PagePublisher::default();
        let mut status_at = Instant::now();
        let mut about = status::about(self.served);
        let mut style_changes = self.subscription.style_changes();
        let (mut drawings, mut views) = (self.subscription.drawings(), self.subscription.views());
        let mut draws = false;
        if !self.send_json(about.clone()).await
            || !self.send_json(self.control()).await
            || !self.send_json(self.style_message()).await
        {
            return End::TOOK_NOTHING;
        }
        self.update_activity();
        loop {
            let [slice, view, across_z, across_y, across_x, free] = &mut self.channels;
            let is_viewed = view.is_viewed || self.bricks.is_some();
            if std::mem::replace(&mut draws, self.bricks.is_some()) != draws && draws {
                drawings.mark_changed();
                views.mark_changed();
            }
            let message = tokio::select! {
                _ = stopped.changed() => {
                    self.leave(account.status(self.served)).await;
                    return End::Gone("the session is over");
                }
                () = self.slot.evicted() => {
                    self.close(close_code::AGAIN, "this page was inactive, and another page took its place").await;
                    return End::Gone("the page was inactive, and another page took its place");
                }
                Ok(()) = turns.changed() => {
                    self.update_activity();
                    Out::Text(self.control())
                }
                (shot, quality) = slice.next() => Out::EncodedFrame(shot, quality),
                (shot, quality) = view.next() => Out::EncodedFrame(shot, quality),
                (shot, quality) = across_z.next() => Out::EncodedFrame(shot, quality),
                (shot, quality) = across_y.next() => Out::EncodedFrame(shot, quality),
                (shot, quality) = across_x.next() => Out::EncodedFrame(shot, quality),
                (shot, quality) = free.next() => Out::EncodedFrame(shot, quality),
                message = next(self.bricks.as_deref()) => Out::Bricks(message),
                Ok(()) = drawings.changed(), if draws => match drawings.borrow_and_update().as_deref() {
                    Some(drawing) => Out::Text(self.tell(drawing)),
                    None => continue,
                },
                Ok(()) = views.changed(), if draws => {
                    Out::Text(view_json(&views.borrow_and_update(), self.steered))
                }
                Ok(()) = style_changes.changed() => Out::Text(self.style_message()),
                _ = marking.tick(), if is_viewed => match self.served.session.broadcaster.marks(Monotonic.now_ns()) {
                    Some(marks) if marked.as_ref().is_none_or(|was| was.differ(&marks)) => {
                        let value = marks.to_json();
                        marked = Some(marks);
                        Out::Text(value)
                    }
                    _ => continue,
                },
                _ = accounts.tick() => {
                    let is_due = self.channels.iter().any(|channel| channel.is_viewed) || status_at.elapsed() >= SELDOM;
                    if !is_due {
                        continue;
                    }
                    status_at = Instant::now();
                    let newer = status::about(self.served);
                    if newer != about {
                        about.clone_from(&newer);
                        if !self.send_json(newer).await {
                            return End::TOOK_NOTHING;
                        }
                    }
                    Out::Text(account.status(self.served))
                }
                _ = questions.tick() => {
                    if self.received.elapsed() >= SILENT {
                        return End::CutOff("the page stopped responding");
                    }
                    Out::Question
                }
                received = self.socket.recv() => match received {
                    Some(Ok(message)) => match self.handle_message(message) {
                        MessageOutcome::Fine => continue,
                        MessageOutcome::Done(text) => Out::Text(serde_json::json!({ "done": text })),
                        MessageOutcome::Refused(why) => Out::Text(serde_json::json!({ "refused": why })),
                        MessageOutcome::Over(end) => return end,
                    },
                    _ => return End::Gone("the connection ended"),
                },
            };
            let taken = match message {
                Out::Text(value) => self.send_json(value).await,
                Out::EncodedFrame(shot, quality) => self.send(&shot, quality).await,
                Out::Bricks(bytes) => self.send_message(Message::Binary(bytes.into())).await,
                Out::Question => self.send_message(Message::Ping(Vec::new().into())).await,
            };
            if !taken {
                return End::TOOK_NOTHING;
            }
        }
    }

    /// Sends the last status and closes.
    async fn leave(&mut self, account: serde_json::Value) {
        if self.send_json(account).await {
            self.close(close_code::AWAY, "the session is over").await;
        }
    }

    async fn close(&mut self, code: u16, reason: &'static str) {
        let close = CloseFrame { code, reason: reason.into() };
        let _ = timeout(SENDING, self.socket.send(Message::Close(Some(close)))).await;
    }

    /// Reports to the viewer slots whether this page is inactive.
    fn update_activity(&self) {
        let is_missed = self.subscription.steers()
            || self.bricks.is_some()
            || self.channels.iter().any(|channel| channel.is_viewed);
        self.slot.set_inactive(!is_missed);
    }

    fn control(&self) -> serde_json::Value {
        serde_json::json!({ "control": self.subscription.steers() })
    }

    fn style_message(&self) -> serde_json::Value {
        self.served.session.broadcaster.style_json()
    }

    async fn send_json(&mut self, value: serde_json::Value) -> bool {
        self.send_message(Message::Text(value.to_string().into())).await
    }

    /// Returns whether the message was sent.
    async fn send_message(&mut self, message: Message) -> bool {
        matches!(timeout(SENDING, self.socket.send(message)).await, Ok(Ok(())))
    }

    async fn send(&mut self, shot: &EncodedFrame, quality: Quality) -> bool {
        let channel = &mut self.channels[shot.kind as usize - 1];
        // The description of a view holds until the view changes.
        let is_new = channel.description != shot.words;
        if let Some(words) = shot.words.as_ref().filter(|_| is_new) {
            channel.description = Some(words.clone());
            if !self.send_json(words.clone()).await {
                return false;
            }
        }
        let channel = &mut self.channels[shot.kind as usize - 1];
        let now = Instant::now();
        // A repeated picture does not measure the time that new ones take.
        let is_new = shot.sequence != channel.last;
        channel.grade.sent(shot.sequence, now, !is_new);
        (channel.sent, channel.last, channel.since) = (channel.sent + 1, shot.sequence, now);
        channel.quality = quality;
        let jpeg = self.served.jpeg_cache.packed(shot, quality, &self.served.gate.counts);
        let captured_ms = shot.captured_ms.filter(|_| is_new);
        self.send_message(Message::Binary(
            packed(shot, captured_ms, jpeg.as_deref(), unix_ms(Monotonic.now_ns())).into(),
        ))
        .await
    }

    fn handle_message(&mut self, message: Message) -> MessageOutcome {
        self.received = Instant::now();
        if !self.messages.count(self.received) {
            return MessageOutcome::Over(End::CutOff("the page sent too many messages"));
        }
        let text = match message {
            Message::Text(text) => text,
            Message::Ping(_) | Message::Pong(_) => return MessageOutcome::Fine,
            Message::Close(_) => return MessageOutcome::Over(End::Gone("the page closed the connection")),
            Message::Binary(_) => return MessageOutcome::Refused("binary messages are not accepted; send text".into()),
        };
        let message = match ClientMessage::parse(&text) {
            Ok(ClientMessage::Page(message)) => return self.page(message),
            Ok(message) => message,
            Err(why) => return MessageOutcome::Refused(why.to_string()),
        };
        self.steered += u64::from(matches!(message, ClientMessage::View(ViewMessage::Steer(_))));
        if !self.subscription.steers() {
            return MessageOutcome::Refused("another page controls this session; take over control first".into());
        }
        match message.execute(self.served) {
            // The picture itself shows that the view has turned.
            Ok(None) => MessageOutcome::Fine,
            Ok(Some(text)) => MessageOutcome::Done(text),
            Err(why) => MessageOutcome::Refused(why.to_string()),
        }
    }

    /// Sets whether the page draws the volume. A page that begins to has no bricks.
    fn draw(&mut self, whether: bool) {
        let pages = self.served.session.broadcaster.brick_pages();
        match (&self.bricks, whether) {
            (Some(bricks), false) => {
                pages.leave(bricks);
                self.bricks = None;
            }
            (None, true) => self.bricks = Some(pages.enter()),
            _ => {}
        }
    }

    /// Returns the settings of the picture, which the page has from then on.
    fn tell(&self, drawing: &Drawing) -> serde_json::Value {
        self.bricks.iter().for_each(|bricks| bricks.tell(drawing));
        drawing.to_json()
    }

    /// Handles a message about this connection.
    fn page(&mut self, message: PageMessage) -> MessageOutcome {
        match message {
            PageMessage::Show { slice, view, planes, bricks } => {
                self.draw(bricks);
                for channel in &mut self.channels {
                    let is_viewed = match channel.kind {
                        Kind::Slice => slice,
                        Kind::View => view,
                        _ => planes,
                    };
                    self.subscription.subscribe(channel.kind, is_viewed);
                    channel.is_viewed = is_viewed;
                }
                self.update_activity();
            }
            PageMessage::Shown { kind: bricks::KIND, sequence, .. } => {
                self.bricks.iter().for_each(|bricks| bricks.answered(sequence));
            }
            PageMessage::Shown { kind, sequence, had } => {
                let Some(channel) = self.channels.iter_mut().find(|channel| channel.kind as u8 == kind) else {
                    return MessageOutcome::Refused(format!("there are no pictures of kind {kind}"));
                };
                channel.answered(sequence, had);
            }
            PageMessage::Control => self.subscription.take_over(),
        }
        MessageOutcome::Fine
    }
}

enum Out {
    Text(serde_json::Value),
    EncodedFrame(Arc<EncodedFrame>, Quality),
    Bricks(Vec<u8>),
    Question,
}

enum MessageOutcome {
    Fine,
    Done(String),
    Refused(String),
    Over(End),
}

/// Returns the next message of bricks of a page that draws the volume; never without.
async fn next(bricks: Option<&PageBricks>) -> Vec<u8> {
    match bricks {
        Some(bricks) => bricks.next().await,
        None => std::future::pending().await,
    }
}

/// Encodes a picture as a message: its pixels, or its JPEG.
fn packed(shot: &EncodedFrame, captured_ms: Option<f64>, jpeg: Option<&[u8]>, sent_ms: f64) -> Vec<u8> {
    let (encoding, pixels) = match (jpeg, &shot.pixels) {
        (Some(jpeg), _) => (2, jpeg),
        (None, Pixmap::Grey(pixels)) => (0, &**pixels),
        (None, Pixmap::Colour(pixels)) => (1, &**pixels),
    };
    let flags = u16::from(shot.refining) | u16::from(captured_ms.is_none()) << 1;
    let mut bytes = Vec::with_capacity(40 + pixels.len());
    bytes.extend([shot.kind as u8, encoding]);
    bytes.extend(flags.to_le_bytes());
    for number in [shot.size[0], shot.size[1], shot.sequence] {
        bytes.extend(number.to_le_bytes());
    }
    for time in [captured_ms.unwrap_or(f64::NAN), sent_ms] {
        bytes.extend(time.to_le_bytes());
    }
    bytes.extend(shot.item.to_le_bytes());
    bytes.extend_from_slice(pixels);
    bytes
}

#[cfg(test)]
mod tests;
