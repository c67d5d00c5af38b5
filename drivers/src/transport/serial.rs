//! Serial lines, using the crate serialport.

#![allow(unsafe_code, reason = "a line is waited for by its number, which serialport hands out without a lifetime")]

use std::io::{ErrorKind, Read, Write};
use std::os::fd::{AsRawFd, BorrowedFd};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use serialport::{ClearBuffer, FlowControl, SerialPort, SerialPortBuilder, SerialPortType, TTYPort};

use sonoweave_core::clock::Clock;

use super::{LineError, Opener, Received, Transport};
use crate::listing::{Listing, SERIAL};

/// The longest time that written bytes may wait for the line.
const WRITE: Duration = Duration::from_millis(500);

/// Directory in which the kernel lists its lines.
const LINES: &str = "/sys/class/tty";

/// Path and rate of a serial line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PortPath {
    /// The device file: `/dev/ttyUSB0`, or preferably a link that does not depend on the
    /// plugging order, `/dev/serial/by-id/…`.
    pub path: PathBuf,
    /// Initial rate, bits per second.
    pub baud: u32,
}

/// Opens a serial line with 8 bits, no parity, 1 stop bit and no handshake, all required for
/// binary records.
#[derive(Debug)]
pub struct SerialOpener {
    port: PortPath,
    name: String,
    clock: Arc<dyn Clock>,
}

impl SerialOpener {
    /// Creates an opener for this port; times come from `clock`.
    pub fn new(port: PortPath, clock: Arc<dyn Clock>) -> Self {
        let name = port.path.display().to_string();
        Self { port, name, clock }
    }
}

impl Opener for SerialOpener {
    fn name(&self) -> &str {
        &self.name
    }

    fn open(&mut self) -> Result<Box<dyn Transport>, LineError> {
        let mut port =
            named(&self.port.path, self.port.baud).open_native().map_err(|error| refusal(&self.port.path, &error))?;
        prefer_low_latency(&self.port.path);
        // Not fatal: the search for the first record would drop these bytes, too.
        if let Err(error) = port.clear(ClearBuffer::All) {
            tracing::debug!("{}: what was received before cannot be dropped: {error}", self.name);
        }
        port.set_timeout(Duration::ZERO).map_err(|error| LineError::Failed(error.to_string()))?;
        Ok(Box::new(Serial { port, clock: Arc::clone(&self.clock) }))
    }
}

/// Lists all serial lines, by persistent names if there are any.
pub fn list() -> Vec<Listing> {
    // The crate panics if the kernel has no such directory.
    if !Path::new(LINES).is_dir() {
        return Vec::new();
    }
    let ports = match serialport::available_ports() {
        Ok(ports) => ports,
        Err(error) => {
            let unavailable = Some(format!("serial lines cannot be listed: {error}"));
            return vec![Listing { id: SERIAL.into(), description: "serial lines".into(), unavailable }];
        }
    };
    let mut found: Vec<Listing> = ports
        .into_iter()
        .filter(|port| is_there(&port.port_name))
        .map(|port| {
            let path = Path::new(&port.port_name);
            let of = match port.port_type {
                SerialPortType::UsbPort(usb) => {
                    let text: Vec<String> = [usb.manufacturer, usb.product].into_iter().flatten().collect();
                    let text = if text.is_empty() { "USB adapter".into() } else { text.join(" ") };
                    format!("{text} ({:04x}:{:04x})", usb.vid, usb.pid)
                }
                SerialPortType::PciPort => "built-in serial line".into(),
                SerialPortType::BluetoothPort => "Bluetooth serial line".into(),
                SerialPortType::Unknown => "serial line".into(),
            };
            let id = lasting_name(path).unwrap_or_else(|| port.port_name.clone());
            let description = format!("{of}, {}", port.port_name);
            Listing { id, description, unavailable: super::denied(path).then(|| super::DENIED.to_owned()) }
        })
        .collect();
    found.sort_by(|a, b| a.id.cmp(&b.id));
    found
}

