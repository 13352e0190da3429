//! Greyscale frames in image files.
//!
//! A frame is 8- or 16-bit greyscale. A file of three colour channels is accepted when they are equal everywhere (many
//! programs save grey so); otherwise it is refused, since any mix of colours would be a guess about the sensor.

use crate::document::{open_input, refuse_special};
use crate::error::{FileError, Problem};
use crate::float_tiff;
pub use crate::image_channel::Channel;
use crate::image_channel::plane;
use crate::memory;
use fringe::frame::{Frame, FrameView, PixelBuffer, Pixels};
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageDecoder, ImageEncoder, ImageFormat, ImageReader, Limits};
use std::fs::File;
use std::io::{self, BufRead, BufReader, BufWriter, Cursor, Seek, Write};
use std::path::Path;

/// Most pixels of one frame: four times the largest area sensor sold. Guards memory against a header that lies.
const PIXELS_LIMIT: u64 = 1 << 29;

/// What the head of an image file states.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ImageHeader {
    /// Columns of the image, px.
    pub width_px: u32,
    /// Rows of the image, px.
    pub height_px: u32,
    /// Bits of a grey value, 8 or 16.
    pub bits: u8,
    /// Three channels, which must turn out equal.
    pub colour: bool,
    /// A last channel of opacity, which is left out.
    pub alpha: bool,
}

type Decoder = Box<dyn ImageDecoder>;

/// Reads the head of a PNG or TIFF file; the pixels are not decoded.
///
/// # Errors
/// Absent, no PNG or TIFF, damaged head, or neither 8- nor 16-bit greyscale.
pub fn read_header(path: &Path) -> Result<ImageHeader, FileError> {
    header(path, open(path, &[ImageFormat::Png, ImageFormat::Tiff])?.as_ref())
}

/// Reads a frame from a PNG or TIFF file.
///
/// `full_scale_dn` is the grey value at which the sensor is full in 16-bit files; `None` means 65535. 8-bit files are
/// full at 255.
///
/// # Errors
/// As [`read_header`]; truncated or damaged pixels, unequal colour channels, grey values above the full scale.
pub fn read_frame(path: &Path, full_scale_dn: Option<u16>) -> Result<Frame, FileError> {
    recorded(path, open(path, &RECORDED)?, full_scale_dn)
}

/// The formats of a recording.
const RECORDED: [ImageFormat; 2] = [ImageFormat::Png, ImageFormat::Tiff];

fn recorded(path: &Path, decoder: Decoder, full_scale_dn: Option<u16>) -> Result<Frame, FileError> {
    // A recording holds frames, not pictures made for the eye.
    if header(path, decoder.as_ref())?.alpha {
        let problem = Problem::Unsupported("has a channel of opacity".into());
        return Err(FileError::new(path, problem, "convert it to 8- or 16-bit greyscale without alpha"));
    }
    frame(path, decoder, full_scale_dn, Channel::Grey)
}

/// As [`read_frame`], from BMP, JPEG and PGM files and TIFF files of floats too, and with opacity, which is left out: for imports,
/// since a recording holds none of them.
///
/// # Errors
/// As [`read_frame`].
pub fn read_foreign_frame(path: &Path, full_scale_dn: Option<u16>) -> Result<Frame, FileError> {
    read_channel(path, full_scale_dn, Channel::Grey)
}

/// As [`read_foreign_frame`], of a colour picture one channel or its luminance.
///
/// # Errors
/// As [`read_foreign_frame`].
pub fn read_channel(path: &Path, full_scale_dn: Option<u16>, channel: Channel) -> Result<Frame, FileError> {
    if let Some(frame) = float_tiff::read(path, full_scale_dn)? {
        return Ok(frame);
    }
    let formats =
        [ImageFormat::Png, ImageFormat::Tiff, ImageFormat::Bmp, ImageFormat::Jpeg, ImageFormat::Pnm];
    frame(path, open(path, &formats)?, full_scale_dn, channel)
}

/// As [`read_frame`], from the bytes of the file, which were read before.
///
/// # Errors
/// As [`read_frame`].
pub fn decode_frame(path: &Path, bytes: Vec<u8>, full_scale_dn: Option<u16>) -> Result<Frame, FileError> {
    recorded(path, decoder(path, Cursor::new(bytes), &RECORDED)?, full_scale_dn)
}

