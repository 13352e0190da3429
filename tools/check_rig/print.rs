//! Prints the result of the check.

use super::PairCheck;
use characterise::health::Cause;
use fringe::geometry::rig::Rig;

/// A line on the residuals of each pair, a line on the verdict, and what explains an unhealthy one.
pub fn print(checks: &[PairCheck], rig: &Rig, with_covariance: bool) {
    for check in checks {
        let h = &check.health;
        println!(
            "{} ({}, {}): {} places, {} rejected; epipolar residual mean {:+.4} px, rms {:.4} px (noise {:.4} px, after the \
             fit {:.4} px)",
            check.name,
            check.left,
            check.right,
            h.used,
            h.rejected,
            h.mean_px,
            h.rms_px,
            h.predicted_px,
            h.rms_after_px
        );
        let verdict = if h.healthy { "healthy" } else { "NOT HEALTHY" };
        let d = &h.drift;
        println!(
            "  {verdict}: drift {:.4} px rms, limit {:.4} px; test {:.1}, limit {:.1} with {} degrees of freedom",
            d.rms_px, d.limit_px, d.statistic, d.limit, d.degrees_of_freedom
        );
        if h.pattern_px > h.pattern_limit_px {
            println!(
                "  not explained by drift: {:.4} px rms, limit {:.4} px: a lens changed, or the phase is worse than \
                 --phase-error-px states (few steps, gamma, a dark or shiny object)",
                h.pattern_px, h.pattern_limit_px
            );
        }
        if d.statistic > d.limit {
            for cause in &d.causes {
                println!("  {}", line(cause, &check.right));
            }
        }
    }
    let suspects = suspects(checks.iter());
    if !suspects.is_empty() {
        println!("in every unhealthy pair: {}", suspects.join(", "));
        if let Some(alike) = moved_alike(rig, suspects.iter().map(String::as_str)) {
            println!("{alike}");
        }
    }
    if !with_covariance {
        println!("the rig file has no covariance: the limit includes noise and phase error only");
    }
}

fn line(cause: &Cause, view: &str) -> String {
    let (value, u, unit) = match cause.unit {
        "rad" => (cause.value.to_degrees(), cause.u.to_degrees(), "°"),
        "mm" => (cause.value, cause.u, " mm"),
        _ => (cause.value * 100.0, cause.u * 100.0, " %"),
    };
    format!(
        "{view}, {} alone: {value:+.5}{unit} (u {u:.5}), explains {:.0} %",
        cause.name,
        cause.explains * 100.0
    )
}

/// What looks like a drift of a projector among the views in a single recording, in words.
pub fn moved_alike<'a>(rig: &Rig, views: impl IntoIterator<Item = &'a str>) -> Option<String> {
    let projector = views.into_iter().find(|view| rig.projector(view).is_some())?;
    Some(format!(
        "a part or a camera that moved between the two directions of the fringes of \"{projector}\" looks the same: record once more, and see whether \
         the same comes out"
    ))
}

/// Views that all unhealthy pairs have in common while no healthy pair has them; empty where nothing is unhealthy.
pub fn suspects<'a>(checks: impl Iterator<Item = &'a PairCheck>) -> Vec<String> {
    let checks: Vec<&PairCheck> = checks.collect();
    let unhealthy = || checks.iter().filter(|check| !check.health.healthy);
    let Some(first) = unhealthy().next() else { return Vec::new() };
    let has = |check: &PairCheck, view: &str| check.left == view || check.right == view;
    [&first.left, &first.right]
        .into_iter()
        .filter(|view| unhealthy().all(|check| has(check, view)))
        .filter(|view| !checks.iter().any(|check| check.health.healthy && has(check, view)))
        .cloned()
        .collect()
}
