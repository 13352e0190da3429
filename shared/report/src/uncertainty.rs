//! The report of an uncertainty budget: table, result, distribution.

use std::path::Path;

use metrology::uncertainty::{Comparison, Evaluation, MonteCarloResult, Row, Validation, density};

use super::ReportError;
use super::number::{self, count, fixed, signed, significant};
use super::page::{Page, Text};
use super::svg::{self, Anchor};
use files::atomic;
use files::budget::BudgetFile;

/// Content of the report.
pub struct UncertaintyInput<'a> {
    /// The budget as read from its file.
    pub file: &'a BudgetFile,
    /// Evaluation of the budget.
    pub evaluation: &'a Evaluation,
    /// Propagation of distributions, and how the budget compares.
    pub monte_carlo: Option<(&'a MonteCarloResult, Validation)>,
    /// Beside the budget's reference.
    pub comparison: Option<Comparison>,
    /// When it was evaluated, UTC.
    pub date: String,
    /// Name and version of the program.
    pub software_version: String,
}

/// Writes the report; the file is complete or absent.
///
/// # Errors
/// A place that cannot be written.
pub fn write_uncertainty(path: &Path, input: &UncertaintyInput<'_>) -> Result<(), ReportError> {
    Ok(atomic::write(path, html(input).as_bytes())?)
}

/// The report as text.
fn html(input: &UncertaintyInput<'_>) -> String {
    let mut page = Page::begin(&format!("Uncertainty budget: {}", input.file.name));
    header(&mut page, input);
    result(&mut page, input);
    budget(&mut page, input);
    distribution(&mut page, input);
    comparison(&mut page, input);
    definitions(&mut page, input);
    page.end()
}

fn header(page: &mut Page, input: &UncertaintyInput<'_>) {
    let file = input.file;
    let model = file.model.as_deref().unwrap_or("sum of sensitivity × quantity");
    page.put(format_args!(
        "<header>\n<h1>Uncertainty budget</h1>\n<p class=\"sub\">{}</p>\n<dl class=\"meta\">\n",
        Text(&file.name)
    ));
    let measurand = format!("{} in {}", file.symbol, number::unit(&file.unit));
    for (label, text) in [
        ("Measurand", measurand.as_str()),
        ("Model", model),
        ("Remark", &file.remark),
        ("Date", &input.date),
        ("Software", &input.software_version),
        ("Budget file (SHA-256)", &file.sha256),
    ] {
        if !text.is_empty() {
            page.put(format_args!("<div><dt>{}</dt><dd>{}</dd></div>\n", Text(label), Text(text)));
        }
    }
    page.put(format_args!("</dl>\n</header>\n"));
}

fn result(page: &mut Page, input: &UncertaintyInput<'_>) {
    let (file, e) = (input.file, input.evaluation);
    let digits = number::decimals(Some(e.expanded_uncertainty));
    page.section("Result");
    page.put(format_args!(
        "<p><strong>{} = ({} ± {}) {}</strong></p>\n",
        Text(&file.symbol),
        fixed(e.estimate, digits),
        fixed(e.expanded_uncertainty, digits),
        Text(number::unit(&file.unit))
    ));
    page.put(format_args!("<dl class=\"terms\">\n"));
    let unit = number::unit(&file.unit);
    let dof = degrees(e.effective_dof);
    for (label, text) in [
        (
            "Combined standard uncertainty u_c",
            format!("{} {unit}", significant(e.combined_standard_uncertainty, 3)),
        ),
        ("Effective degrees of freedom ν_eff", dof),
        ("Coverage factor k", fixed(e.coverage_factor, 2)),
        ("Coverage probability", format!("{} %", fixed(100.0 * e.covered_probability, 2))),
        ("Expanded uncertainty U = k·u_c", format!("{} {unit}", significant(e.expanded_uncertainty, 3))),
    ] {
        page.put(format_args!("<dt>{}</dt><dd>{}</dd>\n", Text(label), Text(&text)));
    }
    page.put(format_args!("</dl>\n"));
    for note in &e.notes {
        page.small(&format!("Note: {note}."));
    }
    page.end_section();
}

