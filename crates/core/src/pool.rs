//! Reusable pixel buffers.

use std::sync::Arc;

/// Lends frame buffers and reuses them once no consumer holds them: no allocation per frame
/// while the consumer keeps up.
pub struct Pool {
    bytes: usize,
    buffers: Vec<Arc<[u8]>>,
}

/// Number of buffers kept. A consumer that holds more frames receives additional buffers, which
/// are not kept.
const KEPT: usize = 8;

impl Pool {
    /// Returns a pool of buffers of this size.
    pub const fn new(bytes: usize) -> Self {
        Self { bytes, buffers: Vec::new() }
    }

    /// Returns a buffer filled by `fill`. Its earlier content is arbitrary.
    pub fn fill<E>(&mut self, fill: impl FnOnce(&mut [u8]) -> Result<(), E>) -> Result<Arc<[u8]>, E> {
        for buffer in &mut self.buffers {
            if let Some(bytes) = Arc::get_mut(buffer) {
                fill(bytes)?;
                return Ok(Arc::clone(buffer));
            }
        }
        let mut buffer: Arc<[u8]> = std::iter::repeat_n(0, self.bytes).collect();
        if let Some(bytes) = Arc::get_mut(&mut buffer) {
            fill(bytes)?;
        }
        if self.buffers.len() < KEPT {
            self.buffers.push(Arc::clone(&buffer));
        }
        Ok(buffer)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pool_reuses_dropped_buffers_only() {
        let mut pool = Pool::new(4);
        let mut with = |value: u8| {
            pool.fill(|out| {
                out.fill(value);
                Ok::<(), ()>(())
            })
            .unwrap()
        };
        let first = with(1);
        let second = with(2);
        assert_eq!((&*first, &*second), (&[1; 4][..], &[2; 4][..]));
        let address = first.as_ptr();
        drop(first);
        let third = with(3);
        assert_eq!(third.as_ptr(), address);
        assert_eq!(&*second, &[2; 4]);
        let held: Vec<_> = (0..20).map(&mut with).collect();
        assert!(held.iter().enumerate().all(|(n, buffer)| **buffer == [n as u8; 4]));
        drop(held);
        assert!(pool.buffers.len() <= KEPT);
    }
}
