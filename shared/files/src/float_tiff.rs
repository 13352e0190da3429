//! TIFF files of floating-point grey values, which the decoder of pictures does not read, and those of several pages.
//!
//! They become 16 bits: 65535 is the stated full scale, 1 where none is stated.

use crate::document::open_input;
use crate::error::{FileError, Problem};
use crate::memory;
use fringe::frame::{Frame, PixelBuffer};
use std::io::{BufReader, Read, Seek};
use std::path::Path;
use tiff::ColorType;
use tiff::decoder::{Decoder, DecodingResult};
use tiff::tags::Tag;

/// The frame of a TIFF file with one channel of 32- or 64-bit floats; `None` of any other file.
///
/// # Errors
/// Damaged pixels; values below 0, above the full scale, or no numbers.
pub(crate) fn read(path: &Path, full_scale_dn: Option<u16>) -> Result<Option<Frame>, FileError> {
    let (file, _) = open_input(path)?;
    let Ok(mut decoder) = Decoder::new(BufReader::new(file)) else { return Ok(None) };
    let (Ok((width_px, height_px)), Ok(ColorType::Gray(32 | 64))) =
        (decoder.dimensions(), decoder.colortype())
    else {
        return Ok(None);
    };
    refuse_pages(path, decoder.inner())?;
    if !(1..=65_535).contains(&width_px) || !(1..=65_535).contains(&height_px) {
        return Ok(None);
    }
    let count = u64::from(width_px) * u64::from(height_px);
    memory::check(path, &format!("{width_px} × {height_px} px"), 12 * count)?;
    let damaged = |what: String| FileError::new(path, Problem::Syntax(what), "record or copy it again");
    let values: Vec<f64> = match decoder.read_image().map_err(|error| damaged(error.to_string()))? {
        DecodingResult::F32(values) => values.into_iter().map(f64::from).collect(),
        DecodingResult::F64(values) => values,
        _ => return Ok(None),
    };
    if values.len() as u64 != count {
        return Err(damaged(format!("{} values for {width_px} × {height_px} px", values.len())));
    }
    let full = full_scale_dn.map_or(1.0, f64::from);
    if let Some(bad) = values.iter().find(|value| !(0.0..=full).contains(*value)) {
        let problem = Problem::Disagreement {
            what: "grey values and full scale",
            here: format!("a pixel has {bad}"),
            there: format!("floating-point values are 0 … {full}"),
        };
        return Err(FileError::new(path, problem, "state full_scale_dn in the layout, or clip the values"));
    }
    let scale = f64::from(u16::MAX) / full;
    let pixels = values.iter().map(|value| (value * scale).round() as u16).collect();
    Ok(Some(Frame { width_px, height_px, full_scale_dn: u16::MAX, pixels: PixelBuffer::Mono16(pixels) }))
}

/// Refuses a file of several pages, of which all but the first would be lost without a word. A smaller copy of the picture is no
/// page.
pub(crate) fn refuse_pages<R: Read + Seek>(path: &Path, source: &mut R) -> Result<(), FileError> {
    if let Ok(mut decoder) = Decoder::new(&mut *source) {
        while decoder.more_images() && decoder.next_image().is_ok() {
            let kind = decoder.find_tag_unsigned::<u32>(Tag::NewSubfileType);
            if kind.ok().flatten().unwrap_or(0) & 1 == 0 {
                let problem = Problem::Unsupported("holds several pages, and a frame is one".into());
                return Err(FileError::new(path, problem, "write each page to a file of its own"));
            }
        }
    }
    source.rewind().map_err(|source| FileError::io(path, "read it", source))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image_file::{read_foreign_frame, read_frame};
    use tiff::encoder::TiffEncoder;
    use tiff::encoder::colortype::{Gray8, Gray32Float};

    #[test]
    fn floats_become_sixteen_bits_of_the_stated_full_scale() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.tif");
        let write = |values: &[f32]| {
            let file = std::fs::File::create(&path).unwrap();
            TiffEncoder::new(file).unwrap().write_image::<Gray32Float>(2, 1, values).unwrap();
        };
        write(&[0.25, 1.0]);
        let frame = read(&path, None).unwrap().unwrap();
        assert_eq!((frame.full_scale_dn, frame.pixels), (65_535, PixelBuffer::Mono16(vec![16_384, 65_535])));
        write(&[1000.0, 4000.0]);
        assert_eq!(
            read(&path, Some(4000)).unwrap().unwrap().pixels,
            PixelBuffer::Mono16(vec![16_384, 65_535])
        );
        assert!(read(&path, None).unwrap_err().to_string().contains("full_scale_dn"));
        write(&[-0.1, f32::NAN]);
        assert!(read(&path, None).is_err());
        std::fs::write(&path, b"P5\n1 1\n255\n0").unwrap();
        assert!(read(&path, None).unwrap().is_none());
    }

    #[test]
    fn a_second_page_is_refused_and_a_smaller_copy_is_not() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.tif");
        let write = |kind: u32| {
            let mut file = TiffEncoder::new(std::fs::File::create(&path).unwrap()).unwrap();
            file.write_image::<Gray8>(2, 1, &[7, 60]).unwrap();
            let mut second = file.new_image::<Gray8>(1, 1).unwrap();
            second.encoder().write_tag(Tag::NewSubfileType, kind).unwrap();
            second.write_data(&[9]).unwrap();
        };
        write(1);
        for read in [read_frame, read_foreign_frame] {
            assert_eq!(read(&path, None).unwrap().pixels, PixelBuffer::Mono8(vec![7, 60]));
        }
        write(0);
        for read in [read_frame, read_foreign_frame] {
            let error = read(&path, None).unwrap_err().to_string();
            assert!(error.contains("a.tif: holds several pages"), "{error}");
        }
    }
}
