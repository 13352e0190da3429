//! Output of a run on the terminal: a line per cycle, then tables.

use files::result::CycleResult;
use metrology::inspection::FeatureResult;
use metrology::verdict::Verdict;
use std::fmt::Write as _;
use twin::Truth;

/// Prints a line of the result. Returns whether it was written: the reader may have closed it (`| head`).
pub fn print_line(text: &str) -> bool {
    cli::text(format_args!("{text}\n"))
}

/// Prints a note to standard error, if that is possible.
pub fn print_note(text: &str) {
    cli::note(format_args!("{text}\n"));
}

/// The line of a cycle.
pub fn cycle_line(result: &CycleResult, requested: Option<u64>) -> String {
    let of = requested.map_or_else(String::new, |n| format!("/{n}"));
    let mut line = format!("cycle {:>3}{of}  ", result.number);
    if !result.is_ok() {
        let _ = write!(line, "NOT OK  {}", result.outcome);
        return line;
    }
    let points = result.points.unwrap_or(0);
    let latency_ms = result.latency_ns.unwrap_or(0) as f64 / 1e6;
    let _ = write!(
        line,
        "ok  {:<13}  {points:>8} points  {latency_ms:>7.1} ms from last frame to verdict",
        verdict_name(result.verdict)
    );
    if let Some(reason) = &result.alignment_failure {
        let _ = write!(line, "  ({reason})");
    }
    if result.moved == Some(true) {
        line.push_str("  (moved during the cycle: see warnings in the result)");
    }
    line
}

/// The name of a verdict.
pub fn verdict_name(verdict: Option<Verdict>) -> &'static str {
    verdict.map_or("no verdict", Verdict::word)
}

/// Median and 99th percentile of each stage and of the latency, over the cycles that are ok.
pub fn stage_table(results: &[CycleResult]) -> String {
    let ok: Vec<&CycleResult> = results.iter().filter(|r| r.is_ok()).collect();
    let Some(first) = ok.first() else { return String::new() };
    let mut text = format!(
        "{:<20} {:>12} {:>12} {:>12}   (ms per cycle, {} cycles)\n",
        "stage",
        "median",
        "99 %",
        "waiting",
        ok.len()
    );
    for (number, stage) in first.stages.iter().enumerate() {
        let times = |pick: fn(&files::result::StageResult) -> u64| -> Vec<u64> {
            ok.iter().filter_map(|r| r.stages.get(number)).map(pick).collect()
        };
        let (compute, wait) = (times(|s| s.compute_ns), times(|s| s.wait_ns));
        let _ = writeln!(
            text,
            "{:<20} {:>12.2} {:>12.2} {:>12.2}",
            stage.name,
            ms(quantile(&compute, 50)),
            ms(quantile(&compute, 99)),
            ms(quantile(&wait, 50))
        );
    }
    let latencies: Vec<u64> = ok.iter().filter_map(|r| r.latency_ns).collect();
    let _ = writeln!(
        text,
        "{:<20} {:>12.2} {:>12.2}",
        "last frame → verdict",
        ms(quantile(&latencies, 50)),
        ms(quantile(&latencies, 99))
    );
    text
}

/// Number of points of a cycle and differences in the overlaps of pairs.
pub fn cloud_lines(result: &CycleResult, pairs: &[&str]) -> String {
    let points = result.points.unwrap_or(0);
    let mut text = format!("points {points}\n");
    let name = |pair: usize| pairs.get(pair).copied().unwrap_or("?");
    for overlap in result.overlaps.iter().flatten() {
        let _ = writeln!(text, "overlap {} – {}: {overlap}", name(overlap.a), name(overlap.b));
    }
    text
}

/// The features of a cycle; with the truth of a simulation, their errors.
pub fn feature_table(features: &[FeatureResult], truth: Option<&Truth>) -> String {
    let mut text = format!("{:<28} {:>12} {:>9} {:>5}", "feature", "value", "u", "unit");
    if truth.is_some() {
        let _ = write!(text, " {:>12} {:>10}", "truth", "error");
    }
    text.push_str("  verdict\n");
    for feature in features {
        let _ = write!(text, "{:<28} ", feature.name);
        match feature.value {
            Some(value) => {
                let u = feature.u.unwrap_or(f64::NAN);
                let _ = write!(text, "{value:>12.4} {u:>9.4} {:>5}", feature.unit);
                if let Some(truth) = truth {
                    let known = truth.get(&feature.name).filter(|t| t.unit == feature.unit.to_string());
                    let _ = match known {
                        Some(t) => write!(text, " {:>12.4} {:>+10.4}", t.value, value - t.value),
                        None => write!(text, " {:>12} {:>10}", "–", "–"),
                    };
                }
                let _ = writeln!(text, "  {}", verdict_name(feature.verdict));
            }
            None => {
                let _ = writeln!(
                    text,
                    "not measured: {}",
                    feature.reason.as_deref().unwrap_or("no reason given")
                );
            }
        }
    }
    text
}

/// Percentile by nearest rank.
fn quantile(values: &[u64], percent: usize) -> u64 {
    let mut sorted = values.to_vec();
    sorted.sort_unstable();
    let rank = (sorted.len() * percent).div_ceil(100).max(1);
    sorted.get(rank - 1).copied().unwrap_or(0)
}

fn ms(ns: u64) -> f64 {
    ns as f64 / 1e6
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_values_of_the_sample() {
        let values: Vec<u64> = (1..=200).rev().collect();
        assert_eq!((quantile(&values, 50), quantile(&values, 99)), (100, 198));
        assert_eq!((quantile(&[7], 50), quantile(&[7], 99)), (7, 7));
        assert_eq!(quantile(&[], 50), 0);
    }
}
