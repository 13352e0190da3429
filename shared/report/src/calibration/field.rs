//! Residuals over the image of each device: every one, and their means in cells, where only what is systematic stays.

use characterise::calibration::Residual;

use super::super::colour::{ColourMap, hex};
use super::super::number::round_up;
use super::super::page::{Page, Text};
use super::super::svg;
use super::{CalibrationReport, kind};

/// Cells along the wider side of an image: wide enough for some ten points each with the usual twenty poses.
const ACROSS: usize = 12;

/// A mean of fewer residuals is no mean.
const FEWEST: usize = 4;

/// Width of a drawing.
const WIDTH: f64 = 520.0;

/// Means of residuals in cells of an image.
pub struct Cells {
    /// Cells along a row.
    pub columns: usize,
    /// Number of rows of cells.
    pub rows: usize,
    /// Row by row: number and mean residual, px.
    pub means: Vec<(usize, [f64; 2])>,
    /// Standard deviation of one coordinate of a residual, px.
    pub sd_px: f64,
    /// Root mean square length of the means over well-filled cells, corrected for noise, px.
    pub systematic_px: f64,
    /// Share of cells with a point.
    pub covered: f64,
}

fn used<'a>(
    report: &'a CalibrationReport<'_>,
    device: usize,
) -> impl Iterator<Item = (&'a Residual, [f64; 2])> {
    let views = report.calibration.views.iter().filter(move |v| v.device == device);
    views.flat_map(|v| &v.residuals).filter(|r| r.used).filter_map(|r| Some((r, r.error_px?)))
}

/// The means of a device.
pub fn cells(report: &CalibrationReport<'_>, device: usize) -> Cells {
    let camera = &report.calibration.devices[device].camera;
    let (width, height) = (f64::from(camera.width_px), f64::from(camera.height_px));
    let share = |edge: f64| ((edge / width.max(height) * ACROSS as f64).round() as usize).max(1);
    let (columns, rows) = (share(width), share(height));
    let mut means = vec![(0, [0.0; 2]); columns * rows];
    let (mut squares, mut count) = (0.0, 0);
    for (residual, [dx, dy]) in used(report, device) {
        let cell = |v: f64, edge: f64, n: usize| (((v + 0.5) / edge * n as f64).max(0.0) as usize).min(n - 1);
        let at = cell(residual.pixel.y, height, rows) * columns + cell(residual.pixel.x, width, columns);
        means[at].0 += 1;
        means[at].1[0] += dx;
        means[at].1[1] += dy;
        squares += dx * dx + dy * dy;
        count += 1;
    }
    let variance = squares / f64::from(2 * count.max(1));
    let (mut excess, mut filled) = (0.0, 0);
    for (number, mean) in &mut means {
        let n = *number as f64;
        *mean = mean.map(|sum| sum / n.max(1.0));
        if *number >= FEWEST {
            excess += mean[0] * mean[0] + mean[1] * mean[1] - 2.0 * variance / n;
            filled += 1;
        }
    }
    let covered = means.iter().filter(|(n, _)| *n > 0).count() as f64 / means.len() as f64;
    let systematic_px = (excess / f64::from(filled.max(1))).max(0.0).sqrt();
    Cells { columns, rows, means, sd_px: variance.sqrt(), systematic_px, covered }
}

/// Writes the section on the residuals over the image.
pub fn section(page: &mut Page, report: &CalibrationReport<'_>) {
    page.section("Residuals over the image");
    page.small("Left: every residual (seen − modelled) of all poses; a good picture has short arrows in all directions, like noise. \
                Right: their means in cells; arrows that agree over neighbouring cells, on darker cells, are errors of the camera \
                model or of the target. A cell's colour is its mean over what noise alone would leave.");
    page.put(format_args!("<div class=\"pictures wide\">\n"));
    for (number, device) in report.calibration.devices.iter().enumerate() {
        let cells = cells(report, number);
        if cells.sd_px <= 0.0 {
            continue;
        }
        let (width, height) = (f64::from(device.camera.width_px), f64::from(device.camera.height_px));
        let scale = WIDTH / width;
        let heading = format!("{} {}", kind(device.kind), device.name);
        begin(page, &heading, height * scale);
        let long = 14.0 / (cells.sd_px * 1.414);
        page.put(format_args!("<path d=\""));
        for (residual, [dx, dy]) in used(report, number) {
            let (x, y) = ((residual.pixel.x + 0.5) * scale, (residual.pixel.y + 0.5) * scale);
            page.put(format_args!("M{x:.1} {y:.1}l{:.1} {:.1}", dx * long, dy * long));
        }
        page.put(format_args!("\" stroke=\"#0b5cad\" stroke-width=\"0.7\" fill=\"none\"/>\n"));
        key(page, height * scale, long);
        svg::close(page);
        page.put(format_args!(
            "<figcaption>{}: all residuals, rms {:.4} px</figcaption></figure>\n",
            Text(&heading),
            device.rms_reprojection_px
        ));
        means(page, &cells, &heading, height * scale);
    }
    page.put(format_args!("</div>\n"));
    scale_of_colours(page);
    page.end_section();
}

