//! Further pairs that would see what no pair sees.

use super::Args;
use super::task::Task;
use crate::progress::Progress;
use anyhow::{Context, Result, bail};
use files::rig_file::read_rig;
use fringe::geometry::rig::{Pair, Rig};
use metrology::view_planning::{Fringes, Seeing, propose, turned_pairs};
use nalgebra::{Unit, Vector3};
use std::collections::BTreeMap;
use std::path::Path;

/// A pair that gains less than this share of the part is not proposed.
const LEAST_SHARE: f64 = 1e-3;

/// A proposed pair with the views that it needs.
pub(super) struct ProposedPair {
    pub(super) pair: Pair,
    /// The pair of the rig that it is turned from; none of a file of candidates.
    pub(super) turned_from: Option<String>,
    pub(super) gain_mm2: f64,
    pub(super) left_mm2: f64,
    /// The pair and its views alone.
    pub(super) rig: Rig,
}

/// The pairs that are proposed, best first; none where none are asked for.
pub(super) fn proposals(args: &Args, task: &Task, seeing: &[Seeing]) -> Result<Vec<ProposedPair>> {
    if args.propose == 0 {
        return Ok(Vec::new());
    }
    let rig = &task.rig_file.rig;
    let middle = task.planner.mesh().bounds().centre();
    let candidates = match &args.candidates {
        Some(path) => {
            let file = read_rig(path)?;
            if file.rig.pairs.is_empty() {
                bail!("{}: has no [[pair]]; each pair is a candidate", path.display());
            }
            file.rig
        }
        None => turned_pairs(rig, &middle, &Unit::new_normalize(args.up.0)),
    };
    let fringes = of_candidates(task, rig);
    let area: f64 = task.planner.elements().iter().filter(|e| !e.buried).map(|e| e.area_mm2).sum();
    let mut progress = Progress::new(candidates.pairs.len(), "trying pairs");
    let limits = (args.propose, LEAST_SHARE * area);
    let found = propose(&task.planner, seeing, (&candidates, &fringes), limits, &mut || progress.step())
        .with_context(|| args.candidates.as_ref().map_or_else(String::new, |p| p.display().to_string()))?;
    let pair = |proposal: metrology::view_planning::Proposal| {
        let pair = candidates.pairs[proposal.candidate].clone();
        let per_pair = (candidates.pairs.len() / rig.pairs.len().max(1)).max(1);
        let source = rig.pairs.get(proposal.candidate / per_pair).map(|pair| pair.name.clone());
        ProposedPair {
            turned_from: source.filter(|_| args.candidates.is_none()),
            gain_mm2: proposal.gain_mm2,
            left_mm2: proposal.left_mm2,
            rig: alone(&candidates, &pair),
            pair,
        }
    };
    Ok(found.into_iter().map(pair).collect())
}

/// The fringes of candidates: those of the first projector of the rig, since names are new.
fn of_candidates(task: &Task, rig: &Rig) -> BTreeMap<String, Vec<Fringes>> {
    let mut fringes = task.fringes.clone();
    let first = rig.pairs.iter().find_map(|pair| {
        task.fringes.get(&pair.projector).or_else(|| task.fringes.get(&pair.right)).cloned()
    });
    if let Some(first) = first {
        fringes.entry(String::new()).or_insert(first);
    }
    fringes
}

/// A pair with its views alone.
fn alone(rig: &Rig, pair: &Pair) -> Rig {
    let names = [&pair.left, &pair.right, &pair.projector];
    let mut one = rig.clone();
    one.cameras.retain(|view| names.contains(&&view.name));
    one.projectors.retain(|view| names.contains(&&view.name));
    one.sensors.retain(|name, _| names.contains(&name));
    one.pairs = vec![pair.clone()];
    one
}

/// Writes the rig with the proposed pairs; views that it has already stay as they are.
pub(super) fn write_rig(path: &Path, task: &Task, proposals: &[ProposedPair]) -> Result<()> {
    let mut rig = task.rig_file.rig.clone();
    for proposal in proposals {
        for view in &proposal.rig.cameras {
            if rig.cameras.iter().all(|known| known.name != view.name) {
                rig.cameras.push(view.clone());
            }
        }
        for view in &proposal.rig.projectors {
            if rig.projectors.iter().all(|known| known.name != view.name) {
                rig.projectors.push(view.clone());
            }
        }
        rig.sensors.extend(proposal.rig.sensors.clone());
        if rig.pairs.iter().any(|known| known.name == proposal.pair.name) {
            bail!(
                "--out {}: the rig has a pair \"{}\" already; rename the candidate",
                path.display(),
                proposal.pair.name
            );
        }
        rig.pairs.push(proposal.pair.clone());
    }
    let mut provenance = toml::Table::new();
    let source = format!("proposed by plan-views from {}: a plan, not a calibration", task.rig_file.sha256);
    provenance.insert("source".into(), source.into());
    files::rig_file::write_rig(path, &rig, &provenance, None)?;
    Ok(())
}

/// Where a view stands and in which direction it looks.
pub(super) fn stand(camera: &fringe::geometry::camera::Camera) -> ([f64; 3], [f64; 3]) {
    let forward = camera.camera_from_world.rotation.inverse() * Vector3::z();
    (camera.centre_mm().coords.into(), forward.into())
}
