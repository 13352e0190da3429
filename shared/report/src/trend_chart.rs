//! The history of a rig as a picture: how far each pair was from its limit.

use crate::Page;
use crate::svg::{self, Anchor};
use files::trend::TrendEntry;

const WIDTH: f64 = 900.0;
const LEFT: f64 = 70.0;
const RIGHT: f64 = 730.0;
const TOP: f64 = 30.0;
const BASE: f64 = 270.0;

/// Decades of the ratio that are drawn: a hundredth of the limit to a hundred times.
const DECADES: f64 = 2.0;

/// Strokes of the lines that share a colour.
const DASHES: [&str; 3] = ["", " stroke-dasharray=\"7 3\"", " stroke-dasharray=\"2 2\""];

/// Okabe and Ito's colours, distinguishable also with a colour vision deficiency.
const COLOURS: [&str; 7] = ["#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00", "#5b6875"];

/// √(statistic/limit) of each pair over the checks, on a logarithmic scale: 1 is the limit.
pub fn chart_svg(entries: &[TrendEntry]) -> String {
    let mut page = svg::begin_file([WIDTH, 330.0], 13.0);
    let bold = "font-weight=\"600\"";
    svg::styled_text(&mut page, [LEFT, 18.0], 13.0, Anchor::Start, bold, "Drift of each pair over its limit");
    for (decade, label) in (-2..=2).zip(["0.01", "0.1", "1 (limit)", "10", "100"]) {
        let at = y(f64::from(decade));
        let (colour, width) = if decade == 0 { ("#ad1f1f", 1.5) } else { ("#e3e8ed", 1.0) };
        let style = format!("stroke=\"{colour}\" stroke-width=\"{width}\"");
        svg::line(&mut page, [[LEFT, at], [RIGHT, at]], &style);
        svg::text(&mut page, [LEFT - 6.0, at + 4.5], 13.0, Anchor::End, label);
    }
    if entries.is_empty() {
        svg::text(&mut page, [LEFT + 20.0, 140.0], 13.0, Anchor::Start, "no check yet");
    }
    dates(&mut page, entries);
    for (index, name) in names(entries).into_iter().enumerate() {
        line(&mut page, entries, name, index);
    }
    svg::end_file(page)
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
fn dates(page: &mut Page, entries: &[TrendEntry]) {
    let count = entries.len();
    let mut shown = vec![0, count / 2, count.saturating_sub(1)];
    shown.dedup();
    for index in shown {
        let Some(entry) = entries.get(index) else { continue };
        let day: String = entry.date.chars().take(10).collect();
        svg::text(page, [x(index, count), 292.0], 13.0, Anchor::Middle, &day);
    }
    let below = [0.5 * (LEFT + RIGHT), 316.0];
    let checks =
        if count == 1 { "1 check".to_owned() } else { format!("{count} checks, in the order of the file") };
    svg::text(page, below, 13.0, Anchor::Middle, &checks);
}

fn line(page: &mut Page, entries: &[TrendEntry], name: &str, index: usize) {
    let colour = COLOURS[index % COLOURS.len()];
    let checks = entries.iter().enumerate();
    let own = checks.filter_map(|(i, entry)| Some((i, entry.pairs.iter().find(|pair| pair.name == name)?)));
    let points: Vec<(f64, f64, bool)> = own
        .map(|(i, pair)| {
            let ratio = (pair.statistic / pair.limit).max(1e-9);
            (x(i, entries.len()), y(0.5 * fringe::math::ln(ratio) / std::f64::consts::LN_10), pair.healthy)
        })
        .collect();
    let path = points.iter().map(|&(x, y, _)| [x, y]);
    // Beyond the colours, by their stroke.
    let dash = DASHES[index / COLOURS.len() % DASHES.len()];
    svg::line(page, path, &format!("stroke=\"{colour}\" stroke-width=\"1.6\"{dash}"));
    for (x, y, healthy) in points {
        let (radius, fill) = if healthy { (3.0, colour) } else { (5.0, "#ad1f1f") };
        svg::circle(page, [x, y], radius, fill, &format!("stroke=\"{colour}\""));
    }
    let at = TOP + 12.0 + 18.0 * index as f64;
    let sample = [[RIGHT + 15.0, at - 4.5], [RIGHT + 37.0, at - 4.5]];
    svg::line(page, sample, &format!("stroke=\"{colour}\" stroke-width=\"3\"{dash}"));
    svg::text(page, [RIGHT + 43.0, at], 13.0, Anchor::Start, name);
}

#[cfg(test)]
mod tests {
    use super::*;
    use files::trend::{TREND_FORMAT, TrendPair};

    /// A check of two pairs, the second of which stays far below its limit.
    fn entry(day: u32, statistic: f64) -> TrendEntry {
        let pair = |name: &str, statistic: f64| {
            let (limit, healthy) = (22.5, statistic <= 22.5);
            TrendPair {
                name: name.into(),
                used: 7000,
                mean_px: 0.0,
                rms_px: 0.017,
                drift_px: 0.0006,
                statistic,
                limit,
                healthy,
            }
        };
        let date = format!("2026-01-{day:02}T08:00:00Z");
        let pairs = vec![pair("pair1", statistic), pair("cam1 <proj1>", 2.0)];
        let [format, rig_sha256, recording_sha256] = [TREND_FORMAT, "ab", "cd"].map(String::from);
        TrendEntry { format, date, rig_sha256, recording_sha256, healthy: statistic <= 22.5, pairs }
    }

    #[test]
    fn the_chart_shows_each_pair_and_escapes_names() {
        let svg = chart_svg(&[entry(1, 3.0), entry(2, 0.0), entry(3, 400.0)]);
        assert!(svg.starts_with("<svg ") && svg.ends_with("</svg>\n"));
        assert!(svg.contains("pair1") && svg.contains("cam1 &lt;proj1&gt;") && svg.contains("2026-01-03"));
        assert_eq!(svg.matches("<circle").count(), 6, "a dot for each check of each pair");
        assert_eq!(svg.matches("r=\"5\"").count(), 1, "one check is over its limit");
        assert!(!svg.contains("NaN") && !svg.contains("inf"));
        assert!(chart_svg(&[]).contains("no check yet"));
    }
}
