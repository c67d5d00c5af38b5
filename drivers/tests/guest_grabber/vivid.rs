//! vivid, the kernel's virtual video device: its controls, and its output, whose frames its
//! input returns.
#![allow(unsafe_code, reason = "ioctl and shared memory, as in the driver under test but for outputs")]

use std::fs::{File, OpenOptions};
use std::os::fd::{AsFd, AsRawFd};
use std::os::unix::fs::OpenOptionsExt;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::{io, mem};

use memmap2::{MmapMut, MmapOptions};
use rustix::event::{PollFd, PollFlags, Timespec};
use v4l::sys as abi;
use v4l::v4l2::vidioc;

pub(crate) const CAPTURE_NODE: &str = "/dev/video0";
pub(crate) const OUTPUT_NODE: &str = "/dev/video1";

/// vivid's controls, by name: their numbers differ between kernels.
pub(crate) mod control {
    pub(crate) const OSD_TEXT: &str = "OSD Text Mode";
    pub(crate) const LOOP_VIDEO: &str = "Loop Video";
    pub(crate) const SEQUENCE_WRAP: &str = "Wrap Sequence Number";
    /// 0 the timings in force, 1 no signal, 2 not locked, 3 out of range, 4 the timings given
    /// by [`DV_TIMINGS`].
    pub(crate) const DV_SIGNAL: &str = "DV Timings Signal Mode";
    /// Timings by their index in a list.
    pub(crate) const DV_TIMINGS: &str = "DV Timings";
    pub(crate) const PERCENT_DROPPED: &str = "Percentage of Dropped Buffers";
    pub(crate) const DISCONNECT: &str = "Disconnect";
    pub(crate) const ERROR_FLAG: &str = "Inject V4L2_BUF_FLAG_ERROR";
    pub(crate) const REFUSE_BUFFERS: &str = "Inject VIDIOC_REQBUFS Error";
    pub(crate) const REFUSE_QUEUE: &str = "Inject VIDIOC_QBUF Error";
    pub(crate) const REFUSE_START: &str = "Inject VIDIOC_STREAMON Error";
    pub(crate) const BREAK: &str = "Inject Fatal Streaming Error";
}

/// A device node, opened in addition to the driver under test.
pub(crate) struct Vivid {
    file: File,
}

impl Vivid {
    pub(crate) fn open(node: &str) -> Self {
        let flags = rustix::fs::OFlags::NONBLOCK.bits().cast_signed();
        let file = OpenOptions::new().read(true).write(true).custom_flags(flags).open(node).unwrap();
        Self { file }
    }

    fn call<T>(&self, request: u64, argument: &mut T) -> io::Result<()> {
        assert_eq!((request >> 16) as usize & 0x3fff, size_of::<T>());
        // SAFETY: the kernel accesses as many bytes as the request's number states, which is
        // the size of the structure. All structures used below consist of integers, unions of
        // them, and pointers that the kernel does not follow for mapped buffers.
        unsafe { v4l::v4l2::ioctl(self.file.as_raw_fd(), request, std::ptr::from_mut(argument).cast()) }
    }

    pub(crate) fn set(&self, control: &str, value: i32) {
        let id = self.number_of(control);
        self.call(vidioc::VIDIOC_S_CTRL, &mut abi::v4l2_control { id, value })
            .unwrap_or_else(|error| panic!("{control} = {value}: {error}"));
    }

    fn number_of(&self, control: &str) -> u32 {
        let mut names = Vec::new();
        let mut id = 0;
        loop {
            // SAFETY: consists of integers, for which zero is valid.
            let mut requested: abi::v4l2_queryctrl = unsafe { mem::zeroed() };
            requested.id = id | abi::V4L2_CTRL_FLAG_NEXT_CTRL;
            if self.call(vidioc::VIDIOC_QUERYCTRL, &mut requested).is_err() {
                panic!("vivid has no control {control}; it has {names:?}");
            }
            id = requested.id;
            let end = requested.name.iter().position(|&byte| byte == 0).unwrap_or(requested.name.len());
            let name = String::from_utf8_lossy(&requested.name[..end]).into_owned();
            // The kernel cuts names at 31 bytes.
            if control == name || (name.len() == 31 && control.starts_with(&name)) {
                return id;
            }
            names.push(name);
        }
    }

