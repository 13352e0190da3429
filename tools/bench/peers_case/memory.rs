//! Memory bandwidth, in safe code: reading and copying buffers far larger than any cache.

use super::Bench;
use anyhow::Result;
use rayon::prelude::*;
use serde_json::json;

const BYTES: usize = 256 << 20;

/// Elements that one task takes.
const CHUNK: usize = 1 << 20;

/// Reads and copies 256 MiB.
pub(super) fn stream(bench: &mut Bench) -> Result<()> {
    "256 MiB".clone_into(&mut bench.size);
    let source = vec![1_u64; BYTES / 8];
    let mut target = vec![2_u64; BYTES / 8];
    for threads in [1, 2] {
        let row = bench.time("stream read", threads, || {
            let sum: u64 =
                source.par_chunks(CHUNK).map(|c| c.iter().fold(0, |a: u64, b| a.wrapping_add(*b))).sum();
            std::hint::black_box(sum);
            Ok(())
        })?;
        row.with(json!({ "GB_s": BYTES as f64 / row.median_ms * 1e-6 }));
        let row = bench.time("stream copy", threads, || {
            target
                .par_chunks_mut(CHUNK)
                .zip(source.par_chunks(CHUNK))
                .for_each(|(to, from)| to.copy_from_slice(from));
            std::hint::black_box(&mut target);
            Ok(())
        })?;
        row.with(json!({ "GB_s": 2.0 * BYTES as f64 / row.median_ms * 1e-6 }));
    }
    Ok(())
}
