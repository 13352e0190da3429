//! The table at the top: each figure with its meaning, the range of good values, and its rating.

use characterise::calibration::{CalibratedDevice, DeviceKind};

use super::super::number::count;
use super::super::page::{Page, Text};
use super::field;
use super::{CalibrationReport, kind};

/// Rates a figure: good up to `good`, to be looked at up to `bad`, bad beyond.
fn rate(value: f64, good: f64, bad: f64) -> Mark {
    match value {
        v if v <= good => Mark::Good,
        v if v <= bad => Mark::Look,
        _ => Mark::Bad,
    }
}

/// Rating at the end of a row.
#[derive(Clone, Copy)]
enum Mark {
    Good,
    Look,
    Bad,
    None,
}

impl Mark {
    fn html(self) -> (&'static str, &'static str) {
        match self {
            Self::Good => ("pass", "good"),
            Self::Look => ("indeterminate", "look closer"),
            Self::Bad => ("fail", "not good"),
            Self::None => ("none", ""),
        }
    }
}

/// One row of the summary.
struct Figure {
    name: &'static str,
    words: &'static str,
    value: String,
    good: &'static str,
    mark: Mark,
}

/// Writes the summary section.
pub fn section(page: &mut Page, report: &CalibrationReport<'_>) {
    let figures = figures(report);
    page.section("Summary");
    page.put(format_args!("<p>{}</p>\n", Text(&overall(&figures))));
    page.put(format_args!(
        "<div class=\"scroll\"><table><thead><tr><th>Figure</th><th>This rig</th><th>A good value</th><th></th></tr></thead><tbody>\n"
    ));
    for figure in figures {
        let (class, word) = figure.mark.html();
        page.put(format_args!(
            "<tr><td>{}<span class=\"detail\">{}</span></td><td>{}</td><td>{}</td><td><span class=\"mark {class}\">{word}</span></td></tr>\n",
            Text(figure.name),
            Text(figure.words),
            Text(&figure.value),
            Text(figure.good)
        ));
    }
    page.put(format_args!("</tbody></table></div>\n"));
    page.end_section();
}

/// One sentence for the whole table.
fn overall(figures: &[Figure]) -> String {
    let names = |wanted: &str| -> Vec<&str> {
        figures.iter().filter(|f| f.mark.html().1 == wanted).map(|f| f.name).collect()
    };
    let (bad, look) = (names("not good"), names("look closer"));
    match (bad.is_empty(), look.is_empty()) {
        (true, true) => "All evaluated figures are good.".to_owned(),
        (true, false) => format!("The rig can be used; look closer at: {}.", look.join("; ")),
        (false, _) => {
            let more = if look.is_empty() {
                String::new()
            } else {
                format!(" Look closer at: {}.", look.join("; "))
            };
            format!(
                "Stated uncertainties should not be relied upon before this is understood: {}.{more}",
                bad.join("; ")
            )
        }
    }
}

fn figures(report: &CalibrationReport<'_>) -> Vec<Figure> {
    let mut figures = vec![spacing(report)];
    figures
        .extend([DeviceKind::Camera, DeviceKind::Projector].into_iter().filter_map(|k| residual(report, k)));
    figures.extend([
        held_out(report),
        between_poses(report),
        halves(report),
        systematic(report),
        coverage(report),
        rejected(report),
    ]);
    figures.extend(report.calibration.warp.map(|w| Figure {
        name: "Bend of the target",
        words: "How far the middle of the board stands out over its edges, along x and y. It was found and taken into account.",
        value: format!(
            "{:+.1} ± {:.1} µm and {:+.1} ± {:.1} µm",
            w.x_mm * 1e3, w.u_mm[0] * 1e3, w.y_mm * 1e3, w.u_mm[1] * 1e3
        ),
        good: "small against the board; below 0.1 % of its length",
        mark: Mark::None,
    }));
    figures
}

