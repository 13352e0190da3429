//! The page of statistics: a table of all features, then the charts of each.

use super::SpcInput;
use crate::number::{decimals, fixed, limit, limit_decimals, optional};
use crate::page::{Page, Text};
use crate::plot::{Mark, Plot, Series as Curve, draw};
use metrology::spc::{ControlLimits, Interval, Study};

/// Bars of a histogram.
const BARS: usize = 24;

/// What the words of the page mean.
const NOTES: [&str; 5] = [
    "Control limits: mean ± 3 σ within subgroups (ISO 7870-2). Single values: σ from the mean moving range of two parts. \
     They tell whether the process is stable; they are no limits of the drawing.",
    "Cp, Cpk: tolerance against σ within subgroups. Pp, Ppk: against the standard deviation of all values (ISO 22514-2, \
     spread 6σ). In brackets the confidence interval: χ² for Cp and Pp, Bissell's for Cpk and Ppk.",
    "Indices hold for a stable process with normally distributed values. Where the test says that values are not normal, \
     use the share outside of the limits, which assumes no distribution (interval of Clopper and Pearson).",
    "Normality: Anderson and Darling with estimated mean and standard deviation; p below 0.05 is not normal.",
    "u: root mean square of the stated standard uncertainties, and its share of the variance of all values. The scatter of \
     parts holds that of the measurement.",
];

pub fn render(input: &SpcInput<'_>) -> String {
    let mut page = Page::begin("Statistics of parts");
    header(&mut page, input);
    summary(&mut page, input);
    for study in input.studies {
        charts(&mut page, study);
    }
    page.section("Definitions and remarks");
    for note in NOTES {
        page.small(note);
    }
    page.end_section();
    page.end()
}

fn header(page: &mut Page, input: &SpcInput<'_>) {
    page.put(format_args!(
        "<header><h1>Statistics of parts</h1>\n<p class=\"sub\">{}</p>\n<dl class=\"meta\">\n",
        Text(input.sources)
    ));
    let facts = [
        ("Parts", input.parts.to_string()),
        ("Without a result", input.parts_not_ok.to_string()),
        ("Confidence of intervals", format!("{} %", 100.0 * input.confidence)),
        ("Ppk asked for", input.least_ppk.map_or("none".into(), |least| format!("{least}, to be proven"))),
        ("Date", input.date.to_owned()),
        ("Software", input.software.to_owned()),
    ];
    for (name, value) in &facts {
        page.put(format_args!("<div><dt>{}</dt><dd>{}</dd></div>\n", Text(name), Text(value)));
    }
    page.put(format_args!("</dl></header>\n"));
}

/// Decimals of values that scatter so.
fn digits(study: &Study) -> usize {
    decimals(study.u_rms.or(study.capability.as_ref().map(|c| c.sd))).clamp(3, 6)
}

fn summary(page: &mut Page, input: &SpcInput<'_>) {
    page.section("All features");
    page.put(format_args!("<div class=\"scroll\"><table><thead><tr><th>Feature</th>"));
    for name in ["Parts", "Mean", "s", "u", "Lower", "Upper", "Outside", "Cpk", "Ppk"] {
        page.put(format_args!("<th class=\"n\">{name}</th>"));
    }
    page.put(format_args!("<th>Stable</th><th>Normal</th></tr></thead><tbody>\n"));
    for study in input.studies {
        row(page, study, input.least_ppk);
    }
    page.put(format_args!("</tbody></table></div>\n"));
    page.end_section();
}

