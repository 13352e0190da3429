//! What the devices were shown: a target that is searched in images, or points that another program found.

use super::Args;
use super::detections::{self, Gathered};
use super::images;
use super::sensors;
use anyhow::{Context, Result, bail};
use characterise::calibration::Observations;
use characterise::target::{TargetBody, TargetKind, TargetSpec};
use files::point_lists::read_point_lists;
use files::recording::Recording;
use files::target_file::read_target;
use std::path::Path;

/// The target, or the lists of its points.
pub struct Shown<'a> {
    /// File of the target or of the lists.
    pub file: &'a Path,
    /// Points along a row; of lists and of targets with faces all points.
    pub columns: u32,
    /// Points along a column; of lists and of targets with faces one.
    pub rows: u32,
    /// What it is, for people.
    pub text: String,
    /// The target that is searched; `None` of lists.
    target: Option<TargetBody>,
}

impl<'a> Shown<'a> {
    /// Reads `--target`, or `--points`.
    pub fn read(args: &'a Args) -> Result<(Self, Option<Observations>)> {
        match (&args.target, &args.points) {
            (_, Some(file)) => {
                if !args.recordings.is_empty() || !args.images.is_empty() {
                    bail!(
                        "--points {}: has the points of all images; leave recordings and --images out",
                        file.display()
                    );
                }
                let observations = read_point_lists(file)?;
                let count = observations.target_mm.len();
                let text = format!("{count} points of lists");
                Ok((Self { file, columns: count as u32, rows: 1, text, target: None }, Some(observations)))
            }
            (Some(file), None) => {
                let target = read_target(file)?;
                let (columns, rows) =
                    target.board().map_or((target.count() as u32, 1), |board| (board.columns, board.rows));
                Ok((Self { file, columns, rows, text: body_text(&target), target: Some(target) }, None))
            }
            (None, None) => bail!("neither --target nor --points: name the target file"),
        }
    }

    /// Finds the target in all images; nothing to find of lists.
    pub fn gather(&self, args: &Args) -> Result<Gathered> {
        let Some(target) = &self.target else { return Ok(Gathered::default()) };
        match (args.recordings.is_empty(), args.images.is_empty()) {
            (true, true) => {
                bail!("neither recordings nor --images: name the recordings of the target, one for each pose")
            }
            (false, false) => bail!("recordings and --images together: give one of them"),
            (true, false) => images::gather(&args.images, target),
            (false, true) => {
                let opened = args
                    .recordings
                    .iter()
                    .map(|path| Ok(Recording::open(path)?))
                    .collect::<Result<Vec<_>>>()?;
                let mut gathered = detections::gather(&opened, target)?;
                gathered.noise = sensors::noise_lines(&opened)?;
                Ok(gathered)
            }
        }
    }

    /// The observations of what was found.
    pub fn observations(&self, gathered: &Gathered, lists: Option<Observations>) -> Result<Observations> {
        match (&self.target, lists) {
            (Some(target), _) => Ok(gathered.observations(target)),
            (None, Some(lists)) => Ok(lists),
            (None, None) => bail!("{}: no points", self.file.display()),
        }
    }

    /// Refuses images that do not show the target.
    pub fn check(&self, gathered: &Gathered) -> Result<()> {
        let Some(target) = &self.target else { return Ok(()) };
        gathered.check(target).with_context(|| self.file.display().to_string())?;
        gathered.refuse_copies()
    }
}

/// What a target is, face by face.
fn body_text(target: &TargetBody) -> String {
    if let Some(board) = target.board() {
        return text(board);
    }
    let faces = target.faces.iter().map(|face| format!("{}: {}", face.name, text(&face.spec)));
    format!("{} faces; {}", target.faces.len(), faces.collect::<Vec<_>>().join("; "))
}

/// Kind, numbers and pitch of a target.
fn text(target: &TargetSpec) -> String {
    let kind = match target.kind {
        TargetKind::Checkerboard => "checkerboard",
        TargetKind::Circles => "circles",
        TargetKind::AsymmetricCircles => "asymmetric circles",
        TargetKind::Charuco => "ChArUco board",
        TargetKind::Aprilgrid => "AprilGrid",
    };
    format!("{kind}, {} × {} points, pitch {} mm", target.columns, target.rows, target.pitch_mm)
}
