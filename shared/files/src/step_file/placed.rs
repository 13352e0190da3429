//! Which solids a file has, in which units, and where its assembly places them.

use super::graph::Graph;
use super::solids::brep;
use super::units::units_of;
use crate::error::{FileError, Problem};
use metrology::cad::{Brep, Frame};
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion};
use std::collections::{BTreeMap, BTreeSet};

/// Assemblies within assemblies; deeper ones are circles.
const DEEPEST: usize = 64;

/// Most solids that an assembly places.
const MOST_PLACED: usize = 100_000;

/// A solid with its name, and where it is placed.
pub(super) struct Solid {
    pub id: u64,
    pub name: String,
    pub brep: Brep,
    pub places: Vec<Isometry3<f64>>,
}

/// Items that are shape, but no solid.
const NO_SOLIDS: [&str; 12] = [
    "SHELL_BASED_SURFACE_MODEL",
    "FACE_BASED_SURFACE_MODEL",
    "FACETED_BREP",
    "FACETED_BREP_AND_BREP_WITH_VOIDS",
    "CSG_SOLID",
    "EXTRUDED_AREA_SOLID",
    "REVOLVED_AREA_SOLID",
    "TESSELLATED_SOLID",
    "TESSELLATED_SHELL",
    "TRIANGULATED_FACE",
    "COMPLEX_TRIANGULATED_FACE",
    "SOLID_REPLICA",
];

/// A representation: what it holds, and what it places.
#[derive(Default)]
struct Representation {
    /// Each solid with its shells, and whether these face as they say.
    breps: Vec<(u64, Vec<(u64, bool)>)>,
    name: String,
    context: Option<u64>,
    /// Other representations with their place in this one.
    parts: Vec<(u64, Isometry3<f64>)>,
    /// Whether another one places it.
    is_part: bool,
}

/// The solids of a file.
pub(super) fn solids(graph: &Graph) -> Result<Vec<Solid>, FileError> {
    let mut all = representations(graph)?;
    relations(graph, &mut all)?;
    let mut places: BTreeMap<u64, Vec<Isometry3<f64>>> = BTreeMap::new();
    let mut count = 0;
    let roots: Vec<u64> = all.iter().filter(|(_, r)| !r.is_part).map(|(id, _)| *id).collect();
    for root in roots {
        place(graph, &all, root, &Isometry3::identity(), DEEPEST, &mut count, &mut places)?;
    }
    let mut found = Vec::new();
    for (id, representation) in &all {
        for (solid, shells) in &representation.breps {
            let context =
                representation.context.ok_or_else(|| graph.fault(*id, "has no context with units"))?;
            let places = places.get(id).cloned().ok_or_else(|| {
                graph.fault(*id, "is a part of itself, or of no assembly that begins anywhere")
            })?;
            let brep = brep(graph, shells, units_of(graph, context)?)?;
            found.push(Solid { id: *solid, name: representation.name.clone(), brep, places });
        }
    }
    if found.is_empty() {
        return Err(none(graph));
    }
    Ok(found)
}

/// What a file without solids has instead.
fn none(graph: &Graph) -> FileError {
    let other = NO_SOLIDS.iter().find_map(|kind| graph.all(kind).first());
    if let Some(id) = other {
        return graph
            .unread(*id, "export the part as a solid (advanced B-rep: MANIFOLD_SOLID_BREP), or as STL");
    }
    let files = graph.all("DOCUMENT_FILE").len() + graph.all("EXTERNAL_SOURCE").len();
    let what =
        if files > 0 { "has no solid, but names other files" } else { "has no solid (MANIFOLD_SOLID_BREP)" };
    FileError::new(graph.path(), Problem::Unsupported(what.into()), "export the part itself, as a solid")
}

/// Representations with their solids and mapped items.
fn representations(graph: &Graph) -> Result<BTreeMap<u64, Representation>, FileError> {
    const KINDS: [&str; 6] = [
        "ADVANCED_BREP_SHAPE_REPRESENTATION",
        "SHAPE_REPRESENTATION",
        "MANIFOLD_SURFACE_SHAPE_REPRESENTATION",
        "FACETED_BREP_SHAPE_REPRESENTATION",
        "GEOMETRICALLY_BOUNDED_SURFACE_SHAPE_REPRESENTATION",
        "REPRESENTATION",
    ];
    let mut all: BTreeMap<u64, Representation> = BTreeMap::new();
    // The first kind holds the solids; others may name one of them again, for its properties.
    let mut held = BTreeSet::new();
    for kind in KINDS {
        for id in graph.all(kind) {
            let Some(params) = graph.record(*id, kind).filter(|p| p.len() >= 3) else { continue };
            let one = all.entry(*id).or_default();
            one.context = graph.reference(*id, params, 2).ok();
            one.name = Graph::name(params);
            for item in graph.list(*id, params, 1)? {
                if let Some(shells) = shells(graph, item)? {
                    if kind == KINDS[0] || !held.contains(&item) {
                        one.breps.push((item, shells));
                    }
                    held.insert(item);
                } else if graph.record(item, "MAPPED_ITEM").is_some() {
                    one.parts.push(mapped(graph, item, one.context)?);
                } else if graph.kind(item) == "absent" {
                    return Err(graph.fault(*id, &format!("names #{item}, which is absent")));
                }
            }
        }
    }
    let parts: BTreeSet<u64> = all.values().flat_map(|r| r.parts.iter().map(|(id, _)| *id)).collect();
    for id in parts {
        all.entry(id).or_default().is_part = true;
    }
    Ok(all)
}

