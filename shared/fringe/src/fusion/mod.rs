//! One cloud from all pairs: isolated points removed, agreement of the pairs reported.
//!
//! # Rules
//! - A point stays when at least `min_neighbours` other points, of whichever pair, lie within the radius; otherwise
//!   it is isolated and goes. Points that are not finite go too.
//! - Without a radius in the settings it is three times the median distance of points that are
//!   neighbours along an image row, of the first cloud that has enough of them: it is known before the other clouds exist.
//! - Points come out in the order of the clouds, within a cloud in the order they came in (that of the pixels).
//! - Overlap of two pairs a < b: for each point p of a, the mean of ½ (n_p + n_q)·(p − q) over the points q of b within
//!   the radius whose normals agree with that of p. This is the distance from p to the local surface of b: positive where
//!   a lies outside of b. The mean of both normals makes it exact on planes and free of the curvature's bias on
//!   spheres, where point-to-plane errs by the sagitta (the symmetric objective of Rusinkiewicz 2019). The thesis
//!   (figure 5.16) takes nearest neighbours, which measures the sampling as well: 48 µm there. Of n > 2 clouds the points in every
//!   (n − 1)th cell of the search are compared: all comparisons together then cost what n/2 of two whole clouds do.

mod buffers;
mod cells;
mod disagreement;
mod grid;
mod isolated;
mod near;
mod overlap;
mod report;
mod runs;
mod scale;
mod sites;
mod surroundings;
mod taking;

use crate::cloud::Point;
use crate::math::parallel::for_parts;
use crate::math::simd::best_level;
use buffers::clear_and_reserve;
use cells::{Cells, Found};
pub use disagreement::disagreement_warning;
use disagreement::{Compared, Comparison, Limits, Raised};
use grid::{Extent, Grid, Lattice, is_finite};
use isolated::has_around;
use near::Near;
use overlap::{Distances, Nearness};
use rayon::prelude::*;
pub use report::{FusionReport, Overlap};
use scale::Scale;
use serde::{Deserialize, Serialize};
use taking::Taken;

/// Points of a piece, and cells of a part of an overlap: enough to be worth a thread's attention, and many for each thread.
const PIECE: usize = 4096;
const CELLS: usize = 512;

/// Settings of the fusion of point clouds.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FusionSettings {
    /// Radius of a neighbourhood, mm; absent: from the spacing of the points.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub radius_mm: Option<f64>,
    /// Fewer other points within the radius make a point isolated.
    pub min_neighbours: u32,
    /// Overlap takes points whose normals differ by less, degrees.
    pub max_normal_angle_deg: f64,
    /// Overlap takes points with so many points of the other pair within the radius.
    pub min_overlap_neighbours: u32,
}

impl Default for FusionSettings {
    fn default() -> Self {
        Self { radius_mm: None, min_neighbours: 4, max_normal_angle_deg: 30.0, min_overlap_neighbours: 6 }
    }
}

/// Points of one cloud that one thread takes: a fixed part, whoever takes it.
#[derive(Debug, Clone, Copy)]
struct Piece {
    cloud: usize,
    first: usize,
    end: usize,
    extent: Extent,
    /// Points of the part that stay.
    kept: usize,
}

/// Fuses again and again with buffers that only grow.
#[derive(Debug, Clone, Default)]
pub struct Fuser {
    /// Clouds that were taken before the others were there, with which scale and settings.
    taken: Vec<Taken>,
    begun: Option<(Scale, FusionSettings)>,
    /// Of each cloud, the pictures that it was measured from; none where that is not known.
    pictures: Vec<Vec<usize>>,
    pieces: Vec<Piece>,
    /// Where each piece begins among the points of all clouds, one after another, and one place more for the end.
    starts: Vec<usize>,
    /// The same among those that stay.
    kept_starts: Vec<usize>,
    /// Whether a point stays, for the points of all clouds.
    keep: Vec<bool>,
    /// Those that do not, by their places among the points of all clouds, in order.
    gone: Vec<u32>,
    per_cloud: Vec<Cells>,
    spacings: Vec<f64>,
    distances: Vec<Distances>,
    compared: Vec<Compared>,
    /// Of each part of an overlap, memory for the sites around a cell.
    near: Vec<Near>,
    raised: Vec<Raised>,
    /// Of each part of the cells, those in which clouds disagree.
    disagreeing: Vec<Vec<Raised>>,
    report: FusionReport,
}

/// Fuses once; see [`Fuser::fuse`].
pub fn fuse(clouds: &[&[Point]], settings: &FusionSettings, out: &mut Vec<Point>) -> FusionReport {
    Fuser::default().fuse(clouds, settings, out).clone()
}

