//! What a host that is led knows of the one that leads, and tells it. Pure.

use super::assembly::chunk;
use super::message::{HostState, Identity, LeaderState, Offer, Phase};
use super::partner::{Admitted, Partner};
use ipc::header::{Link, LinkKind};
use ipc::output_hash;

/// A host that is led.
#[derive(Debug)]
pub struct Follower {
    own: Identity,
    own_session: u64,
    partner: Partner<LeaderState>,
    phase: Phase,
    /// The last cycle that was begun or refused here.
    cycle: u64,
    clouds: Vec<(Offer, Vec<u8>)>,
    /// Number of the last request for chunks that was answered.
    answered: u64,
    due: Vec<(u32, u32)>,
    renew: bool,
    refused: Option<String>,
}

impl Follower {
    /// A host whose stages start.
    pub fn new(own: Identity, own_session: u64, silence_ns: u64) -> Self {
        Self {
            own,
            own_session,
            partner: Partner::new(silence_ns),
            phase: Phase::Starting,
            cycle: 0,
            clouds: Vec::new(),
            answered: 0,
            due: Vec::new(),
            renew: false,
            refused: None,
        }
    }

    /// Takes a message of the link.
    pub fn hear(&mut self, now_ns: u64, header: &Link, payload: &[u8]) {
        if header.kind() != Ok(LinkKind::State) {
            return;
        }
        let Ok(state) = serde_json::from_slice::<LeaderState>(payload) else { return };
        if header.receiver != 0 && header.receiver != self.own_session {
            return; // for a process that was here before, or another one of the same name
        }
        if let Some(refused) = state.refused {
            self.refused = Some(refused);
            return;
        }
        match self.partner.hear(now_ns, header, state) {
            Admitted::Known | Admitted::First => {}
            Admitted::Another => self.renew = true,
            Admitted::Ignored => return,
        }
        let fetch = self.partner.state(now_ns).and_then(|state| state.fetch.as_ref());
        if let Some(fetch) = fetch.filter(|fetch| fetch.number > self.answered) {
            self.answered = fetch.number;
            let (pair, chunks) = (fetch.pair, fetch.chunks.iter());
            self.due.extend(chunks.map(|chunk| (pair, *chunk)));
        }
    }

    /// Why this process may not be a host of the cell.
    pub fn refused(&self) -> Option<&str> {
        self.refused.as_deref()
    }

    /// Whether another run of the host that leads has begun since this one was first heard.
    pub fn must_renew(&self) -> bool {
        self.renew
    }

    /// All stages of this host are there.
    pub fn set_ready(&mut self) {
        if self.phase == Phase::Starting {
            self.phase = Phase::Ready;
        }
    }

    /// A cycle that is wanted and was not begun or refused yet.
    pub fn wanted(&self, now_ns: u64) -> Option<u64> {
        let leader = self.partner.state(now_ns)?;
        let agrees = self.own.difference(&leader.identity).is_none();
        leader.wanted.filter(|cycle| agrees && *cycle > self.cycle)
    }

    /// Why no cycle can come from the host that leads.
    pub fn trouble(&self, now_ns: u64) -> Option<String> {
        match (self.partner.state(now_ns), self.partner.silent_ms(now_ns)) {
            (Some(leader), _) => self.own.difference(&leader.identity),
            (None, Some(silent_ms)) => Some(format!("the host that leads is silent for {silent_ms} ms")),
            (None, None) => Some("the host that leads was not heard yet".into()),
        }
    }

    /// Notes that a wanted cycle was requested of the supervisor.
    pub fn requested(&mut self, cycle: u64) {
        self.set(cycle, Phase::Ready);
    }

    /// A cycle has begun.
    pub fn begin(&mut self, cycle: u64) {
        self.set(cycle, Phase::Begun);
    }

    fn set(&mut self, cycle: u64, phase: Phase) {
        (self.cycle, self.phase) = (cycle, phase);
        self.clouds.clear();
        self.due.clear();
    }

