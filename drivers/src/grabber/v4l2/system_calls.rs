//! The kernel interface of V4L2: one safe method per system call, with plain values. All `unsafe`
//! code of the driver is in this file and in `buffers`.
//!
//! Numbers that are newer than the kernel's headers, or that a driver invents, are passed on
//! unchanged. Nothing here is matched against a closed list, and names need not be UTF-8. The
//! crate `v4l` provides the structures and the numbers of the calls. Its own `Device` and
//! `Stream` are not used: they panic on an unknown field order, on a name truncated within a
//! character, and when a stream cannot be stopped. After one time-out its stream also queues a
//! queued buffer again and again.
#![allow(unsafe_code, reason = "ioctl and shared memory; each block is argued")]

use std::fs::{File, OpenOptions};
use std::os::fd::{AsFd, AsRawFd};
use std::os::unix::fs::OpenOptionsExt;
use std::path::Path;
use std::{io, mem};

use rustix::event::{PollFd, PollFlags, Timespec};
use v4l::sys as abi;
use v4l::v4l2::vidioc;

use crate::grabber::pixels::FourCc;

/// Constants of the interface.
pub(crate) mod number {
    pub(crate) const CAN_CAPTURE: u32 = v4l::sys::V4L2_CAP_VIDEO_CAPTURE;
    pub(crate) const CAN_CAPTURE_PLANES: u32 = v4l::sys::V4L2_CAP_VIDEO_CAPTURE_MPLANE;
    pub(crate) const CAN_STREAM: u32 = v4l::sys::V4L2_CAP_STREAMING;
    pub(crate) const INPUT_NO_POWER: u32 = v4l::sys::V4L2_IN_ST_NO_POWER;
    pub(crate) const INPUT_NO_SIGNAL: u32 = v4l::sys::V4L2_IN_ST_NO_SIGNAL;
    pub(crate) const INPUT_NO_LOCK: u32 =
        v4l::sys::V4L2_IN_ST_NO_H_LOCK | v4l::sys::V4L2_IN_ST_NO_V_LOCK | v4l::sys::V4L2_IN_ST_NO_SYNC;
    pub(crate) const INPUT_HAS_TIMINGS: u32 = v4l::sys::V4L2_IN_CAP_DV_TIMINGS;
    pub(crate) const INPUT_HAS_STANDARDS: u32 = v4l::sys::V4L2_IN_CAP_STD;
    pub(crate) const FLAG_ERROR: u32 = v4l::sys::V4L2_BUF_FLAG_ERROR;
    pub(crate) const FLAG_CLOCK: u32 = v4l::sys::V4L2_BUF_FLAG_TIMESTAMP_MASK;
    pub(crate) const FLAG_CLOCK_MONOTONIC: u32 = v4l::sys::V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC;
    pub(crate) const FLAG_INSTANT: u32 = v4l::sys::V4L2_BUF_FLAG_TSTAMP_SRC_MASK;
    pub(crate) const FLAG_INSTANT_START: u32 = v4l::sys::V4L2_BUF_FLAG_TSTAMP_SRC_SOE;
    pub(crate) const SPACE_JPEG: u32 = v4l::sys::v4l2_colorspace_V4L2_COLORSPACE_JPEG;
    pub(crate) const SPACE_709: u32 = v4l::sys::v4l2_colorspace_V4L2_COLORSPACE_REC709;
    pub(crate) const ENCODING_601: u32 = v4l::sys::v4l2_ycbcr_encoding_V4L2_YCBCR_ENC_601;
    pub(crate) const ENCODING_709: u32 = v4l::sys::v4l2_ycbcr_encoding_V4L2_YCBCR_ENC_709;
    pub(crate) const QUANTIZATION_FULL: u32 = v4l::sys::v4l2_quantization_V4L2_QUANTIZATION_FULL_RANGE;
    pub(crate) const QUANTIZATION_LIMITED: u32 = v4l::sys::v4l2_quantization_V4L2_QUANTIZATION_LIM_RANGE;
    pub(crate) const FIELD_TOP: u32 = v4l::sys::v4l2_field_V4L2_FIELD_TOP;
    pub(crate) const FIELD_BOTTOM: u32 = v4l::sys::v4l2_field_V4L2_FIELD_BOTTOM;
    pub(crate) const FIELD_INTERLACED: u32 = v4l::sys::v4l2_field_V4L2_FIELD_INTERLACED;
    pub(crate) const FIELD_SEQ_TB: u32 = v4l::sys::v4l2_field_V4L2_FIELD_SEQ_TB;
    pub(crate) const FIELD_SEQ_BT: u32 = v4l::sys::v4l2_field_V4L2_FIELD_SEQ_BT;
    pub(crate) const FIELD_ALTERNATE: u32 = v4l::sys::v4l2_field_V4L2_FIELD_ALTERNATE;
    pub(crate) const FIELD_INTERLACED_TB: u32 = v4l::sys::v4l2_field_V4L2_FIELD_INTERLACED_TB;
    pub(crate) const FIELD_INTERLACED_BT: u32 = v4l::sys::v4l2_field_V4L2_FIELD_INTERLACED_BT;
    /// Analogue standards of 525 lines and 60 fields per second.
    pub(crate) const STANDARD_NTSC: u64 = 0xb000;
    /// All standards of 525 lines: NTSC, PAL-M, PAL-60.
    pub(crate) const STANDARD_525: u64 = 0xf900;
    /// PAL of 625 lines and 50 fields per second.
    pub(crate) const STANDARD_PAL: u64 = 0xff;
    pub(crate) const STANDARD_SECAM: u64 = 0xff_0000;
}

