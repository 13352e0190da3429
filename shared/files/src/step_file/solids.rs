//! Solids with their shells, faces, edges and curves, in mm in their own frame.

use super::graph::{Graph, references};
use super::part21::Value;
use super::units::Units;
use crate::error::FileError;
use metrology::cad::{Bound, Brep, BrepEdge, BrepFace, CadShape, Curve, Spline};
use nalgebra::Point3;
use std::collections::BTreeMap;

/// What to do about geometry that is not read.
const OTHER_EXPORT: &str =
    "export the part as STL, or its faces as planes, cylinders, cones, spheres and tori";

/// Curves within curves; deeper ones are circles.
const DEEPEST: usize = 8;

/// The solid of closed shells.
pub(super) fn brep(graph: &Graph, shells: &[(u64, bool)], units: Units) -> Result<Brep, FileError> {
    let mut reader =
        Reader { graph, units, brep: Brep::default(), vertices: BTreeMap::new(), edges: BTreeMap::new() };
    for (shell, forward) in shells {
        let params = graph.params(*shell, "CLOSED_SHELL")?;
        for face in graph.list(*shell, params, 1)? {
            reader.face(face, *forward)?;
        }
    }
    Ok(reader.brep)
}

struct Reader<'a> {
    graph: &'a Graph,
    units: Units,
    brep: Brep,
    vertices: BTreeMap<u64, usize>,
    edges: BTreeMap<u64, usize>,
}

