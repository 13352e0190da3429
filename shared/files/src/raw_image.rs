//! Frames without a header, as camera programs dump them: the layout states what the bytes are.

use crate::document::read_bytes;
use crate::error::{FileError, Problem, did_you_mean};
use cell::pixel_format::PixelFormat;
use fringe::frame::{Frame, PixelBuffer};
use serde::Deserialize;
use std::path::Path;

/// Longest raw file: the largest frame in two bytes a pixel, and a header.
const MOST_BYTES: u64 = 2 << 30;

/// What the bytes of a raw file are.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RawImage {
    /// Columns of the image, px.
    pub width_px: u32,
    /// Rows of the image, px.
    pub height_px: u32,
    /// GenICam name of the format, such as "Mono12p".
    pub pixel_format: String,
    /// Bytes before the first pixel.
    #[serde(default)]
    pub header_bytes: u64,
}

impl RawImage {
    /// The format, checked.
    ///
    /// # Errors
    /// A name that GenICam does not have, a size of no frame.
    pub fn format(&self) -> Result<PixelFormat, Box<(&'static str, Problem, String)>> {
        let names = PixelFormat::ALL.map(PixelFormat::name);
        let known = PixelFormat::ALL.into_iter().find(|format| format.name() == self.pixel_format);
        let Some(format) = known else {
            let limit = names.join(", ");
            let remedy = did_you_mean(&self.pixel_format, names, "name the packing as GenICam does");
            let problem = Problem::Value { value: format!("\"{}\"", self.pixel_format), limit };
            return Err(Box::new(("pixel_format", problem, remedy)));
        };
        let sides = 1..=65_535;
        if !sides.contains(&self.width_px) || !sides.contains(&self.height_px) {
            let value = format!("{} × {} px", self.width_px, self.height_px);
            let problem = Problem::Value { value, limit: "1 … 65535 px a side".into() };
            return Err(Box::new(("width_px", problem, String::new())));
        }
        Ok(format)
    }

    /// Reads a frame.
    ///
    /// # Errors
    /// A file that cannot be read or has another number of bytes than stated, values beyond the format's full scale.
    pub fn read(&self, path: &Path, format: PixelFormat) -> Result<Frame, FileError> {
        let bytes = read_bytes(path, MOST_BYTES)?;
        let count = self.width_px as usize * self.height_px as usize;
        let pixels = usize::try_from(self.header_bytes).ok().and_then(|header| bytes.get(header..));
        let width = if format == PixelFormat::Mono8 { 1 } else { 2 };
        let mut out = vec![0_u8; count * width];
        if !pixels.is_some_and(|pixels| format.unpack(pixels, &mut out)) {
            let problem = Problem::Disagreement {
                what: "bytes and layout",
                here: format!("{} bytes", bytes.len()),
                there: format!(
                    "{} × {} px of {} after {} bytes, none above {} DN",
                    self.width_px,
                    self.height_px,
                    format.name(),
                    self.header_bytes,
                    format.full_scale_dn()
                ),
            };
            return Err(FileError::new(
                path,
                problem,
                "correct raw in the layout: size, pixel_format, header_bytes",
            ));
        }
        let pixels = if width == 1 {
            PixelBuffer::Mono8(out)
        } else {
            let words = out.as_chunks::<2>().0.iter().map(|pair| u16::from_ne_bytes(*pair));
            PixelBuffer::Mono16(words.collect())
        };
        let (width_px, height_px) = (self.width_px, self.height_px);
        Ok(Frame { width_px, height_px, full_scale_dn: format.full_scale_dn(), pixels })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(pixel_format: &str, header_bytes: u64, bytes: &[u8]) -> Result<Vec<u16>, String> {
        let raw = RawImage { width_px: 4, height_px: 1, pixel_format: pixel_format.into(), header_bytes };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.raw");
        std::fs::write(&path, bytes).unwrap();
        let format = raw.format().map_err(|fault| fault.1.to_string())?;
        let frame = raw.read(&path, format).map_err(|error| error.to_string())?;
        assert_eq!(frame.full_scale_dn, format.full_scale_dn());
        Ok(match frame.pixels {
            PixelBuffer::Mono8(values) => values.into_iter().map(u16::from).collect(),
            PixelBuffer::Mono16(values) => values,
        })
    }

    /// 1, 2, 3 and the full value in each packing.
    #[test]
    fn every_packing_is_unpacked() {
        assert_eq!(read("Mono8", 2, &[9, 9, 1, 2, 3, 255]).unwrap(), [1, 2, 3, 255]);
        assert_eq!(read("Mono12", 0, &[1, 0, 2, 0, 3, 0, 255, 15]).unwrap(), [1, 2, 3, 4095]);
        // Least significant bits first: 1 | 2 << 10 | 3 << 20 | 1023 << 30.
        assert_eq!(read("Mono10p", 0, &[0x01, 0x08, 0x30, 0xc0, 0xff]).unwrap(), [1, 2, 3, 1023]);
        assert_eq!(read("Mono12p", 0, &[0x01, 0x20, 0x00, 0x03, 0xf0, 0xff]).unwrap(), [1, 2, 3, 4095]);
        // High eight bits of both pixels outside, the low ones between them.
        assert_eq!(read("Mono12Packed", 0, &[0x00, 0x21, 0x00, 0x00, 0xf3, 0xff]).unwrap(), [1, 2, 3, 4095]);
        assert_eq!(read("Mono10Packed", 0, &[0x00, 0x21, 0x00, 0x00, 0x33, 0xff]).unwrap(), [1, 2, 3, 1023]);
    }

    #[test]
    fn bytes_that_do_not_fit_are_refused_with_both_numbers() {
        let short = read("Mono12p", 0, &[0; 5]).unwrap_err();
        assert!(short.contains("5 bytes") && short.contains("Mono12p"), "{short}");
        assert!(read("Mono10", 0, &[0xff; 8]).unwrap_err().contains("1023 DN"));
        assert!(read("Mono8", 100, &[0; 4]).is_err());
        assert!(read("Mono11", 0, &[0; 8]).unwrap_err().contains("Mono12p"));
    }
}
