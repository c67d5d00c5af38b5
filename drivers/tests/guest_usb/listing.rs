//! Listing of devices that are plugged in, and of those that can be opened.

use drivers::Listing;
use drivers::tracker::polhemus::{self, Settings};
use sonoweave_core::clock::{Clock, MS, Monotonic, SECOND};
use sonoweave_core::health::State;

use super::descriptors::Described;
use super::guest::Test;
use super::{a_liberty, a_viper, liberty};

pub(crate) const TESTS: &[Test] = &[
    ("what_is_plugged_in_is_listed_until_it_is_pulled_out", comes_and_goes),
    ("a_loader_is_listed_with_what_it_waits_for", loader),
    ("two_of_a_kind_are_distinguished", two_of_a_kind),
];

fn on_usb() -> Vec<Listing> {
    polhemus::list().into_iter().filter(|listing| listing.id.starts_with("usb")).collect()
}

/// Polls until `count` devices are listed. Returns them, and the time it took, ns.
fn wait_for(count: usize) -> (Vec<Listing>, i64) {
    let begin = Monotonic.now_ns();
    loop {
        let (listed, took) = (on_usb(), Monotonic.now_ns() - begin);
        if listed.len() == count {
            return (listed, took);
        }
        assert!(took < 5 * SECOND, "not {count}: {listed:?}");
        std::thread::sleep(std::time::Duration::from_millis(10));
    }
}

fn comes_and_goes() {
    assert_eq!(wait_for(0).0, []);
    let mut unit = liberty();
    let (listed, arrived) = wait_for(1);
    assert_eq!(
        (listed[0].id.as_str(), listed[0].description.as_str(), &listed[0].unavailable),
        ("usb:1-1", "Polhemus LIBERTY (0f44:ff20) on USB 1-1", &None)
    );
    unit.pull_out();
    let (_, went) = wait_for(0);
    println!(
        "listed {} ms after it was plugged in, and no more {} ms after it was pulled out",
        arrived / MS,
        went / MS
    );
    // By its serial number if it has one, and beside another device.
    unit.described.serial_number = Some("LBTY-7".into());
    unit.plug_in();
    let mut other = a_viper();
    other.port = 2;
    other.plug_in();
    let (mut listed, _) = wait_for(2);
    listed.sort_by(|a, b| a.id.cmp(&b.id));
    assert_eq!([&listed[0].id, &listed[1].id], ["usb:1-3", "usb:LBTY-7"]);
    assert_eq!(listed[0].description, "Polhemus VIPER (0f44:bf01) on USB 1-3");
    let begin = Monotonic.now_ns();
    on_usb();
    println!("a look at two devices takes {} µs", (Monotonic.now_ns() - begin) / 1000);
}

fn loader() {
    wait_for(0);
    let mut unit = a_liberty(Described::new(0xff21, true, [0x02, 0x86]));
    unit.plug_in();
    let (listed, _) = wait_for(1);
    assert_eq!(listed[0].description, "Polhemus LIBERTY that waits for its firmware (0f44:ff21) on USB 1-1");
    let why = listed[0].unavailable.as_deref().unwrap();
    assert!(why.contains("fxload -t fx2") && why.contains("firmware"), "{why}");
    let mut rig = unit.open();
    assert!(rig.readings(500 * MS).is_empty());
    assert_eq!(rig.state(), State::Absent);
    assert!(rig.why().contains("waits for its firmware") && rig.why().contains("fxload -t fx2"), "{}", rig.why());
    // It returns as a device with firmware.
    unit.pull_out();
    unit.described = Described::new(0xff20, true, [0x04, 0x88]);
    unit.plug_in();
    rig.until(State::Running, 5 * SECOND);
    unit.truth.assert_exact(&rig.poses(100));
}

fn two_of_a_kind() {
    wait_for(0);
    let mut first = a_liberty(Described::new(0xff20, true, [0x04, 0x88]));
    let mut second = a_liberty(Described::new(0xff12, false, [0x02, 0x82]));
    second.described.serial_number = Some("B".into());
    second.port = 1;
    first.plug_in();
    second.plug_in();
    wait_for(2);
    let mut either = first.open();
    assert!(either.readings(300 * MS).is_empty());
    assert_eq!(either.state(), State::Absent);
    assert!(either.why().contains("several devices of its kind are connected"), "{}", either.why());
    let mut by_place = first.open_with(Some("1-1"), Settings::default());
    let mut by_number = second.open_with(Some("B"), Settings::default());
    by_place.until(State::Running, 5 * SECOND);
    by_number.until(State::Running, 5 * SECOND);
    first.truth.assert_exact(&by_place.poses(100));
    second.truth.assert_exact(&by_number.poses(100));
    // Once one of them is gone, the choice is unambiguous.
    by_number.device.stop().unwrap();
    second.pull_out();
    wait_for(1);
    by_place.device.stop().unwrap();
    either.until(State::Running, 5 * SECOND);
    first.truth.assert_exact(&either.poses(100));
}
