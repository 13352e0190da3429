//! One direction of a connection that is slower than the cable below it: for tests of hosts that are far apart.

use std::io::{Read as _, Write as _};
use std::net::{Shutdown, TcpStream};
use std::sync::mpsc::sync_channel;
use std::time::{Duration, Instant};

/// Writes what is read from one end to the other, in order, each piece as much later as `delay` says of it.
pub fn carry(mut from: TcpStream, mut to: TcpStream, mut delay: impl FnMut() -> Duration + Send + 'static) {
    let (sender, waiting) = sync_channel::<(Instant, Vec<u8>)>(4096);
    std::thread::spawn(move || {
        let mut bytes = vec![0; 1 << 14];
        while let Ok(count @ 1..) = from.read(&mut bytes) {
            if sender.send((Instant::now() + delay(), bytes[..count].to_vec())).is_err() {
                return;
            }
        }
    });
    std::thread::spawn(move || {
        for (due, bytes) in waiting {
            std::thread::sleep(due.saturating_duration_since(Instant::now()));
            if to.write_all(&bytes).is_err() {
                return;
            }
        }
        let _ = to.shutdown(Shutdown::Both);
    });
}
