//! The scene: checked bodies in the part frame, and separately the truth.

use crate::assemble;
use crate::body::{self, Body, Hit};
use crate::error::SceneError;
use crate::scene_file::{FORMAT, SceneFile, TrueValue};
use nalgebra::{Point3, Vector3};
use std::collections::BTreeSet;
use std::sync::Arc;

/// The true feature values, separate from the scene that cameras see.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Truth {
    /// In the order of the file.
    pub values: Vec<TrueValue>,
}

impl Truth {
    /// A true value by name.
    pub fn get(&self, name: &str) -> Option<&TrueValue> {
        self.values.iter().find(|v| v.name == name)
    }
}

/// The nearest point of the part's surface.
#[derive(Debug, Clone, PartialEq)]
pub struct SurfacePoint {
    /// Distance, mm; negative inside of the material.
    pub signed_mm: f64,
    /// The surface point in the part frame, mm.
    pub foot_mm: Point3<f64>,
    /// Index of the body, in the order of [`Scene::body_names`].
    pub body: usize,
    /// Face of the body.
    pub face: u32,
    /// Lower bound of the foot's distance to the nearest edge or to where another body begins, mm; zero if the foot
    /// is buried in another body.
    pub edge_mm: f64,
}

impl SurfacePoint {
    /// Whether the foot lies within `margin_mm` of an edge or of another body.
    pub fn is_near_edge(&self, margin_mm: f64) -> bool {
        self.edge_mm < margin_mm
    }
}

/// Bodies in the part frame. Copies share the geometry.
#[derive(Debug, Clone)]
pub struct Scene {
    name: String,
    bodies: Arc<Vec<Body>>,
    truth: Truth,
}

impl Scene {
    /// Checks a scene file; `load` fetches the bytes of a mesh file by its path as written.
    ///
    /// # Errors
    /// Why the scene is invalid, with key, value and limit.
    pub fn new(
        file: &SceneFile,
        load: &mut dyn FnMut(&str) -> Result<Vec<u8>, String>,
    ) -> Result<Self, SceneError> {
        if file.format != FORMAT {
            return Err(SceneError::Format(file.format.clone()));
        }
        if file.bodies.is_empty() {
            return Err(SceneError::NoBody);
        }
        unique("material", file.materials.iter().map(|m| m.name.as_str()))?;
        unique("body", file.bodies.iter().map(|b| b.name.as_str()))?;
        unique("truth", file.truth.iter().map(|t| t.name.as_str()))?;
        if let Some(bad) = file.truth.iter().find(|t| !t.value.is_finite()) {
            return Err(SceneError::Value {
                kind: "truth",
                name: bad.name.clone(),
                key: "value",
                value: bad.value,
                limit: "a finite number".into(),
            });
        }
        let bodies = Arc::new(assemble::build(file, load)?);
        Ok(Self { name: file.name.clone(), bodies, truth: Truth { values: file.truth.clone() } })
    }

    /// What the scene is.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Names of the bodies; parts of a compound one are named `bar.sphere1`, `bar.rod` and so on.
    pub fn body_names(&self) -> impl Iterator<Item = &str> {
        self.bodies.iter().map(|b| b.name.as_str())
    }

    /// The true feature values, only for evaluating a measurement.
    pub fn truth(&self) -> &Truth {
        &self.truth
    }

    /// A scene without truth: what a camera may be given.
    pub(crate) fn without_truth(&self) -> Self {
        Self { truth: Truth::default(), ..self.clone() }
    }

    /// The part's surface nearest to a point of the part frame, exactly.
    ///
    /// Outside of the material this is the distance to the union of all bodies; inside, to the body in which the point
    /// lies deepest below a face.
    pub fn surface_distance(&self, point_mm: &Point3<f64>) -> SurfacePoint {
        let mut best: Option<SurfacePoint> = None;
        for (index, body) in self.bodies.iter().enumerate() {
            let near = body.nearest(point_mm);
            if best.as_ref().is_none_or(|b| near.signed_mm < b.signed_mm) {
                best = Some(SurfacePoint {
                    signed_mm: near.signed_mm,
                    foot_mm: near.foot_mm,
                    body: index,
                    face: near.face,
                    edge_mm: near.edge_mm,
                });
            }
        }
        let mut best = best.unwrap_or(SurfacePoint {
            signed_mm: f64::INFINITY,
            foot_mm: *point_mm,
            body: 0,
            face: 0,
            edge_mm: 0.0,
        });
        for (index, body) in self.bodies.iter().enumerate() {
            if index != best.body {
                best.edge_mm = best.edge_mm.min(body.nearest(&best.foot_mm).signed_mm.max(0.0));
            }
        }
        best
    }

    /// The first body that contains a point of the part frame.
    pub(crate) fn holder(&self, p: &Point3<f64>) -> Option<&str> {
        self.bodies.iter().find(|b| b.holds(p)).map(|b| b.name.as_str())
    }

    /// The first surface a ray of the part frame meets.
    pub fn first_hit(&self, origin: &Point3<f64>, direction: &Vector3<f64>) -> Option<Hit> {
        body::first_hit(&self.bodies, origin, direction)
    }

    /// Whether the straight way from a surface point to a light is blocked.
    pub fn is_shadowed(&self, hit: &Hit, light: &Point3<f64>) -> bool {
        body::is_shadowed(&self.bodies, hit, light)
    }

    pub(crate) fn body(&self, index: usize) -> &Body {
        &self.bodies[index]
    }

    /// Middle of the box of all bounding spheres, mm.
    pub fn centre_mm(&self) -> Point3<f64> {
        let (mut low, mut high) = (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
        for body in self.bodies.iter() {
            let (centre, radius) = body.bound();
            low = low.inf(&centre.coords.add_scalar(-radius));
            high = high.sup(&centre.coords.add_scalar(radius));
        }
        Point3::from((low + high) * 0.5)
    }
}

fn unique<'a>(kind: &'static str, names: impl Iterator<Item = &'a str>) -> Result<(), SceneError> {
    let mut seen = BTreeSet::new();
    for name in names {
        if !seen.insert(name) {
            return Err(SceneError::Duplicate { kind, name: name.into() });
        }
    }
    Ok(())
}
