//! What lies beside a place on another surface: sums over the sites around it, sixteen of them side by side.

use super::sites::{LANES, Place, Sites};
use crate::math::simd::taken;
use std::ops::Range;

/// Memory grows by so many sites, twice what a cell of a surface has around it: cycles are alike, and nothing grows after the first ones.
const ROOM: usize = 256;

/// Sites that one step of the sums takes side by side. It fixes the order of the sums, and so their bits.
const SIDE: usize = 2 * LANES;

/// What a point has around it on another surface.
#[derive(Debug, Clone, Copy)]
pub(super) struct Beside {
    count: [f32; SIDE],
    /// Σ (n + n′)·(p − p′), in radii.
    distance: [f32; SIDE],
    /// Sum of the variances, Σ σ′², radii².
    variance: [f32; SIDE],
}

/// Sites of some runs, one after another: of runs of nine sites, as a surface has them in a cell, every second step would be all but empty.
///
/// They lie some radii from the points that ask, so that single precision tells their places to a ten-millionth of the radius.
#[derive(Debug, Clone, Default)]
pub(super) struct Near {
    /// From a point of the cell that asks, in radii.
    position: [Vec<f32>; 3],
    normal: [Vec<f32>; 3],
    /// Squared standard uncertainties, radii².
    variance: Vec<f32>,
    steps: usize,
}

/// Where the sites of a cell are seen from.
#[derive(Debug, Clone, Copy)]
pub(super) struct Frame {
    origin_mm: [f64; 3],
    /// How many radii a millimetre is.
    per_mm: f64,
}

impl Frame {
    /// From a place, in radii of so many mm.
    pub fn new(origin_mm: [f64; 3], radius_mm: f64) -> Self {
        Self { origin_mm, per_mm: 1.0 / radius_mm }
    }

    /// Coordinates along an axis as they are seen from here.
    #[inline(always)]
    fn seen<const N: usize>(&self, axis: usize, places_mm: [f64; N]) -> [f32; N] {
        let mut out = [0.0; N];
        for (out, place_mm) in out.iter_mut().zip(places_mm) {
            *out = ((place_mm - self.origin_mm[axis]) * self.per_mm) as f32;
        }
        out
    }
}

impl Near {
    /// Takes the sites of some runs in their order.
    #[inline(always)]
    pub fn take(&mut self, sites: &Sites, runs: &[Range<usize>], frame: &Frame) {
        let count = runs.iter().map(ExactSizeIterator::len).sum::<usize>();
        self.steps = count.div_ceil(SIDE);
        // Whole steps are copied, and what is too much is written over; the last run's, and a part of a step, lie nowhere.
        let entries = count + LANES + SIDE;
        let lists = self.position.iter_mut().chain(&mut self.normal);
        for list in lists.chain([&mut self.variance]) {
            if list.len() < entries {
                list.resize(entries.next_multiple_of(ROOM), 0.0);
            }
        }
        let mut at = 0;
        for run in runs {
            for step in 0..run.len().div_ceil(LANES) {
                let (from, to) = (run.start + step * LANES, at + step * LANES);
                for axis in 0..3 {
                    let places = taken::<_, LANES>(&sites.position_mm[axis], from);
                    put(&mut self.position[axis], to, frame.seen(axis, places));
                    put::<LANES>(&mut self.normal[axis], to, taken(&sites.normal[axis], from));
                }
                put(&mut self.variance, to, squared(taken(&sites.sigma_mm, from), frame.per_mm as f32));
            }
            at += run.len();
        }
        put(&mut self.position[0], at, [f32::NAN; SIDE]);
    }

    /// Adds what lies beside a place, which is seen in the frame of the sites.
    #[inline(always)]
    #[allow(clippy::needless_bitwise_bool, reason = "a lazy operator is a branch, which no vector has")]
    pub fn beside(&self, place: &Place, frame: &Frame) -> Beside {
        let (steps, [x, y, z], [nx, ny, nz]) = (self.steps, &self.position, &self.normal);
        let (x, y, z) = (lanes(x, steps), lanes(y, steps), lanes(z, steps));
        let (nx, ny, nz) = (lanes(nx, steps), lanes(ny, steps), lanes(nz, steps));
        let variance = lanes(&self.variance, steps);
        let [px, py, pz] = place.position_mm;
        let ([px], [py], [pz]) = (frame.seen(0, [px]), frame.seen(1, [py]), frame.seen(2, [pz]));
        let (normal, least) = (place.normal, place.cosine);
        let mut sums = Beside::none();
        for step in 0..steps {
            for lane in 0..SIDE {
                let (dx, dy, dz) = (px - x[step][lane], py - y[step][lane], pz - z[step][lane]);
                let (ox, oy, oz) = (nx[step][lane], ny[step][lane], nz[step][lane]);
                let near = dx * dx + dy * dy + dz * dz <= 1.0;
                let cosine = normal[0] * ox + normal[1] * oy + normal[2] * oz;
                let inside = near & (cosine >= least);
                let along = (normal[0] + ox) * dx + (normal[1] + oy) * dy + (normal[2] + oz) * dz;
                // Bits instead of a choice: a choice becomes stores under masks, for which the next step then waits.
                let mask = 0_u32.wrapping_sub(u32::from(inside));
                let masked = |value: f32| f32::from_bits(value.to_bits() & mask);
                sums.count[lane] += masked(1.0);
                sums.distance[lane] += masked(along);
                sums.variance[lane] += masked(variance[step][lane]);
            }
        }
        sums
    }
}

/// Squares of eight entries in radii.
#[inline(always)]
fn squared(mut entries: [f32; LANES], per_mm: f32) -> [f32; LANES] {
    for entry in &mut entries {
        *entry *= per_mm;
        *entry *= *entry;
    }
    entries
}

/// Writes some entries of a list.
#[inline(always)]
fn put<const N: usize>(list: &mut [f32], at: usize, entries: [f32; N]) {
    list[at..at + N].copy_from_slice(&entries);
}

/// Steps of sixteen entries of a list.
#[inline(always)]
fn lanes(list: &[f32], steps: usize) -> &[[f32; SIDE]] {
    &list.as_chunks().0[..steps]
}

impl Beside {
    /// Sums over no sites at all.
    #[inline(always)]
    pub fn none() -> Self {
        Self { count: [0.0; SIDE], distance: [0.0; SIDE], variance: [0.0; SIDE] }
    }

    /// Number of sites, Σ (n + n′)·(p − p′) in radii, and Σ σ′² in radii².
    #[inline(always)]
    pub fn sums(&self) -> [f64; 3] {
        [total(&self.count), total(&self.distance), total(&self.variance)]
    }
}

/// Sum of all lanes.
#[inline(always)]
fn total(lanes: &[f32; SIDE]) -> f64 {
    let mut halves = [0.0; LANES];
    for (lane, half) in halves.iter_mut().enumerate() {
        *half = lanes[lane] + lanes[lane + LANES];
    }
    let [a, b, c, d, e, f, g, h] = halves;
    f64::from(((a + e) + (c + g)) + ((b + f) + (d + h)))
}
