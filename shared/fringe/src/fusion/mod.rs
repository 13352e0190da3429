//! One cloud from all pairs: isolated points removed, agreement of the pairs reported.
//!
//! # Rules
//! - A point stays when at least `min_neighbours` other points, of whichever pair, lie within the radius; otherwise
//!   it is isolated and goes. Points that are not finite go too.
//! - Without a radius in the settings it is `RADIUS_PER_SPACING` times the median distance of points that are
//!   neighbours along an image row.
//! - Points come out in the order of the clouds, within a cloud in the order they came in (that of the pixels).
//! - Overlap of two pairs a < b: for each point p of a, the mean of ½ (n_p + n_q)·(p − q) over the points q of b within
//!   the radius whose normals agree with that of p. This is the distance from p to the local surface of b: positive where
//!   a lies outside of b. The mean of both normals makes it exact on planes and free of the curvature's bias on
//!   spheres, where point-to-plane errs by the sagitta (the symmetric objective of Rusinkiewicz 2019). The thesis
//!   (figure 5.16) takes nearest neighbours, which measures the sampling as well: 48 µm there.

mod cells;

use crate::cloud::Point;
use cells::{Cells, Grid, Site, clear_and_reserve, distance2};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// The radius over the spacing of the points, when the settings give none: a disc of about 28 points.
const RADIUS_PER_SPACING: f64 = 3.0;

/// Pairs of pixel neighbours that are sampled for the spacing.
const SPACING_SAMPLES: usize = 4096;

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

/// How well two pairs agree where both see the part. Lengths in mm.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Overlap {
    /// Number of a cloud.
    pub a: usize,
    /// Number of a later cloud.
    pub b: usize,
    /// Points of a that have a surface of b beside them.
    pub count: u32,
    /// Mean signed distance; positive where a lies outside of b. Zero without points.
    pub mean_mm: f64,
    /// Sample standard deviation of the signed distance. Zero below two points.
    pub sd_mm: f64,
    /// Largest absolute distance, mm.
    pub max_mm: f64,
    /// Root mean square of (distance − mean) over its predicted uncertainty, which takes the points as independent; about 1
    /// when noise is all there is, some 1.1 where neighbours share noise because they were smoothed. Absent without points or uncertainties.
    pub sd_over_sigma: Option<f64>,
}

/// Counts and overlaps of a fusion.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct FusionReport {
    /// Points of the fused cloud.
    pub points: u32,
    /// Points removed, per cloud.
    pub removed: Vec<u32>,
    /// Neighbourhood that was used, mm; zero without points.
    pub radius_mm: f64,
    /// All pairs of clouds in order: (0, 1), (0, 2), … (1, 2), …
    pub overlaps: Vec<Overlap>,
}

/// Fuses again and again with buffers that only grow.
#[derive(Debug, Clone, Default)]
pub struct Fuser {
    /// Finite points of all clouds, one after another.
    all: Vec<Point>,
    everything: Cells,
    keep: Vec<bool>,
    per_cloud: Vec<Cells>,
    spacings: Vec<f64>,
    /// Where each cloud begins among all points, and one place more for the end.
    starts: Vec<usize>,
    /// The same among those that stayed.
    kept_starts: Vec<usize>,
    report: FusionReport,
}

/// Fuses once; see [`Fuser::fuse`].
pub fn fuse(clouds: &[&[Point]], settings: &FusionSettings, out: &mut Vec<Point>) -> FusionReport {
    Fuser::default().fuse(clouds, settings, out).clone()
}

impl Fuser {
    /// Fuses clouds, in the order of the pairs, into `out` (cleared first); see [`Self::fuse_into`].
    pub fn fuse(
        &mut self,
        clouds: &[&[Point]],
        settings: &FusionSettings,
        out: &mut Vec<Point>,
    ) -> &FusionReport {
        clear_and_reserve(out, count(clouds));
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
        self.gather(clouds);
        self.report.radius_mm = 0.0;
        let radius_mm = settings.radius_mm.filter(|r| *r > 0.0).unwrap_or_else(|| self.radius(clouds));
        if let Some(grid) = Grid::over(self.all.iter(), radius_mm) {
            self.report.radius_mm = radius_mm;
            self.mark(&grid, radius_mm, settings.min_neighbours);
        }
        self.kept_starts.clear();
        self.report.removed.clear();
        let mut used = 0;
        for (cloud, points) in clouds.iter().enumerate() {
            let begin = used;
            self.kept_starts.push(begin);
            let range = self.starts[cloud]..self.starts[cloud + 1];
            let kept = self.all[range.clone()].iter().zip(&self.keep[range]).filter(|(_, keep)| **keep);
            for (slot, (point, _)) in out[begin..].iter_mut().zip(kept) {
                *slot = *point;
                used += 1;
            }
            self.report.removed.push((points.len() - (used - begin)) as u32);
        }
        self.kept_starts.push(used);
        self.report.points = used as u32;
        self.report.overlaps.clear();
        self.overlaps(&out[..used], radius_mm, settings);
    }

    /// Copies the finite points.
    fn gather(&mut self, clouds: &[&[Point]]) {
        clear_and_reserve(&mut self.all, count(clouds));
        self.starts.clear();
        self.starts.push(0);
        for cloud in clouds {
            let finite = cloud.iter().filter(|p| p.position_mm.iter().all(|v| v.is_finite()));
            self.all.extend(finite);
            self.starts.push(self.all.len());
        }
        clear_and_reserve(&mut self.keep, self.all.len());
        self.keep.resize(self.all.len(), false);
    }

