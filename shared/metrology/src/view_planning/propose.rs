//! Which further pairs would see what no pair sees.

use super::error::ViewPlanError;
use super::planner::{FringesOf, PairViews, Planner, pair_views};
use super::seeing::Seeing;
use fringe::geometry::camera::Camera;
use fringe::geometry::rig::{Named, Pair, Rig};
use fringe::math::{cos, sin};
use nalgebra::{Isometry3, Point3, Translation3, Unit, UnitQuaternion, Vector3};
use rayon::prelude::*;

/// Elevations above the horizon at which pairs are tried, degrees.
const ELEVATIONS_DEG: [f64; 6] = [15.0, 30.0, 45.0, 60.0, 75.0, 90.0];
/// Steps around the part at which pairs are tried, degrees.
const AZIMUTH_STEP_DEG: usize = 30;

/// A pair that would see more.
#[derive(Debug, Clone, PartialEq)]
pub struct Proposal {
    /// Number of the pair among the candidates.
    pub candidate: usize,
    /// Area that no pair saw before, mm².
    pub gain_mm2: f64,
    /// Area that is still not seen, mm².
    pub left_mm2: f64,
}

/// Greedy choice: again and again the candidate that sees most of what is left, until `most` are chosen or the best one
/// gains less than `least_mm2`. Of equal ones the first is taken. Rims in the pictures count as in the rest of the plan.
///
/// # Errors
/// Candidates that name unknown views.
pub fn propose(
    planner: &Planner,
    seeing: &[Seeing],
    (candidates, fringes): (&Rig, &FringesOf),
    (most, least_mm2): (usize, f64),
    step: &mut dyn FnMut(),
) -> Result<Vec<Proposal>, ViewPlanError> {
    let middle = planner.mesh().bounds().centre();
    let views = candidates
        .pairs
        .iter()
        .map(|pair| pair_views(candidates, pair, fringes, planner.conditions(), &middle))
        .collect::<Result<Vec<PairViews>, _>>()?;
    let pairs = planner.pairs().len();
    let unseen = |index: &usize| !seeing[index * pairs..(index + 1) * pairs].iter().any(Seeing::is_seen);
    let open = |index: &usize| !planner.elements()[*index].buried && unseen(index);
    let mut left: Vec<usize> = (0..planner.elements().len()).filter(open).collect();
    // What each candidate sees of it, found once; the rims in its pictures, which take most of the work, only of one that is about to be chosen.
    let mut seen: Vec<Vec<usize>> = Vec::with_capacity(views.len());
    let mut exact = vec![false; views.len()];
    for pair in &views {
        let sees =
            |index: &&usize| planner.seen_apart_from_rims(pair, &planner.elements()[**index]).is_seen();
        seen.push(left.par_iter().filter(sees).copied().collect());
        step();
    }
    let area = |indices: &[usize]| indices.iter().map(|i| planner.elements()[*i].area_mm2).sum::<f64>();
    let mut proposals = Vec::new();
    while proposals.len() < most {
        let gains = seen.iter().map(|seen| area(seen)).enumerate();
        let best = gains.fold((0, 0.0), |best, gain| if gain.1 > best.1 { gain } else { best });
        if best.1 < least_mm2 || best.1 <= 0.0 {
            break;
        }
        let mut now = std::mem::take(&mut seen[best.0]);
        if !std::mem::replace(&mut exact[best.0], true) {
            let inner = |index: &usize| !planner.is_at_rim(&views[best.0], &planner.elements()[*index]);
            now = now.into_par_iter().filter(inner).collect();
            seen[best.0] = now;
            continue;
        }
        let is_new = |index: &usize| now.binary_search(index).is_err();
        for seen in &mut seen {
            seen.retain(is_new);
        }
        left.retain(is_new);
        proposals.push(Proposal { candidate: best.0, gain_mm2: best.1, left_mm2: area(&left) });
    }
    Ok(proposals)
}

