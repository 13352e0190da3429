//! A GigE Vision device without sockets: datagrams and times in, acknowledgements and actions out.

use super::description::{EXPOSURE_US, GAIN_DB, SOFTWARE, xml};
use super::gvcp::{Command, MAX_READ_BYTES, Request, Status};
use super::identity::{Identity, Quirks};
use super::region::{self, Region};
use super::registers::{Registers, XML_ADDRESS, bootstrap, feature};
use std::net::{Ipv4Addr, SocketAddr};

/// Stream packets, IP and UDP header included: at least what every network carries, at most what a datagram holds.
const PACKET_BYTES: [u32; 2] = [576, 16_000];

/// In the register of the packet size: send a test packet.
const FIRE_TEST: u32 = 1 << 31;

/// In the register of the packet size: the flags, not the size.
const PACKET_FLAGS: u32 = 0xffff_0000;

/// The register of the control privilege: exclusive and control access.
const IN_CONTROL: u32 = 0b11;

/// Capabilities: user name and serial number, write memory, several registers a command, packet resend.
const CAPABILITIES: u32 = 1 << 31 | 1 << 30 | 1 << 2 | 1 << 1 | 1;

/// A client that is silent for longer loses control, unless it asks for another time, ms.
const HEARTBEAT_MS: u32 = 3000;

/// What a datagram asks the host of the device to do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Action {
    /// Nothing beside the acknowledgement.
    None,
    /// Take a frame and stream it.
    Trigger,
    /// Send these packets of a block once more, both ends included.
    Resend { block: u64, first: u32, last: u32 },
    /// Send a packet of the configured size that holds nothing.
    TestPacket,
}

/// States of the clock: off, alone, and following another one; and how long it looks for that, ns.
const CLOCK_OFF: u32 = 3;
const CLOCK_LISTENS: u32 = 4;
const CLOCK_FOLLOWS: u32 = 9;
const CLOCK_NS: u64 = 300_000_000;

/// Temperature of a warm camera, °C, and how much colder it is when it is switched on, K.
const WARM_C: f32 = 35.0;
const COLD_K: f32 = 10.0;

/// Temperature after a time since the start; `warm_up_s` is its time constant, 0: warm from the start.
fn temperature_c(warm_up_s: f32, now_ns: u64) -> f32 {
    let since_s = now_ns as f32 * 1e-9;
    if warm_up_s > 0.0 { WARM_C - COLD_K * (-since_s / warm_up_s).exp() } else { WARM_C }
}

/// A camera as its registers.
#[derive(Debug)]
pub struct Device {
    quirks: Quirks,
    registers: Registers,
    bytes_per_px: u32,
    /// When the clock was told to follow others, ns.
    clock_since_ns: u64,
    /// The client in control and the time of its last command, ns.
    controller: Option<(SocketAddr, u64)>,
    /// Of the client in control: its last command and the answer, for a command that comes twice.
    last: Option<(SocketAddr, u16, Vec<u8>)>,
}

impl Device {
    /// A camera that nobody controls.
    pub fn new(identity: &Identity, quirks: Quirks) -> Self {
        let pixel_format = identity.pixel_format();
        let sensor_px = [identity.width_px, identity.height_px];
        let xml = xml(pixel_format, sensor_px, quirks.old_names);
        let mut r = Registers::new(&xml);
        r.set(bootstrap::VERSION, 0x0001_0002);
        r.set(bootstrap::DEVICE_MODE, 0x8000_0001);
        let [a, b, c, d, e, f] = identity.mac;
        r.set(bootstrap::MAC_HIGH, u32::from_be_bytes([0, 0, a, b]));
        r.set(bootstrap::MAC_LOW, u32::from_be_bytes([c, d, e, f]));
        r.set(bootstrap::IP_OPTIONS, 0b111);
        r.set(bootstrap::IP_CURRENT, 0b101);
        r.set(bootstrap::IP_ADDRESS, identity.address.into());
        r.set(bootstrap::SUBNET_MASK, 0xff00_0000);
        r.set_text(bootstrap::MANUFACTURER, "fringecell", 32);
        r.set_text(bootstrap::MODEL, "Twin", 32);
        r.set_text(bootstrap::DEVICE_VERSION, env!("CARGO_PKG_VERSION"), 32);
        r.set_text(bootstrap::MANUFACTURER_INFO, "simulated camera", 48);
        r.set_text(bootstrap::SERIAL, &identity.serial, 16);
        r.set_text(bootstrap::USER_NAME, &identity.user_name, 16);
        r.set_text(bootstrap::XML_URL, &format!("Local:twin.xml;{XML_ADDRESS:X};{:X}", xml.len()), 512);
        r.set(bootstrap::INTERFACES, 1);
        r.set(bootstrap::STREAMS, 1);
        r.set(bootstrap::CAPABILITIES, CAPABILITIES);
        r.set(bootstrap::HEARTBEAT_MS, HEARTBEAT_MS);
        r.set(bootstrap::TICKS_LOW, 1_000_000_000);
        r.set(bootstrap::STREAM_PACKET, 1500);
        r.set(feature::PIXEL_FORMAT, pixel_format.code());
        r.set(feature::EXPOSURE_US, 10_000.0_f32.to_bits());
        r.set(feature::CLOCK_STATE, CLOCK_OFF);
        let bytes_per_px = identity.bytes_per_px();
        region::open(&mut r, sensor_px, bytes_per_px);
        Self { quirks, registers: r, bytes_per_px, clock_since_ns: 0, controller: None, last: None }
    }