pub(super) const CAPTURE: u32 = abi::v4l2_buf_type_V4L2_BUF_TYPE_VIDEO_CAPTURE;

/// Identity of a node.
#[derive(Debug, Clone)]
pub(crate) struct Identity {
    pub(crate) driver: String,
    pub(crate) card: String,
    pub(crate) bus: String,
    /// Capabilities of this node (`device_caps`).
    pub(crate) can: u32,
}

/// An input: a socket, or a device's only source.
#[derive(Debug, Clone)]
pub(crate) struct Input {
    pub(crate) index: u32,
    pub(crate) name: String,
    /// Analogue standards that the input accepts.
    pub(crate) standards: u64,
    pub(crate) can: u32,
}

/// Sizes of a format.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Sizes {
    One([u32; 2]),
    /// Minimum, maximum and step of width and height.
    Steps {
        least: [u32; 2],
        most: [u32; 2],
        step: [u32; 2],
    },
}

/// The current format.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Format {
    pub(crate) fourcc: FourCc,
    pub(crate) size: [u32; 2],
    pub(crate) row_bytes: u32,
    pub(crate) field: u32,
    pub(crate) space: u32,
    pub(crate) encoding: u32,
    pub(crate) quantization: u32,
}

/// The used fields of digital timings, and the kernel's own record for setting them.
#[derive(Clone, Copy)]
pub(crate) struct Timings {
    record: abi::v4l2_dv_timings,
    /// Frames per second; 0 if unknown.
    pub(crate) rate: f64,
}

/// Result of [`Node::wait`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Ready {
    /// A buffer is filled.
    pub(crate) buffer: bool,
    /// An event is pending.
    pub(crate) event: bool,
    /// There is no stream, it is broken, or the device is gone: the next call reports which.
    pub(crate) trouble: bool,
}

/// An opened device node.
#[derive(Debug)]
pub(crate) struct Node {
    file: File,
}

impl Node {
    pub(crate) fn open(path: &Path) -> io::Result<Self> {
        // Non-blocking: a missing buffer must never block the device's thread.
        let nonblocking = rustix::fs::OFlags::NONBLOCK.bits().cast_signed();
        let file = OpenOptions::new().read(true).write(true).custom_flags(nonblocking).open(path)?;
        Ok(Self { file })
    }

    /// Returns the file, for mapping buffers.
    pub(super) const fn file(&self) -> &File {
        &self.file
    }

    /// Makes the call `request` on `argument`; repeats it when a signal interrupts it.
    pub(super) fn call<T: Plain>(&self, request: vidioc::_IOC_TYPE, argument: &mut T) -> io::Result<()> {
        let size = usize::try_from((request >> 16) & 0x3fff).unwrap_or(usize::MAX);
        assert_eq!(size, size_of::<T>(), "the structure is not the one of this call");
        loop {
            // SAFETY: the descriptor is open for as long as `self` is. The kernel reads and
            // writes as many bytes at the pointer as the request's number states. The assertion
            // above ensures that this is the size of the pointee. `Plain` data has a value for
            // every pattern of bits, and the kernel follows no pointer in it.
            let outcome =
                unsafe { v4l::v4l2::ioctl(self.file.as_raw_fd(), request, std::ptr::from_mut(argument).cast()) };
            match outcome {
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                outcome => return outcome,
            }
        }
    }