fn open(path: &Path, formats: &[ImageFormat]) -> Result<Decoder, FileError> {
    refuse_special(path)?;
    let (file, _) = open_input(path)?;
    decoder(path, BufReader::new(file), formats)
}

fn decoder<R: BufRead + Seek + 'static>(
    path: &Path,
    mut source: R,
    formats: &[ImageFormat],
) -> Result<Decoder, FileError> {
    // What is left of a file that was written on a full disk.
    if source.fill_buf().map_err(|source| FileError::io(path, "read it", source))?.is_empty() {
        let problem = Problem::Unsupported("is empty".into());
        return Err(FileError::new(path, problem, "record or copy it again"));
    }
    let reader = ImageReader::new(source);
    let mut reader = reader.with_guessed_format().map_err(|source| FileError::io(path, "read it", source))?;
    match reader.format() {
        Some(format) if formats.contains(&format) => {}
        other => {
            let found = other.map_or("of no known kind".to_owned(), |format| format!("{format:?}"));
            let problem = Problem::Unsupported(format!("is {found}, expected PNG or TIFF"));
            return Err(FileError::new(path, problem, "convert it to greyscale PNG"));
        }
    }
    if reader.format() == Some(ImageFormat::Tiff) {
        let mut source = reader.into_inner();
        float_tiff::refuse_pages(path, &mut source)?;
        reader = ImageReader::with_format(source, ImageFormat::Tiff);
    }
    let mut decoder = reader.into_decoder().map_err(|error| damaged(path, error))?;
    let mut limits = Limits::default();
    limits.max_alloc = Some(PIXELS_LIMIT * 6);
    decoder.set_limits(limits).map_err(|error| damaged(path, error))?;
    Ok(Box::new(decoder))
}

fn damaged(path: &Path, error: image::ImageError) -> FileError {
    match error {
        image::ImageError::Unsupported(what) => {
            let problem = Problem::Image(Box::new(image::ImageError::Unsupported(what)));
            FileError::new(path, problem, "convert it to 8- or 16-bit greyscale PNG")
        }
        other => FileError::new(path, Problem::Image(Box::new(other)), "record or copy it again"),
    }
}

fn header(path: &Path, decoder: &dyn ImageDecoder) -> Result<ImageHeader, FileError> {
    let (width_px, height_px) = decoder.dimensions();
    let (bits, colour, alpha) = match decoder.original_color_type() {
        ExtendedColorType::L8 => (8, false, false),
        ExtendedColorType::L16 => (16, false, false),
        ExtendedColorType::Rgb8 | ExtendedColorType::Bgr8 => (8, true, false),
        ExtendedColorType::Rgb16 => (16, true, false),
        ExtendedColorType::La8 => (8, false, true),
        ExtendedColorType::La16 => (16, false, true),
        ExtendedColorType::Rgba8 | ExtendedColorType::Bgra8 => (8, true, true),
        ExtendedColorType::Rgba16 => (16, true, true),
        other => {
            let problem = Problem::Unsupported(format!("has pixels of kind {other:?}"));
            return Err(FileError::new(path, problem, "convert it to 8- or 16-bit greyscale without alpha"));
        }
    };
    let sides = 1..=65_535;
    if !sides.contains(&width_px)
        || !sides.contains(&height_px)
        || u64::from(width_px) * u64::from(height_px) > PIXELS_LIMIT
    {
        let value = format!("{width_px} × {height_px} px");
        let limit = format!("1 … 65535 px a side, at most {PIXELS_LIMIT} pixels");
        return Err(FileError::new(path, Problem::Value { value, limit }, "is this a camera frame?"));
    }
    Ok(ImageHeader { width_px, height_px, bits, colour, alpha })
}