/// Returns whether a port exists. Kernels keep names of legacy ports that the machine lacks;
/// such ports have type 0. Other lines have no type.
fn is_there(path: &str) -> bool {
    let name = path.strip_prefix("/dev/").unwrap_or(path);
    std::fs::read_to_string(Path::new(LINES).join(name).join("type")).map_or(true, |kind| kind.trim() != "0")
}

/// Returns the link that names a line by its adapter, independent of the plugging order.
fn lasting_name(path: &Path) -> Option<String> {
    let same = |link: &Path| std::fs::canonicalize(link).is_ok_and(|target| target == path);
    let links = std::fs::read_dir("/dev/serial/by-id").ok()?;
    let found = links.filter_map(Result::ok).map(|link| link.path()).find(|link| same(link))?;
    Some(found.display().to_string())
}

/// Returns a port that is to be opened, without handshake.
pub(super) fn named(path: &Path, baud: u32) -> SerialPortBuilder {
    serialport::new(path.to_string_lossy(), baud).flow_control(FlowControl::None)
}

/// Converts an error at opening to reason and remedy.
pub(super) fn refusal(path: &Path, error: &serialport::Error) -> LineError {
    if !path.exists() {
        return LineError::Absent("no such file".into());
    }
    if super::denied(path) {
        return LineError::Denied;
    }
    // The crate reports the system's reason only as text.
    let text = error.to_string();
    let is_taken = ["busy", "exclusive lock"].iter().any(|word| text.to_ascii_lowercase().contains(word));
    if is_taken {
        return LineError::Refused(match super::holder(path) {
            Some(who) => format!("another program has it open, {who}; close that"),
            None => "another program has it open; close that (a modem manager may try new lines, too)".into(),
        });
    }
    LineError::Refused(text)
}

/// Sets the adapter's latency timer to 1 ms: FTDI chips hold bytes back for up to 16 ms
/// otherwise. If the file is not writable, the udev rule sets it.
fn prefer_low_latency(path: &Path) {
    let Some(name) = std::fs::canonicalize(path).ok().and_then(|path| path.file_name().map(ToOwned::to_owned)) else {
        return;
    };
    let timer = Path::new("/sys/bus/usb-serial/devices").join(name).join("latency_timer");
    if timer.exists()
        && let Err(error) = std::fs::write(&timer, "1")
    {
        tracing::info!(
            "{}: {error}; bytes may wait up to 16 ms in the adapter: install the udev rule",
            timer.display()
        );
    }
}

/// An open serial line.
struct Serial {
    port: TTYPort,
    clock: Arc<dyn Clock>,
}

impl Transport for Serial {
    fn read(&mut self, into: &mut [u8], deadline_ns: i64) -> Result<Received, LineError> {
        // The crate's own waiting returns an error with its own text, which allocates at every
        // timeout.
        if !super::wait([self.wakes_by()], deadline_ns - self.clock.now_ns()) {
            return Ok(Received { bytes: 0, at_ns: self.clock.now_ns() });
        }
        self.port.set_timeout(Duration::ZERO).map_err(|error| LineError::Failed(error.to_string()))?;
        let read = self.port.read(into);
        let at_ns = self.clock.now_ns();
        match read {
            // End of file; no supported device sends that.
            Ok(0) => Err(LineError::Gone("the line has ended".into())),
            Ok(bytes) => Ok(Received { bytes, at_ns }),
            Err(error)
                if matches!(error.kind(), ErrorKind::TimedOut | ErrorKind::Interrupted | ErrorKind::WouldBlock) =>
            {
                Ok(Received { bytes: 0, at_ns })
            }
            Err(error) => Err(trouble(&error)),
        }
    }

    fn write(&mut self, bytes: &[u8]) -> Result<(), LineError> {
        self.port.set_timeout(WRITE).map_err(|error| LineError::Failed(error.to_string()))?;
        self.port.write_all(bytes).map_err(|error| match error.kind() {
            ErrorKind::TimedOut => LineError::Stuck,
            _ => trouble(&error),
        })
    }

