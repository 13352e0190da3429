//! Images of a target without a recording: `--images cam1='left*.png'`.

use super::detections::{Gathered, SearchedImage, for_all, search, usual_sizes};
use super::target_images::Source;
use anyhow::{Context, Result, bail};
use characterise::calibration::DeviceKind;
use characterise::target::TargetBody;
use std::path::PathBuf;

/// Finds the target in the images of all cameras; the n-th of each shows pose n.
pub fn gather(patterns: &[String], target: &TargetBody) -> Result<Gathered> {
    let lists = patterns.iter().map(|pattern| list(pattern)).collect::<Result<Vec<_>>>()?;
    let (first, count) = (&lists[0].0, lists[0].1.len());
    if let Some((camera, files)) = lists.iter().find(|(_, files)| files.len() != count) {
        bail!(
            "--images: camera \"{camera}\" has {} images, \"{first}\" has {count}; give one of each pose for every camera",
            files.len()
        );
    }
    let pictures: Vec<(usize, usize)> =
        (0..count).flat_map(|number| (0..lists.len()).map(move |list| (number, list))).collect();
    let looks = for_all("finding targets", &pictures, |(number, list)| -> Result<SearchedImage> {
        let path = &lists[*list].1[*number];
        let frame = files::image_file::read_foreign_frame(path, None)?;
        Ok(search(&frame, target, path.display().to_string(), Source::File(path.clone())))
    });
    let mut all = Gathered::default();
    let sizes = usual_sizes(
        pictures
            .iter()
            .zip(&looks)
            .filter_map(|((_, list), look)| Some((lists[*list].0.as_str(), look.as_ref().ok()?.size_px))),
    );
    for ((number, list), look) in pictures.into_iter().zip(looks) {
        if list == 0 {
            all.pose(lists[0].1[number].display().to_string());
        }
        let camera = &lists[list].0;
        let Some(look) = all.usable(camera, &sizes, look) else { continue };
        let (width_px, height_px) = look.size_px;
        let device = all.device(camera, DeviceKind::Camera, width_px, height_px)?;
        if let Some(faces) = all.take(look, device, number) {
            all.add(device, number, &faces);
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
