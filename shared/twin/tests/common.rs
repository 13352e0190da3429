//! Small scenes and rigs.

use fringe::geometry::rig::Rig;
use fringe::math::random::Key;
use nalgebra::{Point3, Vector3};
use twin::{Scene, thesis};

/// A scene from its `[[body]]` tables, all of one material.
pub fn scene(bodies: &str) -> Scene {
    parse(bodies).unwrap()
}

pub fn parse(bodies: &str) -> Result<Scene, String> {
    let head = "format = \"fringecell-scene/1\"\n[[material]]\nname = \"white\"\nalbedo = 0.7\n";
    parse_text(&format!("{head}{bodies}"), &mut |_| Err("no file in this test".into()))
}

/// As the reader of files does it.
pub fn parse_text(
    text: &str,
    load: &mut dyn FnMut(&str) -> Result<Vec<u8>, String>,
) -> Result<Scene, String> {
    let file = toml::from_str(text).map_err(|error| error.to_string())?;
    Scene::new(&file, load).map_err(|error| error.to_string())
}

/// A `[[body]]` table of a scene file.
pub fn body(name: &str, position_mm: [f64; 3], geometry: &str) -> String {
    format!(
        "[[body]]\nname = \"{name}\"\nmaterial = \"white\"\nposition_mm = {position_mm:?}\ngeometry = {geometry}\n"
    )
}

/// The rig of the thesis with few pixels.
pub fn small_rig() -> Rig {
    thesis::rig(280, 188)
}

pub const ARTEFACT: &str = include_str!("../../../configs/complex-artefact.scene.toml");

pub fn artefact() -> Scene {
    parse_text(ARTEFACT, &mut |_| Err("no file in this scene".into())).unwrap()
}

/// Even points in a cube about a centre.
pub fn points(seed: u64, count: u64, centre: [f64; 3], half_mm: f64) -> Vec<Point3<f64>> {
    let key = Key::new(seed);
    let draw =
        |i: u64| Vector3::new(key.symmetric(3 * i), key.symmetric(3 * i + 1), key.symmetric(3 * i + 2));
    (0..count).map(|i| Point3::from(Vector3::from(centre) + draw(i) * half_mm)).collect()
}

/// The bytes of a binary STL file.
pub fn stl(triangles: &[[[f32; 3]; 3]]) -> Vec<u8> {
    let mut bytes = vec![0; 80];
    bytes.extend((triangles.len() as u32).to_le_bytes());
    for triangle in triangles {
        bytes.extend([0; 12]);
        triangle.as_flattened().iter().for_each(|c| bytes.extend(c.to_le_bytes()));
        bytes.extend([0; 2]);
    }
    bytes
}

/// The twelve triangles of a box about the origin, outside counter-clockwise.
pub fn box_triangles(half: [f32; 3]) -> Vec<[[f32; 3]; 3]> {
    let mut triangles = Vec::new();
    for axis in 0..3 {
        for side in [-1.0_f32, 1.0] {
            let corner = |a: f32, b: f32| {
                let mut c = [0.0; 3];
                c[axis] = side * half[axis];
                c[(axis + 1) % 3] = a * half[(axis + 1) % 3];
                c[(axis + 2) % 3] = b * half[(axis + 2) % 3];
                c
            };
            let mut quad = [corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)];
            if side < 0.0 {
                quad.reverse();
            }
            triangles.push([quad[0], quad[1], quad[2]]);
            triangles.push([quad[0], quad[2], quad[3]]);
        }
    }
    triangles
}
