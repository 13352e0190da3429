//! `--draw`: every image with what was found in it, and its residuals once there is a calibration.

use super::detections::Gathered;
use super::target_images::TargetImage;
use crate::progress::Progress;
use anyhow::{Context, Result};
use characterise::calibration::{Calibration, Observations, View, ViewReport};
use fringe::frame::Frame;
use report::{GreyPicture, ImagePointMark, ImagePointPicture, image_points_png};
use std::path::Path;

/// A typical arrow spans this part of the image's width.
const ARROW_SHARE: f64 = 0.02;

/// Writes `<pose>-<camera>.png` for each image, also where no target or no calibration was found.
pub fn write(
    folder: &Path,
    gathered: &Gathered,
    observations: &Observations,
    calibration: Option<&Calibration>,
    columns: u32,
) -> Result<()> {
    files::atomic::create_dir(folder)?;
    let mut progress = Progress::new(gathered.target_images.len(), "drawing");
    for image in &gathered.target_images {
        progress.step();
        let name = format!("{:03}-{}.png", image.pose, file_name(&observations.devices[image.device].name));
        let picture = picture(image, observations, calibration, columns)?;
        let png = image_points_png(&picture).with_context(|| image.place.clone())?;
        files::atomic::write(&folder.join(name), &png)?;
    }
    Ok(())
}

/// A camera's name may hold anything; a file's may not.
fn file_name(name: &str) -> String {
    let plain = |c: char| if c.is_alphanumeric() || "-_".contains(c) { c } else { '_' };
    name.chars().map(plain).collect()
}

fn picture(
    image: &TargetImage,
    observations: &Observations,
    calibration: Option<&Calibration>,
    columns: u32,
) -> Result<ImagePointPicture> {
    let is = |v: &View| v.device == image.device && v.pose == image.pose;
    let view = observations.views.iter().find(|v| is(v));
    let report = calibration.and_then(|c| {
        let report = c.views.iter().find(|v| v.device == image.device && v.pose == image.pose)?;
        Some((report, magnification(c, image.device)))
    });
    let (marks, magnification, note) = match (view, report) {
        (Some(_), Some((report, magnification))) => {
            (adjusted(report, columns), magnification, caption(report, magnification))
        }
        (Some(view), None) => (found(view, columns), 1.0, not_adjusted(view, calibration)),
        (None, _) => (Vec::new(), 1.0, image.why.clone().unwrap_or_default()),
    };
    let grey = grey(&image.load()?, image.place.clone());
    Ok(ImagePointPicture { grey, marks, magnification, note })
}

fn index(point: usize, columns: u32) -> (u32, u32) {
    (point as u32 % columns.max(1), point as u32 / columns.max(1))
}

fn found(view: &View, columns: u32) -> Vec<ImagePointMark> {
    let mark = |s: &characterise::calibration::ImagePoint| ImagePointMark {
        index: index(s.index, columns),
        pixel: [s.pixel.x, s.pixel.y],
        error_px: None,
        rejected: false,
    };
    view.image_points.iter().map(mark).collect()
}

fn adjusted(report: &ViewReport, columns: u32) -> Vec<ImagePointMark> {
    let mut marks: Vec<ImagePointMark> = report
        .residuals
        .iter()
        .map(|r| ImagePointMark {
            index: index(r.index, columns),
            pixel: [r.pixel.x, r.pixel.y],
            error_px: r.error_px,
            rejected: !r.used,
        })
        .collect();
    // A view that was read turned starts at its true first point.
    marks.sort_by_key(|m| (m.index.1, m.index.0));
    marks
}

fn caption(report: &ViewReport, magnification: f64) -> String {
    let rejected = report.residuals.iter().filter(|r| !r.used).count();
    let turned = if report.turned { ", read the other way round" } else { "" };
    format!(
        "{} points, {rejected} rejected{turned}; rms {:.4} px; arrows: seen − modelled, {magnification} times as long",
        report.residuals.len(),
        report.rms_px
    )
}

fn not_adjusted(view: &View, calibration: Option<&Calibration>) -> String {
    let why = if calibration.is_some() { "not part of the adjustment" } else { "no calibration" };
    format!("{} points; {why}", view.image_points.len())
}

/// One for all images of a camera, so that they can be compared: 1, 2 or 5 times a power of ten.
fn magnification(calibration: &Calibration, device: usize) -> f64 {
    let device = &calibration.devices[device];
    let wanted = ARROW_SHARE * f64::from(device.camera.width_px) / device.rms_reprojection_px.max(1e-9);
    let mut step = 1.0;
    while step * 10.0 <= wanted {
        step *= 10.0;
    }
    [5.0, 2.0].into_iter().map(|s| s * step).find(|s| *s <= wanted).unwrap_or(step)
}

/// Eight bits of a frame.
fn grey(frame: &Frame, caption: String) -> GreyPicture {
    let mut values = Vec::new();
    frame.view().to_8_bits(&mut values);
    GreyPicture { caption, width_px: frame.width_px, height_px: frame.height_px, values }
}
