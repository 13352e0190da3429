//! The history of a rig as a picture: how far each pair was from its limit.

use crate::Text;
use files::trend::TrendEntry;
use std::fmt::Write as _;

const WIDTH: f64 = 900.0;
const LEFT: f64 = 70.0;
const RIGHT: f64 = 730.0;
const TOP: f64 = 30.0;
const BASE: f64 = 270.0;

/// Decades of the ratio that are drawn: a hundredth of the limit to a hundred times.
const DECADES: f64 = 2.0;

/// Okabe and Ito's colours, distinguishable also with a colour vision deficiency.
const COLOURS: [&str; 7] = ["#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00", "#5b6875"];

/// √(statistic/limit) of each pair over the checks, on a logarithmic scale: 1 is the limit.
pub fn chart_svg(entries: &[TrendEntry]) -> String {
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} 330\" width=\"{WIDTH}\" height=\"330\" \
         font-family=\"sans-serif\" font-size=\"13\" fill=\"#1f2933\">\n<rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n\
         <text x=\"{LEFT}\" y=\"18\" font-weight=\"600\">Drift of each pair over its limit</text>\n"
    );
    for decade in -2..=2_i32 {
        let (at, limit) = (y(f64::from(decade)), decade == 0);
        let (colour, width) = if limit { ("#ad1f1f", 1.5) } else { ("#e3e8ed", 1.0) };
        let label = ["0.01", "0.1", "1 (limit)", "10", "100"][(decade + 2) as usize];
        let _ = writeln!(
            out,
            "<path d=\"M{LEFT} {at:.1}H{RIGHT}\" stroke=\"{colour}\" stroke-width=\"{width}\"/><text x=\"{:.0}\" \
             y=\"{:.1}\" text-anchor=\"end\">{label}</text>",
            LEFT - 6.0,
            at + 4.5
        );
    }
    if entries.is_empty() {
        let _ = writeln!(out, "<text x=\"{:.0}\" y=\"140\">no check yet</text>", LEFT + 20.0);
    }
    dates(&mut out, entries);
    for (index, name) in names(entries).into_iter().enumerate() {
        line(&mut out, entries, name, index);
    }
    out.push_str("</svg>\n");
    out
}

/// Names of all pairs, in the order of their first check.
fn names(entries: &[TrendEntry]) -> Vec<&str> {
    let mut names: Vec<&str> = Vec::new();
    for pair in entries.iter().flat_map(|entry| &entry.pairs) {
        if !names.contains(&pair.name.as_str()) {
            names.push(&pair.name);
        }
    }
    names
}

fn x(index: usize, count: usize) -> f64 {
    LEFT + 15.0 + (RIGHT - LEFT - 30.0) * (index as f64 / (count.max(2) - 1) as f64)
}

fn y(decade: f64) -> f64 {
    let share = (decade / DECADES).clamp(-1.0, 1.0);
    0.5 * (TOP + BASE) - 0.5 * (BASE - TOP) * share
}

/// The days of the first, the middle and the last check.
fn dates(out: &mut String, entries: &[TrendEntry]) {
    let count = entries.len();
    let mut shown = vec![0, count / 2, count.saturating_sub(1)];
    shown.dedup();
    for index in shown {
        let Some(entry) = entries.get(index) else { continue };
        let day: String = entry.date.chars().take(10).collect();
        let _ = writeln!(
            out,
            "<text x=\"{:.1}\" y=\"292\" text-anchor=\"middle\">{}</text>",
            x(index, count),
            Text(&day)
        );
    }
    let _ = writeln!(
        out,
        "<text x=\"{:.0}\" y=\"316\" text-anchor=\"middle\">{count} checks in the order of the file</text>",
        0.5 * (LEFT + RIGHT)
    );
}

fn line(out: &mut String, entries: &[TrendEntry], name: &str, index: usize) {
    let colour = COLOURS[index % COLOURS.len()];
    let checks = entries.iter().enumerate();
    let own = checks.filter_map(|(i, entry)| Some((i, entry.pairs.iter().find(|pair| pair.name == name)?)));
    let points: Vec<(f64, f64, bool)> = own
        .map(|(i, pair)| {
            let ratio = (pair.statistic / pair.limit).max(1e-9);
            (x(i, entries.len()), y(0.5 * fringe::math::ln(ratio) / std::f64::consts::LN_10), pair.healthy)
        })
        .collect();
    let path: Vec<String> = points.iter().map(|(x, y, _)| format!("{x:.1},{y:.1}")).collect();
    let _ = writeln!(
        out,
        "<polyline points=\"{}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"1.6\"/>",
        path.join(" ")
    );
    for (x, y, healthy) in points {
        let (radius, fill) = if healthy { (3.0, colour) } else { (5.0, "#ad1f1f") };
        let _ = writeln!(
            out,
            "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{radius}\" fill=\"{fill}\" stroke=\"{colour}\"/>"
        );
    }
    let at = TOP + 12.0 + 18.0 * index as f64;
    let _ = writeln!(
        out,
        "<path d=\"M{:.0} {:.1}h22\" stroke=\"{colour}\" stroke-width=\"3\"/><text x=\"{:.0}\" y=\"{at:.1}\">{}</text>",
        RIGHT + 15.0,
        at - 4.5,
        RIGHT + 43.0,
        Text(name)
    );
}

#[cfg(test)]
mod tests {
    use super::*;
    use files::trend::{TREND_FORMAT, TrendPair};

    fn entry(day: u32, statistic: f64) -> TrendEntry {
        let pair = |name: &str, statistic: f64| TrendPair {
            name: name.into(),
            used: 7000,
            mean_px: -0.1 / 3.0,
            rms_px: 0.017,
            drift_px: 0.0006,
            statistic,
            limit: 22.5,
            healthy: statistic <= 22.5,
        };
        TrendEntry {
            format: TREND_FORMAT.into(),
            date: format!("2026-01-{day:02}T08:00:00Z"),
            rig_sha256: "ab".into(),
            recording_sha256: "cd".into(),
            healthy: statistic <= 22.5,
            pairs: vec![pair("pair1", statistic), pair("cam1 <proj1>", 2.0)],
        }
    }

    #[test]
    fn the_chart_shows_each_pair_and_escapes_names() {
        let svg = chart_svg(&[entry(1, 3.0), entry(2, 0.0), entry(3, 400.0)]);
        assert!(svg.starts_with("<svg ") && svg.ends_with("</svg>\n"));
        assert!(svg.contains("pair1") && svg.contains("cam1 &lt;proj1&gt;") && svg.contains("2026-01-03"));
        assert_eq!(svg.matches("<polyline").count(), 2);
        assert!(!svg.contains("NaN") && !svg.contains("inf"));
        assert!(chart_svg(&[]).contains("no check yet"));
    }
}
