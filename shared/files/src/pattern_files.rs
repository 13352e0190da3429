//! The patterns of projectors as files: images to flash or to show by other means, and `patterns.toml`, which states what each
//! of them is.

use crate::atomic;
use crate::error::{FileError, Problem};
use crate::hash::sha256_hex;
use crate::image_file::encode_png;
use cell::configuration::ProjectorConfig;
use cell::lightcrafter::{Place, draw, image_count, places};
use fringe::frame::{FrameView, Pixels};
use fringe::pattern::{Axis, PatternError, locate};
use image::ExtendedColorType;
use image::codecs::bmp::BmpEncoder;
use serde::Serialize;
use std::fs;
use std::path::{Path, PathBuf};

/// Value of `format` in `patterns.toml`.
pub const PATTERNS_FORMAT: &str = "fringecell-patterns/1";

/// Name of the file that states what each image is.
pub const PATTERNS_FILE: &str = "patterns.toml";

/// How the patterns are written.
#[derive(Debug, Clone, Copy, Default)]
pub struct PatternFiles {
    /// Frames of black and white alone as PNG of one bit a pixel, and with one bit in images of 24.
    pub one_bit: bool,
    /// Images of 24 bits also of projectors that are no boards.
    pub packed: bool,
}

/// All patterns of a cell: the content of `patterns.toml`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PatternList {
    /// [`PATTERNS_FORMAT`], which names this kind of file.
    pub format: &'static str,
    /// Patterns of each projector, in the order of projection.
    pub projector: Vec<ProjectorPatterns>,
}

/// The patterns of one projector.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ProjectorPatterns {
    /// Name of the projector.
    pub name: String,
    /// Columns of every image, px.
    pub width_px: u32,
    /// Rows of every image, px.
    pub height_px: u32,
    /// Exposure of a pattern on a board, µs.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub exposure_us: Option<u32>,
    /// From pattern to pattern on a board, µs.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub period_us: Option<u32>,
    /// Frames in the order of projection.
    pub frame: Vec<PatternFrame>,
    /// Images of 24 bits, for boards.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub image: Vec<PackedImage>,
}

/// One frame of a sequence.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct PatternFrame {
    /// Number in the sequence, from 0.
    pub number: usize,
    /// Its file, relative to the folder.
    pub file: String,
    /// SHA-256 of the file, hexadecimal.
    pub sha256: String,
    /// Number of its set in the sequence, from 0.
    pub set_number: usize,
    /// Name of its set.
    pub set: &'static str,
    /// Axis along which the set varies.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub axis: Option<Axis>,
    /// Number within its set, from 0.
    pub step: usize,
    /// Number of the image of 24 bits that it lies in, as in flash.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub image: Option<usize>,
    /// Its first bit there, 0 … 23: green, red, blue.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bit: Option<u8>,
    /// Its bits there, 1 or 8.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bits: Option<u8>,
}

/// An image of 24 bits that holds several patterns.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct PackedImage {
    /// Its number in flash, from 0.
    pub number: usize,
    /// Its file, relative to the folder.
    pub file: String,
    /// SHA-256 of the file, hexadecimal.
    pub sha256: String,
}

/// Writes the patterns of these projectors into a new folder, which is complete or absent.
///
/// # Errors
/// A folder that holds something or cannot be written; a pattern that cannot be generated.
pub fn write_patterns(
    folder: &Path,
    projectors: &[ProjectorConfig],
    how: PatternFiles,
) -> Result<PatternList, FileError> {
    let used = folder.is_file() || fs::read_dir(folder).is_ok_and(|mut entries| entries.next().is_some());
    if used {
        let problem = Problem::Unsupported("is not an empty folder".into());
        return Err(FileError::new(folder, problem, "name a new folder"));
    }
    let making = Making::beside(folder)?;
    let written = projectors.iter().map(|projector| one_projector(folder, &making.0, projector, how));
    let list = PatternList { format: PATTERNS_FORMAT, projector: written.collect::<Result<_, _>>()? };
    let text = toml::to_string(&list).map_err(|error| {
        FileError::new(folder, Problem::Unsupported(format!("cannot be described: {error}")), "")
    })?;
    atomic::write(&making.0.join(PATTERNS_FILE), text.as_bytes())?;
    fs::rename(&making.0, folder).map_err(|source| FileError::io(folder, "create the folder", source))?;
    Ok(list)
}

