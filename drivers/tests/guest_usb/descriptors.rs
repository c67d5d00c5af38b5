//! Descriptors of a USB device.

/// An endpoint of interface 0.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Endpoint {
    /// Bit 7 is set for endpoints to the host.
    pub(crate) address: u8,
    /// 2 bulk, 3 interrupt.
    pub(crate) kind: u8,
    /// Packet size, bytes.
    pub(crate) packet: u16,
}

/// A device with one configuration and one interface of a vendor-specific class.
#[derive(Debug, Clone)]
pub(crate) struct Described {
    pub(crate) product: u16,
    /// 480 Mbit/s if true, else 12.
    pub(crate) is_high_speed: bool,
    pub(crate) serial_number: Option<String>,
    pub(crate) endpoints: Vec<Endpoint>,
}

/// Vendor number.
const VENDOR: u16 = drivers::tracker::polhemus::VENDOR;

impl Described {
    /// Creates a device with one bulk endpoint in each direction.
    pub(crate) fn new(product: u16, is_high_speed: bool, [out, into]: [u8; 2]) -> Self {
        let packet = if is_high_speed { 512 } else { 64 };
        let endpoints = [out, into].map(|address| Endpoint { address, kind: 2, packet }).to_vec();
        Self { product, is_high_speed, serial_number: None, endpoints }
    }

    /// Returns the answer to a descriptor request; `None` if the device lacks the descriptor.
    pub(crate) fn descriptor(&self, kind: u8, index: u8) -> Option<Vec<u8>> {
        match (kind, index) {
            (1, _) => {
                let [vendor, product] = [VENDOR, self.product].map(u16::to_le_bytes);
                let serial = if self.serial_number.is_some() { 3 } else { 0 };
                let mut device = vec![18, 1, 0x00, 0x02, 0xff, 0, 0, 64];
                device.extend([vendor, product, [0, 1]].concat());
                device.extend([1, 2, serial, 1]);
                Some(device)
            }
            (2, _) => Some(self.configuration()),
            (3, 0) => Some(vec![4, 3, 0x09, 0x04]),
            (3, 1) => Some(string("Polhemus")),
            (3, 2) => Some(string("A virtual tracker")),
            (3, 3) => self.serial_number.as_deref().map(string),
            _ => None,
        }
    }

    fn configuration(&self) -> Vec<u8> {
        let endpoints: Vec<u8> = self
            .endpoints
            .iter()
            .flat_map(|e| {
                let [low, high] = e.packet.to_le_bytes();
                [7, 5, e.address, e.kind, low, high, if e.kind == 3 { 10 } else { 0 }]
            })
            .collect();
        let count = u8::try_from(self.endpoints.len()).unwrap();
        let interface = [9, 4, 0, 0, count, 0xff, 0, 0, 0];
        let [low, high] = u16::try_from(9 + interface.len() + endpoints.len()).unwrap().to_le_bytes();
        // Self-powered.
        let configuration = [9, 2, low, high, 1, 1, 0, 0xc0, 50];
        [&configuration[..], &interface, &endpoints].concat()
    }

    /// Returns an endpoint's packet size, bytes.
    pub(crate) fn packet(&self, address: u8) -> usize {
        let found = self.endpoints.iter().find(|e| e.address == address);
        usize::from(found.unwrap_or_else(|| panic!("there is no endpoint {address:02x}")).packet)
    }
}

fn string(text: &str) -> Vec<u8> {
    let units: Vec<u8> = text.encode_utf16().flat_map(u16::to_le_bytes).collect();
    [&[u8::try_from(units.len() + 2).unwrap(), 3][..], &units].concat()
}
