//! The report of a comparison: what was compared how, the numbers, the map of deviations and its histogram.

use super::page::{Page, Text};
use super::{ReportError, ReportInput, figures};
use files::atomic;
use fringe::cloud::Point;
use std::path::Path;

/// Content of the report of a comparison.
#[derive(Debug, Clone, Default)]
pub struct ComparisonInput<'a> {
    /// Its title: what is compared with what.
    pub title: String,
    /// Lines of the header: label and text.
    pub details: Vec<(String, String)>,
    /// Tables: heading, then rows of label, value and unit or meaning.
    pub tables: Vec<(String, Vec<[String; 3]>)>,
    /// The cloud, in the frame of the reference.
    pub cloud: &'a [Point],
    /// Index into `cloud` and signed deviation, mm. Points without one stay grey.
    pub deviations: &'a [(u32, f32)],
    /// From what the deviations are taken, as a sentence.
    pub meaning: String,
    /// End of the colour bar, mm; if `None`, from the data.
    pub half_range_mm: Option<f64>,
    /// Definitions and remarks at the end, a paragraph each.
    pub notes: Vec<String>,
}

/// Writes the report of a comparison; the file is complete or absent.
///
/// # Errors
/// See [`ReportError`].
pub fn write_comparison(path: &Path, input: &ComparisonInput<'_>) -> Result<(), ReportError> {
    Ok(atomic::write(path, comparison(input)?.as_bytes())?)
}

fn comparison(input: &ComparisonInput<'_>) -> Result<String, ReportError> {
    let mut page = Page::begin(&input.title);
    page.put(format_args!(
        "<header>\n<h1>Comparison report</h1>\n<p class=\"sub\">{}</p>\n",
        Text(&input.title)
    ));
    page.put(format_args!("<dl class=\"meta\">\n"));
    for (label, text) in &input.details {
        page.put(format_args!("<div><dt>{}</dt><dd>{}</dd></div>\n", Text(label), Text(text)));
    }
    page.put(format_args!("</dl>\n</header>\n"));
    for (heading, rows) in &input.tables {
        table(&mut page, heading, rows);
    }
    let map = ReportInput {
        cloud: input.cloud,
        deviations: input.deviations,
        deviation_meaning: input.meaning.clone(),
        deviation_half_range_mm: input.half_range_mm,
        ..ReportInput::default()
    };
    figures::deviations(&mut page, &map)?;
    page.section("Definitions and remarks");
    for note in &input.notes {
        page.small(note);
    }
    page.end_section();
    Ok(page.end())
}

fn table(page: &mut Page, heading: &str, rows: &[[String; 3]]) {
    page.section(heading);
    page.put(format_args!("<div class=\"scroll\"><table>\n<tbody>\n"));
    for [label, value, meaning] in rows {
        page.put(format_args!(
            "<tr><td>{}</td><td class=\"n\"><b>{}</b></td><td>{}</td></tr>\n",
            Text(label),
            Text(value),
            Text(meaning)
        ));
    }
    page.put(format_args!("</tbody></table></div>\n"));
    page.end_section();
}