/// All pairs of a rig, each as a rigid whole turned about the middle of the part to places above the horizon: every 30° around the
/// vertical and every 15° up to it. Names state pair, azimuth and elevation.
pub fn turned_pairs(rig: &Rig, middle: &Point3<f64>, up: &Unit<Vector3<f64>>) -> Rig {
    let mut turned = Rig { sensors: std::collections::BTreeMap::new(), ..Rig::default() };
    for pair in &rig.pairs {
        let names = [&pair.left, &pair.right, &pair.projector];
        let Some(head) = direction(rig, pair, middle) else { continue };
        for elevation_deg in ELEVATIONS_DEG {
            // Straight from above, turning about the vertical changes little of what is seen: half a turn is enough.
            let around = if elevation_deg < 90.0 { 360 } else { 180 };
            for azimuth_deg in (0..around).step_by(AZIMUTH_STEP_DEG) {
                let tag = format!("{azimuth_deg}-{elevation_deg}");
                let motion = about(middle, &turn(&head, up, azimuth_deg as f64, elevation_deg));
                let name = |old: &str| format!("{old}-{tag}");
                for (list, out) in
                    [(&rig.cameras, &mut turned.cameras), (&rig.projectors, &mut turned.projectors)]
                {
                    for view in list.iter().filter(|view| names.contains(&&view.name)) {
                        let new = name(&view.name);
                        if out.iter().all(|known: &Named| known.name != new) {
                            out.push(Named { name: new, camera: moved(&view.camera, &motion) });
                        }
                    }
                }
                for view in names {
                    if let Some(sensor) = rig.sensors.get(view) {
                        turned.sensors.insert(name(view), *sensor);
                    }
                }
                turned.pairs.push(Pair {
                    name: name(&pair.name),
                    left: name(&pair.left),
                    right: name(&pair.right),
                    projector: if pair.projector.is_empty() { String::new() } else { name(&pair.projector) },
                });
            }
        }
    }
    turned
}

/// From the middle of the part to the middle of the views of a pair.
fn direction(rig: &Rig, pair: &Pair, middle: &Point3<f64>) -> Option<Unit<Vector3<f64>>> {
    let views = [&pair.left, &pair.right].map(|name| rig.device(name));
    let sum: Vector3<f64> = views.iter().flatten().map(|view| (view.centre_mm() - middle).normalize()).sum();
    Unit::try_new(sum, 1e-9)
}

/// The turn that brings a direction to an azimuth, counted from where it stands, and an elevation.
fn turn(
    head: &Unit<Vector3<f64>>,
    up: &Unit<Vector3<f64>>,
    azimuth_deg: f64,
    elevation_deg: f64,
) -> UnitQuaternion<f64> {
    let height = head.dot(up).clamp(-1.0, 1.0);
    let flat = head.into_inner() - up.into_inner() * height;
    // A pair that stands straight above has no azimuth of its own: any horizontal direction is its front.
    let fallback = if up.x.abs() < 0.6 { Vector3::x() } else { Vector3::y() };
    let front = flat
        .try_normalize(1e-6)
        .unwrap_or_else(|| (fallback - up.into_inner() * fallback.dot(up)).normalize());
    let sideways = Unit::new_normalize(up.cross(&front));
    let (elevation, azimuth) = (elevation_deg.to_radians(), azimuth_deg.to_radians());
    let now = fringe::math::atan2(height, head.dot(&front));
    // A right-handed turn about `sideways` lowers what lies in front.
    let tilt = UnitQuaternion::from_quaternion(quaternion(&sideways, now - elevation));
    UnitQuaternion::from_quaternion(quaternion(up, azimuth)) * tilt
}

fn quaternion(axis: &Unit<Vector3<f64>>, angle_rad: f64) -> nalgebra::Quaternion<f64> {
    let (sine, cosine) = (sin(0.5 * angle_rad), cos(0.5 * angle_rad));
    nalgebra::Quaternion::new(cosine, axis.x * sine, axis.y * sine, axis.z * sine)
}

/// A turn about a point.
fn about(middle: &Point3<f64>, turn: &UnitQuaternion<f64>) -> Isometry3<f64> {
    Isometry3::from_parts(Translation3::from(middle.coords - turn * middle.coords), *turn)
}

/// A view after a motion of its mount.
fn moved(camera: &Camera, motion: &Isometry3<f64>) -> Camera {
    Camera { camera_from_world: camera.camera_from_world * motion.inverse(), ..camera.clone() }
}
