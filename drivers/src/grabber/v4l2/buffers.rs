//! Buffers shared with the kernel, and the frames in them.
#![allow(unsafe_code, reason = "shared memory; each block is argued")]

use std::io;
use std::sync::Arc;

use memmap2::{MmapOptions, MmapRaw};
use v4l::sys as abi;
use v4l::v4l2::vidioc;

use super::system_calls::{CAPTURE, Node, zeroed};

const MAPPED: u32 = abi::v4l2_memory_V4L2_MEMORY_MMAP;

/// Description of a filled buffer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Filled {
    pub(crate) index: u32,
    /// Used bytes of the buffer.
    pub(crate) bytes: u32,
    pub(crate) flags: u32,
    pub(crate) field: u32,
    pub(crate) stamp_ns: i64,
    pub(crate) sequence: u32,
}

/// Buffers shared with the kernel, streaming for as long as this value lives.
///
/// Each buffer belongs either to the kernel (queued) or to us. Only [`Stream::read`] takes one,
/// and it gives it back after its closure has returned.
pub(crate) struct Stream {
    node: Arc<Node>,
    buffers: Vec<MmapRaw>,
    /// Buffers that the kernel refused to take back; offered again each time.
    returned: Vec<u32>,
}

impl Stream {
    /// Requests `count` buffers (the driver may change the number), queues all of them and starts
    /// streaming.
    pub(crate) fn start(node: Arc<Node>, count: u32) -> io::Result<Self> {
        let mut request = abi::v4l2_requestbuffers { count, type_: CAPTURE, memory: MAPPED, ..zeroed() };
        node.call(vidioc::VIDIOC_REQBUFS, &mut request)?;
        // From here on, `Drop` releases the buffers.
        let count = request.count.min(32);
        let mut stream = Self { node, buffers: Vec::new(), returned: Vec::with_capacity(count as usize) };
        for index in 0..count {
            let mut buffer = abi::v4l2_buffer { index, type_: CAPTURE, memory: MAPPED, ..zeroed() };
            stream.node.call(vidioc::VIDIOC_QUERYBUF, &mut buffer)?;
            // SAFETY: a union of integers, as in the timings, and of a pointer that is not
            // followed.
            let offset = unsafe { buffer.m.offset };
            let length = buffer.length as usize;
            stream.buffers.push(MmapOptions::new().offset(offset.into()).len(length).map_raw(stream.node.file())?);
        }
        if stream.buffers.is_empty() {
            return Err(io::Error::other("the driver gives no buffers"));
        }
        for index in 0..count {
            stream.queue(index)?;
        }
        stream.node.call(vidioc::VIDIOC_STREAMON, &mut CAPTURE.cast_signed())?;
        Ok(stream)
    }

    fn queue(&self, index: u32) -> io::Result<()> {
        let mut buffer = abi::v4l2_buffer { index, type_: CAPTURE, memory: MAPPED, ..zeroed() };
        self.node.call(vidioc::VIDIOC_QBUF, &mut buffer)
    }

    /// Passes the next filled buffer with its used bytes to `copy`, then returns it to the
    /// kernel. Returns `None` if no buffer is filled.
    pub(crate) fn read<R>(&mut self, copy: impl FnOnce(&Filled, &[u8]) -> R) -> io::Result<Option<R>> {
        self.give_back();
        let mut buffer = abi::v4l2_buffer { type_: CAPTURE, memory: MAPPED, ..zeroed() };
        match self.node.call(vidioc::VIDIOC_DQBUF, &mut buffer) {
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => return Ok(None),
            outcome => outcome?,
        }
        let filled = Filled {
            index: buffer.index,
            bytes: buffer.bytesused,
            flags: buffer.flags,
            field: buffer.field,
            stamp_ns: nanoseconds(buffer.timestamp.tv_sec, buffer.timestamp.tv_usec),
            sequence: buffer.sequence,
        };
        let Some(map) = self.buffers.get(filled.index as usize) else {
            return Err(io::Error::other("the driver hands out a buffer that it was not asked for"));
        };
        let length = (filled.bytes as usize).min(map.len());
        // SAFETY: the mapping has `map.len()` bytes and lives as long as `self`. The kernel does
        // not write to the buffer from the dequeuing above to the queuing below. No other
        // reference to it exists: `self` is borrowed mutably for that time, and the closure
        // cannot keep the slice.
        let bytes = unsafe { std::slice::from_raw_parts(map.as_ptr(), length) };
        let made = copy(&filled, bytes);
        self.returned.push(filled.index);
        self.give_back();
        Ok(Some(made))
    }

    /// Queues our buffers; refused ones are kept for the next call.
    fn give_back(&mut self) {
        let node = &self.node;
        self.returned.retain(|&index| {
            let mut buffer = abi::v4l2_buffer { index, type_: CAPTURE, memory: MAPPED, ..zeroed() };
            node.call(vidioc::VIDIOC_QBUF, &mut buffer).is_err()
        });
    }
}

impl Drop for Stream {
    fn drop(&mut self) {
        // Errors here mean that the device is gone or broken; the kernel frees the rest when the
        // node is closed.
        let _ = self.node.call(vidioc::VIDIOC_STREAMOFF, &mut CAPTURE.cast_signed());
        self.buffers.clear();
        let mut none = abi::v4l2_requestbuffers { count: 0, type_: CAPTURE, memory: MAPPED, ..zeroed() };
        let _ = self.node.call(vidioc::VIDIOC_REQBUFS, &mut none);
    }
}

fn nanoseconds(seconds: impl Into<i64>, microseconds: impl Into<i64>) -> i64 {
    seconds.into().saturating_mul(1_000_000_000).saturating_add(microseconds.into().saturating_mul(1000))
}