fn row(page: &mut Page, study: &Study, least: Option<f64>) {
    let (series, digits) = (&study.series, digits(study));
    let limit_digits = limit_decimals(series.limits.upper.or(series.limits.lower));
    let capability = study.capability.as_ref();
    let mean = study.chart.as_ref().map(|chart| chart.location.centre).or(capability.map(|c| c.mean));
    page.put(format_args!("<tr><td>{} ({})", Text(&series.name), Text(&series.unit)));
    if let Some(recipe) = &series.recipe {
        page.put(format_args!("<span class=\"detail\">recipe {}</span>", Text(recipe)));
    }
    page.put(format_args!("</td>"));
    let index = |value: Option<Interval>| {
        value.map_or("–".into(), |v| format!("{:.2} ({:.2} … {:.2})", v.value, v.low, v.high))
    };
    let missing = if series.missing > 0 { format!(" (+{} without)", series.missing) } else { String::new() };
    let ppk = capability.and_then(|c| c.ppk);
    for text in [
        format!("{}{missing}", series.values.len()),
        optional(mean, digits),
        optional(capability.map(|c| c.sd), digits + 1),
        optional(study.u_rms, digits + 1),
        limit(series.limits.lower, limit_digits),
        limit(series.limits.upper, limit_digits),
        capability.map_or("–".into(), |c| (c.outside.below + c.outside.above).to_string()),
        index(capability.and_then(|c| c.cpk)),
    ] {
        page.put(format_args!("<td class=\"n\">{}</td>", Text(&text)));
    }
    let class = match (least, ppk) {
        (None, _) => "none",
        (Some(least), Some(ppk)) if ppk.low >= least => "pass",
        (Some(_), _) => "fail",
    };
    page.put(format_args!("<td class=\"n {class}\">{}</td>", Text(&index(ppk))));
    let stable = study.chart.as_ref().map_or("–".into(), |chart| match chart.signals.len() {
        0 => "yes".into(),
        n => format!("{n} signals"),
    });
    let normal = study.normality.map_or("–".into(), |normality| {
        format!("{}, p = {:.3}", if normality.p < 0.05 { "no" } else { "yes" }, normality.p)
    });
    page.put(format_args!("<td>{stable}</td><td>{normal}</td></tr>\n"));
}

fn charts(page: &mut Page, study: &Study) {
    let Some(chart) = &study.chart else { return };
    let series = &study.series;
    page.section(&format!("{} ({})", series.name, series.unit));
    let number = |index: usize| (index + 1) as f64;
    let points = |of: &dyn Fn(usize) -> Option<f64>| -> Vec<(f64, f64)> {
        (0..chart.points.len()).filter_map(|i| Some((number(i), of(i)?))).collect()
    };
    let last = number(chart.points.len() - 1);
    let grouped = chart.subgroup > 1;
    let (location, spread) = if grouped { ("mean", "standard deviation") } else { ("value", "moving range") };
    let x_label = if grouped { format!("subgroup of {} parts", chart.subgroup) } else { "part".to_owned() };
    let drawn = [
        (location, points(&|i| Some(chart.points[i].location)), chart.location, true),
        (spread, points(&|i| chart.points[i].spread), chart.spread, false),
    ];
    for (name, values, limits, marked) in drawn {
        let mut curves = vec![
            Curve { name: name.into(), mark: Mark::Line, points: values.clone() },
            control(limits, last),
        ];
        if marked {
            let signals = chart.signals.iter().map(|s| (number(s.point), chart.points[s.point].location));
            let points: Vec<(f64, f64)> = signals.collect();
            if !points.is_empty() {
                curves.push(Curve { name: "signal".into(), mark: Mark::Dots, points });
            }
            curves.extend(drawing_limits(study, last));
        }
        draw(
            page,
            &Plot {
                title: format!("{}: {name}", series.name),
                x_label: x_label.clone(),
                y_label: format!("{name} / {}", series.unit),
                log_y: false,
                series: curves,
                marks: Vec::new(),
                note: String::new(),
            },
        );
    }
    histogram(page, study);
    for signal in &chart.signals {
        let part = series.parts.get(chart.points[signal.point].first).map_or("", String::as_str);
        page.small(&format!("Signal at part {part}: {}.", signal.reason));
    }
    page.end_section();
}

