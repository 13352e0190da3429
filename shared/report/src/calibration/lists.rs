//! Points and images that were rejected, and the definitions.

use super::super::page::{Page, Text};
use super::CalibrationReport;

/// Largest number of rows of a list.
const LISTED: usize = 30;

/// The sections at the end.
pub fn section(page: &mut Page, report: &CalibrationReport<'_>) {
    outliers(page, report);
    if !report.notes.is_empty() {
        page.section("Left out");
        for note in report.notes {
            page.small(note);
        }
        page.end_section();
    }
    definitions(page);
}

fn outliers(page: &mut Page, report: &CalibrationReport<'_>) {
    page.section("Points rejected");
    let mut rows: Vec<(f64, &characterise::calibration::Outlier)> = report
        .calibration
        .outliers
        .iter()
        .map(|o| (o.error_px.map_or(f64::INFINITY, |[x, y]| (x * x + y * y).sqrt()), o))
        .collect();
    if rows.is_empty() {
        page.small("None.");
        return page.end_section();
    }
    rows.sort_by(|a, b| b.0.total_cmp(&a.0).then((a.1.view, a.1.index).cmp(&(b.1.view, b.1.index))));
    page.put(format_args!(
        "<div class=\"scroll\"><table><thead><tr><th>Pose</th><th>Device</th><th class=\"n\">Point (column,row)</th>\
         <th class=\"n\">Off by, px</th></tr></thead><tbody>\n"
    ));
    for (length, outlier) in rows.iter().take(LISTED) {
        let view = &report.observations.views[outlier.view];
        let off = if length.is_finite() { format!("{length:.3}") } else { "behind the device".to_owned() };
        page.put(format_args!(
            "<tr><td>{}</td><td>{}</td><td class=\"n\">{}</td><td class=\"n\">{off}</td></tr>\n",
            Text(report.pose_name(view.pose)),
            Text(&report.observations.devices[view.device].name),
            report.point_name(outlier.index)
        ));
    }
    page.put(format_args!("</tbody></table></div>\n"));
    if rows.len() > LISTED {
        page.small(&format!("The {LISTED} largest of {}; --json lists all.", rows.len()));
    }
    page.end_section();
}

fn definitions(page: &mut Page) {
    page.section("Definitions");
    page.put(format_args!("<dl class=\"terms\">\n"));
    for (term, meaning) in [
        (
            "Reprojection error",
            "Root mean square distance of seen and modelled pixel over all points used, in px of the device. √2 times the \
          standard deviation of one coordinate.",
        ),
        (
            "Held-out pose",
            "A pose that is left out of the adjustment; afterwards only its six parameters are solved, with the rig held.",
        ),
        (
            "Predicted",
            "From the noise of the points and the covariance of the adjustment, propagated to the same quantity.",
        ),
        (
            "χ²",
            "Squared difference of both halves' parameters in units of their joint covariance: about the number of parameters when model and \
          uncertainties are right.",
        ),
        (
            "Projector",
            "Treated as an inverse camera: its pixels come from the phase at the points of the target.",
        ),
        ("Uncertainty", "Standard uncertainty, k = 1, unless U is written: k = 2."),
        (
            "Scale",
            "Comes from the pitch of the target alone. Its relative uncertainty enters every length and no figure here; --check-length \
          compares it with another length.",
        ),
    ] {
        page.put(format_args!("<dt>{}</dt><dd>{}</dd>\n", Text(term), Text(meaning)));
    }
    page.put(format_args!("</dl>\n"));
    page.end_section();
}
