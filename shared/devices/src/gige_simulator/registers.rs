//! The memory of a device: the bootstrap registers of the standard, the registers of its features, and the file that
//! describes them.

/// Addresses of the bootstrap registers.
pub mod bootstrap {
    pub const VERSION: u32 = 0x0000;
    pub const DEVICE_MODE: u32 = 0x0004;
    pub const MAC_HIGH: u32 = 0x0008;
    pub const MAC_LOW: u32 = 0x000c;
    pub const IP_OPTIONS: u32 = 0x0010;
    pub const IP_CURRENT: u32 = 0x0014;
    pub const IP_ADDRESS: u32 = 0x0024;
    pub const SUBNET_MASK: u32 = 0x0034;
    pub const MANUFACTURER: u32 = 0x0048;
    pub const MODEL: u32 = 0x0068;
    pub const DEVICE_VERSION: u32 = 0x0088;
    pub const MANUFACTURER_INFO: u32 = 0x00a8;
    pub const SERIAL: u32 = 0x00d8;
    pub const USER_NAME: u32 = 0x00e8;
    /// Bytes that the answer to a discovery carries.
    pub const DISCOVERY_BYTES: usize = 0x00f8;
    pub const XML_URL: u32 = 0x0200;
    pub const INTERFACES: u32 = 0x0600;
    pub const STREAMS: u32 = 0x0904;
    pub const CAPABILITIES: u32 = 0x0934;
    pub const HEARTBEAT_MS: u32 = 0x0938;
    pub const TICKS_LOW: u32 = 0x0940;
    pub const TIME_CONTROL: u32 = 0x0944;
    pub const TIME_HIGH: u32 = 0x0948;
    pub const TIME_LOW: u32 = 0x094c;
    pub const CONTROL: u32 = 0x0a00;
    pub const STREAM_PORT: u32 = 0x0d00;
    pub const STREAM_PACKET: u32 = 0x0d04;
    pub const STREAM_DELAY: u32 = 0x0d08;
    pub const STREAM_ADDRESS: u32 = 0x0d18;
}

/// Addresses of the features' registers.
pub mod feature {
    pub const WIDTH: u32 = 0xa000;
    pub const HEIGHT: u32 = 0xa004;
    pub const PIXEL_FORMAT: u32 = 0xa008;
    pub const PAYLOAD_BYTES: u32 = 0xa00c;
    pub const ACQUISITION: u32 = 0xa010;
    pub const ACQUISITION_MODE: u32 = 0xa014;
    pub const TRIGGER_MODE: u32 = 0xa018;
    pub const TRIGGER_SOURCE: u32 = 0xa01c;
    pub const TRIGGER_SOFTWARE: u32 = 0xa020;
    pub const TRIGGER_SELECTOR: u32 = 0xa024;
    pub const EXPOSURE_US: u32 = 0xa028;
    pub const GAIN_DB: u32 = 0xa02c;
    pub const TEMPERATURE_C: u32 = 0xa030;
    pub const LOCKED: u32 = 0xa034;
    pub const SENSOR_WIDTH: u32 = 0xa038;
    pub const SENSOR_HEIGHT: u32 = 0xa03c;
    pub const OFFSET_X: u32 = 0xa040;
    pub const OFFSET_Y: u32 = 0xa044;
    pub const WIDTH_LIMIT: u32 = 0xa048;
    pub const HEIGHT_LIMIT: u32 = 0xa04c;
    pub const OFFSET_X_LIMIT: u32 = 0xa050;
    pub const OFFSET_Y_LIMIT: u32 = 0xa054;
    pub const CLOCK: u32 = 0xa058;
    pub const CLOCK_STATE: u32 = 0xa05c;
    pub const CLOCK_UPDATE: u32 = 0xa060;
    pub const EXPOSURE_AUTO: u32 = 0xa064;
    pub const TRIGGER_ACTIVATION: u32 = 0xa068;
}

/// Where the description begins.
pub const XML_ADDRESS: u32 = 0x0001_0000;

/// Registers that a client may write; all others belong to the device.
const WRITABLE: [u32; 26] = [
    bootstrap::HEARTBEAT_MS,
    bootstrap::TIME_CONTROL,
    bootstrap::CONTROL,
    bootstrap::STREAM_PORT,
    bootstrap::STREAM_PACKET,
    bootstrap::STREAM_DELAY,
    bootstrap::STREAM_ADDRESS,
    feature::PIXEL_FORMAT,
    feature::ACQUISITION,
    feature::ACQUISITION_MODE,
    feature::TRIGGER_MODE,
    feature::TRIGGER_SOURCE,
    feature::TRIGGER_SOFTWARE,
    feature::TRIGGER_SELECTOR,
    feature::EXPOSURE_US,
    feature::GAIN_DB,
    feature::LOCKED,
    feature::WIDTH,
    feature::HEIGHT,
    feature::OFFSET_X,
    feature::OFFSET_Y,
    feature::CLOCK,
    feature::CLOCK_UPDATE,
    feature::EXPOSURE_AUTO,
    feature::TRIGGER_ACTIVATION,
    bootstrap::USER_NAME,
];

/// Memory with the registers.
#[derive(Debug, Clone)]
pub struct Registers {
    bytes: Vec<u8>,
}

impl Registers {
    /// Empty registers before this description.
    pub fn new(xml: &str) -> Self {
        let mut bytes = vec![0; XML_ADDRESS as usize];
        bytes.extend(xml.as_bytes());
        bytes.resize(bytes.len().next_multiple_of(4), 0);
        Self { bytes }
    }

    /// The bytes from an address on; `None` beyond the end.
    pub fn read(&self, address: u32, count: usize) -> Option<&[u8]> {
        let start = address as usize;
        self.bytes.get(start..start.checked_add(count)?)
    }

    /// The value of a register; 0 where there is none.
    pub fn get(&self, address: u32) -> u32 {
        self.read(address, 4).and_then(|b| b.try_into().ok()).map_or(0, u32::from_be_bytes)
    }

    /// Sets the value of a register.
    pub fn set(&mut self, address: u32, value: u32) {
        self.set_bytes(address, &value.to_be_bytes());
    }

    /// Sets a text, cut or filled with zeros to `length`.
    pub fn set_text(&mut self, address: u32, text: &str, length: usize) {
        let mut bytes = vec![0; length];
        let used = text.len().min(length - 1);
        bytes[..used].copy_from_slice(&text.as_bytes()[..used]);
        self.set_bytes(address, &bytes);
    }

    fn set_bytes(&mut self, address: u32, value: &[u8]) {
        let start = address as usize;
        if let Some(place) = self.bytes.get_mut(start..start + value.len()) {
            place.copy_from_slice(value);
        }
    }

    /// Whether a client may write this register.
    pub fn is_writable(address: u32) -> bool {
        WRITABLE.contains(&address)
    }
}