    pub(crate) fn identity(&self) -> io::Result<Identity> {
        let mut own: abi::v4l2_capability = zeroed();
        self.call(vidioc::VIDIOC_QUERYCAP, &mut own)?;
        let of_node = own.capabilities & abi::V4L2_CAP_DEVICE_CAPS != 0;
        Ok(Identity {
            driver: text(&own.driver),
            card: text(&own.card),
            bus: text(&own.bus_info),
            can: if of_node { own.device_caps } else { own.capabilities },
        })
    }

    pub(crate) fn inputs(&self) -> Vec<Input> {
        (0..).map_while(|index| self.input_at(index).ok()).take(64).collect()
    }

    fn input_at(&self, index: u32) -> io::Result<Input> {
        let mut input = abi::v4l2_input { index, ..zeroed() };
        self.call(vidioc::VIDIOC_ENUMINPUT, &mut input)?;
        Ok(Input { index, name: text(&input.name), standards: input.std, can: input.capabilities })
    }

    /// Returns the present status of an input's source.
    pub(crate) fn input_status(&self, index: u32) -> io::Result<u32> {
        let mut input = abi::v4l2_input { index, ..zeroed() };
        self.call(vidioc::VIDIOC_ENUMINPUT, &mut input)?;
        Ok(input.status)
    }

    pub(crate) fn input(&self) -> io::Result<u32> {
        let mut index = 0_i32;
        self.call(vidioc::VIDIOC_G_INPUT, &mut index)?;
        u32::try_from(index).map_err(|_| io::ErrorKind::InvalidData.into())
    }

    pub(crate) fn set_input(&self, index: u32) -> io::Result<()> {
        self.call(vidioc::VIDIOC_S_INPUT, &mut index.cast_signed())
    }

    /// Returns the analogue standard that the device detects.
    pub(crate) fn query_standard(&self) -> io::Result<u64> {
        let mut standard = 0_u64;
        self.call(vidioc::VIDIOC_QUERYSTD, &mut standard)?;
        Ok(standard)
    }

    /// Returns the current analogue standard.
    pub(crate) fn standard(&self) -> io::Result<u64> {
        let mut standard = 0_u64;
        self.call(vidioc::VIDIOC_G_STD, &mut standard)?;
        Ok(standard)
    }

    pub(crate) fn set_standard(&self, mut standard: u64) -> io::Result<()> {
        self.call(vidioc::VIDIOC_S_STD, &mut standard)
    }

    /// Returns the digital timings that the device detects.
    pub(crate) fn query_timings(&self) -> io::Result<Timings> {
        self.timings_by(vidioc::VIDIOC_QUERY_DV_TIMINGS)
    }

    /// Returns the current digital timings.
    pub(crate) fn timings(&self) -> io::Result<Timings> {
        self.timings_by(vidioc::VIDIOC_G_DV_TIMINGS)
    }

    fn timings_by(&self, request: vidioc::_IOC_TYPE) -> io::Result<Timings> {
        let mut record: abi::v4l2_dv_timings = zeroed();
        self.call(request, &mut record)?;
        // SAFETY: all members of the union are integers, so any bits are values of each of them.
        let bt = unsafe { record.__bindgen_anon_1.bt };
        let across = [bt.width, bt.hfrontporch, bt.hsync, bt.hbackporch];
        let interlaced = bt.interlaced & abi::V4L2_DV_INTERLACED != 0;
        let mut down = vec![bt.height, bt.vfrontporch, bt.vsync, bt.vbackporch];
        if interlaced {
            down.extend([bt.il_vfrontporch, bt.il_vsync, bt.il_vbackporch]);
        }
        let total = |parts: &[u32]| parts.iter().map(|&part| f64::from(part)).sum::<f64>();
        let whole = total(&across) * total(&down);
        let clock = bt.pixelclock as f64;
        Ok(Timings { record, rate: if whole > 0.0 { clock / whole } else { 0.0 } })
    }

