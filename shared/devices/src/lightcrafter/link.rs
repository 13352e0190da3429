//! Commands and answers of a board in reports of 64 bytes.
//!
//! A message has a header of four bytes (flags, sequence number, length of the rest as 16 bits), two bytes of command (the low
//! one first) and its data. What does not fit into the first report continues in further ones without a header. Sources: DLPU010
//! section 1.2 and DLPU018J section 1.2 (USB interface).

use super::transport::{REPORT_BYTES, Report, Transport};
use std::time::{Duration, Instant};

/// Flag: the device answers. DLPU018J tables 1-5 and 1-7, bit 6.
pub const ANSWER: u8 = 0x40;
/// Flag: a value is asked for. Bit 7.
pub const READ: u8 = 0x80;
/// Flag of an answer: the command is unknown or failed. Bit 5.
pub const REFUSED: u8 = 0x20;

/// Longest message of a controller after its header: its buffer has 512 bytes (DLPU018J 1.2.1), and 504 bytes of data are sent
/// with two bytes of command and two of length.
pub const MOST_BYTES: usize = 508;

/// Longest time until an answer.
const WAIT: Duration = Duration::from_secs(1);

/// A command of both controllers, as the guides number it: CMD2 in the high byte, CMD3 in the low one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Command(pub u16, pub &'static str);

impl std::fmt::Display for Command {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "command {:#06x} ({})", self.0, self.1)
    }
}

/// The commands to a board and its answers.
pub struct Link {
    transport: Box<dyn Transport>,
    sequence: u8,
    /// Whether answers carry the sequence number of their command: DLPU018 states it of the DLPC900.
    answers_in_sequence: bool,
}

impl Link {
    /// Commands over this transport.
    pub fn new(transport: Box<dyn Transport>, answers_in_sequence: bool) -> Self {
        Self { transport, sequence: 0, answers_in_sequence }
    }

    /// Sends a command with its data and waits until it is carried out.
    ///
    /// # Errors
    /// The device refuses, does not answer or is gone; the text names the command.
    pub fn write(&mut self, command: Command, data: &[u8]) -> Result<(), String> {
        self.send(ANSWER, command, data)?;
        self.answer(command).map(|_| ())
    }

    /// Asks for a value of so many bytes at least.
    ///
    /// # Errors
    /// As [`Self::write`]; an answer that is too short.
    pub fn read(&mut self, command: Command, least_bytes: usize) -> Result<Vec<u8>, String> {
        self.send(READ | ANSWER, command, &[])?;
        let data = self.answer(command)?;
        if data.len() < least_bytes {
            return Err(format!("{command}: the answer has {} bytes instead of {least_bytes}", data.len()));
        }
        Ok(data)
    }

    /// Sends a command and reads back what it set.
    ///
    /// # Errors
    /// As [`Self::read`]; another value.
    pub fn set(&mut self, command: Command, data: &[u8]) -> Result<(), String> {
        self.write(command, data)?;
        let found = self.read(command, data.len())?;
        if found[..data.len()] != *data {
            return Err(format!(
                "{command}: {data:02x?} was set, the board has {:02x?}",
                &found[..data.len()]
            ));
        }
        Ok(())
    }

    /// Asks for the first byte of a value until it is as wanted.
    ///
    /// # Errors
    /// As [`Self::read`]; it is not so within the time.
    pub fn until(
        &mut self,
        command: Command,
        within: Duration,
        wanted: impl Fn(u8) -> bool,
    ) -> Result<u8, String> {
        let start = Instant::now();
        loop {
            let found = self.read(command, 1)?[0];
            if wanted(found) {
                return Ok(found);
            }
            if start.elapsed() > within {
                return Err(format!("{command}: {found:#04x} after {:.1} s", within.as_secs_f64()));
            }
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    fn send(&mut self, flags: u8, command: Command, data: &[u8]) -> Result<(), String> {
        let length = data.len() + 2;
        if length > MOST_BYTES {
            return Err(format!("{command}: {} bytes of data are too many for one message", data.len()));
        }
        self.drain(command)?;
        self.sequence = self.sequence.wrapping_add(1);
        let mut message = vec![flags, self.sequence];
        message.extend((length as u16).to_le_bytes());
        message.extend(command.0.to_le_bytes());
        message.extend(data);
        for part in message.chunks(REPORT_BYTES) {
            let mut report = [0; REPORT_BYTES];
            report[..part.len()].copy_from_slice(part);
            self.transport.send(&report).map_err(|error| format!("{command}: {error}"))?;
        }
        Ok(())
    }

    /// Throws away what answers an earlier command.
    fn drain(&mut self, command: Command) -> Result<(), String> {
        let mut report = [0; REPORT_BYTES];
        for _ in 0..64 {
            let came = self.transport.receive(&mut report, Duration::ZERO);
            if came.map_err(|error| format!("{command}: {error}"))? == 0 {
                return Ok(());
            }
        }
        Err(format!("{command}: the device sends without end"))
    }

    fn answer(&mut self, command: Command) -> Result<Vec<u8>, String> {
        let start = Instant::now();
        loop {
            let report = self.report(command, start)?;
            let [flags, sequence, low, high, first @ ..] = report;
            let length = usize::from(u16::from_le_bytes([low, high]));
            let stale = self.answers_in_sequence && sequence != self.sequence;
            if length > MOST_BYTES {
                return Err(format!("{command}: the answer claims {length} bytes"));
            }
            let mut data = first[..length.min(first.len())].to_vec();
            while data.len() < length {
                let further = self.report(command, start)?;
                data.extend(&further[..(length - data.len()).min(REPORT_BYTES)]);
            }
            if stale {
                continue;
            }
            if flags & REFUSED != 0 {
                return Err(format!("{command}: the board refuses it"));
            }
            return Ok(data);
        }
    }

    fn report(&mut self, command: Command, start: Instant) -> Result<Report, String> {
        let mut report = [0; REPORT_BYTES];
        let left = WAIT.saturating_sub(start.elapsed());
        match self.transport.receive(&mut report, left).map_err(|error| format!("{command}: {error}"))? {
            0 => Err(format!("{command}: no answer within {} s", WAIT.as_secs())),
            REPORT_BYTES => Ok(report),
            count => Err(format!("{command}: an answer of {count} bytes, reports have {REPORT_BYTES}")),
        }
    }
}
