//! The stage `link` of the host that leads: lets the others take their frames, and takes their clouds.

use super::leader::{CameCloud, Peer};
use super::speaker::{End, Speaker};
use super::{identity, plan};
use crate::stage::{Fault, Report, StageContext, TextBuffer, Worker};
use anyhow::Result;
use cell::schedule::{Kind, Work};
use fringe::cloud::Point;
use ipc::IpcError;
use ipc::header::Cloud;
use ipc::link::{LinkEnd, new_session};
use ipc::os::now_ns;
use ipc::port::Publisher;
use std::collections::BTreeMap;
use std::time::Duration;

/// Pause between two looks at what came, ns.
const LOOK_NS: u64 = 2_000_000;

/// Pause between two looks for hosts at the start.
const START_PAUSE: Duration = Duration::from_millis(20);

/// How long a host may be away until an operator is told, ns.
const TELL_AFTER_NS: u64 = 3_000_000_000;

/// The link of the host that leads.
pub struct Receive {
    speaker: Speaker,
    /// Hosts in the order of the link, as indices of the graph.
    hosts: Vec<usize>,
    clouds: BTreeMap<usize, Publisher<Cloud>>,
    /// What the schedule wants, in its order.
    works: Vec<Work>,
    /// Place of the next one in `works`.
    next: usize,
    /// Since when the next one may start, ns.
    since_ns: Option<u64>,
    /// Whether the host was told to begin.
    asked: bool,
    /// When the light of each host was off, by the clock of this one, ns.
    light_off_ns: Vec<u64>,
    /// Longest wait for a host, ns: shorter than the supervisor waits for this stage.
    patience_ns: u64,
    text: TextBuffer,
}

impl Receive {
    /// Opens the link, and waits for the other hosts as long as a start may take.
    pub fn new(context: &StageContext) -> Result<Self> {
        let (cell, graph) = (&context.cell, &context.cell.graph);
        let (hosts, session) = (graph.led(), new_session()?);
        let silence_ns = cell.config.limits.silence_ms.saturating_mul(1_000_000);
        let mut peers = Vec::new();
        let mut clouds = BTreeMap::new();
        for &host in &hosts {
            let mut pairs = BTreeMap::new();
            for &pair in &graph.hosts[host].pairs {
                let topic = format!("cloud/{}", graph.pairs[pair].name);
                pairs.insert(pair as u32, cell.schedule.topic(&topic).map_or(0, |topic| topic.bytes));
                clouds.insert(pair, context.publisher(&topic)?);
            }
            let own = identity(cell)?;
            peers.push(Peer::new(graph.host_name(host), own, session, pairs, size_of::<Point>(), silence_ns));
        }
        let names = hosts.iter().map(|&host| graph.host_name(host).to_owned()).collect();
        let speaker = Speaker::start(plan(cell, LinkEnd::Leads(names))?, session, End::Leads(peers))?;
        let activations = cell.schedule.activations.iter();
        let works = activations.filter(|a| cell.schedule.stages[a.stage].kind == Kind::Link).map(|a| a.work);
        let receive = Self {
            light_off_ns: vec![0; hosts.len()],
            works: works.collect(),
            patience_ns: cell.config.limits.stage_budget_ms.saturating_mul(800_000),
            speaker,
            hosts,
            clouds,
            next: 0,
            since_ns: None,
            asked: false,
            text: TextBuffer::new(),
        };
        receive.wait_for_hosts(cell.config.limits.start_ms)?;
        Ok(receive)
    }

    /// A host that does not come in time is the outcome of the first cycle.
    fn wait_for_hosts(&self, start_ms: u64) -> Result<()> {
        let begin_ns = now_ns();
        let until_ns = begin_ns.saturating_add(start_ms.saturating_mul(750_000));
        let mut told = vec![String::new(); self.hosts.len()];
        while now_ns() < until_ns {
            let mut ready = true;
            for (host, told) in told.iter_mut().enumerate() {
                let state = self.speaker.peer(host, |peer| peer.ready(now_ns()))?;
                ready &= state == Ok(true);
                if let Err(reason) = state
                    && told.is_empty()
                    && now_ns() > begin_ns + TELL_AFTER_NS
                {
                    tracing::warn!("{reason}");
                    *told = reason;
                }
            }
            if ready {
                break;
            }
            std::thread::sleep(START_PAUSE);
        }
        Ok(())
    }

    /// Asks the thread; a link that is broken ends the stage.
    fn peer<T>(&self, host: usize, ask: impl FnOnce(&mut Peer) -> T) -> Result<T, Fault> {
        self.speaker.peer(host, ask).map_err(Fault::Fatal)
    }

    /// Place of a host in the link.
    fn place(&self, host: usize) -> usize {
        self.hosts.iter().position(|&known| known == host).unwrap_or_default()
    }

