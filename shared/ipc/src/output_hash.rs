//! The hash of a stage output: frame, phase map, cloud, result.

use twox_hash::XxHash3_128;

/// Hash of the bytes of an output (xxh3, 128 bits), as headers, cycle records and results carry it.
pub fn output_hash(bytes: &[u8]) -> u128 {
    XxHash3_128::oneshot(bytes)
}
