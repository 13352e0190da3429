//! Point clouds as PLY files.
//!
//! Written: binary little-endian, `x y z` as double, `nx ny nz sigma modulation` as float, `pair` as uchar, 45 bytes a
//! point, positions in mm in the world frame; `sigma_shared` as float behind them where any point has it. Read: any PLY
//! (text, both byte orders, float or double, elements and properties in any order; unknown ones are skipped).

mod mesh;
mod text;
mod write;

pub use mesh::read_triangles;
pub(crate) use write::comment_line;
pub use write::{write_cloud, write_deviations};

use crate::document::{open_input, refuse_special};
use crate::error::{FileError, Problem};
use crate::memory;
use fringe::cloud::Point;
use ply_rs_bw::parser::{Parser, Reader};
use ply_rs_bw::ply::{
    ElementDef, Encoding, Header, PropertyAccess, PropertyAccessResult, PropertyType, ScalarType,
};
use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::Path;

/// A header is shorter than this: hundreds of times the longest one meant.
const HEADER_LIMIT_BYTES: usize = 1 << 20;

/// The last line of the header.
const HEADER_END: &[u8] = b"end_header";

/// A bounding box below this diagonal is more likely in metres than a part of that size in mm.
const METRES_BELOW_MM: f64 = 1.0;

/// What a comment `unit` may say.
const MILLIMETRES: [&str; 5] = ["mm", "millimeter", "millimeters", "millimetre", "millimetres"];

/// A cloud as read.
#[derive(Debug, Clone, Default)]
pub struct Cloud {
    /// The points, in the order of the file. What the file does not carry (see `columns`) is zero.
    pub points: Vec<Point>,
    /// Which properties beyond the position the file carries.
    pub columns: Columns,
    /// Points whose position is NaN or infinite: counted here, left out of `points`.
    pub dropped: usize,
    /// Comment lines of the header.
    pub comments: Vec<String>,
}

/// Properties that a cloud may carry.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Columns {
    /// Normals in the properties `nx ny nz`.
    pub normal: bool,
    /// Standard uncertainty in the property `sigma`.
    pub sigma: bool,
    /// Modulation in the property `modulation`.
    pub modulation: bool,
    /// Index of the pair in the property `pair`.
    pub pair: bool,
}

impl Cloud {
    /// The value of a comment `key: value`.
    pub fn comment(&self, key: &str) -> Option<&str> {
        self.comments.iter().find_map(|line| line.strip_prefix(key)?.strip_prefix(": "))
    }

    /// Smallest and largest coordinates, mm; `None` for an empty cloud.
    pub fn bounds_mm(&self) -> Option<([f64; 3], [f64; 3])> {
        let first = self.points.first()?.position_mm;
        Some(self.points.iter().fold((first, first), |(low, high), point| {
            let fold = |a: [f64; 3], pick: fn(f64, f64) -> f64| {
                std::array::from_fn(|i| pick(a[i], point.position_mm[i]))
            };
            (fold(low, f64::min), fold(high, f64::max))
        }))
    }

    /// A sentence for a cloud whose extent suggests metres instead of mm.
    pub fn unit_hint(&self) -> Option<String> {
        let (low, high) = self.bounds_mm()?;
        let diagonal_mm = (0..3).map(|i| (high[i] - low[i]).powi(2)).sum::<f64>().sqrt();
        (self.points.len() > 1 && diagonal_mm < METRES_BELOW_MM).then(|| {
            format!(
                "the cloud's diagonal is {diagonal_mm:.4} mm: is the file in metres? lengths are read as mm"
            )
        })
    }
}

/// Reads a cloud.
///
/// # Errors
/// Not a PLY file, no `vertex` element with `x y z`, fewer or more bytes than its header promises, or a damaged body.
pub fn read_cloud(path: &Path) -> Result<Cloud, FileError> {
    let (header, mut reader) = open(path)?;
    read_body(path, &header, &mut reader)
}

/// Opens a PLY file with points and reads its header.
fn open(path: &Path) -> Result<(Header, Reader<BufReader<File>>), FileError> {
    refuse_special(path)?;
    let (file, metadata) = open_input(path)?;
    let mut buffered = BufReader::with_capacity(HEADER_LIMIT_BYTES, file);
    let start = buffered.fill_buf().map_err(|source| FileError::io(path, "read it", source))?;
    // A text without line ends would be read whole as one line.
    if !start.starts_with(b"ply") || !start.windows(HEADER_END.len()).any(|window| window == HEADER_END) {
        let problem = Problem::Syntax(format!(
            "is no PLY file: it does not begin with \"ply\", or \"end_header\" does not follow within {HEADER_LIMIT_BYTES} bytes"
        ));
        return Err(FileError::new(path, problem, "name a point cloud in PLY format"));
    }
    let mut reader = Reader::new(buffered);
    let header = Parser::<Vertex>::new().read_header(&mut reader).map_err(|error| {
        let problem = Problem::Syntax(format!("is no PLY file: {}", one_line(&error.to_string())));
        FileError::new(path, problem, "name a point cloud in PLY format")
    })?;
    check_header(path, &header, metadata.len())?;
    Ok((header, reader))
}

