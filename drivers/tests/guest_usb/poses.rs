//! Delivered poses equal the measured ones.

use drivers::simulated::Model;
use drivers::tracker::polhemus::Settings;
use sonoweave_core::clock::{Clock, MS, Monotonic, SECOND};
use sonoweave_core::health::State;

use super::descriptors::{Described, Endpoint};
use super::guest::Test;
use super::vhci::Cut;
use super::{Unit, a_fastrak, a_liberty, a_patriot, a_viper, allocations, liberty};

pub(crate) const TESTS: &[Test] = &[
    ("poses_of_every_product_are_the_unit_s_to_the_last_bit", every_product),
    ("stations_of_one_unit_come_side_by_side", stations),
    ("eight_reads_wait_in_the_controller", in_flight),
    ("endpoints_are_found_by_descriptors", other_endpoints),
    ("bytes_may_be_cut_anywhere_between_transfers", cut_anywhere),
    ("a_host_that_does_not_read_for_a_while_loses_nothing", sleeping_host),
    ("a_reading_asks_for_no_memory", no_allocations),
];

/// Sets a unit up, compares poses with the truth, and leaves it quiet.
fn assert_exact<M: Model + 'static>(mut unit: Unit<M>, stations: &[u8], count: usize) {
    unit.plug_in();
    let mut rig = unit.open_with(None, Settings { stations: stations.to_vec(), ..Settings::default() });
    let took = rig.until(State::Running, 5 * SECOND);
    let poses = rig.poses(count);
    let late = unit.truth.assert_exact(&poses);
    for station in stations {
        assert!(poses.iter().filter(|pose| pose.station == *station).count() >= count / stations.len() - 1);
    }
    let received = rig.device.health().received;
    assert_eq!((received.opened, received.set_up, received.lost, received.refused), (1, 1, 0, 0), "{received:?}");
    println!(
        "{}: running {} ms after it was plugged in; the latest of {count} poses after {} ms",
        rig.device.describe().name,
        took / MS,
        late / MS
    );
    rig.device.stop().unwrap();
    // The unit must receive the command to stop.
    let end = Monotonic.now_ns() + SECOND;
    while unit.twin().continuous() {
        assert!(Monotonic.now_ns() < end, "it goes on talking");
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
}

fn every_product() {
    // The manufacturer's endpoints, where they are known.
    assert_exact(a_liberty(Described::new(0xff20, true, [0x04, 0x88])), &[1], 480);
    assert_exact(a_liberty(Described::new(0xff12, false, [0x02, 0x82])), &[1], 240);
    assert_exact(a_patriot(Described::new(0xef20, true, [0x04, 0x88])), &[1], 120);
    assert_exact(a_patriot(Described::new(0xef12, false, [0x02, 0x82])), &[1], 120);
    assert_exact(a_viper(), &[1], 480);
    assert_exact(a_fastrak(0x0002), &[1], 120);
    assert_exact(a_fastrak(0x0003), &[1], 120);
}

fn stations() {
    let eight: Vec<u8> = (1..=8).collect();
    let unit = a_liberty(Described::new(0xff20, true, [0x04, 0x88]));
    unit.twin().active = 0xff;
    assert_exact(unit, &eight, 8 * 120);
    let unit = a_viper();
    unit.twin().sensors = 0xffff;
    let all: Vec<u8> = (1..=16).collect();
    assert_exact(unit, &all, 16 * 120);
    let unit = a_fastrak(0x0002);
    unit.twin().stations = [true; 4];
    assert_exact(unit, &[1, 2, 3, 4], 4 * 30);
}