impl Fuser {
    /// For clouds of which it is known what they were measured from: for each, the numbers of its pictures, one for each camera under each
    /// projector. Clouds that share none have noise of their own; of all others the points are asked.
    pub fn of_pictures(pictures: Vec<Vec<usize>>) -> Self {
        Self { pictures, ..Self::default() }
    }

    /// Fuses clouds, in the order of the pairs, into `out` (cleared first); see [`Self::fuse_into`].
    pub fn fuse(
        &mut self,
        clouds: &[&[Point]],
        settings: &FusionSettings,
        out: &mut Vec<Point>,
    ) -> &FusionReport {
        // Points of a call before may stay: all are written over.
        if out.capacity() < count(clouds) {
            clear_and_reserve(out, count(clouds));
        }
        out.resize(count(clouds), bytemuck::Zeroable::zeroed());
        self.fuse_all(clouds, settings, out);
        out.truncate(self.report.points as usize);
        &self.report
    }

    /// Fuses clouds, in the order of the pairs, to the beginning of `out`; `None` where `out` is shorter than all clouds
    /// have points. Allocates only where this call needs more memory than all before it, by a quarter.
    pub fn fuse_into(
        &mut self,
        clouds: &[&[Point]],
        settings: &FusionSettings,
        out: &mut [Point],
    ) -> Option<&FusionReport> {
        if out.len() < count(clouds) {
            return None;
        }
        self.fuse_all(clouds, settings, out);
        Some(&self.report)
    }

    fn fuse_all(&mut self, clouds: &[&[Point]], settings: &FusionSettings, out: &mut [Point]) {
        let (taken, scale) = self.keep_taken(clouds, settings);
        (taken..clouds.len()).for_each(|number| self.cut(number, clouds[number]));
        let spacings = &mut self.spacings;
        let scale = scale.or_else(|| Scale::of_first(clouds, settings, spacings));
        let scale = scale.or_else(|| Scale::of_all(clouds, spacings)).unwrap_or_default();
        let extent = self.look((taken, &clouds[taken..]), scale.radius_mm, settings.min_neighbours);
        let grid = Grid::over(Lattice::new(scale.origin_mm, scale.radius_mm, &extent), &extent);
        if let Some(grid) = &grid {
            self.fill(taken, clouds, grid);
            self.mark((0, clouds), grid, scale.radius_mm, settings.min_neighbours);
        }
        self.report.radius_mm = scale.radius_mm;
        self.copy(clouds, out);
        self.report.overlaps.clear();
        self.report.disagreeing = 0;
        if let Some(grid) = &grid {
            self.remove(clouds, grid);
            self.overlaps(clouds.len(), grid, scale.radius_mm, settings);
            self.raise(out);
        }
        self.forget();
    }

    /// Marks those of the other points of some clouds that are not isolated among them: they are not so among more clouds.
    fn mark(
        &mut self,
        (first, clouds): (usize, &[&[Point]]),
        grid: &Grid,
        radius_mm: f64,
        min_neighbours: u32,
    ) {
        let wanted = (radius_mm * radius_mm, min_neighbours);
        let per_cloud = &self.per_cloud[first..first + clouds.len()];
        let pieces = self.pieces.partition_point(|piece| piece.cloud < first);
        let Some(starts) = self.starts.get(pieces..).filter(|starts| !starts.is_empty()) else { return };
        for_parts(starts, &mut self.keep[starts[0]..], &mut self.pieces[pieces..], &|_, keep, piece| {
            let own = piece.cloud - first;
            let cloud = clouds[own];
            let mut found = Found::default();
            for (index, keep) in (piece.first..piece.end).zip(keep.iter_mut()) {
                *keep = *keep
                    || (is_finite(&cloud[index])
                        && has_around((per_cloud, own), grid, &cloud[index], &mut found, wanted));
            }
            piece.kept = keep.iter().map(|keep| usize::from(*keep)).sum();
        });
    }

    /// Copies the points that stay.
    fn copy(&mut self, clouds: &[&[Point]], out: &mut [Point]) {
        clear_and_reserve(&mut self.kept_starts, self.pieces.len() + 1);
        self.report.removed.clear();
        self.report.removed.extend(clouds.iter().map(|cloud| cloud.len() as u32));
        let mut used = 0;
        for piece in &self.pieces {
            self.kept_starts.push(used);
            used += piece.kept;
            self.report.removed[piece.cloud] -= piece.kept as u32;
        }
        self.kept_starts.push(used);
        self.report.points = used as u32;
        let (starts, keep) = (&self.starts, &self.keep);
        for_parts(&self.kept_starts, &mut out[..used], &mut self.pieces, &|number, out, piece| {
            let points = piece.points(clouds);
            if out.len() == points.len() {
                out.copy_from_slice(points);
                return;
            }
            let kept = points.iter().zip(&keep[starts[number]..]).filter(|(_, keep)| **keep);
            out.iter_mut().zip(kept).for_each(|(slot, (point, _))| *slot = *point);
        });
    }

