//! The corrected rig file with its covariance and history, and what is printed of it.

use super::shown::Shown;
use super::{Args, Found, Judge, PairAfter, PlacesOf};
use anyhow::{Context, Result};
use characterise::calibration::PARAMETERS;
use characterise::health::ViewCorrection;
use files::rig_file::{CovarianceRef, covariance_beside};
use serde_json::{Value, json};

/// Writes the covariance, then the rig file that names it.
pub fn write(args: &Args, shown: &[Shown], judge: &Judge, whole: &Found) -> Result<()> {
    let Found { view: found, baseline, u_scale, .. } = whole;
    let warnings = warnings(whole);
    let rig = judge.rig_with(&found.camera);
    let reference = covariance(args, judge, found)?;
    let mut provenance = judge.rig_file.provenance.clone();
    let mut entry = toml::Table::new();
    entry.insert("date".into(), files::clock::rfc3339_now().into());
    entry.insert("software".into(), format!("fringetool {}", env!("CARGO_PKG_VERSION")).into());
    entry.insert("from_rig_sha256".into(), judge.rig_file.sha256.clone().into());
    let recordings: Vec<&str> = shown.iter().map(|shown| shown.recording.sha256.as_str()).collect();
    entry.insert("recording_sha256".into(), recordings.first().copied().unwrap_or_default().into());
    if recordings.len() > 1 {
        entry.insert("recordings_sha256".into(), recordings.into());
    }
    entry.insert("view".into(), judge.view.to_owned().into());
    let numbers = |values: &[f64]| toml::Value::Array(values.iter().map(|value| (*value).into()).collect());
    let degrees: Vec<f64> = found.drift[..3].iter().map(|rad| rad.to_degrees()).collect();
    entry.insert("rotation_deg".into(), numbers(&degrees));
    entry.insert("shift_mm".into(), numbers(&found.drift[3..6]));
    entry.insert("focal_part".into(), found.drift[6].into());
    entry.insert("model".into(), found.name().into());
    if let Some(baseline) = baseline {
        entry.insert("baseline_factor".into(), baseline.factor.into());
    }
    let plans: Vec<String> = shown
        .iter()
        .filter_map(|shown| Some(files::hash::sha256_hex(shown.plan_text.as_ref()?.text.as_bytes())))
        .collect();
    if !plans.is_empty() {
        entry.insert("length_plans_sha256".into(), plans.into());
        entry.insert("u_scale".into(), u_scale.unwrap_or_default().into());
    }
    let mut history = match provenance.remove("corrections") {
        Some(toml::Value::Array(history)) => history,
        _ => Vec::new(),
    };
    if !warnings.is_empty() {
        entry.insert("warnings".into(), warnings.into());
    }
    history.push(toml::Value::Table(entry));
    provenance.insert("corrections".into(), toml::Value::Array(history));
    files::rig_file::write_rig(&args.out, &rig, &provenance, reference.as_ref())?;
    Ok(())
}

/// The covariance of the old rig with that of the correction added to the view's own part; none where the old rig has none.
fn covariance(args: &Args, judge: &Judge, found: &ViewCorrection) -> Result<Option<CovarianceRef>> {
    let Some(known) = judge.covariance else { return Ok(None) };
    let bytes = files::document::read_bytes(&known.path, 1 << 30)?;
    let mut value: Value = serde_json::from_slice(&bytes)?;
    let count = known.parameters.len();
    if let Some(place) = known.devices.iter().position(|device| device == judge.view)
        && known.parameters[..] == PARAMETERS[..count.min(PARAMETERS.len())]
    {
        for (k, added) in found.parameter_covariance(count).into_iter().enumerate() {
            let entry = &mut value["matrix"][place * count + k / count][place * count + k % count];
            *entry = json!(entry.as_f64().unwrap_or(0.0) + added);
        }
    }
    let path = covariance_beside(&args.out);
    let file = path.file_name().unwrap_or_default().to_owned();
    files::result::write_json(&path, &value).with_context(|| path.display().to_string())?;
    let sha256 = files::hash::sha256_hex(&files::document::read_bytes(&path, 1 << 30)?);
    Ok(Some(CovarianceRef { file: file.to_string_lossy().into_owned(), sha256 }))
}

