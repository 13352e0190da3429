//! GigE Vision control protocol (GVCP): commands of a client, acknowledgements of a device. UDP port 3956, big-endian.

/// The port of every device.
pub const PORT: u16 = 3956;

/// Largest datagram of the protocol, bytes.
pub const MAX_DATAGRAM: usize = 576;

/// Bytes of memory that one acknowledgement carries at most.
pub const MAX_READ_BYTES: usize = 536;

const KEY: u8 = 0x42;
const HEADER_BYTES: usize = 8;
const ACKNOWLEDGE: u8 = 0x01;
const EXTENDED_IDS: u8 = 0x10;

/// Codes of the commands; the acknowledgement of a command is the next number.
pub mod code {
    pub const DISCOVERY: u16 = 0x0002;
    pub const PACKET_RESEND: u16 = 0x0040;
    pub const READ_REGISTER: u16 = 0x0080;
    pub const WRITE_REGISTER: u16 = 0x0082;
    pub const READ_MEMORY: u16 = 0x0084;
    pub const WRITE_MEMORY: u16 = 0x0086;
}

/// How a command ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u16)]
pub enum Status {
    /// The command was carried out.
    Success = 0x0000,
    /// The device does not know this command.
    NotImplemented = 0x8001,
    /// A parameter is not valid.
    InvalidParameter = 0x8002,
    /// There is nothing at this address.
    InvalidAddress = 0x8003,
    /// The register can only be read.
    WriteProtect = 0x8004,
    /// Addresses and lengths are multiples of four.
    BadAlignment = 0x8005,
    /// Another client controls the device, or none does.
    AccessDenied = 0x8006,
}

/// A command with its parameters.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Command<'a> {
    /// Asks every device for its identity.
    Discovery,
    /// Values of registers; four bytes of address each.
    ReadRegisters(&'a [u8]),
    /// Register values; four bytes of address and four of value each.
    WriteRegisters(&'a [u8]),
    /// So many bytes of memory.
    ReadMemory { address: u32, count: usize },
    /// Writes bytes into the memory.
    WriteMemory { address: u32, data: &'a [u8] },
    /// These packets of a block once more, both ends included.
    Resend { block: u64, first: u32, last: u32 },
    /// A command whose parameters have the wrong length.
    Malformed,
    /// A command that is not known.
    Unknown,
}

/// One datagram of a client.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Request<'a> {
    /// Number that the acknowledgement repeats; never 0.
    pub id: u16,
    /// Code of the command.
    pub code: u16,
    /// Whether the client waits for an acknowledgement.
    pub acknowledge: bool,
    /// The command with its parameters.
    pub command: Command<'a>,
}

fn u32_at(bytes: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_be_bytes(bytes.get(at..at + 4)?.try_into().ok()?))
}

fn u16_at(bytes: &[u8], at: usize) -> Option<u16> {
    Some(u16::from_be_bytes(bytes.get(at..at + 2)?.try_into().ok()?))
}

impl<'a> Request<'a> {
    /// Reads a datagram; `None` for one that is no command of this protocol.
    pub fn parse(datagram: &'a [u8]) -> Option<Self> {
        if *datagram.first()? != KEY {
            return None;
        }
        let flags = *datagram.get(1)?;
        let (code, length, id) = (u16_at(datagram, 2)?, u16_at(datagram, 4)?, u16_at(datagram, 6)?);
        let payload = datagram.get(HEADER_BYTES..HEADER_BYTES + usize::from(length))?;
        let command = Self::command(code, flags, payload).unwrap_or(Command::Malformed);
        Some(Self { id, code, acknowledge: flags & ACKNOWLEDGE != 0, command })
    }

    fn command(code: u16, flags: u8, payload: &'a [u8]) -> Option<Command<'a>> {
        let whole = |size: usize| !payload.is_empty() && payload.len().is_multiple_of(size);
        Some(match code {
            code::DISCOVERY => Command::Discovery,
            code::READ_REGISTER if whole(4) => Command::ReadRegisters(payload),
            code::WRITE_REGISTER if whole(8) => Command::WriteRegisters(payload),
            code::READ_MEMORY => {
                Command::ReadMemory { address: u32_at(payload, 0)?, count: usize::from(u16_at(payload, 6)?) }
            }
            code::WRITE_MEMORY => {
                Command::WriteMemory { address: u32_at(payload, 0)?, data: payload.get(4..)? }
            }
            code::PACKET_RESEND if flags & EXTENDED_IDS != 0 => Command::Resend {
                block: u64::from(u32_at(payload, 12)?) << 32 | u64::from(u32_at(payload, 16)?),
                first: u32_at(payload, 4)?,
                last: u32_at(payload, 8)?,
            },
            code::PACKET_RESEND => Command::Resend {
                block: u64::from(u16_at(payload, 2)?),
                first: u32_at(payload, 4)? & 0x00ff_ffff,
                last: u32_at(payload, 8)? & 0x00ff_ffff,
            },
            code::READ_REGISTER | code::WRITE_REGISTER => return None,
            _ => Command::Unknown,
        })
    }

    /// The acknowledgement of this request.
    pub fn answer(&self, status: Status, payload: &[u8]) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(HEADER_BYTES + payload.len());
        bytes.extend((status as u16).to_be_bytes());
        bytes.extend((self.code | 1).to_be_bytes());
        bytes.extend((payload.len() as u16).to_be_bytes());
        bytes.extend(self.id.to_be_bytes());
        bytes.extend(payload);
        bytes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_are_read_as_the_standard_writes_them() {
        let read = [0x42, 0x01, 0x00, 0x80, 0x00, 0x04, 0x00, 0x07, 0x00, 0x00, 0x0a, 0x00];
        let request = Request::parse(&read).unwrap();
        assert_eq!((request.id, request.acknowledge), (7, true));
        assert_eq!(request.command, Command::ReadRegisters(&[0, 0, 0x0a, 0]));
        assert_eq!(request.answer(Status::Success, &[0, 0, 0, 2]), [0, 0, 0, 0x81, 0, 4, 0, 7, 0, 0, 0, 2]);

        let resend = [0x42, 0, 0, 0x40, 0, 12, 0, 9, 0, 0, 0, 5, 0, 0, 0, 3, 0, 0, 0, 4];
        let request = Request::parse(&resend).unwrap();
        assert_eq!(request.command, Command::Resend { block: 5, first: 3, last: 4 });
        assert!(!request.acknowledge);
    }

    #[test]
    fn a_datagram_of_any_bytes_is_read_or_refused() {
        let mut state = 1_u64;
        for _ in 0..20_000 {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let length = (state >> 33) as usize % 40;
            let mut bytes: Vec<u8> = (0..length).map(|i| (state >> (i % 8 * 8)) as u8).collect();
            if length > 4 {
                bytes[0] = 0x42;
                bytes[2] = 0;
            }
            let _ = Request::parse(&bytes);
        }
        assert_eq!(Request::parse(&[]), None);
        assert_eq!(Request::parse(&[0x42, 1, 0, 0x80, 0, 8, 0, 1, 0, 0]), None, "shorter than it says");
        let odd = [0x42, 1, 0, 0x80, 0, 2, 0, 1, 0, 0];
        assert_eq!(Request::parse(&odd).unwrap().command, Command::Malformed);
    }
}