impl Reader<'_> {
    fn face(&mut self, id: u64, forward: bool) -> Result<(), FileError> {
        let graph = self.graph;
        if let Some(params) = graph.record(id, "ORIENTED_FACE") {
            let (inner, along) = (graph.reference(id, params, 2)?, graph.truth(id, params, 3)?);
            if graph.record(inner, "ORIENTED_FACE").is_some() {
                return Err(graph.fault(id, "is a face of itself"));
            }
            return self.face(inner, forward == along);
        }
        let found = graph.record(id, "ADVANCED_FACE").or_else(|| graph.record(id, "FACE_SURFACE"));
        let params = found.ok_or_else(|| graph.unread(id, OTHER_EXPORT))?;
        let outward = graph.truth(id, params, 3)? == forward;
        let shape = self.shape(graph.reference(id, params, 2)?, id)?;
        let mut bounds = Vec::new();
        for bound in graph.list(id, params, 1)? {
            bounds.push(self.bound(bound, forward)?);
        }
        self.brep.faces.push(BrepFace { id, name: Graph::name(params), shape, outward, bounds });
        Ok(())
    }

    fn bound(&mut self, id: u64, forward: bool) -> Result<Bound, FileError> {
        let graph = self.graph;
        let params = graph.record(id, "FACE_OUTER_BOUND").or_else(|| graph.record(id, "FACE_BOUND"));
        let params = params.ok_or_else(|| graph.fault(id, "where a FACE_BOUND is needed"))?;
        let line = graph.reference(id, params, 1)?;
        let forward = graph.truth(id, params, 2)? == forward;
        if let Some(params) = graph.record(line, "VERTEX_LOOP") {
            return Ok(Bound::Corner(self.vertex(graph.reference(line, params, 1)?)?));
        }
        let mut edges = Vec::new();
        let Some(params) = graph.record(line, "EDGE_LOOP") else {
            return Err(graph.unread(line, OTHER_EXPORT));
        };
        for oriented in graph.list(line, params, 1)? {
            let params = graph.params(oriented, "ORIENTED_EDGE")?;
            let along = graph.truth(oriented, params, 4)?;
            edges.push((self.edge(graph.reference(oriented, params, 3)?)?, along == forward));
        }
        Ok(Bound::Loop(edges))
    }

    fn vertex(&mut self, id: u64) -> Result<usize, FileError> {
        if let Some(known) = self.vertices.get(&id) {
            return Ok(*known);
        }
        let params = self.graph.params(id, "VERTEX_POINT")?;
        let point = self.graph.point(self.graph.reference(id, params, 1)?)?;
        self.brep.vertices.push(point * self.units.length_mm);
        self.vertices.insert(id, self.brep.vertices.len() - 1);
        Ok(self.brep.vertices.len() - 1)
    }

    fn edge(&mut self, id: u64) -> Result<usize, FileError> {
        if let Some(known) = self.edges.get(&id) {
            return Ok(*known);
        }
        let graph = self.graph;
        let params = graph.params(id, "EDGE_CURVE")?;
        let ends =
            [self.vertex(graph.reference(id, params, 1)?)?, self.vertex(graph.reference(id, params, 2)?)?];
        let curve = self.curve(graph.reference(id, params, 3)?, DEEPEST)?;
        if curve == Curve::Line && ends[0] == ends[1] {
            return Err(graph.fault(id, "is a straight line that ends where it begins"));
        }
        self.brep.edges.push(BrepEdge { id, curve, ends, along: graph.truth(id, params, 4)? });
        self.edges.insert(id, self.brep.edges.len() - 1);
        Ok(self.brep.edges.len() - 1)
    }

    fn length(&self, id: u64, params: &[Value], at: usize) -> Result<f64, FileError> {
        let length = self.graph.number(id, params, at)? * self.units.length_mm;
        if length > 0.0 && length < 1e9 {
            Ok(length)
        } else {
            Err(self.graph.fault(id, "has a radius that is not above 0, or beyond 1e9 mm"))
        }
    }

    fn curve(&self, id: u64, depth: usize) -> Result<Curve, FileError> {
        let graph = self.graph;
        let depth = depth.checked_sub(1).ok_or_else(|| graph.fault(id, "is a curve of itself"))?;
        for kind in ["SURFACE_CURVE", "SEAM_CURVE", "INTERSECTION_CURVE", "TRIMMED_CURVE"] {
            if let Some(params) = graph.record(id, kind) {
                return self.curve(graph.reference(id, params, 1)?, depth);
            }
        }
        if graph.record(id, "LINE").is_some() {
            return Ok(Curve::Line);
        }
        if let Some(params) = graph.record(id, "CIRCLE") {
            let frame = graph.frame(graph.reference(id, params, 1)?, self.units.length_mm)?;
            return Ok(Curve::Ellipse(frame, [self.length(id, params, 2)?; 2]));
        }
        if let Some(params) = graph.record(id, "ELLIPSE") {
            let frame = graph.frame(graph.reference(id, params, 1)?, self.units.length_mm)?;
            return Ok(Curve::Ellipse(frame, [self.length(id, params, 2)?, self.length(id, params, 3)?]));
        }
        self.spline(id)
    }

    /// A B-spline, in one record or in several of one entity.
    fn spline(&self, id: u64) -> Result<Curve, FileError> {
        let graph = self.graph;
        let Some(own) = graph.record(id, "B_SPLINE_CURVE_WITH_KNOTS") else {
            return Err(graph.unread(id, OTHER_EXPORT));
        };
        let parts = graph.record(id, "B_SPLINE_CURVE");
        // As a part of several records it has no name and no control points of its own.
        let (base, from, knots) = match parts {
            Some(base) => (base, 0, 0),
            None => (own, 1, 6),
        };
        let degree = graph.number(id, base, from)?;
        if !(1.0..=25.0).contains(&degree) {
            return Err(graph.fault(id, "has a degree that is not within 1 … 25"));
        }
        let degree = degree as usize;
        let poles = match base.get(from + 1) {
            Some(Value::List(items)) => references(items),
            _ => return Err(graph.fault(id, "has no control points")),
        };
        let scaled = |point: Point3<f64>| point * self.units.length_mm;
        let poles: Vec<Point3<f64>> =
            poles.into_iter().map(|p| graph.point(p).map(scaled)).collect::<Result<_, _>>()?;
        let times = graph.numbers(id, own, knots)?;
        let values = graph.numbers(id, own, knots + 1)?;
        let sum: f64 = times.iter().sum();
        if times.len() != values.len()
            || sum != (poles.len() + degree + 1) as f64
            || times.iter().any(|t| *t < 1.0)
        {
            return Err(graph.fault(id, "its knots do not fit its control points"));
        }
        let repeated = times.iter().zip(&values).flat_map(|(t, k)| std::iter::repeat_n(*k, *t as usize));
        let weights = match graph.record(id, "RATIONAL_B_SPLINE_CURVE") {
            Some(params) => graph.numbers(id, params, 0)?,
            None => vec![1.0; poles.len()],
        };
        let spline = Spline { degree, knots: repeated.collect(), poles, weights };
        if spline.is_valid() {
            Ok(Curve::Spline(spline))
        } else {
            Err(graph.fault(id, "is no valid B-spline"))
        }
    }

    fn shape(&self, id: u64, face: u64) -> Result<CadShape, FileError> {
        let graph = self.graph;
        let named = |name: &'static str| graph.record(id, name).map(|params| (name, params));
        let kinds =
            ["PLANE", "CYLINDRICAL_SURFACE", "CONICAL_SURFACE", "SPHERICAL_SURFACE", "TOROIDAL_SURFACE"];
        let Some((kind, params)) = kinds.into_iter().find_map(named) else {
            let mut error = graph.unread(id, OTHER_EXPORT);
            error.key = format!("face #{face}");
            return Err(error);
        };
        let frame = graph.frame(graph.reference(id, params, 1)?, self.units.length_mm)?;
        let (at, axis) = (frame.origin, frame.axes.column(2).into_owned());
        Ok(match kind {
            "PLANE" => CadShape::Plane { point_mm: at, normal: axis },
            "CYLINDRICAL_SURFACE" => {
                CadShape::Cylinder { point_mm: at, axis, radius_mm: self.length(id, params, 2)? }
            }
            "CONICAL_SURFACE" => {
                let half_angle_rad = graph.number(id, params, 3)? * self.units.angle_rad;
                if !(1e-4..1.5705).contains(&half_angle_rad) {
                    return Err(graph.fault(id, "its angle is not within 0° and 90°"));
                }
                let radius_mm = graph.number(id, params, 2)? * self.units.length_mm;
                CadShape::Cone { point_mm: at, axis, radius_mm, half_angle_rad }
            }
            "SPHERICAL_SURFACE" => CadShape::Sphere { center_mm: at, radius_mm: self.length(id, params, 2)? },
            _ => {
                let [ring_radius_mm, tube_radius_mm] =
                    [self.length(id, params, 2)?, self.length(id, params, 3)?];
                if tube_radius_mm >= ring_radius_mm {
                    return Err(graph.unread(id, OTHER_EXPORT));
                }
                CadShape::Torus { center_mm: at, axis, ring_radius_mm, tube_radius_mm }
            }
        })
    }
}