    /// Value of the feature `PixelFormat`.
    pub fn pixel_format(&self) -> u32 {
        self.registers.get(feature::PIXEL_FORMAT)
    }

    /// The window of the sensor that a frame shows.
    pub fn region(&self) -> Region {
        Region::of(&self.registers)
    }

    /// Where frames go to; `None` while no client opened the stream.
    pub fn destination(&self) -> Option<SocketAddr> {
        let port = self.registers.get(bootstrap::STREAM_PORT) as u16;
        let address = Ipv4Addr::from(self.registers.get(bootstrap::STREAM_ADDRESS));
        (port != 0 && !address.is_unspecified()).then(|| (address, port).into())
    }

    /// Size of a stream packet, IP and UDP header included, bytes.
    pub fn packet_bytes(&self) -> usize {
        (self.registers.get(bootstrap::STREAM_PACKET) & 0xffff) as usize
    }

    /// Pause from one stream packet to the next, ns: ticks of the clock of this device.
    pub fn packet_delay_ns(&self) -> u64 {
        self.registers.get(bootstrap::STREAM_DELAY).into()
    }

    /// Exposure time that was set, µs.
    pub fn exposure_us(&self) -> f32 {
        f32::from_bits(self.registers.get(feature::EXPOSURE_US))
    }

    /// Whether a trigger of this source takes a frame now.
    pub fn waits_for(&self, source: u32) -> bool {
        let r = &self.registers;
        self.is_acquiring() && r.get(feature::TRIGGER_MODE) == 1 && r.get(feature::TRIGGER_SOURCE) == source
    }

    /// Whether frames are taken without a trigger.
    pub fn runs_free(&self) -> bool {
        self.is_acquiring() && self.registers.get(feature::TRIGGER_MODE) == 0
    }

    /// Whether the client started the acquisition.
    pub fn is_acquiring(&self) -> bool {
        self.registers.get(feature::ACQUISITION) == 1
    }

    /// Takes control from a client that was silent for longer than its heartbeat.
    pub fn expire(&mut self, now_ns: u64) {
        let limit_ns = u64::from(self.registers.get(bootstrap::HEARTBEAT_MS)) * 1_000_000;
        if self.controller.is_some_and(|(_, last_ns)| now_ns.saturating_sub(last_ns) > limit_ns) {
            self.release();
        }
    }

    fn release(&mut self) {
        self.controller = None;
        self.last = None;
        for register in [bootstrap::CONTROL, bootstrap::STREAM_PORT, feature::ACQUISITION, feature::LOCKED] {
            self.registers.set(register, 0);
        }
    }

    /// Takes a datagram: the acknowledgement, if one is due, and what is to be done.
    pub fn take(&mut self, datagram: &[u8], from: SocketAddr, now_ns: u64) -> (Option<Vec<u8>>, Action) {
        self.expire(now_ns);
        let Some(request) = Request::parse(datagram) else { return (None, Action::None) };
        if let Some((_, last_ns)) = self.controller.as_mut().filter(|(client, _)| *client == from) {
            *last_ns = now_ns;
        }
        // A client whose answer was lost asks again: the command must not be carried out twice.
        let again = self.last.as_ref().filter(|(client, id, _)| (*client, *id) == (from, request.id));
        if let Some((_, _, answer)) = again.filter(|_| request.acknowledge) {
            return (Some(answer.clone()), Action::None);
        }
        let (status, payload, action) = self.execute(&request, from, now_ns);
        let answer = request.answer(status, &payload);
        if request.acknowledge
            && matches!(request.command, Command::WriteRegisters(_) | Command::WriteMemory { .. })
        {
            self.last = Some((from, request.id, answer.clone()));
        }
        (request.acknowledge.then_some(answer), action)
    }