    pub(crate) fn set_timings(&self, timings: &Timings) -> io::Result<()> {
        self.call(vidioc::VIDIOC_S_DV_TIMINGS, &mut timings.record.clone())
    }

    pub(crate) fn formats(&self) -> Vec<FourCc> {
        let at = |index| {
            let mut format = abi::v4l2_fmtdesc { index, type_: CAPTURE, ..zeroed() };
            self.call(vidioc::VIDIOC_ENUM_FMT, &mut format).ok()?;
            Some(format.pixelformat.to_le_bytes())
        };
        (0..).map_while(at).take(256).collect()
    }

    pub(crate) fn sizes(&self, fourcc: FourCc) -> Vec<Sizes> {
        let at = |index| {
            let mut sizes = abi::v4l2_frmsizeenum { index, pixel_format: u32::from_le_bytes(fourcc), ..zeroed() };
            self.call(vidioc::VIDIOC_ENUM_FRAMESIZES, &mut sizes).ok()?;
            // SAFETY: a union of integers, as in the timings.
            Some(unsafe {
                if sizes.type_ == abi::v4l2_frmsizetypes_V4L2_FRMSIZE_TYPE_DISCRETE {
                    let one = sizes.__bindgen_anon_1.discrete;
                    Sizes::One([one.width, one.height])
                } else {
                    let range = sizes.__bindgen_anon_1.stepwise;
                    Sizes::Steps {
                        least: [range.min_width, range.min_height],
                        most: [range.max_width, range.max_height],
                        step: [range.step_width, range.step_height],
                    }
                }
            })
        };
        (0..).map_while(at).take(256).collect()
    }

    /// Returns the available frame intervals in seconds, the shortest of each range; empty if the
    /// driver does not report them.
    pub(crate) fn intervals(&self, fourcc: FourCc, [width, height]: [u32; 2]) -> Vec<[u32; 2]> {
        let at = |index| {
            let pixel_format = u32::from_le_bytes(fourcc);
            let mut interval = abi::v4l2_frmivalenum { index, pixel_format, width, height, ..zeroed() };
            self.call(vidioc::VIDIOC_ENUM_FRAMEINTERVALS, &mut interval).ok()?;
            // SAFETY: a union of integers, as in the timings.
            let fraction = unsafe {
                if interval.type_ == abi::v4l2_frmivaltypes_V4L2_FRMIVAL_TYPE_DISCRETE {
                    interval.__bindgen_anon_1.discrete
                } else {
                    interval.__bindgen_anon_1.stepwise.min
                }
            };
            Some([fraction.numerator, fraction.denominator])
        };
        (0..).map_while(at).take(256).collect()
    }

    pub(crate) fn format(&self) -> io::Result<Format> {
        let mut format = abi::v4l2_format { type_: CAPTURE, ..zeroed() };
        self.call(vidioc::VIDIOC_G_FMT, &mut format)?;
        Ok(of_format(&format))
    }

    /// Requests a format; returns the driver's choice, which may differ.
    pub(crate) fn set_format(&self, fourcc: FourCc, [width, height]: [u32; 2], field: u32) -> io::Result<Format> {
        let mut format = abi::v4l2_format { type_: CAPTURE, ..zeroed() };
        let pixelformat = u32::from_le_bytes(fourcc);
        format.fmt.pix = abi::v4l2_pix_format { width, height, pixelformat, field, ..zeroed() };
        self.call(vidioc::VIDIOC_S_FMT, &mut format)?;
        Ok(of_format(&format))
    }

    /// Returns the frame interval in seconds, as a fraction, and whether it can be set.
    pub(crate) fn interval(&self) -> io::Result<([u32; 2], bool)> {
        let mut parameters = abi::v4l2_streamparm { type_: CAPTURE, ..zeroed() };
        self.call(vidioc::VIDIOC_G_PARM, &mut parameters)?;
        Ok(of_parameters(&parameters))
    }

    pub(crate) fn set_interval(&self, [numerator, denominator]: [u32; 2]) -> io::Result<()> {
        let mut parameters = abi::v4l2_streamparm { type_: CAPTURE, ..zeroed() };
        parameters.parm.capture =
            abi::v4l2_captureparm { timeperframe: abi::v4l2_fract { numerator, denominator }, ..zeroed() };
        self.call(vidioc::VIDIOC_S_PARM, &mut parameters)
    }

