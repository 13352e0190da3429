//! Distances between two clouds with a level of detection: M3C2.
//!
//! D. Lague, N. Brodu, J. Leroux, Accurate 3D comparison of complex topography with terrestrial laser scanner, ISPRS J.
//! 82, 2013. At each core point of the reference the normal is that of the scale at which the reference is most planar;
//! both clouds are averaged along it inside a cylinder, and the difference of the means is significant where it exceeds
//! LOD₉₅ = 1.96 (√(s₁²/n₁ + s₂²/n₂) + reg). The scatter s takes in noise and roughness; what shifts a cloud as a
//! whole is added as `reg`.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::statistics::Statistics;
use crate::reference::CloudReference;
use crate::spatial::{Aabb, CHUNK, Moments, PointTree, eigen_normal, thinned};
use fringe::cloud::Point;

/// Two-sided 95 % of the normal distribution.
const K95: f64 = 1.96;

/// Fewest points of each cloud in the cylinder for a level of detection (Lague et al., section 3.2).
const LEAST_FOR_LEVEL: usize = 4;

/// Fewest points of a plane at a scale.
const LEAST_FOR_NORMAL: usize = 4;

/// What is averaged over which lengths.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct M3c2Settings {
    /// Diameters of the balls on which normals are tried, mm; the most planar one counts.
    pub normal_scales_mm: Vec<f64>,
    /// Diameter of the cylinder, mm.
    pub projection_scale_mm: f64,
    /// Half length of the cylinder: the largest distance that can be found, mm.
    pub depth_mm: f64,
    /// Edge of the cells that keep one core point each, mm.
    pub core_mm: f64,
    /// Uncertainty of the alignment of the clouds, mm.
    pub registration_mm: f64,
}

/// A core point and what was found there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct M3c2Point {
    /// The core point, with its unit normal, outside; the normal is zero where no scale has one.
    pub point: Point,
    /// Diameter at which the normal was taken, mm.
    pub scale_mm: f64,
    /// Mean of the cloud less mean of the reference along the normal, mm; `None` where either has no point.
    pub distance_mm: Option<f64>,
    /// Level of detection at 95 %, mm; `None` below four points of either.
    pub level_mm: Option<f64>,
    /// Points of the reference and of the cloud in the cylinder.
    pub counts: [usize; 2],
}

impl M3c2Point {
    /// Whether the distance is beyond the level of detection.
    pub fn significant(&self) -> bool {
        matches!((self.distance_mm, self.level_mm), (Some(d), Some(level)) if d.abs() > level)
    }
}

/// Result of an M3C2 comparison.
#[derive(Debug, Clone)]
pub struct M3c2 {
    /// Distance at each core point, in their order.
    pub points: Vec<M3c2Point>,
    /// Statistics of all distances; `None` without any.
    pub statistics: Option<Statistics>,
    /// Core points with a distance beyond their level of detection.
    pub significant: usize,
    /// Core points with a level of detection.
    pub with_level: usize,
    /// Median of the levels of detection, mm.
    pub median_level_mm: Option<f64>,
    /// Core points without a distance.
    pub without_distance: usize,
}

/// Compares a cloud with a reference cloud at core points of the reference.
pub fn m3c2(points: &[Point], reference: &CloudReference, settings: &M3c2Settings) -> M3c2 {
    let positions: Vec<Point3<f64>> = points.iter().map(Point::position).collect();
    let cloud = PointTree::new(&positions);
    let tree = &reference.tree;
    let mut slots = vec![0; tree.order().len()];
    for (slot, index) in tree.order().iter().enumerate() {
        slots[*index as usize] = slot;
    }
    let in_order: Vec<Point3<f64>> = slots.iter().map(|slot| tree.sites()[*slot]).collect();
    let cores = thinned(&in_order, settings.core_mm);
    let found: Vec<M3c2Point> = cores
        .par_chunks(CHUNK)
        .flat_map_iter(|chunk| {
            chunk.iter().map(|index| core_point(slots[*index as usize], reference, &cloud, settings))
        })
        .collect();
    summarise(found)
}

