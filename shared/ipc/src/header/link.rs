//! Header of messages between the hosts of a cell.

use super::{Header, value};
use crate::error::MessageError;
use crate::output_hash;
use iceoryx2::prelude::ZeroCopySend;

/// Largest payload of a message between hosts, bytes: a chunk of a cloud, or a state as JSON.
pub const LINK_BYTES: usize = 1 << 18;

/// A message between two hosts. No time is in it: the clocks of two hosts differ.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ZeroCopySend)]
#[repr(C)]
#[repr(align(64))]
#[type_name("fringecell.Link.1")]
pub struct Link {
    /// Session of the sender: a random number of each start.
    pub sender: u64,
    /// Session that it is for; 0: any.
    pub receiver: u64,
    /// Number of the message among those of its sender, from 1.
    pub sequence: u64,
    /// Cycle that it belongs to, from 1; 0 outside of cycles.
    pub cycle: u64,
    /// Hash of header and payload (xxh3, 128 bits), high half.
    pub hash_high: u64,
    /// Low half of the hash.
    pub hash_low: u64,
    /// The number of a [`LinkKind`].
    pub kind: u32,
    /// Of a chunk: index of the pair.
    pub pair: u32,
    /// Of a chunk: its number in the cloud, from 0.
    pub chunk: u32,
    /// Length of the payload, bytes.
    pub bytes: u32,
}

/// Kinds of messages between hosts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum LinkKind {
    /// The state of the sender as JSON. It holds all that counts, so that a lost one is made up for by the next.
    State = 1,
    /// A piece of a cloud.
    Chunk = 2,
}

impl Link {
    /// The header with length and hash of its payload.
    #[must_use]
    pub fn sealed(self, payload: &[u8]) -> Self {
        let header = Self { bytes: payload.len() as u32, ..self };
        let hash = header.hash_of(payload);
        Self { hash_high: (hash >> 64) as u64, hash_low: hash as u64, ..header }
    }

    /// Whether header and payload are those that were sealed.
    pub fn is_sound(&self, payload: &[u8]) -> bool {
        let hash = self.hash_of(payload);
        self.bytes as usize == payload.len()
            && [(hash >> 64) as u64, hash as u64] == [self.hash_high, self.hash_low]
    }

    fn hash_of(&self, payload: &[u8]) -> u128 {
        let words = [self.sender, self.receiver, self.sequence, self.cycle];
        let halves = [self.kind, self.pair, self.chunk, self.bytes];
        let mut bytes: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
        bytes.extend(halves.iter().flat_map(|half| half.to_le_bytes()));
        bytes.extend(output_hash(payload).to_le_bytes());
        output_hash(&bytes)
    }

    /// The kind.
    ///
    /// # Errors
    /// [`MessageError::Value`] for an unknown number.
    pub fn kind(&self) -> Result<LinkKind, MessageError> {
        match self.kind {
            1 => Ok(LinkKind::State),
            2 => Ok(LinkKind::Chunk),
            other => Err(value("kind", other.into(), "1 state, 2 chunk")),
        }
    }
}

impl Header for Link {
    fn cycle(&self) -> u64 {
        self.cycle
    }

    fn payload_bytes(&self) -> Result<usize, MessageError> {
        Ok(self.bytes as usize)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_changed_bit_of_header_and_payload_is_found() {
        let header = Link {
            sender: 7,
            receiver: 8,
            sequence: 9,
            cycle: 3,
            kind: 2,
            pair: 1,
            chunk: 4,
            ..Link::default()
        };
        let mut payload: Vec<u8> = (0..=255).collect();
        let sealed = header.sealed(&payload);
        assert!(sealed.is_sound(&payload) && !sealed.is_sound(&payload[1..]));
        for bit in 0..8 * payload.len() {
            payload[bit / 8] ^= 1 << (bit % 8);
            assert!(!sealed.is_sound(&payload), "{bit}");
            payload[bit / 8] ^= 1 << (bit % 8);
        }
        for changed in [
            Link { sender: 6, ..sealed },
            Link { receiver: 0, ..sealed },
            Link { sequence: 10, ..sealed },
            Link { cycle: 4, ..sealed },
            Link { kind: 1, ..sealed },
            Link { pair: 0, ..sealed },
            Link { chunk: 5, ..sealed },
            Link { bytes: 255, ..sealed },
        ] {
            assert!(!changed.is_sound(&payload), "{changed:?}");
        }
        assert!(Link { kind: 3, ..sealed }.kind().is_err());
    }
}
