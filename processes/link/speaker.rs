//! The thread that speaks with the other hosts.

use super::drill::Drill;
use super::follower::Follower;
use super::leader::Peer;
use anyhow::{Context, Result, anyhow};
use crossbeam::channel::{Sender, bounded};
use ipc::IpcError;
use ipc::header::{Link, LinkKind};
use ipc::link::{HostLink, LinkPlan};
use ipc::os::now_ns;
use serde::Serialize;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

/// Pause of the thread while messages come.
const BUSY_PAUSE: Duration = Duration::from_millis(1);

/// Pause of the thread without messages.
const IDLE_PAUSE: Duration = Duration::from_millis(3);

/// Rounds without a message after which it is idle.
const BUSY_ROUNDS: u32 = 100;

/// Signs of life within the time after which a host counts as lost.
const SIGNS: u64 = 10;

/// Longest pause between two signs of life, ns.
const MAX_SIGN_NS: u64 = 100_000_000;

/// What this host knows of the others.
#[derive(Debug)]
pub enum End {
    /// It leads these hosts.
    Leads(Vec<Peer>),
    /// It is a host that is led.
    Follows(Box<Follower>),
}

/// The thread, and what it shares with the stage.
pub struct Speaker {
    shared: Arc<Mutex<Shared>>,
    thread: Option<JoinHandle<()>>,
}

struct Shared {
    end: End,
    /// Why the thread ended.
    failed: Option<String>,
    stop: bool,
}

impl Speaker {
    /// Opens the link and starts the thread.
    pub fn start(plan: LinkPlan, session: u64, end: End) -> Result<Self> {
        let shared = Arc::new(Mutex::new(Shared { end, failed: None, stop: false }));
        let (opened, is_open) = bounded(1);
        let thread = std::thread::Builder::new()
            .name("link".into())
            .spawn({
                let shared = Arc::clone(&shared);
                move || run(&plan, session, &shared, &opened)
            })
            .context("starting the thread of the link")?;
        is_open.recv().context("the thread of the link ended")??;
        Ok(Self { shared, thread: Some(thread) })
    }

    fn lock(&self) -> MutexGuard<'_, Shared> {
        self.shared.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Asks or tells what is known of one of the hosts that are led.
    pub fn peer<T>(&self, host: usize, ask: impl FnOnce(&mut Peer) -> T) -> Result<T> {
        let mut shared = self.lock();
        if let Some(reason) = &shared.failed {
            return Err(anyhow!("{reason}"));
        }
        match &mut shared.end {
            End::Leads(peers) => Ok(ask(&mut peers[host])),
            End::Follows(_) => Err(anyhow!("this host does not lead")),
        }
    }

    /// Asks or tells what is known of the host that leads.
    pub fn follower<T>(&self, ask: impl FnOnce(&mut Follower) -> T) -> Result<T> {
        let mut shared = self.lock();
        if let Some(reason) = &shared.failed {
            return Err(anyhow!("{reason}"));
        }
        match &mut shared.end {
            End::Follows(follower) => Ok(ask(follower)),
            End::Leads(_) => Err(anyhow!("this host leads")),
        }
    }
}

impl Drop for Speaker {
    fn drop(&mut self) {
        self.lock().stop = true;
        if let Some(thread) = self.thread.take() {
            // A panic of the thread has ended the process already.
            let _ = thread.join();
        }
    }
}

fn run(plan: &LinkPlan, session: u64, shared: &Mutex<Shared>, opened: &Sender<Result<(), IpcError>>) {
    let link = match HostLink::open(plan) {
        Ok(link) => {
            let _ = opened.send(Ok(()));
            link
        }
        Err(error) => {
            let _ = opened.send(Err(error));
            return;
        }
    };
    let sign_ns = (plan.silence_ms.saturating_mul(1_000_000) / SIGNS).min(MAX_SIGN_NS);
    let mut voice =
        Voice { link, session, sequence: 0, told: Vec::new(), sign_ns, drill: Drill::from_environment() };
    if let Err(error) = voice.speak(shared) {
        shared.lock().unwrap_or_else(PoisonError::into_inner).failed = Some(format!("{error:#}"));
    }
}

/// The last state that a host was told.
#[derive(Default)]
struct Told {
    state: Vec<u8>,
    to: u64,
    at_ns: u64,
}

struct Voice {
    link: HostLink,
    session: u64,
    sequence: u64,
    /// By host, then of the one that is refused.
    told: Vec<[Told; 2]>,
    sign_ns: u64,
    drill: Drill,
}

impl Voice {
    fn speak(&mut self, shared: &Mutex<Shared>) -> Result<()> {
        let mut quiet = 0;
        loop {
            self.link.spin();
            let mut guard = shared.lock().unwrap_or_else(PoisonError::into_inner);
            if guard.stop {
                return Ok(());
            }
            let moved = match &mut guard.end {
                End::Leads(peers) => self.lead(peers)?,
                End::Follows(follower) => self.follow(follower)?,
            };
            drop(guard);
            quiet = if moved { 0 } else { quiet + 1 };
            std::thread::sleep(if quiet < BUSY_ROUNDS { BUSY_PAUSE } else { IDLE_PAUSE });
        }
    }

    fn lead(&mut self, peers: &mut [Peer]) -> Result<bool> {
        let mut moved = false;
        for (host, peer) in peers.iter_mut().enumerate() {
            while let Some((header, payload)) = self.link.receive(host)? {
                peer.hear(now_ns(), &header, &payload);
                moved = true;
            }
            peer.update(now_ns());
            let (to, state) = peer.tell();
            self.tell(host, 0, to, &state)?;
            if let Some((to, state)) = peer.refusal(now_ns()) {
                self.tell(host, 1, to, &state)?;
            }
        }
        Ok(moved)
    }

    fn follow(&mut self, follower: &mut Follower) -> Result<bool> {
        let mut moved = false;
        while let Some((header, payload)) = self.link.receive(0)? {
            follower.hear(now_ns(), &header, &payload);
            moved = true;
        }
        while let Some((header, payload)) = follower.next_chunk() {
            for (header, payload) in self.drill.chunks(header, payload) {
                self.sequence += 1;
                let header = Link { sender: self.session, sequence: self.sequence, ..header };
                self.link.send(0, header, &payload)?;
                self.link.spin();
            }
            moved = true;
        }
        let (to, state) = follower.tell(now_ns());
        self.tell(0, 0, to, &state)?;
        if let Some((to, state)) = follower.refusal(now_ns()) {
            self.tell(0, 1, to, &state)?;
        }
        Ok(moved)
    }

    /// Sends a state that is new, or a sign of life when it is due.
    fn tell<T: Serialize>(&mut self, host: usize, which: usize, to: u64, state: &T) -> Result<()> {
        if self.told.len() <= host {
            self.told.resize_with(host + 1, Default::default);
        }
        let (told, now) = (&mut self.told[host][which], now_ns());
        let state = serde_json::to_vec(state)?;
        if told.to == to && told.state == state && now.saturating_sub(told.at_ns) < self.sign_ns {
            return Ok(());
        }
        self.sequence += 1;
        let header = Link {
            sender: self.session,
            receiver: to,
            sequence: self.sequence,
            kind: LinkKind::State as u32,
            ..Link::default()
        };
        self.link.send(host, header, &state)?;
        self.link.spin();
        *told = Told { state, to, at_ns: now };
        Ok(())
    }
}
