//! What the calibration of the rig adds to the uncertainty of each feature.

use anyhow::{Context, Result, bail};
use characterise::calibration::{Followed, Mode, PARAMETERS, modes};
use characterise::sensor::FootprintEffect;
use files::footprints_off::FootprintsOff;
use files::rig_file::RigFile;
use fringe::cloud::Point;
use fringe::geometry::rig::Rig;
use fringe::sensor::Sensor;
use metrology::inspection::{InspectionResult, Plan, evaluate};
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Parts of a mode that are tried, the whole one first.
const PARTS: [f64; 4] = [1.0, 0.1, 0.01, 0.001];

/// Share of the points of a camera of which the effect of its footprint has to be known; edges and rims are the rest of a whole cloud.
const LEAST_JUDGED: f64 = 0.5;

/// The result with the calibration's share in each uncertainty and verdict.
pub fn with_calibration(
    plan: &Plan,
    points: &[Point],
    rig_file: &RigFile,
    cameras_off: &FootprintsOff,
) -> Result<InspectionResult> {
    let shares = shares(plan, points, rig_file, cameras_off)?;
    let mut unknown = seeing(&rig_file.rig, points);
    unknown.retain(|name| rig_file.rig.sensor(name).footprint.is_none());
    if !unknown.is_empty() {
        eprintln!(
            "warning: {}: states no footprint_px of {}: the uncertainty of each feature holds what is open of it, estimated from \
             white and black or assumed; `fringetool calibrate` finds it",
            rig_file.path.display(),
            unknown.join(", ")
        );
    }
    if !cameras_off.is_empty() {
        eprintln!(
            "warning: {}; the uncertainty of each feature holds the difference: {REMEDY}",
            other_footprint(cameras_off)
        );
    }
    Ok(evaluate(&plan.clone().with_calibration(&shares), points))
}

/// What mends a footprint that differs from what was taken off.
pub const REMEDY: &str = "look at focus and dirt, or state no footprint_px under [decode]";

/// Says so of the cameras.
pub fn other_footprint(cameras_off: &FootprintsOff) -> String {
    let names: Vec<&str> = cameras_off.keys().map(String::as_str).collect();
    format!("another footprint was taken off the frames of {} than these cameras have", names.join(", "))
}

/// What is open of the cameras' footprints: effects, and the standard uncertainty of the change that each belongs to, px².
#[derive(Default)]
pub struct OpenFootprints(Vec<(FootprintEffect, f64)>);

impl OpenFootprints {
    /// Of all cameras of the pairs, on their cloud; `sensors` says what is known of each. What differs from what was taken off counts as
    /// one more: all these footprints may be wrong by what is said of each.
    pub fn new(
        rig: &Rig,
        sensors: &BTreeMap<String, Sensor>,
        cameras_off: &FootprintsOff,
        points: &[Point],
    ) -> Self {
        let (mut open, mut off) = (Vec::new(), Vec::new());
        for name in seeing(rig, points) {
            let known = sensors.get(name).copied().unwrap_or_default();
            let effect = FootprintEffect::of(rig, name, points);
            off.extend(cameras_off.get(name).map(|off_px2| (effect.clone(), *off_px2)));
            open.push((effect, known.footprint_u_px2()));
        }
        if !off.is_empty() {
            open.push((FootprintEffect::together(&off), 1.0));
        }
        Self(open)
    }

    /// Warns where so many points have no neighbours that the share does not hold what their footprints do.
    fn warn(&self, rig: &Path) {
        let least = self.0.iter().map(|(effect, _)| effect.judged()).fold(1.0, f64::min);
        if least < LEAST_JUDGED {
            eprintln!(
                "warning: {}: what a footprint does is known at {:.0} % of the points of a camera, and the uncertainties hold no more: take a cloud \
                 with normals and all its points, as it was reconstructed",
                rig.display(),
                100.0 * least
            );
        }
    }

    /// What the modes of a calibration and these footprints, each by such a part, change of the features of a plan, over that part: the root of
    /// the sum of squares. `followed` is the cloud, `here` are its features. `None` where one is not found, there or on moved points.
    pub fn shares(
        &self,
        (modes, part): (&[Mode], f64),
        plan: &Plan,
        followed: &Followed<'_>,
        here: &[Option<f64>],
    ) -> Vec<Option<f64>> {
        let by_mode = modes.par_iter().map(|mode| feature_values(plan, &mode.moved(followed)));
        let footprints = self.0.par_iter();
        let by_footprint =
            footprints.map(|(effect, u)| feature_values(plan, &effect.moved(followed.points(), part * u)));
        let moved: Vec<Vec<Option<f64>>> = by_mode.chain(by_footprint).collect();
        let share = |(index, here): (usize, &Option<f64>)| {
            let here = (*here)?;
            let square = |moved: &Vec<Option<f64>>| Some(((moved[index]? - here) / part).powi(2));
            moved.iter().map(square).sum::<Option<f64>>().map(f64::sqrt)
        };
        here.iter().enumerate().map(share).collect()
    }
}

