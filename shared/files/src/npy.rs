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
    let (header, data, numbers) = numbers(&bytes, fault)?;
    let count = numbers.as_ref().and_then(|numbers| numbers.count_in(data));
    let values = match numbers {
        Some(Values::F32(values)) => values,
        Some(Values::F64(values)) => values.into_iter().map(|value| value as f32).collect(),
        _ => return Err(fault("holds numbers other than little-endian float32 or float64")),
    };
    let (height_px, width_px) =
        shape(header).ok_or_else(|| fault("is not two-dimensional with 1 to 65535 rows and columns"))?;
    if count != Some(width_px as usize * height_px as usize) {
        return Err(fault("does not have the length that its shape states"));
    }
    Ok(Raster { width_px, height_px, values })
}

/// Numbers of an array as the file has them.
#[derive(Debug, Clone, PartialEq)]
pub enum Values {
    /// Bytes; `bool` too, as 0 and 1.
    U8(Vec<u8>),
    /// Values in single precision.
    F32(Vec<f32>),
    /// Values in double precision.
    F64(Vec<f64>),
}

impl Values {
    /// How many numbers there are; `None` where they are not the whole of the data.
    fn count_in(&self, data: &[u8]) -> Option<usize> {
        let (count, size) = match self {
            Self::U8(values) => (values.len(), 1),
            Self::F32(values) => (values.len(), 4),
            Self::F64(values) => (values.len(), 8),
        };
        (count * size == data.len()).then_some(count)
    }
}

/// An array of any number of dimensions, the last one fastest.
#[derive(Debug, Clone, PartialEq)]
pub struct Array {
    /// Length of each dimension.
    pub shape: Vec<usize>,
    /// As many values as the lengths multiply to.
    pub values: Values,
}

/// Reads an array of `uint8`, `bool`, `float32` or `float64`.
///
/// # Errors
/// No such file, another kind of file or of numbers, or a length that does not fit the shape.
pub fn read_array(path: &Path) -> Result<Array, FileError> {
    let bytes = read_bytes(path, LIMIT_BYTES)?;
    let fault = |what: &str| {
        let remedy = "write an array of uint8, float32 or float64, rows first, with numpy.save";
        FileError::new(path, Problem::Unsupported(what.to_owned()), remedy)
    };
    let (header, data, numbers) = numbers(&bytes, fault)?;
    let values = numbers
        .ok_or_else(|| fault("holds numbers other than uint8, float32 and float64 (little-endian)"))?;
    let shape = dimensions(header).ok_or_else(|| fault("has no shape"))?;
    let count = shape.iter().try_fold(1_usize, |product, side| product.checked_mul(*side));
    if count.is_none() || count != values.count_in(data) {
        return Err(fault("is shorter or longer than its shape says"));
    }
    Ok(Array { shape, values })
}

/// Header, data and numbers of a file; no numbers where they are of another kind.
fn numbers(
    bytes: &[u8],
    fault: impl Fn(&str) -> FileError,
) -> Result<(&str, &[u8], Option<Values>), FileError> {
    let (header, data) = split(bytes).ok_or_else(|| fault("is no NumPy file"))?;
    if field(header, "fortran_order") != Some("False") {
        return Err(fault("holds columns first"));
    }
    let values = match field(header, "descr").map(|text| text.trim_matches(['\'', '"'])) {
        Some("|u1" | "|b1") => Values::U8(data.to_vec()),
        Some("<f4") => Values::F32(data.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect()),
        Some("<f8") => Values::F64(data.as_chunks::<8>().0.iter().map(|b| f64::from_le_bytes(*b)).collect()),
        _ => return Ok((header, data, None)),
    };
    Ok((header, data, Some(values)))
}

/// Lengths of all dimensions in the header.
fn dimensions(header: &str) -> Option<Vec<usize>> {
    let inside = header.split_once("'shape':")?.1.split_once('(')?.1.split_once(')')?.0;
    inside.split(',').map(str::trim).filter(|text| !text.is_empty()).map(|text| text.parse().ok()).collect()
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
    fn arrays_have_the_shape_and_numbers_of_the_file() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.npy");
        let file = |descr: &str, shape: &str, data: &[u8]| {
            let header = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}\n");
            let mut bytes =
                [MAGIC, &[1, 0], &(header.len() as u16).to_le_bytes(), header.as_bytes()].concat();
            bytes.extend(data);
            std::fs::write(&path, bytes).unwrap();
            read_array(&path)
        };
        let bytes = file("|u1", "(2, 1, 3)", &[1, 2, 3, 4, 5, 6]).unwrap();
        assert_eq!(bytes, Array { shape: vec![2, 1, 3], values: Values::U8(vec![1, 2, 3, 4, 5, 6]) });
        let double = file("<f8", "(1,)", &2.5_f64.to_le_bytes()).unwrap();
        assert_eq!(double, Array { shape: vec![1], values: Values::F64(vec![2.5]) });
        let single = file("<f4", "()", &(-1.0_f32).to_le_bytes()).unwrap();
        assert_eq!(single, Array { shape: vec![], values: Values::F32(vec![-1.0]) });
        let huge = format!("({0}, {0}, {0})", usize::MAX / 2);
        for (descr, shape, data) in [
            ("|u1", "(2, 2)", &[1, 2, 3][..]),
            ("|u1", &huge, &[1][..]),
            ("<f4", "(1,)", &[0; 5][..]),
            ("<i8", "(1,)", &[0; 8][..]),
            ("|u1", "(-1,)", &[0][..]),
        ] {
            assert!(
                file(descr, shape, data).unwrap_err().to_string().contains("numpy.save"),
                "{descr} {shape}"
            );
        }
    }

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
