//! Each camera and projector in a row.

use super::super::number::count;
use super::super::page::{Page, Text};
use super::{CalibrationReport, kind};

/// Writes the section on the parameters of the devices.
pub fn section(page: &mut Page, report: &CalibrationReport<'_>) {
    page.section("Cameras and projectors");
    page.put(format_args!(
        "<div class=\"scroll\"><table><thead><tr><th>Device</th><th class=\"n\">Views</th><th class=\"n\">Points</th>\
         <th class=\"n\">Rejected</th><th class=\"n\">Error, px</th><th class=\"n\">Held out, px</th><th class=\"n\">Halves, px</th>\
         <th class=\"n\">Focal length, px</th><th class=\"n\">Principal point, px</th></tr></thead><tbody>\n"
    ));
    for (number, d) in report.calibration.devices.iter().enumerate() {
        let held = report.held_out.ok().and_then(|h| h.devices.get(number));
        let cross = report.cross.ok().and_then(|c| c.devices.get(number));
        let both = |pair: Option<(f64, f64)>| {
            pair.map_or_else(|| "–".to_owned(), |(found, predicted)| format!("{found:.4} ({predicted:.4})"))
        };
        let u = &d.standard_uncertainty;
        let [fx, fy] = d.camera.focal_px;
        let [cx, cy] = d.camera.principal_point_px;
        page.put(format_args!(
            "<tr><td>{}<span class=\"detail\">{}, {} × {} px</span></td><td class=\"n\">{}</td><td class=\"n\">{}</td>\
             <td class=\"n\">{}</td><td class=\"n\">{:.4}</td><td class=\"n\">{}</td><td class=\"n\">{}</td>\
             <td class=\"n\">{}<br>{}</td><td class=\"n\">{}<br>{}</td></tr>\n",
            Text(&d.name),
            kind(d.kind),
            d.camera.width_px,
            d.camera.height_px,
            d.views,
            count(d.points as u64),
            d.outliers,
            d.rms_reprojection_px,
            both(held.map(|h| (h.rms_px, h.predicted_px))),
            both(cross.map(|c| (c.rms_px, c.predicted_px))),
            with_u(fx, u[0]),
            with_u(fy, u[1]),
            with_u(cx, u[2]),
            with_u(cy, u[3]),
        ));
    }
    page.put(format_args!("</tbody></table></div>\n"));
    page.small("In brackets: what noise and covariance predict. ±: standard uncertainty (k = 1). Focal length and principal point \
                are x above y; they vary together with the position of the device, so that their own uncertainties look worse than the \
                measurement is.");
    page.end_section();
}

fn with_u(value: f64, u: f64) -> String {
    let digits = super::super::number::decimals(Some(u));
    format!("{value:.digits$} ± {u:.digits$}")
}