    pub(crate) fn set_input(&self, input: i32) {
        self.call(vidioc::VIDIOC_S_INPUT, &mut { input }).unwrap();
    }

    /// Returns timings of this size and rate, progressive.
    fn timings(&self, size: [u32; 2], hz: f64) -> abi::v4l2_dv_timings {
        for index in 0.. {
            // SAFETY: consists of integers and unions of them, for which zero is valid.
            let mut entry: abi::v4l2_enum_dv_timings = unsafe { mem::zeroed() };
            entry.index = index;
            if self.call(vidioc::VIDIOC_ENUM_DV_TIMINGS, &mut entry).is_err() {
                break;
            }
            let timings = entry.timings;
            // SAFETY: a union of integers.
            let bt = unsafe { timings.__bindgen_anon_1.bt };
            let across = bt.width + bt.hfrontporch + bt.hsync + bt.hbackporch;
            let down = bt.height + bt.vfrontporch + bt.vsync + bt.vbackporch;
            let rate = bt.pixelclock as f64 / f64::from(across) / f64::from(down);
            if [bt.width, bt.height] == size && bt.interlaced == 0 && (rate - hz).abs() < 0.5 {
                return timings;
            }
        }
        panic!("vivid knows no timings of {size:?} at {hz}");
    }

    pub(crate) fn set_timings(&self, size: [u32; 2], hz: f64) {
        let mut timings = self.timings(size, hz);
        self.call(vidioc::VIDIOC_S_DV_TIMINGS, &mut timings).unwrap();
    }

    /// Sets the output's format; returns the bytes per line and per buffer.
    fn set_output_format(&self, fourcc: [u8; 4], [width, height]: [u32; 2]) -> [usize; 2] {
        // SAFETY: consists of integers and unions of them, for which zero is valid.
        let mut format: abi::v4l2_format = unsafe { mem::zeroed() };
        format.type_ = OUTPUT;
        // SAFETY: consists of integers, for which zero is valid.
        let zero: abi::v4l2_pix_format = unsafe { mem::zeroed() };
        let pixelformat = u32::from_le_bytes(fourcc);
        format.fmt.pix = abi::v4l2_pix_format { width, height, pixelformat, field: 1, ..zero };
        self.call(vidioc::VIDIOC_S_FMT, &mut format).unwrap();
        // SAFETY: a union of integers.
        let pix = unsafe { format.fmt.pix };
        assert_eq!((pix.pixelformat.to_le_bytes(), [pix.width, pix.height]), (fourcc, [width, height]));
        [pix.bytesperline as usize, pix.sizeimage as usize]
    }

    /// Restores vivid's initial state, whatever a test has left.
    pub(crate) fn reset() {
        let vivid = Self::open(CAPTURE_NODE);
        vivid.set(control::PERCENT_DROPPED, 0);
        vivid.set(control::SEQUENCE_WRAP, 0);
        vivid.set_input(1);
        vivid.set(control::DV_SIGNAL, 0);
        vivid.set(control::OSD_TEXT, 2);
        vivid.set(control::LOOP_VIDEO, 0);
        vivid.set_timings([640, 480], 60.0);
    }
}

const OUTPUT: u32 = abi::v4l2_buf_type_V4L2_BUF_TYPE_VIDEO_OUTPUT;
const MAPPED: u32 = abi::v4l2_memory_V4L2_MEMORY_MMAP;
const BUFFERS: u32 = 4;

/// Feeds frames to the output from its own thread until dropped.
pub(crate) struct Feeder {
    stop: Arc<AtomicBool>,
    fed: Arc<AtomicU64>,
    thread: Option<JoinHandle<()>>,
    /// Bytes per line and per frame of the output's format.
    pub(crate) row_bytes: usize,
    pub(crate) frame_bytes: usize,
}

