//! The frames of each camera in a folder.

use crate::glob::natural;
use anyhow::{Context, Result, ensure};
use files::recording::{RECORDING_FILE, Recording};
use fringe::pattern::PatternSet;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Endings of picture files.
const ENDINGS: [&str; 8] = ["png", "tif", "tiff", "bmp", "jpg", "jpeg", "pgm", "pnm"];

/// Frames of one camera, in the order in which they were taken.
pub struct Series {
    /// Name of the camera, from its folder or the beginning of the file names.
    pub name: String,
    /// Files of the frames.
    pub files: Vec<PathBuf>,
    /// Grey value of a full sensor, where a recording tells it.
    pub full_scale_dn: Option<u16>,
    /// Sequence of a recording.
    pub declared: Option<Vec<PatternSet>>,
    /// Projector size of a recording, px.
    pub projector_px: Option<[u32; 2]>,
}

/// Finds the cameras: of a recording, by folder, or by what stands before the last number of a file name.
pub fn find(folder: &Path) -> Result<Vec<Series>> {
    if folder.join(RECORDING_FILE).is_file() {
        return recorded(folder);
    }
    let mut found = in_folder(folder, None)?;
    if found.is_empty() {
        let mut folders: Vec<PathBuf> = entries(folder)?.into_iter().filter(|path| path.is_dir()).collect();
        folders.sort_by_cached_key(|path| natural(&path.to_string_lossy()));
        for inner in folders {
            let name = inner.file_name().unwrap_or_default().to_string_lossy().into_owned();
            found.extend(in_folder(&inner, Some(&name))?);
        }
    }
    ensure!(!found.is_empty(), "{}: no picture files ({})", folder.display(), ENDINGS.join(", "));
    Ok(found)
}

fn recorded(folder: &Path) -> Result<Vec<Series>> {
    let recording = Recording::open(folder)?;
    let several = recording.projectors.len() > 1;
    let of = |projector: &files::recording::RecordedProjector| {
        let name =
            |camera: &str| if several { format!("{}-{camera}", projector.name) } else { camera.to_owned() };
        let series = projector.cameras.iter().map(|camera| Series {
            name: name(&camera.name),
            files: camera.frames.clone(),
            full_scale_dn: (camera.bits == 16).then_some(camera.full_scale_dn),
            declared: Some(projector.sequence.clone()),
            projector_px: Some([projector.width_px, projector.height_px]),
        });
        series.collect::<Vec<_>>()
    };
    ensure!(
        !several,
        "{}: {} projectors; explore the folder of one, such as {}",
        folder.display(),
        recording.projectors.len(),
        folder.join("frames").join(&recording.projectors[0].name).display()
    );
    Ok(recording.projectors.iter().flat_map(of).collect())
}

/// Series of one folder; all belong to the camera of the folder's name, where there is one series.
fn in_folder(folder: &Path, camera: Option<&str>) -> Result<Vec<Series>> {
    let mut groups: BTreeMap<String, Vec<PathBuf>> = BTreeMap::new();
    for path in entries(folder)? {
        let ending = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
        let stem = path.file_stem().and_then(|s| s.to_str()).unwrap_or_default();
        if path.is_file() && ENDINGS.contains(&ending.as_str()) && stem.contains(|c: char| c.is_ascii_digit())
        {
            groups.entry(before_number(stem).to_owned()).or_default().push(path);
        }
    }
    let several = groups.len() > 1;
    let series = groups.into_iter().enumerate().map(|(index, (prefix, mut files))| {
        files.sort_by_cached_key(|file| natural(&file.to_string_lossy()));
        let own = prefix.trim_matches(|c: char| !c.is_alphanumeric()).to_owned();
        let name = match (camera, own.is_empty()) {
            (Some(camera), _) if !several => camera.to_owned(),
            (Some(camera), false) => format!("{camera}-{own}"),
            (None, false) if several => own,
            _ => format!("cam{}", index + 1),
        };
        Series { name, files, full_scale_dn: None, declared: None, projector_px: None }
    });
    Ok(series.collect())
}

/// What stands before the last number of a name.
fn before_number(stem: &str) -> &str {
    let end = stem.rfind(|c: char| c.is_ascii_digit()).unwrap_or(0);
    stem[..end].trim_end_matches(|c: char| c.is_ascii_digit())
}

fn entries(folder: &Path) -> Result<Vec<PathBuf>> {
    let entries =
        std::fs::read_dir(folder).with_context(|| format!("{}: cannot be listed", folder.display()))?;
    entries.map(|entry| Ok(entry?.path())).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cameras_are_told_apart_by_what_stands_before_the_number() {
        let dir = tempfile::tempdir().unwrap();
        for name in ["left_2.png", "left_10.png", "right_2.png", "right_10.png", "notes.txt", "board.png"] {
            std::fs::write(dir.path().join(name), b"").unwrap();
        }
        let found = find(dir.path()).unwrap();
        let names: Vec<&str> = found.iter().map(|s| s.name.as_str()).collect();
        assert_eq!(names, ["left", "right"]);
        assert!(found[0].files[0].ends_with("left_2.png") && found[0].files[1].ends_with("left_10.png"));
    }

    #[test]
    fn a_folder_a_camera_gives_its_name() {
        let dir = tempfile::tempdir().unwrap();
        for name in ["L", "R"] {
            std::fs::create_dir(dir.path().join(name)).unwrap();
            std::fs::write(dir.path().join(name).join("1.bmp"), b"").unwrap();
        }
        let names: Vec<String> = find(dir.path()).unwrap().into_iter().map(|s| s.name).collect();
        assert_eq!(names, ["L", "R"]);
        assert!(find(&dir.path().join("none")).is_err());
    }
}