/// A folder that is being filled; what is left of it is removed when dropped.
struct Making(PathBuf);

impl Making {
    fn beside(folder: &Path) -> Result<Self, FileError> {
        let full = std::path::absolute(folder).map_err(|e| FileError::io(folder, "resolve the path", e))?;
        let (Some(parent), Some(name)) = (full.parent(), full.file_name()) else {
            return Err(FileError::new(folder, Problem::Unsupported("is no name of a folder".into()), ""));
        };
        atomic::create_dir(parent)?;
        let mut hidden = std::ffi::OsString::from(".");
        hidden.push(name);
        hidden.push(format!(".{}.tmp", std::process::id()));
        let making = parent.join(hidden);
        fs::create_dir(&making).map_err(|source| FileError::io(&making, "create the folder", source))?;
        Ok(Self(making))
    }
}

impl Drop for Making {
    fn drop(&mut self) {
        // After the rename there is nothing left to remove.
        let _ = fs::remove_dir_all(&self.0);
    }
}

fn one_projector(
    folder: &Path,
    making: &Path,
    projector: &ProjectorConfig,
    how: PatternFiles,
) -> Result<ProjectorPatterns, FileError> {
    let not_drawn = |error: PatternError| {
        let remedy = format!("projector \"{}\" cannot show it; remove it from its sequence", projector.name);
        FileError::new(folder, Problem::Pattern(error), remedy)
    };
    atomic::create_dir(&making.join(&projector.name))?;
    let board = projector.lightcrafter.as_ref();
    let bits = projector.pattern_bits(board.map_or(how.one_bit, |board| board.one_bit)).map_err(not_drawn)?;
    let placed = places(bits.iter().copied());
    let packs = how.packed || board.is_some();
    let first = board.map_or(0, |board| usize::from(board.first_image));
    let [width_px, height_px] = projector.size_px();
    let empty = vec![0; width_px as usize * height_px as usize * 3];
    let mut images = vec![empty; if packs { image_count(&placed) } else { 0 }];
    let mut frames = Vec::new();
    for (number, place) in placed.iter().enumerate() {
        let Some(((set, step), drawn)) = locate(&projector.sequence, number).zip(projector.image_u8(number))
        else {
            continue;
        };
        let pattern = drawn.map_err(not_drawn)?;
        if packs {
            draw(&mut images[place.image], *place, &pattern);
        }
        let file = format!("{}/{number:03}.png", projector.name);
        let sha256 = write(&making.join(&file), &png([width_px, height_px], &pattern, how.one_bit))?;
        let set_of = &projector.sequence[set];
        let in_image = packs.then_some(Place { image: first + place.image, ..*place });
        frames.push(PatternFrame {
            number,
            file,
            sha256,
            set_number: set,
            set: set_of.name(),
            axis: set_of.axis(),
            step,
            image: in_image.map(|place| place.image),
            bit: in_image.map(|place| place.bit),
            bits: in_image.map(|place| place.bits),
        });
    }
    let packed = images.iter().enumerate().map(|(number, rgb)| {
        let number = first + number;
        let file = format!("{}/image-{number:02}.bmp", projector.name);
        let sha256 = write(&making.join(&file), &bmp([width_px, height_px], rgb))?;
        Ok(PackedImage { number, file, sha256 })
    });
    Ok(ProjectorPatterns {
        name: projector.name.clone(),
        width_px,
        height_px,
        exposure_us: board.map(|board| board.exposure_us),
        period_us: board.map(|board| board.period_us),
        image: packed.collect::<Result<_, FileError>>()?,
        frame: frames,
    })
}

/// Writes a file of the new folder; gives its hash.
fn write(path: &Path, content: &std::io::Result<Vec<u8>>) -> Result<String, FileError> {
    match content {
        Ok(bytes) => {
            fs::write(path, bytes).map_err(|source| FileError::io(path, "write it", source))?;
            Ok(sha256_hex(bytes))
        }
        Err(error) => Err(FileError::io(path, "encode it", std::io::Error::other(error.to_string()))),
    }
}

