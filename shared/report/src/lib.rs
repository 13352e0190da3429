//! The measurement report: one HTML file that needs nothing else, neither a network nor scripts, on screen or on paper.
//!
//! [`ReportInput`] is the content, given by the caller; [`write_html`] sets it. Dates and versions are
//! passed in as text, nothing is read from a clock, so the same input gives the same bytes. All text is escaped.
//!
//! [`picture`] gives the pictures alone, as PNG files with colour bars.

use std::path::Path;

use files::atomic;
use metrology::verdict::Verdict;

pub mod acceptance;
pub mod calibration;
mod canvas;
mod charts;
mod class_map;
mod colour;
mod comparison;
mod csv;
mod error;
mod figures;
mod flatness;
mod formats;
mod glyph;
mod image_points;
mod input;
pub mod live;
pub mod number;
mod page;
pub mod part;
pub mod picture;
pub mod plot;
mod qdas;
mod raster;
pub mod spc;
mod splat;
mod stage_times;
pub mod statistics;
pub mod svg;
mod tables;
#[cfg(test)]
mod tests;
pub mod trend_chart;
pub mod uncertainty;
mod view_plan;

pub use class_map::{Class, ClassMap, class_counts, class_map_png};
pub use colour::ColourMap;
pub use comparison::{ComparisonInput, write_comparison};
pub use error::ReportError;
pub use flatness::{FlatnessInput, FlatnessRepeat, write_flatness};
pub use formats::Formats;
pub use image_points::{ImagePointMark, ImagePointPicture, image_points_png};
pub use input::{Activity, FeatureRow, GreyPicture, Mark, PhasePicture, ReportInput, Span};
pub use page::{Page, Text};
pub use picture::PictureError;
pub use view_plan::view_plan_png;

/// Writes the report; the file is complete or absent.
///
/// # Errors
/// See [`ReportError`].
pub fn write_html(path: &Path, input: &ReportInput<'_>) -> Result<(), ReportError> {
    Ok(atomic::write(path, html(input)?.as_bytes())?)
}

/// The report as text.
///
/// # Errors
/// A contradiction, or a picture whose data do not fit their size.
pub fn html(input: &ReportInput<'_>) -> Result<String, ReportError> {
    let unfit = |row: &&FeatureRow| row.has_limits() && row.feature.verdict != Some(Verdict::Pass);
    match input.features.iter().find(unfit) {
        Some(bad) if input.verdict == Some(Verdict::Pass) => {
            return Err(ReportError::Contradiction { feature: bad.feature.name.clone() });
        }
        _ => {}
    }
    let mut page = page::Page::begin(&format!("Measurement report: {} – {}", input.part, input.cell));
    tables::header(&mut page, input);
    tables::verdict(&mut page, input);
    tables::features(&mut page, input);
    figures::deviations(&mut page, input)?;
    figures::clouds(&mut page, input)?;
    tables::overlaps(&mut page, input);
    figures::views_and_maps(&mut page, input)?;
    charts::timeline(&mut page, &input.timeline, &input.marks);
    tables::stages(&mut page, input);
    tables::cycles(&mut page, input);
    tables::definitions(&mut page, input);
    Ok(page.end())
}