    /// Takes the points that went out of the search.
    fn remove(&mut self, clouds: &[&[Point]], grid: &Grid) {
        clear_and_reserve(&mut self.gone, count(clouds) - self.report.points as usize);
        for (piece, start) in self.pieces.iter().zip(&self.starts) {
            if piece.kept == piece.end - piece.first {
                continue;
            }
            for (offset, point) in piece.points(clouds).iter().enumerate() {
                if self.keep[start + offset] {
                    continue;
                }
                self.gone.push((start + offset) as u32);
                if is_finite(point) {
                    let index = (piece.first + offset) as u32;
                    self.per_cloud[piece.cloud].remove(grid, &point.position_mm, index);
                }
            }
        }
    }

    fn overlaps(&mut self, clouds: usize, grid: &Grid, radius_mm: f64, settings: &FusionSettings) {
        let cosine = crate::math::cos(settings.max_normal_angle_deg.to_radians());
        // Every cloud is compared with all others: from one cell in so many, so that the work grows with the clouds, not with their square.
        let every = clouds.saturating_sub(1).max(1);
        let nearness = Nearness { radius_mm, cosine, fewest: settings.min_overlap_neighbours, every };
        let (level, limits) = (best_level(), Limits::of_every(every));
        let cells: usize = self.per_cloud[..clouds].iter().map(Cells::len).sum();
        clear_and_reserve(&mut self.raised, 2 * cells);
        for a in 0..clouds {
            for b in a + 1..clouds {
                let (own, other) = (&self.per_cloud[a], &self.per_cloud[b]);
                let parts = own.len().div_ceil(CELLS);
                clear_and_reserve(&mut self.distances, parts);
                self.distances.resize(parts, Distances::default());
                clear_and_reserve(&mut self.compared, own.len());
                self.compared.resize(own.len(), Compared::default());
                self.near.resize_with(self.near.len().max(parts), Near::default);
                let parts = self.distances.par_iter_mut().zip(self.compared.par_chunks_mut(CELLS));
                // Some parts take longer than others: none goes to a thread together with another.
                let parts = parts.zip(&mut self.near).enumerate().with_max_len(1);
                parts.for_each(|(part, ((distances, compared), near))| {
                    let cells = (part * CELLS, compared);
                    *distances = Distances::of((own, other), cells, near, grid, &nearness, level);
                });
                let mut all = Distances::default();
                self.distances.iter().for_each(|part| all.join(part));
                self.report.overlaps.push(all.overlap(a, b));
                let (own, other) = ((a, own), (b, other));
                let mut comparison =
                    Comparison { own, other, compared: &self.compared, grid, noise: 1.0, limits };
                if self.may_share_noise(a, b) {
                    comparison = comparison.with_own_noise();
                }
                comparison.find(&mut self.disagreeing, &mut self.raised);
            }
        }
    }

    /// Whether two clouds were measured from one picture, as far as is known.
    fn may_share_noise(&self, a: usize, b: usize) -> bool {
        match (self.pictures.get(a), self.pictures.get(b)) {
            (Some(a), Some(b)) => a.iter().any(|picture| b.contains(picture)),
            _ => true,
        }
    }

    /// Gives the points of cells in which pairs disagree the uncertainty that this asks for.
    fn raise(&mut self, out: &mut [Point]) {
        disagreement::largest(&mut self.raised);
        for Raised { cell: (cloud, cell), excess_mm2 } in &self.raised {
            let first = self.pieces.partition_point(|piece| piece.cloud < *cloud);
            for index in self.per_cloud[*cloud].points(*cell) {
                let place = self.starts[first + index / PIECE] + index % PIECE;
                if self.keep[place] {
                    let before = self.gone.partition_point(|gone| (*gone as usize) < place);
                    let point = &mut out[place - before];
                    // What parts the pairs may be the same all over a face.
                    for part in [&mut point.sigma_mm, &mut point.shared_mm] {
                        *part = (f64::from(*part).powi(2) + excess_mm2).sqrt() as f32;
                    }
                    self.report.disagreeing += 1;
                }
            }
        }
    }
}

impl Piece {
    fn points<'a>(&self, clouds: &[&'a [Point]]) -> &'a [Point] {
        &clouds[self.cloud][self.first..self.end]
    }
}

/// Points of all clouds.
fn count(clouds: &[&[Point]]) -> usize {
    clouds.iter().map(|cloud| cloud.len()).sum()
}

#[cfg(test)]
mod tests;
