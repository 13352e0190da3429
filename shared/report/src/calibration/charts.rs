//! Error of each image as bars, and how the residuals are distributed.

use characterise::calibration::ViewReport;
use fringe::math::exp;

use super::super::number::ticks;
use super::super::page::{Page, Text};
use super::super::svg::{self, Anchor};
use super::{CalibrationReport, kind};

/// Bars of a histogram over ± [`RANGE`] standard deviations.
const BINS: usize = 40;

/// Half width of a histogram, standard deviations.
const RANGE: f64 = 5.0;

/// A row of bars for each device.
pub fn images(page: &mut Page, report: &CalibrationReport<'_>) {
    page.section("Error of each image");
    page.put(format_args!(
        "<ul class=\"legend\"><li><i style=\"background:#0b5cad\"></i>adjusted</li><li><i style=\"background:#ad1f1f\"></i>more than \
         1.5 times its device's</li><li><i style=\"background:#1f2933;border-radius:50%\"></i>held out: the same image when its pose is \
         left out</li></ul>\n"
    ));
    for number in 0..report.calibration.devices.len() {
        bars(page, report, number);
    }
    page.small("Named by pose. Bars that stand out: look at that image (--pictures) for blur, glare, or a target that moved.");
    page.end_section();
}

fn bars(page: &mut Page, report: &CalibrationReport<'_>, number: usize) {
    let device = &report.calibration.devices[number];
    let own: Vec<&ViewReport> = report.calibration.views.iter().filter(|v| v.device == number).collect();
    let held = |pose: usize| {
        let folds = report.held_out.ok()?.folds.iter().flat_map(|f| &f.views);
        folds.into_iter().find(|v| v.device == number && v.pose == pose).map(|v| v.rms_px)
    };
    let poses: Vec<usize> = (0..report.observations.poses.len())
        .filter(|p| own.iter().any(|v| v.pose == *p) || held(*p).is_some())
        .collect();
    let adjusted = |pose: usize| own.iter().find(|v| v.pose == pose).map(|v| v.rms_px);
    let highest = poses.iter().flat_map(|p| [adjusted(*p), held(*p)]).flatten().fold(1e-12, f64::max) * 1.08;
    let (base, top) = (112.0, 10.0);
    let y = |px: f64| base - (base - top) * (px / highest).min(1.0);
    let step = 850.0 / poses.len().max(1) as f64;
    page.put(format_args!("<div class=\"chart\">"));
    svg::open(page, "", [1000.0, 150.0], &format!("error of each image of {}", device.name));
    svg::styled_text(page, [0.0, 58.0], 14.0, Anchor::Start, "font-weight=\"600\"", &device.name);
    svg::text(page, [0.0, 75.0], 12.0, Anchor::Start, &format!("{}, px", kind(device.kind)));
    let (values, digits) = ticks(0.0, highest, 3);
    for value in values {
        svg::grid_line(page, [140.0, 1000.0], y(value), 12.0, &format!("{value:.digits$}"));
    }
    // Names of all images where they fit, else of every second, third …
    let every = (58.0 / step).ceil().max(1.0) as usize;
    for (place, pose) in poses.iter().enumerate() {
        let left = 145.0 + step * place as f64;
        if let Some(px) = adjusted(*pose) {
            let colour = if px > 1.5 * device.rms_reprojection_px { "#ad1f1f" } else { "#0b5cad" };
            page.put(format_args!(
                "<rect x=\"{left:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{:.1}\" fill=\"{colour}\"><title>{}: {px:.4} px</title></rect>\n",
                y(px),
                step * 0.78,
                base - y(px),
                Text(report.pose_name(*pose))
            ));
        }
        if let Some(px) = held(*pose) {
            page.put(format_args!(
                "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"3\" fill=\"#1f2933\"/>\n",
                left + 0.39 * step,
                y(px)
            ));
        }
        if place % every == 0 {
            let name: String = report.pose_name(*pose).chars().take(12).collect();
            svg::text(page, [left + 0.39 * step, base + 15.0], 11.0, Anchor::Middle, &name);
        }
    }
    svg::line(page, [[140.0, base], [1000.0, base]], &format!("stroke=\"{}\"", svg::INK));
    svg::close(page);
    page.put(format_args!("</div>\n"));
}

/// A small histogram for each device.
pub fn histograms(page: &mut Page, report: &CalibrationReport<'_>) {
    page.section("Distribution of the residuals");
    page.put(format_args!("<div class=\"pictures\">\n"));
    for (number, device) in report.calibration.devices.iter().enumerate() {
        let sd = device.rms_reprojection_px * std::f64::consts::FRAC_1_SQRT_2;
        let views = report.calibration.views.iter().filter(|v| v.device == number);
        let errors: Vec<f64> = views
            .flat_map(|v| &v.residuals)
            .filter(|r| r.used)
            .filter_map(|r| r.error_px)
            .flatten()
            .map(|e| e / sd.max(1e-300))
            .collect();
        page.put(format_args!("<figure>"));
        histogram(page, &errors);
        let beyond = errors.iter().filter(|e| e.abs() > 3.0).count() as f64 / errors.len().max(1) as f64;
        page.put(format_args!(
            "<figcaption>{} {}: one standard deviation is {sd:.4} px; {:.2} % are beyond three (normal: 0.27 %)</figcaption></figure>\n",
            kind(device.kind),
            Text(&device.name),
            beyond * 100.0
        ));
    }
    page.put(format_args!("</div>\n"));
    page.small("Both coordinates of all points used, in standard deviations. Line: normal distribution. A higher middle with wider feet \
                means that some images are worse than others.");
    page.end_section();
}

fn histogram(page: &mut Page, errors: &[f64]) {
    let mut bins = [0_u32; BINS];
    for error in errors.iter().filter(|e| e.abs() < RANGE) {
        bins[(((error / RANGE + 1.0) * 0.5 * BINS as f64) as usize).min(BINS - 1)] += 1;
    }
    let expected = |at: f64| {
        errors.len() as f64 * 2.0 * RANGE / BINS as f64 * exp(-0.5 * at * at) / std::f64::consts::TAU.sqrt()
    };
    let highest = bins.iter().copied().map(f64::from).fold(expected(0.0), f64::max).max(1.0);
    let (width, base) = (360.0, 150.0);
    let y = |n: f64| base - 140.0 * n / highest;
    let x = |at: f64| (at / RANGE + 1.0) * 0.5 * width;
    svg::open(page, "", [width, 172.0], "histogram of residuals");
    let step = width / BINS as f64;
    for (i, n) in bins.iter().enumerate().filter(|(_, n)| **n > 0) {
        let top = y(f64::from(*n));
        svg::rectangle(page, [step * i as f64, top], [step - 0.6, base - top], "#9fc1e3", "");
    }
    let curve = (0..=100).map(|i| {
        let at = RANGE * (f64::from(i) / 50.0 - 1.0);
        [x(at), y(expected(at))]
    });
    svg::line(page, curve, &format!("stroke=\"{}\" stroke-width=\"1.5\"", svg::INK));
    svg::line(page, [[0.0, base], [width, base]], &format!("stroke=\"{}\"", svg::INK));
    for at in [-4, -2, 0, 2, 4] {
        let text = if at < 0 { format!("−{}", -at) } else { at.to_string() };
        svg::text(page, [x(f64::from(at)), 167.0], 13.0, Anchor::Middle, &text);
    }
    svg::close(page);
}
