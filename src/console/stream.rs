//! A page's connection: pictures and accounts to it, what it wants from it.
//!
//! Binary messages are pictures, a header of 40 bytes (little-endian) before the pixels:
//!
//! | at | type | what |
//! |---|---|---|
//! | 0 | u8 | 1 the scanner's picture, 2 the volume's, 3 to 5 planes across the volume's z, y and x axis, 6 a free plane |
//! | 1 | u8 | 0 grey, 1 red, green and blue; 8 bits each; 2 a JPEG, which may have half as many pixels a side |
//! | 2 | u16 | bit 0: a finer one follows; bit 1: when it was captured is not known |
//! | 4, 8 | u32 | pixels to the right and down |
//! | 12 | u32 | its number among those of its kind, from 1 |
//! | 16, 24 | f64 | when its frame was captured, and when it was sent, ms since the UNIX epoch |
//! | 32 | u64 | its frame's number |
//!
//! Text messages are JSON: what the session tells of itself; what is to be marked in the volume's picture, when that has changed; before the volume's picture `sight`, when that has
//! changed, which says what place of the world is where in it; and before the picture of a plane `plane`, which has its kind and number and says where it lies. A page answers each
//! picture when it has drawn it, and has two of a kind on their way at most: so one that is slow gets fewer, always the newest, and
//! nothing piles up for it. One whose line is slow gets them as JPEGs for as long as it is (`quality`); the last one, if none newer comes, once more and better.

use std::sync::Arc;
use std::time::Duration;

use axum::extract::State;
use axum::extract::ws::{CloseFrame, Message, WebSocket, WebSocketUpgrade, close_code};
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use drivers::clock::{Clock as _, Monotonic};
use tokio::sync::watch;
use tokio::time::{Instant, MissedTickBehavior, interval, interval_at, timeout};

use super::marks::Marks;
use super::places::Place;
use super::quality::{Grade, Quality};
use super::screen::{KINDS, Kind, Pixmap, Seat, Shot, unix_ms};
use super::wish::Wish;
use super::{Counts, Served, told};

/// Pictures of a kind on their way to a page.
const ON_THEIR_WAY: u32 = 2;
/// A page that answers none of them for so long is asked nothing more of: its pictures count as lost.
const FORGIVEN: Duration = Duration::from_secs(2);
/// Between two accounts.
const OFTEN: Duration = Duration::from_millis(250);
/// Between two for a page that looks at nothing: nobody reads them, but it knows that the line is there.
const SELDOM: Duration = Duration::from_secs(1);
/// Between two looks whether there is something else to be marked in the view.
const MARKED: Duration = Duration::from_millis(100);
/// For how long a page may keep a message waiting.
const SENDING: Duration = Duration::from_secs(5);
/// Bytes of a message of a page.
const MOST_BYTES: usize = 4096;
/// A page is asked this often whether it is there, which its browser answers by itself, and has gone when it has said nothing for so long.
const ASKED: Duration = Duration::from_secs(10);
const SILENT: Duration = Duration::from_secs(30);
/// Messages of a page in a second: a hand that drags makes 120, and pictures are answered.
const MOST_MESSAGES: u32 = 400;

pub(super) async fn stream(State(served): State<Served>, upgrade: WebSocketUpgrade) -> Response {
    let Some((place, gave_way)) = served.places.enter().await else {
        Counts::add(&served.gate.counts.pages_sent_away);
        let sentence = "as many pages look on as there are places; close one\n";
        return (StatusCode::SERVICE_UNAVAILABLE, sentence).into_response();
    };
    if gave_way {
        Counts::add(&served.gate.counts.gave_way);
    }
    upgrade.max_message_size(MOST_BYTES).max_frame_size(MOST_BYTES).write_buffer_size(0).on_upgrade(
        async move |socket| {
            let end = Page::new(&served, socket, place).run(served.stopped.clone()).await;
            if let End::CutOff(_) = end {
                Counts::add(&served.gate.counts.pages_cut_off);
            }
            tracing::debug!("a page has gone: {}", end.reason());
        },
    )
}

/// Whether a text is something that a page can want.
///
/// # Errors
/// Why it is not.
pub fn understood(text: &str) -> Result<(), String> {
    Wish::parse(text).map(drop)
}

/// What of a kind is on its way.
struct Channel {
    kind: Kind,
    looks: bool,
    pictures: watch::Receiver<Option<Arc<Shot>>>,
    sent: u32,
    /// The number of the last one that was sent, and of the last that was answered.
    last: u32,
    since: Instant,
    /// How good that one was.
    quality: Quality,
    grade: Grade,
    /// What was told before the last of its pictures.
    told: Option<serde_json::Value>,
}

impl Channel {
    fn new(kind: Kind, seat: &Seat) -> Self {
        Self {
            kind,
            looks: false,
            pictures: seat.pictures(kind),
            sent: 0,
            last: 0,
            since: Instant::now(),
            quality: Quality::Whole,
            grade: Grade::default(),
            told: None,
        }
    }

