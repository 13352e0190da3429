//! Header, verdict and tables of the report.

use super::number::{
    NONE, count, decimals, fixed, limit, limit_decimals, milliseconds, optional, signed, unit,
};
use super::page::{Page, Text};
use super::stage_times::stage_times;
use super::statistics::{median_ns, percentile_99_ns};
use super::{FeatureRow, ReportInput, charts};
use files::result::CycleResult;
use metrology::verdict::Verdict;

/// Above this number of cycles only the last ones and those that went wrong are listed.
const CYCLES_LISTED: usize = 60;

/// A verdict as it is printed.
fn word(verdict: Option<Verdict>) -> &'static str {
    verdict.map_or("NO RESULT", Verdict::word)
}

/// Its class in the style sheet.
fn class(verdict: Option<Verdict>) -> &'static str {
    verdict.map_or("none", Verdict::key)
}

impl FeatureRow {
    /// Whether it counts for the verdict: it has limits, or was decided about.
    pub(super) fn has_limits(&self) -> bool {
        self.feature.verdict.is_some() || self.feature.has_limits()
    }
}

/// Title, and what was measured, when and with what.
pub fn header(page: &mut Page, input: &ReportInput<'_>) {
    page.put(format_args!(
        "<header>\n<h1>Measurement report</h1>\n<p class=\"sub\">Optical coordinate measurement by fringe projection</p>\n\
         <dl class=\"meta\">\n"
    ));
    let fixed_lines = [
        ("Part", &input.part),
        ("Cell", &input.cell),
        ("Date", &input.date),
        ("Inspection plan", &input.plan_id),
        ("Rig (calibration)", &input.rig_hash),
        ("Software", &input.software_version),
    ];
    let details = input.details.iter().map(|(label, text)| (label.as_str(), text));
    for (label, text) in fixed_lines.into_iter().chain(details).filter(|(_, text)| !text.is_empty()) {
        page.put(format_args!("<div><dt>{}</dt><dd>{}</dd></div>\n", Text(label), Text(text)));
    }
    page.put(format_args!("</dl>\n</header>\n"));
}

/// Writes the verdict banner.
pub fn verdict(page: &mut Page, input: &ReportInput<'_>) {
    let class = class(input.verdict);
    page.put(format_args!(
        "<div class=\"verdict {class}\" role=\"status\"><span class=\"word {class}\">{}</span><div><p>{}</p>",
        word(input.verdict),
        Text(&sentence(input))
    ));
    if !input.reason.is_empty() {
        page.put(format_args!("<p>{}</p>", Text(&input.reason)));
    }
    for warning in &input.warnings {
        page.put(format_args!("<p><b>Warning:</b> {}</p>", Text(warning)));
    }
    page.put(format_args!("</div></div>\n"));
}

/// The verdict as a sentence, counted from the table.
fn sentence(input: &ReportInput<'_>) -> String {
    let verdicts: Vec<Option<Verdict>> =
        input.features.iter().filter(|row| row.has_limits()).map(|row| row.feature.verdict).collect();
    let number = |wanted: Option<Verdict>| verdicts.iter().filter(|verdict| **verdict == wanted).count();
    if verdicts.is_empty() {
        return match input.verdict {
            None => "The measurement gave no result.".to_owned(),
            Some(_) => "No feature has limits.".to_owned(),
        };
    }
    let all = if verdicts.len() == 1 {
        "1 feature with limits".to_owned()
    } else {
        format!("{} features with limits", verdicts.len())
    };
    let mut parts = vec![format!("{} within", number(Some(Verdict::Pass)))];
    let others = [
        (Some(Verdict::Indeterminate), "too close to a limit to decide"),
        (Some(Verdict::Fail), "outside"),
        (None, "not measured"),
    ];
    for (verdict, words) in others {
        match number(verdict) {
            0 => {}
            n => parts.push(format!("{n} {words}")),
        }
    }
    if number(Some(Verdict::Pass)) == verdicts.len() {
        format!("{all}: all within.")
    } else {
        format!("{all}: {}.", parts.join(", "))
    }
}

