//! The bodies of a scene file, checked.

use crate::body::{Body, Form};
use crate::checkerboard::{Checkerboard, Markers};
use crate::error::SceneError;
use crate::mesh::Mesh;
use crate::scene_file::{BodyFile, CheckerboardFile, GeometryFile, MaterialFile, SceneFile};
use crate::solid::{Prism, Solid};
use crate::surface::Surface;
use fringe::math::random::Key;
use fringe::math::tan;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector2, Vector3};

/// No part of a cell is larger than this, mm; it keeps every distance far from the end of the digits.
const LARGEST_MM: f64 = 1e5;

/// Makes the bodies of a scene file.
pub(crate) fn build(
    file: &SceneFile,
    load: &mut dyn FnMut(&str) -> Result<Vec<u8>, String>,
) -> Result<Vec<Body>, SceneError> {
    for material in &file.materials {
        check_material(material)?;
    }
    let mut bodies = Vec::new();
    for body in &file.bodies {
        let material = file.materials.iter().find(|m| m.name == body.material).ok_or_else(|| {
            let names: Vec<_> = file.materials.iter().map(|m| m.name.as_str()).collect();
            SceneError::UnknownMaterial {
                body: body.name.clone(),
                material: body.material.clone(),
                known: names.join(", "),
            }
        })?;
        let part_from_body = place(body)?;
        let check = Check { kind: "body", name: &body.name };
        for (suffix, offset, form, board) in forms(body, check, load)? {
            let surface = surface_of(material, bodies.len(), board);
            let name = if suffix.is_empty() { body.name.clone() } else { format!("{}.{suffix}", body.name) };
            bodies.push(Body::new(name, form, &(part_from_body * offset), surface));
        }
    }
    Ok(bodies)
}

/// Checks numbers of one table of the file.
#[derive(Clone, Copy)]
struct Check<'a> {
    kind: &'static str,
    name: &'a str,
}

impl Check<'_> {
    fn fail(self, key: &'static str, value: f64, limit: String) -> SceneError {
        SceneError::Value { kind: self.kind, name: self.name.into(), key, value, limit }
    }

    fn range(self, key: &'static str, value: f64, least: f64, most: f64) -> Result<f64, SceneError> {
        if (least..=most).contains(&value) {
            return Ok(value);
        }
        Err(self.fail(key, value, format!("{least} to {most}")))
    }

    fn size(self, key: &'static str, value: f64) -> Result<f64, SceneError> {
        if value > 0.0 && value <= LARGEST_MM {
            return Ok(value);
        }
        Err(self.fail(key, value, format!("larger than 0 and at most {LARGEST_MM}")))
    }
}

fn check_material(material: &MaterialFile) -> Result<(), SceneError> {
    let check = Check { kind: "material", name: &material.name };
    check.range("albedo", material.albedo, 0.0, 1.0)?;
    check.range("texture", material.texture, 0.0, 1.0)?;
    check.range("texture_mm", material.texture_mm, 1e-3, LARGEST_MM)?;
    check.range("specular", material.specular, 0.0, 1e3)?;
    check.range("shininess", material.shininess, 0.0, 1e4)?;
    Ok(())
}

fn surface_of(material: &MaterialFile, index: usize, board: Option<Checkerboard>) -> Surface {
    Surface {
        albedo: material.albedo,
        texture: material.texture,
        texture_mm: material.texture_mm,
        specular: material.specular,
        shininess: material.shininess,
        checkerboard: board,
        // The grain belongs to the part, not to the run: it does not depend on the twin's seed.
        key: Key::new(index as u64),
    }
}

fn place(body: &BodyFile) -> Result<Isometry3<f64>, SceneError> {
    let check = Check { kind: "body", name: &body.name };
    for value in body.position_mm {
        check.range("position_mm", value, -LARGEST_MM, LARGEST_MM)?;
    }
    for value in body.rotation_deg {
        check.range("rotation_deg", value, -360.0, 360.0)?;
    }
    let turn = crate::pose::rotation(body.rotation_deg.map(f64::to_radians));
    Ok(Isometry3::from_parts(Translation3::from(Vector3::from(body.position_mm)), turn))
}

type Part = (String, Isometry3<f64>, Form, Option<Checkerboard>);