    fn wakes_by(&self) -> Option<BorrowedFd<'_>> {
        // SAFETY: the number is that of a file which the port keeps open until it is dropped.
        // The port stays borrowed as long as the result lives.
        Some(unsafe { BorrowedFd::borrow_raw(self.port.as_raw_fd()) })
    }

    fn set_baud(&mut self, baud: u32) -> Result<(), LineError> {
        self.port.set_baud_rate(baud).map_err(|error| LineError::Failed(format!("{baud} bits a second: {error}")))?;
        self.port.clear(ClearBuffer::Input).map_err(|error| LineError::Failed(error.to_string()))
    }
}

fn trouble(error: &std::io::Error) -> LineError {
    // A write to a line whose adapter was unplugged gives EIO.
    let is_gone = matches!(error.kind(), ErrorKind::BrokenPipe | ErrorKind::NotFound)
        || matches!(error.raw_os_error(), Some(code) if code == rustix::io::Errno::IO.raw_os_error()
            || code == rustix::io::Errno::NODEV.raw_os_error() || code == rustix::io::Errno::NXIO.raw_os_error());
    if is_gone { LineError::Gone(error.to_string()) } else { LineError::Failed(error.to_string()) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sonoweave_core::clock::{MS, Monotonic, SECOND};

    fn open(path: &str) -> Result<Box<dyn Transport>, LineError> {
        SerialOpener::new(PortPath { path: path.into(), baud: 115_200 }, Arc::new(Monotonic)).open()
    }

    #[test]
    fn pseudo_terminal_passes_bytes_and_reports_hangup() {
        let (mut other, own) = TTYPort::pair().unwrap();
        let path = own.name().unwrap();
        drop(own);
        let mut line = open(&path).unwrap();
        line.set_baud(38_400).unwrap();
        let mut buffer = [0; 64];
        // Every byte passes: none is echoed, interpreted as control or held back until a line
        // end.
        let all: Vec<u8> = (0..=255).collect();
        let mut back = Vec::new();
        for part in all.chunks(51) {
            other.write_all(part).unwrap();
            let now = Monotonic.now_ns();
            while back.len() < all.len() {
                let Received { bytes, at_ns } = line.read(&mut buffer, now + 20 * MS).unwrap();
                assert!(at_ns >= now);
                back.extend_from_slice(&buffer[..bytes]);
                if bytes == 0 {
                    break;
                }
            }
        }
        assert_eq!(back, all);
        line.write(b"P\x03\x11\x13\r").unwrap();
        other.set_timeout(Duration::from_secs(1)).unwrap();
        let mut sent = [0; 5];
        other.read_exact(&mut sent).unwrap();
        assert_eq!(&sent, b"P\x03\x11\x13\r");
        let before = Monotonic.now_ns();
        let none = line.read(&mut buffer, before + 5 * MS).unwrap();
        assert!(none.bytes == 0 && none.at_ns >= before + 5 * MS && none.at_ns < before + SECOND, "{none:?}");
        drop(other);
        let gone = line.read(&mut buffer, Monotonic.now_ns() + SECOND);
        assert!(matches!(gone, Err(LineError::Gone(_))), "{gone:?}");
    }

    #[test]
    fn open_failure_gives_reason() {
        let absent = open("/dev/no-such-line").err().unwrap();
        assert!(matches!(absent, LineError::Absent(_)) && absent.to_string().contains("plug it in"), "{absent}");
        let no_line = open("/dev/null").err().unwrap();
        assert!(matches!(no_line, LineError::Refused(_)), "{no_line}");
        let (other, own) = TTYPort::pair().unwrap();
        let path = own.name().unwrap();
        drop(own);
        let _first = open(&path).unwrap();
        let second = open(&path).err().unwrap();
        assert!(matches!(&second, LineError::Refused(why) if why.contains("another program")), "{second}");
        drop(other);
    }
}
