//! What the page is given of results, scans and the cell: JSON with what it shows, and no more.

use crate::feed::{Ended, RasterHeader, ScanHeader};
use crate::software::FRINGECELL;
use cell::Cell;
use cell::schedule::label;
use files::result::CycleResult;
use metrology::inspection::{FeatureResult, Plan, Quantity};
use nalgebra::Point3;
use serde_json::{Value, json};

/// The cell: what does not change during a run.
pub fn cell(cell: &Cell, demo: bool, run: u32) -> Value {
    let graph = &cell.graph;
    json!({
        "cell": cell.name,
        "demo": demo,
        "run": run,
        "software": FRINGECELL.line(),
        "cameras": graph.cameras.iter().map(|c| &c.name).collect::<Vec<_>>(),
        "projectors": graph.projectors.iter().map(|p| &p.name).collect::<Vec<_>>(),
        "pairs": graph.pairs.iter().map(|p| &p.name).collect::<Vec<_>>(),
        "stages": cell.schedule.stages.iter().map(|s| &s.name).collect::<Vec<_>>(),
        "deadline_ms": cell.config.limits.cycle_deadline_ms,
    })
}

/// A cycle in a list and in charts.
pub fn brief(result: &CycleResult) -> Value {
    let feature = |f: &FeatureResult| json!([f.name, f.value, f.u, f.verdict]);
    let overlap = |o: &fringe::fusion::Overlap| json!([o.a, o.b, o.count, o.mean_mm, o.sd_mm]);
    json!({
        "number": result.number,
        "date": result.date,
        "outcome": result.outcome,
        "verdict": result.verdict,
        "part": result.part,
        "recipe": result.recipe,
        "duration_ns": result.duration_ns,
        "latency_ns": result.latency_ns,
        "features": result.features.iter().map(feature).collect::<Vec<_>>(),
        "overlaps": result.overlaps.iter().flatten().map(overlap).collect::<Vec<_>>(),
    })
}

/// A cycle with all that the page shows of the last one.
pub fn ended(cell: &Cell, ended: &Ended) -> Value {
    let result = &ended.result;
    let plan = plan(cell, result);
    json!({
        "brief": brief(result),
        "points": result.points,
        "alignment_failure": result.alignment_failure,
        "guard_factor": plan.map(|plan| plan.settings.guard_factor),
        "plan": plan.map(|plan| &plan.name),
        "features": result.features,
        "places": plan.map(|plan| places(plan, result)).unwrap_or_default(),
        "decode": result.reports.iter().filter(|(name, _)| name.starts_with("phase/")).collect::<Vec<_>>(),
        "spans": spans(cell, ended),
    })
}

fn plan<'a>(cell: &'a Cell, result: &CycleResult) -> Option<&'a Plan> {
    let name = result.recipe.as_ref()?;
    cell.config.recipes.iter().find(|recipe| recipe.name == *name)?.plan.as_ref()
}

/// Of each feature the place of its first element in the world, mm; null where it was not found.
fn places(plan: &Plan, result: &CycleResult) -> Vec<Value> {
    let place = |feature: &metrology::inspection::Feature| -> Option<[f64; 3]> {
        let fit = result.elements.get(first_element(plan, &feature.quantity)?)?.fit.as_ref()?;
        let world = result.alignment.as_ref()?.world_from_part() * Point3::from(fit.place());
        Some(world.coords.into())
    };
    plan.features.iter().map(|feature| json!(place(feature))).collect()
}

/// The first measured element; `None` where all are made of others.
fn first_element(plan: &Plan, quantity: &Quantity) -> Option<usize> {
    Some(match quantity {
        Quantity::SphereDiameter(element) => *element,
        Quantity::CentreDistance(elements) | Quantity::PlaneDistance(elements) => elements[0],
        Quantity::PlaneFlatness { plane, .. } => *plane,
        Quantity::PlaneAngle { planes, .. } => planes[0],
        Quantity::HemisphereHeight { sphere, .. } => *sphere,
        Quantity::Characteristic { index, .. } => {
            let elements = &plan.characteristics.get(*index)?.elements;
            *elements.iter().find(|index| **index < plan.elements.len())?
        }
    })
}

/// Times of the activations: stage, label, and wait, start, end and sending in µs from the first of them.
fn spans(cell: &Cell, ended: &Ended) -> Vec<Value> {
    let first = ended.spans.iter().map(|s| s.start_ns.saturating_sub(s.wait_ns)).min().unwrap_or(0);
    let span = |s: &crate::supervisor::collect::Span| {
        let activation = cell.schedule.activations.get(s.activation)?;
        let us = |ns: u64| ns.saturating_sub(first) / 1000;
        let name = label(&cell.graph, activation.work);
        Some(json!([
            activation.stage,
            name,
            s.wait_ns / 1000,
            us(s.start_ns),
            us(s.end_ns),
            s.send_ns / 1000
        ]))
    };
    ended.spans.iter().filter_map(span).collect()
}

/// What the last scan holds.
pub fn scan(cell: &Cell, header: &ScanHeader) -> Value {
    let raster = |raster: &RasterHeader| {
        let graph = &cell.graph;
        json!({
            "number": raster.number,
            "camera": graph.cameras.get(raster.camera as usize).map(|c| &c.name),
            "projector": graph.projectors.get(raster.projector as usize).map(|p| &p.name),
            "path": format!("{}/{}", raster.camera, raster.projector),
            "width_px": raster.width_px,
            "height_px": raster.height_px,
            "step": raster.step,
        })
    };
    json!({
        "number": header.number,
        "cloud_number": header.cloud_number,
        "points": header.points,
        "all_points": header.all_points,
        "pictures": header.pictures.iter().map(raster).collect::<Vec<_>>(),
        "maps": header.maps.iter().map(raster).collect::<Vec<_>>(),
    })
}