fn begin(page: &mut Page, heading: &str, height: f64) {
    page.put(format_args!("<figure>"));
    svg::open(page, "framed", [WIDTH, height + 26.0], &format!("residuals of {heading}"));
}

/// A line of known length below the picture.
fn key(page: &mut Page, height: f64, px_to_units: f64) {
    let px = round_up(24.0 / px_to_units);
    page.put(format_args!(
        "<rect x=\"0\" y=\"{height:.1}\" width=\"{WIDTH}\" height=\"26\" fill=\"#fff\"/><path d=\"M0 {height:.1}H{WIDTH}\" stroke=\"#d5dbe1\"/>\
         <path d=\"M8 {0:.1}h{1:.1}m0 -4v8m-{1:.1} 0v-8\" stroke=\"#1f2933\" stroke-width=\"1.5\" fill=\"none\"/>\
         <text x=\"{2:.1}\" y=\"{3:.1}\" font-size=\"13\">{px} px</text>\n",
        height + 13.0,
        px * px_to_units,
        16.0 + px * px_to_units,
        height + 18.0
    ));
}

fn means(page: &mut Page, cells: &Cells, heading: &str, height: f64) {
    begin(page, heading, height);
    let (w, h) = (WIDTH / cells.columns as f64, height / cells.rows as f64);
    // Long enough that a mean of a tenth of the noise is still seen.
    let long = 0.9 * w / (cells.sd_px * 1.414);
    for (i, (count, mean)) in cells.means.iter().enumerate() {
        let (x, y) = ((i % cells.columns) as f64 * w, (i / cells.columns) as f64 * h);
        let length = (mean[0] * mean[0] + mean[1] * mean[1]).sqrt();
        let colour = if *count < FEWEST {
            "#f0f1f3".to_owned()
        } else {
            hex(cell_colour(length / (cells.sd_px * (2.0 / *count as f64).sqrt())))
        };
        page.put(format_args!(
            "<rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{w:.2}\" height=\"{h:.2}\" fill=\"{colour}\" stroke=\"#fff\" stroke-width=\"0.6\"/>\n"
        ));
        if *count >= FEWEST {
            let (x, y) = (x + 0.5 * w, y + 0.5 * h);
            page.put(format_args!(
                "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"1.6\" fill=\"#1f2933\"/><path d=\"M{x:.1} {y:.1}l{:.1} {:.1}\" stroke=\"#1f2933\" \
                 stroke-width=\"1.6\"/>\n",
                mean[0] * long,
                mean[1] * long
            ));
        }
    }
    key(page, height, long);
    svg::close(page);
    page.put(format_args!(
        "<figcaption>{}: means in cells; systematic part {:.4} px; points in {:.0} % of the cells</figcaption></figure>\n",
        Text(heading),
        cells.systematic_px,
        cells.covered * 100.0
    ));
}

/// White at noise, red where the mean is four times what noise would leave.
fn cell_colour(times_noise: f64) -> [u8; 3] {
    ColourMap::Diverging.colour(0.5 + 0.34 * ((times_noise - 1.0) / 3.0).clamp(0.0, 1.0))
}

fn scale_of_colours(page: &mut Page) {
    page.put(format_args!("<ul class=\"legend\"><li>Mean over what noise leaves:</li>"));
    for times in [1.0, 2.0, 3.0, 4.0] {
        let more = if times == 4.0 { " and more" } else { "" };
        page.put(format_args!(
            "<li><i style=\"background:{}\"></i>{times}{more}</li>",
            hex(cell_colour(times))
        ));
    }
    page.put(format_args!(
        "<li><i style=\"background:#f0f1f3\"></i>fewer than {FEWEST} points: the lens is extrapolated</li></ul>\n"
    ));
}
