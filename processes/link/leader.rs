//! What the host that leads knows of one of the others, and wants of it. Pure.

use super::assembly::{Added, Assembly};
use super::message::{Counts, Fetch, HostState, Identity, LeaderState, Phase};
use super::partner::{Admitted, Partner};
use ipc::header::{Link, LinkKind};
use std::collections::BTreeMap;

/// Chunks that are asked for at once: they fit in the buffers on their way.
const WINDOW: usize = 16;

/// Chunks that have not come after this long are asked for again, ns.
const REPEAT_NS: u64 = 250_000_000;

/// A cloud that is complete.
#[derive(Debug)]
pub struct CameCloud {
    /// The points as they were sent.
    pub bytes: Vec<u8>,
    /// Hash of the points.
    pub hash: u128,
    /// How its chunks came.
    pub counts: Counts,
}

/// One of the hosts that are led.
#[derive(Debug)]
pub struct Peer {
    name: String,
    own: Identity,
    own_session: u64,
    /// Pairs of the host, with the largest cloud of each, bytes.
    pairs: BTreeMap<u32, u64>,
    point_bytes: usize,
    partner: Partner<HostState>,
    /// The cycle that is wanted, and the session that it is wanted of.
    wanted: Option<(u64, u64)>,
    received: u64,
    coming: Option<(u32, Assembly)>,
    asked: Vec<u32>,
    next_chunk: usize,
    fetch: Option<Fetch>,
    fetches: u64,
    progress_ns: u64,
    came: BTreeMap<u32, CameCloud>,
    counts: Counts,
    /// Why the cycle that is wanted cannot be had any more.
    lost: Option<String>,
}

impl Peer {
    /// A host that was not heard yet.
    pub fn new(
        name: &str,
        own: Identity,
        own_session: u64,
        pairs: BTreeMap<u32, u64>,
        point_bytes: usize,
        silence_ns: u64,
    ) -> Self {
        Self {
            name: name.to_owned(),
            own,
            own_session,
            pairs,
            point_bytes,
            partner: Partner::new(silence_ns),
            wanted: None,
            received: 0,
            coming: None,
            asked: Vec::new(),
            next_chunk: 0,
            fetch: None,
            fetches: 0,
            progress_ns: 0,
            came: BTreeMap::new(),
            counts: Counts::default(),
            lost: None,
        }
    }

    /// Takes a message of the link.
    pub fn hear(&mut self, now_ns: u64, header: &Link, payload: &[u8]) {
        let for_us = header.receiver == 0 || header.receiver == self.own_session;
        let state = match header.kind() {
            Ok(LinkKind::Chunk) if for_us => return self.hear_chunk(now_ns, header, payload),
            Ok(LinkKind::State) => serde_json::from_slice::<HostState>(payload).ok(),
            _ => None,
        };
        let Some(state) = state.filter(|state| state.identity.host == self.name) else {
            self.counts.strange += 1;
            return;
        };
        if !for_us {
            return; // it follows another leader, and tells that one
        }
        if self.partner.hear(now_ns, header, state) == Admitted::Another {
            let (name, wanted) = (&self.name, self.wanted.is_some());
            self.lost = wanted.then(|| format!("host \"{name}\" was started again during the cycle"));
        }
    }

    fn hear_chunk(&mut self, now_ns: u64, header: &Link, payload: &[u8]) {
        let known = self.partner.hear_more(now_ns, header.sender);
        let of_cycle = self.wanted.is_some_and(|(cycle, _)| cycle == header.cycle);
        let coming = self.coming.as_mut().filter(|(pair, _)| known && of_cycle && *pair == header.pair);
        let Some((_, assembly)) = coming else {
            // A chunk that was asked for twice may come after its cloud is complete.
            let late = known && header.cycle <= self.received.max(self.wanted.map_or(0, |(cycle, _)| cycle));
            if late {
                self.counts.doubled += 1;
            } else {
                self.counts.strange += 1;
            }
            return;
        };
        match assembly.add(header.chunk as usize, payload) {
            Added::New => {
                self.asked.retain(|asked| *asked != header.chunk);
                self.progress_ns = now_ns;
            }
            Added::Doubled => self.counts.doubled += 1,
            Added::Strange => self.counts.strange += 1,
        }
    }

    /// Whether the host can take a cycle, or why not.
    ///
    /// # Errors
    /// It is silent, differs from this host, or says why it does not follow.
    pub fn ready(&self, now_ns: u64) -> Result<bool, String> {
        let state = self.state(now_ns)?;
        Ok(!matches!(state.phase, Phase::Starting))
    }

    fn state(&self, now_ns: u64) -> Result<&HostState, String> {
        let name = &self.name;
        let Some(silent_ms) = self.partner.silent_ms(now_ns) else {
            return Err(format!(
                "host \"{name}\" was not heard yet; start the cell there with `fringecell run CONFIG --host {name}`, and check the \
                 network"
            ));
        };
        let Some(state) = self.partner.state(now_ns) else {
            return Err(format!(
                "no sign of life of host \"{name}\" for {silent_ms} ms: the host or the link is lost"
            ));
        };
        if let Some(difference) = self.own.difference(&state.identity) {
            return Err(difference);
        }
        match &state.problem {
            Some(problem) => Err(format!("host \"{name}\": {problem}")),
            None => Ok(state),
        }
    }

    /// Wants a cycle of the host, which has to be [`Self::ready`].
    pub fn begin(&mut self, cycle: u64) {
        self.drop_cycle();
        self.wanted = self.partner.session().map(|session| (cycle, session));
        self.counts = Counts::default();
    }