impl Feeder {
    /// Loops the output back to the HDMI input, both with the same timings, and feeds it the
    /// frames that `paint` makes from their numbers.
    pub(crate) fn start(
        fourcc: [u8; 4],
        size: [u32; 2],
        hz: f64,
        paint: impl Fn(u64, &mut [u8]) + Send + 'static,
    ) -> Self {
        let capture = Vivid::open(CAPTURE_NODE);
        capture.set_input(1);
        capture.set_timings(size, hz);
        capture.set(control::OSD_TEXT, 2);
        capture.set(control::LOOP_VIDEO, 1);
        let output = Vivid::open(OUTPUT_NODE);
        output.set_timings(size, hz);
        let [row_bytes, frame_bytes] = output.set_output_format(fourcc, size);
        let stop = Arc::new(AtomicBool::new(false));
        let fed = Arc::new(AtomicU64::new(0));
        let (stopped, count) = (Arc::clone(&stop), Arc::clone(&fed));
        let thread = std::thread::Builder::new()
            .name("feeder".into())
            .spawn(move || feed(&output, frame_bytes, &stopped, &count, paint))
            .unwrap();
        Self { stop, fed, thread: Some(thread), row_bytes, frame_bytes }
    }

    /// Returns the number of frames handed over so far.
    pub(crate) fn fed(&self) -> u64 {
        self.fed.load(Ordering::Relaxed)
    }
}

impl Drop for Feeder {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take()
            && thread.join().is_err()
            && !std::thread::panicking()
        {
            panic!("the feeder failed");
        }
    }
}

fn buffer(index: u32) -> abi::v4l2_buffer {
    // SAFETY: consists of integers, and a union of integers and pointers that may be null.
    let zero: abi::v4l2_buffer = unsafe { mem::zeroed() };
    abi::v4l2_buffer { index, type_: OUTPUT, memory: MAPPED, ..zero }
}

fn feed(output: &Vivid, frame_bytes: usize, stop: &AtomicBool, fed: &AtomicU64, paint: impl Fn(u64, &mut [u8])) {
    // SAFETY: consists of integers, for which zero is valid.
    let zero: abi::v4l2_requestbuffers = unsafe { mem::zeroed() };
    let mut request = abi::v4l2_requestbuffers { count: BUFFERS, type_: OUTPUT, memory: MAPPED, ..zero };
    output.call(vidioc::VIDIOC_REQBUFS, &mut request).unwrap();
    let mut maps: Vec<MmapMut> = (0..request.count)
        .map(|index| {
            let mut requested = buffer(index);
            output.call(vidioc::VIDIOC_QUERYBUF, &mut requested).unwrap();
            // SAFETY: the kernel's buffer of this length at this offset; it is written only
            // while it is not queued.
            unsafe {
                let offset = requested.m.offset;
                MmapOptions::new().offset(offset.into()).len(requested.length as usize).map_mut(&output.file).unwrap()
            }
        })
        .collect();
    let mut number = 0;
    let mut queue = |index: u32| {
        paint(number, &mut maps[index as usize][..frame_bytes]);
        number += 1;
        let mut filled = buffer(index);
        filled.bytesused = u32::try_from(frame_bytes).unwrap();
        filled.field = 1;
        output.call(vidioc::VIDIOC_QBUF, &mut filled).unwrap();
        fed.store(number, Ordering::Relaxed);
    };
    (0..request.count).for_each(&mut queue);
    output.call(vidioc::VIDIOC_STREAMON, &mut OUTPUT.cast_signed()).unwrap();
    while !stop.load(Ordering::Relaxed) {
        let mut polled = [PollFd::from_borrowed_fd(output.file.as_fd(), PollFlags::OUT)];
        let timeout = Timespec { tv_sec: 0, tv_nsec: 100_000_000 };
        if rustix::event::poll(&mut polled, Some(&timeout)).unwrap_or(0) == 0 {
            continue;
        }
        let mut done = buffer(0);
        match output.call(vidioc::VIDIOC_DQBUF, &mut done) {
            Ok(()) => queue(done.index),
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => {}
            Err(error) => panic!("the output broke off: {error}"),
        }
    }
    output.call(vidioc::VIDIOC_STREAMOFF, &mut OUTPUT.cast_signed()).unwrap();
}
