//! Drawings of the report as SVG: they scale, print sharply and carry real text.

use fringe::math::exp;

use super::colour::{ColourMap, hex};
use super::number::{self, count, fixed, milliseconds, signed};
use super::page::{Page, Text};
use super::picture::{Ends, share};
use super::statistics::Summary;
use super::svg::{self, Anchor, INK};
use super::{Activity, Mark, Span};
use metrology::inspection::FeatureResult;

const SOFT: &str = "#5b6875";
const LINE: &str = "#d5dbe1";
const COMPUTE: &str = "#0b5cad";
const WAIT: &str = "#ccd5de";

/// Bars of the histogram: even, so that zero lies between two of them.
const BINS: usize = 60;

/// Where a value lies between its limits, with its uncertainty; nothing without an upper limit or a value.
pub fn tolerance(page: &mut Page, feature: &FeatureResult, uncertainty: Option<f64>) {
    let (Some(upper), Some(value)) = (feature.upper, feature.value.filter(|value| value.is_finite())) else {
        return page.put(format_args!("{}", number::NONE));
    };
    // A form deviation has no lower limit; zero is its natural end.
    let lower = feature.lower.unwrap_or(0.0);
    if !(upper - lower).is_finite() || upper <= lower {
        return page.put(format_args!("{}", number::NONE));
    }
    let place = |value: f64| (25.0 + 90.0 * (value - lower) / (upper - lower)).clamp(3.0, 137.0);
    let (x, u) = (place(value), uncertainty.unwrap_or(0.0));
    let (left, right) = (place(value - u), place(value + u));
    svg::open(page, "tolerance", [140.0, 18.0], "place of the value between its limits");
    svg::rectangle(page, [25.0, 6.0], [90.0, 6.0], "#e3e8ed", "");
    svg::line(page, [[0.0, 9.0], [140.0, 9.0]], &format!("stroke=\"{LINE}\""));
    for (at, present) in [(25.0, feature.lower.is_some()), (115.0, true)] {
        if present {
            svg::line(page, [[at, 2.0], [at, 16.0]], &format!("stroke=\"{SOFT}\" stroke-width=\"1.5\""));
        }
    }
    let style = format!("stroke=\"{INK}\" stroke-width=\"1.2\"");
    for ends in [[[left, 9.0], [right, 9.0]], [[left, 6.0], [left, 12.0]], [[right, 6.0], [right, 12.0]]] {
        svg::line(page, ends, &style);
    }
    svg::circle(page, [x, 9.0], 3.0, INK, "");
    svg::close(page);
}

/// A colour bar with values and unit, to stand below a picture.
pub fn colour_bar(page: &mut Page, map: ColourMap, ends: Ends, title: &str, with_sign: bool) {
    let id = page.fresh_id();
    svg::open(page, "bar", [600.0, 58.0], "colour bar");
    page.put(format_args!("<defs><linearGradient id=\"{id}\">"));
    let table = map.table();
    for (i, colour) in table.iter().enumerate() {
        let offset = i as f64 / (table.len() - 1) as f64;
        page.put(format_args!("<stop offset=\"{offset:.4}\" stop-color=\"{}\"/>", hex(*colour)));
    }
    page.put(format_args!(
        "</linearGradient></defs><rect x=\"30\" y=\"6\" width=\"540\" height=\"13\" fill=\"url(#{id})\" stroke=\"{SOFT}\" \
         stroke-width=\"0.5\"/>"
    ));
    for (value, text) in bar_labels(map, ends, with_sign) {
        let x = 30.0 + 540.0 * share(value, ends);
        svg::mark_below(page, [x, 19.0], 5.0, 13.0, &text);
    }
    svg::text(page, [300.0, 55.0], 13.0, Anchor::Middle, title);
    svg::close(page);
}

/// Values of a colour bar and how they are written.
fn bar_labels(map: ColourMap, ends: Ends, with_sign: bool) -> Vec<(f64, String)> {
    if map == ColourMap::Cyclic {
        let quarters = ["0", "π/2", "π", "3π/2", "2π"].into_iter().enumerate();
        let value = |i: usize| ends.low + (ends.high - ends.low) * i as f64 / 4.0;
        return quarters.map(|(i, text)| (value(i), text.to_owned())).collect();
    }
    let (values, digits) = number::ticks(ends.low, ends.high, 6);
    let text = |v: f64| if with_sign { signed(v, digits) } else { fixed(v, digits) };
    values.into_iter().map(|v| (v, text(v))).collect()
}

