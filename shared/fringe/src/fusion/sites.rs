//! Points as the search sees them: each property a list of its own, so that eight of them are one step of a vector loop.

// Without branches a loop vectorises.
#![allow(clippy::needless_bitwise_bool)]

use super::buffers::clear_and_reserve;
use crate::cloud::Point;

/// Points that one step of a loop takes side by side. It fixes the order of the sums, and so their bits.
pub(super) const LANES: usize = 8;

/// Points in the order of their cells.
#[derive(Debug, Clone, Default)]
pub(super) struct Sites {
    position_mm: [Vec<f64>; 3],
    normal: [Vec<f32>; 3],
    sigma_mm: Vec<f32>,
}

/// What a point has around it on another surface.
#[derive(Debug, Clone, Copy)]
pub(super) struct Beside {
    count: [f64; LANES],
    /// Σ (n + n′)·(p − p′), mm.
    distance: [f64; LANES],
    /// Sum of the variances, Σ σ′², mm².
    variance: [f64; LANES],
}

/// A point with its normal, and which others lie beside it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place {
    position_mm: [f64; 3],
    normal: [f64; 3],
    /// Standard uncertainty of the point, mm.
    pub sigma_mm: f64,
    /// Largest squared distance, mm².
    limit_mm2: f64,
    /// Smallest cosine of the normals.
    cosine: f64,
}

impl Sites {
    /// Takes points in an order: their keys, and their numbers in the cloud. Behind them come places that no search finds, so that
    /// a step of a loop may begin at any site.
    pub fn take(&mut self, order: &[(u64, u32)], points: &[Point]) {
        let entries = order.len() + LANES;
        self.position_mm.iter_mut().for_each(|list| resize(list, entries, f64::NAN));
        self.normal.iter_mut().for_each(|list| resize(list, entries, 0.0));
        resize(&mut self.sigma_mm, entries, 0.0);
        let [x, y, z] = &mut self.position_mm;
        let [nx, ny, nz] = &mut self.normal;
        let positions = x.iter_mut().zip(y).zip(z);
        let lists = positions.zip(nx.iter_mut().zip(ny).zip(nz)).zip(&mut self.sigma_mm);
        for (((((x, y), z), ((nx, ny), nz)), sigma), (_, index)) in lists.zip(order) {
            let point = &points[*index as usize];
            [*x, *y, *z] = point.position_mm;
            [*nx, *ny, *nz] = point.normal;
            *sigma = point.sigma_mm;
        }
    }

    /// Takes a site out of all searches: it then lies nowhere.
    pub fn remove(&mut self, site: usize) {
        self.position_mm[0][site] = f64::NAN;
    }

    /// Position of a site, mm.
    #[inline]
    pub fn position_mm(&self, site: usize) -> [f64; 3] {
        [self.position_mm[0][site], self.position_mm[1][site], self.position_mm[2][site]]
    }

    /// A site as one that asks for others; `None` where it has no normal.
    #[inline(always)]
    pub fn place(&self, site: usize, limit_mm2: f64, cosine: f64) -> Option<Place> {
        let normal = [0, 1, 2].map(|axis| f64::from(self.normal[axis][site]));
        let sigma_mm = f64::from(self.sigma_mm[site]);
        (normal != [0.0; 3]).then(|| Place {
            position_mm: self.position_mm(site),
            normal,
            sigma_mm,
            limit_mm2,
            cosine,
        })
    }

    /// Adds what lies beside a place among the sites from `first` up to `end`.
    #[inline(always)]
    #[allow(clippy::needless_bitwise_bool, reason = "a lazy operator is a branch, which no vector has")]
    pub fn add_beside(&self, place: &Place, first: usize, end: usize, beside: &mut Beside) {
        let steps = (end - first).div_ceil(LANES);
        let [x, y, z] = [0, 1, 2].map(|axis| lanes(&self.position_mm[axis], first, steps));
        let [nx, ny, nz] = [0, 1, 2].map(|axis| lanes(&self.normal[axis], first, steps));
        let sigma = lanes(&self.sigma_mm, first, steps);
        let mut sums = *beside;
        for step in 0..steps {
            let left = (end - first - step * LANES).min(LANES) as u32;
            for lane in 0..LANES {
                let dx = place.position_mm[0] - x[step][lane];
                let dy = place.position_mm[1] - y[step][lane];
                let dz = place.position_mm[2] - z[step][lane];
                let [ox, oy, oz] = [nx, ny, nz].map(|n| f64::from(n[step][lane]));
                let near = dx * dx + dy * dy + dz * dz <= place.limit_mm2;
                let cosine = place.normal[0] * ox + place.normal[1] * oy + place.normal[2] * oz;
                let inside = near & (cosine >= place.cosine) & ((lane as u32) < left);
                let along =
                    (place.normal[0] + ox) * dx + (place.normal[1] + oy) * dy + (place.normal[2] + oz) * dz;
                let s = f64::from(sigma[step][lane]);
                // Bits instead of a choice: a choice becomes stores under masks, for which the next step then waits.
                let mask = 0_u64.wrapping_sub(u64::from(inside));
                let masked = |value: f64| f64::from_bits(value.to_bits() & mask);
                sums.count[lane] += masked(1.0);
                sums.distance[lane] += masked(along);
                sums.variance[lane] += masked(s * s);
            }
        }
        *beside = sums;
    }
}

/// Steps of eight entries of a list, from one on; the lists are eight entries longer than they have sites.
#[inline(always)]
fn lanes<T>(list: &[T], first: usize, steps: usize) -> &[[T; LANES]] {
    &list[first..first + steps * LANES].as_chunks().0[..steps]
}

/// Gives a list so many entries, the last ones of which are `empty`.
fn resize<T: Copy>(list: &mut Vec<T>, entries: usize, empty: T) {
    if list.capacity() < entries {
        clear_and_reserve(list, entries);
    }
    list.resize(entries, empty);
    list[entries - LANES..].fill(empty);
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
