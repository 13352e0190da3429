//! The images of a recording's folders: which frames there are, and that they are alike.

use crate::error::{FileError, Problem, list};
use crate::image_file::{ImageHeader, read_header};
use std::path::{Path, PathBuf};

/// Frame and exposure of a file's name: `007` or `007_2`.
fn numbers(stem: &str, exposures: usize) -> Option<[usize; 2]> {
    let (frame, exposure) = match stem.split_once('_') {
        Some((frame, exposure)) => (frame, exposure.parse().ok().filter(|e| *e > 0 && *e < exposures)?),
        None => (stem, 0),
    };
    let number = frame.parse::<usize>().ok()?;
    let written = if exposure == 0 { format!("{number:03}") } else { format!("{number:03}_{exposure}") };
    (written == stem).then_some([number, exposure])
}

/// Those of the frames 000 … count − 1 of each exposure that are used, each there once, and no other image.
pub(super) fn list_frames(
    folder: &Path,
    (count, used): (usize, &[usize]),
    exposures: usize,
) -> Result<Vec<Vec<PathBuf>>, FileError> {
    let mut all: Vec<Vec<Option<PathBuf>>> = vec![vec![None; count]; exposures];
    for path in images(folder)? {
        let stem = path.file_stem().and_then(|stem| stem.to_str()).unwrap_or("");
        match numbers(stem, exposures) {
            Some([number, exposure]) if number < count => {
                let found = &mut all[exposure];
                if let Some(first) = &found[number] {
                    let problem = Problem::Disagreement {
                        what: "frames",
                        here: format!("{} is frame {number}", path.display()),
                        there: format!("so is {}", first.display()),
                    };
                    return Err(FileError::new(folder, problem, "remove one of them"));
                }
                found[number] = Some(path);
            }
            Some(_) => {
                let problem = Problem::Disagreement {
                    what: "frames and sequence",
                    here: format!("this is frame {stem}"),
                    there: format!(
                        "the sequence of recording.toml has {count} frames, 000 … {:03}",
                        count - 1
                    ),
                };
                return Err(FileError::new(&path, problem, "correct the sequence, or remove the frame"));
            }
            None => {
                let problem = Problem::Value {
                    value: format!("\"{stem}\""),
                    limit: "frames are named by their number: 000.png, 001.png, …".into(),
                };
                return Err(FileError::new(&path, problem, "rename or remove it"));
            }
        }
    }
    all.into_iter()
        .enumerate()
        .map(|(exposure, mut found)| {
            let found = used.iter().map(|number| (*number, found[*number].take())).collect();
            complete(folder, exposure, found)
        })
        .collect()
}

fn complete(
    folder: &Path,
    exposure: usize,
    found: Vec<(usize, Option<PathBuf>)>,
) -> Result<Vec<PathBuf>, FileError> {
    let count = found.len();
    let there = found.iter().filter(|(_, path)| path.is_some()).count();
    let missing: Vec<String> =
        found.iter().filter(|(_, path)| path.is_none()).map(|(number, _)| format!("{number:03}")).collect();
    if missing.is_empty() {
        return Ok(found.into_iter().filter_map(|(_, path)| path).collect());
    }
    let shown = list(missing.iter().take(8).map(String::as_str));
    let problem = Problem::Disagreement {
        what: "frames and sequence",
        here: match exposure {
            0 => format!("{there} frames are here (missing: {shown})"),
            _ => format!(
                "{there} frames of exposure {exposure} are here (missing: {shown}, each with _{exposure})"
            ),
        },
        there: format!("the sequence of recording.toml has {count}"),
    };
    Err(FileError::new(
        folder,
        problem,
        "record or copy again, or correct the sequence; frames that are lost may be listed as missing = [number, …] in the [[projector]]",
    ))
}

/// Image files of a folder in the order of their names; hidden ones (a copy going on, a desktop's notes) do not count.
fn images(folder: &Path) -> Result<Vec<PathBuf>, FileError> {
    let io = |source| FileError::io(folder, "list the folder", source);
    let mut paths = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(io)? {
        let path = entry.map_err(io)?.path();
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("").to_ascii_lowercase();
        let hidden = path.file_name().is_some_and(|name| name.as_encoded_bytes().starts_with(b"."));
        if ["png", "tif", "tiff"].contains(&extension.as_str()) && !hidden {
            paths.push(path);
        }
    }
    paths.sort();
    Ok(paths)
}

/// The head that all frames of a camera share.
pub(super) fn equal_headers(frames: &[PathBuf]) -> Result<ImageHeader, FileError> {
    let mut first: Option<(ImageHeader, &PathBuf)> = None;
    for path in frames {
        let head = read_header(path)?;
        let Some((expected, reference)) = first else {
            first = Some((head, path));
            continue;
        };
        let same = |head: ImageHeader| (head.width_px, head.height_px, head.bits);
        if same(head) != same(expected) {
            let problem = Problem::Disagreement {
                what: "frames",
                here: format!("this one is {}", describe(head)),
                there: format!("{} is {}", reference.display(), describe(expected)),
            };
            return Err(FileError::new(path, problem, "all frames of a camera have one size and depth"));
        }
    }
    // The sequence has at least one frame, and every frame was found.
    first
        .map(|(head, _)| head)
        .ok_or_else(|| FileError::new(Path::new(""), Problem::Missing("a frame".into()), ""))
}

fn describe(head: ImageHeader) -> String {
    format!("{} × {} px of {} bits", head.width_px, head.height_px, head.bits)
}
