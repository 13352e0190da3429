//! CAD in STEP (ISO 10303-21: AP203, AP214, AP242): solids as triangles, and the elements of inspection plans on their faces.
//!
//! [`part21`] reads the entities, [`placed`] finds the solids and where an assembly places them, [`solids`] reads their faces, and
//! [`metrology::cad`] makes triangles of them. What is not read is refused with its number and type.

mod curves;
mod graph;
mod part21;
mod placed;
mod solids;
mod surfaces;
#[cfg(test)]
mod tests;
mod units;

use crate::document::read_bytes;
use crate::error::{FileError, Problem};
use crate::memory;
use graph::Graph;
use metrology::cad::{BrepError, CadFeature, CadMesh, FreeFace, features, free_faces};
use metrology::spatial::Aabb;
use nalgebra::Point3;
use placed::Solid;
use std::path::Path;

/// Largest file: some ten million entities.
const LARGEST_BYTES: u64 = 1 << 30;

/// Memory that the entities of a file take, in bytes for each byte of it.
const MEMORY_PER_BYTE: u64 = 10;

/// Most triangles of all solids, each as often as it is placed.
const MOST_TRIANGLES: usize = 20_000_000;

/// Triangles are so much of the part's size off their surfaces, by default.
const CHORD_PER_SIZE: f64 = 2e-5;

/// Limits of that default, mm: far below what fringes resolve, and no more triangles than help.
const CHORD_MM: [f64; 2] = [0.0005, 0.02];

/// Distances that may be asked for, mm.
const ASKED_MM: std::ops::RangeInclusive<f64> = 1e-5..=10.0;

/// Coordinates beyond this are no part, mm.
const FARTHEST_MM: f64 = 1e6;

/// A part in STEP as triangles, with the elements of its solids.
#[derive(Debug, Clone)]
pub struct StepPart {
    /// Solids, each where the assembly places it.
    pub solids: Vec<StepSolid>,
    /// Largest distance between the triangles and their surfaces, mm.
    pub chord_mm: f64,
}

/// A solid of a part, in the part's frame.
#[derive(Debug, Clone)]
pub struct StepSolid {
    /// Name of its representation; empty where there is none.
    pub name: String,
    /// Its triangles; counter-clockwise when seen from outside.
    pub mesh: CadMesh,
    /// Elements on its faces, in the order of these.
    pub features: Vec<CadFeature>,
    /// Faces that are no elements, in the order of the solid.
    pub free_faces: Vec<FreeFace>,
}

impl StepPart {
    /// The triangles of all solids.
    pub fn all_triangles(&self) -> Vec<[Point3<f64>; 3]> {
        let of = |solid: &StepSolid| -> Vec<[Point3<f64>; 3]> {
            let mesh = &solid.mesh;
            mesh.triangles.iter().map(|t| t.map(|c| mesh.corners[c as usize])).collect()
        };
        self.solids.iter().flat_map(of).collect()
    }

    /// Number of triangles of all solids.
    pub fn triangle_count(&self) -> usize {
        self.solids.iter().map(|s| s.mesh.triangles.len()).sum()
    }

    /// Volume of all solids, mm³.
    pub fn volume_mm3(&self) -> f64 {
        self.solids.iter().map(|s| s.mesh.volume_mm3()).sum()
    }

    /// The elements of all solids.
    pub fn features(&self) -> Vec<CadFeature> {
        self.solids.iter().flat_map(|s| s.features.iter().cloned()).collect()
    }

    /// What was read, in words.
    pub fn words(&self) -> String {
        let solids = match self.solids.len() {
            1 => "1 solid".to_owned(),
            count => format!("{count} solids"),
        };
        format!(
            "{solids}, {:.1} mm³, as {} triangles within {} mm of the surfaces",
            self.volume_mm3(),
            self.triangle_count(),
            (self.chord_mm * 1e5).round() / 1e5
        )
    }
}

/// Whether the first bytes of a file are those of STEP; comments may stand before.
pub fn begins_as_step(start: &[u8]) -> bool {
    let mut rest = start.strip_prefix(b"\xef\xbb\xbf").unwrap_or(start).trim_ascii_start();
    while let Some(comment) = rest.strip_prefix(b"/*") {
        let Some(end) = comment.windows(2).position(|w| w == b"*/") else { return false };
        rest = comment[end + 2..].trim_ascii_start();
    }
    rest.starts_with(b"ISO-10303-21")
}

