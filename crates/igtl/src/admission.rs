//! Admission of clients: the allowed networks, the number of clients, and those of one address.

use std::net::{IpAddr, Ipv4Addr, Ipv6Addr};
use std::time::Duration;

use ipnet::IpNet;
use tokio::time::Instant;

use listener::counted_address;

/// Largest number of clients; further ones are refused at once. Most viewers never send anything,
/// so silence is no reason to close a connection in favour of another.
const CLIENTS: usize = 32;
/// Largest number of clients of one address, so that one machine cannot take all slots.
const CLIENTS_OF_ADDRESS: usize = 8;
/// Shortest time between two messages about refused addresses.
const REPORTED_EVERY: Duration = Duration::from_secs(10);

/// Whether an address may connect: 127.0.0.1 and ::1 always, and others that an allowed network
/// contains. Without networks, the server listens on this machine, whose addresses may connect.
pub(super) fn admits(allowed: &[IpNet], address: IpAddr) -> bool {
    let address = address.to_canonical();
    address == Ipv4Addr::LOCALHOST
        || address == Ipv6Addr::LOCALHOST
        || (allowed.is_empty() && address.is_loopback())
        || allowed.iter().any(|network| network.contains(&address))
}

/// Whether there is a slot for a client of this address, beside those of the others.
pub(super) fn has_room(others: impl Iterator<Item = IpAddr>, address: IpAddr) -> bool {
    let own = counted_address(address);
    let (mut all, mut of_own) = (0, 0);
    for other in others {
        all += 1;
        of_own += usize::from(counted_address(other) == own);
    }
    all < CLIENTS && of_own < CLIENTS_OF_ADDRESS
}

/// Reports refused addresses to the log, however many there are, at most once in
/// [`REPORTED_EVERY`].
#[derive(Debug, Default)]
pub(super) struct Refusals {
    reported: Option<Instant>,
    unreported: u64,
}

impl Refusals {
    /// Counts a refusal. Returns the number of refusals to report now, with this one.
    pub(super) fn add(&mut self, now: Instant) -> Option<u64> {
        self.unreported += 1;
        if self.reported.is_some_and(|reported| now.saturating_duration_since(reported) < REPORTED_EVERY) {
            return None;
        }
        self.reported = Some(now);
        Some(std::mem::take(&mut self.unreported))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn address(text: &str) -> IpAddr {
        text.parse().unwrap()
    }

    #[test]
    fn only_allowed_networks_and_this_machine_are_admitted() {
        let allowed = ["192.168.0.0/24", "fd00:1::/64"].map(|text| text.parse().unwrap());
        for (text, expected) in [
            ("192.168.0.1", true),
            ("192.168.0.255", true),
            ("192.168.1.1", false),
            ("::ffff:192.168.0.9", true),
            ("::ffff:192.168.1.9", false),
            ("fd00:1::7", true),
            ("fd00:1:0:1::7", false),
            ("127.0.0.1", true),
            ("::1", true),
            ("::ffff:127.0.0.1", true),
            ("127.0.0.2", false),
            ("0.0.0.0", false),
        ] {
            assert_eq!(admits(&allowed, address(text)), expected, "{text}");
        }
        assert!(admits(&[], address("127.0.0.2")), "without networks it listens here only");
        assert!(!admits(&[], address("192.168.0.1")) && !admits(&[], address("fd00:1::7")));
    }

    #[test]
    fn one_address_cannot_take_all_slots() {
        let of = |count: usize, text: &str| vec![address(text); count];
        let flood = of(CLIENTS_OF_ADDRESS, "192.0.2.1");
        assert!(has_room(flood[1..].iter().copied(), flood[0]));
        assert!(!has_room(flood.iter().copied(), flood[0]));
        assert!(!has_room(flood.iter().copied(), address("::ffff:192.0.2.1")), "the same machine");
        assert!(has_room(flood.iter().copied(), address("192.0.2.2")));
        let network = of(CLIENTS_OF_ADDRESS, "2001:db8::1");
        assert!(!has_room(network.into_iter(), address("2001:db8::2")), "IPv6 counts by network");
        let many = (0..CLIENTS as u8).map(|n| IpAddr::from([192, 0, 2, n]));
        assert!(has_room(many.clone().skip(1), address("198.51.100.1")));
        assert!(!has_room(many, address("198.51.100.1")));
    }

    #[test]
    fn refusals_are_reported_once_in_a_while() {
        let begun = Instant::now();
        let mut refusals = Refusals::default();
        assert_eq!(refusals.add(begun), Some(1));
        assert!((0..1000).all(|_| refusals.add(begun + REPORTED_EVERY / 2).is_none()));
        assert_eq!(refusals.add(begun + REPORTED_EVERY), Some(1001));
    }
}