fn spacing(report: &CalibrationReport<'_>) -> Figure {
    let value = report.spacing.map_or_else(
        || format!("no pair sees a bar of {:.0} mm within the volume", report.spacing_mm),
        |s| {
            format!(
                "{:.2} µm typical, {:.2} µm worst, for {:.0} mm between centres",
                s.rms_mm * 1e3,
                s.worst_mm * 1e3,
                report.spacing_mm
            )
        },
    );
    Figure {
        name: "Uncertainty of a sphere spacing",
        words: "Standard uncertainty that the calibration alone gives to the distance of two spheres anywhere in the volume. \
                Noise of a measurement and the certificate of the target's pitch come on top.",
        value,
        good: "a tenth of the tightest tolerance to be measured, or less",
        mark: Mark::None,
    }
}

fn residual(report: &CalibrationReport<'_>, wanted: DeviceKind) -> Option<Figure> {
    let devices = || report.calibration.devices.iter().filter(|d| d.kind == wanted);
    let worst = devices().max_by(|a, b| a.rms_reprojection_px.total_cmp(&b.rms_reprojection_px))?;
    let (good, bad, name, text) = match wanted {
        DeviceKind::Camera => (
            0.1,
            0.3,
            "Reprojection error, cameras",
            "below 0.1 px; 0.01 to 0.05 px with sharp, low-noise images",
        ),
        DeviceKind::Projector => (0.1, 0.3, "Reprojection error, projectors", "below 0.1 px"),
    };
    Some(Figure {
        name,
        words: "Root mean square distance between where a point was seen and where the rig puts it. Small is necessary, but \
                says nothing about places where no point was.",
        value: format!("{:.4} px ({}, the worst)", worst.rms_reprojection_px, worst.name),
        good: text,
        mark: rate(worst.rms_reprojection_px, good, bad),
    })
}

fn held_out(report: &CalibrationReport<'_>) -> Figure {
    let ratio = |d: &&characterise::calibration::HeldOutDevice| d.rms_px / d.predicted_px.max(1e-300);
    let (value, mark) = match report.held_out {
        Err(why) => (format!("not done: {why}"), Mark::None),
        Ok(held) => match held.devices.iter().max_by(|a, b| ratio(a).total_cmp(&ratio(b))) {
            None => ("no device".to_owned(), Mark::None),
            Some(worst) => (
                format!(
                    "{:.2} times the prediction ({}: {:.4} px against {:.4} px)",
                    ratio(&worst),
                    worst.name,
                    worst.rms_px,
                    worst.predicted_px
                ),
                rate(ratio(&worst), 1.15, 1.5),
            ),
        },
    };
    Figure {
        name: "Held-out poses",
        words: "Poses that had no say in the calibration are predicted by it. The error there, over what noise and \
                stated uncertainty explain.",
        value,
        good: "0.9 to 1.15",
        mark,
    }
}

fn between_poses(report: &CalibrationReport<'_>) -> Figure {
    let between = report.held_out.ok().and_then(|held| held.between_poses(report.calibration));
    let worst = between.iter().flatten().max_by(|a, b| a.over_stated.total_cmp(&b.over_stated));
    let (value, mark) = match worst {
        None => ("not done: it takes three groups of poses that are held out".to_owned(), Mark::None),
        Some(worst) => {
            let [fx, fy, ..] = worst.standard_uncertainty;
            let reported = format!(
                "{:.2} of the stated uncertainties ({}: focal lengths {fx:.3} and {fy:.3} px)",
                worst.over_stated, worst.name
            );
            (reported, rate(worst.over_stated, 1.7, 2.5))
        }
    };
    Figure {
        name: "Between groups of poses",
        words: "How far focal lengths and principal points move when groups of poses are left out (jackknife), over what the \
                stated uncertainties say. What the points of a pose have in common, as a board that bends, makes it large.",
        value,
        good: "0.5 to 1.7; beyond 2.5 use the uncertainty between poses",
        mark,
    }
}