fn in_flight() {
    let unit = liberty();
    let mut rig = unit.open();
    rig.until(State::Running, 5 * SECOND);
    unit.plug().state().waited = None;
    rig.poses(480);
    let [fewest, most] = unit.plug().state().waited.unwrap();
    println!("when there was something to send, {fewest} to {most} reads waited");
    assert!((4..=8).contains(&fewest) && most == 8, "{fewest} to {most}");
    // No transfer remains after the device is released.
    rig.device.stop().unwrap();
    let end = Monotonic.now_ns() + 2 * SECOND;
    while unit.plug().state().waiting > 0 {
        assert!(Monotonic.now_ns() < end, "{} still wait", unit.plug().state().waiting);
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
}

fn other_endpoints() {
    let mut described = Described::new(0xff12, false, [0x05, 0x83]);
    // An endpoint that cannot carry records, packets of other sizes, and a second pair after
    // the first.
    described.endpoints[0].packet = 8;
    described.endpoints[1].packet = 32;
    described.endpoints.insert(0, Endpoint { address: 0x81, kind: 3, packet: 8 });
    described
        .endpoints
        .extend([Endpoint { address: 0x86, kind: 2, packet: 64 }, Endpoint { address: 0x07, kind: 2, packet: 64 }]);
    let mut unit = a_liberty(described);
    unit.plug_in();
    // The hemisphere command has 16 bytes, and the sensors stay in that hemisphere.
    let mut rig = unit.open_with(None, Settings { hemisphere: [0.75, 0.125, 0.0], ..Settings::default() });
    rig.until(State::Running, 5 * SECOND);
    unit.truth.assert_exact(&rig.poses(240));
    // An empty packet follows each transfer that fills its last packet, and no other transfer.
    let written = unit.plug().state().written.clone();
    let full = |bytes: &Vec<u8>| !bytes.is_empty() && bytes.len().is_multiple_of(8);
    assert!(written.iter().any(full), "no command fills its packets: {written:?}");
    for (n, bytes) in written.iter().enumerate() {
        let is_ended = written.get(n + 1).is_some_and(Vec::is_empty);
        assert_eq!(full(bytes), is_ended, "{n}: {}", bytes.escape_ascii());
    }
}

fn cut_anywhere() {
    for mut unit in [liberty(), a_liberty(Described::new(0xff12, false, [0x02, 0x82]))] {
        if unit.plug.is_none() {
            unit.plug_in();
        }
        unit.twin().active = 7;
        unit.plug().state().cut = Cut::Anywhere;
        let mut rig = unit.open_with(None, Settings { stations: vec![1, 2, 3], ..Settings::default() });
        rig.until(State::Running, 5 * SECOND);
        let before = unit.plug().state().packets;
        unit.truth.assert_exact(&rig.poses(720));
        let packets = unit.plug().state().packets - before;
        assert!(packets > 900, "{packets} packets for 240 frames of three records");
        let received = rig.device.health().received;
        assert_eq!((received.set_up, received.lost, received.refused), (1, 0, 0), "{received:?}");
    }
    let mut unit = a_viper();
    unit.plug_in();
    unit.twin().sensors = 0xf;
    unit.plug().state().cut = Cut::Anywhere;
    let mut rig = unit.open_with(None, Settings { stations: vec![1, 2, 3, 4], ..Settings::default() });
    rig.until(State::Running, 5 * SECOND);
    unit.truth.assert_exact(&rig.poses(960));
}

fn sleeping_host() {
    let unit = liberty();
    let mut rig = unit.open();
    rig.until(State::Running, 5 * SECOND);
    let mut poses = rig.poses(10);
    // Longer than the allowed silence of the unit.
    std::thread::sleep(std::time::Duration::from_millis(1500));
    poses.extend(rig.poses(480));
    // The waiting poses were measured long before they were read.
    assert!(unit.truth.assert_exact(&poses) > SECOND);
    let received = rig.device.health().received;
    assert_eq!((received.opened, received.set_up, received.lost), (1, 1, 0), "{received:?}");
}

fn no_allocations() {
    let unit = liberty();
    let mut rig = unit.open();
    rig.until(State::Running, 5 * SECOND);
    rig.poses(100);
    let mut readings = 0;
    let before = allocations::so_far();
    while readings < 480 {
        let deadline = Monotonic.now_ns() + 50 * MS;
        readings += usize::from(matches!(rig.device.next(deadline).unwrap(), sonoweave_core::Next::Reading(_)));
    }
    assert_eq!(allocations::so_far() - before, 0);
    // A wait without a reading does not allocate either.
    unit.twin().wire.hung = true;
    rig.readings(100 * MS);
    let before = allocations::so_far();
    for _ in 0..10 {
        let deadline = Monotonic.now_ns() + 5 * MS;
        assert!(matches!(rig.device.next(deadline).unwrap(), sonoweave_core::Next::Pending));
    }
    assert_eq!(allocations::so_far() - before, 0);
}
