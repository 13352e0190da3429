//! Validation of the rig beyond the points it was adjusted to: held-out poses, two halves.

use anyhow::{Context, Result, bail};
use characterise::calibration::{
    BetweenPoses, COMMON_PARAMETERS, Calibration, CalibrationSettings, CrossValidation, HeldOut,
    Observations, calibrate, cross_validate, hold_out, in_turn,
};
use serde_json::{Value, json};

/// Poses are held out in this many groups by default: four fifths of them determine a rig nearly as well as all.
const TURNS: usize = 5;

/// Which poses `--hold-out` selects.
pub enum Plan {
    /// So many groups, each held out in turn from a separate calibration; the rig uses all poses. The flag is set where the
    /// number was given.
    InTurn(usize, bool),
    /// These poses; the rig is calibrated without them.
    Named(Vec<usize>),
}

/// Results of the validation.
pub struct Validation {
    /// Held-out poses, or why there are none.
    pub held: Result<HeldOut, String>,
    /// How far the rig differs from one group of poses to another, where three groups or more were requested.
    pub between: Option<Vec<BetweenPoses>>,
    /// How they were chosen.
    pub how: String,
    /// Two halves against each other, or why not.
    pub cross: Result<CrossValidation, String>,
}

impl Plan {
    /// From the arguments: a number of groups, or names of poses.
    pub fn new(asked: &[String], observations: &Observations) -> Result<Self> {
        match asked {
            [] => {
                let seen = in_turn(observations, 1).concat().len();
                return Ok(Self::InTurn(TURNS.min(seen), false));
            }
            [one] if one.bytes().all(|b| b.is_ascii_digit()) && !one.is_empty() => {
                let seen = in_turn(observations, 1).concat().len();
                let turns: usize = one.parse().unwrap_or(usize::MAX);
                if turns == 1 || turns > seen {
                    bail!(
                        "--hold-out {one}: write 0 for none, or 2 to {seen} groups of the {seen} poses seen"
                    );
                }
                return Ok(Self::InTurn(turns, true));
            }
            _ => {}
        }
        let mut poses = Vec::new();
        for name in asked {
            let fits = |pose: &String| pose == name || pose.ends_with(&format!("/{name}"));
            let found: Vec<usize> =
                (0..observations.poses.len()).filter(|p| fits(&observations.poses[*p])).collect();
            match found.as_slice() {
                [pose] => poses.push(*pose),
                [] => bail!("--hold-out {name}: no such pose; known: {}", observations.poses.join(", ")),
                _ => bail!("--hold-out {name}: matches {} poses; give more of the path", found.len()),
            }
        }
        poses.sort_unstable();
        poses.dedup();
        Ok(Self::Named(poses))
    }

    /// Calibrates the rig and validates it.
    pub fn solve(
        &self,
        observations: &Observations,
        settings: &CalibrationSettings,
    ) -> Result<(Calibration, Validation)> {
        let (calibration, held, how, known) = match self {
            Self::InTurn(turns, asked) => {
                let calibration = calibrate(observations, settings)?;
                let held = match turns {
                    0 => Err("switched off".to_owned()),
                    _ => hold_out(observations, settings, &in_turn(observations, *turns))
                        .map_err(|e| e.to_string()),
                };
                if let (Err(why), true, true) = (&held, *asked, *turns > 0) {
                    bail!("--hold-out {turns}: without a group of poses, {why}");
                }
                (calibration, held, format!("in turn, {turns} groups"), observations.clone())
            }
            Self::Named(poses) => {
                let held = hold_out(observations, settings, std::slice::from_ref(poses))
                    .context("without the poses of --hold-out")?;
                let mut known = observations.clone();
                known.views.retain(|v| !poses.contains(&v.pose));
                let calibration = held.folds[0].calibration.clone();
                (calibration, Ok(held), format!("{} named poses", poses.len()), known)
            }
        };
        let cross = cross_validate(&known, settings).map_err(|e| e.to_string());
        let between = held.as_ref().ok().and_then(|held| held.between_poses(&calibration));
        Ok((calibration, Validation { held, between, how, cross }))
    }
}

/// Beyond this the poses disagree: of independent errors the ratio of five groups exceeds it once in ten thousand times.
const DISAGREEMENT: f64 = 2.5;

/// Halves of the poses with a χ² that independent errors exceed less often than this disagree.
const HALVES: f64 = 1e-4;

