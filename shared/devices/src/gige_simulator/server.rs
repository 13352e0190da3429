//! The sockets of a simulated camera: one thread answers commands and streams the frames.

use super::description::LINE1;
use super::device::{Action, Device};
use super::gvcp::{Command, MAX_DATAGRAM, PORT, Request};
use super::gvsp::{Block, next_id};
use super::identity::{Identity, Quirks};
use crate::background::Background;
use fringe::decode::OrderEvent;
use std::collections::VecDeque;
use std::io;
use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4, UdpSocket};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Memory for frames whose packets may be asked for again, bytes; and how many frames at least and at most.
const KEPT_BYTES: usize = 64 << 20;
const KEPT_BLOCKS: [usize; 2] = [4, 64];

/// Longest pause between two packets, ns: a frame must not take so long that its client thinks the camera dead.
const LONGEST_DELAY_NS: u64 = 100_000;

/// How often a silent client is looked for, and a frame is taken without a trigger.
const TICK: Duration = Duration::from_millis(100);

/// Why a trigger gives no frame.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum NoFrame {
    /// There is nothing to see, for this reason.
    Nothing(String),
    /// The camera answers nothing for this time.
    Silent(Duration),
}

/// Where the frames of a camera come from.
pub trait FrameSource: Send {
    /// Writes the frame of this moment: whole rows of the sensor, usually as many as the identity states. `fired`: what the
    /// projector shows at the moment of its trigger; absent, the trigger is by software.
    ///
    /// # Errors
    /// There is nothing to see.
    fn expose(
        &mut self,
        exposure_us: f32,
        fired: Option<Pattern>,
        pixels: &mut Vec<u8>,
    ) -> Result<(), NoFrame>;
}

/// Projector and frame of its sequence, both from 0.
pub type Pattern = (usize, usize);

/// The cable from a projector to the first input of a camera.
#[derive(Debug)]
pub struct Line {
    fired: Arc<Mutex<VecDeque<Pattern>>>,
    wake: UdpSocket,
    camera: SocketAddr,
}

impl Line {
    /// Fires the camera while the projector shows a pattern.
    pub fn fire(&self, pattern: Pattern) {
        self.fired.lock().unwrap_or_else(PoisonError::into_inner).push_back(pattern);
        // No command of the standard is so short; the camera looks at its line after every datagram, and every tick.
        let _ = self.wake.send_to(&[0], self.camera);
    }
}

/// What goes wrong on the way, for tests: every so many packets or frames, 0 for never.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
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
    /// What happens to the order of the frames in every cycle.
    pub order: Option<OrderEvent>,
    /// Seed of an event in every second cycle, drawn from all that the order of frames may suffer, frames that never come, frames of a wrong size, and
    /// a camera that is silent for some seconds.
    pub storm: Option<u64>,
    /// What is particular about the camera itself.
    pub quirks: Quirks,
}

