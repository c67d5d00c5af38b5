//! The echo simulation: equal bits for any number of threads, and no allocation during a
//! simulation.

#![allow(clippy::unwrap_used, reason = "tests fail so")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::sync::Arc;

use drivers::simulated::Faults;
use drivers::simulated::grabber::Grabber;
use phantom::body::{doll, thigh};
use phantom::{Bedside, Body, Motion, Scan, ScanSettings, Scanner, Scene};
use sonoweave_core::clock::{Clock, MS, Manual, SECOND};
use sonoweave_core::reading::Reading;
use sonoweave_core::slice::Pixels;
use sonoweave_core::{Device, Next};

thread_local! {
    static ASKED: Cell<usize> = const { Cell::new(0) };
}

/// The system's allocator, counting each thread's allocations.
struct Counting;

#[allow(unsafe_code, reason = "an allocator is unsafe by its trait; this one hands everything to the system's")]
// SAFETY: every call is passed on unchanged to the system's allocator, which keeps the contract;
// counting changes only a number of this thread.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ASKED.with(|asked| asked.set(asked.get() + 1));
        // SAFETY: the caller guarantees the same conditions as for the system's allocator.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the memory came from the system's allocator, with this layout.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        ASKED.with(|asked| asked.set(asked.get() + 1));
        // SAFETY: the memory came from the system's allocator, with this layout.
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Returns this thread's allocations during the call.
fn asked(action: impl FnOnce()) -> usize {
    let before = ASKED.with(Cell::get);
    action();
    ASKED.with(Cell::get) - before
}

/// A sweep of a body by a scanner.
fn scan(body: Arc<Body>, scanner: Scanner) -> Scan {
    let image_size = [96, 80];
    let pixel = scanner.pixel_mm(image_size);
    let settings = ScanSettings {
        scene: Scene::Body(body),
        scanner: Some(scanner),
        motion: Motion::Freehand,
        frames: 12,
        gap_mm: 2.0,
        image_size,
        pixel_mm: [pixel; 2],
        noise_sd: 0.0,
        ..ScanSettings::default()
    };
    Scan::new(settings).unwrap()
}

fn scans() -> [Scan; 2] {
    let doll = scan(Arc::new(doll::doll()), Scanner::abdominal(105.0).in_water());
    let thigh = scan(Arc::new(thigh::thigh(60.0)), Scanner::abdominal(120.0));
    [doll, thigh]
}

fn greys(scan: &Scan) -> Vec<Vec<u8>> {
    let slices = scan.slices(0..scan.frames());
    let pixels = slices.iter().map(|slice| match slice.image.pixels() {
        Pixels::U8(pixels) => pixels.to_vec(),
        other => panic!("{} bytes of another kind", other.bytes()),
    });
    pixels.collect()
}

#[test]
fn frames_are_bit_identical_for_any_thread_count() {
    for scan in scans() {
        let bmode = scan.bmode().unwrap();
        // First in sequence, in a workspace used for other frames; then in reverse order, each
        // in a new workspace.
        let mut room = bmode.workspace();
        let paint = |frame: u32, room: &mut _| {
            let mut picture = vec![7; 96 * 80];
            assert!(scan.paint_echoes(frame, room, &mut picture));
            picture
        };
        let in_order: Vec<Vec<u8>> = (0..12).map(|frame| paint(frame, &mut room)).collect();
        assert!(in_order.iter().all(|picture| picture.iter().any(|grey| *grey > 60)), "there is something to see");
        assert!(in_order.windows(2).all(|two| two[0] != two[1]), "and it moves");
        for frame in (0..12).rev() {
            assert!(paint(frame, &mut bmode.workspace()) == in_order[frame as usize], "frame {frame}");
        }
        for threads in [1, 2, 3, 5, 8] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            assert!(pool.install(|| greys(&scan)) == in_order, "{threads} threads");
        }
    }
}

#[test]
fn simulated_frame_allocates_nothing() {
    for scan in scans() {
        let bmode = scan.bmode().unwrap();
        let (mut room, mut picture) = (bmode.workspace(), vec![0; 96 * 80]);
        // Not even for the first: the workspace is made for the worst case of the body.
        for frame in 0..12 {
            let count = asked(|| assert!(scan.paint_echoes(frame, &mut room, &mut picture)));
            assert_eq!(count, 0, "frame {frame}");
        }
    }
}

#[test]
fn grabber_frame_allocates_nothing_once_pool_is_full() {
    let [scan, _] = scans();
    let bedside = Arc::new(Bedside::new(scan, 0));
    let clock = Manual::at(0);
    let mut grabber =
        Grabber::new(bedside.pictures(), [96, 80], 30.0, Faults::default(), Arc::new(clock.clone())).unwrap();
    grabber.start().unwrap();
    let (mut frames, mut held) = (0, 0);
    while clock.now_ns() < 2 * SECOND {
        let mut frame = None;
        let count = asked(|| frame = Some(grabber.next(clock.now_ns() + 50 * MS).unwrap()));
        let Some(Next::Reading(Reading::Frame(frame))) = frame else { continue };
        frames += 1;
        held = held.max(count);
        assert!(frames < 4 || count == 0, "frame {frames}: {count} allocations");
        assert!(frame.pixels.iter().any(|grey| *grey > 0));
    }
    assert!(frames > 50 && held > 0, "{frames} {held}");
}

#[test]
fn allocation_counter_counts() {
    let count = asked(|| assert_eq!(*std::hint::black_box(Box::new(7)), 7));
    assert_eq!(count, 1);
}