/// Both control limits and the centre in one curve, drawn there and back.
fn control(limits: ControlLimits, last: f64) -> Curve {
    let (left, right) = (1.0, last.max(2.0));
    let points = vec![
        (right, limits.lower),
        (left, limits.lower),
        (left, limits.centre),
        (right, limits.centre),
        (left, limits.centre),
        (left, limits.upper),
        (right, limits.upper),
    ];
    Curve { name: "centre and control limits".into(), mark: Mark::Line, points }
}

/// The limits of the drawing, where they lie so near that the values stay readable.
fn drawing_limits(study: &Study, last: f64) -> Option<Curve> {
    let (limits, chart) = (study.series.limits, study.chart.as_ref()?);
    let reach = 4.0 * (chart.location.upper - chart.location.lower);
    let near = |limit: &f64| (limit - chart.location.centre).abs() <= reach;
    let lines: Vec<f64> = [limits.lower, limits.upper].into_iter().flatten().filter(near).collect();
    let points = lines.iter().flat_map(|&y| [(1.0, y), (last.max(2.0), y)]).collect::<Vec<_>>();
    (!points.is_empty()).then(|| Curve { name: "limits of the plan".into(), mark: Mark::Dots, points })
}

fn histogram(page: &mut Page, study: &Study) {
    let values = &study.series.values;
    let low = values.iter().copied().fold(f64::INFINITY, f64::min);
    let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if values.len() < 8 || high <= low {
        return;
    }
    let width = (high - low) / BARS as f64;
    let mut counts = [0_usize; BARS];
    for value in values {
        counts[(((value - low) / width) as usize).min(BARS - 1)] += 1;
    }
    // A line through the tops of the classes: bars stand for whole numbers here.
    let digits = digits(study);
    let points = counts.iter().enumerate().flat_map(|(i, &count)| {
        let left = low + width * i as f64;
        [(left, count as f64), (left + width, count as f64)]
    });
    let limits = study.series.limits;
    let marks = [(limits.lower, "lower"), (limits.upper, "upper")];
    let inside = |at: &f64| (low..=high).contains(at);
    draw(
        page,
        &Plot {
            title: format!("{}: distribution", study.series.name),
            x_label: format!("value / {}", study.series.unit),
            y_label: "parts".into(),
            log_y: false,
            series: vec![Curve {
                name: "parts per class".into(),
                mark: Mark::Line,
                points: points.collect(),
            }],
            marks: marks
                .into_iter()
                .filter_map(|(at, name)| Some((at.filter(inside)?, name.to_owned())))
                .collect(),
            note: String::new(),
        },
    );
    page.small(&format!("{} … {} {}", fixed(low, digits), fixed(high, digits), study.series.unit));
}

#[cfg(test)]
mod tests {
    use super::*;
    use metrology::spc::{Limits, Series, StudySettings, study};

    #[test]
    fn the_page_names_features_signals_and_escapes_them() {
        let mut values: Vec<f64> = (0..40).map(|i| 10.0 + 0.001 * f64::from((i * 7) % 11)).collect();
        values[20] = 10.5;
        let series = Series {
            name: "<b>length</b>".into(),
            unit: "mm".into(),
            parts: (0..40).map(|i| format!("part <{i}>")).collect(),
            values,
            limits: Limits { lower: Some(9.9), upper: Some(10.1) },
            ..Series::default()
        };
        let studies = [study(series, StudySettings { subgroup: 1, confidence: 0.95 })];
        let html = render(&SpcInput {
            studies: &studies,
            sources: "a&b",
            parts: 40,
            parts_not_ok: 0,
            confidence: 0.95,
            least_ppk: Some(1.33),
            date: "2026-01-31T08:00:00Z",
            software: "test",
        });
        assert!(html.contains("&lt;b&gt;length&lt;/b&gt;") && !html.contains("<b>length"));
        assert!(html.contains("Signal at part part &lt;20&gt;: outside of the control limits."));
        assert!(html.contains("<td class=\"n fail\">"), "an index that is not proven is marked");
        assert!(!html.contains("NaN") && !html.contains("inf"));
    }
}
