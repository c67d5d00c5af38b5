//! No allocation from a reading's ticks to a frame's pose after the first seconds: not for
//! samples, frames, or late and lost readings.

#![allow(clippy::unwrap_used, reason = "a test that cannot be set up has failed")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use glam::{DQuat, DVec3};

use sonoweave_core::named::StaticTransform;
use sonoweave_core::{Ticks, Timing};
use sync::PairingOptions;
use sync::clock::{ClockMap, ClockSettings};
use sync::history::{PoseSample, Rigid};
use sync::pairing::timed::{FrameTime, Source, TimedOptions, TimedPairing};

const MS: i64 = 1_000_000;

thread_local! {
    static ALLOCATIONS: Cell<usize> = const { Cell::new(0) };
}

/// The system's allocator, counting each thread's allocations.
struct Counting;

#[allow(unsafe_code, reason = "an allocator is unsafe by its trait; this one hands everything to the system's")]
// SAFETY: every call is passed on unchanged to the system's allocator, which keeps the contract;
// counting changes only a number of this thread.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.with(|count| count.set(count.get() + 1));
        // SAFETY: the caller guarantees the same conditions as for the system's allocator.
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

#[test]
fn samples_and_frames_allocate_nothing() {
    let timing = |ticks, hz| Timing { ticks, tick_hz: Some(hz), rate_hz: Some(hz), ..Timing::default() };
    let counted = timing(Ticks::Measurements, 240.0);
    let uncounted = timing(Ticks::None, 60.0);
    let mut clocks = [counted, uncounted].map(|timing| ClockMap::new(ClockSettings::new(&timing, 0)));
    let rows = [0.1, 0.0, 0.0, 0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0];
    let mut region = TimedPairing::new(TimedOptions {
        pairing: PairingOptions {
            statics: vec![StaticTransform::new("Image", "Probe", &rows).unwrap()],
            ..PairingOptions::default()
        },
        sources: vec![Source::new("Probe", "Tracker"), Source::new("Reference", "Tracker")],
        kept: 256,
        ..TimedOptions::default()
    })
    .unwrap();
    let (mut random, mut placed, mut refused) = (12_345_u64, 0, 0);
    let mut draw = |most: i64| {
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((random >> 33) as i64) % most
    };
    let mut before = 0;
    for n in 0..240 * 60_i64 {
        if n == 240 * 15 {
            (before, placed, refused) = (ALLOCATIONS.with(Cell::get), 0, 0);
        }
        let at = n * 1_000_000_000 / 240;
        // Jitter, and an occasional stall of 300 ms; also a wrong stamp, a reset and a lost
        // record.
        let stalled = if n % 2000 > 1928 { (2000 - n % 2000) * 1_000_000_000 / 240 } else { 0 };
        let host = at + (3 * MS - draw(3 * MS)).max(stalled) - if n % 1777 == 0 { 60 * MS } else { 0 };
        if n % 331 == 0 {
            continue;
        }
        let tick = if n < 240 * 40 { n } else { n - 240 * 40 };
        let timed =
            [Some(clocks[0].push(host, Some(tick.unsigned_abs()))), (n % 4 == 0).then(|| clocks[1].push(host, None))];
        for (source, timed) in timed.into_iter().enumerate() {
            let Some(timed) = timed else { continue };
            let pose =
                Rigid { rotation: DQuat::from_rotation_x(n as f64 * 1e-4), position_mm: DVec3::X * n as f64 * 0.1 };
            let (time_ns, bound_ns, flags) = (timed.time_ns, timed.bound_ns, timed.flags);
            region.pose(source, PoseSample { time_ns, bound_ns, flags, pose, invalid: None });
        }
        clocks.iter_mut().for_each(|clock| {
            clock.advance(at);
            clock.take_published();
        });
        if n % 8 == 0 {
            let frame = FrameTime { time_ns: at - 20 * MS, bound_ns: MS, flags: Default::default(), size: [640, 480] };
            region.frame(frame, at, ());
        }
        while let Some(ready) = region.next(at) {
            match ready.answer {
                Ok(_) => placed += 1,
                Err(_) => refused += 1,
            }
        }
    }
    let allocations = ALLOCATIONS.with(Cell::get) - before;
    assert!(placed > 1000, "{placed}");
    assert_eq!(allocations, 0, "for {placed} frames placed and {refused} refused");
}
