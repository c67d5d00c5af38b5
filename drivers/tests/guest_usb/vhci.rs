//! A simulated USB device on the kernel's virtual host controller. The controller sends its
//! transfers through one end of a socket pair, and takes the bytes written there as the
//! device's answer. The protocol is USB/IP: a header of 48 bytes per transfer, big-endian.
//! Closing the socket unplugs the device.

use std::collections::VecDeque;
use std::fs;
use std::io::{Read, Write};
use std::os::fd::{AsFd, AsRawFd};
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, Timespec};

use drivers::transport::Peer;
use sonoweave_core::clock::{Clock, MS, Monotonic, SECOND};

use super::descriptors::Described;

const HEADER: usize = 48;
const CONTROLLER: &str = "/sys/devices/platform/vhci_hcd.0";
/// The kernel's status numbers of a transfer.
const STALLED: i32 = -32;
const UNLINKED: i32 = -104;
/// The longest sleep of the device's thread, ns.
const TURN: i64 = 5 * MS;

/// Division of a device's bytes into packets.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Cut {
    /// Bytes sent together begin a new packet.
    Records,
    /// Division anywhere, with occasional empty packets.
    Anywhere,
}

/// Behaviour of a device, and a record of its transfers.
pub(crate) struct State {
    pub(crate) cut: Cut,
    /// The device neither accepts nor sends anything: transfers wait.
    pub(crate) is_stuck: bool,
    /// The endpoints, to the host and from it, refuse all transfers until the host clears them.
    pub(crate) is_halted: [bool; 2],
    /// The device sends half of its next bytes and then unplugs itself.
    pub(crate) leaves_mid_record: bool,
    /// Reads that were pending when data was available: the fewest, the most.
    pub(crate) waited: Option<[usize; 2]>,
    /// Transfers sent by the host, in order, including empty ones.
    pub(crate) written: Vec<Vec<u8>>,
    /// Number of times the host has cleared an endpoint.
    pub(crate) cleared: usize,
    /// Number of reads pending now.
    pub(crate) waiting: usize,
    /// Number of packets sent.
    pub(crate) packets: u64,
}

/// A device that stays plugged in until this is dropped.
pub(crate) struct Plug {
    state: Arc<Mutex<State>>,
    line: UnixStream,
    thread: Option<JoinHandle<()>>,
    /// Time it was plugged in, host ns.
    pub(crate) since_ns: i64,
}

impl Plug {
    /// Plugs a device into a high-speed port of the controller, from 0. Its bulk endpoints
    /// connect the host with the peer.
    pub(crate) fn into<T: Peer + 'static>(port: usize, described: Described, peer: Arc<Mutex<T>>) -> Self {
        wait_until_free(port);
        let (ours, kernels) = UnixStream::pair().unwrap();
        let state = State {
            cut: Cut::Records,
            is_stuck: false,
            is_halted: [false; 2],
            leaves_mid_record: false,
            waited: None,
            written: Vec::new(),
            cleared: 0,
            waiting: 0,
            packets: 0,
        };
        let state = Arc::new(Mutex::new(state));
        let speed = if described.is_high_speed { 3 } else { 2 };
        let since_ns = Monotonic.now_ns();
        fs::write(format!("{CONTROLLER}/attach"), format!("{port} {} {} {speed}", kernels.as_raw_fd(), port + 2))
            .unwrap();
        drop(kernels);
        let line = ours.try_clone().unwrap();
        let device = Device {
            line: ours,
            described,
            peer,
            state: Arc::clone(&state),
            reads: VecDeque::new(),
            writes: VecDeque::new(),
            text: VecDeque::new(),
            random: fastrand::Rng::with_seed(11),
        };
        let thread = std::thread::Builder::new().name("device".into()).spawn(move || device.run()).unwrap();
        Self { state, line, thread: Some(thread), since_ns }
    }

    pub(crate) fn state(&self) -> MutexGuard<'_, State> {
        locked(&self.state)
    }

    /// Lets the device unplug itself in the middle of its next bytes.
    pub(crate) fn leave_mid_record(mut self) {
        self.state().leaves_mid_record = true;
        self.thread.take().unwrap().join().unwrap();
    }
}

impl Drop for Plug {
    fn drop(&mut self) {
        let _ = self.line.shutdown(std::net::Shutdown::Both);
        if let Some(thread) = self.thread.take()
            && thread.join().is_err()
            && !std::thread::panicking()
        {
            panic!("the device failed");
        }
    }
}