fn forms(
    body: &BodyFile,
    check: Check,
    load: &mut dyn FnMut(&str) -> Result<Vec<u8>, String>,
) -> Result<Vec<Part>, SceneError> {
    let one = |solid: Solid| vec![part("", Vector3::zeros(), solid)];
    Ok(match &body.geometry {
        GeometryFile::Sphere { diameter_mm } => one(ball(check, *diameter_mm)?),
        GeometryFile::Cylinder { diameter_mm, height_mm } => one(Solid::Tube {
            radius_mm: 0.5 * check.size("diameter_mm", *diameter_mm)?,
            length_mm: check.size("height_mm", *height_mm)?,
        }),
        GeometryFile::Box { size_mm: [x, y, z] } => one(block(check, [*x, *y, *z], -0.5 * z)?),
        GeometryFile::Plane { size_mm: [x, y], thickness_mm, checkerboard } => {
            check.size("thickness_mm", *thickness_mm)?;
            let board = checkerboard.as_ref().map(|b| board(check, b)).transpose()?;
            let (suffix, at, form, _) =
                part("", Vector3::zeros(), block(check, [*x, *y, *thickness_mm], -thickness_mm)?);
            vec![(suffix, at, form, board)]
        }
        GeometryFile::Wedge { footprint_mm, height_mm, inclination_deg } => {
            one(wedge(check, *footprint_mm, *height_mm, *inclination_deg)?)
        }
        GeometryFile::Hemisphere { diameter_mm, base_mm } => {
            let radius_mm = 0.5 * check.size("diameter_mm", *diameter_mm)?;
            let mut parts = one(Solid::Dome { radius_mm });
            if let Some([x, y, z]) = base_mm {
                parts.push(part("base", Vector3::zeros(), block(check, [*x, *y, *z], -z)?));
            }
            parts
        }
        GeometryFile::BallBar { diameters_mm, spacing_mm, rod_diameter_mm } => {
            ball_bar(check, *diameters_mm, *spacing_mm, *rod_diameter_mm)?
        }
        GeometryFile::BallBeam { diameters_mm, offsets_mm, rod_diameter_mm, rod_length_mm, drop_mm } => {
            if diameters_mm.len() != offsets_mm.len() {
                return Err(SceneError::Lengths {
                    body: body.name.clone(),
                    a_len: diameters_mm.len(),
                    b_len: offsets_mm.len(),
                });
            }
            let spheres: Vec<_> = diameters_mm.iter().copied().zip(offsets_mm.iter().copied()).collect();
            let mut parts = spheres_on_x(check, &spheres)?;
            check.range("drop_mm", *drop_mm, 0.0, LARGEST_MM)?;
            parts.push(rod(check, *rod_diameter_mm, check.size("rod_length_mm", *rod_length_mm)?, -drop_mm)?);
            parts
        }
        GeometryFile::Mesh { file, scale } => {
            check.size("scale", *scale)?;
            let named = |reason| SceneError::MeshFile { body: body.name.clone(), file: file.clone(), reason };
            let bytes = load(file).map_err(named)?;
            let mesh = Mesh::from_stl(&bytes, *scale).map_err(|source| SceneError::Mesh {
                body: body.name.clone(),
                file: file.clone(),
                source,
            })?;
            vec![(String::new(), Isometry3::identity(), Form::Mesh(mesh), None)]
        }
    })
}

fn part(suffix: &str, at: Vector3<f64>, solid: Solid) -> Part {
    (
        suffix.into(),
        Isometry3::from_parts(Translation3::from(at), UnitQuaternion::identity()),
        Form::Solid(solid),
        None,
    )
}

fn ball(check: Check, diameter_mm: f64) -> Result<Solid, SceneError> {
    Ok(Solid::Ball { radius_mm: 0.5 * check.size("diameter_mm", diameter_mm)? })
}

/// A box with x and y about the origin, from z = `bottom_mm` up.
fn block(check: Check, size_mm: [f64; 3], bottom_mm: f64) -> Result<Solid, SceneError> {
    for value in size_mm {
        check.size("size_mm", value)?;
    }
    let [x, y, z] = size_mm;
    let (a, top) = (0.5 * x, bottom_mm + z);
    let corners = [(-a, bottom_mm), (a, bottom_mm), (a, top), (-a, top)];
    Ok(Solid::Prism(Prism::new(corners.map(|(x, z)| Vector2::new(x, z)).to_vec(), 0.5 * y)))
}

fn wedge(
    check: Check,
    footprint_mm: [f64; 2],
    height_mm: f64,
    inclination_deg: f64,
) -> Result<Solid, SceneError> {
    for value in footprint_mm {
        check.size("footprint_mm", value)?;
    }
    check.size("height_mm", height_mm)?;
    check.range("inclination_deg", inclination_deg, 0.1, 89.9)?;
    let run = height_mm / tan(inclination_deg.to_radians());
    let [x, y] = footprint_mm;
    if run >= x {
        let limit = format!("below {:.3} so that the slope ends within the footprint", height_mm * x / run);
        return Err(check.fail("height_mm", height_mm, limit));
    }
    let a = 0.5 * x;
    let corners = [(-a, 0.0), (a, 0.0), (a - run, height_mm), (-a, height_mm)];
    Ok(Solid::Prism(Prism::new(corners.map(|(x, z)| Vector2::new(x, z)).to_vec(), 0.5 * y)))
}

