//! What `compare` and `register` share: reading clouds and references, units, starts.

use anyhow::{Context, Result, anyhow, bail};
use files::ply::Cloud;
use files::surface_file::{self, Surface};
use fringe::cloud::Point;
use fringe::geometry::pose::Pose;
use metrology::reference::{CloudReference, Reference};
use metrology::register::InitialPose;
use metrology::spatial::{Aabb, TriangleMesh};
use nalgebra::{Matrix3, Point3, Vector3};
use std::path::Path;
use std::str::FromStr;

/// Two things that differ in size by more than this are not in the same unit: metres against mm make 1000, inches 25.4.
const UNIT_RATIO: f64 = 300.0;

/// Rows of a rotation may be off unit length and right angles by so much: six printed digits.
const ROTATION_TOLERANCE: f64 = 1e-5;

/// Reads a cloud and reports the points left out.
pub fn read_cloud(path: &Path) -> Result<Cloud> {
    let cloud = surface_file::read_cloud(path)?;
    said(path, &cloud);
    if cloud.points.is_empty() {
        bail!("{}: has no point with finite coordinates; is this the right file?", path.display());
    }
    Ok(cloud)
}

/// As [`read_cloud`], for commands that have no reference to hold the cloud's size against: refuses what looks like metres.
pub fn read_cloud_in_mm(path: &Path) -> Result<Cloud> {
    let cloud = read_cloud(path)?;
    if let Some(hint) = cloud.unit_hint() {
        bail!("{}: {hint}; convert it", path.display());
    }
    Ok(cloud)
}

fn said(path: &Path, cloud: &Cloud) {
    if cloud.dropped > 0 {
        let points = if cloud.dropped == 1 { "point" } else { "points" };
        eprintln!("{}: {} {points} without finite coordinates left out", path.display(), cloud.dropped);
    }
}

/// How the reference of a command becomes triangles.
#[derive(clap::Args)]
pub struct Chord {
    /// Largest distance between triangles and surfaces of a reference in STEP, mm; default: 2e-5 of its size, within 0.0005 … 0.02.
    #[arg(long, value_name = "MM", value_parser = length)]
    chord_mm: Option<f64>,
}

impl Chord {
    /// Reads a cloud or mesh; the solids of a STEP file become triangles, and it is said how many.
    fn read(&self, path: &Path) -> Result<Surface> {
        if surface_file::is_step(path)? {
            let part = files::step_file::read_part(path, self.chord_mm)?;
            eprintln!("{}: {}", path.display(), part.words());
            return Ok(Surface::Mesh(part.all_triangles()));
        }
        if let Some(chord) = self.chord_mm {
            bail!(
                "--chord-mm {chord}: {} is no STEP file: its points or triangles stay as they are; leave it out",
                path.display()
            );
        }
        Ok(surface_file::read(path)?)
    }
}

/// Reads a reference: a cloud or a mesh.
pub fn read_reference(
    path: &Path,
    chord: &Chord,
    towards: Vector3<f64>,
    radius_mm: Option<f64>,
) -> Result<Reference> {
    let named = || path.display().to_string();
    match chord.read(path)? {
        Surface::Mesh(triangles) => {
            let mesh = TriangleMesh::new(&triangles).with_context(named)?;
            if mesh.without_area() > 0 {
                eprintln!("{}: {} triangles without area left out", named(), mesh.without_area());
            }
            if mesh.turned() > 0 {
                eprintln!(
                    "{}: {} of {} triangles faced the wrong way and were turned round",
                    named(),
                    mesh.turned(),
                    mesh.triangles().len()
                );
            }
            if mesh.border_edges() > 0 {
                eprintln!(
                    "{}: the mesh is open: it ends at {} edges; points beside it have no deviation",
                    named(),
                    mesh.border_edges()
                );
            }
            Ok(Reference::Mesh(mesh))
        }
        Surface::Cloud(cloud) => {
            said(path, &cloud);
            let reference = CloudReference::new(&cloud.points, towards, radius_mm).with_context(named)?;
            Ok(Reference::Cloud(reference))
        }
    }
}

/// Refuses a cloud and a reference whose sizes differ as if by their units.
pub fn check_units(cloud: (&Path, &[Point]), reference: (&Path, &Reference)) -> Result<()> {
    let positions: Vec<Point3<f64>> = cloud.1.iter().map(Point::position).collect();
    let diagonal = |b: Aabb| (b.high - b.low).norm();
    let (own, other) = (diagonal(Aabb::of(&positions)), diagonal(reference.1.bounds()));
    let ratio = own.max(other) / own.min(other);
    if own > 0.0 && other > 0.0 && ratio > UNIT_RATIO {
        let smaller = if own < other { cloud.0 } else { reference.0 };
        bail!(
            "{}: its diagonal is {own:.4} mm, that of {} {other:.4} mm: a ratio of {ratio:.0}, limit {UNIT_RATIO}; is {} in \
             metres? convert it to mm",
            cloud.0.display(),
            reference.0.display(),
            smaller.display()
        );
    }
    Ok(())
}