fn one_line(text: &str) -> String {
    text.replace('\n', " ")
}

/// A body that does not hold what the header promises.
fn damaged(path: &Path, error: &dyn std::fmt::Display) -> FileError {
    let problem = Problem::Syntax(format!("is damaged or truncated: {}", one_line(&error.to_string())));
    FileError::new(path, problem, "write or copy it again")
}

fn read_body<T: BufRead>(path: &Path, header: &Header, reader: &mut Reader<T>) -> Result<Cloud, FileError> {
    let mut cloud = None;
    for (name, element) in &header.elements {
        if name != "vertex" {
            Parser::<Skipped>::new()
                .read_payload_for_element(reader, element, header)
                .map_err(|error| damaged(path, &error))?;
            continue;
        }
        let vertices = if header.encoding == Encoding::Ascii && text::is_flat(element) {
            text::vertices(path, element, reader)?
        } else {
            let vertices = Parser::<Vertex>::new().read_payload_for_element(reader, element, header);
            vertices.map_err(|error| damaged(path, &error))?
        };
        cloud = Some(cloud_of(vertices, header, element));
    }
    let missing =
        || FileError::new(path, Problem::Missing("the element \"vertex\"".into()), "is this a point cloud?");
    let cloud = cloud.ok_or_else(missing)?;
    refuse_surplus(path, header, reader)?;
    check_values(path, &cloud)?;
    Ok(cloud)
}

/// Refuses another unit than mm, and uncertainties that none can be.
fn check_values(path: &Path, cloud: &Cloud) -> Result<(), FileError> {
    if let Some(unit) = cloud.comment("unit").filter(|unit| !MILLIMETRES.contains(&unit.trim())) {
        let problem = Problem::Unsupported(format!("has lengths in \"{unit}\" by its comment \"unit\""));
        return Err(FileError::new(path, problem, "lengths are read as mm: convert them, and the comment"));
    }
    let outside = |value: f32| value < 0.0 || value.is_infinite();
    let sigmas = cloud.points.iter().filter(|point| outside(point.sigma_mm)).count();
    refuse_uncertainties(path, cloud, "\"sigma\" is negative or infinite", sigmas)?;
    let shared =
        cloud.points.iter().filter(|point| outside(point.shared_mm) || point.shared_mm.is_nan()).count();
    refuse_uncertainties(path, cloud, "\"sigma_shared\" is negative or infinite or no number", shared)
}

/// Refuses a cloud in which so many uncertainties are none.
fn refuse_uncertainties(path: &Path, cloud: &Cloud, what: &str, count: usize) -> Result<(), FileError> {
    if count == 0 {
        return Ok(());
    }
    let problem = Problem::Unsupported(format!("has {count} of {} points whose {what}", cloud.points.len()));
    let remedy = "a standard uncertainty is 0 mm or more: write the file again, or leave the property out";
    Err(FileError::new(path, problem, remedy))
}

/// A cloud of the vertices read, without those that are nowhere.
fn cloud_of(vertices: Vec<Vertex>, header: &Header, element: &ElementDef) -> Cloud {
    let total = vertices.len();
    let finite = |point: &Point| point.position_mm.iter().all(|v| v.is_finite());
    let points: Vec<Point> = vertices.into_iter().map(|vertex| vertex.0).filter(finite).collect();
    let has = |name: &str| element.properties.get(name).is_some();
    Cloud {
        dropped: total - points.len(),
        points,
        columns: Columns {
            normal: ["nx", "ny", "nz"].into_iter().all(has),
            sigma: has("sigma"),
            modulation: has("modulation"),
            pair: has("pair"),
        },
        comments: header.comments.clone(),
    }
}

/// Refuses a body that goes on after the last element that the header counts: a writer that died before it could
/// correct its header, or another count or type than meant; the points read would then be a part, or displaced.
fn refuse_surplus<T: BufRead>(path: &Path, header: &Header, reader: &mut Reader<T>) -> Result<(), FileError> {
    let mut surplus = 0_u64;
    let mut blank = true;
    loop {
        let rest = reader
            .get_mut()
            .fill_buf()
            .map_err(|source| FileError::io(path, "read it to its end", source))?;
        let length = rest.len();
        if length == 0 {
            break;
        }
        blank &= rest.iter().all(u8::is_ascii_whitespace);
        surplus += length as u64;
        reader.get_mut().consume(length);
    }
    // Line ends behind the last element are no element.
    if blank {
        return Ok(());
    }
    let counts: Vec<String> =
        header.elements.iter().map(|(name, element)| format!("{} \"{name}\"", element.count)).collect();
    let problem = Problem::Disagreement {
        what: "header and body",
        here: format!("the header counts {}", counts.join(", ")),
        there: format!("{surplus} bytes follow them"),
    };
    Err(FileError::new(path, problem, "correct the counts and types in the header, or write the file again"))
}

