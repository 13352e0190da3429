//! Points as the search sees them: each property a list of its own, so that eight of them are one step of a vector loop.

use super::PIECE;
use super::buffers::clear_and_reserve;
use super::cells::Cloud;
use rayon::prelude::*;

/// Points that one step of a loop takes side by side. It fixes the order of the sums, and so their bits.
pub(super) const LANES: usize = 8;

/// Points in the order of their cells.
#[derive(Debug, Clone, Default)]
pub(super) struct Sites {
    pub position_mm: [Vec<f64>; 3],
    pub normal: [Vec<f32>; 3],
    pub sigma_mm: Vec<f32>,
}

/// A point with its normal, and which others lie beside it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place {
    pub position_mm: [f64; 3],
    pub normal: [f64; 3],
    /// Standard uncertainty of the point, mm.
    pub sigma_mm: f64,
    /// Largest squared distance, mm².
    pub limit_mm2: f64,
    /// Smallest cosine of the normals.
    pub cosine: f64,
}

impl Sites {
    /// Takes the points of a cloud. Behind them come places that no search finds, so that a step of a loop may begin at any site.
    pub fn take(&mut self, cloud: &Cloud) {
        let sites = cloud.sites();
        let entries = sites + LANES;
        self.position_mm.iter_mut().for_each(|list| resize(list, entries, f64::NAN));
        self.normal.iter_mut().for_each(|list| resize(list, entries, 0.0));
        resize(&mut self.sigma_mm, entries, 0.0);
        let [x, y, z] = self.position_mm.each_mut().map(|list| list[..sites].par_chunks_mut(PIECE));
        let [nx, ny, nz] = self.normal.each_mut().map(|list| list[..sites].par_chunks_mut(PIECE));
        let pieces =
            x.zip(y).zip(z).zip(nx.zip(ny).zip(nz)).zip(self.sigma_mm[..sites].par_chunks_mut(PIECE));
        pieces.enumerate().for_each(|(piece, ((((x, y), z), ((nx, ny), nz)), sigma))| {
            let positions = x.iter_mut().zip(y).zip(z);
            let lists = positions.zip(nx.iter_mut().zip(ny).zip(nz)).zip(sigma);
            for (((((x, y), z), ((nx, ny), nz)), sigma), point) in lists.zip(cloud.points_from(piece * PIECE))
            {
                [*x, *y, *z] = point.position_mm;
                [*nx, *ny, *nz] = point.normal;
                *sigma = point.sigma_mm;
            }
        });
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
}

/// Gives a list so many entries, the last ones of which are `empty`.
fn resize<T: Copy>(list: &mut Vec<T>, entries: usize, empty: T) {
    if list.capacity() < entries {
        clear_and_reserve(list, entries);
    }
    list.resize(entries, empty);
    list[entries - LANES..].fill(empty);
}
