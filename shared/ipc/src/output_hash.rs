//! The hash of a stage output: frame, phase map, cloud, result.

use xxhash_rust::xxh3::xxh3_128;

/// Hash of the bytes of an output (xxh3, 128 bits), as headers, cycle records and results carry it.
pub fn output_hash(bytes: &[u8]) -> u128 {
    xxh3_128(bytes)
}
