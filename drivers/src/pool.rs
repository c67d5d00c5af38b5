//! Buffers of pictures that are used again.

use std::sync::Arc;

/// Lends out pictures' buffers and takes them back when nobody else holds them: no allocation a frame while the consumer keeps up.
pub(crate) struct Pool {
    bytes: usize,
    buffers: Vec<Arc<[u8]>>,
}

/// Buffers kept; who holds more frames than that at a time gets further ones that are not kept.
const KEPT: usize = 8;

impl Pool {
    pub(crate) const fn new(bytes: usize) -> Self {
        Self { bytes, buffers: Vec::new() }
    }

    /// A buffer that `fill` has filled. Its earlier content is arbitrary.
    pub(crate) fn fill<E>(&mut self, fill: impl FnOnce(&mut [u8]) -> Result<(), E>) -> Result<Arc<[u8]>, E> {
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
    fn buffers_come_back_when_they_are_dropped_and_never_while_they_are_held() {
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
