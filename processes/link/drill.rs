//! Faults of a network on request, to try what becomes of them: `FRINGECELL_LINK_DRILL=lose,double,delay,damage`.

use ipc::header::Link;

/// Every so many chunks a fault.
const EVERY: u64 = 5;

/// Faults that are made in turn, and a chunk that is held back.
#[derive(Debug, Default)]
pub struct Drill {
    faults: Vec<String>,
    chunks: u64,
    held: Option<(Link, Vec<u8>)>,
}

impl Drill {
    /// The faults that the environment asks for; usually none.
    pub fn from_environment() -> Self {
        let faults = std::env::var("FRINGECELL_LINK_DRILL").unwrap_or_default();
        Self {
            faults: faults.split(',').filter(|f| !f.is_empty()).map(str::to_owned).collect(),
            ..Self::default()
        }
    }

    /// What is sent instead of a chunk.
    pub fn chunks(&mut self, header: Link, payload: &[u8]) -> Vec<(Link, Vec<u8>)> {
        let mut sent: Vec<(Link, Vec<u8>)> = self.held.take().into_iter().collect();
        let message = (header, payload.to_vec());
        self.chunks += 1;
        let turn = (self.chunks / EVERY) as usize % self.faults.len().max(1);
        let fault = self.faults.get(turn).filter(|_| self.chunks.is_multiple_of(EVERY));
        match fault.map(String::as_str) {
            Some("lose") => {}
            Some("double") => sent.extend([message.clone(), message]),
            Some("delay") => self.held = Some(message),
            Some("damage") => {
                let (header, mut payload) = message;
                payload[0] ^= 1;
                sent.push((header, payload));
            }
            _ => sent.push(message),
        }
        sent
    }
}