    /// The next picture and how good it is to be, once there is room for it.
    async fn next(&mut self) -> (Arc<Shot>, Quality) {
        loop {
            // Nothing is on its way, and what is there could be better.
            let again = if self.looks && self.sent == 0 { self.grade.again(self.quality) } else { None };
            if self.looks && self.sent < ON_THEIR_WAY {
                let newest = self.pictures.borrow_and_update().clone();
                match (newest, again) {
                    (Some(shot), _) if shot.sequence != self.last => return (shot, self.grade.quality()),
                    (Some(shot), Some((quality, wait))) if self.since.elapsed() >= wait => return (shot, quality),
                    _ => {}
                }
            } else if self.looks && self.since.elapsed() >= FORGIVEN {
                self.sent = 0;
                self.grade.forgiven(Instant::now());
                continue;
            }
            let waits = async {
                if self.looks && self.sent >= ON_THEIR_WAY {
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

/// Why a page is served no longer.
enum End {
    /// By itself, or with the session.
    Gone(&'static str),
    /// By this server.
    CutOff(&'static str),
}

impl End {
    const TOOK_NOTHING: Self = Self::CutOff("it took nothing");

    fn reason(&self) -> &'static str {
        let (Self::Gone(reason) | Self::CutOff(reason)) = self;
        reason
    }
}

struct Page<'a> {
    served: &'a Served,
    socket: WebSocket,
    place: Place,
    /// When it said something last, if only that it is there.
    heard: Instant,
    seat: Seat,
    channels: [Channel; KINDS],
    /// Messages in this second.
    messages: u32,
    second: Instant,
}

impl<'a> Page<'a> {
    fn new(served: &'a Served, socket: WebSocket, place: Place) -> Self {
        let seat = served.shown.screen.enter();
        let channels = Kind::ALL.map(|kind| Channel::new(kind, &seat));
        let now = Instant::now();
        Self { served, socket, place, heard: now, seat, channels, messages: 0, second: now }
    }

    /// Until the page is gone, or the server is; why.
    async fn run(mut self, mut stopped: watch::Receiver<()>) -> End {
        let mut turns = self.seat.turns();
        let mut accounts = interval(OFTEN);
        accounts.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut questions = interval_at(Instant::now() + ASKED, ASKED);
        questions.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut marking = interval(MARKED);
        marking.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut marked: Option<Marks> = None;
        let mut account = told::Teller::default();
        let mut told_at = Instant::now();
        let mut about = told::about(self.served);
        let mut dressed = self.seat.dressed();
        if !self.say(about.clone()).await || !self.say(self.control()).await || !self.say(self.dress()).await {
            return End::TOOK_NOTHING;
        }
        self.rests();
        loop {
            let [slice, view, across_z, across_y, across_x, free] = &mut self.channels;
            let looks = view.looks;
            let message = tokio::select! {
                _ = stopped.changed() => {
                    self.leave(account.tell(self.served)).await;
                    return End::Gone("the session is over");
                }
                () = self.place.sent_away() => {
                    self.close(close_code::AGAIN, "nobody looks here, and another page has come").await;
                    return End::Gone("it looked at nothing, and gave its place to another");
                }
                Ok(()) = turns.changed() => {
                    self.rests();
                    Out::Text(self.control())
                }
                (shot, quality) = slice.next() => Out::Shot(shot, quality),
                (shot, quality) = view.next() => Out::Shot(shot, quality),
                (shot, quality) = across_z.next() => Out::Shot(shot, quality),
                (shot, quality) = across_y.next() => Out::Shot(shot, quality),
                (shot, quality) = across_x.next() => Out::Shot(shot, quality),
                (shot, quality) = free.next() => Out::Shot(shot, quality),
                Ok(()) = dressed.changed() => Out::Text(self.dress()),
                _ = marking.tick(), if looks => match self.served.shown.screen.marks(Monotonic.now_ns()) {
                    Some(marks) if marked.as_ref().is_none_or(|was| was.differ(&marks)) => {
                        let value = marks.told();
                        marked = Some(marks);
                        Out::Text(value)
                    }
                    _ => continue,
                },
                _ = accounts.tick() => {
                    let is_due = self.channels.iter().any(|channel| channel.looks) || told_at.elapsed() >= SELDOM;
                    if !is_due {
                        continue;
                    }
                    told_at = Instant::now();
                    let newer = told::about(self.served);
                    if newer != about {
                        about.clone_from(&newer);
                        if !self.say(newer).await {
                            return End::TOOK_NOTHING;
                        }
                    }
                    Out::Text(account.tell(self.served))
                }
                _ = questions.tick() => {
                    if self.heard.elapsed() >= SILENT {
                        return End::CutOff("it fell silent");
                    }
                    Out::Question
                }
                came = self.socket.recv() => match came {
                    Some(Ok(message)) => match self.heard(message) {
                        Heard::Fine => continue,
                        Heard::Done(says) => Out::Text(serde_json::json!({ "done": says })),
                        Heard::Refused(why) => Out::Text(serde_json::json!({ "refused": why })),
                        Heard::Over(end) => return end,
                    },
                    _ => return End::Gone("it went away"),
                },
            };
            let taken = match message {
                Out::Text(value) => self.say(value).await,
                Out::Shot(shot, quality) => self.send(&shot, quality).await,
                Out::Question => self.hand(Message::Ping(Vec::new().into())).await,
            };
            if !taken {
                return End::TOOK_NOTHING;
            }
        }
    }

    /// The last that is told.
    async fn leave(&mut self, account: serde_json::Value) {
        if self.say(account).await {
            self.close(close_code::AWAY, "the session is over").await;
        }
    }

    async fn close(&mut self, code: u16, reason: &'static str) {
        let close = CloseFrame { code, reason: reason.into() };
        let _ = timeout(SENDING, self.socket.send(Message::Close(Some(close)))).await;
    }

    /// Whether it would be missed by nobody is known to who gives places away.
    fn rests(&self) {
        let is_missed = self.seat.steers() || self.channels.iter().any(|channel| channel.looks);
        self.place.rests(!is_missed);
    }

    fn control(&self) -> serde_json::Value {
        serde_json::json!({ "control": self.seat.steers() })
    }

    fn dress(&self) -> serde_json::Value {
        self.served.shown.screen.told_dress()
    }

    async fn say(&mut self, value: serde_json::Value) -> bool {
        self.hand(Message::Text(value.to_string().into())).await
    }

    /// Whether it was taken.
    async fn hand(&mut self, message: Message) -> bool {
        matches!(timeout(SENDING, self.socket.send(message)).await, Ok(Ok(())))
    }

    async fn send(&mut self, shot: &Shot, quality: Quality) -> bool {
        let channel = &mut self.channels[shot.kind as usize - 1];
        // What is told of a view holds until it is turned.
        let is_new = channel.told != shot.words;
        if let Some(words) = shot.words.as_ref().filter(|_| is_new) {
            channel.told = Some(words.clone());
            if !self.say(words.clone()).await {
                return false;
            }
        }
        let channel = &mut self.channels[shot.kind as usize - 1];
        let now = Instant::now();
        // What comes once more tells nothing of how long new ones take.
        let is_new = shot.sequence != channel.last;
        channel.grade.sent(shot.sequence, now, !is_new);
        (channel.sent, channel.last, channel.since) = (channel.sent + 1, shot.sequence, now);
        channel.quality = quality;
        let jpeg = self.served.shelf.packed(shot, quality, &self.served.gate.counts);
        let captured_ms = shot.captured_ms.filter(|_| is_new);
        self.hand(Message::Binary(packed(shot, captured_ms, jpeg.as_deref(), unix_ms(Monotonic.now_ns())).into())).await
    }

    fn heard(&mut self, message: Message) -> Heard {
        self.heard = Instant::now();
        if self.second.elapsed() >= Duration::from_secs(1) {
            (self.messages, self.second) = (0, Instant::now());
        }
        self.messages += 1;
        if self.messages > MOST_MESSAGES {
            return Heard::Over(End::CutOff("it said too much"));
        }
        let text = match message {
            Message::Text(text) => text,
            Message::Ping(_) | Message::Pong(_) => return Heard::Fine,
            Message::Close(_) => return Heard::Over(End::Gone("it closed")),
            Message::Binary(_) => return Heard::Refused("pages speak in text".into()),
        };
        let act = match Wish::parse(&text) {
            Ok(Wish::Show { slice, view, planes }) => {
                for channel in &mut self.channels {
                    let looks = match channel.kind {
                        Kind::Slice => slice,
                        Kind::View => view,
                        _ => planes,
                    };
                    self.seat.look(channel.kind, looks);
                    channel.looks = looks;
                }
                self.rests();
                return Heard::Fine;
            }
            Ok(Wish::Shown { kind, sequence, had }) => {
                let channel = self.channels.iter_mut().find(|channel| channel.kind as u8 == kind);
                return match channel {
                    Some(channel) => {
                        channel.answered(sequence, had);
                        Heard::Fine
                    }
                    None => Heard::Refused(format!("there are no pictures of a kind {kind}")),
                };
            }
            Ok(Wish::Control) => {
                self.seat.take_over();
                return Heard::Fine;
            }
            Ok(Wish::Act(act)) => act,
            Err(why) => return Heard::Refused(why),
        };
        if !self.seat.steers() {
            return Heard::Refused("another page steers this session; take over control first".into());
        }
        match act.act(self.served) {
            // What is turned is seen to turn.
            Ok(None) => Heard::Fine,
            Ok(Some(says)) => Heard::Done(says),
            Err(why) => Heard::Refused(why),
        }
    }
}

enum Out {
    Text(serde_json::Value),
    Shot(Arc<Shot>, Quality),
    Question,
}

enum Heard {
    Fine,
    Done(String),
    Refused(String),
    Over(End),
}

/// A picture as a message: its pixels, or its JPEG.
fn packed(shot: &Shot, captured_ms: Option<f64>, jpeg: Option<&[u8]>, sent_ms: f64) -> Vec<u8> {
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
