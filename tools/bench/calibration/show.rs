//! Prints the tables of the benchmark.

use super::Report;
use super::bars::SpacingReport;
use super::scatter::ScatterReport;

/// Prints every table of the report.
pub fn print(report: &Report) {
    println!("points in the images, found − true");
    for c in &report.corners {
        println!(
            "  {:10} {:>6} points, mean ({:+.4}, {:+.4}) px, sd ({:.4}, {:.4}) px, {:.2} of the stated sd, correlation of \
             neighbours {:+.2}",
            c.devices,
            c.points,
            c.mean_px[0],
            c.mean_px[1],
            c.sd_px[0],
            c.sd_px[1],
            c.in_standard_deviations,
            c.correlation
        );
    }
    for trial in &report.from_images {
        println!(
            "\ncalibration from images, seed {}: {} poses, sigma0 {:.3}, {} outliers, target misfit {:.2}",
            trial.seed, report.plan.poses, trial.sigma0, trial.outliers, trial.target_misfit
        );
        for d in &trial.devices {
            println!(
                "  {:6} reprojection rms {:.4} px, mean {:.4} px, {} views, {} points",
                d.name, d.rms_reprojection_px, d.mean_reprojection_px, d.views, d.points
            );
        }
        spacings("  spacing of spheres at 120 mm, by geometry", &trial.spacing);
    }
    if let Some(scatter) = &report.image_scatter {
        parameters("parameters from images", scatter);
    }
    if let Some(scatter) = &report.drawn_scatter {
        parameters("parameters from drawn errors", scatter);
        spacings("spacing of spheres at 120 mm, all drawn trials, by geometry", &report.drawn_spacing);
    }
    measured(report);
    let t = &report.time;
    println!(
        "\n{} poses × 4 cameras: detection {:.2} s on one core ({:.0} ms per image), adjustment {:.2} s; with two projectors \
         {:.2} s",
        t.poses, t.detection_s, t.detection_ms_per_image, t.adjustment_4_cameras_s, t.adjustment_all_s
    );
}

fn parameters(what: &str, scatter: &ScatterReport) {
    let ok = (scatter.chi_square - scatter.degrees_of_freedom as f64).abs() < scatter.half_interval;
    println!(
        "\n{what}, {} trials: χ² {:.0} of {} degrees of freedom, 95 % interval ± {:.0}: {}",
        scatter.trials,
        scatter.chi_square,
        scatter.degrees_of_freedom,
        scatter.half_interval,
        if ok { "inside" } else { "outside" }
    );
    println!("  {:22} {:10} {:>18} {:>12}", "", "", "error/predicted sd", "rms error");
    for g in &scatter.groups {
        println!("  {:22} {:10} {:>18.3} {:>12.6}", g.name, g.devices, g.in_standard_deviations, g.rms_error);
    }
}

fn spacings(what: &str, pairs: &[SpacingReport]) {
    println!("{what}");
    for p in pairs {
        println!(
            "    {}: {} bars, mean {:+.2} µm, rms {:.2} µm, max {:.2} µm; predicted u {:.2} µm rms, {:.2} µm max; 4 µm kept by {}",
            p.pair,
            p.bars,
            p.mean_mm * 1e3,
            p.rms_mm * 1e3,
            p.max_mm * 1e3,
            p.u_rms_mm * 1e3,
            p.u_max_mm * 1e3,
            p.within_goal
        );
    }
}

fn measured(report: &Report) {
    if report.measured.is_empty() {
        return;
    }
    println!(
        "\nspacing measured (120 mm), error in µm: each pair, fused | the same frames with the true rig"
    );
    let cells = |values: &[Option<f64>]| {
        let cell = |v: &Option<f64>| v.map_or_else(|| "     –".to_owned(), |v| format!("{:+6.2}", v * 1e3));
        values.iter().map(cell).collect::<Vec<_>>().join(" ")
    };
    for bar in &report.measured {
        let [x, y, z] = bar.direction;
        println!(
            "  along ({x:+.2}, {y:+.2}, {z:+.2}) at z {:5.1}: {} | {}",
            bar.middle_mm[2],
            cells(&bar.calibrated_mm),
            cells(&bar.true_rig_mm)
        );
    }
}
