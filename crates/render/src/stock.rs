//! Boxes that another thread makes before they are needed.
//!
//! A sweep fills hundreds of new bricks per slice. A thread that made each box when it needs it
//! would wait for fresh pages of memory, which takes longer than filling them.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};
use std::thread::JoinHandle;

use crate::region::RenderRegion;

/// Updates before any boxes are made in advance: a volume that is read once needs none.
const UPDATES_BEFORE: u32 = 2;

/// Most bricks in stock: a slice of 256² pixels and 0.5 mm reaches up to 1000 new ones.
const MOST: usize = 2048;

/// Returns the number of bricks of a region to be made in advance.
pub(crate) fn stocked(region: &RenderRegion) -> usize {
    let bricks: usize = region.bricks().iter().map(|n| *n as usize).product();
    (bricks / 8).min(MOST)
}

/// Equal boxes.
pub(crate) struct Stock<T> {
    blank: fn() -> Box<T>,
    /// Most boxes that are ready. Half as many more are being made.
    most: usize,
    updates: u32,
    ready: Mutex<Vec<Box<T>>>,
    making: Option<JoinHandle<Vec<Box<T>>>>,
    /// Boxes made when they were needed, since the last update.
    late: AtomicU64,
}

impl<T: Send + 'static> Stock<T> {
    /// Returns an empty stock of the boxes that `blank` makes. `most` of them are made ready; 0
    /// makes each when it is needed.
    pub(crate) fn new(blank: fn() -> Box<T>, most: usize) -> Self {
        let (ready, late) = (Mutex::default(), AtomicU64::new(0));
        Self { blank, most, updates: 0, ready, making: None, late }
    }

    /// Sets how many boxes are made ready.
    pub(crate) fn hold(&mut self, most: usize) {
        // Half of the new number are being made from now on.
        let made = self.making.take().and_then(|thread| thread.join().ok());
        self.ready.get_mut().unwrap_or_else(PoisonError::into_inner).extend(made.unwrap_or_default());
        self.most = most;
    }

    /// Returns a box; makes it if none is ready.
    pub(crate) fn take(&self) -> Box<T> {
        let ready = self.ready.lock().unwrap_or_else(PoisonError::into_inner).pop();
        ready.unwrap_or_else(|| {
            self.late.fetch_add(1, Ordering::Relaxed);
            (self.blank)()
        })
    }

    /// Ends an update; returns how many of the boxes that it took were not ready. Another thread
    /// makes more if few are left.
    pub(crate) fn refill(&mut self) -> u64 {
        let late = std::mem::take(self.late.get_mut());
        self.updates = self.updates.saturating_add(1);
        let (blank, half) = (self.blank, self.most / 2);
        let ready = self.ready.get_mut().unwrap_or_else(PoisonError::into_inner);
        if self.updates < UPDATES_BEFORE || half == 0 {
            return late;
        }
        if ready.len() <= half {
            // Waits for the thread if it has not finished, so that the numbers depend on nothing
            // else.
            ready.extend(self.making.take().and_then(|thread| thread.join().ok()).unwrap_or_default());
        }
        if self.making.is_none() {
            // If no thread can be started, each box is made when it is needed.
            let make = move || (0..half).map(|_| blank()).collect();
            self.making = std::thread::Builder::new().name("render-memory".into()).spawn(make).ok();
        }
        late
    }

    /// Returns the boxes in stock, and those that are being made.
    pub(crate) fn len(&self) -> usize {
        let ready = self.ready.lock().unwrap_or_else(PoisonError::into_inner).len();
        ready + if self.making.is_some() { self.most / 2 } else { 0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_are_made_ahead_once_a_volume_grows() {
        let update = |stock: &mut Stock<u8>, n: usize| {
            (0..n).for_each(|_| assert_eq!(*stock.take(), 7));
            (stock.refill(), stock.len())
        };
        let mut stock = Stock::new(|| Box::new(7_u8), 8);
        assert_eq!(update(&mut stock, 3), (3, 0));
        assert_eq!(update(&mut stock, 2), (2, 4));
        // Those of the thread are taken over at the next update, and others begun.
        assert_eq!(update(&mut stock, 0), (0, 8));
        assert_eq!(update(&mut stock, 0), (0, 12));
        assert_eq!(update(&mut stock, 3), (0, 9));
        assert_eq!(update(&mut stock, 2), (0, 11));
        // More than are ready.
        assert_eq!(update(&mut stock, 9), (2, 8));
        let mut none = Stock::new(|| Box::new(7_u8), 0);
        assert_eq!([1, 1, 1].map(|n| update(&mut none, n)), [(1, 0); 3]);
    }
}