/// A camera on the network, until dropped.
#[derive(Debug)]
pub struct Server {
    address: SocketAddr,
    fired: Arc<Mutex<VecDeque<Pattern>>>,
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
        let fired = Arc::new(Mutex::new(VecDeque::new()));
        let mut camera = Camera {
            fired: fired.clone(),
            device: Device::new(&identity, faults.quirks),
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
            last_free: Instant::now(),
            silent_until: None,
        };
        let answering = Background::start("gige camera", move || camera.answer())?;
        Ok(Self { address, fired, _answering: answering })
    }

    /// The cable to its first input.
    ///
    /// # Errors
    /// No socket can be opened.
    pub fn line(&self) -> io::Result<Line> {
        let wake = UdpSocket::bind((self.address.ip(), 0))?;
        Ok(Line { fired: self.fired.clone(), wake, camera: self.address })
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
        let socket = shared_socket(broadcast, PORT)?;
        socket.set_read_timeout(Some(TICK))?;
        let mut devices = Vec::new();
        for identity in cameras {
            devices.push((Device::new(identity, Quirks::default()), UdpSocket::bind((identity.address, 0))?));
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

/// A socket beside those of other programs on the same broadcast address: each of them gets what is sent there.
fn shared_socket(broadcast: Ipv4Addr, port: u16) -> io::Result<UdpSocket> {
    use rustix::net::{AddressFamily, SocketFlags, SocketType, bind, socket_with, sockopt};
    let socket = socket_with(AddressFamily::INET, SocketType::DGRAM, SocketFlags::CLOEXEC, None)?;
    sockopt::set_socket_reuseaddr(&socket, true)?;
    bind(&socket, &SocketAddrV4::new(broadcast, port))?;
    Ok(socket.into())
}

struct Camera {
    fired: Arc<Mutex<VecDeque<Pattern>>>,
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
    /// When the last frame was taken without a trigger.
    last_free: Instant,
    /// The camera answers nothing until then.
    silent_until: Option<Instant>,
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
        let received = self.control.recv_from(&mut buffer);
        if self.silent_until.is_some_and(|until| Instant::now() < until) {
            self.fired.lock().unwrap_or_else(PoisonError::into_inner).clear();
            self.device.expire(self.now_ns());
            return;
        }
        self.look_at_line();
        if self.device.runs_free() && self.last_free.elapsed() >= TICK {
            self.last_free = Instant::now();
            self.expose(None);
        }
        let Ok((length, from)) = received else {
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
            Action::Trigger => self.expose(None),
            Action::TestPacket => self.test_packet(),
            Action::Resend { block, first, last } => self.resend(block, first, last),
        }
    }

    fn test_packet(&mut self) {
        let Some(destination) = self.device.destination() else { return };
        let bytes = self.device.packet_bytes().saturating_sub(28);
        let _ = self.stream.send_to(&vec![0; bytes], destination);
    }

    /// Takes a frame for each time that the projector fired; without a client that waits for it the cable is not connected.
    fn look_at_line(&mut self) {
        loop {
            let next = self.fired.lock().unwrap_or_else(PoisonError::into_inner).pop_front();
            let Some(pattern) = next else { return };
            if self.device.waits_for(LINE1) {
                self.expose(Some(pattern));
            }
        }
    }

    fn expose(&mut self, fired: Option<Pattern>) {
        self.triggers += 1;
        if is_nth(self.triggers, self.faults.ignore_trigger_every) {
            return;
        }
        let kept = (KEPT_BYTES / self.identity.frame_bytes().max(1)).clamp(KEPT_BLOCKS[0], KEPT_BLOCKS[1]);
        let mut pixels = if self.blocks.len() < kept {
            Vec::with_capacity(self.identity.frame_bytes())
        } else {
            self.blocks.pop_front().map(|block| block.pixels).unwrap_or_default()
        };
        pixels.clear();
        let timestamp_ns = self.now_ns();
        match self.source.expose(self.device.exposure_us(), fired, &mut pixels) {
            Ok(()) => {}
            Err(NoFrame::Nothing(_)) => return,
            Err(NoFrame::Silent(time)) => {
                self.silent_until = Some(Instant::now() + time);
                return;
            }
        }
        let (region, bytes_per_px) = (self.device.region(), self.identity.bytes_per_px() as usize);
        region.cut(bytes_per_px, &mut pixels);
        let row_bytes = (region.size[0] as usize * bytes_per_px).max(1);
        let block = Block {
            id: self.next,
            timestamp_ns,
            pixel_format: self.device.pixel_format(),
            corner_px: region.corner,
            width_px: region.size[0],
            height_px: (pixels.len() / row_bytes) as u32,
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
        let (start, delay) =
            (Instant::now(), Duration::from_nanos(self.device.packet_delay_ns().min(LONGEST_DELAY_NS)));
        for number in 0..block.packets() {
            // A pause that is shorter than the system can sleep is made up for by the next ones.
            std::thread::sleep((start + delay * number).saturating_duration_since(Instant::now()));
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