/// What was corrected, and what is left of the residuals of each pair.
pub fn report(view: &str, whole: &Found, shown: &[Shown], after: &[PairAfter]) -> Vec<String> {
    let Found { view: found, models, baseline, u_scale, lengths, places, .. } = whole;
    let (d, u) = (found.drift, found.u());
    let axes = ["x", "y", "z"];
    let turn = |i: usize| format!("{} {:+.5}° (u {:.5})", axes[i], d[i].to_degrees(), u[i].to_degrees());
    let shift = |i: usize| format!("{} {:+.4} mm (u {:.4})", axes[i], d[3 + i], u[3 + i]);
    let list = |part: &dyn Fn(usize) -> String| (0..3).map(part).collect::<Vec<_>>().join(", ");
    let focal = format!("{view}: focal length {:+.4} % (u {:.4} %)", 100.0 * d[6], 100.0 * u[6]);
    let parts = [
        format!("{view} was turned about {}", list(&turn)),
        format!("{view} was shifted along {}", list(&shift)),
        focal,
    ];
    let mut lines: Vec<String> =
        parts.into_iter().zip(found.changes).filter(|(_, changes)| *changes).map(|(line, _)| line).collect();
    let tried = models.iter().map(|model| {
        let verdict = if model.is_possible() { "" } else { ", contradicted" };
        format!("{} χ² {:.1} of {:.1}{verdict}", model.name(), model.chi2, model.limit)
    });
    lines.push(format!("models: {}", tried.collect::<Vec<_>>().join("; ")));
    lines.push(format!(
        "lengths of 100 mm: u {:.2} µm in the objects of the recordings, up to {:.1} µm elsewhere in the volume, by the correction",
        found.u_length * 1e5,
        found.u_volume * 1e5
    ));
    if let (Some(baseline), Some(u_scale)) = (baseline, u_scale) {
        lines.push(format!(
            "baseline: factor {:.6} (u {:.6}, by all that was seen); the certified lengths confirm it to {u_scale:.6} (standard uncertainty)",
            baseline.factor, baseline.u
        ));
    }
    for (shown, lengths) in shown.iter().zip(lengths).filter(|(shown, _)| shown.plan.is_some()) {
        let count = if *lengths == 1 {
            "1 certified length".to_owned()
        } else {
            format!("{lengths} certified lengths")
        };
        lines.push(format!("{}: {count} measured", shown.recording.folder.display()));
    }
    lines.extend(places.iter().filter(|places| places.three.agrees()).map(|places| {
        let PlacesOf { partner, second, three } = places;
        format!("{} places that {partner} and {second} measure together entered", three.used)
    }));
    lines.extend(warnings(whole).iter().map(|warning| format!("warning: {warning}")));
    let several = shown.len() > 1;
    for (number, shown) in shown.iter().enumerate() {
        let place = if several { format!("{}: ", shown.recording.folder.display()) } else { String::new() };
        lines.extend(of_pairs(&place, after.iter().filter(|pair| pair.recording == number)));
    }
    lines
}

/// What the pairs of one recording show before and after: one line for each pair of the rig file, and one for all further cameras.
fn of_pairs<'a>(place: &str, after: impl Iterator<Item = &'a PairAfter>) -> Vec<String> {
    let (further, own): (Vec<&PairAfter>, Vec<&PairAfter>) = after.partition(|pair| pair.further);
    let line = |pair: &&PairAfter| {
        format!(
            "{place}{}: drift {:.4} px rms before, {:.4} px after",
            pair.name, pair.before_px, pair.rms_px
        )
    };
    let mut lines: Vec<String> = own.iter().map(line).collect();
    let worst = |of: fn(&PairAfter) -> f64| further.iter().map(|pair| of(pair)).fold(0.0, f64::max);
    match further.as_slice() {
        [] => {}
        [only] => lines.push(line(only)),
        several => lines.push(format!(
            "{place}{} pairs with further cameras: drift up to {:.4} px rms before, up to {:.4} px after",
            several.len(),
            worst(|pair| pair.before_px),
            worst(|pair| pair.rms_px)
        )),
    }
    lines
}

/// What makes the corrected rig doubtful, in words.
fn warnings(found: &Found) -> Vec<String> {
    let mut all = found.exact.clone();
    all.extend(found.alike.clone());
    all.extend(found.places.iter().filter(|places| !places.three.agrees()).map(left_out));
    all.extend(found.doubted.iter().map(|simple| {
        format!(
            "without the length standard {} alone explains the residuals (χ² {:.1} of {:.1}); check the certified lengths before the new \
             rig is used",
            simple.name(),
            simple.chi2,
            simple.limit
        )
    }));
    all
}

/// Why places that two fixed views measure together did not count.
fn left_out(places: &PlacesOf) -> String {
    let PlacesOf { partner, second, three } = places;
    let by = if three.lengths_agree {
        format!("the pairs contradict them (χ² {:.1} of {:.1})", three.chi2, three.limit)
    } else {
        "the certified lengths contradict them".to_owned()
    };
    format!(
        "the places that {partner} and {second} measure together were left out: {by}; one of both may have moved"
    )
}

/// Keys that other programs rely on.
pub fn json(args: &Args, found: Option<(&str, &Found)>, after: &[PairAfter]) -> Value {
    json!({
        "recording": args.recordings.first(),
        "recordings": args.recordings,
        "rig": args.rig,
        "corrected": found.is_some(),
        "out": found.map(|_| &args.out),
        "view": found.map(|(view, _)| view),
        "model": found.map(|(_, found)| found.view.name()),
        "models": found.map(|(_, found)| found.models.iter().map(|model| json!({
            "name": model.name(), "chi2": model.chi2, "limit": model.limit, "possible": model.is_possible(),
        })).collect::<Vec<_>>()),
        "u_length": found.map(|(_, found)| found.view.u_length),
        "u_volume": found.map(|(_, found)| found.view.u_volume),
        "drift": found.map(|(_, found)| found.view.drift),
        "u_drift": found.map(|(_, found)| found.view.u()),
        "lengths": found.map(|(_, found)| &found.lengths),
        "places": found.map(|(_, found)| found.places.iter().map(|places| json!({
            "partner": places.partner, "projector": places.second, "used": places.three.used,
            "chi2": places.three.chi2, "limit": places.three.limit, "lengths_agree": places.three.lengths_agree,
            "entered": places.three.agrees(),
        })).collect::<Vec<_>>()),
        "warnings": found.map(|(_, found)| warnings(found)),
        "u_scale": found.and_then(|(_, found)| found.u_scale),
        "baseline": found.and_then(|(_, found)| found.baseline),
        "pairs": after.iter().map(|pair| json!({
            "name": pair.name, "recording": args.recordings[pair.recording],
            "healthy": pair.healthy, "rms_px": pair.rms_px,
        })).collect::<Vec<_>>(),
    })
}