    /// Subscribes to changes of the source. Few drivers support this.
    pub(crate) fn subscribe_source_change(&self, input: u32) -> io::Result<()> {
        let mut subscription =
            abi::v4l2_event_subscription { type_: abi::V4L2_EVENT_SOURCE_CHANGE, id: input, ..zeroed() };
        self.call(vidioc::VIDIOC_SUBSCRIBE_EVENT, &mut subscription)
    }

    /// Takes the oldest event; returns whether it is a change of the source.
    pub(crate) fn event(&self) -> io::Result<bool> {
        let mut event: abi::v4l2_event = zeroed();
        self.call(vidioc::VIDIOC_DQEVENT, &mut event)?;
        Ok(event.type_ == abi::V4L2_EVENT_SOURCE_CHANGE)
    }

    /// Waits for an event, at most `nanoseconds`.
    pub(crate) fn wait(&self, nanoseconds: i64) -> io::Result<Ready> {
        let events = PollFlags::IN | PollFlags::PRI;
        let mut polled = [PollFd::from_borrowed_fd(self.file.as_fd(), events)];
        let timeout =
            Timespec { tv_sec: nanoseconds.max(0) / 1_000_000_000, tv_nsec: nanoseconds.max(0) % 1_000_000_000 };
        match rustix::event::poll(&mut polled, Some(&timeout)) {
            Ok(_) => {
                let seen = polled[0].revents();
                Ok(Ready {
                    buffer: seen.contains(PollFlags::IN),
                    event: seen.contains(PollFlags::PRI),
                    trouble: seen.intersects(PollFlags::ERR | PollFlags::HUP | PollFlags::NVAL),
                })
            }
            // The caller checks its deadline and calls again.
            Err(rustix::io::Errno::INTR) => Ok(Ready { buffer: false, event: false, trouble: false }),
            Err(error) => Err(error.into()),
        }
    }
}

/// Returns a structure of the interface with all fields zero.
pub(super) fn zeroed<T: Plain>() -> T {
    // SAFETY: all zeros is a value of a `Plain` type.
    unsafe { mem::zeroed() }
}

/// Data that may be passed to the kernel.
///
/// # Safety
/// Every pattern of bits, all zeros included, must be a value of the type. If it holds a pointer,
/// the kernel must not follow it for buffers of our kind.
pub(super) unsafe trait Plain {}

macro_rules! plain {
    ($($name:ty)*) => { $(
        // SAFETY: integers, and structures and unions of them. The pointers in some of them are
        // for planes and for user memory, which we do not use.
        unsafe impl Plain for $name {}
    )* };
}

plain! {
    i32 u64 abi::v4l2_capability abi::v4l2_input abi::v4l2_dv_timings abi::v4l2_fmtdesc abi::v4l2_frmsizeenum abi::v4l2_frmivalenum abi::v4l2_format
    abi::v4l2_pix_format abi::v4l2_streamparm abi::v4l2_captureparm abi::v4l2_event_subscription abi::v4l2_event abi::v4l2_requestbuffers abi::v4l2_buffer
}

/// Returns the text up to the first NUL; invalid UTF-8 is replaced.
fn text(bytes: &[u8]) -> String {
    let end = bytes.iter().position(|&byte| byte == 0).unwrap_or(bytes.len());
    String::from_utf8_lossy(&bytes[..end]).into_owned()
}

fn of_format(format: &abi::v4l2_format) -> Format {
    // SAFETY: unions of integers, as in the timings; for a capture buffer the kernel fills this
    // member.
    let pix = unsafe { format.fmt.pix };
    Format {
        fourcc: pix.pixelformat.to_le_bytes(),
        size: [pix.width, pix.height],
        row_bytes: pix.bytesperline,
        field: pix.field,
        space: pix.colorspace,
        // SAFETY: a union of integers, as above.
        encoding: unsafe { pix.__bindgen_anon_1.ycbcr_enc },
        quantization: pix.quantization,
    }
}

fn of_parameters(parameters: &abi::v4l2_streamparm) -> ([u32; 2], bool) {
    // SAFETY: unions of integers, as in the timings; for a capture buffer the kernel fills this
    // member.
    let capture = unsafe { parameters.parm.capture };
    let abi::v4l2_fract { numerator, denominator } = capture.timeperframe;
    ([numerator, denominator], capture.capability & abi::V4L2_CAP_TIMEPERFRAME != 0)
}