/// Degrees of freedom as they are printed.
pub fn degrees(dof: f64) -> String {
    if dof.is_infinite() {
        return "∞".to_owned();
    }
    fixed(dof, usize::from(dof < 1000.0 && dof.fract() != 0.0))
}

fn budget(page: &mut Page, input: &UncertaintyInput<'_>) {
    let unit = number::unit(&input.file.unit);
    page.section("Budget");
    page.put(format_args!(
        "<div class=\"scroll\"><table>\n<thead><tr><th>Quantity</th><th class=\"n\">Estimate</th><th class=\"c\">Type</th>\
         <th>Distribution</th><th class=\"n\">Value</th><th class=\"n\">Divisor</th><th class=\"n\">u(x)</th>\
         <th class=\"unit\">Unit</th><th class=\"n\">Sensitivity c</th><th class=\"n\">|c|·u(x), {}</th><th class=\"n\">Share, %</th>\
         <th class=\"n\">ν</th></tr></thead>\n<tbody>\n",
        Text(unit)
    ));
    for row in &input.evaluation.rows {
        budget_row(page, row);
    }
    if input.evaluation.correlation_share != 0.0 {
        page.put(format_args!(
            "<tr><td colspan=\"10\">Correlation</td><td class=\"n\">{}</td><td></td></tr>\n",
            fixed(100.0 * input.evaluation.correlation_share, 1)
        ));
    }
    page.put(format_args!("</tbody></table></div>\n"));
    page.small(
        "Value is what the source states: a standard or expanded uncertainty, or the half-width of a distribution. u(x) = \
         value / divisor. Share is the part of the variance u_c².",
    );
    page.end_section();
}

fn budget_row(page: &mut Page, row: &Row) {
    page.put(format_args!("<tr><td>{}", Text(&row.name)));
    if !row.source.is_empty() {
        page.put(format_args!("<span class=\"detail\">{}</span>", Text(&row.source)));
    }
    page.put(format_args!(
        "</td><td class=\"n\">{}</td><td class=\"c\">{:?}</td><td>{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td>\
         <td class=\"n\">{}</td><td class=\"unit\">{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td>\
         <td class=\"n\">{}</td></tr>\n",
        estimate(row),
        row.method,
        row.distribution.name(),
        significant(row.value, 3),
        fixed(row.divisor, 3),
        significant(row.standard_uncertainty, 3),
        Text(number::unit(&row.unit)),
        significant(row.sensitivity, 3),
        significant(row.contribution, 3),
        fixed(100.0 * row.share, 1),
        degrees(row.dof)
    ));
}

/// The estimate with the digits that its uncertainty supports.
pub fn estimate(row: &Row) -> String {
    match row.estimate.abs() {
        // A fixed number of digits would hide a coefficient such as 1e-5/K.
        small if small > 0.0 && small < 1e-3 => significant(row.estimate, 4),
        _ => fixed(row.estimate, number::decimals(Some(row.standard_uncertainty))),
    }
}

fn distribution(page: &mut Page, input: &UncertaintyInput<'_>) {
    if input.evaluation.combined_standard_uncertainty <= 0.0 {
        return;
    }
    page.section("Distribution of the measurand");
    Chart::new(input).draw(page, input);
    match input.monte_carlo {
        Some((monte_carlo, validation)) => {
            for line in monte_carlo_lines(input.file, monte_carlo, validation) {
                page.small(&line);
            }
        }
        None => page.small(
            "Curve: the distribution that the budget takes, t with ν_eff. No Monte Carlo method was run.",
        ),
    }
    page.end_section();
}

