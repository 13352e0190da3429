//! Emulated projector boards, for tests without hardware: they take the reports that the guides document, refuse all else, and
//! tell what their mirrors would show.

mod dlpc350;
mod dlpc900;
pub(crate) mod erle;

pub use dlpc350::{Dlpc350, picture_of_display};
pub use dlpc900::Dlpc900;

use crate::background::Background;
use crate::lightcrafter::{REPORT_BYTES, Report, Transport};
use std::collections::VecDeque;
use std::io::{self, ErrorKind, Read, Write};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// What a controller does with a command.
pub trait Board: Send {
    /// A value is set.
    ///
    /// # Errors
    /// The guide does not allow it here: the board refuses, and the text states why.
    fn write(&mut self, command: u16, data: &[u8]) -> Result<(), String>;

    /// A value is asked for.
    ///
    /// # Errors
    /// As for [`Board::write`].
    fn read(&mut self, command: u16) -> Result<Vec<u8>, String>;

    /// What the mirrors show, a level 0 … 255 for each of them; `None` when they are dark.
    fn shown(&self) -> Option<Vec<u8>>;

    /// The patterns of a sequence that runs once, and the time from one to the next, µs.
    fn sequence(&self) -> Option<(Vec<Vec<u8>>, u32)> {
        None
    }
}

/// A value that is the one that was set, or found, after some reads.
#[derive(Debug, Clone, Copy)]
struct Slow {
    value: u8,
    coming: Option<(u8, u32)>,
}

impl Slow {
    /// Is this value, and stays so.
    fn new(value: u8) -> Self {
        Self { value, coming: None }
    }

    /// Becomes another value after so many reads; what it is already it stays.
    fn become_after(&mut self, value: u8, reads: u32) {
        self.coming = (self.settled() != Some(value)).then_some((value, reads));
    }

    /// The value, where it does not change any more.
    fn settled(&self) -> Option<u8> {
        self.coming.is_none().then_some(self.value)
    }

    fn read(&mut self) -> u8 {
        match &mut self.coming {
            Some((value, 0)) => *self = Self::new(*value),
            Some((_, reads)) => *reads -= 1,
            None => {}
        }
        self.value
    }
}

/// What goes wrong, by the number of a command.
#[derive(Debug, Clone, Copy, Default)]
pub struct BoardFaults {
    /// This command is refused.
    pub refuse: Option<u16>,
    /// This command is not answered.
    pub silent: Option<u16>,
    /// The answer to this command is a report of ten bytes.
    pub short: Option<u16>,
    /// The value of this command is another one when it is read back.
    pub forget: Option<u16>,
    /// After so many reports the device is gone.
    pub vanish_after: Option<usize>,
    /// After so many starts of a sequence the device is gone.
    pub vanish_after_starts: Option<usize>,
}

/// A board behind the protocol of reports.
pub struct Emulator {
    board: Box<dyn Board>,
    faults: BoardFaults,
    /// The message that is coming in, and its full length.
    message: Vec<u8>,
    expected: usize,
    answers: VecDeque<Vec<u8>>,
    reports: usize,
    starts: usize,
    started: bool,
    last_sequence: Option<u8>,
    /// Everything that no guide allows, in words.
    violations: Vec<String>,
}

impl Emulator {
    /// A board without a cable yet.
    pub fn new(board: impl Board + 'static, faults: BoardFaults) -> Self {
        Self {
            board: Box::new(board),
            faults,
            message: Vec::new(),
            expected: 0,
            answers: VecDeque::new(),
            reports: 0,
            starts: 0,
            started: false,
            last_sequence: None,
            violations: Vec::new(),
        }
    }

    /// What the mirrors show.
    pub fn shown(&self) -> Option<Vec<u8>> {
        self.board.shown()
    }

    /// The patterns of a sequence that was started to run once since this was asked for, and the time from one to the next, µs.
    pub fn take_sequence(&mut self) -> Option<(Vec<Vec<u8>>, u32)> {
        std::mem::take(&mut self.started).then(|| self.board.sequence()).flatten()
    }

    /// Everything that no guide allows, in words; empty for a driver that knows them.
    pub fn violations(&self) -> &[String] {
        &self.violations
    }

    /// Takes a report; answers wait until they are fetched.
    fn take(&mut self, report: &Report) -> io::Result<()> {
        self.reports += 1;
        let beyond = |most: Option<usize>, count: usize| most.is_some_and(|most| count > most);
        if beyond(self.faults.vanish_after, self.reports)
            || beyond(self.faults.vanish_after_starts, self.starts)
        {
            return Err(io::Error::new(ErrorKind::NotConnected, "no such device"));
        }
        if self.message.is_empty() {
            let length = usize::from(u16::from_le_bytes([report[2], report[3]]));
            self.expected = 4 + length;
            if !(2..=508).contains(&length) {
                self.violations.push(format!("a message of {length} bytes"));
                return Ok(());
            }
        }
        let part = (self.expected - self.message.len()).min(REPORT_BYTES);
        self.message.extend(&report[..part]);
        if report[part..].iter().any(|byte| *byte != 0) {
            self.violations.push("bytes behind the end of a message".into());
        }
        if self.message.len() == self.expected {
            let message = std::mem::take(&mut self.message);
            self.carry_out(&message);
        }
        Ok(())
    }