/// The value of each feature of a plan on a cloud, in its order.
pub fn feature_values(plan: &Plan, points: &[Point]) -> Vec<Option<f64>> {
    evaluate(plan, points).features.iter().map(|feature| feature.value).collect()
}

/// Names of the cameras that take part in a pair which has points.
fn seeing<'a>(rig: &'a Rig, points: &[Point]) -> Vec<&'a str> {
    let pairs: BTreeSet<usize> = points.iter().map(|point| point.pair as usize).collect();
    let paired = |name: &str| {
        pairs
            .iter()
            .filter_map(|pair| rig.pairs.get(*pair))
            .any(|pair| pair.left == name || pair.right == name)
    };
    rig.cameras.iter().map(|camera| camera.name.as_str()).filter(|name| paired(name)).collect()
}

/// Root of the sum of squares over the modes of the covariance and the footprints of the cameras, for each feature.
pub fn shares(
    plan: &Plan,
    points: &[Point],
    rig_file: &RigFile,
    cameras_off: &FootprintsOff,
) -> Result<Vec<Option<f64>>> {
    let path = rig_file.path.display();
    let Some(covariance) = rig_file.read_covariance()? else {
        bail!("{path}: names no covariance; `fringetool calibrate` writes one beside the rig file");
    };
    let count = covariance.parameters.len();
    if covariance.parameters[..] != PARAMETERS[..count.min(PARAMETERS.len())] {
        bail!(
            "{}: parameters: other ones than {}; calibrate again",
            covariance.path.display(),
            PARAMETERS.join(", ")
        );
    }
    let (pairs, most) = (rig_file.rig.pairs.len(), points.iter().map(|point| point.pair).max().unwrap_or(0));
    if most as usize >= pairs {
        bail!(
            "{path}: the cloud has points of pair {}, the rig has {pairs}: it is another rig's cloud",
            most + 1
        );
    }
    let names: Vec<&str> = covariance.devices.iter().map(String::as_str).collect();
    let matrix = covariance.part(&names).unwrap_or_default();
    let here = feature_values(plan, points);
    let footprints = OpenFootprints::new(&rig_file.rig, &rig_file.sensors(), cameras_off, points);
    footprints.warn(&rig_file.path);
    let followed = Followed::new(&rig_file.rig, points);
    let mut shares = vec![None; here.len()];
    // A mode so large that a feature is lost says nothing of it; a part of the mode does.
    for part in PARTS {
        let open = |index: &usize| here[*index].is_some() && shares[*index].is_none();
        let open: Vec<usize> = (0..here.len()).filter(open).collect();
        if open.is_empty() {
            break;
        }
        let smaller: Vec<f64> = matrix.iter().map(|value| value * part * part).collect();
        let modes = modes(&rig_file.rig, &covariance.devices, count, &smaller).with_context(|| {
            format!("{path}: a pair has a view that {} does not hold", covariance.path.display())
        })?;
        let found = footprints.shares((&modes, part), plan, &followed, &here);
        for index in open {
            shares[index] = found[index];
        }
    }
    if let Some(lost) = (0..here.len()).find(|index| here[*index].is_some() && shares[*index].is_none()) {
        bail!(
            "{}: this covariance, or the footprints of the cameras, moves the points of feature \"{}\" so far that it cannot be measured any \
             more, so that its uncertainty is not known; calibrate again",
            covariance.path.display(),
            plan.features[lost].name
        );
    }
    Ok(shares)
}

#[cfg(test)]
mod tests {
    use super::*;
    use files::hash::sha256_hex;
    use files::plan_file::read_plan;
    use files::rig_file::{CovarianceRef, covariance_beside, read_rig};
    use fringe::sensor::Footprint;

    /// What a calibration adds to the diameter of a ball, mm: variances of the focal lengths along x of all cameras, and what the rig file
    /// states beside them.
    fn share_of_a_ball(
        variance: f64,
        (sensors, cameras_off): (&BTreeMap<String, Sensor>, &FootprintsOff),
        points: &[Point],
    ) -> Result<f64> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("rig.toml");
        let mut demo =
            read_rig(&Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/demo-rig.toml")).unwrap();
        let size = 2 * demo.rig.cameras.len();
        let at = |i: usize, j: usize| if i == j && i.is_multiple_of(2) { variance } else { 0.0 };
        let names: Vec<&str> = demo.rig.cameras.iter().map(|camera| camera.name.as_str()).collect();
        let matrix: Vec<Vec<f64>> = (0..size).map(|i| (0..size).map(|j| at(i, j)).collect()).collect();
        let known = sensors.iter().filter_map(|(name, sensor)| Some((name, sensor.footprint?.u_px?)));
        let known = known.map(|(name, u)| (name.clone(), serde_json::json!({ "u_footprint_px": u })));
        let text = serde_json::json!({
            "format": "fringecell-covariance/1", "devices": names, "parameters": PARAMETERS[..2], "matrix": matrix,
            "sensors": known.collect::<serde_json::Map<_, _>>(),
        })
        .to_string();
        std::fs::write(covariance_beside(&path), &text).unwrap();
        let reference =
            CovarianceRef { file: "rig.covariance.json".into(), sha256: sha256_hex(text.as_bytes()) };
        demo.rig.sensors = sensors.clone();
        let rig_file = RigFile { path, covariance: Some(reference), ..demo };
        let plan = folder.path().join("ball.plan.toml");
        std::fs::write(
            &plan,
            "format = \"fringecell-plan/1\"\nname = \"ball\"\n[[element]]\nkind = \"sphere\"\nname = \"s\"\n\
             center_mm = [0.0, 0.0, 0.0]\ndiameter_mm = 20.0\nmargin_mm = 1.0\nmin_points = 10\n[[feature]]\n\
             kind = \"sphere-diameter\"\nname = \"d\"\nelement = \"s\"\nnominal_mm = 20.0\ntolerance_mm = [-0.1, 0.1]\n",
        )
        .unwrap();
        Ok(shares(&read_plan(&plan).unwrap().0, points, &rig_file, cameras_off)?[0].unwrap())
    }