fn frame(
    path: &Path,
    decoder: Decoder,
    full_scale_dn: Option<u16>,
    channel: Channel,
) -> Result<Frame, FileError> {
    let head = header(path, decoder.as_ref())?;
    let channels = if head.colour { 3 } else { 1 } + usize::from(head.alpha);
    let kind = decoder.color_type();
    let bytes = if head.bits == 8 { 1 } else { 2 };
    if usize::from(kind.channel_count()) != channels
        || usize::from(kind.bytes_per_pixel()) != bytes * channels
    {
        let problem = Problem::Unsupported(format!("decodes as {kind:?}"));
        return Err(FileError::new(path, problem, "convert it to 8- or 16-bit greyscale PNG"));
    }
    let values = head.width_px as usize * head.height_px as usize * channels;
    // The decoder holds another copy.
    let bytes = 2 * values as u64 * u64::from(head.bits) / 8;
    memory::check(path, &format!("{} × {} px", head.width_px, head.height_px), bytes)?;
    let (pixels, full_scale_dn) = if head.bits == 8 {
        let mut bytes = vec![0_u8; values];
        decoder.read_image(&mut bytes).map_err(|error| damaged(path, error))?;
        (PixelBuffer::Mono8(plane(path, bytes, (head.colour, head.alpha), channel)?), 255)
    } else {
        let mut words = vec![0_u16; values];
        decoder.read_image(bytemuck::cast_slice_mut(&mut words)).map_err(|error| damaged(path, error))?;
        let words = plane(path, words, (head.colour, head.alpha), channel)?;
        let full = full_scale_dn.unwrap_or(u16::MAX);
        check_full_scale(path, &words, full)?;
        (PixelBuffer::Mono16(words), full)
    };
    Ok(Frame { width_px: head.width_px, height_px: head.height_px, full_scale_dn, pixels })
}

fn check_full_scale(path: &Path, words: &[u16], full_scale_dn: u16) -> Result<(), FileError> {
    match words.iter().max() {
        Some(max) if *max > full_scale_dn => {
            let problem = Problem::Disagreement {
                what: "grey values and full scale",
                here: format!("the brightest pixel has {max} DN"),
                there: format!("full_scale_dn = {full_scale_dn}"),
            };
            let remedy = "correct full_scale_dn in recording.toml; grey values stand in the low bits";
            Err(FileError::new(path, problem, remedy))
        }
        _ => Ok(()),
    }
}

/// Writes a frame as greyscale PNG (8 bits a pixel, or 16 for [`Pixels::Mono16`]), fast rather than small.
///
/// # Errors
/// What the writer reports; pixels that do not fill width × height.
pub fn encode_png(frame: &FrameView<'_>, out: &mut impl Write) -> io::Result<()> {
    if frame.pixels.len() != frame.width_px as usize * frame.height_px as usize {
        return Err(io::Error::new(io::ErrorKind::InvalidInput, "pixels do not fill the frame"));
    }
    // Up is exact prediction for vertical fringes and cheap; adaptive filtering costs more time than the disk saves.
    let encoder = PngEncoder::new_with_quality(out, CompressionType::Fast, FilterType::Up);
    let written = match frame.pixels {
        Pixels::Mono8(bytes) => {
            encoder.write_image(bytes, frame.width_px, frame.height_px, ExtendedColorType::L8)
        }
        Pixels::Mono16(words) => {
            let bytes = bytemuck::cast_slice(words);
            encoder.write_image(bytes, frame.width_px, frame.height_px, ExtendedColorType::L16)
        }
    };
    written.map_err(io::Error::other)
}