/// Histogram of deviations with mean, standard deviation and the normal distribution that has both.
pub fn histogram(page: &mut Page, deviations_mm: &[f64], summary: &Summary, half_range_mm: f64) {
    const LEFT: f64 = 74.0;
    const RIGHT: f64 = 980.0;
    const TOP: f64 = 34.0;
    const BASE: f64 = 250.0;
    let bins = bins(deviations_mm, half_range_mm);
    let highest = bins.iter().copied().max().unwrap_or(0).max(1) as f64;
    let x = |mm: f64| LEFT + (RIGHT - LEFT) * (0.5 + mm / (2.0 * half_range_mm));
    let y = |n: f64| BASE - (BASE - TOP) * (n / (highest * 1.05)).min(1.0);
    page.put(format_args!("<div class=\"chart\">"));
    svg::open(page, "", [1000.0, 302.0], "histogram of deviations");
    let (values, _) = number::ticks(0.0, highest, 4);
    for value in values {
        svg::grid_line(page, [LEFT, RIGHT], y(value), 13.0, &count(value as u64));
    }
    let width_mm = 2.0 * half_range_mm / BINS as f64;
    for (i, n) in bins.iter().enumerate().filter(|(_, n)| **n > 0) {
        let low_mm = -half_range_mm + width_mm * i as f64;
        let colour = ColourMap::Diverging.colour((i as f64 + 0.5) / BINS as f64);
        let (left, top) = (x(low_mm), y(*n as f64));
        let size = [x(low_mm + width_mm) - left, BASE - top];
        let outline = "stroke=\"#7b8794\" stroke-width=\"0.6\"";
        svg::rectangle(page, [left, top], size, &hex(colour), outline);
    }
    normal_curve(page, summary, half_range_mm, &x, &y);
    histogram_axis(page, half_range_mm, summary, &x);
    svg::close(page);
    page.put(format_args!("</div>\n"));
}

/// Counts between −range and +range; the last bin includes its upper end.
fn bins(deviations_mm: &[f64], half_range_mm: f64) -> [u64; BINS] {
    let mut bins = [0; BINS];
    for deviation in deviations_mm.iter().filter(|d| d.abs() <= half_range_mm) {
        let place = (0.5 + deviation / (2.0 * half_range_mm)) * BINS as f64;
        bins[(place as usize).min(BINS - 1)] += 1;
    }
    bins
}

fn normal_curve(
    page: &mut Page,
    summary: &Summary,
    half_range_mm: f64,
    x: &dyn Fn(f64) -> f64,
    y: &dyn Fn(f64) -> f64,
) {
    let (Some(mean), Some(sd)) = (summary.mean, summary.sd.filter(|sd| *sd > 0.0)) else {
        return;
    };
    let width_mm = 2.0 * half_range_mm / BINS as f64;
    let peak = summary.count as f64 * width_mm / (sd * std::f64::consts::TAU.sqrt());
    let curve = (0..=180).map(|step| {
        let mm = half_range_mm * (f64::from(step) / 90.0 - 1.0);
        let z = (mm - mean) / sd;
        [x(mm), y(peak * exp(-0.5 * z * z))]
    });
    svg::line(page, curve, &format!("stroke=\"{INK}\" stroke-width=\"1.4\" stroke-dasharray=\"5 3\""));
}

fn histogram_axis(page: &mut Page, half_range_mm: f64, summary: &Summary, x: &dyn Fn(f64) -> f64) {
    svg::line(page, [[74.0, 250.0], [980.0, 250.0]], &format!("stroke=\"{INK}\""));
    let (values, digits) = number::ticks(-half_range_mm * 1e3, half_range_mm * 1e3, 8);
    for value in values {
        svg::mark_below(page, [x(value * 1e-3), 250.0], 5.0, 13.0, &signed(value, digits));
    }
    svg::text(page, [527.0, 293.0], 13.0, Anchor::Middle, "Deviation, µm");
    svg::upright_text(page, [16.0, 142.0], 13.0, "Points");
    let in_um = |value: Option<f64>| value.map(|v| v * 1e3);
    if let Some(mean) = summary.mean.filter(|mean| mean.abs() <= half_range_mm) {
        let line = [[x(mean), 26.0], [x(mean), 250.0]];
        svg::line(page, line, &format!("stroke=\"{INK}\" stroke-width=\"1.4\""));
    }
    let text = format!(
        "mean {} µm   sd {} µm   n {}",
        in_um(summary.mean).map_or_else(|| number::NONE.to_owned(), |m| signed(m, 2)),
        number::optional(in_um(summary.sd), 2),
        count(summary.count as u64)
    );
    let bold = "font-weight=\"600\" xml:space=\"preserve\"";
    svg::styled_text(page, [980.0, 18.0], 14.0, Anchor::End, bold, &text);
}