    fn execute(&mut self, request: &Request<'_>, from: SocketAddr, now_ns: u64) -> (Status, Vec<u8>, Action) {
        let plain = |status| (status, Vec::new(), Action::None);
        match request.command {
            Command::Discovery => {
                let block = self.registers.read(0, bootstrap::DISCOVERY_BYTES).unwrap_or_default();
                (Status::Success, block.to_vec(), Action::None)
            }
            Command::ReadRegisters(addresses) => {
                let mut values = Vec::new();
                for address in addresses.as_chunks::<4>().0 {
                    let address = u32::from_be_bytes(*address);
                    if address == bootstrap::TIME_HIGH || address == bootstrap::TIME_LOW {
                        self.registers.set(bootstrap::TIME_HIGH, (now_ns >> 32) as u32);
                        self.registers.set(bootstrap::TIME_LOW, now_ns as u32);
                    }
                    if address == feature::TEMPERATURE_C {
                        let celsius = temperature_c(self.quirks.warm_up_s, now_ns);
                        self.registers.set(address, celsius.to_bits());
                    }
                    match self.registers.read(address, 4) {
                        Some(_) if !address.is_multiple_of(4) => return plain(Status::BadAlignment),
                        Some(value) => values.extend(value),
                        None => return plain(Status::InvalidAddress),
                    }
                }
                (Status::Success, values, Action::None)
            }
            Command::ReadMemory { address, count } => {
                if !address.is_multiple_of(4) || !count.is_multiple_of(4) {
                    return plain(Status::BadAlignment);
                }
                match self.registers.read(address, count) {
                    Some(data) if count <= MAX_READ_BYTES => {
                        (Status::Success, [&address.to_be_bytes(), data].concat(), Action::None)
                    }
                    Some(_) => plain(Status::InvalidParameter),
                    None => plain(Status::InvalidAddress),
                }
            }
            Command::WriteRegisters(pairs) => self.write_registers(pairs, from, now_ns),
            Command::WriteMemory { .. } if !self.controls(from) => plain(Status::AccessDenied),
            Command::WriteMemory { address: bootstrap::USER_NAME, data } if data.len() == 16 => {
                let text = String::from_utf8_lossy(data);
                self.registers.set_text(bootstrap::USER_NAME, text.trim_end_matches('\0'), 16);
                (Status::Success, vec![0, 0, 0, 16], Action::None)
            }
            Command::WriteMemory { address, data } => self.write_memory(address, data, from, now_ns),
            Command::Resend { block, first, last } => {
                (Status::Success, Vec::new(), Action::Resend { block, first, last })
            }
            Command::Malformed => plain(Status::InvalidParameter),
            Command::Unknown => plain(Status::NotImplemented),
        }
    }

    /// Writes registers as bytes: some clients set numbers with a fraction so.
    fn write_memory(
        &mut self,
        address: u32,
        data: &[u8],
        from: SocketAddr,
        now_ns: u64,
    ) -> (Status, Vec<u8>, Action) {
        let mut action = Action::None;
        let (words, rest) = data.as_chunks::<4>();
        if !rest.is_empty() {
            return (Status::BadAlignment, Vec::new(), action);
        }
        for (index, word) in words.iter().enumerate() {
            let written = address.checked_add(4 * index as u32).ok_or(Status::InvalidAddress);
            match written.and_then(|address| self.write(address, u32::from_be_bytes(*word), from, now_ns)) {
                Ok(Action::None) => {}
                Ok(next) => action = next,
                Err(status) => return (status, (4 * index as u32).to_be_bytes().to_vec(), action),
            }
        }
        (Status::Success, (data.len() as u32).to_be_bytes().to_vec(), action)
    }

    fn controls(&self, from: SocketAddr) -> bool {
        self.controller.is_some_and(|(client, _)| client == from)
    }