    fn ball_point(out: [f64; 3]) -> Point {
        Point {
            position_mm: out.map(|v| 10.0 * v),
            normal: out.map(|v| v as f32),
            sigma_mm: 0.01,
            modulation: 80.0,
            pair: 0,
            pixel: 0,
            shared_mm: 0.0,
        }
    }

    /// Proves: a covariance ten thousand times as large gives a share a hundred times as large, although its modes move the sphere out of its
    /// region; one that moves it whatever part is taken is refused with the feature.
    #[test]
    fn a_share_is_found_however_large_the_covariance_is() {
        // Half a sphere that both cameras see, turned about its axis.
        let point = |i: usize| {
            let (z, turn) = (-0.1 - 0.8 * i as f64 / 400.0, 2.4 * i as f64);
            let (sin, cos) = fringe::math::sincos(turn);
            let ring = (1.0 - z * z).sqrt();
            ball_point([ring * cos, ring * sin, z])
        };
        let points: Vec<Point> = (0..400).map(point).collect();
        let share =
            |factor: f64| share_of_a_ball(factor * 1e-3, (&BTreeMap::new(), &FootprintsOff::new()), &points);
        let [small, large] = [1e6, 1e10].map(|factor| share(factor).unwrap());
        assert!(small > 1e-4 && (0.5..2.0).contains(&(large / small / 100.0)), "{small} mm, {large} mm");
        let refused = share(1e20).unwrap_err().to_string();
        assert!(refused.contains("feature \"d\" so far that it cannot be measured"), "{refused}");
    }

    /// Proves: the uncertainty of the footprints is part of the share, in proportion, beside that of the geometry; of cameras of which
    /// no footprint is known it is that of any lens in focus.
    #[test]
    fn the_footprints_of_the_cameras_take_part() {
        let demo = read_rig(&Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/demo-rig.toml")).unwrap();
        let left = demo.rig.camera("cam1").unwrap();
        // The ball as the left camera sees it, where it is seen at less than 50°.
        let mut points = Vec::new();
        for pixel in 0..left.width_px * left.height_px {
            let at =
                nalgebra::Point2::new(f64::from(pixel % left.width_px), f64::from(pixel / left.width_px));
            let Some(ray) = left.ray(at) else { continue };
            let half = ray.origin_mm.coords.dot(&ray.direction);
            let root = half * half - ray.origin_mm.coords.norm_squared() + 100.0;
            let place = ray.origin_mm + ray.direction * (-half - root.max(0.0).sqrt());
            if root > 0.0 && place.coords.dot(&ray.direction) < -6.4 {
                points.push(ball_point((place.coords / 10.0).into()));
            }
        }
        let share = |u_px: f64, cameras_off: &FootprintsOff| {
            let footprint = Footprint { sigma_px: [0.5; 2], u_px: Some([u_px; 2]), field_px2: 0.0 };
            let sensor = Sensor { footprint: Some(footprint), ..Sensor::default() };
            let sensors = demo.rig.cameras.iter().map(|camera| (camera.name.clone(), sensor)).collect();
            share_of_a_ball(1e-6, (&sensors, cameras_off), &points).unwrap()
        };
        let none = FootprintsOff::new();
        let alone = share(0.0, &none);
        let [small, large] = [0.01, 0.03].map(|u_px| (share(u_px, &none).powi(2) - alone * alone).sqrt());
        assert!(small > 1e-5 && (large / small / 3.0 - 1.0).abs() < 0.01, "{small} mm, {large} mm");
        let unknown = share_of_a_ball(1e-6, (&BTreeMap::new(), &none), &points).unwrap();
        // Variances of 0.12 px² and of 2 · 0.5 · 0.01 px².
        assert!((unknown / small / 12.0 - 1.0).abs() < 0.02, "{unknown} mm, {small} mm");
        // What the frames of one camera contradict counts beside it.
        let off = FootprintsOff::from([("cam1".to_owned(), -0.3)]);
        let less = FootprintsOff::from([("cam1".to_owned(), 0.1)]);
        let [off, less] =
            [off, less].map(|cameras_off| (share(0.0, &cameras_off).powi(2) - alone * alone).sqrt());
        assert!(less > small && (off / less / 3.0 - 1.0).abs() < 0.01, "{off} mm, {less} mm");
    }
}