/// The table of features.
pub fn features(page: &mut Page, input: &ReportInput<'_>) {
    page.section("Features");
    if input.features.is_empty() {
        page.small("The inspection plan names no feature.");
        return page.end_section();
    }
    let truth = input.features.iter().any(|f| f.truth.is_some());
    let uncertainty = match input.coverage_factor {
        Some(k) => format!("U <small>(k&#8239;=&#8239;{})</small>", plain(k)),
        None => "u <small>(k&#8239;=&#8239;1)</small>".to_owned(),
    };
    page.put(format_args!(
        "<div class=\"scroll\"><table>\n<thead><tr><th>Feature</th><th class=\"n\">Measured</th>\
         <th class=\"n\">{uncertainty}</th><th class=\"n\">Lower limit</th><th class=\"n\">Upper limit</th><th class=\"unit\">Unit</th>\
         <th class=\"c\">Between the limits</th><th>Verdict</th>"
    ));
    if truth {
        page.put(format_args!("<th class=\"n truth\">Truth</th><th class=\"n truth\">Error</th>"));
    }
    page.put(format_args!("</tr></thead>\n<tbody>\n"));
    for row in &input.features {
        feature_row(page, row, input.coverage_factor.unwrap_or(1.0), truth);
    }
    page.put(format_args!("</tbody></table></div>\n"));
    page.small(match input.coverage_factor {
        Some(_) => "U is the expanded uncertainty: the standard uncertainty times the coverage factor k.",
        None => "u is the standard uncertainty.",
    });
    page.small(&input.decision_rule);
    if truth {
        page.small(
            "Truth is the value in the scene of the simulator; it is known only because this part is simulated, and the \
             measurement did not see it. Error is measured minus truth.",
        );
    }
    page.end_section();
}

/// A factor without needless digits.
fn plain(factor: f64) -> String {
    limit(Some(factor), 0)
}

fn feature_row(page: &mut Page, row: &FeatureRow, factor: f64, truth: bool) {
    let feature = &row.feature;
    let value = feature.value.unwrap_or(f64::NAN);
    let uncertainty = feature.u.map(|u| u * factor).filter(|u| u.is_finite());
    let digits = decimals(uncertainty);
    let limit_digits = limit_decimals(feature.lower).max(limit_decimals(feature.upper));
    page.put(format_args!("<tr><td>{}", Text(&feature.name)));
    // Why there is no value, else how the value is defined.
    if let Some(detail) = feature.reason.as_ref().or(feature.detail.as_ref()) {
        page.put(format_args!("<span class=\"detail\">{}</span>", Text(detail)));
    }
    page.put(format_args!(
        "</td><td class=\"n\"><b>{}</b></td><td class=\"n\">{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td>\
         <td class=\"unit\">{}</td><td class=\"c\">",
        fixed(value, digits),
        optional(uncertainty, digits),
        limit(feature.lower, limit_digits),
        limit(feature.upper, limit_digits),
        Text(unit(&feature.unit.to_string()))
    ));
    charts::tolerance(page, feature, uncertainty);
    let mark = if row.has_limits() { verdict_mark(feature.verdict) } else { NONE.to_owned() };
    page.put(format_args!("</td><td>{mark}</td>"));
    if truth {
        let error = row.truth.map_or_else(|| NONE.to_owned(), |t| signed(value - t, digits));
        page.put(format_args!(
            "<td class=\"n truth\">{}</td><td class=\"n truth\">{error}</td>",
            optional(row.truth, digits)
        ));
    }
    page.put(format_args!("</tr>\n"));
}

fn verdict_mark(verdict: Option<Verdict>) -> String {
    format!("<span class=\"mark {}\">{}</span>", class(verdict), word(verdict))
}

/// Agreement of the pairs.
pub fn overlaps(page: &mut Page, input: &ReportInput<'_>) {
    if input.overlaps.is_empty() {
        return;
    }
    page.section("Agreement of the pairs where both saw the part");
    page.put(format_args!(
        "<div class=\"scroll\"><table>\n<thead><tr><th>Pairs</th><th class=\"n\">Mean distance, µm</th>\
         <th class=\"n\">Standard deviation, µm</th><th class=\"n\">Points compared</th></tr></thead>\n<tbody>\n"
    ));
    let name = |pair: usize| input.pair_names.get(pair).map_or(NONE, String::as_str);
    for row in input.overlaps {
        page.put(format_args!(
            "<tr><td>{} – {}</td><td class=\"n\">{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td></tr>\n",
            Text(name(row.a)),
            Text(name(row.b)),
            signed(row.mean_mm * 1e3, 1),
            fixed(row.sd_mm * 1e3, 1),
            count(row.count.into())
        ));
    }
    page.put(format_args!("</tbody></table></div>\n"));
    page.end_section();
}