/// What the Monte Carlo method found, in sentences.
pub fn monte_carlo_lines(file: &BudgetFile, m: &MonteCarloResult, validation: Validation) -> Vec<String> {
    let unit = number::unit(&file.unit);
    let digits = number::decimals(Some(m.standard_uncertainty)) + 1;
    let stable = match m.converged {
        Some(true) => format!("stable to {} {unit}", significant(m.tolerance, 2)),
        Some(false) => format!(
            "NOT stable to {} {unit} within max_trials; allow more, or set digits = 1",
            significant(m.tolerance, 2)
        ),
        None => "a fixed number, stability not checked".to_owned(),
    };
    let ends = |i: metrology::uncertainty::Interval| {
        format!("[{}, {}]", fixed(i.low, digits), fixed(i.high, digits))
    };
    let word = if validation.valid { "validated" } else { "NOT validated; use the Monte Carlo interval" };
    vec![
        format!("Monte Carlo: {} trials, seed {}, {stable}.", count(m.trials), m.seed),
        format!(
            "{} = {} {unit}, u = {} {unit}; {} % within {} {unit} (probabilistically symmetric), shortest {} {unit}.",
            file.symbol,
            fixed(m.estimate, digits),
            fixed(m.standard_uncertainty, digits),
            fixed(100.0 * m.coverage_probability, 2),
            ends(m.probabilistically_symmetric),
            ends(m.shortest)
        ),
        format!(
            "The budget's interval differs by {} {unit} below and {} {unit} above, tolerance {} {unit}: {word}.",
            significant(validation.low_difference, 2),
            significant(validation.high_difference, 2),
            significant(validation.tolerance, 2)
        ),
    ]
}

/// The comparison in one sentence.
pub fn comparison_line(file: &BudgetFile, comparison: &Comparison) -> Option<String> {
    let reference = file.reference.as_ref()?;
    let unit = number::unit(&file.unit);
    let digits = number::decimals(Some(comparison.deviation_expanded_uncertainty));
    let word = if comparison.agrees { "they agree" } else { "they do NOT agree" };
    let reference_digits = number::decimals(Some(reference.expanded_uncertainty));
    Some(format!(
        "{}: ({} ± {}) {unit}; deviation ({} ± {}) {unit}, E_n = {}: {word}.",
        reference.name,
        fixed(reference.value, reference_digits),
        fixed(reference.expanded_uncertainty, reference_digits),
        signed(comparison.deviation, digits),
        fixed(comparison.deviation_expanded_uncertainty, digits),
        fixed(comparison.normalised_error, 3)
    ))
}

fn comparison(page: &mut Page, input: &UncertaintyInput<'_>) {
    if let Some(line) = input.comparison.as_ref().and_then(|c| comparison_line(input.file, c)) {
        page.section("Comparison");
        page.put(format_args!("<p>{}</p>\n", Text(&line)));
        page.small("E_n = (x − X) / √(U_x² + U_X²); |E_n| ≤ 1 is agreement.");
        page.end_section();
    }
}

fn definitions(page: &mut Page, input: &UncertaintyInput<'_>) {
    page.section("Method");
    page.small(
        "Evaluated following JCGM 100:2008 (GUM): law of propagation of uncertainty, sensitivities as derivatives of the \
         model at the estimates, ν_eff by Welch and Satterthwaite, k = t_p(ν_eff) unless the budget fixes it.",
    );
    if input.monte_carlo.is_some() {
        page.small(
            "Monte Carlo method following JCGM 101:2008 (Supplement 1), 7.9: blocks of trials until twice the standard \
             deviations of estimate, uncertainty and interval ends are within a fifth of δ; validation following 8.1.",
        );
    }
    page.end_section();
}

/// Place of a picture's parts.
struct Chart {
    low: f64,
    high: f64,
    peak: f64,
}

impl Chart {
    const LEFT: f64 = 20.0;
    const RIGHT: f64 = 980.0;
    const TOP: f64 = 34.0;
    const BASE: f64 = 250.0;
    const BUDGET: &'static str = "#ad1f1f";
    const BARS: &'static str = "#9db8d6";
    const TRIALS: &'static str = "#0b5cad";

    fn new(input: &UncertaintyInput<'_>) -> Self {
        let e = input.evaluation;
        let reach = 4.0 * e.combined_standard_uncertainty;
        let (mut low, mut high) = (e.estimate - reach, e.estimate + reach);
        let mut peak = density(0.0, e.effective_dof) / e.combined_standard_uncertainty;
        if let Some((m, _)) = input.monte_carlo {
            let h = &m.histogram;
            low = low.min(h.low);
            high = high.max(h.low + h.width * h.counts.len() as f64);
            let highest = h.counts.iter().copied().max().unwrap_or(0) as f64;
            if h.width > 0.0 {
                peak = peak.max(highest / (m.trials as f64 * h.width));
            }
        }
        Self { low, high, peak: 1.05 * peak }
    }