fn summarise(points: Vec<M3c2Point>) -> M3c2 {
    let distances: Vec<f64> = points.iter().filter_map(|p| p.distance_mm).collect();
    let mut levels: Vec<f64> = points.iter().filter_map(|p| p.level_mm).collect();
    levels.sort_unstable_by(f64::total_cmp);
    M3c2 {
        statistics: Statistics::of(&distances),
        significant: points.iter().filter(|p| p.significant()).count(),
        with_level: levels.len(),
        median_level_mm: Statistics::of(&levels).map(|s| s.median_mm),
        without_distance: points.len() - distances.len(),
        points,
    }
}

fn core_point(
    slot: usize,
    reference: &CloudReference,
    cloud: &PointTree,
    settings: &M3c2Settings,
) -> M3c2Point {
    let core = reference.tree.sites()[slot];
    let point = Point { position_mm: core.coords.into(), ..bytemuck::Zeroable::zeroed() };
    let mut found = M3c2Point { point, scale_mm: 0.0, distance_mm: None, level_mm: None, counts: [0; 2] };
    let Some((normal, scale_mm)) = most_planar(&core, &reference.tree, &settings.normal_scales_mm) else {
        return found;
    };
    let normal = reference.towards_outside(slot, &normal);
    (found.point.normal, found.scale_mm) = (normal.map(|v| v as f32).into(), scale_mm);
    let [a, b] = [&reference.tree, cloud].map(|tree| along(tree, &core, &normal, settings));
    found.counts = [a.count, b.count];
    if a.count > 0 && b.count > 0 {
        found.distance_mm = Some(b.mean_mm - a.mean_mm);
    }
    if a.count >= LEAST_FOR_LEVEL && b.count >= LEAST_FOR_LEVEL {
        let scatter = (a.variance_mm2 / a.count as f64 + b.variance_mm2 / b.count as f64).sqrt();
        found.level_mm = Some(K95 * (scatter + settings.registration_mm));
    }
    found
}

/// The normal of the scale at which the points scatter least beside their plane, compared with all their scatter.
fn most_planar(core: &Point3<f64>, tree: &PointTree, scales_mm: &[f64]) -> Option<(Vector3<f64>, f64)> {
    let mut best: Option<(f64, Vector3<f64>, f64)> = None;
    for scale_mm in scales_mm {
        let mut moments = Moments::about(*core);
        tree.within(core, 0.5 * scale_mm, |slot| moments.add(&tree.sites()[slot]));
        if moments.count() < LEAST_FOR_NORMAL {
            continue;
        }
        if let Some((normal, [least, middle, most])) = eigen_normal(&moments.covariance()) {
            let beside = least / (least + middle + most);
            if best.is_none_or(|(other, ..)| beside < other) {
                best = Some((beside, normal, *scale_mm));
            }
        }
    }
    best.map(|(_, normal, scale_mm)| (normal, scale_mm))
}

/// Points in a cylinder, along its axis.
struct Along {
    count: usize,
    mean_mm: f64,
    variance_mm2: f64,
}

fn along(tree: &PointTree, core: &Point3<f64>, axis: &Vector3<f64>, settings: &M3c2Settings) -> Along {
    let radius_mm = 0.5 * settings.projection_scale_mm;
    let depth_mm = settings.depth_mm;
    // A box whose enclosing ball misses the cylinder's axis by more than its radius holds none of its points.
    let passes = |b: &Aabb| {
        let middle = b.centre() - core;
        let half = 0.5 * (b.high - b.low).norm();
        let at = middle.dot(axis).clamp(-depth_mm, depth_mm);
        (middle - axis * at).norm() <= radius_mm + half
    };
    let (mut count, mut sum, mut squares) = (0, 0.0, 0.0);
    tree.within_box(passes, |_, site| {
        let d = site - core;
        let height = d.dot(axis);
        if height.abs() <= depth_mm && (d - axis * height).norm_squared() <= radius_mm * radius_mm {
            count += 1;
            sum += height;
            squares += height * height;
        }
    });
    let n = f64::from(count);
    let mean_mm = sum / n.max(1.0);
    let variance_mm2 = ((squares - sum * mean_mm) / (n - 1.0).max(1.0)).max(0.0);
    Along { count: count as usize, mean_mm, variance_mm2 }
}