    /// Median distance of row neighbours, sampled evenly, times the factor; 1 mm when no two points are neighbours.
    fn radius(&mut self, clouds: &[&[Point]]) -> f64 {
        let stride = (self.all.len() / SPACING_SAMPLES).max(1);
        clear_and_reserve(&mut self.spacings, self.all.len() / stride + clouds.len());
        for cloud in clouds {
            let neighbours =
                cloud.windows(2).step_by(stride).filter(|w| w[1].pixel == w[0].pixel.wrapping_add(1));
            let distances = neighbours.map(|w| distance2(&w[0].position_mm, &w[1].position_mm).sqrt());
            self.spacings.extend(distances.filter(|d| d.is_finite()));
        }
        self.spacings.sort_unstable_by(f64::total_cmp);
        let median = self.spacings.get(self.spacings.len() / 2).copied().filter(|d| *d > 0.0);
        median.map_or(1.0, |spacing| RADIUS_PER_SPACING * spacing)
    }

    /// Marks the points that are not isolated.
    fn mark(&mut self, grid: &Grid, radius_mm: f64, min_neighbours: u32) {
        self.everything.fill(grid, &self.all, 0);
        let (limit, keep) = (radius_mm * radius_mm, &mut self.keep);
        self.everything.sweep(grid, &self.everything, |sites, runs| {
            for site in sites {
                // The site finds itself; the middle row is the most likely one to have enough.
                let wanted = min_neighbours + 1;
                let mut count = 0;
                for run in [4, 1, 3, 5, 7, 0, 2, 6, 8] {
                    for other in runs[run] {
                        count += u32::from(distance2(&other.position_mm, &site.position_mm) <= limit);
                        if count >= wanted {
                            break;
                        }
                    }
                }
                keep[site.index as usize] = count >= wanted;
            }
        });
    }

    fn overlaps(&mut self, points: &[Point], radius_mm: f64, settings: &FusionSettings) {
        let starts = &self.kept_starts;
        let clouds = starts.len() - 1;
        let Some(grid) = Grid::over(points.iter(), radius_mm) else { return };
        self.per_cloud.resize_with(self.per_cloud.len().max(clouds), Cells::default);
        for (cloud, cells) in self.per_cloud.iter_mut().take(clouds).enumerate() {
            cells.fill(&grid, &points[starts[cloud]..starts[cloud + 1]], 0);
        }
        let cosine = crate::math::cos(settings.max_normal_angle_deg.to_radians());
        for a in 0..clouds {
            for b in a + 1..clouds {
                let mut distances = Distances::default();
                self.per_cloud[a].sweep(&grid, &self.per_cloud[b], |sites, runs| {
                    for site in sites {
                        let wanted = settings.min_overlap_neighbours;
                        if let Some((distance, sigma)) =
                            signed_distance(site, runs, radius_mm, cosine, wanted)
                        {
                            distances.add(distance, sigma);
                        }
                    }
                });
                self.report.overlaps.push(distances.overlap(a, b));
            }
        }
    }
}

/// Points of all clouds.
fn count(clouds: &[&[Point]]) -> usize {
    clouds.iter().map(|cloud| cloud.len()).sum()
}

/// Signed distance from a site to the surface of the other cloud, and its predicted uncertainty.
fn signed_distance(
    site: &Site,
    runs: [&[Site]; 9],
    radius_mm: f64,
    cosine: f64,
    wanted: u32,
) -> Option<(f64, f64)> {
    let normal = Vector3::from(site.normal.map(f64::from));
    if normal == Vector3::zeros() {
        return None;
    }
    let limit = radius_mm * radius_mm;
    let (mut count, mut sum, mut variance) = (0, 0.0, 0.0);
    for other in runs.iter().copied().flatten() {
        if distance2(&other.position_mm, &site.position_mm) > limit {
            continue;
        }
        let other_normal = Vector3::from(other.normal.map(f64::from));
        // Zero normals fail here.
        if normal.dot(&other_normal) < cosine {
            continue;
        }
        let between = Vector3::from(site.position_mm) - Vector3::from(other.position_mm);
        count += 1;
        sum += (normal + other_normal).dot(&between);
        variance += f64::from(other.sigma_mm * other.sigma_mm);
    }
    if count < wanted.max(1) {
        return None;
    }
    let n = f64::from(count);
    let own = f64::from(site.sigma_mm);
    Some((0.5 * sum / n, (own * own + variance / (n * n)).sqrt()))
}

/// Moments of the distances, in the order of the sweep.
#[derive(Debug, Clone, Copy, Default)]
struct Distances {
    count: u32,
    mean: f64,
    squares: f64,
    max: f64,
    weights: f64,
    weighted: f64,
    weighted_squares: f64,
}

impl Distances {
    /// Welford's update: no cancellation.
    fn add(&mut self, distance: f64, sigma: f64) {
        self.count += 1;
        let before = distance - self.mean;
        self.mean += before / f64::from(self.count);
        self.squares += before * (distance - self.mean);
        self.max = self.max.max(distance.abs());
        let weight = 1.0 / (sigma * sigma);
        self.weights += weight;
        self.weighted += weight * distance;
        self.weighted_squares += weight * distance * distance;
    }

    fn overlap(&self, a: usize, b: usize) -> Overlap {
        let n = f64::from(self.count);
        let sd_mm = if self.count < 2 { 0.0 } else { (self.squares / (n - 1.0)).sqrt() };
        // Σ w (d − m)² = Σ w d² − 2 m Σ w d + m² Σ w.
        let m = self.mean;
        let sum = self.weighted_squares - 2.0 * m * self.weighted + m * m * self.weights;
        let ratio = (sum / n).sqrt();
        let sd_over_sigma = (self.count > 1 && ratio.is_finite()).then_some(ratio);
        Overlap { a, b, count: self.count, mean_mm: self.mean, sd_mm, max_mm: self.max, sd_over_sigma }
    }
}

#[cfg(test)]
mod tests;