/// PNG of 8 bits a pixel, or of one where that holds the pattern and is wanted.
fn png([width_px, height_px]: [u32; 2], pattern: &[u8], one_bit: bool) -> std::io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    if !one_bit || pattern.iter().any(|level| !matches!(level, 0 | 255)) {
        let view = FrameView { width_px, height_px, full_scale_dn: 255, pixels: Pixels::Mono8(pattern) };
        encode_png(&view, &mut bytes)?;
        return Ok(bytes);
    }
    let mut encoder = png::Encoder::new(&mut bytes, width_px, height_px);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::One);
    let rows: Vec<u8> = pattern.chunks(width_px as usize).flat_map(packed_row).collect();
    let mut writer = encoder.write_header()?;
    writer.write_image_data(&rows)?;
    writer.finish()?;
    Ok(bytes)
}

/// Eight pixels a byte, the first in the most significant bit.
fn packed_row(row: &[u8]) -> impl Iterator<Item = u8> {
    let byte = |pixels: &[u8]| {
        let bits = pixels.iter().enumerate().map(|(place, level)| u8::from(*level != 0) << (7 - place));
        bits.sum()
    };
    row.chunks(8).map(byte)
}

/// BMP of 24 bits a pixel, what the software of the boards reads.
fn bmp([width_px, height_px]: [u32; 2], rgb: &[u8]) -> std::io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    BmpEncoder::new(&mut bytes)
        .encode(rgb, width_px, height_px, ExtendedColorType::Rgb8)
        .map_err(std::io::Error::other)?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use cell::configuration::Driver;
    use cell::lightcrafter::taken;
    use fringe::pattern::PatternSet;

    fn projector(sequence: Vec<PatternSet>) -> ProjectorConfig {
        ProjectorConfig::new("proj1", Driver::Twin, [37, 11], sequence)
    }

    #[test]
    fn images_on_disk_are_the_patterns_and_the_list_states_their_hashes() {
        let folder = tempfile::tempdir().unwrap();
        let light = projector(vec![
            PatternSet::sine(Axis::X, 16.0, 4),
            PatternSet::gray(Axis::Y, 3, 2.0),
            PatternSet::White {},
        ]);
        for how in [
            PatternFiles::default(),
            PatternFiles { one_bit: true, packed: true },
            PatternFiles { one_bit: false, packed: true },
        ] {
            let out = folder.path().join(format!("{how:?}"));
            let list = write_patterns(&out, std::slice::from_ref(&light), how).unwrap();
            let written = &list.projector[0];
            assert_eq!(written.frame.len(), 8);
            let images: Vec<Vec<u8>> = written
                .image
                .iter()
                .map(|image| image::open(out.join(&image.file)).unwrap().into_rgb8().into_raw())
                .collect();
            assert_eq!(
                images.len(),
                if !how.packed {
                    0
                } else if how.one_bit {
                    2
                } else {
                    3
                }
            );
            for frame in &written.frame {
                let bytes = fs::read(out.join(&frame.file)).unwrap();
                assert_eq!(sha256_hex(&bytes), frame.sha256);
                let expected = light.image_u8(frame.number).unwrap().unwrap();
                let found = image::load_from_memory(&bytes).unwrap().into_luma8();
                assert_eq!((found.width(), found.height()), (37, 11));
                assert_eq!(found.into_raw(), expected, "{frame:?}");
                if let (Some(image), Some(bit), Some(bits)) = (frame.image, frame.bit, frame.bits) {
                    assert_eq!(taken(&images[image], Place { image, bit, bits }), expected, "{frame:?}");
                }
            }
            let one = fs::read(out.join("proj1/004.png")).unwrap();
            assert_eq!(one[24], if how.one_bit { 1 } else { 8 }, "bits a pixel in the header");
            let text = fs::read_to_string(out.join(PATTERNS_FILE)).unwrap();
            assert!(text.contains(&written.frame[7].sha256), "{text}");
        }
        let names: Vec<_> = fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().file_name()).collect();
        assert_eq!(names.len(), 3, "{names:?}");
    }

    #[test]
    fn a_used_folder_stays_as_it_is_and_a_pattern_that_nobody_can_draw_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("new");
        let random = projector(vec![PatternSet::Random { frames: 1 }]);
        let error = write_patterns(&out, &[random], PatternFiles::default()).unwrap_err().to_string();
        assert!(error.contains("random"), "{error}");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
        fs::create_dir(&out).unwrap();
        fs::write(out.join("mine"), "x").unwrap();
        let light = projector(vec![PatternSet::White {}]);
        let error = write_patterns(&out, &[light], PatternFiles::default()).unwrap_err().to_string();
        assert!(error.contains("is not an empty folder"), "{error}");
        assert_eq!(fs::read_dir(&out).unwrap().count(), 1);
    }
}