/// Reads a part. Without a distance, triangles lie within 2e-5 of the part's size of their surfaces, at least 0.0005 mm, at most 0.02 mm.
///
/// # Errors
/// Another kind of file, a damaged one, entities that are not read, solids that are not closed; with entity and remedy.
pub fn read_part(path: &Path, chord_mm: Option<f64>) -> Result<StepPart, FileError> {
    let bytes = read_bytes(path, LARGEST_BYTES)?;
    part_of(path, &bytes, chord_mm)
}

/// As [`read_part`], of bytes that were read.
///
/// # Errors
/// As [`read_part`].
pub fn part_of(path: &Path, bytes: &[u8], chord_mm: Option<f64>) -> Result<StepPart, FileError> {
    if let Some(chord) = chord_mm.filter(|chord| !ASKED_MM.contains(chord)) {
        let problem = Problem::Value {
            value: format!("{chord} mm"),
            limit: "triangles may be 1e-5 … 10 mm off their surfaces".into(),
        };
        return Err(FileError::new(path, problem, "give another --chord-mm"));
    }
    if !begins_as_step(bytes) {
        let problem = Problem::Unsupported("does not begin with ISO-10303-21: it is no STEP file".into());
        return Err(FileError::new(path, problem, "name a file that a CAD system exported as STEP"));
    }
    memory::check(path, &format!("{} bytes of STEP", bytes.len()), MEMORY_PER_BYTE * bytes.len() as u64)?;
    let graph = Graph::read(path, bytes)?;
    let found = placed::solids(&graph)?;
    let size_mm = size_mm(path, &found)?;
    let chord_mm = chord_mm.unwrap_or((CHORD_PER_SIZE * size_mm).clamp(CHORD_MM[0], CHORD_MM[1]));
    let (mut solids, mut count) = (Vec::new(), 0);
    for solid in &found {
        let mesh =
            solid.brep.mesh(chord_mm, MOST_TRIANGLES).map_err(|error| refused(&graph, solid, &error))?;
        count += mesh.triangles.len() * solid.places.len();
        if count > MOST_TRIANGLES {
            let error = BrepError::TooMany { limit: MOST_TRIANGLES, chord_mm };
            return Err(refused(&graph, solid, &error));
        }
        let free_faces = free_faces(&solid.brep, &mesh);
        for (number, place) in solid.places.iter().enumerate() {
            let mesh = mesh.clone().moved(place);
            let mut features = features(&solid.brep, place, &mesh);
            for feature in &mut features {
                feature.instance = (solid.places.len() > 1).then_some(number + 1);
            }
            solids.push(StepSolid {
                name: solid.name.clone(),
                mesh,
                features,
                free_faces: free_faces.clone(),
            });
        }
    }
    Ok(StepPart { solids, chord_mm })
}

/// Diagonal of the box about all solids, mm.
fn size_mm(path: &Path, solids: &[Solid]) -> Result<f64, FileError> {
    let reach = |s: &Solid| s.places.iter().flat_map(|place| s.brep.reach(place)).collect::<Vec<_>>();
    let places: Vec<Point3<f64>> = solids.iter().flat_map(reach).collect();
    if places.iter().any(|p| p.iter().any(|c| !c.is_finite() || c.abs() > FARTHEST_MM)) {
        let what = format!("has corners beyond ±{FARTHEST_MM:.0e} mm: no part is there");
        let remedy = "check the unit of the export, and move the part to its origin";
        return Err(FileError::new(path, Problem::Unsupported(what), remedy));
    }
    if places.is_empty() {
        return Ok(0.0);
    }
    let bounds = Aabb::of(&places);
    Ok((bounds.high - bounds.low).norm())
}

/// Why a solid does not become triangles, with the remedy.
fn refused(graph: &Graph, solid: &Solid, error: &BrepError) -> FileError {
    let remedy = match error {
        BrepError::TooMany { .. } => "give a larger --chord-mm, or export single parts",
        _ => "heal the part in the CAD system and export it again, or export it as STL",
    };
    let what = format!("#{} ({}): {error}", solid.id, graph.kind(solid.id));
    FileError::new(graph.path(), Problem::Syntax(what), remedy)
}
