//! Heights of an object over the reference plane.

use super::{Which, decode};
use crate::Outcome;
use crate::report::{check_outputs, emit};
use anyhow::{Context, Result, bail};
use characterise::reference_plane::Heights;
use files::npy::{self, Raster};
use files::plane_file::{PLANE_FILE, read_planes};
use files::recording::RECORDING_FILE;
use files::rig_file::read_rig;
use fringe::cloud::Point;
use fringe::geometry::camera::Camera;
use fringe::math::statistics::median;
use nalgebra::Point2;
use report::ColourMap;
use report::picture::{Range, Scalar, scalar_png};
use std::path::{Path, PathBuf};

#[derive(clap::Args)]
pub struct Args {
    /// Folder of the recording.
    recording: PathBuf,
    /// Folder of the calibration.
    #[arg(long, value_name = "DIR")]
    calibration: PathBuf,
    /// Write the heights in mm, NaN where unknown (`.npy`).
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Write an image of the heights (PNG).
    #[arg(long, value_name = "FILE")]
    picture: Option<PathBuf>,
    /// Write a point cloud (PLY, docs/formats.md); requires --rig, whose plane z = 0 must be the reference plane.
    #[arg(long, value_name = "FILE", requires = "rig")]
    cloud: Option<PathBuf>,
    /// Rig file (TOML, docs/formats.md) with the camera, for the lateral coordinates of --cloud.
    #[arg(long, value_name = "FILE", requires = "cloud")]
    rig: Option<PathBuf>,
    /// Write the result as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Runs the command; the outcome becomes the exit code.
pub fn run(args: &Args) -> Result<Outcome> {
    let (recording, planes) = (args.recording.join(RECORDING_FILE), args.calibration.join(PLANE_FILE));
    let mut inputs: Vec<&Path> = vec![&recording, &planes];
    inputs.extend(args.rig.as_deref());
    let outputs = [
        ("--out", args.out.as_deref()),
        ("--picture", args.picture.as_deref()),
        ("--cloud", args.cloud.as_deref()),
        ("--json", args.json.as_deref()),
    ];
    check_outputs(&outputs, &inputs, None)?;
    let file = read_planes(&args.calibration)?;
    let which = Which {
        projector: file.projector.clone(),
        camera: file.camera.clone(),
        axis: file.calibration.info.axis,
    };
    let map = decode(&args.recording, &which)?;
    let heights = file
        .calibration
        .measure(&map.view())
        .with_context(|| format!("{} with {}", args.recording.display(), args.calibration.display()))?;
    let points = match (&args.cloud, &args.rig) {
        (Some(cloud), Some(rig)) => Some((cloud, cloud_of(rig, &file.camera, &heights, &map.modulation)?)),
        _ => None,
    };
    write(args, &heights, points)?;
    print_report(args, &heights)
}

fn write(args: &Args, heights: &Heights, points: Option<(&PathBuf, Vec<Point>)>) -> Result<()> {
    let (width_px, height_px) = (heights.width_px, heights.height_px);
    if let Some(path) = &args.out {
        npy::write(path, &Raster { width_px, height_px, values: heights.height_mm.clone() })?;
    }
    if let Some(path) = &args.picture {
        let picture = Scalar {
            width_px,
            height_px,
            values: &heights.height_mm,
            valid: None,
            map: ColourMap::Sequential,
            range: Range::Inner,
            unit: "mm",
        };
        let png = scalar_png(&picture).with_context(|| path.display().to_string())?;
        files::atomic::write(path, &png)?;
    }
    if let Some((path, points)) = points {
        let calibration = args.calibration.display().to_string();
        let software = concat!("fringetool ", env!("CARGO_PKG_VERSION"));
        let comments = [("method", "reference-plane"), ("calibration", &calibration), ("software", software)];
        files::ply::write_cloud(path, &points, &comments)?;
    }
    Ok(())
}

fn print_report(args: &Args, heights: &Heights) -> Result<Outcome> {
    let known = || heights.height_mm.iter().copied().filter(|z| z.is_finite()).map(f64::from);
    let count = known().count();
    let (low, high) = known().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), z| (l.min(z), h.max(z)));
    if count == 0 {
        bail!(
            "{}: no pixel has a height; {} are beyond the calibrated range; check that nothing was moved since the calibration",
            args.recording.display(),
            heights.beyond
        );
    }
    let mut sigma: Vec<f32> = heights.sigma_mm.iter().copied().filter(|s| s.is_finite()).collect();
    let sigma_mm = median(&mut sigma);
    println!(
        "{}: {count} heights, {low:.3} … {high:.3} mm; noise {} µm (median); {} beyond the calibrated range",
        args.recording.display(),
        sigma_mm.map_or_else(|| "–".into(), |s| format!("{:.1}", s * 1e3)),
        heights.beyond
    );
    let json = serde_json::json!({
        "heights": count,
        "lowest_mm": low,
        "highest_mm": high,
        "sigma_median_mm": sigma_mm,
        "beyond": heights.beyond,
    });
    emit(args.json.as_deref(), &json)?;
    Ok(Outcome::Done)
}

/// Each pixel's ray, cut with the plane at its height.
fn cloud_of(rig: &Path, camera: &str, heights: &Heights, modulation: &[f32]) -> Result<Vec<Point>> {
    let file = read_rig(rig)?;
    let Some(camera) = file.rig.camera(camera) else {
        bail!("{}: no camera \"{camera}\", which was calibrated", rig.display());
    };
    if (camera.width_px, camera.height_px) != (heights.width_px, heights.height_px) {
        bail!(
            "{}: the camera has {} × {} px, the heights {} × {} px",
            rig.display(),
            camera.width_px,
            camera.height_px,
            heights.width_px,
            heights.height_px
        );
    }
    Ok((0..heights.height_mm.len()).filter_map(|i| point(camera, heights, modulation, i)).collect())
}

fn point(camera: &Camera, heights: &Heights, modulation: &[f32], i: usize) -> Option<Point> {
    let z_mm = f64::from(heights.height_mm[i]);
    let width = heights.width_px as usize;
    let ray = camera.ray(Point2::new((i % width) as f64, (i / width) as f64))?;
    let along = (z_mm - ray.origin_mm.z) / ray.direction.z;
    (z_mm.is_finite() && along.is_finite() && along > 0.0).then(|| Point {
        position_mm: (ray.origin_mm + ray.direction * along).into(),
        normal: [0.0; 3],
        sigma_mm: heights.sigma_mm[i],
        modulation: modulation[i],
        pair: 0,
        pixel: i as u32,
        shared_mm: 0.0,
    })
}