    /// The cycle has ended, with or without the clouds of the host.
    pub fn drop_cycle(&mut self) {
        self.wanted = None;
        self.coming = None;
        self.fetch = None;
        self.asked.clear();
        self.came.clear();
        self.lost = None;
    }

    /// Whether the light of the host is off again in the cycle that is wanted.
    ///
    /// # Errors
    /// Why the cycle cannot be had.
    pub fn is_acquired(&self, now_ns: u64) -> Result<bool, String> {
        if self.wanted.is_none() {
            return Ok(true); // all its clouds are here
        }
        let phase = self.phase(now_ns)?;
        Ok(matches!(phase, Some(Phase::Acquired | Phase::Matched)))
    }

    /// Whether the host has begun the cycle that is wanted.
    pub fn has_begun(&self, now_ns: u64) -> bool {
        self.wanted.is_none() || matches!(self.phase(now_ns), Ok(Some(_)))
    }

    /// The cloud of a pair, once it is complete.
    ///
    /// # Errors
    /// Why it cannot be had.
    pub fn take_cloud(&mut self, now_ns: u64, pair: u32) -> Result<Option<CameCloud>, String> {
        match self.came.remove(&pair) {
            Some(cloud) => Ok(Some(cloud)),
            None => self.phase(now_ns).map(|_| None),
        }
    }

    /// What the host does in the cycle that is wanted; nothing yet: `None`.
    fn phase(&self, now_ns: u64) -> Result<Option<Phase>, String> {
        if let Some(lost) = &self.lost {
            return Err(lost.clone());
        }
        let state = self.state(now_ns)?;
        let wanted = self.wanted.filter(|(cycle, _)| *cycle == state.cycle);
        match wanted.map(|_| state.phase) {
            Some(Phase::Failed) => {
                Err(format!("host \"{}\" ended the cycle; its own outcome says why", self.name))
            }
            Some(Phase::Starting | Phase::Ready) | None => Ok(None),
            Some(phase) => Ok(Some(phase)),
        }
    }

    /// Goes on with the clouds. Call it often.
    pub fn update(&mut self, now_ns: u64) {
        let Ok(Some(Phase::Matched)) = self.phase(now_ns) else { return };
        if let Err(reason) = self.fetch(now_ns) {
            self.lost = Some(format!("host \"{}\": {reason}", self.name));
        }
    }

    fn fetch(&mut self, now_ns: u64) -> Result<(), String> {
        if self.coming.is_none() {
            let Some(next) = self.pairs.keys().copied().find(|pair| !self.came.contains_key(pair)) else {
                return Ok(());
            };
            let state = self.state(now_ns)?;
            let offer = state
                .clouds
                .iter()
                .find(|offer| offer.pair == next)
                .ok_or("it offers no cloud of a pair of its")?;
            let assembly = Assembly::new(offer, self.point_bytes, self.pairs[&next])?;
            self.counts = Counts { chunks: assembly.chunks() as u64, ..Counts::default() };
            self.coming = Some((next, assembly));
            (self.next_chunk, self.progress_ns) = (0, now_ns);
            self.asked.clear();
        }
        let Some((pair, assembly)) = &self.coming else { return Ok(()) };
        let pair = *pair;
        if assembly.is_complete() {
            return self.finish();
        }
        if self.asked.len() <= WINDOW / 2 && self.next_chunk < assembly.chunks() {
            let end = (self.next_chunk + WINDOW - self.asked.len()).min(assembly.chunks());
            let chunks: Vec<u32> = (self.next_chunk..end).map(|chunk| chunk as u32).collect();
            self.next_chunk = end;
            self.asked.extend(&chunks);
            self.ask(pair, chunks);
        } else if now_ns.saturating_sub(self.progress_ns) > REPEAT_NS {
            self.progress_ns = now_ns;
            self.counts.repeated += self.asked.len() as u64;
            self.ask(pair, self.asked.clone());
        }
        Ok(())
    }

    fn ask(&mut self, pair: u32, chunks: Vec<u32>) {
        self.fetches += 1;
        self.fetch = Some(Fetch { number: self.fetches, pair, chunks });
    }

    fn finish(&mut self) -> Result<(), String> {
        let Some((pair, assembly)) = self.coming.take() else { return Ok(()) };
        let bytes = assembly.finish()?;
        let hash = ipc::output_hash(&bytes);
        self.came.insert(pair, CameCloud { bytes, hash, counts: self.counts });
        self.fetch = None;
        if let Some((cycle, _)) = self.wanted
            && self.pairs.keys().all(|pair| self.came.contains_key(pair))
        {
            (self.received, self.wanted) = (cycle, None);
        }
        Ok(())
    }

    /// The state that the host shall hear, and the session that it is for; 0: any.
    pub fn tell(&self) -> (u64, LeaderState) {
        let state = LeaderState {
            identity: self.own.clone(),
            wanted: self.wanted.map(|(cycle, _)| cycle),
            received: self.received,
            fetch: self.fetch.clone(),
            refused: None,
        };
        (self.partner.session().unwrap_or_default(), state)
    }

    /// What a second host of the same name shall hear.
    pub fn refusal(&self, now_ns: u64) -> Option<(u64, LeaderState)> {
        let session = self.partner.rival(now_ns)?;
        let refused = Some(format!(
            "another supervisor is host \"{}\" of this cell already; stop one of them, or give this one another name in --host",
            self.name
        ));
        Some((session, LeaderState { identity: self.own.clone(), refused, ..LeaderState::default() }))
    }
}

#[cfg(test)]
#[path = "leader_tests.rs"]
mod tests;
