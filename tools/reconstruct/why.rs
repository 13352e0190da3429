//! `--map`: a picture of what became of each pixel, and the counts beside the result.

use super::PairCloud;
use crate::pipeline::DecodedView;
use anyhow::{Context, Result};
use files::recording::{RecordedCamera, RecordedProjector, Recording};
use fringe::frame::PixelBuffer;
use fringe::geometry::rig::Pair;
use fringe::phase::PhaseMap;
use fringe::surface::Cause;
use report::{Class, ClassMap, class_counts, class_map_png};
use std::path::{Path, PathBuf};

/// Frames that use less than this part of their range may have another one than the recording states.
const LITTLE: u32 = 8;

/// What to tell of frames of 16 bits whose largest grey value is far below the range: where no pixel is lit, the range may be wrong.
pub(super) fn low_range(recording: &Recording) -> Option<String> {
    let of = |projector: &RecordedProjector, camera: &RecordedCamera| {
        let largest = |frame: usize| match recording.load(&projector.name, &camera.name, frame).ok()?.pixels {
            PixelBuffer::Mono16(values) => values.into_iter().max(),
            PixelBuffer::Mono8(_) => None,
        };
        let largest = (0..camera.frames.len()).filter_map(largest).max()?;
        (u32::from(largest) * LITTLE < u32::from(camera.full_scale_dn)).then(|| {
            format!(
                "; the largest grey value of camera \"{}\" is {largest}, where full_scale_dn is {}: state the camera's in {}, 1023 for 10 bits, 4095 for 12",
                camera.name,
                camera.full_scale_dn,
                recording.document.path.display()
            )
        })
    };
    recording
        .projectors
        .iter()
        .find_map(|projector| projector.cameras.iter().find_map(|camera| of(projector, camera)))
}

/// Beside the causes: lit, but masked when it was decoded.
const MASKED: u8 = Cause::ALL.len() as u8;

/// Colours of the causes, in their order.
const COLOURS: [[u8; 3]; Cause::ALL.len()] = [
    [20, 20, 24],
    [198, 202, 206],
    [60, 60, 110],
    [60, 110, 160],
    [214, 39, 40],
    [255, 127, 14],
    [188, 140, 30],
    [140, 86, 75],
    [44, 160, 44],
    [150, 220, 120],
    [148, 60, 190],
    [240, 220, 40],
    [230, 120, 190],
];

/// What the legend states, by number of the class.
fn legend() -> Vec<Class> {
    let causes = Cause::ALL.into_iter().zip(COLOURS).map(|(cause, colour)| {
        let name = if cause == Cause::Dark { "not lit" } else { cause.name() };
        Class { name: name.to_owned(), colour }
    });
    let masked = Class { name: "lit, masked when decoded".to_owned(), colour: [90, 70, 40] };
    causes.chain([masked]).collect()
}

/// The class of each pixel of the left camera. What is not valid counts as lit where its modulation reaches that of valid pixels.
pub(super) fn classes(causes: &[Cause], maps: &[&PhaseMap]) -> Vec<u8> {
    let least = |map: &PhaseMap| {
        let valid = map.modulation.iter().zip(&map.valid).filter(|(_, valid)| **valid != 0);
        valid.map(|(modulation, _)| *modulation).fold(f32::INFINITY, f32::min)
    };
    let least: Vec<f32> = maps.iter().map(|map| least(map)).collect();
    let lit = |pixel: usize| maps.iter().zip(&least).all(|(map, least)| map.modulation[pixel] >= *least);
    let class = |(pixel, cause): (usize, &Cause)| {
        if *cause == Cause::Dark && !maps.is_empty() && lit(pixel) { MASKED } else { *cause as u8 }
    };
    causes.iter().enumerate().map(class).collect()
}

/// The maps of the left camera of a pair.
pub(super) fn left_maps<'a>(views: &'a [DecodedView], cloud: &PairCloud) -> Vec<&'a PhaseMap> {
    let left = |view: &&DecodedView| view.projector == cloud.pair.projector && view.camera == cloud.pair.left;
    views.iter().filter(left).flat_map(|view| view.maps.iter().map(|decoded| &decoded.map)).collect()
}

/// What is left out, by cause, the most first; without what is not lit.
pub(super) fn left_out(classes: &[u8]) -> Vec<(String, usize)> {
    let legend = legend();
    let counts = class_counts(classes, legend.len());
    let named = legend.into_iter().zip(counts).enumerate();
    let mut named: Vec<(String, usize)> = named
        .filter(|(class, (_, count))| {
            *count > 0 && *class != Cause::Dark as usize && *class != Cause::Point as usize
        })
        .map(|(_, (class, count))| (class.name, count))
        .collect();
    named.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
    named
}

/// Where the picture of a pair lies: the given path, with the name of the pair before the ending where there are several.
fn path_of(path: &Path, pair: &str, several: bool) -> PathBuf {
    if !several {
        return path.to_owned();
    }
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let plain: String =
        pair.chars().map(|c| if c.is_alphanumeric() || "-_".contains(c) { c } else { '_' }).collect();
    path.with_file_name(format!("{stem}-{plain}.png"))
}

/// Where the pictures of the pairs lie.
pub(super) fn paths(path: &Path, pairs: &[Pair]) -> Vec<PathBuf> {
    pairs.iter().map(|pair| path_of(path, &pair.name, pairs.len() > 1)).collect()
}

/// Writes one picture for each pair; their paths.
pub(super) fn write(path: &Path, views: &[DecodedView], pairs: &[PairCloud]) -> Result<Vec<PathBuf>> {
    let legend = legend();
    let mut written = Vec::new();
    for cloud in pairs {
        let path = path_of(path, &cloud.pair.name, pairs.len() > 1);
        let Some(info) = left_maps(views, cloud).first().map(|map| map.info) else { continue };
        let (width_px, height_px) = (info.width_px, info.height_px);
        let map = ClassMap { width_px, height_px, classes: &cloud.classes, legend: &legend };
        let png = class_map_png(&map).with_context(|| path.display().to_string())?;
        files::atomic::write(&path, &png)?;
        written.push(path);
    }
    Ok(written)
}
