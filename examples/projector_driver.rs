//! A projector driver of one's own: a projector that takes lines of text over TCP (`show 4`, `dark`) and answers `ok`, run through
//! the checks that every driver has to pass. A real one opens its device in the same place.
//!
//! ```console
//! $ cargo run --example projector_driver
//! ```

use devices::{DeviceError, Light, conformance};
use std::io::{BufRead, BufReader, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::time::Duration;

/// The driver: a connection, and the name of the projector for messages.
struct TextProjector {
    name: String,
    stream: BufReader<TcpStream>,
}

impl TextProjector {
    /// Opens the device when the stage starts: an absent projector is then an error at the start.
    fn open(name: &str, address: SocketAddr) -> Result<Self, DeviceError> {
        let failed = |error| DeviceError::Frame(format!("projector \"{name}\" at {address}: {error}"));
        let stream = TcpStream::connect_timeout(&address, Duration::from_secs(1)).map_err(failed)?;
        // An answer that never comes must not hold the cell.
        stream.set_read_timeout(Some(Duration::from_secs(1))).map_err(failed)?;
        Ok(Self { name: name.to_owned(), stream: BufReader::new(stream) })
    }

    /// Sends a line and waits until the pattern stands.
    fn ask(&mut self, line: &str) -> Result<(), DeviceError> {
        let mut answer = String::new();
        let asked = writeln!(self.stream.get_mut(), "{line}");
        asked
            .and_then(|()| self.stream.read_line(&mut answer))
            .map_err(|e| self.failed(line, &e.to_string()))?;
        if answer.trim() == "ok" { Ok(()) } else { Err(self.failed(line, answer.trim())) }
    }

    fn failed(&self, line: &str, why: &str) -> DeviceError {
        DeviceError::Frame(format!("projector \"{}\": \"{line}\": {why}", self.name))
    }
}

impl Light for TextProjector {
    fn show(&mut self, frame: usize) -> Result<(), DeviceError> {
        self.ask(&format!("show {frame}"))
    }

    fn darken(&mut self) -> Result<(), DeviceError> {
        self.ask("dark")
    }
}

/// What stands for the device here: it knows 18 patterns.
fn device(listener: &TcpListener) -> std::io::Result<()> {
    let (stream, _) = listener.accept()?;
    let mut lines = BufReader::new(stream.try_clone()?).lines();
    while let Some(Ok(line)) = lines.next() {
        let known = line == "dark" || (0..18).any(|frame| line == format!("show {frame}"));
        writeln!(&stream, "{}", if known { "ok" } else { "no such pattern" })?;
    }
    Ok(())
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let listener = TcpListener::bind("127.0.0.1:0")?;
    let address = listener.local_addr()?;
    std::thread::spawn(move || device(&listener));
    let mut projector = TextProjector::open("proj1", address)?;
    conformance::check_light(&mut projector, 18, Duration::from_secs(5))?;
    println!("the driver does what a cell asks of a projector");
    Ok(())
}
