//! Places of a surface with their normals, spread evenly: what the search for a start works on.

use crate::spread::some_of;
use nalgebra::{Point3, Vector3};

use super::LEAST_POINTS;
use crate::reference::{CloudError, CloudReference, Reference};
use crate::spatial::{Aabb, TriangleMesh, thin_to, thinned};
use fringe::cloud::Point;

/// Points of a cloud from which normals are made. Their planes then span some three spacings of this many points, which
/// averages the noise of the single points.
const NORMAL_POINTS: usize = 12_000;

/// A place of a surface with its unit normal, mm.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sample {
    pub place: Vector3<f64>,
    pub normal: Vector3<f64>,
}

/// Samples of one surface.
#[derive(Debug, Clone)]
pub(super) struct Samples {
    pub list: Vec<Sample>,
    /// Whether the normals point out of the material; otherwise their signs mean nothing.
    pub signed: bool,
}

impl Samples {
    /// Of a cloud, about `wanted` of them.
    ///
    /// # Errors
    /// Too few points for a surface, all of them in one place or on a line.
    pub fn of_cloud(points: &[Point], wanted: usize) -> Result<Self, CloudError> {
        let positions: Vec<Point3<f64>> = points.iter().map(Point::position).collect();
        let kept = thin_to(&positions, NORMAL_POINTS);
        let kept: Vec<Point> = kept.into_iter().map(|i| points[i as usize]).collect();
        let surface = CloudReference::new(&kept, Vector3::z(), None)?.with_normals();
        let all = Self::of_surface(&surface);
        if all.list.len() < LEAST_POINTS {
            return Err(CloudError::NoSurface);
        }
        let places: Vec<Point3<f64>> = all.list.iter().map(|s| Point3::from(s.place)).collect();
        let list = thin_to(&places, wanted).into_iter().map(|i| all.list[i as usize]).collect();
        Ok(Self { list, signed: all.signed })
    }

    /// Of a reference, one about every `spacing_mm`.
    pub fn of_reference(reference: &Reference, spacing_mm: f64) -> Self {
        match reference {
            Reference::Cloud(cloud) => Self::of_surface(cloud).thinned(spacing_mm),
            Reference::Mesh(mesh) => Self::of_mesh(mesh, spacing_mm),
        }
    }

    fn of_surface(cloud: &CloudReference) -> Self {
        let list = cloud.oriented().map(|(place, normal)| Sample { place: place.coords, normal }).collect();
        Self { list, signed: cloud.has_normals() }
    }

    /// Of a mesh: places at equal steps of the area summed over its triangles, spread within each triangle by a
    /// two-dimensional golden-ratio sequence (M. Roberts, 2018).
    fn of_mesh(mesh: &TriangleMesh, spacing_mm: f64) -> Self {
        let outside = if volume_mm3(mesh) < 0.0 && mesh.border_edges() == 0 { -1.0 } else { 1.0 };
        let step = spacing_mm * spacing_mm;
        let mut list = Vec::new();
        let (mut summed, mut number) = (0.0, 0_u64);
        for triangle in mesh.triangles() {
            let [a, b, c] = triangle.corners;
            summed += 0.5 * (b - a).cross(&(c - a)).norm();
            while (number as f64 + 0.5) * step < summed {
                let spread = |ratio: f64| (0.5 + ratio * number as f64).fract();
                let (u, v) = (spread(0.754_877_666_246_692_7), spread(0.569_840_290_998_053_2));
                let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
                let place = a.coords + (b - a) * u + (c - a) * v;
                list.push(Sample { place, normal: triangle.normal * outside });
                number += 1;
            }
        }
        Self { list, signed: true }
    }

    /// One of each cube with this edge.
    pub fn thinned(&self, edge_mm: f64) -> Self {
        let places: Vec<Point3<f64>> = self.list.iter().map(|s| Point3::from(s.place)).collect();
        let list = thinned(&places, edge_mm).into_iter().map(|i| self.list[i as usize]).collect();
        Self { list, signed: self.signed }
    }

    /// `most` at most, from all over.
    pub fn few(&self, most: usize) -> Vec<Sample> {
        some_of(&self.list, most)
    }

    /// Diagonal of the box around all, mm.
    pub fn diagonal_mm(&self) -> f64 {
        let places: Vec<Point3<f64>> = self.list.iter().map(|s| Point3::from(s.place)).collect();
        let bounds = Aabb::of(&places);
        (bounds.high - bounds.low).norm()
    }
}

/// Area of the surface that a reference stands for, mm².
pub(super) fn area_mm2(reference: &Reference) -> f64 {
    match reference {
        Reference::Cloud(cloud) => cloud.spacing_mm() * cloud.spacing_mm() * cloud.len() as f64,
        Reference::Mesh(mesh) => mesh
            .triangles()
            .iter()
            .map(|t| 0.5 * (t.corners[1] - t.corners[0]).cross(&(t.corners[2] - t.corners[0])).norm())
            .sum(),
    }
}

/// Volume within a closed mesh, negative when its triangles run clockwise seen from outside.
fn volume_mm3(mesh: &TriangleMesh) -> f64 {
    let about = mesh.bounds().centre();
    let of = |[a, b, c]: [Vector3<f64>; 3]| a.dot(&b.cross(&c)) / 6.0;
    mesh.triangles().iter().map(|t| of(t.corners.map(|p| p - about))).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::register::{InitialPose, RegisterError, RegisterSettings, register};
    use fringe::synthetic::Noise;

    fn point(place: [f64; 3]) -> Point {
        Point { position_mm: place, ..bytemuck::Zeroable::zeroed() }
    }

    /// Points on a line have no normals for the search, neither as the cloud nor as the reference.
    #[test]
    fn a_line_is_no_surface() {
        let mut noise = Noise(1);
        let line: Vec<Point> = (0..2000).map(|i| point([0.1 * f64::from(i), 0.0, 3.0])).collect();
        let mut on_face = || {
            let (x, y) = (60.0 * noise.unit(), 40.0 * noise.unit());
            point([x, y, 0.01 * x * y])
        };
        let face: Vec<Point> = (0..2000).map(|_| on_face()).collect();
        let searched = |points: &[Point], target: &[Point]| {
            let reference =
                Reference::Cloud(CloudReference::new(target, Vector3::z(), None).unwrap().with_normals());
            register(points, &reference, &InitialPose::Search, &RegisterSettings::default())
        };
        for target in [&face, &line] {
            assert_eq!(searched(&line, target).unwrap_err(), RegisterError::Cloud(CloudError::NoSurface));
        }
        assert!(searched(&face, &line).is_err());
        // With or without a pose for so few: no panic.
        (7..=20).for_each(|count| drop(searched(&face[..count], &face)));
    }
}
