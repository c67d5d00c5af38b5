//! USB devices with one bulk endpoint in each direction, using the crate nusb.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

use nusb::transfer::{Buffer, Bulk, In, Out, TransferError};
use nusb::{DeviceInfo, Endpoint, ErrorKind, MaybeFuture};

use sonoweave_core::clock::Clock;

use super::{LineError, Opener, Received, Transport};

/// Read transfers queued in the kernel, so that the device's buffer does not fill while the
/// host is busy.
const IN_FLIGHT: usize = 8;
/// Bytes per transfer, a multiple of every packet size. A short packet ends a transfer early.
const TRANSFER: usize = 512;
/// Time limit of a write, and then of the cancellation of its transfers.
const WRITE: Duration = Duration::from_millis(250);

/// Identifies a USB device.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct UsbId {
    /// Vendor number.
    pub vendor: u16,
    /// Product numbers; any of them matches.
    pub products: Vec<u16>,
    /// Product numbers while the device waits for its firmware, each with the remedy.
    pub loaders: Vec<(u16, String)>,
    /// The device's serial number, or its place as bus and ports (`1-2.4`). `None` if there is
    /// only one.
    pub which: Option<String>,
}

impl UsbId {
    fn is(&self, device: &DeviceInfo) -> bool {
        self.products.contains(&device.product_id()) && self.is_where(device)
    }

    fn is_where(&self, device: &DeviceInfo) -> bool {
        let named = |which: &str| device.serial_number() == Some(which) || place(device) == which;
        self.which.as_deref().is_none_or(named)
    }

    /// Returns the remedy if one of these devices matches and waits for its firmware.
    fn advice<'a>(&'a self, devices: &[DeviceInfo]) -> Option<&'a str> {
        let waits = |(number, _): &&(u16, String)| {
            devices.iter().any(|device| device.product_id() == *number && self.is_where(device))
        };
        self.loaders.iter().find(waits).map(|(_, advice)| advice.as_str())
    }
}

/// Returns bus and ports of a device, in the kernel's notation. It stays the same while the
/// device stays in the same socket.
pub fn place(device: &DeviceInfo) -> String {
    let ports: Vec<String> = device.port_chain().iter().map(u8::to_string).collect();
    format!("{}-{}", device.bus_id().trim_start_matches('0'), ports.join("."))
}

/// Lists all devices of a vendor, with their products.
///
/// # Errors
/// [`LineError::Failed`] when the system cannot list USB devices.
pub fn list(vendor: u16) -> Result<Vec<DeviceInfo>, LineError> {
    let devices = nusb::list_devices().wait().map_err(|error| LineError::Failed(error.to_string()))?;
    Ok(devices.filter(|device| device.vendor_id() == vendor).collect())
}

/// Returns why a device cannot be opened, judged by its file; the device is not accessed.
pub fn unavailable(device: &DeviceInfo) -> Option<String> {
    let bus: u32 = device.bus_id().parse().ok()?;
    let file = format!("/dev/bus/usb/{bus:03}/{:03}", device.device_address());
    super::denied(std::path::Path::new(&file)).then(|| super::DENIED.to_owned())
}

/// Opens a USB device.
#[derive(Debug)]
pub struct UsbOpener {
    id: UsbId,
    name: String,
    clock: Arc<dyn Clock>,
}

impl UsbOpener {
    /// Creates an opener for this device; times come from `clock`.
    pub fn new(id: UsbId, clock: Arc<dyn Clock>) -> Self {
        let name = match &id.which {
            Some(which) => format!("USB {:04x} {which}", id.vendor),
            None => format!("USB {:04x}", id.vendor),
        };
        Self { id, name, clock }
    }
}

impl Opener for UsbOpener {
    fn name(&self) -> &str {
        &self.name
    }

    fn open(&mut self) -> Result<Box<dyn Transport>, LineError> {
        let all = list(self.id.vendor)?;
        let mut fitting = all.iter().filter(|device| self.id.is(device));
        let Some(info) = fitting.next() else {
            return Err(match self.id.advice(&all) {
                Some(advice) => LineError::Refused(advice.to_owned()),
                None => LineError::Absent("no such USB device".into()),
            });
        };
        if let (None, Some(_)) = (&self.id.which, fitting.next()) {
            return Err(LineError::Refused(
                "several devices of its kind are connected; name one by its serial number or its place".into(),
            ));
        }
        let refused = |error: nusb::Error| match error.kind() {
            ErrorKind::Disconnected | ErrorKind::NotFound => LineError::Absent(error.to_string()),
            ErrorKind::PermissionDenied => LineError::Denied,
            ErrorKind::Busy => LineError::Refused("another program or a kernel driver has it; close that".into()),
            _ => LineError::Refused(error.to_string()),
        };
        let device = info.open().wait().map_err(refused)?;
        let interface = device.detach_and_claim_interface(0).wait().map_err(refused)?;
        // The endpoints come from the descriptors and not from a table: firmware versions
        // differ.
        let described = interface.descriptor();
        let bulk = |direction| {
            let endpoints = described.iter().flat_map(|interface| interface.endpoints());
            let mut bulk = endpoints.filter(|e| e.transfer_type() == nusb::descriptors::TransferType::Bulk);
            bulk.find(|endpoint| endpoint.direction() == direction).map(|endpoint| endpoint.address())
        };
        let (Some(into), Some(out)) = (bulk(nusb::transfer::Direction::In), bulk(nusb::transfer::Direction::Out))
        else {
            return Err(LineError::Refused("has no bulk endpoints; it may be waiting for its firmware".into()));
        };
        let mut input = interface.endpoint::<Bulk, In>(into).map_err(refused)?;
        let output = interface.endpoint::<Bulk, Out>(out).map_err(refused)?;
        let packet = input.max_packet_size().max(1);
        for _ in 0..IN_FLIGHT {
            let buffer = input.allocate(TRANSFER.div_ceil(packet) * packet);
            input.submit(buffer);
        }
        Ok(Box::new(Usb { input, output, left: VecDeque::new(), at_ns: 0, clock: Arc::clone(&self.clock) }))
    }
}

