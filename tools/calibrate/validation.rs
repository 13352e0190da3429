//! What says whether the rig may be trusted beyond the points it was adjusted to: held-out poses, two halves.

use anyhow::{Context, Result, bail};
use fringe::calibration::{
    Calibration, CalibrationSettings, CrossValidation, HeldOut, Observations, calibrate, cross_validate,
    hold_out, in_turn,
};
use serde_json::{Value, json};

/// Poses are held out in this many groups by default: four fifths of them determine a rig nearly as well as all.
const TURNS: usize = 5;

/// What `--hold-out` asks for.
pub enum Plan {
    /// So many groups, each held out in turn from a calibration of its own; the rig knows all poses. With whether this was
    /// asked for.
    InTurn(usize, bool),
    /// These poses; the rig does not know them.
    Named(Vec<usize>),
}

/// What was found.
pub struct Validation {
    /// Held-out poses, or why there are none.
    pub held: Result<HeldOut, String>,
    /// How they were chosen.
    pub how: String,
    /// Two halves against each other, or why not.
    pub cross: Result<CrossValidation, String>,
}

impl Plan {
    /// From the arguments: a number of groups, or names of poses.
    pub fn new(asked: &[String], observations: &Observations) -> Result<Self> {
        match asked {
            [] => return Ok(Self::InTurn(TURNS, false)),
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
                [] => bail!("--hold-out {name}: no such pose; there are: {}", observations.poses.join(", ")),
                _ => bail!("--hold-out {name}: fits {} poses; write more of the path", found.len()),
            }
        }
        poses.sort_unstable();
        poses.dedup();
        Ok(Self::Named(poses))
    }

    /// Calibrates and judges.
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
        Ok((calibration, Validation { held, how, cross }))
    }
}

/// Lines for people.
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
    let device = |d: &fringe::calibration::HeldOutDevice| {
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
    })
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
