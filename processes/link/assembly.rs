//! A cloud that comes in chunks: whatever is lost, doubled, late or out of order, the bytes are those that were sent. Pure.

use super::message::Offer;
use ipc::header::LINK_BYTES;
use ipc::output_hash;

/// Bytes of a chunk; the last one of a cloud is shorter.
pub const CHUNK_BYTES: usize = LINK_BYTES;

/// A cloud that is not complete yet.
#[derive(Debug)]
pub struct Assembly {
    bytes: Vec<u8>,
    hash: u128,
    have: Vec<bool>,
    missing: usize,
}

/// What became of a chunk.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Added {
    /// It was missing until now.
    New,
    /// It was there already.
    Doubled,
    /// The cloud has no such chunk.
    Strange,
}

impl Assembly {
    /// The cloud that a host offers.
    ///
    /// # Errors
    /// An offer that cannot be a cloud of this pair.
    pub fn new(offer: &Offer, point_bytes: usize, capacity_bytes: u64) -> Result<Self, String> {
        let expected = u64::from(offer.points) * point_bytes as u64;
        if offer.bytes != expected || offer.bytes > capacity_bytes {
            return Err(format!(
                "it offers a cloud of {} bytes with {} points; {expected} bytes belong to them, and at most {capacity_bytes} are \
                 possible",
                offer.bytes, offer.points
            ));
        }
        let hash = u128::from_str_radix(&offer.hash, 16)
            .map_err(|_| format!("it offers a cloud with the hash {:?}, which is no number", offer.hash))?;
        let chunks = (offer.bytes as usize).div_ceil(CHUNK_BYTES);
        Ok(Self { bytes: vec![0; offer.bytes as usize], hash, have: vec![false; chunks], missing: chunks })
    }

    /// Number of chunks of the cloud.
    pub fn chunks(&self) -> usize {
        self.have.len()
    }

    /// Whether a chunk is still missing.
    #[cfg(test)]
    pub fn lacks(&self, chunk: usize) -> bool {
        self.have.get(chunk).is_some_and(|have| !have)
    }

    /// Puts a chunk in its place.
    pub fn add(&mut self, chunk: usize, payload: &[u8]) -> Added {
        let begin = chunk.saturating_mul(CHUNK_BYTES);
        let Some(have) = self.have.get_mut(chunk) else { return Added::Strange };
        let end = (begin + CHUNK_BYTES).min(self.bytes.len());
        if payload.len() != end - begin {
            return Added::Strange;
        }
        if std::mem::replace(have, true) {
            return Added::Doubled;
        }
        self.bytes[begin..end].copy_from_slice(payload);
        self.missing -= 1;
        Added::New
    }

    /// Whether no chunk is missing.
    pub fn is_complete(&self) -> bool {
        self.missing == 0
    }

    /// The bytes of a complete cloud.
    ///
    /// # Errors
    /// They are not those that the host has.
    pub fn finish(self) -> Result<Vec<u8>, String> {
        let hash = output_hash(&self.bytes);
        if self.is_complete() && hash == self.hash {
            return Ok(self.bytes);
        }
        Err(format!(
            "its cloud came with the hash {hash:032x} and {} missing chunks, but has the hash {:032x}",
            self.missing, self.hash
        ))
    }
}

/// The bytes of a chunk of a cloud.
pub fn chunk(bytes: &[u8], chunk: usize) -> Option<&[u8]> {
    bytes.chunks(CHUNK_BYTES).nth(chunk)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const POINT: usize = 56;

    fn offer(bytes: &[u8]) -> Offer {
        let hash = format!("{:032x}", output_hash(bytes));
        Offer { pair: 1, points: (bytes.len() / POINT) as u32, bytes: bytes.len() as u64, hash }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        #[test]
        fn any_order_with_any_repetition_gives_the_bytes(points in 0_usize..30_000, seed in any::<u64>()) {
            let bytes: Vec<u8> = (0..points * POINT).map(|i| (i as u64 ^ seed) as u8).collect();
            let mut assembly = Assembly::new(&offer(&bytes), POINT, u64::MAX).unwrap();
            let count = assembly.chunks();
            // From a place that depends on the seed, every one, then all once more.
            let order = (0..2 * count).map(|i| (i * 7 + seed as usize % count.max(1)) % count.max(1));
            let mut added = 0;
            for number in order.chain(0..count) {
                let wanted = assembly.lacks(number);
                let became = assembly.add(number, chunk(&bytes, number).unwrap());
                prop_assert_eq!(became == Added::New, wanted);
                added += usize::from(wanted);
            }
            prop_assert_eq!(added, count);
            prop_assert!(assembly.is_complete());
            prop_assert_eq!(assembly.finish().unwrap(), bytes);
        }
    }

    #[test]
    fn wrong_chunks_and_offers_are_refused() {
        let bytes = vec![3; 10_000 * POINT];
        let offered = offer(&bytes);
        let mut assembly = Assembly::new(&offered, POINT, u64::MAX).unwrap();
        assert_eq!(assembly.add(99, &bytes[..CHUNK_BYTES]), Added::Strange);
        assert_eq!(assembly.add(usize::MAX, &bytes[..CHUNK_BYTES]), Added::Strange);
        assert_eq!(assembly.add(0, &bytes[..CHUNK_BYTES - 1]), Added::Strange);
        let mut wrong = bytes[..CHUNK_BYTES].to_vec();
        wrong[0] = 4;
        assert_eq!(assembly.add(0, &wrong), Added::New);
        for number in 1..assembly.chunks() {
            assembly.add(number, chunk(&bytes, number).unwrap());
        }
        assert!(assembly.finish().unwrap_err().contains("but has the hash"));
        assert!(Assembly::new(&offered, POINT, 1000).unwrap_err().contains("at most 1000"));
        let hostile = Offer { bytes: u64::MAX, points: u32::MAX, ..offered.clone() };
        assert!(Assembly::new(&hostile, POINT, 1 << 32).is_err());
        assert!(Assembly::new(&Offer { hash: "x".into(), ..offered }, POINT, 1 << 32).is_err());
        let nothing = Assembly::new(&offer(&[]), POINT, 0).unwrap();
        assert!(nothing.is_complete() && nothing.finish().unwrap().is_empty());
    }
}