/// Writes a frame to a new file, as [`encode_png`].
///
/// # Errors
/// The file exists already or cannot be written.
pub fn write_png(path: &Path, frame: &FrameView<'_>) -> Result<(), FileError> {
    let written = || -> io::Result<()> {
        let mut out = BufWriter::with_capacity(1 << 16, File::create_new(path)?);
        encode_png(frame, &mut out)?;
        out.flush()
    };
    written().map_err(|source| FileError::io(path, "write it", source))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(pixels: PixelBuffer) -> Frame {
        let full_scale_dn = if matches!(pixels, PixelBuffer::Mono8(_)) { 255 } else { 4095 };
        Frame { width_px: 3, height_px: 2, full_scale_dn, pixels }
    }

    #[test]
    fn frames_come_back_as_they_were_written() {
        let dir = tempfile::tempdir().unwrap();
        let eight = frame(PixelBuffer::Mono8(vec![0, 1, 127, 128, 254, 255]));
        let twelve = frame(PixelBuffer::Mono16(vec![0, 1, 255, 256, 4094, 4095]));
        for (name, frame) in [("a.png", eight), ("b.png", twelve)] {
            let path = dir.path().join(name);
            write_png(&path, &frame.view()).unwrap();
            assert_eq!(read_frame(&path, Some(4095)).unwrap(), frame);
            assert!(write_png(&path, &frame.view()).is_err(), "an existing file is not overwritten");
        }
        assert!(
            read_frame(&dir.path().join("b.png"), Some(1023)).unwrap_err().to_string().contains("4095 DN")
        );
        assert_eq!(read_frame(&dir.path().join("b.png"), None).unwrap().full_scale_dn, 65_535);
    }

    #[test]
    fn tiff_of_both_depths_is_read() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.tif");
        image::ImageBuffer::<image::Luma<u16>, _>::from_raw(2, 1, vec![7_u16, 60_000])
            .unwrap()
            .save(&path)
            .unwrap();
        assert_eq!(read_frame(&path, None).unwrap().pixels, PixelBuffer::Mono16(vec![7, 60_000]));
        image::ImageBuffer::<image::Luma<u8>, _>::from_raw(2, 1, vec![7_u8, 60])
            .unwrap()
            .save(&path)
            .unwrap();
        assert_eq!(read_frame(&path, None).unwrap().pixels, PixelBuffer::Mono8(vec![7, 60]));
    }

    #[test]
    fn colour_is_accepted_only_when_it_is_grey() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.png");
        let save = |bytes: Vec<u8>| {
            image::ImageBuffer::<image::Rgb<u8>, _>::from_raw(2, 1, bytes).unwrap().save(&path).unwrap();
        };
        save(vec![5, 5, 5, 9, 9, 9]);
        assert_eq!(read_frame(&path, None).unwrap().pixels, PixelBuffer::Mono8(vec![5, 9]));
        save(vec![5, 5, 5, 9, 9, 8]);
        assert!(read_frame(&path, None).unwrap_err().to_string().contains("is a colour image"));
    }

    #[test]
    fn a_channel_of_a_colour_picture_is_a_frame_and_opacity_is_left_out() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.png");
        let pixels = vec![10_u8, 20, 30, 128, 200, 100, 0, 255];
        image::ImageBuffer::<image::Rgba<u8>, _>::from_raw(2, 1, pixels).unwrap().save(&path).unwrap();
        for (channel, expected) in [
            (Channel::Red, [10, 200]),
            (Channel::Green, [20, 100]),
            (Channel::Blue, [30, 0]),
            (Channel::Luminance, [18, 119]),
        ] {
            let frame = read_channel(&path, None, channel).unwrap();
            assert_eq!(frame.pixels, PixelBuffer::Mono8(expected.to_vec()), "{channel:?}");
        }
        assert!(read_foreign_frame(&path, None).unwrap_err().to_string().contains("is a colour image"));
        assert!(read_frame(&path, None).unwrap_err().to_string().contains("opacity"));
    }

    #[test]
    fn pgm_of_both_depths_is_read() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.pgm");
        std::fs::write(&path, b"P5\n2 1\n255\n\x07\x3c").unwrap();
        assert_eq!(read_foreign_frame(&path, None).unwrap().pixels, PixelBuffer::Mono8(vec![7, 60]));
        std::fs::write(&path, b"P5\n2 1\n65535\n\x00\x07\x30\x39").unwrap();
        assert_eq!(read_foreign_frame(&path, None).unwrap().pixels, PixelBuffer::Mono16(vec![7, 12345]));
        assert!(read_frame(&path, None).is_err(), "a recording holds PNG and TIFF");
    }

    #[test]
    fn every_truncation_of_a_file_is_an_error_and_never_a_panic() {
        let dir = tempfile::tempdir().unwrap();
        let whole = dir.path().join("whole.png");
        let values = (0..64 * 48).map(|i| (i * 37 % 251) as u8).collect();
        let frame =
            Frame { width_px: 64, height_px: 48, full_scale_dn: 255, pixels: PixelBuffer::Mono8(values) };
        write_png(&whole, &frame.view()).unwrap();
        let bytes = std::fs::read(&whole).unwrap();
        let cut = dir.path().join("cut.png");
        // The last 12 bytes are the end mark, which carries no pixels.
        for length in (0..bytes.len() - 12).rev().step_by(5) {
            std::fs::write(&cut, &bytes[..length]).unwrap();
            assert!(read_frame(&cut, None).is_err(), "{length} of {} bytes", bytes.len());
        }
    }

    #[test]
    fn a_header_that_lies_about_the_size_is_refused() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.png");
        write_png(&path, &frame(PixelBuffer::Mono8(vec![0; 6])).view()).unwrap();
        let mut bytes = std::fs::read(&path).unwrap();
        bytes[16..24].copy_from_slice(&[0, 0, 0xff, 0xff, 0, 0, 0xff, 0xff]);
        std::fs::write(&path, bytes).unwrap();
        assert!(read_frame(&path, None).is_err());
    }
}
