//! A client: its requests, and the messages that wait for it.

use std::cell::{Cell, RefCell};
use std::net::IpAddr;
use std::time::Duration;

use tokio::sync::Notify;
use tokio::time::Instant;

use drivers::openigtlink::{Fixed, Version};

use super::counts::Counts;
use super::outbox::{Outbox, Wire};

/// Messages that a client receives without request.
#[derive(Debug, Clone, Copy)]
pub(super) struct Subscriptions {
    pub(super) images: bool,
    pub(super) transforms: bool,
}

/// A client.
pub(super) struct Client {
    /// IPv4 as such, also if an IPv6 socket reports it.
    pub(super) address: IpAddr,
    pub(super) version: Cell<Version>,
    pub(super) subscriptions: Cell<Subscriptions>,
    /// Whether it has requested POSITIONs.
    pub(super) positions: Cell<bool>,
    /// TDATA: smallest interval, and time of the next one.
    pub(super) tools: Cell<Option<(Duration, Instant)>>,
    /// Time and name of its request for a volume.
    pub(super) volume_request: Cell<Option<(Instant, Fixed<20>)>>,
    outbox: RefCell<Outbox>,
    pub(super) more: Notify,
    /// Whether it requests more than it receives.
    pub(super) choked: Cell<bool>,
}

impl Client {
    pub(super) fn new(address: IpAddr) -> Self {
        Self {
            address,
            version: Cell::new(Version::One),
            subscriptions: Cell::new(Subscriptions { images: true, transforms: true }),
            positions: Cell::new(false),
            tools: Cell::new(None),
            volume_request: Cell::new(None),
            outbox: RefCell::default(),
            more: Notify::new(),
            choked: Cell::new(false),
        }
    }

    /// Whether it is on this machine.
    pub(super) fn is_local(&self) -> bool {
        self.address.is_loopback()
    }

    /// Queues an answer.
    pub(super) fn answer(&self, wire: Wire) {
        if !self.outbox.borrow_mut().answer(wire) {
            self.choked.set(true);
        }
        self.more.notify_one();
    }

    /// Returns the next message to send.
    pub(super) fn next(&self) -> Option<Wire> {
        self.outbox.borrow_mut().next()
    }

    /// Queues a published message.
    pub(super) fn publish(&self, name: &str, wire: Wire, counts: &Counts) {
        self.outbox.borrow_mut().publish(name, wire, &counts.replaced);
        self.more.notify_one();
    }
}
