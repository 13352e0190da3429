//! The elements of a part in colours, seen from two opposite sides.

use super::Chosen;
use crate::plan_text::legend;
use anyhow::Result;
use files::step_file::StepPart;
use nalgebra::{Point3, Vector3};
use report::{ClassMap, class_map_png};

/// Width of one view, px.
const VIEW_PX: usize = 420;

/// Class where nothing is seen.
const NOTHING: u8 = u8::MAX;

/// The picture as PNG: on the left from above, right and front, on the right from the other side.
pub fn picture(part: &StepPart, all: &[Chosen]) -> Result<Vec<u8>> {
    let mut classes: Vec<Vec<u8>> = part.solids.iter().map(|s| vec![0; s.mesh.triangles.len()]).collect();
    let kept: Vec<&Chosen> = all.iter().filter(|one| one.left_out.is_none()).collect();
    for (number, one) in kept.iter().enumerate() {
        for triangle in &one.feature.triangles {
            classes[one.solid][*triangle as usize] = (number + 1).min(250) as u8;
        }
    }
    let views = [1.0, -1.0].map(|side| view(part, &classes, &Vector3::new(side, -0.7 * side, 0.8 * side)));
    let (width, height) = (2 * VIEW_PX, views[0].len() / VIEW_PX);
    let mut pixels = Vec::with_capacity(width * height);
    for row in 0..height {
        for view in &views {
            pixels.extend_from_slice(&view[row * VIEW_PX..(row + 1) * VIEW_PX]);
        }
    }
    let legend = legend("no element", kept.iter().take(250).map(|one| one.name.clone()));
    let (width_px, height_px) = (width as u32, height as u32);
    Ok(class_map_png(&ClassMap { width_px, height_px, classes: &pixels, legend: &legend })?)
}

/// The class of each pixel, seen along a direction from far away.
fn view(part: &StepPart, classes: &[Vec<u8>], towards: &Vector3<f64>) -> Vec<u8> {
    let to_eye = towards.normalize();
    let right = Vector3::z().cross(&to_eye).normalize();
    let up = to_eye.cross(&right);
    let flat = |p: &Point3<f64>| [p.coords.dot(&right), -p.coords.dot(&up), p.coords.dot(&to_eye)];
    let mut bounds = [[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]];
    for [x, y, _] in part.solids.iter().flat_map(|s| &s.mesh.corners).map(flat) {
        bounds[0] = [bounds[0][0].min(x), bounds[0][1].min(y)];
        bounds[1] = [bounds[1][0].max(x), bounds[1][1].max(y)];
    }
    let size = (bounds[1][0] - bounds[0][0]).max(bounds[1][1] - bounds[0][1]).max(1e-9);
    let scale = (VIEW_PX as f64 - 8.0) / size;
    let middle = [0, 1].map(|i| 0.5 * (bounds[0][i] + bounds[1][i]));
    let half = 0.5 * VIEW_PX as f64;
    let mut pixels = vec![NOTHING; VIEW_PX * VIEW_PX];
    let mut depth = vec![f64::NEG_INFINITY; VIEW_PX * VIEW_PX];
    for (solid, classes) in part.solids.iter().zip(classes) {
        for (triangle, class) in solid.mesh.triangles.iter().zip(classes) {
            let corners = triangle.map(|c| {
                let [x, y, z] = flat(&solid.mesh.corners[c as usize]);
                [(x - middle[0]) * scale + half, (y - middle[1]) * scale + half, z]
            });
            paint(&corners, *class, &mut pixels, &mut depth);
        }
    }
    pixels
}

/// Paints one triangle where nothing lies before it.
fn paint(corners: &[[f64; 3]; 3], class: u8, pixels: &mut [u8], depth: &mut [f64]) {
    let [a, b, c] = corners;
    let turned = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1]);
    if turned.abs() < 1e-12 {
        return;
    }
    let range = |i: usize| {
        let low = a[i].min(b[i]).min(c[i]).floor().max(0.0) as usize;
        let high = (a[i].max(b[i]).max(c[i]).ceil() as usize).min(VIEW_PX - 1);
        low..=high
    };
    for y in range(1) {
        for x in range(0) {
            let (px, py) = (x as f64, y as f64);
            let v = ((px - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (py - a[1])) / turned;
            let w = ((b[0] - a[0]) * (py - a[1]) - (px - a[0]) * (b[1] - a[1])) / turned;
            if v < 0.0 || w < 0.0 || v + w > 1.0 {
                continue;
            }
            let z = a[2] + v * (b[2] - a[2]) + w * (c[2] - a[2]);
            let at = y * VIEW_PX + x;
            if z > depth[at] {
                (depth[at], pixels[at]) = (z, class);
            }
        }
    }
}