/// Refuses headers that promise what the file cannot hold, before anything is allocated for it.
fn check_header(path: &Path, header: &Header, file_bytes: u64) -> Result<(), FileError> {
    let Some(vertex) = header.elements.get("vertex") else {
        let problem = Problem::Missing("the element \"vertex\"".into());
        return Err(FileError::new(path, problem, "is this a point cloud?"));
    };
    for name in ["x", "y", "z"] {
        match vertex.properties.get(name).map(|property| &property.data_type) {
            Some(PropertyType::Scalar(ScalarType::Float | ScalarType::Double)) => {}
            None => {
                let problem = Problem::Missing(format!("the property \"{name}\" of \"vertex\""));
                return Err(FileError::new(path, problem, "a point has x, y and z in mm"));
            }
            Some(other) => {
                let problem = Problem::Unsupported(format!("property \"{name}\" has the type {other:?}"));
                return Err(FileError::new(path, problem, "write positions as float or double"));
            }
        }
    }
    for (name, element) in &header.elements {
        let needed = least_bytes(element, header.encoding).saturating_mul(element.count as u64);
        if needed > file_bytes || (element.properties.is_empty() && element.count > 0) {
            let problem = Problem::Disagreement {
                what: "header and size",
                here: format!("{} elements \"{name}\" need at least {needed} bytes", element.count),
                there: format!("the file has {file_bytes}"),
            };
            return Err(FileError::new(path, problem, "truncated? write or copy it again"));
        }
        let bytes = held_bytes(name).saturating_mul(element.count as u64);
        memory::check(path, &format!("{} elements \"{name}\"", element.count), bytes)?;
    }
    Ok(())
}

/// Memory that one element takes while it is read: lists grow by doubling. Others than points and faces are not kept.
fn held_bytes(name: &str) -> u64 {
    match name {
        "vertex" => 2 * size_of::<Point>() as u64,
        // Its list of three corners, and the triangle.
        "face" => {
            2 * (size_of::<Vec<i64>>() + 3 * size_of::<i64>()) as u64 + size_of::<[[f64; 3]; 3]>() as u64
        }
        _ => 0,
    }
}

/// Bytes that one element takes at least.
fn least_bytes(element: &ElementDef, encoding: Encoding) -> u64 {
    let scalar = |kind: &ScalarType| match kind {
        ScalarType::Char | ScalarType::UChar => 1,
        ScalarType::Short | ScalarType::UShort => 2,
        ScalarType::Int | ScalarType::UInt | ScalarType::Float => 4,
        ScalarType::Double => 8,
    };
    let property = |kind: &PropertyType| match (encoding, kind) {
        // A digit and what separates it from the next one; the last line may lack its end.
        (Encoding::Ascii, _) => 1,
        (_, PropertyType::Scalar(kind) | PropertyType::List(kind, _)) => scalar(kind),
    };
    element.properties.iter().map(|(_, definition)| property(&definition.data_type)).sum()
}

/// A point on its way from the file.
#[derive(Debug)]
struct Vertex(Point);

impl PropertyAccess for Vertex {
    fn new() -> Self {
        Self(bytemuck::Zeroable::zeroed())
    }

    fn set_double(&mut self, name: &str, value: f64) -> PropertyAccessResult {
        let point = &mut self.0;
        match name {
            "x" => point.position_mm[0] = value,
            "y" => point.position_mm[1] = value,
            "z" => point.position_mm[2] = value,
            "nx" => point.normal[0] = value as f32,
            "ny" => point.normal[1] = value as f32,
            "nz" => point.normal[2] = value as f32,
            "sigma" => point.sigma_mm = value as f32,
            "sigma_shared" => point.shared_mm = value as f32,
            "modulation" => point.modulation = value as f32,
            _ => return PropertyAccessResult::Ignored,
        }
        PropertyAccessResult::Set
    }

    fn set_float(&mut self, name: &str, value: f32) -> PropertyAccessResult {
        self.set_double(name, f64::from(value))
    }

    fn set_uchar(&mut self, name: &str, value: u8) -> PropertyAccessResult {
        self.set_uint(name, u32::from(value))
    }

    fn set_ushort(&mut self, name: &str, value: u16) -> PropertyAccessResult {
        self.set_uint(name, u32::from(value))
    }

    fn set_uint(&mut self, name: &str, value: u32) -> PropertyAccessResult {
        if name != "pair" {
            return PropertyAccessResult::Ignored;
        }
        self.0.pair = value;
        PropertyAccessResult::Set
    }

    fn set_int(&mut self, name: &str, value: i32) -> PropertyAccessResult {
        u32::try_from(value).map_or(PropertyAccessResult::Ignored, |value| self.set_uint(name, value))
    }
}

/// An element that is read past.
#[derive(Debug)]
struct Skipped;

impl PropertyAccess for Skipped {
    fn new() -> Self {
        Self
    }
}

#[cfg(test)]
mod tests;