fn halves(report: &CalibrationReport<'_>) -> Figure {
    let (value, mark) = match report.cross {
        Err(why) => (format!("not done: {why}"), Mark::None),
        Ok(cross) => {
            let ratio =
                |d: &characterise::calibration::DeviceDifference| d.rms_px / d.predicted_px.max(1e-300);
            let worst = cross.devices.iter().max_by(|a, b| ratio(a).total_cmp(&ratio(b)));
            let n = cross.degrees_of_freedom as f64;
            let reported = worst.map_or_else(String::new, |w| {
                format!("{} differs by {:.4} px, predicted {:.4} px; ", w.name, w.rms_px, w.predicted_px)
            });
            let limit = n + 1.96 * (2.0 * n).sqrt();
            let mark = rate(cross.chi_square, limit, 2.0 * n);
            (format!("{reported}χ² {:.0} for {n:.0} parameters", cross.chi_square), mark)
        }
    };
    Figure {
        name: "Two independent halves",
        words: "The poses are split and both halves calibrated alone. If they differ by more than their uncertainties say, the \
                camera model or the target is wrong, however small the reprojection error.",
        value,
        good: "χ² about the number of parameters; below it is fine",
        mark,
    }
}

fn systematic(report: &CalibrationReport<'_>) -> Figure {
    let share = |d: &CalibratedDevice, number: usize| {
        field::cells(report, number).systematic_px / d.rms_reprojection_px.max(1e-300)
    };
    let devices = report.calibration.devices.iter().enumerate();
    let worst = devices.map(|(i, d)| (share(d, i), d, i)).max_by(|a, b| a.0.total_cmp(&b.0));
    let (value, mark) = worst.map_or_else(
        || ("no device".to_owned(), Mark::None),
        |(share, d, i)| {
            let px = field::cells(report, i).systematic_px;
            (
                format!("{px:.4} px ({} {}, {:.0} % of its error)", kind(d.kind), d.name, share * 100.0),
                rate(share, 0.3, 0.6),
            )
        },
    );
    Figure {
        name: "Systematic part of the residuals",
        words: "What stays when residuals of all poses are averaged in each part of the image, noise taken off: errors of the \
                camera model that more poses will not remove.",
        value,
        good: "below 30 % of the reprojection error",
        mark,
    }
}

fn coverage(report: &CalibrationReport<'_>) -> Figure {
    let devices = report.calibration.devices.iter().enumerate().filter(|(_, d)| d.kind == DeviceKind::Camera);
    let least = devices.map(|(i, d)| (field::cells(report, i).covered, d)).min_by(|a, b| a.0.total_cmp(&b.0));
    let (value, mark) = least.map_or_else(
        || ("no camera".to_owned(), Mark::None),
        |(share, d)| {
            let mark = if share >= 0.75 {
                Mark::Good
            } else if share >= 0.5 {
                Mark::Look
            } else {
                Mark::Bad
            };
            (format!("{:.0} % ({}, the least)", share * 100.0, d.name), mark)
        },
    );
    Figure {
        name: "Image covered by points",
        words: "Share of the image in which the target was seen in some pose. Outside, the lens model is extrapolated.",
        value,
        good: "75 % or more, with the corners",
        mark,
    }
}

fn rejected(report: &CalibrationReport<'_>) -> Figure {
    let points: usize = report.calibration.devices.iter().map(|d| d.points + d.outliers).sum();
    let outliers = report.calibration.outliers.len();
    let share = outliers as f64 / points.max(1) as f64;
    Figure {
        name: "Points rejected",
        words: "Points whose deviation noise cannot explain; they were not used. Each is listed below.",
        value: format!("{} of {} ({:.2} %)", count(outliers as u64), count(points as u64), share * 100.0),
        good: "below 0.5 %",
        mark: rate(share, 0.005, 0.03),
    }
}
