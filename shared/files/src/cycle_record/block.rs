//! The blocks of the file: each head vouches for itself, for its contents and for all heads before it.

use super::ValueKey;
use twox_hash::XxHash3_64;

/// Bytes of a head.
pub(super) const HEAD_BYTES: usize = 40;

/// Bytes of a head that its chain sum covers: all before it.
const SUMMED_BYTES: usize = 32;

/// What a block holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Header,
    Value,
    Cycle,
    Seal,
}

/// What stands before each block.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Head {
    pub kind: Kind,
    /// Cycle and activation that the contents belong to; 0 in the header and the seal.
    pub key: ValueKey,
    /// Number of bytes that follow the head.
    pub length: u64,
    /// Checksum (xxh3) of the bytes that follow.
    pub checksum: u64,
}

impl Head {
    /// The head of a block with these contents.
    pub fn of(kind: Kind, key: ValueKey, contents: &[u8]) -> Self {
        Self { kind, key, length: contents.len() as u64, checksum: XxHash3_64::oneshot(contents) }
    }

    /// The bytes of the head, and the chain sum after it. `chain` is the sum after the head before it.
    pub fn to_bytes(self, chain: u64) -> ([u8; HEAD_BYTES], u64) {
        let mut bytes = [0; HEAD_BYTES];
        let kind: u32 = match self.kind {
            Kind::Header => 1,
            Kind::Value => 2,
            Kind::Cycle => 3,
            Kind::Seal => 4,
        };
        bytes[..4].copy_from_slice(&kind.to_le_bytes());
        bytes[4..8].copy_from_slice(&self.key.activation.to_le_bytes());
        bytes[8..16].copy_from_slice(&self.key.cycle.to_le_bytes());
        bytes[16..24].copy_from_slice(&self.length.to_le_bytes());
        bytes[24..32].copy_from_slice(&self.checksum.to_le_bytes());
        let chain = XxHash3_64::oneshot_with_seed(chain, &bytes[..SUMMED_BYTES]);
        bytes[SUMMED_BYTES..].copy_from_slice(&chain.to_le_bytes());
        (bytes, chain)
    }

    /// The head and the chain sum after it. `None`: this is no head, or not the one that followed the sum `chain`.
    pub fn from_bytes(bytes: &[u8; HEAD_BYTES], chain: u64) -> Option<(Self, u64)> {
        let chain = XxHash3_64::oneshot_with_seed(chain, &bytes[..SUMMED_BYTES]);
        if u64::from_le_bytes(part(bytes, SUMMED_BYTES)) != chain {
            return None;
        }
        let kind = match u32::from_le_bytes(part(bytes, 0)) {
            1 => Kind::Header,
            2 => Kind::Value,
            3 => Kind::Cycle,
            4 => Kind::Seal,
            _ => return None,
        };
        let key = ValueKey {
            cycle: u64::from_le_bytes(part(bytes, 8)),
            activation: u32::from_le_bytes(part(bytes, 4)),
        };
        let length = u64::from_le_bytes(part(bytes, 16));
        Some((Self { kind, key, length, checksum: u64::from_le_bytes(part(bytes, 24)) }, chain))
    }
}

fn part<const N: usize, const M: usize>(bytes: &[u8; M], at: usize) -> [u8; N] {
    std::array::from_fn(|i| bytes[at + i])
}
