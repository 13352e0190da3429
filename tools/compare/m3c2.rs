//! The M3C2 method of `compare`.

use super::Args;
use super::output::{Compared, Levels};
use anyhow::{Result, bail};
use fringe::cloud::Point;
use metrology::compare::m3c2::{M3c2Settings, m3c2};
use metrology::reference::CloudReference;

/// Diameter of the cylinder in spacings: 38 points on the average; Lague et al. ask for 20 or more.
const PROJECTION_SPACINGS: f64 = 7.0;

/// Scales of the normals, as multiples of the cylinder's diameter.
const SCALES: [f64; 3] = [1.0, 2.0, 4.0];

/// Depth of the cylinder without `--max-distance`, as a multiple of its diameter.
const DEPTH: f64 = 5.0;

/// Compares and puts the core points in the place of the cloud's.
pub fn compare(args: &Args, points: &[Point], reference: &CloudReference) -> Result<Compared> {
    let projection_scale_mm = args.projection_scale.unwrap_or(PROJECTION_SPACINGS * reference.spacing_mm());
    let settings = M3c2Settings {
        normal_scales_mm: args
            .normal_scales
            .clone()
            .unwrap_or_else(|| SCALES.map(|factor| factor * projection_scale_mm).to_vec()),
        projection_scale_mm,
        depth_mm: args.max_distance.unwrap_or(DEPTH * projection_scale_mm),
        core_mm: args.core.unwrap_or(0.5 * projection_scale_mm),
        registration_mm: args.registration,
    };
    let found = m3c2(points, reference, &settings);
    let Some(statistics) = found.statistics else {
        bail!(
            "{}: none of {} core points of {} has points of both clouds in its cylinder of {} mm and ±{} mm: the clouds do \
             not overlap; align them first, or widen --projection-scale or --max-distance",
            args.cloud.display(),
            found.points.len(),
            args.reference.display(),
            settings.projection_scale_mm,
            settings.depth_mm
        );
    };
    let levels = Levels {
        settings,
        core_points: found.points.len(),
        without_distance: found.without_distance,
        with_level: found.with_level,
        significant: found.significant,
        lod95_median_mm: found.median_level_mm,
    };
    let cores = found.points.iter().map(|p| p.point).collect();
    let deviations_mm = found.points.iter().map(|p| p.distance_mm).collect();
    Ok(Compared {
        points: cores,
        deviations_mm,
        statistics,
        counts: None,
        m3c2: Some(levels),
        conformity: None,
    })
}
