//! The sockets of a simulated camera: one thread answers commands and streams the frames.

use super::device::{Action, Device, Identity};
use super::gvcp::{Command, MAX_DATAGRAM, PORT, Request};
use super::gvsp::{Block, next_id};
use crate::background::Background;
use std::collections::VecDeque;
use std::io;
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::time::{Duration, Instant};

/// Frames that are kept for lost packets.
const KEPT_BLOCKS: usize = 4;

/// How often a silent client is looked for.
const TICK: Duration = Duration::from_millis(100);

/// Where the frames of a camera come from.
pub trait FrameSource: Send {
    /// Writes the frame of this moment, as many bytes as the identity states; an error is a frame that never comes.
    ///
    /// # Errors
    /// There is nothing to see.
    fn expose(&mut self, exposure_us: f32, pixels: &mut Vec<u8>) -> Result<(), String>;
}

/// What goes wrong on the way, for tests: every so many packets or frames, 0 for never.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Faults {
    /// Every n-th packet is not sent at first.
    pub drop_every: u64,
    /// Every n-th packet is sent twice.
    pub duplicate_every: u64,
    /// Every n-th packet changes places with the next one.
    pub swap_every: u64,
    /// Every n-th trigger is ignored.
    pub ignore_trigger_every: u64,
    /// Whether lost packets are sent again when asked for.
    pub no_resend: bool,
}

/// A camera on the network, until dropped.
#[derive(Debug)]
pub struct Server {
    address: SocketAddr,
    _answering: Background,
}

impl Server {
    /// Opens the control port of a camera and answers from then on.
    ///
    /// # Errors
    /// The port of this address is taken or may not be opened.
    pub fn start(identity: Identity, source: Box<dyn FrameSource>, faults: Faults) -> io::Result<Self> {
        let control = UdpSocket::bind((identity.address, PORT))?;
        control.set_read_timeout(Some(TICK))?;
        let stream = UdpSocket::bind((identity.address, 0))?;
        let address = control.local_addr()?;
        let mut camera = Camera {
            device: Device::new(&identity),
            identity,
            source,
            faults,
            control,
            stream,
            blocks: VecDeque::new(),
            next: 1,
            sent: 0,
            triggers: 0,
            started: Instant::now(),
            packet: Vec::new(),
        };
        let answering = Background::start("gige camera", move || camera.answer())?;
        Ok(Self { address, _answering: answering })
    }

    /// Address and port of its commands.
    pub fn address(&self) -> SocketAddr {
        self.address
    }
}

/// Answers a search by broadcast for several cameras of this computer, until dropped.
#[derive(Debug)]
pub struct Responder {
    _answering: Background,
}

impl Responder {
    /// Listens on a broadcast address.
    ///
    /// # Errors
    /// The port of this address is taken or may not be opened.
    pub fn start(broadcast: Ipv4Addr, cameras: &[Identity]) -> io::Result<Self> {
        let socket = UdpSocket::bind((broadcast, PORT))?;
        socket.set_read_timeout(Some(TICK))?;
        let mut devices = Vec::new();
        for identity in cameras {
            devices.push((Device::new(identity), UdpSocket::bind((identity.address, 0))?));
        }
        let mut buffer = [0; MAX_DATAGRAM + 64];
        let answering = Background::start("gige search", move || {
            let Ok((length, from)) = socket.recv_from(&mut buffer) else { return };
            let request = Request::parse(&buffer[..length]);
            if request.is_none_or(|request| request.command != Command::Discovery) {
                return;
            }
            for (device, socket) in &mut devices {
                if let (Some(answer), _) = device.take(&buffer[..length], from, 0) {
                    let _ = socket.send_to(&answer, from);
                }
            }
        })?;
        Ok(Self { _answering: answering })
    }
}

struct Camera {
    identity: Identity,
    device: Device,
    source: Box<dyn FrameSource>,
    faults: Faults,
    control: UdpSocket,
    stream: UdpSocket,
    blocks: VecDeque<Block>,
    next: u16,
    sent: u64,
    triggers: u64,
    started: Instant,
    packet: Vec<u8>,
}

/// Whether this is the n-th of every n.
fn is_nth(count: u64, every: u64) -> bool {
    every != 0 && count.is_multiple_of(every)
}

impl Camera {
    fn now_ns(&self) -> u64 {
        self.started.elapsed().as_nanos() as u64
    }

    /// Answers one command, if one comes within a tick.
    fn answer(&mut self) {
        let mut buffer = [0; MAX_DATAGRAM + 64];
        let Ok((length, from)) = self.control.recv_from(&mut buffer) else {
            self.device.expire(self.now_ns());
            return;
        };
        let now_ns = self.now_ns();
        let (answer, action) = self.device.take(&buffer[..length], from, now_ns);
        if let Some(answer) = answer {
            // A client that is gone receives nothing: the heartbeat ends its control.
            let _ = self.control.send_to(&answer, from);
        }
        match action {
            Action::None => {}
            Action::Trigger => self.expose(),
            Action::TestPacket => self.test_packet(),
            Action::Resend { block, first, last } => self.resend(block, first, last),
        }
    }

    fn test_packet(&mut self) {
        let Some(destination) = self.device.destination() else { return };
        let bytes = self.device.packet_bytes().saturating_sub(28);
        let _ = self.stream.send_to(&vec![0; bytes], destination);
    }

    fn expose(&mut self) {
        self.triggers += 1;
        if is_nth(self.triggers, self.faults.ignore_trigger_every) {
            return;
        }
        let mut pixels = if self.blocks.len() < KEPT_BLOCKS {
            Vec::with_capacity(self.identity.frame_bytes())
        } else {
            self.blocks.pop_front().map(|block| block.pixels).unwrap_or_default()
        };
        pixels.clear();
        let timestamp_ns = self.now_ns();
        if self.source.expose(self.device.exposure_us(), &mut pixels).is_err() {
            return;
        }
        let block = Block {
            id: self.next,
            timestamp_ns,
            pixel_format: self.device.pixel_format(),
            width_px: self.identity.width_px,
            height_px: self.identity.height_px,
            packet_bytes: self.device.packet_bytes(),
            pixels,
        };
        self.next = next_id(self.next);
        self.send(&block);
        self.blocks.push_back(block);
    }

    fn send(&mut self, block: &Block) {
        let Some(destination) = self.device.destination() else { return };
        let mut late = Vec::new();
        for number in 0..block.packets() {
            block.packet(number, &mut self.packet);
            self.sent += 1;
            if is_nth(self.sent, self.faults.drop_every) {
                continue;
            }
            if is_nth(self.sent, self.faults.swap_every) && late.is_empty() {
                late.clone_from(&self.packet);
                continue;
            }
            let copies = 1 + usize::from(is_nth(self.sent, self.faults.duplicate_every));
            for _ in 0..copies {
                let _ = self.stream.send_to(&self.packet, destination);
            }
            if !late.is_empty() {
                let _ = self.stream.send_to(&late, destination);
                late.clear();
            }
        }
        if !late.is_empty() {
            let _ = self.stream.send_to(&late, destination);
        }
    }

    fn resend(&mut self, block: u64, first: u32, last: u32) {
        let Some(destination) = self.device.destination().filter(|_| !self.faults.no_resend) else { return };
        let Some(block) = self.blocks.iter().find(|kept| u64::from(kept.id) == block) else { return };
        for number in first..=last.min(block.packets().saturating_sub(1)) {
            if block.packet(number, &mut self.packet) {
                let _ = self.stream.send_to(&self.packet, destination);
            }
        }
    }
}