/// An open USB device.
struct Usb {
    input: Endpoint<Bulk, In>,
    output: Endpoint<Bulk, Out>,
    /// Received bytes that did not fit into the caller's buffer; `at_ns` is their arrival time.
    left: VecDeque<u8>,
    at_ns: i64,
    clock: Arc<dyn Clock>,
}

/// Converts a transfer error. On some hosts an unplugged device reports a fault first: both
/// mean that it is gone.
fn trouble(error: TransferError) -> LineError {
    match error {
        TransferError::Disconnected | TransferError::Fault => LineError::Gone(error.to_string()),
        _ => LineError::Failed(error.to_string()),
    }
}

impl Transport for Usb {
    fn read(&mut self, into: &mut [u8], deadline_ns: i64) -> Result<Received, LineError> {
        while self.left.is_empty() {
            let left = u64::try_from(deadline_ns - self.clock.now_ns()).unwrap_or(0);
            let Some(mut done) = self.input.wait_next_complete(Duration::from_nanos(left)) else {
                return Ok(Received { bytes: 0, at_ns: self.clock.now_ns() });
            };
            self.at_ns = self.clock.now_ns();
            let status = done.status;
            if status.is_ok() {
                self.left.extend(&done.buffer[..done.actual_len]);
            }
            if matches!(status, Err(TransferError::Disconnected | TransferError::Fault)) {
                return Err(trouble(TransferError::Disconnected));
            }
            if matches!(status, Err(TransferError::Stall)) {
                self.recover()?;
            } else {
                done.buffer.clear();
                self.input.submit(done.buffer);
            }
            if let Err(error) = status {
                return Err(trouble(error));
            }
        }
        let bytes = self.left.len().min(into.len());
        for (into, byte) in into.iter_mut().zip(self.left.drain(..bytes)) {
            *into = byte;
        }
        Ok(Received { bytes, at_ns: self.at_ns })
    }

    fn write(&mut self, bytes: &[u8]) -> Result<(), LineError> {
        self.send(bytes)?;
        // An empty packet marks the end of a write that fills its last packet.
        if bytes.len().is_multiple_of(self.output.max_packet_size().max(1)) {
            self.send(&[])?;
        }
        Ok(())
    }

    fn set_baud(&mut self, _baud: u32) -> Result<(), LineError> {
        Ok(())
    }
}

impl Usb {
    /// Sends the content of one transfer. A transfer that the device does not accept is
    /// cancelled, so that nothing waits forever.
    fn send(&mut self, bytes: &[u8]) -> Result<(), LineError> {
        let gone = || LineError::Gone("its transfers do not end".into());
        // Tries a second time after a stall of the endpoint.
        for _ in 0..2 {
            let mut buffer = Buffer::new(bytes.len());
            buffer.extend_from_slice(bytes);
            self.output.submit(buffer);
            let done = self.output.wait_next_complete(WRITE).or_else(|| {
                self.output.cancel_all();
                self.output.wait_next_complete(WRITE)
            });
            match done.ok_or_else(gone)?.status {
                Ok(()) => return Ok(()),
                Err(TransferError::Cancelled) => return Err(LineError::Stuck),
                Err(TransferError::Stall) => {
                    self.output.clear_halt().wait().map_err(|error| LineError::Gone(error.to_string()))?;
                }
                Err(error) => return Err(trouble(error)),
            }
        }
        Err(trouble(TransferError::Stall))
    }

    /// Recovers from a stall: cancels the pending transfers, clears the endpoint, and submits
    /// new reads.
    fn recover(&mut self) -> Result<(), LineError> {
        self.input.cancel_all();
        let mut buffers = Vec::new();
        while self.input.pending() > 0 {
            match self.input.wait_next_complete(WRITE) {
                Some(done) => buffers.push(done.buffer),
                None => return Err(LineError::Gone("its transfers do not end".into())),
            }
        }
        self.input.clear_halt().wait().map_err(|error| LineError::Gone(error.to_string()))?;
        let packet = self.input.max_packet_size().max(1);
        for _ in 0..IN_FLIGHT {
            let mut buffer = buffers.pop().unwrap_or_else(|| self.input.allocate(TRANSFER.div_ceil(packet) * packet));
            buffer.clear();
            self.input.submit(buffer);
        }
        Ok(())
    }
}
