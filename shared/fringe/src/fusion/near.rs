//! What lies beside a place on another surface: sums over the sites around it, eight of them side by side.

use super::sites::{LANES, Place, Sites};
use crate::math::simd::taken;
use std::ops::Range;

/// Memory grows by so many sites, twice what a cell of a surface has around it: cycles are alike, and nothing grows after the first ones.
const ROOM: usize = 256;

/// What a point has around it on another surface.
#[derive(Debug, Clone, Copy)]
pub(super) struct Beside {
    count: [f64; LANES],
    /// Σ (n + n′)·(p − p′), mm.
    distance: [f64; LANES],
    /// Sum of the variances, Σ σ′², mm².
    variance: [f64; LANES],
}

/// Sites of some runs, one after another: of runs of nine sites, as a surface has them in a cell, every second step would be all but empty.
#[derive(Debug, Clone, Default)]
pub(super) struct Near {
    position_mm: [Vec<f64>; 3],
    normal: [Vec<f64>; 3],
    variance_mm2: Vec<f64>,
    steps: usize,
}

impl Near {
    /// Takes the sites of some runs in their order.
    #[inline(always)]
    pub fn take(&mut self, sites: &Sites, runs: &[Range<usize>]) {
        let count = runs.iter().map(ExactSizeIterator::len).sum::<usize>();
        self.steps = count.div_ceil(LANES);
        // Whole steps are copied, and what is too much is written over; the last run's, and a part of a step, lie nowhere.
        let entries = count + 2 * LANES;
        let lists = self.position_mm.iter_mut().chain(&mut self.normal);
        for list in lists.chain([&mut self.variance_mm2]) {
            if list.len() < entries {
                list.resize(entries.next_multiple_of(ROOM), 0.0);
            }
        }
        let mut at = 0;
        for run in runs {
            for step in 0..run.len().div_ceil(LANES) {
                let (from, to) = (run.start + step * LANES, at + step * LANES);
                for axis in 0..3 {
                    put(&mut self.position_mm[axis], to, taken(&sites.position_mm[axis], from));
                    put(&mut self.normal[axis], to, widened(&sites.normal[axis], from));
                }
                put(&mut self.variance_mm2, to, squared(widened(&sites.sigma_mm, from)));
            }
            at += run.len();
        }
        put(&mut self.position_mm[0], at, [f64::NAN; LANES]);
    }

    /// Adds what lies beside a place.
    #[inline(always)]
    #[allow(clippy::needless_bitwise_bool, reason = "a lazy operator is a branch, which no vector has")]
    pub fn beside(&self, place: &Place) -> Beside {
        let [x, y, z] = [0, 1, 2].map(|axis| lanes(&self.position_mm[axis], self.steps));
        let [nx, ny, nz] = [0, 1, 2].map(|axis| lanes(&self.normal[axis], self.steps));
        let variance = lanes(&self.variance_mm2, self.steps);
        let mut sums = Beside::none();
        for step in 0..self.steps {
            for lane in 0..LANES {
                let dx = place.position_mm[0] - x[step][lane];
                let dy = place.position_mm[1] - y[step][lane];
                let dz = place.position_mm[2] - z[step][lane];
                let [ox, oy, oz] = [nx, ny, nz].map(|n| n[step][lane]);
                let near = dx * dx + dy * dy + dz * dz <= place.limit_mm2;
                let cosine = place.normal[0] * ox + place.normal[1] * oy + place.normal[2] * oz;
                let inside = near & (cosine >= place.cosine);
                let along =
                    (place.normal[0] + ox) * dx + (place.normal[1] + oy) * dy + (place.normal[2] + oz) * dz;
                // Bits instead of a choice: a choice becomes stores under masks, for which the next step then waits.
                let mask = 0_u64.wrapping_sub(u64::from(inside));
                let masked = |value: f64| f64::from_bits(value.to_bits() & mask);
                sums.count[lane] += masked(1.0);
                sums.distance[lane] += masked(along);
                sums.variance[lane] += masked(variance[step][lane]);
            }
        }
        sums
    }
}

/// Eight entries of a list in double precision.
#[inline(always)]
fn widened(list: &[f32], from: usize) -> [f64; LANES] {
    let mut out = [0.0; LANES];
    for (out, entry) in out.iter_mut().zip(&list[from..from + LANES]) {
        *out = f64::from(*entry);
    }
    out
}

#[inline(always)]
fn squared(mut entries: [f64; LANES]) -> [f64; LANES] {
    for entry in &mut entries {
        *entry *= *entry;
    }
    entries
}

/// Writes eight entries of a list.
#[inline(always)]
fn put(list: &mut [f64], at: usize, entries: [f64; LANES]) {
    list[at..at + LANES].copy_from_slice(&entries);
}

/// Steps of eight entries of a list.
#[inline(always)]
fn lanes(list: &[f64], steps: usize) -> &[[f64; LANES]] {
    &list.as_chunks().0[..steps]
}

impl Beside {
    /// Sums over no sites at all.
    #[inline(always)]
    pub fn none() -> Self {
        Self { count: [0.0; LANES], distance: [0.0; LANES], variance: [0.0; LANES] }
    }

    /// Number of sites, Σ (n + n′)·(p − p′) in mm, and Σ σ′² in mm².
    #[inline(always)]
    pub fn sums(&self) -> [f64; 3] {
        [&self.count, &self.distance, &self.variance].map(|lanes| {
            let [a, b, c, d, e, f, g, h] = *lanes;
            ((a + e) + (c + g)) + ((b + f) + (d + h))
        })
    }
}