/// What each stage did in the last cycle.
pub fn timeline(page: &mut Page, spans: &[Span], marks: &[Mark]) {
    let (Some(start), Some(end)) =
        (spans.iter().map(|s| s.start_ns).min(), spans.iter().map(|s| s.end_ns).max())
    else {
        return;
    };
    let mut stages: Vec<&str> = Vec::new();
    for span in spans {
        if !stages.contains(&span.stage.as_str()) {
            stages.push(&span.stage);
        }
    }
    let length_ns = end.saturating_sub(start).max(1) as f64;
    let x = |at: u64| 150.0 + 830.0 * (at.saturating_sub(start) as f64 / length_ns).min(1.0);
    let base = 30.0 + 24.0 * stages.len() as f64;
    page.section("Stage timeline of the last cycle");
    page.put(format_args!(
        "<ul class=\"legend\"><li><i style=\"background:{COMPUTE}\"></i>compute</li>\
         <li><i style=\"background:{WAIT}\"></i>wait</li></ul>\n<div class=\"chart\">"
    ));
    svg::open(page, "", [1000.0, base + 46.0], "stage timeline");
    time_axis(page, length_ns, base);
    for (row, stage) in stages.iter().enumerate() {
        let top = 30.0 + 24.0 * row as f64;
        svg::text(page, [140.0, top + 15.5], 13.0, Anchor::End, stage);
        for span in spans.iter().filter(|s| s.stage == *stage) {
            bar(page, span, x(span.start_ns), x(span.end_ns.max(span.start_ns)), top);
        }
    }
    for mark in marks.iter().filter(|m| (start..=end).contains(&m.at_ns)) {
        let at = x(mark.at_ns);
        let anchor = if at > 850.0 { Anchor::End } else { Anchor::Start };
        svg::line(page, [[at, 20.0], [at, base]], "stroke=\"#ad1f1f\" stroke-dasharray=\"3 2\"");
        svg::styled_text(page, [at, 14.0], 12.5, anchor, "style=\"fill:#ad1f1f\"", &mark.name);
    }
    svg::close(page);
    page.put(format_args!("</div>\n"));
    page.end_section();
}

fn bar(page: &mut Page, span: &Span, left: f64, right: f64, top: f64) {
    let (colour, word, inset) = match span.activity {
        Activity::Compute => (COMPUTE, "compute", 3.0),
        Activity::Wait => (WAIT, "wait", 7.0),
    };
    // A span too short to be seen is drawn half a unit wide: it happened.
    page.put(format_args!(
        "<rect x=\"{left:.2}\" y=\"{:.1}\" width=\"{:.2}\" height=\"{:.1}\" fill=\"{colour}\"><title>{}: {word} {} ms</title></rect>\n",
        top + inset,
        (right - left).max(0.5),
        24.0 - 2.0 * inset,
        Text(&span.stage),
        milliseconds(Some(span.end_ns.saturating_sub(span.start_ns)))
    ));
}

fn time_axis(page: &mut Page, length_ns: f64, base: f64) {
    let length_ms = length_ns * 1e-6;
    let (values, digits) = number::ticks(0.0, length_ms, 10);
    for value in values {
        let at = 150.0 + 830.0 * value / length_ms;
        svg::line(page, [[at, 26.0], [at, base + 4.0]], "stroke=\"#e3e8ed\"");
        svg::text(page, [at, base + 20.0], 13.0, Anchor::Middle, &fixed(value, digits));
    }
    svg::line(page, [[150.0, base], [980.0, base]], &format!("stroke=\"{INK}\""));
    svg::text(page, [565.0, base + 40.0], 13.0, Anchor::Middle, "Time, ms");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_value_within_the_range_is_counted_once() {
        let values = [-0.1, -0.05, -1e-12, 0.0, 0.05, 0.1, 0.11, f64::NAN];
        let counts = bins(&values, 0.1);
        assert_eq!(counts.iter().sum::<u64>(), 6);
        assert_eq!((counts[0], counts[29], counts[30], counts[59]), (1, 1, 1, 1));
    }
}