/// The closed shells of a solid; `None` for other items.
fn shells(graph: &Graph, item: u64) -> Result<Option<Vec<(u64, bool)>>, FileError> {
    let outer = |params| graph.reference(item, params, 1).map(|shell| (shell, true));
    if let Some(params) = graph.record(item, "BREP_WITH_VOIDS").filter(|p| p.len() >= 3) {
        let mut all = vec![outer(params)?];
        for void in graph.list(item, params, 2)? {
            all.push(match graph.record(void, "ORIENTED_CLOSED_SHELL") {
                Some(params) => (graph.reference(void, params, 2)?, graph.truth(void, params, 3)?),
                None => (void, true),
            });
        }
        return Ok(Some(all));
    }
    let params = graph.record(item, "MANIFOLD_SOLID_BREP").filter(|p| p.len() >= 2);
    params.map(|params| outer(params).map(|shell| vec![shell])).transpose()
}

/// The representation that a MAPPED_ITEM repeats, with its place.
fn mapped(graph: &Graph, item: u64, context: Option<u64>) -> Result<(u64, Isometry3<f64>), FileError> {
    let params = graph.params(item, "MAPPED_ITEM")?;
    let (map, target) = (graph.reference(item, params, 1)?, graph.reference(item, params, 2)?);
    let params = graph.params(map, "REPRESENTATION_MAP")?;
    let (origin, part) = (graph.reference(map, params, 0)?, graph.reference(map, params, 1)?);
    if graph.record(target, "AXIS2_PLACEMENT_3D").is_none() {
        return Err(
            graph.unread(target, "export the parts where they lie, without operators that mirror or scale")
        );
    }
    let scale = context.map(|c| units_of(graph, c)).transpose()?.map_or(1.0, |u| u.length_mm);
    Ok((part, pose(&graph.frame(target, scale)?) * pose(&graph.frame(origin, scale)?).inverse()))
}

/// Relations between representations: the same thing twice, or a part with its place in an assembly.
fn relations(graph: &Graph, all: &mut BTreeMap<u64, Representation>) -> Result<(), FileError> {
    for kind in ["REPRESENTATION_RELATIONSHIP", "SHAPE_REPRESENTATION_RELATIONSHIP"] {
        for id in graph.all(kind) {
            let Some(params) = graph.record(*id, kind).filter(|p| p.len() >= 4) else { continue };
            let (first, second) = (graph.reference(*id, params, 2)?, graph.reference(*id, params, 3)?);
            let transformation = graph
                .record(*id, "REPRESENTATION_RELATIONSHIP_WITH_TRANSFORMATION")
                .map(|p| graph.reference(*id, p, 0))
                .transpose()?;
            let (assembly, part, place) = if let Some(operator) = transformation {
                (second, first, item_defined(graph, operator, all, [first, second])?)
            } else {
                // One thing twice: the one with solids belongs to the one that an assembly places.
                let solid = |r: u64| all.get(&r).is_some_and(|r| !r.breps.is_empty());
                let turned = solid(first) && !solid(second);
                let (outer, inner) = if turned { (second, first) } else { (first, second) };
                (outer, inner, Isometry3::identity())
            };
            if assembly != part {
                all.entry(assembly).or_default().parts.push((part, place));
                all.entry(part).or_default().is_part = true;
            }
        }
    }
    Ok(())
}

/// The place of an ITEM_DEFINED_TRANSFORMATION: the first item, in the part, comes to lie on the second, in the assembly.
fn item_defined(
    graph: &Graph,
    id: u64,
    all: &BTreeMap<u64, Representation>,
    [part, assembly]: [u64; 2],
) -> Result<Isometry3<f64>, FileError> {
    let Some(params) = graph.record(id, "ITEM_DEFINED_TRANSFORMATION") else {
        return Err(
            graph.unread(id, "export the parts where they lie, without operators that mirror or scale")
        );
    };
    let (one, two) = (graph.reference(id, params, 2)?, graph.reference(id, params, 3)?);
    let scale = |representation: u64| {
        let context = all.get(&representation).and_then(|r| r.context);
        context.map(|c| units_of(graph, c)).transpose().map(|u| u.map_or(1.0, |u| u.length_mm))
    };
    Ok(pose(&graph.frame(two, scale(assembly)?)?) * pose(&graph.frame(one, scale(part)?)?).inverse())
}

fn pose(frame: &Frame) -> Isometry3<f64> {
    let axes: Matrix3<f64> = frame.axes;
    let turn = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
    Isometry3::from_parts(Translation3::from(frame.origin.coords), turn)
}

/// Where a representation and its parts lie.
fn place(
    graph: &Graph,
    all: &BTreeMap<u64, Representation>,
    id: u64,
    at: &Isometry3<f64>,
    depth: usize,
    count: &mut usize,
    places: &mut BTreeMap<u64, Vec<Isometry3<f64>>>,
) -> Result<(), FileError> {
    *count += 1;
    if depth == 0 || *count > MOST_PLACED {
        let what =
            format!("lies in more than {DEEPEST} assemblies, or more than {MOST_PLACED} parts are placed");
        return Err(graph.fault(id, &what));
    }
    places.entry(id).or_default().push(*at);
    for (part, inner) in all.get(&id).map_or(&[][..], |r| &r.parts) {
        place(graph, all, *part, &(at * inner), depth - 1, count, places)?;
    }
    Ok(())
}
