//! Footprints of the rig file that the frames of a recording contradict, as a comment of its cloud: `reconstruct` writes it, and `measure
//! --rig` takes the difference into the uncertainty of each feature.

use crate::pipeline::DecodedView;
use anyhow::{Context, Result, bail};
use files::ply::Cloud;
use std::collections::BTreeMap;
use std::path::Path;

/// Name of the comment; its value is a JSON object.
pub const KEY: &str = "footprint_off_px2";

/// By camera, by how much the variance of the footprint that the frames show differs from that of the rig file, px².
pub type Contradicted = BTreeMap<String, f64>;

/// What the frames of a recording contradict: of each camera the largest difference.
pub fn found(views: &[DecodedView]) -> Contradicted {
    let mut all = Contradicted::new();
    for view in views {
        let tests = view.maps.iter().filter_map(|decoded| decoded.report.sensor.footprint);
        for test in tests.filter(|test| test.contradicts) {
            let off_px2 = test.seen_px * test.seen_px - test.known_px * test.known_px;
            let largest = all.entry(view.camera.clone()).or_insert(0.0);
            if off_px2.abs() > largest.abs() {
                *largest = off_px2;
            }
        }
    }
    all
}

/// What the comment of a cloud says; nothing where there is none.
///
/// # Errors
/// A comment that is no object of numbers.
pub fn of_cloud(cloud: &Cloud, path: &Path) -> Result<Contradicted> {
    let Some(text) = cloud.comment(KEY) else { return Ok(Contradicted::new()) };
    let place = || {
        format!(
            "{}: comment {KEY}: \"{text}\" names no cameras with px²: reconstruct the cloud again",
            path.display()
        )
    };
    let read: Contradicted = serde_json::from_str(text).with_context(place)?;
    if read.values().any(|off_px2| !off_px2.is_finite()) {
        bail!(place());
    }
    Ok(read)
}

/// Says what a result without `--rig` does not hold.
pub fn warn(contradicted: &Contradicted, path: &Path) {
    if !contradicted.is_empty() {
        let names: Vec<&str> = contradicted.keys().map(String::as_str).collect();
        eprintln!(
            "warning: {}: its frames show another footprint of {} than its rig file, which the uncertainties do not hold: look at focus \
             and dirt, or take it in with --rig",
            path.display(),
            names.join(", ")
        );
    }
}
