//! The blocks of the file: a head that vouches for itself and for what follows it.

use super::ValueKey;
use xxhash_rust::xxh3::{Xxh3, xxh3_64};

/// Bytes of a head.
pub(super) const HEAD_BYTES: usize = 24;

/// Bytes in front of a value: cycle and activation.
pub(super) const KEY_BYTES: usize = 12;

/// What a block holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Header,
    Value,
    Cycle,
}

/// What stands before each block.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Head {
    pub kind: Kind,
    /// Number of bytes that follow the head.
    pub length: u64,
    /// Checksum (xxh3) of the bytes that follow.
    pub checksum: u64,
}

impl Head {
    /// The head of a block made of these parts.
    pub fn of(kind: Kind, parts: &[&[u8]]) -> Self {
        let mut sum = Xxh3::new();
        for part in parts {
            sum.update(part);
        }
        Self { kind, length: parts.iter().map(|part| part.len() as u64).sum(), checksum: sum.digest() }
    }

    pub fn to_bytes(self) -> [u8; HEAD_BYTES] {
        let mut bytes = [0; HEAD_BYTES];
        let kind: u32 = match self.kind {
            Kind::Header => 1,
            Kind::Value => 2,
            Kind::Cycle => 3,
        };
        bytes[..4].copy_from_slice(&kind.to_le_bytes());
        bytes[8..16].copy_from_slice(&self.length.to_le_bytes());
        bytes[16..].copy_from_slice(&self.checksum.to_le_bytes());
        let sum = xxh3_64(&bytes) as u32;
        bytes[4..8].copy_from_slice(&sum.to_le_bytes());
        bytes
    }

    /// Parses a head; `None` where its checksum does not hold.
    pub fn from_bytes(bytes: &[u8; HEAD_BYTES]) -> Option<Self> {
        let mut unsummed = *bytes;
        unsummed[4..8].fill(0);
        if u32::from_le_bytes(part(bytes, 4)) != xxh3_64(&unsummed) as u32 {
            return None;
        }
        let kind = match u32::from_le_bytes(part(bytes, 0)) {
            1 => Kind::Header,
            2 => Kind::Value,
            3 => Kind::Cycle,
            _ => return None,
        };
        Some(Self {
            kind,
            length: u64::from_le_bytes(part(bytes, 8)),
            checksum: u64::from_le_bytes(part(bytes, 16)),
        })
    }
}

impl ValueKey {
    pub(super) fn to_bytes(self) -> [u8; KEY_BYTES] {
        let mut bytes = [0; KEY_BYTES];
        bytes[..8].copy_from_slice(&self.cycle.to_le_bytes());
        bytes[8..].copy_from_slice(&self.activation.to_le_bytes());
        bytes
    }

    pub(super) fn from_bytes(bytes: &[u8; KEY_BYTES]) -> Self {
        Self { cycle: u64::from_le_bytes(part(bytes, 0)), activation: u32::from_le_bytes(part(bytes, 8)) }
    }
}

fn part<const N: usize, const M: usize>(bytes: &[u8; M], at: usize) -> [u8; N] {
    std::array::from_fn(|i| bytes[at + i])
}
