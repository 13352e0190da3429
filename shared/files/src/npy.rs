//! Rasters of numbers as NumPy files (`.npy`): what other people's programs read and write without a library of ours.
//!
//! Written: two-dimensional little-endian `f32`, rows first. Read: the same, or `f64`.

use crate::atomic;
use crate::document::read_bytes;
use crate::error::{FileError, Problem};
use std::io::Write;
use std::path::Path;

/// The first bytes of every file.
const MAGIC: &[u8] = b"\x93NUMPY";

/// Largest raster: as many pixels as a decoder takes, in double precision.
const LIMIT_BYTES: u64 = fringe::decode::MAX_PIXELS as u64 * 8 + 65_536;

/// Numbers, row by row.
#[derive(Debug, Clone, PartialEq)]
pub struct Raster {
    /// Columns of the raster, px.
    pub width_px: u32,
    /// Rows of the raster, px.
    pub height_px: u32,
    /// width × height values; NaN where there is none.
    pub values: Vec<f32>,
}

/// Writes a raster in one step.
///
/// # Errors
/// Values that do not fill it; whatever the disk reports.
pub fn write(path: &Path, raster: &Raster) -> Result<(), FileError> {
    let (width, height) = (raster.width_px, raster.height_px);
    if raster.values.len() as u64 != u64::from(width) * u64::from(height) {
        let problem = Problem::Disagreement {
            what: "sizes",
            here: format!("{} values", raster.values.len()),
            there: format!("{width} × {height} px"),
        };
        return Err(FileError::new(path, problem, ""));
    }
    let mut header = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({height}, {width}), }}");
    // Magic, version and length take ten bytes; the data begin at a multiple of 64, after a line feed.
    let padded = (header.len() + 11).next_multiple_of(64) - 11;
    header.extend(std::iter::repeat_n(' ', padded - header.len()));
    atomic::write_with(path, |out| {
        out.write_all(MAGIC)?;
        out.write_all(&[1, 0])?;
        out.write_all(&(header.len() as u16 + 1).to_le_bytes())?;
        out.write_all(header.as_bytes())?;
        out.write_all(b"\n")?;
        raster.values.iter().try_for_each(|value| out.write_all(&value.to_le_bytes()))
    })
}

/// Reads a raster.
///
/// # Errors
/// No such file, another kind of file or of numbers, or a length that does not fit the shape.
pub fn read(path: &Path) -> Result<Raster, FileError> {
    let bytes = read_bytes(path, LIMIT_BYTES)?;
    let fault = |what: &str| {
        let remedy = "write a two-dimensional array of float32 with numpy.save";
        FileError::new(path, Problem::Unsupported(what.to_owned()), remedy)
    };
    let (header, data) = split(&bytes).ok_or_else(|| fault("is no NumPy file"))?;
    let double = match field(header, "descr").map(|text| text.trim_matches(['\'', '"'])) {
        Some("<f4") => false,
        Some("<f8") => true,
        _ => return Err(fault("holds numbers other than little-endian float32 or float64")),
    };
    if field(header, "fortran_order") != Some("False") {
        return Err(fault("holds columns first"));
    }
    let (height_px, width_px) =
        shape(header).ok_or_else(|| fault("is not two-dimensional with 1 to 65535 rows and columns"))?;
    let pixels = width_px as usize * height_px as usize;
    if data.len() != pixels * if double { 8 } else { 4 } {
        return Err(fault("is shorter or longer than its shape says"));
    }
    let values = if double {
        data.as_chunks::<8>().0.iter().map(|b| f64::from_le_bytes(*b) as f32).collect()
    } else {
        data.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect()
    };
    Ok(Raster { width_px, height_px, values })
}

/// Splits a file into its header and its data.
fn split(bytes: &[u8]) -> Option<(&str, &[u8])> {
    let rest = bytes.strip_prefix(MAGIC)?;
    let (length, rest) = match rest.first()? {
        1 => (u16::from_le_bytes(rest.get(2..4)?.try_into().ok()?) as usize, rest.get(4..)?),
        2 | 3 => (u32::from_le_bytes(rest.get(2..6)?.try_into().ok()?) as usize, rest.get(6..)?),
        _ => return None,
    };
    Some((std::str::from_utf8(rest.get(..length)?).ok()?, rest.get(length..)?))
}

/// What stands after a key of the header, up to the next comma.
fn field<'a>(header: &'a str, key: &str) -> Option<&'a str> {
    let after = header.split_once(&format!("'{key}':"))?.1.trim_start();
    Some(after.split(',').next()?.trim())
}

fn shape(header: &str) -> Option<(u32, u32)> {
    let inside = header.split_once("'shape':")?.1.split_once('(')?.1.split_once(')')?.0;
    let (rows, columns) = inside.trim_end_matches(',').split_once(',')?;
    let side = |text: &str| text.trim().parse::<u32>().ok().filter(|side| (1..=65_535).contains(side));
    Some((side(rows)?, side(columns)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rasters_come_back_and_damage_is_named() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.npy");
        let raster =
            Raster { width_px: 3, height_px: 2, values: vec![0.0, -1.5, 2.0, 3.0, f32::INFINITY, 5.0] };
        write(&path, &raster).unwrap();
        assert_eq!(read(&path).unwrap(), raster);
        let bytes = std::fs::read(&path).unwrap();
        assert!((bytes.len() - 24).is_multiple_of(64), "the data are aligned");
        for length in 0..bytes.len() {
            std::fs::write(&path, &bytes[..length]).unwrap();
            assert!(read(&path).is_err(), "{length} bytes");
        }
        let text = String::from_utf8_lossy(&bytes[..128]).into_owned();
        for (from, to) in [("<f4", ">f4"), ("False", "True "), ("(2, 3)", "(2,)  "), ("(2, 3)", "(0, 3)")] {
            assert!(text.contains(from));
            let mut other = bytes.clone();
            let at = bytes.windows(from.len()).position(|w| w == from.as_bytes()).unwrap();
            other[at..at + to.len()].copy_from_slice(to.as_bytes());
            std::fs::write(&path, &other).unwrap();
            assert!(read(&path).unwrap_err().to_string().contains("numpy.save"), "{to}");
        }
        assert!(write(&path, &Raster { width_px: 4, ..raster }).is_err());
    }
}
