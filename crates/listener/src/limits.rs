//! Limits of a client: the address under which it counts, and its messages per second.

use std::net::{IpAddr, Ipv6Addr};
use std::time::Duration;

use tokio::time::Instant;

/// Most messages of a client per second. A page that drags sends 120, and answers pictures; a
/// tracker sends 240 poses.
pub const MOST_MESSAGES: u32 = 400;

/// Returns the address under which a client counts. For IPv6 this is the network, since its
/// machines choose their addresses freely. IPv4 addresses that IPv6 sockets report are IPv4.
pub fn counted_address(address: IpAddr) -> IpAddr {
    match address.to_canonical() {
        IpAddr::V6(address) => Ipv6Addr::from_bits(address.to_bits() >> 64 << 64).into(),
        address @ IpAddr::V4(_) => address,
    }
}

/// The messages of a client in the present second.
#[derive(Debug)]
pub struct MessageRate {
    messages: u32,
    since: Instant,
}

impl MessageRate {
    /// Begins a second.
    pub fn new(now: Instant) -> Self {
        Self { messages: 0, since: now }
    }

    /// Counts a message. Returns whether the client keeps to [`MOST_MESSAGES`].
    pub fn count(&mut self, now: Instant) -> bool {
        if now.saturating_duration_since(self.since) >= Duration::from_secs(1) {
            *self = Self::new(now);
        }
        self.messages = self.messages.saturating_add(1);
        self.messages <= MOST_MESSAGES
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_beyond_limit_are_reported_until_next_second() {
        let begun = Instant::now();
        let after = |ms| begun + Duration::from_millis(ms);
        let mut rate = MessageRate::new(begun);
        assert!((0..MOST_MESSAGES).all(|_| rate.count(after(10))));
        assert!(!rate.count(after(10)) && !rate.count(after(999)));
        assert!((0..MOST_MESSAGES).all(|_| rate.count(after(1000))));
        assert!(!rate.count(after(1999)) && rate.count(after(2000)));
    }

    #[test]
    fn ipv6_clients_count_by_network_and_mapped_as_ipv4() {
        let counted = |text: &str| counted_address(text.parse().unwrap()).to_string();
        assert_eq!(counted("2001:db8:1:2:3:4:5:6"), "2001:db8:1:2::");
        assert_eq!(counted("::ffff:192.0.2.7"), "192.0.2.7");
        assert_eq!(counted("192.0.2.7"), "192.0.2.7");
    }
}
