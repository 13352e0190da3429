//! The trend file of the check.

use super::{Args, PairCheck};
use anyhow::{Result, bail};
use files::atomic;
use files::recording::Recording;
use files::rig_file::RigFile;
use files::trend::{Seal, TREND_FORMAT, TrendEntry, TrendPair, append_trend, verify_trend};
use report::trend_chart::chart_svg;

/// Checks of the history that are printed.
const SHOWN: usize = 8;

/// The date given by `--date`, that of the recording, or now.
pub fn date(args: &Args, recording: &Recording) -> Result<String> {
    let recorded = recording.provenance.get("date").map(|date| match date {
        toml::Value::String(text) => text.clone(),
        other => other.to_string(),
    });
    let Some(given) = args.date.clone().or(recorded) else { return Ok(files::clock::rfc3339_now()) };
    match given.parse::<toml::value::Datetime>() {
        Ok(date) if date.date.is_some() => Ok(given),
        _ => {
            bail!("--date {given}: is not a date; write RFC 3339, such as 2026-01-31T08:00:00Z or 2026-01-31")
        }
    }
}

fn seal(args: &Args) -> Result<Seal> {
    Ok(args.key.as_deref().map(Seal::read_key).transpose()?.unwrap_or(Seal::Chain))
}

/// Checks the trend file given by `--trend`.
pub fn verify(args: &Args) -> Result<()> {
    if let Some(path) = &args.trend {
        verify_trend(path, &seal(args)?)?;
    }
    Ok(())
}

/// Appends the check to the trend file given by `--trend` and prints its history.
pub fn append(
    args: &Args,
    date: String,
    recording: &Recording,
    rig_file: &RigFile,
    checks: &[PairCheck],
) -> Result<()> {
    let Some(path) = &args.trend else { return Ok(()) };
    let pairs: Vec<TrendPair> = checks.iter().map(pair).collect();
    let entry = TrendEntry {
        format: TREND_FORMAT.to_owned(),
        date,
        rig_sha256: rig_file.sha256.clone(),
        recording_sha256: recording.sha256.clone(),
        healthy: pairs.iter().all(|pair| pair.healthy),
        pairs,
    };
    let trend = append_trend(path, &seal(args)?, entry)?;
    println!(
        "{}: {} checks, the last ones (drift in units of its limit):",
        path.display(),
        trend.entries.len()
    );
    for entry in trend.entries.iter().skip(trend.entries.len().saturating_sub(SHOWN)) {
        let ratio = |pair: &TrendPair| format!("{} {:.2}", pair.name, (pair.statistic / pair.limit).sqrt());
        let pairs: Vec<String> = entry.pairs.iter().map(ratio).collect();
        let verdict = if entry.healthy { "healthy" } else { "NOT HEALTHY" };
        let rig = entry.rig_sha256.get(..8).unwrap_or(&entry.rig_sha256);
        println!("  {} rig {rig} {verdict}: {}", entry.date, pairs.join(", "));
    }
    println!("  last seal {}", trend.last_seal);
    if let Some(chart) = &args.picture {
        atomic::write(chart, chart_svg(&trend.entries).as_bytes())?;
    }
    Ok(())
}

fn pair(check: &PairCheck) -> TrendPair {
    let health = &check.health;
    TrendPair {
        name: check.name.clone(),
        used: health.used,
        mean_px: health.mean_px,
        rms_px: health.rms_px,
        drift_px: health.drift.rms_px,
        statistic: health.drift.statistic,
        limit: health.drift.limit,
        healthy: health.healthy,
    }
}
