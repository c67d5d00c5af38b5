//! Publishes pending changes to all clients that want them.

use std::rc::Rc;
use std::time::Duration;

use tokio::time::{Instant, MissedTickBehavior, interval};

use drivers::openigtlink::{Content, Fixed, Message, Status};

use super::client::Client;
use super::encode::{self, Both};
use super::state::{LastPublished, ServerState};
use super::{POSES_HZ, STATUS_EVERY};

/// Longest wait for a requested volume; then the client learns that there is none.
const PATIENCE: Duration = Duration::from_secs(5);
/// Publishing interval.
const TURN: Duration = Duration::from_millis(10);

/// Publishes changes until the server ends.
pub(super) async fn run(state: Rc<ServerState>) {
    let mut status = interval(STATUS_EVERY);
    let mut turn = interval(TURN);
    turn.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let mut is_new = false;
    loop {
        tokio::select! {
            // Limits the rate, however often changes arrive.
            _ = turn.tick(), if is_new => {
                is_new = false;
                state.publish();
            }
            () = state.hub.changed.notified() => is_new = true,
            _ = status.tick() => {
                state.publish();
                state.publish_to(|_| true, &mut Both::new(state.status()));
                state.give_up();
            }
        }
    }
}

impl ServerState {
    /// Sends to all clients concerned; a message that cannot be encoded is sent to none.
    fn publish_to(&self, concerns: impl Fn(&Client) -> bool, both: &mut Both) {
        let name = both.name();
        for client in self.clients.borrow().iter().filter(|client| concerns(client)) {
            match both.wire(client.version.get()) {
                Ok(wire) => client.publish(&name, wire, &self.counts),
                Err(why) => return tracing::debug!("{name}: {why}"),
            }
        }
    }

    fn publish(&self) {
        let taken = self.hub.take_pending();
        let now = Instant::now();
        let mut published = self.published.borrow_mut();
        if taken.status.is_some() {
            published.status = taken.status;
        }
        for (name, (sample, is_new)) in taken.poses {
            if !is_new {
                continue;
            }
            if published.due.get(&name).is_none_or(|due| *due <= now) {
                published.due.insert(name.clone(), now + Duration::from_secs(1) / POSES_HZ);
                let mut both = Both::new(encode::pose(&name, &sample));
                self.publish_to(|client| client.subscriptions.get().transforms, &mut both);
                published.transforms.insert(name.clone(), both);
                self.publish_to(|client| client.positions.get(), &mut Both::new(encode::position(&name, &sample)));
            }
            published.poses.insert(name, sample);
        }
        if !published.poses.is_empty() {
            let mut tools = Both::new(encode::tools(published.poses.iter()));
            let is_due = |client: &Client| client.tools.get().is_some_and(|(_, due)| due <= now);
            self.publish_to(is_due, &mut tools);
            for client in self.clients.borrow().iter().filter(|client| is_due(client)) {
                client.tools.set(client.tools.get().map(|(apart, _)| (apart, now + apart)));
            }
        }
        if let Some((item, slice)) = taken.slice {
            let mut both = Both::new(encode::slice(&taken.world, item, &slice));
            self.publish_to(|client| client.subscriptions.get().images, &mut both);
            published.slice = Some(both);
            let mut both = Both::new(encode::image_to(&taken.world, &slice));
            self.publish_to(|client| client.subscriptions.get().transforms, &mut both);
            let name = sonoweave_core::reading::transform_name("Image", &taken.world);
            published.transforms.insert(name, both);
        }
        if !taken.world.is_empty() {
            published.world = taken.world;
        }
        match taken.volume {
            None => {}
            Some(Ok(snapshot)) => {
                let mut both = Both::new(encode::volume(&published.world, &snapshot));
                self.publish_to(
                    |client| client.subscriptions.get().images || client.volume_request.get().is_some(),
                    &mut both,
                );
                self.clients.borrow().iter().for_each(|client| client.volume_request.set(None));
                (published.volume, published.snapshot) = (Some(both), Some(Ok(snapshot)));
            }
            Some(Err(why)) => {
                published.snapshot = Some(Err(why));
                drop(published);
                self.none_to(|_| true);
            }
        }
    }

    /// Answers clients that have waited too long for a volume: there is none.
    fn give_up(&self) {
        self.none_to(|since| since.elapsed() > PATIENCE);
    }

    fn none_to(&self, overdue: impl Fn(Instant) -> bool) {
        for client in self.clients.borrow().iter() {
            let Some((since, name)) = client.volume_request.get() else { continue };
            if overdue(since) {
                client.volume_request.set(None);
                self.send(client, Message::new(name, encode::now(), nothing("IMAGE")));
            }
        }
    }

    /// Returns the last status as a message.
    pub(super) fn status(&self) -> Message {
        match &self.published.borrow().status {
            Some((code, sentence)) => encode::status(*code, sentence),
            None => encode::status(Status::NOT_READY, "the session has not begun"),
        }
    }

    /// Sends the status and the last messages to a new client.
    pub(super) fn welcome(&self, client: &Rc<Client>) {
        self.send(client, self.status());
        let mut published = self.published.borrow_mut();
        let LastPublished { slice, volume, transforms, .. } = &mut *published;
        for both in transforms.values_mut().chain(slice).chain(volume) {
            let name = both.name();
            if let Ok(wire) = both.wire(client.version.get()) {
                client.publish(&name, wire, &self.counts);
            }
        }
    }

    /// Sends a message to one client.
    pub(super) fn send(&self, client: &Client, message: Message) {
        match Both::new(message).wire(client.version.get()) {
            Ok(wire) => client.answer(wire),
            Err(why) => tracing::warn!("an OpenIGTLink answer cannot be sent: {why}"),
        }
    }
}

/// Returns the content that says that there is no message of this type.
pub(super) fn nothing(kind: &str) -> Content {
    Content::Nothing(Fixed::new(kind).unwrap_or(Fixed::EMPTY))
}
