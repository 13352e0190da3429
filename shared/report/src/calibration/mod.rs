//! The calibration report: quality of the rig, in text and diagrams for its user.
//!
//! Like the measurement report it is one HTML file without scripts and without a clock.

use std::path::Path;

use characterise::calibration::{
    Calibration, CrossValidation, DeviceKind, HeldOut, Observations, SphereSpacing, Volume,
};

use super::ReportError;
use super::page::{Page, Text};
use files::atomic;

mod charts;
mod devices;
mod field;
mod length;
mod lists;
mod maps;
mod scene;
mod summary;

pub use length::{CheckedLength, LengthCheck, LengthSummary};

/// Content of the report.
#[derive(Debug, Clone)]
pub struct CalibrationReport<'a> {
    /// Name of the rig.
    pub rig: String,
    /// Lines of the header: label and text (target, software, files with their hashes).
    pub details: Vec<(String, String)>,
    /// Result of the adjustment.
    pub calibration: &'a Calibration,
    /// What it was given.
    pub observations: &'a Observations,
    /// Points along a row of the target, to name them.
    pub columns: u32,
    /// Name and devices of each pair.
    pub pairs: &'a [(String, [usize; 2])],
    /// Length of the bars of the spacing, mm.
    pub spacing_mm: f64,
    /// Their predicted uncertainty; `None` where no pair sees such a bar.
    pub spacing: Option<SphereSpacing>,
    /// Held-out poses, or why there are none.
    pub held_out: Result<&'a HeldOut, &'a str>,
    /// How they were chosen.
    pub held_out_how: &'a str,
    /// Two halves of the poses, or why they were not compared.
    pub cross: Result<&'a CrossValidation, &'a str>,
    /// Certified lengths compared with measured ones.
    pub lengths: &'a [LengthCheck],
    /// Pictures and views that were left out, a line each.
    pub notes: &'a [String],
}

impl CalibrationReport<'_> {
    /// "4,2" of a point of the target.
    fn point_name(&self, index: usize) -> String {
        let columns = self.columns.max(1) as usize;
        format!("{},{}", index % columns, index / columns)
    }

    /// Last part of a pose's name: the rest of the path is the same for all.
    fn pose_name(&self, pose: usize) -> &str {
        let name = self.observations.poses.get(pose).map_or("", String::as_str);
        name.trim_end_matches('/').rsplit('/').next().unwrap_or(name)
    }
}

/// Kind of a device as text: "camera" or "projector".
fn kind(kind: DeviceKind) -> &'static str {
    match kind {
        DeviceKind::Camera => "camera",
        DeviceKind::Projector => "projector",
    }
}

/// Writes the report; the file is complete or absent.
///
/// # Errors
/// The file cannot be written.
pub fn write_html(path: &Path, report: &CalibrationReport<'_>) -> Result<(), ReportError> {
    Ok(atomic::write(path, html(report)?.as_bytes())?)
}

/// The report as text.
///
/// # Errors
/// A picture that cannot be encoded.
pub fn html(report: &CalibrationReport<'_>) -> Result<String, ReportError> {
    let mut page = Page::begin(&format!("Calibration report: {}", report.rig));
    header(&mut page, report);
    summary::section(&mut page, report);
    devices::section(&mut page, report);
    length::section(&mut page, report.lengths);
    scene::section(&mut page, report);
    charts::images(&mut page, report);
    field::section(&mut page, report);
    charts::histograms(&mut page, report);
    maps::section(&mut page, report)?;
    lists::section(&mut page, report);
    Ok(page.end())
}

fn header(page: &mut Page, report: &CalibrationReport<'_>) {
    page.put(format_args!(
        "<header>\n<h1>Calibration report</h1>\n<p class=\"sub\">All cameras, projectors and poses of the target in one \
         adjustment</p>\n<dl class=\"meta\">\n"
    ));
    for (label, text) in &report.details {
        page.put(format_args!("<div><dt>{}</dt><dd>{}</dd></div>\n", Text(label), Text(text)));
    }
    page.put(format_args!("</dl>\n</header>\n"));
}

/// Whether the volume has to be shown after half a turn about its x axis so that z points to the devices: the target is
/// seen from its front, where its own z may point either way.
fn turned(report: &CalibrationReport<'_>, volume: &Volume) -> bool {
    let to_volume = volume.world_from_volume.inverse();
    report.calibration.devices.iter().map(|d| (to_volume * d.camera.centre_mm()).z).sum::<f64>() < 0.0
}