    fn remote(&mut self, context: &mut StageContext, host: usize, since_ns: u64) -> Result<bool, Fault> {
        let (place, now) = (self.place(host), now_ns());
        let late = now.saturating_sub(since_ns) > self.patience_ns;
        if !self.asked {
            match self.peer(place, |peer| peer.ready(now))? {
                Ok(true) => {
                    let cycle = context.cycle();
                    self.peer(place, |peer| peer.begin(cycle))?;
                    self.asked = true;
                }
                Err(reason) if late => return Err(Fault::Cycle(reason)),
                Ok(false) if late => return Err(self.late(context, host, "its stages are not ready")),
                _ => return Ok(false),
            }
        }
        let acquired = self.peer(place, |peer| peer.is_acquired(now))?.map_err(Fault::Cycle)?;
        if acquired {
            self.light_off_ns[place] = now;
            self.go_on();
            context.done(Work::Remote { host }, since_ns, &[], Report::default())?;
            return Ok(true);
        }
        if late {
            let begun = self.peer(place, |peer| peer.has_begun(now))?;
            let what = if begun { "it has not taken all frames" } else { "it has not begun the cycle" };
            return Err(self.late(context, host, what));
        }
        Ok(false)
    }

    fn receive(&mut self, context: &mut StageContext, pair: usize, since_ns: u64) -> Result<bool, Fault> {
        let graph = &context.cell.graph;
        let host = graph.hosts.iter().position(|host| host.pairs.contains(&pair)).unwrap_or_default();
        let (place, now) = (self.place(host), now_ns());
        match self.peer(place, |peer| peer.take_cloud(now, pair as u32))?.map_err(Fault::Cycle)? {
            Some(cloud) => {
                self.hand_on(context, pair, place, &cloud, since_ns)?;
                Ok(true)
            }
            None if now.saturating_sub(since_ns) > self.patience_ns => {
                let name = graph.pair_name(pair).to_owned();
                Err(self.late(context, host, &format!("the cloud of pair \"{name}\" has not come")))
            }
            None => Ok(false),
        }
    }

    fn late(&self, context: &StageContext, host: usize, what: &str) -> Fault {
        let ms = self.patience_ns / 1_000_000;
        let host = context.cell.graph.host_name(host);
        Fault::Cycle(format!(
            "host \"{host}\": {what} for {ms} ms; raise limits.stage_budget_ms where it needs longer"
        ))
    }

    fn hand_on(
        &mut self,
        context: &mut StageContext,
        pair: usize,
        place: usize,
        cloud: &CameCloud,
        since_ns: u64,
    ) -> Result<(), Fault> {
        let Some(publisher) = self.clouds.get(&pair) else { return Ok(()) };
        let points = cloud.bytes.len() / size_of::<Point>();
        let camera = &context.cell.graph.cameras[context.cell.graph.pairs[pair].left];
        let header = Cloud {
            cycle: context.cycle(),
            // Clocks of hosts differ: the last frame is as old as the news of it.
            t_ns: self.light_off_ns[place],
            pair: pair as u32,
            capacity: camera.width_px * camera.height_px,
            points: points as u32,
        };
        let mut loan = publisher.loan(header)?;
        loan.payload_mut()[..cloud.bytes.len()].copy_from_slice(&cloud.bytes);
        context.sending(|| loan.send())?;
        self.go_on();
        let report = Report { count: points, text: self.text.json(&cloud.counts)? };
        context.done_hashed(Work::Receive { pair }, since_ns, (cloud.bytes.len(), cloud.hash), report)
    }

    fn go_on(&mut self) {
        self.next += 1;
        self.since_ns = None;
        self.asked = false;
    }
}

impl Worker for Receive {
    fn connect(&mut self) -> Result<(), IpcError> {
        Ok(())
    }

    fn begin(&mut self, _context: &mut StageContext) -> Result<(), Fault> {
        self.forget();
        Ok(())
    }

    fn step(&mut self, context: &mut StageContext) -> Result<bool, Fault> {
        let Some(&work) = self.works.get(self.next) else { return Ok(false) };
        if !context.may_start(work) {
            return Ok(false);
        }
        let since_ns = *self.since_ns.get_or_insert_with(now_ns);
        match work {
            Work::Remote { host } => self.remote(context, host, since_ns),
            Work::Receive { pair } => self.receive(context, pair, since_ns),
            _ => Ok(false),
        }
    }

    fn forget(&mut self) {
        self.next = 0;
        self.since_ns = None;
        self.asked = false;
        for host in 0..self.hosts.len() {
            // A link that is broken ends the stage with its next step.
            let _ = self.speaker.peer(host, Peer::drop_cycle);
        }
    }

    fn due_ns(&self) -> Option<u64> {
        self.since_ns.map(|_| now_ns() + LOOK_NS)
    }
}
