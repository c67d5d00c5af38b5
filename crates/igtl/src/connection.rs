//! A client's connection: reads its requests, and sends waiting messages as fast as the client
//! receives them.

use std::io::ErrorKind;
use std::rc::Rc;
use std::time::Duration;

use tokio::net::TcpStream;
use tokio::sync::watch;
use tokio::time::{Instant, sleep_until};

use drivers::openigtlink::{Decoder, Event, Limits};
use listener::MessageRate;

use super::admission::admits;
use super::client::Client;
use super::counts::Counts;
use super::outbox::Wire;
use super::state::ServerState;

/// A client that receives less than [`LEAST`] of a message in this time is disconnected.
const STALL: Duration = Duration::from_secs(10);
/// Bytes.
const LEAST: usize = 16 << 10;
/// Refused messages after which a client is disconnected.
const REFUSED: u64 = 16;
/// Size of the read buffer, bytes.
const READ: usize = 4096;

/// Serves until the client leaves, is disconnected, or the server ends.
pub(super) async fn serve(
    state: &Rc<ServerState>,
    client: &Rc<Client>,
    stream: TcpStream,
    mut stopped: watch::Receiver<()>,
) {
    // Poses are short and urgent; if the option is refused, they are delayed.
    let _ = stream.set_nodelay(true);
    let mut decoder = Decoder::new(Limits::SMALL);
    let mut buffer = [0; READ];
    let mut sending: Option<(Wire, usize)> = None;
    let (mut since, mut taken) = (Instant::now(), 0);
    let mut messages = MessageRate::new(since);
    let mut allowed = state.allowed.clone();
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
                    if !messages.count(Instant::now()) {
                        return Counts::add(&state.counts.too_many);
                    }
                    match event {
                        Event::Message(message, _) => state.handle(client, *message),
                        Event::Refused(why) => state.refuse(client, &why),
                    }
                }
                if let Err(why) = outcome {
                    tracing::debug!("an OpenIGTLink client sent invalid data: {why}");
                    return Counts::add(&state.counts.nonsense);
                }
                if decoder.refused() > REFUSED {
                    return Counts::add(&state.counts.nonsense);
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
                    return Counts::add(&state.counts.cut_off);
                }
                (since, taken) = (Instant::now(), 0);
            }
            Ok(()) = allowed.changed() => {
                if !admits(&allowed.borrow(), client.address) {
                    return Counts::add(&state.counts.not_allowed);
                }
            }
            _ = stopped.changed(), if !is_stopped => is_stopped = true,
        }
        if client.choked.get() {
            return Counts::add(&state.counts.cut_off);
        }
    }
}