/// Times of the stages.
pub fn stages(page: &mut Page, input: &ReportInput<'_>) {
    let stages = stage_times(input.cycles);
    if stages.is_empty() {
        return;
    }
    page.section("Stage times, ms");
    page.put(format_args!(
        "<div class=\"scroll\"><table>\n<thead><tr><th>Stage</th><th class=\"n\">Compute, median</th>\
         <th class=\"n\">Compute, 99th percentile</th><th class=\"n\">Wait, median</th>\
         <th class=\"n\">Wait, 99th percentile</th><th class=\"n\">Cycles</th></tr></thead>\n<tbody>\n"
    ));
    for stage in &stages {
        page.put(format_args!(
            "<tr><td>{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td>\
             <td class=\"n\">{}</td><td class=\"n\">{}</td></tr>\n",
            Text(&stage.name),
            milliseconds(median_ns(&stage.compute_ns)),
            milliseconds(percentile_99_ns(&stage.compute_ns)),
            milliseconds(median_ns(&stage.wait_ns)),
            milliseconds(percentile_99_ns(&stage.wait_ns)),
            count(stage.compute_ns.len() as u64)
        ));
    }
    page.put(format_args!("</tbody></table></div>\n"));
    page.end_section();
}

/// All cycles, or of a long run the last ones and those that went wrong.
pub fn cycles(page: &mut Page, input: &ReportInput<'_>) {
    if input.cycles.is_empty() {
        return;
    }
    page.section("Cycles");
    let good = input.cycles.iter().filter(|c| c.is_ok()).count();
    let total = input.cycles.len();
    page.put(format_args!(
        "<div class=\"scroll\"><table>\n<thead><tr><th class=\"n\">Cycle</th><th>Outcome</th><th>Verdict</th>\
         <th class=\"n\">Latency, ms</th><th class=\"n\">Points</th></tr></thead>\n<tbody>\n"
    ));
    let first_listed = total.saturating_sub(CYCLES_LISTED);
    let listed = |(place, cycle): &(usize, &CycleResult)| *place >= first_listed || !cycle.is_ok();
    let rows: Vec<&CycleResult> = input.cycles.iter().enumerate().filter(listed).map(|(_, c)| c).collect();
    for cycle in &rows {
        page.put(format_args!(
            "<tr><td class=\"n\">{}</td><td>{}</td><td>{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td></tr>\n",
            cycle.number,
            Text(&cycle.outcome),
            cycle.verdict.map_or_else(|| NONE.to_owned(), |verdict| verdict_mark(Some(verdict))),
            milliseconds(cycle.latency_ns),
            cycle.points.map_or_else(|| NONE.to_owned(), count)
        ));
    }
    page.put(format_args!("</tbody></table></div>\n"));
    page.small(&format!("{good} of {total} cycles ended ok."));
    if rows.len() < total {
        page.small(&format!("{} earlier cycles that ended ok are not listed.", total - rows.len()));
    }
    page.end_section();
}

/// What each statistic means, and the remarks of the caller.
pub fn definitions(page: &mut Page, input: &ReportInput<'_>) {
    const TERMS: [(&str, &str); 7] = [
        (
            "Standard uncertainty u",
            "Standard deviation that characterises the dispersion of the values that could reasonably be attributed to \
             the measured quantity (GUM 2.3.1). Values are printed with two significant digits of their uncertainty.",
        ),
        (
            "Deviation",
            "Signed distance of a measured point from the reference named at the picture. Mean: arithmetic mean. sd: \
             sample standard deviation, n − 1. 95th percentile: of the magnitudes, by nearest rank.",
        ),
        (
            "Agreement of the pairs",
            "Signed distance along the normal between the surfaces that two pairs measured at the same place; \
             arithmetic mean and sample standard deviation (n − 1) over all compared points.",
        ),
        (
            "Absolute and wrapped phase",
            "Phase of the projected fringes at each pixel in rad; absolute: with the fringe order, so that \
             phase × period / 2π is the projector pixel; wrapped: without it, 0 … 2π.",
        ),
        ("Latency", "Time from the arrival of the last frame of a cycle to its verdict."),
        (
            "Compute, wait",
            "Time in which a stage worked on a cycle, and time in which it had nothing to work on until its input came.",
        ),
        (
            "Median, 99th percentile",
            "Over all cycles listed for the stage; the percentile by nearest rank, so below 100 cycles it is the longest \
             time.",
        ),
    ];
    page.section("Definitions and remarks");
    page.put(format_args!("<dl class=\"terms\">\n"));
    for (term, meaning) in TERMS {
        page.put(format_args!("<dt>{}</dt><dd>{}</dd>\n", Text(term), Text(meaning)));
    }
    page.put(format_args!("</dl>\n"));
    for note in &input.notes {
        page.small(note);
    }
    page.end_section();
}
