//! One client: what it sends is answered, and what waits for it is sent as fast as it takes it, and no faster than it must.

use std::cell::{Cell, RefCell};
use std::io::ErrorKind;
use std::rc::Rc;
use std::time::Duration;

use drivers::openigtlink::{Decoder, Event, Fixed, Limits, Version};
use tokio::net::TcpStream;
use tokio::sync::{Notify, watch};
use tokio::time::{Instant, sleep_until};

use super::outbox::{Outbox, Wire};
use super::server::{Counts, House};

/// Who has a message sent to it and takes less than [`LEAST`] in such a time is cut off.
const STALL: Duration = Duration::from_secs(10);
/// Bytes.
const LEAST: usize = 16 << 10;
/// Messages that were not understood after which a client is cut off.
const REFUSED: u64 = 16;
/// Bytes of a read.
const READ: usize = 4096;

/// What a client wants unasked.
#[derive(Debug, Clone, Copy)]
pub(super) struct Wanted {
    pub(super) images: bool,
    pub(super) transforms: bool,
}

/// A client.
pub(super) struct Client {
    /// Of this machine.
    pub(super) is_local: bool,
    pub(super) version: Cell<Version>,
    pub(super) wants: Cell<Wanted>,
    /// It has asked for POSITIONs.
    pub(super) positions: Cell<bool>,
    /// TDATA: how far apart at least, and when it is due.
    pub(super) tools: Cell<Option<(Duration, Instant)>>,
    /// It has asked for a volume by this name, then.
    pub(super) asked: Cell<Option<(Instant, Fixed<20>)>>,
    outbox: RefCell<Outbox>,
    more: Notify,
    /// It asks for more than it takes.
    choked: Cell<bool>,
}

impl Client {
    pub(super) fn new(is_local: bool) -> Self {
        Self {
            is_local,
            version: Cell::new(Version::One),
            wants: Cell::new(Wanted { images: true, transforms: true }),
            positions: Cell::new(false),
            tools: Cell::new(None),
            asked: Cell::new(None),
            outbox: RefCell::default(),
            more: Notify::new(),
            choked: Cell::new(false),
        }
    }

    /// An answer to it.
    pub(super) fn answer(&self, wire: Wire) {
        if !self.outbox.borrow_mut().answer(wire) {
            self.choked.set(true);
        }
        self.more.notify_one();
    }

    /// What is to be sent to it next.
    pub(super) fn next(&self) -> Option<Wire> {
        self.outbox.borrow_mut().next()
    }

    /// What is shown to it.
    pub(super) fn show(&self, name: &str, wire: Wire, counts: &Counts) {
        self.outbox.borrow_mut().show(name, wire, &counts.replaced);
        self.more.notify_one();
    }
}

/// Serves until the client goes, is cut off, or the server ends.
pub(super) async fn serve(house: &Rc<House>, client: &Rc<Client>, stream: TcpStream, mut stopped: watch::Receiver<()>) {
    // Poses are short and late soon; where that is refused they wait.
    let _ = stream.set_nodelay(true);
    let mut decoder = Decoder::new(Limits::SMALL);
    let mut buffer = [0; READ];
    let mut sending: Option<(Wire, usize)> = None;
    let (mut since, mut taken) = (Instant::now(), 0);
    let mut is_stopped = false;
    loop {
        if sending.is_none() {
            sending = client.next().map(|wire| (wire, 0));
            (since, taken) = (Instant::now(), 0);
            if is_stopped && sending.is_none() {
                return;
            }
        }
        tokio::select! {
            ready = stream.readable() => {
                if ready.is_err() {
                    return;
                }
                let read = match stream.try_read(&mut buffer) {
                    Ok(0) => return,
                    Ok(read) => read,
                    Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) => 0,
                    Err(_) => return,
                };
                let mut events = Vec::new();
                let outcome = decoder.feed(&buffer[..read], &mut |event| events.push(event));
                for event in events {
                    match event {
                        Event::Message(message, _) => house.hear(client, *message),
                        Event::Refused(why) => house.refuse(client, &why),
                    }
                }
                if let Err(why) = outcome {
                    tracing::debug!("a client of OpenIGTLink sent something else: {why}");
                    return Counts::add(&house.counts.nonsense);
                }
                if decoder.refused() > REFUSED {
                    return Counts::add(&house.counts.nonsense);
                }
            }
            ready = stream.writable(), if sending.is_some() => {
                let Some((wire, at)) = &mut sending else { continue };
                if ready.is_err() {
                    return;
                }
                match stream.try_write(&wire[*at..]) {
                    Ok(written) => {
                        *at += written;
                        taken += written;
                        if *at == wire.len() {
                            sending = None;
                        }
                    }
                    Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) => {}
                    Err(_) => return,
                }
            }
            () = client.more.notified(), if sending.is_none() => {}
            () = sleep_until(since + STALL), if sending.is_some() => {
                if taken < LEAST {
                    return Counts::add(&house.counts.cut_off);
                }
                (since, taken) = (Instant::now(), 0);
            }
            _ = stopped.changed(), if !is_stopped => is_stopped = true,
        }
        if client.choked.get() {
            return Counts::add(&house.counts.cut_off);
        }
    }
}
