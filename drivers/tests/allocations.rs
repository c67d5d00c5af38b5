//! Decoders do not allocate after construction: not for records, nor garbage, nor divided
//! records.

#![allow(clippy::unwrap_used, reason = "a test that cannot be set up has failed")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use drivers::arm::{ea1, microscribe, qsb};
use drivers::framing::{Decoder, Format};
use drivers::tracker::polhemus::{fastrak, isotrak, liberty, viper};

thread_local! {
    static ALLOCATIONS: Cell<usize> = const { Cell::new(0) };
}

/// The system's allocator, counting each thread's requests.
struct Counting;

#[allow(unsafe_code, reason = "an allocator is unsafe by its trait; this one hands everything to the system's")]
// SAFETY: every call is passed unchanged to the system's allocator, which keeps the contract.
// Counting accesses only a number of this thread.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.with(|count| count.set(count.get() + 1));
        // SAFETY: the caller's promises are the system allocator's conditions.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the memory came from the system's allocator, with this layout.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        ALLOCATIONS.with(|count| count.set(count.get() + 1));
        // SAFETY: the memory came from the system's allocator, with this layout.
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Feeds good records with garbage between them, in pieces of many lengths. Checks that
/// `records` are found per good part, and nothing is allocated.
fn allocates_nothing<F: Format>(name: &str, format: F, good: &[u8], records: usize) {
    let mut stream = Vec::new();
    for round in 0..50_u8 {
        stream.extend(good.repeat(3));
        // Too short to be the beginning of a record for long, and different every time.
        stream.extend([round, b'0', b'2', b'$', round ^ 0xff, b'L', b'V', b's', 0x83, 0xB0]);
    }
    let mut decoder = Decoder::new(format);
    let (mut found, mut rest, mut piece) = (0, &stream[..], 1);
    let before = ALLOCATIONS.with(Cell::get);
    while !rest.is_empty() {
        let (bytes, after) = rest.split_at(piece.min(rest.len()));
        decoder.feed(bytes, &mut |_, _| found += 1);
        rest = after;
        piece = piece * 7 % 301;
    }
    let allocations = ALLOCATIONS.with(Cell::get) - before;
    assert_eq!(allocations, 0, "{name}");
    assert!(found >= 100 * records, "{name}: {found} records found");
    assert!(decoder.losses().bytes_skipped >= 490, "{name}");
}

#[test]
fn allocator_counts_requests() {
    let before = ALLOCATIONS.with(Cell::get);
    let boxed = std::hint::black_box(Box::new(7));
    assert_eq!((ALLOCATIONS.with(Cell::get) - before, *boxed), (1, 7));
}

#[test]
fn decoding_allocates_nothing() {
    let written = |write: &dyn Fn(&mut Vec<u8>)| {
        let mut bytes = Vec::new();
        write(&mut bytes);
        bytes
    };
    for (mode, codes) in [
        (fastrak::Mode::Ascii, &[2, 11, 1][..]),
        (fastrak::Mode::Ascii, &[52, 61, 1]),
        (fastrak::Mode::Binary, &[2, 11, 0]),
    ] {
        let layout = fastrak::Layout::new(mode, codes).unwrap();
        let pose = fastrak::Pose { quaternion_wxyz: Some([1.0, 0.0, 0.0, 0.0]), ..fastrak::Pose::empty(1, b' ') };
        let good = written(&|to| pose.write(&layout, to));
        allocates_nothing("FASTRAK", fastrak::Fastrak::uniform(1, layout), &good, 1);
    }
    let layout = isotrak::Layout::new(&[2, 11]).unwrap();
    let pose = isotrak::Pose { quaternion_wxyz_counts: Some([32_767, 0, 0, 0]), ..isotrak::Pose::empty(1, b' ') };
    allocates_nothing("ISOTRAK", isotrak::Isotrak::new(1, layout), &written(&|to| pose.write(&layout, to)), 1);
    let layout = liberty::Layout::new(&[8, 9, 2, 7]).unwrap();
    let header = liberty::Header { tag: liberty::Tag::Liberty, station: 1, command: b'C', error: 0 };
    let pose = liberty::Pose { quaternion_wxyz: Some([1.0, 0.0, 0.0, 0.0]), ..liberty::Pose::empty(header) };
    allocates_nothing("LIBERTY", liberty::Liberty::new(1, layout), &written(&|to| pose.write(&layout, to)), 1);
    let who = viper::Command::WhoAmI.bytes();
    allocates_nothing("VIPER", viper::Viper::new(1), &who, 1);
    for framing in [ea1::Framing::Lines, ea1::Framing::Blocks] {
        let sample = ea1::Sample { seq: 1, t_us: 2, counts: [3, -4, 5], flags: 7, buttons: 0, framing };
        let good = written(&|to| ea1::Record::Sample(sample).write(to));
        allocates_nothing("EA1", ea1::Ea1::or_bare_numbers(), &good, 1);
    }
    // The checksum is in lower case, which takes the slower path.
    allocates_nothing("EA1, unusual", ea1::Ea1::new(), b"$EA,42,1000000,1024,-300,65536,07*1e\r\n", 1);
    allocates_nothing("EA1's answers", ea1::Ea1::new(), &written(&|to| ea1::Record::Error(3).write(to)), 1);
    allocates_nothing("QSB", qsb::Qsb, b"s 0E FFFFFED4 00001234 !\r\ns0E00000001!\r\n", 2);
    let request = microscribe::Request::new(microscribe::Family::MicroScribe, 6, true).unwrap();
    let good = written(&|to| microscribe::Sample::new(0, None, &[1, 2, 3, 4, 5, 6]).write(request, to));
    allocates_nothing("MicroScribe", microscribe::Samples::new(request), &good, 1);
}

#[test]
fn session_message_allocates_only_its_index_entry() {
    use formats::session::{SessionWriter, WriterOptions};
    use sonoweave_core::reading::{Pose, Reading, Stamp, Status};
    let folder = tempfile::tempdir().unwrap();
    let mut session = SessionWriter::create(folder.path(), WriterOptions::new("a test")).unwrap();
    let source = session.device("tracker", None, &sonoweave_core::Description::default(), None).unwrap();
    let mut write = |n: i64, apart_ns: i64| {
        let at_ns = sonoweave_core::clock::SECOND * 1_000_000 + n * apart_ns;
        let pose = Pose {
            stamp: Stamp { host_ns: Some(at_ns), ..Stamp::default() },
            station: 1,
            position_cm: [n as f64; 3],
            quaternion_wxyz: [1.0, 0.0, 0.0, 0.0],
            buttons: 0,
            distortion: None,
            code: None,
            status: Status::Ok,
        };
        session.write(source, &Reading::Pose(pose), at_ns).unwrap();
    };
    // Several chunks pass, so that every buffer reaches its final size.
    (0..1000).for_each(|n| write(n, 10_000_000));
    let before = ALLOCATIONS.with(Cell::get);
    (0..4096).for_each(|n| write(n + 1_000_000, 10_000));
    let allocations = ALLOCATIONS.with(Cell::get) - before;
    // A chunk's index doubles: 4, 8, 16, … 4096 entries; and the chunk before was closed.
    assert!(allocations < 60, "{allocations} for 4096 messages");
}