/// Locks also after a panic: a failed test must not stop the device's thread.
fn locked<T>(of: &Mutex<T>) -> MutexGuard<'_, T> {
    of.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Waits until the controller has released a port and the kernel has noticed that the device is
/// gone. Otherwise the next device would receive data sent to the old one.
fn wait_until_free(port: usize) {
    let end = Monotonic.now_ns() + 10 * SECOND;
    loop {
        let status = fs::read_to_string(format!("{CONTROLLER}/status")).unwrap();
        let mut ports = status.lines().skip(1).map(|line| line.split_whitespace().nth(2).unwrap());
        // VDEV_ST_NULL
        let is_free = ports.nth(port) == Some("004");
        if is_free && !Path::new(&format!("/sys/bus/usb/devices/1-{}", port + 1)).exists() {
            return;
        }
        assert!(Monotonic.now_ns() < end, "port {port} does not become free: {status}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// A pending transfer of the host.
struct Waits {
    number: u32,
    length: usize,
    /// Transfer to the host: the bytes so far. Transfer from the host: its bytes.
    bytes: Vec<u8>,
}

struct Device<T> {
    line: UnixStream,
    described: Described,
    peer: Arc<Mutex<T>>,
    state: Arc<Mutex<State>>,
    /// In order of arrival.
    reads: VecDeque<Waits>,
    writes: VecDeque<Waits>,
    /// Pieces to be sent.
    text: VecDeque<Vec<u8>>,
    random: fastrand::Rng,
}

fn word(bytes: &[u8], at: usize) -> u32 {
    u32::from_be_bytes(*bytes[at..].first_chunk().unwrap())
}

/// Closes the socket however the thread ends: the kernel would otherwise wait forever for
/// transfers.
impl<T> Drop for Device<T> {
    fn drop(&mut self) {
        let _ = self.line.shutdown(std::net::Shutdown::Both);
    }
}

impl<T: Peer> Device<T> {
    fn run(mut self) {
        loop {
            // Serves all requests of the host before sending anything.
            while self.is_asked_within(0) {
                if !self.serve() {
                    return;
                }
            }
            if !self.give() {
                return;
            }
            locked(&self.state).waiting = self.reads.len();
            let now = Monotonic.now_ns();
            let due = locked(&self.peer).due(now).unwrap_or(i64::MAX);
            if self.is_asked_within((due.min(now + TURN) - now).max(0)) && !self.serve() {
                return;
            }
        }
    }

    fn is_asked_within(&self, ns: i64) -> bool {
        let mut polled = [PollFd::from_borrowed_fd(self.line.as_fd(), PollFlags::IN)];
        rustix::event::poll(&mut polled, Some(&Timespec { tv_sec: 0, tv_nsec: ns })).unwrap_or(0) > 0
    }

    /// Sends available data to pending reads. Returns false after the device was unplugged.
    fn give(&mut self) -> bool {
        let state = Arc::clone(&self.state);
        let mut state = locked(&state);
        if state.is_stuck {
            return true;
        }
        while let Some(write) = self.writes.pop_front() {
            if state.is_halted[1] {
                if !self.answer(write.number, STALLED, 0, &[]) {
                    return false;
                }
                continue;
            }
            state.written.push(write.bytes.clone());
            locked(&self.peer).written(&write.bytes, 0, Monotonic.now_ns());
            if !self.answer(write.number, 0, write.length, &[]) {
                return false;
            }
        }
        if state.is_halted[0] {
            while let Some(read) = self.reads.pop_front() {
                if !self.answer(read.number, STALLED, 0, &[]) {
                    return false;
                }
            }
            return true;
        }
        let now = Monotonic.now_ns();
        // Errors of an unplugged peer are ignored; the socket reports unplugging here.
        if let Ok(Some((_, bytes))) = locked(&self.peer).next(0, now, now) {
            let waiting = self.reads.len();
            let [fewest, most] = state.waited.unwrap_or([waiting; 2]);
            state.waited = Some([fewest.min(waiting), most.max(waiting)]);
            self.text.push_back(bytes);
        }
        let packet = self.packet_to_host();
        while let Some(front) = self.text.front_mut()
            && let Some(read) = self.reads.front_mut()
        {
            let room = packet.min(read.length - read.bytes.len());
            let whole = front.len().min(room);
            let bytes = match state.cut {
                _ if state.leaves_mid_record => (front.len() / 2).min(room),
                Cut::Records => whole,
                Cut::Anywhere => self.random.usize(0..=whole),
            };
            read.bytes.extend(front.drain(..bytes));
            if front.is_empty() {
                self.text.pop_front();
            }
            state.packets += 1;
            // A packet that is not full ends a transfer.
            if (bytes < packet || read.bytes.len() == read.length)
                && let Some(Waits { number, bytes, .. }) = self.reads.pop_front()
                && !self.answer(number, 0, bytes.len(), &bytes)
            {
                return false;
            }
            if state.leaves_mid_record {
                return false;
            }
        }
        true
    }

    fn packet_to_host(&self) -> usize {
        let bulk = self.described.endpoints.iter().find(|e| e.kind == 2 && e.address & 0x80 != 0);
        bulk.map_or(64, |endpoint| self.described.packet(endpoint.address))
    }

    /// Reports the result of a transfer. Returns false if the host no longer listens.
    fn answer(&mut self, number: u32, status: i32, actual: usize, bytes: &[u8]) -> bool {
        let mut header = [0; HEADER];
        header[..4].copy_from_slice(&3_u32.to_be_bytes());
        header[4..8].copy_from_slice(&number.to_be_bytes());
        header[20..24].copy_from_slice(&status.to_be_bytes());
        header[24..28].copy_from_slice(&u32::try_from(actual).unwrap().to_be_bytes());
        self.line.write_all(&[&header, bytes].concat()).is_ok()
    }

    /// Handles one request. Returns false after the device was unplugged.
    fn serve(&mut self) -> bool {
        let mut header = [0; HEADER];
        if self.line.read_exact(&mut header).is_err() {
            return false;
        }
        let number = word(&header, 4);
        match word(&header, 0) {
            1 => {
                let (is_read, endpoint) = (word(&header, 12) == 1, word(&header, 16) as u8);
                let length = word(&header, 24) as usize;
                let mut bytes = Vec::new();
                if !is_read {
                    bytes.resize(length, 0);
                    if self.line.read_exact(&mut bytes).is_err() {
                        return false;
                    }
                }
                match (endpoint, is_read) {
                    (0, _) => return self.control(number, *header[40..].first_chunk().unwrap(), length),
                    (_, true) => {
                        assert!(self.described.packet(endpoint | 0x80) > 0);
                        assert_eq!(length % self.packet_to_host(), 0, "a read that a whole packet may overflow");
                        self.reads.push_back(Waits { number, length, bytes });
                    }
                    (_, false) => {
                        assert!(self.described.packet(endpoint) > 0);
                        self.writes.push_back(Waits { number, length, bytes });
                    }
                }
                true
            }
            2 => {
                let victim = word(&header, 20);
                let before = self.reads.len() + self.writes.len();
                self.reads.retain(|read| read.number != victim);
                self.writes.retain(|write| write.number != victim);
                let found = before > self.reads.len() + self.writes.len();
                let mut header = [0; HEADER];
                header[..4].copy_from_slice(&4_u32.to_be_bytes());
                header[4..8].copy_from_slice(&number.to_be_bytes());
                header[20..24].copy_from_slice(&(if found { UNLINKED } else { 0 }).to_be_bytes());
                self.line.write_all(&header).is_ok()
            }
            other => panic!("the kernel asks for {other}"),
        }
    }

    /// Answers a request on endpoint 0.
    fn control(&mut self, number: u32, setup: [u8; 8], length: usize) -> bool {
        let [kind, request, low, high, ..] = setup;
        let answer = match (kind, request) {
            (0x80, 6) => self.described.descriptor(high, low),
            (0x80, 8) => Some(vec![1]),
            (0x80..=0x82, 0) => Some(vec![0, 0]),
            // Clears an endpoint's halt.
            (0x02, 1) => {
                let mut state = locked(&self.state);
                state.is_halted[usize::from(setup[4] & 0x80 == 0)] = false;
                state.cleared += 1;
                Some(Vec::new())
            }
            // Sets the configuration, the interface's setting, or a feature.
            (0x00, 9) | (0x01, 11) | (0x00 | 0x01, 1 | 3) => Some(Vec::new()),
            _ => None,
        };
        match answer {
            Some(mut bytes) => {
                bytes.truncate(length);
                self.answer(number, 0, bytes.len(), &bytes)
            }
            None => self.answer(number, STALLED, 0, &[]),
        }
    }
}