    fn x(&self, value: f64) -> f64 {
        Self::LEFT
            + (Self::RIGHT - Self::LEFT) * ((value - self.low) / (self.high - self.low)).clamp(0.0, 1.0)
    }

    fn y(&self, density: f64) -> f64 {
        Self::BASE - (Self::BASE - Self::TOP) * (density / self.peak).clamp(0.0, 1.0)
    }

    fn draw(&self, page: &mut Page, input: &UncertaintyInput<'_>) {
        let e = input.evaluation;
        page.put(format_args!("<ul class=\"legend\">"));
        if input.monte_carlo.is_some() {
            page.put(format_args!(
                "<li><i style=\"background:{}\"></i>Monte Carlo</li><li><i style=\"background:{}\"></i>its interval</li>",
                Self::BARS,
                Self::TRIALS
            ));
        }
        page.put(format_args!(
            "<li><i style=\"background:{}\"></i>budget: t with ν_eff = {}, and y ± U</li></ul>\n<div class=\"chart\">",
            Self::BUDGET,
            degrees(e.effective_dof)
        ));
        svg::open(page, "", [1000.0, 302.0], "distribution of the measurand");
        if let Some((m, _)) = input.monte_carlo {
            self.bars(page, m);
            let interval = m.decisive();
            self.ends(page, [interval.low, interval.high], Self::TRIALS, "none");
        }
        self.curve(page, e);
        let ends = [e.estimate - e.expanded_uncertainty, e.estimate + e.expanded_uncertainty];
        self.ends(page, ends, Self::BUDGET, "5 3");
        self.axis(page, input.file);
        svg::close(page);
        page.put(format_args!("</div>\n"));
    }

    fn bars(&self, page: &mut Page, m: &MonteCarloResult) {
        let h = &m.histogram;
        for (i, n) in h.counts.iter().enumerate().filter(|(_, n)| **n > 0) {
            let left = h.low + h.width * i as f64;
            let top = self.y(*n as f64 / (m.trials as f64 * h.width));
            let size = [self.x(left + h.width) - self.x(left), Self::BASE - top];
            svg::rectangle(page, [self.x(left), top], size, Self::BARS, "");
        }
        page.put(format_args!("\n"));
    }

    fn curve(&self, page: &mut Page, e: &Evaluation) {
        let curve = (0..=240).map(|step| {
            let value = self.low + (self.high - self.low) * f64::from(step) / 240.0;
            let t = (value - e.estimate) / e.combined_standard_uncertainty;
            let height = density(t, e.effective_dof) / e.combined_standard_uncertainty;
            [self.x(value), self.y(height)]
        });
        svg::line(page, curve, &format!("stroke=\"{}\" stroke-width=\"1.8\"", Self::BUDGET));
    }

    fn ends(&self, page: &mut Page, ends: [f64; 2], colour: &str, dashes: &str) {
        for end in ends {
            let x = self.x(end);
            let style = format!("stroke=\"{colour}\" stroke-width=\"1.6\" stroke-dasharray=\"{dashes}\"");
            svg::line(page, [[x, Self::TOP - 8.0], [x, Self::BASE]], &style);
        }
    }

    fn axis(&self, page: &mut Page, file: &BudgetFile) {
        let axis = [[Self::LEFT, Self::BASE], [Self::RIGHT, Self::BASE]];
        svg::line(page, axis, &format!("stroke=\"{}\"", svg::INK));
        let (values, digits) = number::ticks(self.low, self.high, 8);
        for value in values {
            svg::mark_below(page, [self.x(value), Self::BASE], 5.0, 13.0, &fixed(value, digits));
        }
        let label = format!("{}, {}", file.symbol, number::unit(&file.unit));
        svg::text(page, [500.0, 293.0], 13.0, Anchor::Middle, &label);
    }
}
