//! `--check-length`: a certified length between two points of the target, as each pair measures it in each pose.
//!
//! The scale of a rig comes from `pitch_mm` alone, and the adjustment cannot detect when it is wrong. A length
//! that was measured independently can. Held-out poses are measured by the rig that was calibrated without them.

use super::validation::Validation;
use anyhow::{Context, Result, bail};
use characterise::calibration::{Calibration, MeasuredLength, Observations, ViewReport};
use fringe::geometry::rig::Pair;
use report::calibration::{CheckedLength, LengthCheck};
use serde_json::{Value, json};

/// A length as declared.
pub struct Certified {
    text: String,
    points: [usize; 2],
    length_mm: f64,
    u_mm: f64,
}

impl Certified {
    /// Parses the argument `column,row:column,row=LENGTH_MM[,U_MM]`.
    pub fn parse(argument: &str, (columns, rows): (u32, u32)) -> Result<Self> {
        let form = || {
            format!("--check-length {argument}: write column,row:column,row=length_mm or …=length_mm,u_mm")
        };
        let (ends, length) = argument.split_once('=').with_context(form)?;
        let (from, to) = ends.split_once(':').with_context(form)?;
        let point = |text: &str| -> Result<usize> {
            let (column, row) = text.split_once(',').with_context(form)?;
            let [column, row]: [u32; 2] =
                [column.trim().parse().with_context(form)?, row.trim().parse().with_context(form)?];
            if column >= columns || row >= rows {
                bail!(
                    "--check-length {argument}: point {column},{row} does not exist; columns run from 0 to {}, rows from 0 to {}",
                    columns - 1,
                    rows - 1
                );
            }
            Ok(row as usize * columns as usize + column as usize)
        };
        let points = [point(from)?, point(to)?];
        let numbers: Vec<f64> = length
            .split(',')
            .map(|n| n.trim().parse::<f64>())
            .collect::<Result<_, _>>()
            .with_context(form)?;
        let (length_mm, u_mm) = match numbers.as_slice() {
            [length] => (*length, 0.0),
            [length, u] => (*length, *u),
            _ => bail!(form()),
        };
        if points[0] == points[1]
            || !(length_mm > 0.0 && length_mm < 1e6)
            || !(0.0..length_mm).contains(&u_mm)
        {
            bail!("{}; two points, a positive length, 0 ≤ u < length", form());
        }
        Ok(Self { text: ends.to_owned(), points, length_mm, u_mm })
    }

    /// Measures it by all pairs in all poses.
    pub fn check(
        &self,
        calibration: &Calibration,
        validation: &Validation,
        observations: &Observations,
        pairs: &[(Pair, [usize; 2])],
    ) -> Result<LengthCheck> {
        self.refuse_ambiguous(observations)?;
        if pairs.is_empty() {
            bail!("--check-length {}: no pair measures it; define one with --pair", self.text);
        }
        let own = [(calibration, calibration.views.as_slice())];
        let sources: Vec<(&Calibration, &[ViewReport])> = match &validation.held {
            Ok(held) => held.folds.iter().map(|f| (&f.calibration, f.views.as_slice())).collect(),
            Err(_) => own.to_vec(),
        };
        let mut rows = Vec::new();
        for (pair, devices) in pairs {
            for (rig, views) in &sources {
                for (pose, found) in self.measure(rig, views, *devices) {
                    rows.push(CheckedLength {
                        pose: observations.poses[pose].clone(),
                        pair: pair.name.clone(),
                        measured_mm: found.length_mm,
                        u_mm: found.u_mm,
                    });
                }
            }
        }
        if rows.is_empty() {
            bail!("--check-length {}: no pair sees both points in any pose", self.text);
        }
        Ok(LengthCheck {
            name: self.text.clone(),
            certified_mm: self.length_mm,
            u_certified_mm: self.u_mm,
            held_out: validation.held.is_ok(),
            rows,
        })
    }

    fn measure(
        &self,
        rig: &Calibration,
        views: &[ViewReport],
        pair: [usize; 2],
    ) -> Vec<(usize, MeasuredLength)> {
        let mut found = Vec::new();
        for left in views.iter().filter(|v| v.device == pair[0]) {
            let Some(right) = views.iter().find(|v| v.device == pair[1] && v.pose == left.pose) else {
                continue;
            };
            if let Some(length) = rig.measured_length(pair, [left, right], self.points) {
                found.push((left.pose, length));
            }
        }
        found
    }

    /// On a target without marks, which looks the same after half a turn, only opposite points are identified with certainty.
    fn refuse_ambiguous(&self, observations: &Observations) -> Result<()> {
        let last = observations.target_mm.len() - 1;
        if observations.views.iter().any(|v| v.may_be_turned) && self.points[0] + self.points[1] != last {
            bail!(
                "--check-length {}: the target looks the same after half a turn, so this length may be read as another one; \
                 choose two opposite points, such as two far corners",
                self.text
            );
        }
        Ok(())
    }
}

/// Prints the comparison of each pair.
pub fn print(check: &LengthCheck) {
    let s = check.summary();
    println!(
        "length {}: certified {:.4} mm, measured in {} poses: mean deviation {:+.4} mm (U {:.4} mm, k = 2), scatter {:.4} mm, \
         largest {:+.4} mm, predicted u of one {:.4} mm",
        check.name, check.certified_mm, s.count, s.mean_mm, s.expanded_mm, s.sd_mm, s.largest_mm, s.u_mm
    );
    println!("length {}: {}", check.name, check.verdict());
}

/// The comparison as JSON.
pub fn json(check: &LengthCheck) -> Value {
    let s = check.summary();
    json!({
        "points": check.name,
        "certified_mm": check.certified_mm,
        "u_certified_mm": check.u_certified_mm,
        "held_out": check.held_out,
        "mean_deviation_mm": s.mean_mm,
        "u_mean_deviation_mm": s.expanded_mm / 2.0,
        "sd_mm": s.sd_mm,
        "largest_deviation_mm": s.largest_mm,
        "predicted_u_mm": s.u_mm,
        "scale_corrected": false,
        "lengths": check.rows.iter().map(|r| json!({
            "pose": r.pose, "pair": r.pair, "measured_mm": r.measured_mm,
            "deviation_mm": r.measured_mm - check.certified_mm, "u_mm": r.u_mm,
        })).collect::<Vec<_>>(),
    })
}
