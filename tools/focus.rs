//! `fringetool focus`: best focus and depth of focus from images of a projected checkerboard.

use crate::Outcome;
use crate::progress::Progress;
use crate::report::{check_outputs, emit};
use anyhow::{Context, Result, bail};
use characterise::focus::curve::{Focus, FocusPoint, evaluate};
use characterise::response::Roi;
use files::recording::Recording;
use fringe::frame::Frame;
use report::plot::{Mark, Plot, Series, Sheet, write_sheet};
use std::path::PathBuf;

#[derive(clap::Args)]
pub struct Args {
    /// Recordings, one a position: the first frame of the first projector and camera counts.
    recordings: Vec<PathBuf>,
    /// Images instead of a recording, one for each position: patterns with `*`, in the order of the numbers in the names.
    #[arg(long, value_name = "PATTERN", num_args = 1..)]
    images: Vec<String>,
    /// Position of each image, mm: z1,z2,… or first:last:step.
    #[arg(long, value_name = "LIST", allow_hyphen_values = true)]
    positions: String,
    /// Region with the checkerboard, px; by default the middle, up to 512 × 512 px.
    #[arg(long, value_name = "x,y,w,h")]
    roi: Option<Roi>,
    /// Fraction of the largest contrast that bounds the depth of focus, 0 … 1.
    #[arg(long, value_name = "F", default_value_t = 0.5)]
    fraction: f64,
    /// Write a report with the contrast curve (HTML).
    #[arg(long, alias = "html", value_name = "FILE")]
    report: Option<PathBuf>,
    /// Write the result as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Runs the command; the outcome becomes the exit code.
pub fn run(args: &Args) -> Result<Outcome> {
    let outputs = [("--report", args.report.as_deref()), ("--json", args.json.as_deref())];
    let inputs: Vec<_> = args.recordings.iter().map(PathBuf::as_path).collect();
    check_outputs(&outputs, &inputs, None)?;
    let positions = crate::numbers::list("--positions", &args.positions)?;
    let (names, frames) = read(args, positions.len())?;
    let pictures: Vec<_> = positions.iter().copied().zip(frames.iter().map(Frame::view)).collect();
    let what = names.first().cloned().unwrap_or_default();
    let focus = evaluate(&pictures, args.roi, args.fraction)
        .with_context(|| format!("{what} and {} more", names.len().saturating_sub(1)))?;
    print(&focus);
    if let Some(path) = &args.report {
        write_sheet(path, &sheet(&focus, &names))?;
        println!("{}", path.display());
    }
    let mut json = serde_json::to_value(&focus)?;
    let files: Vec<_> = names.iter().zip(&positions).collect();
    json["files"] = files.iter().map(|(n, z)| serde_json::json!({ "file": n, "position_mm": z })).collect();
    emit(args.json.as_deref(), &json)?;
    Ok(Outcome::Done)
}

/// Names and frames, one a position.
fn read(args: &Args, count: usize) -> Result<(Vec<String>, Vec<Frame>)> {
    let mut files: Vec<PathBuf> = args.recordings.clone();
    if files.is_empty() == args.images.is_empty() {
        bail!("give either recordings or --images, with one position each");
    }
    for pattern in &args.images {
        files.extend(crate::glob::expand(pattern).with_context(|| format!("--images {pattern}"))?);
    }
    if files.len() != count {
        bail!("{} images, but --positions: {count}; give one position for each image", files.len());
    }
    let mut progress = Progress::new(count, "reading");
    let mut frames = Vec::with_capacity(count);
    for file in &files {
        frames.push(if args.images.is_empty() {
            first_frame(&Recording::open(file)?)?
        } else {
            files::image_file::read_foreign_frame(file, None)?
        });
        progress.step();
    }
    Ok((files.iter().map(|file| file.display().to_string()).collect(), frames))
}

fn first_frame(recording: &Recording) -> Result<Frame> {
    let projector = recording.projectors.first().context("the recording has no projector")?;
    let camera = projector.cameras.first().context("the recording has no camera")?;
    Ok(recording.load(&projector.name, &camera.name, 0)?)
}

/// Fraction of saturated pixels in the region above which a note is printed.
const MOST_SATURATED: f64 = 0.01;

fn print(focus: &Focus) {
    println!("region {}", focus.roi);
    for point in &focus.curve {
        println!(
            "  {:10.3} mm: contrast {:.5} ({:5.1} %), squares of {:.2} px, mean {:.1} DN{}",
            point.position_mm,
            point.carrier.contrast,
            100.0 * point.normalised,
            point.carrier.square_px(),
            point.carrier.mean_dn,
            if point.carrier.saturated > 0 {
                format!(", {} px saturated", point.carrier.saturated)
            } else {
                String::new()
            }
        );
    }
    let clipped = |p: &&FocusPoint| p.carrier.saturated as f64 > MOST_SATURATED * focus.roi.pixels() as f64;
    if let Some(point) = focus.curve.iter().find(clipped) {
        eprintln!(
            "at {:.3} mm {} of {} pixels saturate, which lowers the contrast there and bends the curve; lower the exposure",
            point.position_mm,
            point.carrier.saturated,
            focus.roi.pixels()
        );
    }
    match (focus.best_focus_mm, focus.u_best_focus_mm) {
        (Some(best), Some(u)) => println!("best focus {best:.3} mm, u {u:.3} mm"),
        _ => println!(
            "the curve has no maximum between the positions; the sharpest image is at {:.3} mm",
            focus.sharpest_mm
        ),
    }
    println!("{}", depth(focus));
}

fn depth(focus: &Focus) -> String {
    let percent = 100.0 * focus.fraction;
    match (focus.depth_of_focus_mm, focus.near_mm, focus.far_mm) {
        (Some(depth), Some(near), Some(far)) => {
            format!(
                "depth of focus at {percent:.0} % of the maximum: {depth:.3} mm, from {near:.3} to {far:.3} mm"
            )
        }
        _ => format!(
            "depth of focus at {percent:.0} % of the maximum: at least {:.3} mm; its ends are not within the positions",
            focus.depth_at_least_mm
        ),
    }
}

fn sheet(focus: &Focus, names: &[String]) -> Sheet {
    let top = focus.curve.iter().fold(0.0, |m: f64, p| m.max(p.carrier.contrast));
    let measured = focus.curve.iter().map(|p| (p.position_mm, p.normalised)).collect();
    let (first, last) = (focus.curve[0].position_mm, focus.curve[focus.curve.len() - 1].position_mm);
    let grid = (0..=400).map(|i| first + (last - first) * f64::from(i) / 400.0);
    let mut series = Vec::new();
    if let Some(fit) = &focus.fit {
        let points = grid.map(|z| (z, fit.contrast(z) / top)).collect();
        series.push(Series { name: "fitted Gaussian".into(), mark: Mark::Line, points });
    }
    series.push(Series { name: "measured".into(), mark: Mark::Dots, points: measured });
    let ends = vec![(first, focus.fraction), (last, focus.fraction)];
    series.push(Series { name: "limit of the depth of focus".into(), mark: Mark::Line, points: ends });
    let named = [("near end", focus.near_mm), ("best focus", focus.best_focus_mm), ("far end", focus.far_mm)];
    let marks = named.into_iter().filter_map(|(name, at)| Some((at?, name.to_owned()))).collect();
    let best = match (focus.best_focus_mm, focus.u_best_focus_mm) {
        (Some(best), Some(u)) => format!("{best:.3} mm, {u:.3} mm"),
        _ => "not between the positions".into(),
    };
    let facts = vec![
        ("Best focus, standard uncertainty".into(), best),
        ("Depth of focus".into(), depth(focus)),
        ("Region (x, y, width, height)".into(), format!("{} px", focus.roi)),
    ];
    let plot = Plot {
        title: "Contrast of the projected checkerboard".into(),
        x_label: "Position, mm".into(),
        y_label: "Contrast, relative to the largest".into(),
        log_y: false,
        series,
        marks,
        note: "Contrast: amplitude of the strongest component of the 2D Fourier spectrum (Hann window, mean removed) over \
               the mean grey value."
            .into(),
    };
    let subtitle = match names {
        [only] => only.clone(),
        [first, .., last] => format!("{first} … {last}"),
        [] => String::new(),
    };
    Sheet { title: "Depth of focus".into(), subtitle, facts, plots: vec![plot], notes: Vec::new() }
}