/// What to do about poses that disagree.
pub fn notes(validation: &Validation) -> impl Iterator<Item = String> {
    let beyond = validation.between.iter().flatten().filter(|b| b.over_stated > DISAGREEMENT);
    let groups = beyond.map(|b| {
        format!(
            "{}: from one group of poses to another it differs by {:.1} times its stated uncertainties, limit {DISAGREEMENT}; use the uncertainty between poses, add poses, and check that the board is rigid and as declared",
            b.name, b.over_stated
        )
    });
    let contradict = |cross: &&CrossValidation| cross.probability() < HALVES || cross.chi_square.is_nan();
    let halves = validation.cross.iter().filter(contradict).map(|cross| {
        format!(
            "the two halves of the poses contradict each other: χ² {:.1} of {} parameters, which errors of the stated size reach once in {:.0} \
             calibrations; look for pictures of another camera, focus or zoom, for overexposed and for processed ones (worst view, points rejected)",
            cross.chi_square,
            cross.degrees_of_freedom,
            1.0 / cross.probability().max(1e-15)
        )
    });
    groups.chain(halves)
}

/// Prints the results of the validation.
pub fn print(validation: &Validation) {
    match &validation.held {
        Ok(held) => {
            for d in &held.devices {
                println!(
                    "held-out poses ({}): {} rms {:.4} px, predicted {:.4} px, {} points, {} rejected",
                    validation.how, d.name, d.rms_px, d.predicted_px, d.points, d.outliers
                );
            }
        }
        Err(why) => println!("held-out poses: none: {why}"),
    }
    for b in validation.between.iter().flatten() {
        let u = &b.standard_uncertainty;
        println!(
            "between groups of poses: {} f u ({:.3}, {:.3}), c u ({:.3}, {:.3}) px, {:.2} of the stated",
            b.name, u[0], u[1], u[2], u[3], b.over_stated
        );
    }
    match &validation.cross {
        Ok(cross) => {
            for d in &cross.devices {
                println!(
                    "two halves of the poses: {} projects {:.4} px apart, predicted {:.4} px",
                    d.name, d.rms_px, d.predicted_px
                );
            }
            println!(
                "two halves of the poses: χ² {:.1} of {} parameters",
                cross.chi_square, cross.degrees_of_freedom
            );
        }
        Err(why) => println!("two halves of the poses: not compared: {why}"),
    }
}

/// Held-out poses for programs.
pub fn held_json(validation: &Validation, observations: &Observations) -> Value {
    let held = match &validation.held {
        Ok(held) => held,
        Err(why) => return json!({ "absent": why }),
    };
    let device = |d: &characterise::calibration::HeldOutDevice| {
        json!({
            "name": d.name, "rms_reprojection_px": d.rms_px, "predicted_px": d.predicted_px,
            "corners": d.points, "rejected": d.outliers,
        })
    };
    let views = held.folds.iter().flat_map(|f| &f.views).map(|v| {
        json!({
            "device": observations.devices[v.device].name, "pose": observations.poses[v.pose],
            "rms_reprojection_px": v.rms_px,
        })
    });
    json!({
        "how": validation.how,
        "devices": held.devices.iter().map(device).collect::<Vec<_>>(),
        "views": views.collect::<Vec<_>>(),
        "between_poses": validation.between.as_ref().map(|all| all.iter().map(|b| json!({
            "name": b.name, "standard_uncertainty": adjusted(&b.standard_uncertainty), "over_stated": b.over_stated,
        })).collect::<Vec<_>>()),
    })
}

/// The parameters that every lens has, and the further ones where one of them was adjusted.
fn adjusted(u: &[f64]) -> &[f64] {
    if u[COMMON_PARAMETERS..].iter().any(|u| *u != 0.0) { u } else { &u[..COMMON_PARAMETERS] }
}

/// Two halves for programs.
pub fn cross_json(validation: &Validation) -> Value {
    match &validation.cross {
        Err(why) => json!({ "absent": why }),
        Ok(cross) => json!({
            "devices": cross.devices.iter().map(|d| json!({
                "name": d.name, "rms_px": d.rms_px, "predicted_px": d.predicted_px,
            })).collect::<Vec<_>>(),
            "chi_square": cross.chi_square,
            "degrees_of_freedom": cross.degrees_of_freedom,
        }),
    }
}
