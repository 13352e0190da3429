//! The nominal surface of a scene as triangles: what a CAD system would export of it.

use crate::body::{Body, Form};
use crate::scene::Scene;
use crate::solid::{Prism, Solid};
use fringe::math::{acos, sincos};
use nalgebra::{Point3, Vector2};
use std::f64::consts::{PI, TAU};

/// Fewest corners of a circle.
const LEAST_SIDES: usize = 12;
/// Most corners of a circle: a hundred thousand would make ten thousand million triangles of a sphere.
const MOST_SIDES: usize = 4096;

/// Corners of a triangle, counter-clockwise when seen from outside, mm.
type Corners = [Point3<f64>; 3];

impl Scene {
    /// The surfaces of all bodies in the part frame, corners on the surface, chords at most `chord_mm` (above zero) below it. Bodies that overlap are
    /// not joined.
    pub fn triangles(&self, chord_mm: f64) -> Vec<Corners> {
        let bodies = (0..self.body_names().count()).map(|index| self.body(index));
        bodies.flat_map(|body| body_triangles(body, chord_mm)).collect()
    }
}

fn body_triangles(body: &Body, chord_mm: f64) -> Vec<Corners> {
    let local = match body.form() {
        Form::Solid(solid) => solid_triangles(solid, chord_mm),
        Form::Mesh(mesh) => mesh.corners().collect(),
    };
    local.into_iter().map(|corners| corners.map(|corner| body.in_part(&corner))).collect()
}

/// Corners of a circle whose chords lie at most so far below it.
fn sides(radius_mm: f64, chord_mm: f64) -> usize {
    let half = acos((1.0 - chord_mm / radius_mm).clamp(-1.0, 1.0));
    ((PI / half.max(1e-9)).ceil() as usize).clamp(LEAST_SIDES, MOST_SIDES)
}

fn solid_triangles(solid: &Solid, chord_mm: f64) -> Vec<Corners> {
    let mut out = Vec::new();
    match solid {
        // Both directions of a facet of a sphere add to its depth.
        Solid::Ball { radius_mm } => {
            let n = sides(*radius_mm, 0.5 * chord_mm);
            cap(*radius_mm, n, PI, &mut out);
        }
        Solid::Dome { radius_mm } => {
            let n = sides(*radius_mm, 0.5 * chord_mm);
            cap(*radius_mm, n, 0.5 * PI, &mut out);
            disc(*radius_mm, 0.0, n, false, &mut out);
        }
        Solid::Tube { radius_mm, length_mm } => {
            let n = sides(*radius_mm, chord_mm);
            let at = |i: usize, z: f64| on_circle(*radius_mm, i, n, z);
            for i in 0..n {
                let [a, b, c, d] = [at(i, 0.0), at(i + 1, 0.0), at(i + 1, *length_mm), at(i, *length_mm)];
                out.extend([[a, b, c], [a, c, d]]);
            }
            disc(*radius_mm, 0.0, n, false, &mut out);
            disc(*radius_mm, *length_mm, n, true, &mut out);
        }
        Solid::Prism(prism) => prism_triangles(prism, &mut out),
    }
    out
}

fn on_circle(radius_mm: f64, index: usize, sides: usize, z: f64) -> Point3<f64> {
    // The last corner is the first one, to the last bit.
    let (sin, cos) = sincos(TAU * (index % sides) as f64 / sides as f64);
    Point3::new(radius_mm * cos, radius_mm * sin, z)
}

/// A sphere from its pole at +z down to a polar angle.
fn cap(radius_mm: f64, sides: usize, to_rad: f64, out: &mut Vec<Corners>) {
    let rings = ((sides as f64 * to_rad / TAU).ceil() as usize).max(2);
    let at = |ring: usize, i: usize| {
        let (sin, cos) = sincos(to_rad * ring as f64 / rings as f64);
        // Exactly one pole, and an equator at exactly z = 0.
        let is_pole = ring == 0 || (ring == rings && to_rad == PI);
        let z = if ring == rings && to_rad < PI { 0.0 } else { radius_mm * cos };
        on_circle(if is_pole { 0.0 } else { radius_mm * sin }, i, sides, z)
    };
    for ring in 0..rings {
        for i in 0..sides {
            let [a, b, c, d] = [at(ring, i), at(ring + 1, i), at(ring + 1, i + 1), at(ring, i + 1)];
            if ring + 1 < rings || to_rad < PI {
                out.push([a, b, c]);
            }
            if ring > 0 {
                out.push([a, c, d]);
            }
        }
    }
}

/// A disc across z that looks up or down.
fn disc(radius_mm: f64, z: f64, sides: usize, up: bool, out: &mut Vec<Corners>) {
    let middle = Point3::new(0.0, 0.0, z);
    for i in 0..sides {
        let (a, b) = (on_circle(radius_mm, i, sides, z), on_circle(radius_mm, i + 1, sides, z));
        out.push(if up { [middle, a, b] } else { [middle, b, a] });
    }
}

fn prism_triangles(prism: &Prism, out: &mut Vec<Corners>) {
    let (profile, y) = prism.outline();
    let at = |corner: &Vector2<f64>, y: f64| Point3::new(corner.x, y, corner.y);
    let next = profile.iter().cycle().skip(1);
    for (from, to) in profile.iter().zip(next) {
        // The profile runs counter-clockwise in x and z, which is clockwise seen along −y.
        let [a, b, c, d] = [at(from, -y), at(to, -y), at(to, y), at(from, y)];
        out.extend([[a, c, b], [a, d, c]]);
    }
    for i in 1..profile.len().saturating_sub(1) {
        let [a, b, c] = [&profile[0], &profile[i], &profile[i + 1]];
        out.push([at(a, -y), at(b, -y), at(c, -y)]);
        out.push([at(a, y), at(c, y), at(b, y)]);
    }
}
