//! A body in the part frame, and what a ray meets.

use crate::mesh::Mesh;
use crate::solid::{Contact, Nearest, Solid};
use crate::surface::Surface;
use nalgebra::{Isometry3, Matrix3, Point3, Vector3};

/// A ray that starts on a mesh ignores what lies nearer than this, mm: a thousand times the rounding at 500 mm.
const MESH_SKIN_MM: f64 = 1e-6;

/// The geometry of a body.
#[derive(Debug, Clone)]
pub(crate) enum Form {
    Solid(Solid),
    Mesh(Mesh),
}

/// A body with its place and surface.
#[derive(Debug, Clone)]
pub struct Body {
    /// Name of the body, unique in the scene.
    pub name: String,
    /// Reflection of the surface.
    pub surface: Surface,
    form: Form,
    /// p_body = turn · (p_part − shift).
    turn: Matrix3<f64>,
    shift: Point3<f64>,
    bound_centre: Point3<f64>,
    bound_radius: f64,
}

/// Where a ray meets the part, in the part frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Distance along the ray, mm.
    pub t_mm: f64,
    /// The surface point, mm.
    pub point_mm: Point3<f64>,
    /// Outward normal, unit vector.
    pub normal: Vector3<f64>,
    /// Index of the body.
    pub body: usize,
    /// Face of the body.
    pub face: u32,
}

impl Body {
    /// Puts a form at its place in the part frame.
    pub(crate) fn new(name: String, form: Form, part_from_body: &Isometry3<f64>, surface: Surface) -> Self {
        let (centre, radius) = match &form {
            Form::Solid(solid) => solid.bounding_sphere(),
            Form::Mesh(mesh) => mesh.bounding_sphere(),
        };
        Self {
            name,
            surface,
            form,
            turn: part_from_body.rotation.inverse().to_rotation_matrix().into_inner(),
            shift: Point3::from(part_from_body.translation.vector),
            bound_centre: part_from_body * centre,
            // A hair wider than the body, so that rounding never culls a grazing ray.
            bound_radius: radius * (1.0 + 1e-9) + 1e-9,
        }
    }

    /// Part frame to body frame.
    pub fn local(&self, p: &Point3<f64>) -> Point3<f64> {
        Point3::from(self.turn * (p - self.shift))
    }

    /// Body frame to part frame.
    pub(crate) fn in_part(&self, p: &Point3<f64>) -> Point3<f64> {
        self.shift + self.turn.transpose() * p.coords
    }

    /// Its geometry, in the body frame.
    pub(crate) fn form(&self) -> &Form {
        &self.form
    }

    /// Centre and radius of a sphere that holds the body, in the part frame.
    pub fn bound(&self) -> (Point3<f64>, f64) {
        (self.bound_centre, self.bound_radius)
    }

    /// Whether a ray can meet the body before `limit_mm`.
    fn in_reach(&self, origin: &Point3<f64>, d: &Vector3<f64>, limit_mm: f64) -> bool {
        let to_centre = self.bound_centre - origin;
        let along = to_centre.dot(d);
        let miss_squared = (to_centre - d * along).norm_squared();
        let radius = self.bound_radius;
        miss_squared <= radius * radius && along > -radius && along < limit_mm + radius
    }

    fn enter(&self, origin: &Point3<f64>, d: &Vector3<f64>, least_mm: f64) -> Option<Contact> {
        let (o, d) = (self.local(origin), self.turn * d);
        match &self.form {
            Form::Solid(solid) => solid.enter(&o, &d),
            Form::Mesh(mesh) => mesh.enter(&o, &d, least_mm),
        }
    }

    /// The nearest surface point, in the part frame.
    pub fn nearest(&self, p: &Point3<f64>) -> Nearest {
        let local = self.local(p);
        let near = match &self.form {
            Form::Solid(solid) => solid.nearest(&local),
            Form::Mesh(mesh) => mesh.nearest(&local),
        };
        Nearest { foot_mm: self.shift + self.turn.transpose() * near.foot_mm.coords, ..near }
    }

    /// Whether a point lies inside.
    pub fn holds(&self, p: &Point3<f64>) -> bool {
        (p - self.bound_centre).norm() <= self.bound_radius && self.nearest(p).signed_mm < 0.0
    }
}

/// The first surface that a ray with a unit direction meets.
pub(crate) fn first_hit(bodies: &[Body], origin: &Point3<f64>, d: &Vector3<f64>) -> Option<Hit> {
    let mut best: Option<(usize, Contact)> = None;
    for (index, body) in bodies.iter().enumerate() {
        let limit = best.map_or(f64::INFINITY, |(_, c)| c.t_mm);
        if body.in_reach(origin, d, limit)
            && let Some(contact) = body.enter(origin, d, 0.0)
            && contact.t_mm < limit
        {
            best = Some((index, contact));
        }
    }
    best.map(|(body, contact)| Hit {
        t_mm: contact.t_mm,
        point_mm: origin + d * contact.t_mm,
        normal: bodies[body].turn.transpose() * contact.normal,
        body,
        face: contact.face,
    })
}

/// Whether something lies between a surface point and a light. The light must be on the outer side of the face.
pub(crate) fn is_shadowed(bodies: &[Body], hit: &Hit, light: &Point3<f64>) -> bool {
    let start = hit.point_mm + hit.normal * MESH_SKIN_MM;
    let way = light - start;
    let length = way.norm();
    let d = way / length;
    bodies.iter().enumerate().any(|(index, body)| {
        if !body.in_reach(&start, &d, length) {
            return false;
        }
        match &body.form {
            // A convex body cannot shadow a face of its own that looks at the light.
            Form::Solid(_) if index == hit.body => false,
            Form::Solid(_) => body.enter(&start, &d, 0.0).is_some_and(|c| c.t_mm < length),
            Form::Mesh(mesh) => mesh.blocks(&body.local(&start), &(body.turn * d), MESH_SKIN_MM, length),
        }
    })
}