/// Points after a motion, with their normals.
pub fn moved(points: &[Point], pose: &Pose) -> Vec<Point> {
    let rotated = |normal: [f32; 3]| -> [f32; 3] {
        (pose.rotation * Vector3::from(normal.map(f64::from))).map(|v| v as f32).into()
    };
    let one = |p: &Point| Point {
        position_mm: pose.point(&p.position().coords).into(),
        normal: rotated(p.normal),
        ..*p
    };
    points.iter().map(one).collect()
}

/// `search`, `as-it-lies`, or the file of a transform.
pub fn start(text: &str) -> Result<InitialPose> {
    match text {
        "search" => Ok(InitialPose::Search),
        "as-it-lies" => {
            Ok(InitialPose::Given(Pose { rotation: Matrix3::identity(), translation: Vector3::zeros() }))
        }
        file => read_transform(Path::new(file)).map(InitialPose::Given),
    }
}

/// Reads a transform: JSON with `matrix` (as `register` writes it), or 16 numbers row by row.
fn read_transform(path: &Path) -> Result<Pose> {
    let text = files::document::read_text(path)?;
    let numbers: Vec<f64> = if text.trim_start().starts_with('{') {
        let json: serde_json::Value = files::result::read_json(path)?;
        let rows = json.get("matrix").and_then(|m| m.as_array());
        let rows = rows.ok_or_else(|| {
            anyhow!("{}: matrix: is missing; give four rows of four numbers", path.display())
        })?;
        rows.iter()
            .flat_map(|row| row.as_array().into_iter().flatten())
            .filter_map(serde_json::Value::as_f64)
            .collect()
    } else {
        text.split([',', ' ', '\t', '\n', '\r', ';'])
            .filter(|word| !word.is_empty())
            .map(|word| word.parse().map_err(|_| anyhow!("{}: \"{word}\" is not a number", path.display())))
            .collect::<Result<_>>()?
    };
    pose_of(&numbers).with_context(|| path.display().to_string())
}

fn pose_of(numbers: &[f64]) -> Result<Pose> {
    if numbers.len() != 16 {
        bail!("matrix: {} numbers found, 16 are needed; give four rows of four", numbers.len());
    }
    if let Some((index, value)) = numbers.iter().enumerate().find(|(_, value)| !value.is_finite()) {
        bail!(
            "matrix: entry {value} in row {}, column {} is not finite; give a finite number",
            index / 4 + 1,
            index % 4 + 1
        );
    }
    let at = |row: usize, column: usize| numbers[4 * row + column];
    let rotation = Matrix3::from_fn(at);
    let off = (rotation * rotation.transpose() - Matrix3::identity()).amax();
    let last = [at(3, 0), at(3, 1), at(3, 2), at(3, 3) - 1.0];
    if off > ROTATION_TOLERANCE || last.iter().any(|v| v.abs() > ROTATION_TOLERANCE) {
        bail!(
            "matrix: is not a rigid motion: its rotation is off by {off:.1e}, limit {ROTATION_TOLERANCE:.0e}, or its last row is not 0 0 0 1"
        );
    }
    if rotation.determinant() < 0.0 {
        bail!("matrix: is a reflection (determinant −1); a rigid motion has determinant +1");
    }
    Ok(Pose { rotation, translation: Vector3::new(at(0, 3), at(1, 3), at(2, 3)) })
}

/// A direction given as `x,y,z`.
#[derive(Clone, Copy, Debug)]
pub struct Direction(pub Vector3<f64>);

impl FromStr for Direction {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match numbers(text)?.as_slice() {
            [x, y, z] => Vector3::new(*x, *y, *z).try_normalize(1e-12).map(Self),
            _ => None,
        }
        .ok_or_else(|| "three numbers x,y,z, not all zero".into())
    }
}

/// Finite numbers parted by commas.
fn numbers(text: &str) -> Result<Vec<f64>, String> {
    let one = |part: &str| {
        let number = part.trim().parse::<f64>().ok().filter(|v| v.is_finite());
        number.ok_or_else(|| format!("\"{part}\" is not a finite number"))
    };
    text.split(',').map(one).collect()
}

/// A length above zero, mm.
pub fn length(text: &str) -> Result<f64, String> {
    match numbers(text)?.as_slice() {
        [mm] if *mm > 0.0 => Ok(*mm),
        _ => Err("a length in mm above 0".into()),
    }
}