    /// The light of this host is off.
    pub fn acquired(&mut self) {
        self.phase = Phase::Acquired;
    }

    /// All clouds of the cycle: pair, points, bytes.
    pub fn matched(&mut self, clouds: Vec<(u32, u32, Vec<u8>)>) {
        let offer = |(pair, points, bytes): (u32, u32, Vec<u8>)| {
            let hash = format!("{:032x}", output_hash(&bytes));
            (Offer { pair, points, bytes: bytes.len() as u64, hash }, bytes)
        };
        self.clouds = clouds.into_iter().map(offer).collect();
        self.phase = Phase::Matched;
    }

    /// The cycle ended without its clouds being delivered.
    pub fn failed(&mut self) {
        if matches!(self.phase, Phase::Begun | Phase::Acquired | Phase::Matched) {
            self.phase = Phase::Failed;
        }
        self.clouds.clear();
        self.due.clear();
    }

    /// The clouds were delivered.
    pub fn delivered(&mut self) {
        self.phase = Phase::Ready;
        self.clouds.clear();
        self.due.clear();
    }

    /// Whether the host that leads has all clouds of the cycle.
    ///
    /// # Errors
    /// It does not want them any more, or is lost.
    pub fn is_delivered(&self, now_ns: u64) -> Result<bool, String> {
        let Some(leader) = self.partner.state(now_ns) else {
            let silent_ms = self.partner.silent_ms(now_ns).unwrap_or_default();
            return Err(format!(
                "no sign of life of the host that leads for {silent_ms} ms: it or the link is lost"
            ));
        };
        if leader.received >= self.cycle {
            return Ok(true);
        }
        if leader.wanted == Some(self.cycle) {
            return Ok(false);
        }
        Err(format!(
            "host \"{}\", which leads, ended the cycle; its own outcome says why",
            leader.identity.host
        ))
    }

    /// The next chunk that is due: header and payload.
    pub fn next_chunk(&mut self) -> Option<(Link, &[u8])> {
        while let Some((pair, number)) = (!self.due.is_empty()).then(|| self.due.remove(0)) {
            let place = self.clouds.iter().position(|(offer, _)| offer.pair == pair);
            let Some(place) = place.filter(|&place| chunk(&self.clouds[place].1, number as usize).is_some())
            else {
                continue;
            };
            let header = Link {
                receiver: self.partner.session().unwrap_or_default(),
                cycle: self.cycle,
                kind: LinkKind::Chunk as u32,
                pair,
                chunk: number,
                ..Link::default()
            };
            return chunk(&self.clouds[place].1, number as usize).map(|bytes| (header, bytes));
        }
        None
    }

    /// The state that the host that leads shall hear, and its session; 0: any.
    pub fn tell(&self, now_ns: u64) -> (u64, HostState) {
        let leader = self.partner.state(now_ns);
        // The next run of the host that leads makes this host begin anew: until then it must not be counted on.
        let left = leader.is_none() && self.partner.session().is_some();
        let state = HostState {
            identity: self.own.clone(),
            phase: if self.renew || left { Phase::Starting } else { self.phase },
            cycle: self.cycle,
            clouds: self.clouds.iter().map(|(offer, _)| offer.clone()).collect(),
            problem: None,
        };
        // One that fell silent is not answered any more: its next run has to hear this host.
        (leader.and_then(|_| self.partner.session()).unwrap_or_default(), state)
    }

    /// What a second leader shall hear.
    pub fn refusal(&self, now_ns: u64) -> Option<(u64, HostState)> {
        let session = self.partner.rival(now_ns)?;
        let leader = self.partner.state(now_ns).map_or("another host", |state| &state.identity.host);
        let problem = Some(format!(
            "it is led by another supervisor of host \"{leader}\"; stop one of the two that lead this cell"
        ));
        Some((session, HostState { identity: self.own.clone(), problem, ..HostState::default() }))
    }
}
