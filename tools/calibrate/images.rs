//! Pictures of a target without a recording: `--images cam1='left*.png'`.

use super::sights::Gathered;
use crate::progress::Progress;
use anyhow::{Context, Result, bail};
use fringe::calibration::DeviceKind;
use fringe::target::TargetSpec;
use std::path::PathBuf;

/// Finds the target in the pictures of all cameras; the n-th of each shows pose n.
pub fn gather(patterns: &[String], target: &TargetSpec) -> Result<Gathered> {
    let lists = patterns.iter().map(|pattern| list(pattern)).collect::<Result<Vec<_>>>()?;
    let (first, count) = (&lists[0].0, lists[0].1.len());
    if let Some((camera, files)) = lists.iter().find(|(_, files)| files.len() != count) {
        bail!(
            "--images: camera \"{camera}\" has {} pictures, \"{first}\" has {count}: one of each pose for every camera",
            files.len()
        );
    }
    let mut all = Gathered::default();
    let mut progress = Progress::new(count * lists.len(), "finding targets");
    for number in 0..count {
        let pose = all.pose(lists[0].1[number].display().to_string());
        for (camera, files) in &lists {
            progress.step();
            let path = &files[number];
            let frame = rig::image_file::read_foreign_frame(path, None)?;
            let device = all
                .device(camera, DeviceKind::Camera, frame.width_px, frame.height_px)
                .with_context(|| path.display().to_string())?;
            if let Some(detection) = all.look(&frame, target, &path.display().to_string()) {
                all.add(device, pose, &detection);
            }
        }
    }
    Ok(all)
}

/// Camera and files of `camera=pattern`, in the order of the numbers in their names.
fn list(argument: &str) -> Result<(String, Vec<PathBuf>)> {
    let (camera, pattern) =
        argument.split_once('=').with_context(|| format!("--images {argument}: write camera=pattern"))?;
    let files = crate::glob::expand(pattern).with_context(|| format!("--images {argument}"))?;
    Ok((camera.to_owned(), files))
}