    fn carry_out(&mut self, message: &[u8]) {
        let [flags, sequence, _, _, low, high, data @ ..] = message else { return };
        let command = u16::from_le_bytes([*low, *high]);
        if self.last_sequence.is_some_and(|last| *sequence != last.wrapping_add(1)) {
            self.violations
                .push(format!("{command:#06x}: sequence number {sequence} after {:?}", self.last_sequence));
        }
        self.last_sequence = Some(*sequence);
        self.starts += usize::from(command == 0x1a24 && data == [2]);
        self.started |= command == 0x1a24 && data == [2];
        let done = match flags {
            0x40 => self.board.write(command, data).map(|()| Vec::new()),
            0xc0 => self.board.read(command),
            _ => Err(format!("flags {flags:#04x}")),
        };
        let is = |fault: Option<u16>| fault == Some(command);
        let refused = is(self.faults.refuse);
        let mut answer = match done {
            Ok(answer) if !refused => answer,
            Ok(_) => Vec::new(),
            Err(reason) => {
                self.violations.push(format!("{command:#06x} {data:02x?}: {reason}"));
                return self.answer(flags | 0x20, *sequence, &[]);
            }
        };
        if is(self.faults.silent) {
            return;
        }
        if is(self.faults.forget) && *flags == 0xc0 {
            for byte in &mut answer {
                *byte = byte.wrapping_add(1);
            }
        }
        if is(self.faults.short) {
            self.answers.push_back(vec![*flags; 10]);
            return;
        }
        self.answer(if refused { flags | 0x20 } else { *flags }, *sequence, &answer);
    }

    fn answer(&mut self, flags: u8, sequence: u8, data: &[u8]) {
        let mut message = vec![flags, sequence];
        message.extend((data.len() as u16).to_le_bytes());
        message.extend(data);
        for part in message.chunks(REPORT_BYTES) {
            let mut report = part.to_vec();
            report.resize(REPORT_BYTES, 0);
            self.answers.push_back(report);
        }
    }
}

/// A board that a driver and a test look at together.
#[derive(Clone)]
pub struct SharedEmulator(Arc<Mutex<Emulator>>);

impl SharedEmulator {
    /// A board to be shared.
    pub fn new(emulator: Emulator) -> Self {
        Self(Arc::new(Mutex::new(emulator)))
    }

    /// The board, for as long as the guard lives.
    pub fn lock(&self) -> MutexGuard<'_, Emulator> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Answers at a Unix socket, until dropped; `look` looks at the board after each report, and every 20 ms.
    ///
    /// # Errors
    /// The path is taken or cannot be written.
    pub fn serve(
        &self,
        path: &Path,
        mut look: impl FnMut(&mut Emulator) + Send + 'static,
    ) -> io::Result<ServedBoard> {
        let listener = UnixListener::bind(path)?;
        listener.set_nonblocking(true)?;
        let board = self.clone();
        let mut client: Option<UnixStream> = None;
        let answering = Background::start("board", move || {
            let Some(stream) = &mut client else {
                match listener.accept() {
                    Ok((stream, _)) => {
                        let wait = Some(Duration::from_millis(20));
                        client = stream.set_read_timeout(wait).is_ok().then_some(stream);
                        board.lock().restart();
                    }
                    Err(_) => std::thread::sleep(Duration::from_millis(5)),
                }
                return;
            };
            let mut report = [0; REPORT_BYTES];
            match stream.read_exact(&mut report) {
                Ok(()) => {
                    let mut emulator = board.lock();
                    let mut done = emulator.take(&report);
                    // Before the driver goes on.
                    look(&mut emulator);
                    while let (Ok(()), Some(answer)) = (&done, emulator.answers.pop_front()) {
                        done = stream.write_all(&answer);
                    }
                    if done.is_err() {
                        client = None;
                    }
                }
                // What a board shows from its video input changes without a report.
                Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {
                    look(&mut board.lock());
                }
                Err(_) => client = None,
            }
        })?;
        Ok(ServedBoard { _answering: answering })
    }
}

/// A board that answers at a Unix socket, until dropped.
#[derive(Debug)]
pub struct ServedBoard {
    _answering: Background,
}

impl Emulator {
    /// A cable that is plugged in again: nothing is under way.
    fn restart(&mut self) {
        self.message.clear();
        self.answers.clear();
        self.last_sequence = None;
    }
}

impl Transport for SharedEmulator {
    fn send(&mut self, report: &Report) -> io::Result<()> {
        self.lock().take(report)
    }

    fn receive(&mut self, report: &mut Report, wait: Duration) -> io::Result<usize> {
        let answer = self.lock().answers.pop_front();
        let Some(answer) = answer else {
            // Nothing comes by itself: what is not there now does not come later.
            std::thread::sleep(wait.min(Duration::from_millis(10)));
            return Ok(0);
        };
        report[..answer.len()].copy_from_slice(&answer);
        Ok(answer.len())
    }
}

/// A value of some bytes, little-endian.
fn number(data: &[u8]) -> u32 {
    data.iter().rev().fold(0, |value, byte| value << 8 | u32::from(*byte))
}

/// Data of a command that has this many bytes.
fn bytes<const N: usize>(data: &[u8]) -> Result<[u8; N], String> {
    data.try_into().map_err(|_| format!("{} bytes of data instead of {N}", data.len()))
}

#[cfg(test)]
mod tests;