    fn write_registers(&mut self, pairs: &[u8], from: SocketAddr, now_ns: u64) -> (Status, Vec<u8>, Action) {
        let mut action = Action::None;
        for (index, pair) in pairs.as_chunks::<8>().0.iter().enumerate() {
            let (address, value) = pair.split_at(4);
            let number = |bytes: &[u8]| bytes.try_into().map_or(0, u32::from_be_bytes);
            match self.write(number(address), number(value), from, now_ns) {
                Ok(Action::None) => {}
                Ok(next) => action = next,
                Err(status) => return (status, (index as u32).to_be_bytes().to_vec(), action),
            }
        }
        (Status::Success, ((pairs.len() / 8) as u32).to_be_bytes().to_vec(), action)
    }

    fn write(&mut self, address: u32, value: u32, from: SocketAddr, now_ns: u64) -> Result<Action, Status> {
        if !address.is_multiple_of(4) {
            return Err(Status::BadAlignment);
        }
        let controls = self.controls(from);
        if address == bootstrap::CONTROL {
            return self.change_control(value, from, now_ns, controls);
        }
        if !controls {
            return Err(Status::AccessDenied);
        }
        if !Registers::is_writable(address) {
            let known = self.registers.read(address, 4).is_some();
            return Err(if known { Status::WriteProtect } else { Status::InvalidAddress });
        }
        if self.quirks.stuck == Some(address) {
            return Ok(Action::None);
        }
        match address {
            bootstrap::STREAM_PACKET => {
                let bytes = (value & 0xffff).clamp(PACKET_BYTES[0], PACKET_BYTES[1]) / 4 * 4;
                self.registers.set(address, value & PACKET_FLAGS & !FIRE_TEST | bytes);
                return Ok(if value & FIRE_TEST != 0 { Action::TestPacket } else { Action::None });
            }
            feature::PIXEL_FORMAT if value != self.pixel_format() => return Err(Status::InvalidParameter),
            feature::TRIGGER_SOFTWARE => {
                let ready = self.waits_for(SOFTWARE);
                return Ok(if ready && value == 1 { Action::Trigger } else { Action::None });
            }
            _ => self.check(address, value)?,
        }
        if region::has(address) {
            region::write(&mut self.registers, address, value, self.bytes_per_px)?;
            return Ok(Action::None);
        }
        self.registers.set(address, value);
        match address {
            feature::CLOCK => {
                self.clock_since_ns = now_ns;
                self.update_clock(now_ns);
            }
            feature::CLOCK_UPDATE => self.update_clock(now_ns),
            _ => {}
        }
        Ok(Action::None)
    }

    /// Whether a feature may take a value now.
    fn check(&self, address: u32, value: u32) -> Result<(), Status> {
        let within = |[least, most]: [f32; 2]| {
            let number = f32::from_bits(value);
            if (least..=most).contains(&number) { Ok(()) } else { Err(Status::InvalidParameter) }
        };
        let known = |most: u32| if value <= most { Ok(()) } else { Err(Status::InvalidParameter) };
        match address {
            feature::EXPOSURE_US if self.registers.get(feature::EXPOSURE_AUTO) != 0 => {
                Err(Status::WriteProtect)
            }
            feature::EXPOSURE_US => within(EXPOSURE_US),
            feature::GAIN_DB => within(GAIN_DB),
            feature::TRIGGER_MODE | feature::TRIGGER_SOURCE | feature::EXPOSURE_AUTO | feature::CLOCK => {
                known(1)
            }
            feature::ACQUISITION_MODE | feature::TRIGGER_SELECTOR | feature::TRIGGER_ACTIVATION => known(0),
            _ if region::has(address) && self.is_acquiring() => Err(Status::WriteProtect),
            _ => Ok(()),
        }
    }

    /// The state of the clock as it is read until the next update.
    fn update_clock(&mut self, now_ns: u64) {
        let listens = self.quirks.no_clock || now_ns.saturating_sub(self.clock_since_ns) < CLOCK_NS;
        let state = match self.registers.get(feature::CLOCK) {
            0 => CLOCK_OFF,
            _ if listens => CLOCK_LISTENS,
            _ => CLOCK_FOLLOWS,
        };
        self.registers.set(feature::CLOCK_STATE, state);
    }

    fn change_control(
        &mut self,
        value: u32,
        from: SocketAddr,
        now_ns: u64,
        controls: bool,
    ) -> Result<Action, Status> {
        if !controls && self.controller.is_some() {
            return Err(Status::AccessDenied);
        }
        if value & IN_CONTROL == 0 {
            self.release();
        } else {
            self.controller = Some((from, now_ns));
            self.registers.set(bootstrap::CONTROL, value & IN_CONTROL);
        }
        Ok(Action::None)
    }
}
