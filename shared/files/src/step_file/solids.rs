//! Solids with their shells, faces, edges and curves, in mm in their own frame.

use super::curves::{DEEPEST, OTHER_EXPORT, curve};
use super::graph::Graph;
use super::surfaces::surface;
use super::units::Units;
use crate::error::FileError;
use metrology::cad::{Bound, Brep, BrepEdge, BrepFace, Curve};
use nalgebra::Point3;
use std::collections::BTreeMap;

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
        let mut bounds = Vec::new();
        for bound in graph.list(id, params, 1)? {
            bounds.push(self.bound(bound, forward)?);
        }
        let found = surface(graph, self.units, graph.reference(id, params, 2)?, &self.corners(&bounds));
        let (surface, turned) = found.map_err(|mut error| {
            error.key = format!("face #{id}");
            error
        })?;
        let (name, outward) = (Graph::name(params), outward != turned);
        self.brep.faces.push(BrepFace { id, name, surface, outward, bounds });
        Ok(())
    }

    /// Corners at which the edges about a face end.
    fn corners(&self, bounds: &[Bound]) -> Vec<Point3<f64>> {
        let of = |bound: &Bound| match bound {
            Bound::Corner(vertex) => vec![*vertex],
            Bound::Loop(edges) => edges.iter().flat_map(|(edge, _)| self.brep.edges[*edge].ends).collect(),
        };
        bounds.iter().flat_map(of).map(|vertex| self.brep.vertices[vertex]).collect()
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
        let corners = ends.map(|end| self.brep.vertices[end]);
        let curve = curve(graph, self.units, graph.reference(id, params, 3)?, corners, DEEPEST)?;
        if curve == Curve::Line && ends[0] == ends[1] {
            return Err(graph.fault(id, "is a straight line that ends where it begins"));
        }
        self.brep.edges.push(BrepEdge { id, curve, ends, along: graph.truth(id, params, 4)? });
        self.edges.insert(id, self.brep.edges.len() - 1);
        Ok(self.brep.edges.len() - 1)
    }
}