fn spheres_on_x(check: Check, spheres: &[(f64, f64)]) -> Result<Vec<Part>, SceneError> {
    if spheres.is_empty() {
        return Err(check.fail("diameters_mm", 0.0, "a list with at least one sphere".into()));
    }
    let one = |(index, (diameter_mm, x)): (usize, &(f64, f64))| {
        check.range("offsets_mm", *x, -LARGEST_MM, LARGEST_MM)?;
        let solid = ball(check, *diameter_mm)?;
        Ok(part(&format!("sphere{}", index + 1), Vector3::new(*x, 0.0, 0.0), solid))
    };
    spheres.iter().enumerate().map(one).collect()
}

/// A cylinder along x, its middle at x = 0.
fn rod(check: Check, diameter_mm: f64, length_mm: f64, z_mm: f64) -> Result<Part, SceneError> {
    let radius_mm = 0.5 * check.size("rod_diameter_mm", diameter_mm)?;
    let (suffix, _, form, board) = part("rod", Vector3::zeros(), Solid::Tube { radius_mm, length_mm });
    let turn = crate::pose::rotation([0.0, std::f64::consts::FRAC_PI_2, 0.0]);
    let at = Translation3::new(-0.5 * length_mm, 0.0, z_mm);
    Ok((suffix, Isometry3::from_parts(at, turn), form, board))
}

fn ball_bar(
    check: Check,
    diameters_mm: [f64; 2],
    spacing_mm: f64,
    rod_diameter_mm: f64,
) -> Result<Vec<Part>, SceneError> {
    let half = 0.5 * check.size("spacing_mm", spacing_mm)?;
    let [first, second] = diameters_mm;
    let mut parts = spheres_on_x(check, &[(first, -half), (second, half)])?;
    if rod_diameter_mm != 0.0 {
        parts.push(rod(check, rod_diameter_mm, spacing_mm, 0.0)?);
    }
    Ok(parts)
}

fn board(check: Check, file: &CheckerboardFile) -> Result<Checkerboard, SceneError> {
    check.range("checkerboard.columns", file.columns.into(), 1.0, 10_000.0)?;
    check.range("checkerboard.rows", file.rows.into(), 1.0, 10_000.0)?;
    Ok(Checkerboard {
        columns: file.columns,
        rows: file.rows,
        pitch_mm: check.size("checkerboard.pitch_mm", file.pitch_mm)?,
        dark: check.range("checkerboard.dark", file.dark, 0.0, 1.0)?,
        markers: markers(check, file)?,
    })
}

/// The markers of a board, if it has any; they need both keys, an even number of rows and a dictionary that is long enough.
fn markers(check: Check, file: &CheckerboardFile) -> Result<Option<Markers>, SceneError> {
    let first = file.first_marker.unwrap_or(0);
    let Some(dictionary) = file.dictionary else {
        return match (file.marker_mm, file.first_marker) {
            (None, None) => Ok(None),
            (Some(value), _) => {
                Err(check.fail("checkerboard.marker_mm", value, "left out, or given with dictionary".into()))
            }
            (None, Some(first)) => {
                let limit = "left out, or given with dictionary".into();
                Err(check.fail("checkerboard.first_marker", first.into(), limit))
            }
        };
    };
    let side_mm = file.marker_mm.unwrap_or(0.0);
    check.range("checkerboard.marker_mm", side_mm, 0.4 * file.pitch_mm, 0.9 * file.pitch_mm)?;
    if !file.rows.is_multiple_of(2) {
        let limit = "even on a board with markers: the square at its top left is dark".into();
        return Err(check.fail("checkerboard.rows", file.rows.into(), limit));
    }
    let needed = (u64::from(file.columns) + 1) * (u64::from(file.rows) + 1) / 2;
    let most = (dictionary.count() as u64).saturating_sub(needed);
    check.range("checkerboard.first_marker", first.into(), 0.0, most as f64)?;
    if needed > dictionary.count() as u64 {
        let limit = format!("few enough for the {} markers of the dictionary", dictionary.count());
        return Err(check.fail("checkerboard.columns", file.columns.into(), limit));
    }
    Ok(Some(Markers { dictionary, size: side_mm / file.pitch_mm, first: first as usize }))
}
