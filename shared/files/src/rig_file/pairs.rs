//! Pairs of a rig file: their names are checked, and their projector is found where they name none.

use crate::document::Document;
use crate::error::{FileError, Problem, did_you_mean, list};
use crate::name::check_name;
use fringe::geometry::rig::Rig;
use std::path::Path;

/// The property `pair` of a point cloud is a byte.
const MOST_PAIRS: usize = 256;

/// Checks the names of pairs and of their views.
pub(super) fn check_pairs(document: &Document, rig: &Rig) -> Result<(), FileError> {
    if rig.pairs.len() > MOST_PAIRS {
        let problem = Problem::Value {
            value: format!("{} pairs", rig.pairs.len()),
            limit: format!("at most {MOST_PAIRS}: a point cloud numbers them in a byte"),
        };
        return Err(document.fault("pair", problem, "split the rig file"));
    }
    for (index, pair) in rig.pairs.iter().enumerate() {
        let key = |part: &str| format!("pair[{index}].{part}");
        check_name(&pair.name).map_err(|problem| document.fault(&key("name"), problem, ""))?;
        if rig.camera(&pair.left).is_none() {
            return Err(unknown(document, &key("left"), "camera", &pair.left, camera_names(rig)));
        }
        if rig.camera(&pair.right).is_none() && rig.projector(&pair.right).is_none() {
            let known = camera_names(rig).chain(rig.projectors.iter().map(|p| p.name.as_str()));
            return Err(unknown(document, &key("right"), "camera or projector", &pair.right, known));
        }
        if pair.left == pair.right {
            let problem = Problem::Value {
                value: format!("left = right = \"{}\"", pair.left),
                limit: "a pair has two views".into(),
            };
            return Err(document.fault(&key("right"), problem, "name the other camera"));
        }
        let by_projector = rig.projector(&pair.right).is_some();
        if by_projector && !pair.projector.is_empty() && pair.projector != pair.right {
            let problem = Problem::Disagreement {
                what: "right view and projector",
                here: format!("projector = \"{}\"", pair.projector),
                there: format!("right = \"{}\" is a projector", pair.right),
            };
            return Err(document.fault(
                &key("projector"),
                problem,
                "leave `projector` out, or name the right view",
            ));
        }
    }
    Ok(())
}

fn camera_names(rig: &Rig) -> impl Iterator<Item = &str> + Clone {
    rig.cameras.iter().map(|camera| camera.name.as_str())
}

pub(crate) fn unknown<'a>(
    document: &Document,
    key: &str,
    kind: &'static str,
    name: &str,
    known: impl IntoIterator<Item = &'a str> + Clone,
) -> FileError {
    let remedy = did_you_mean(name, known.clone(), "name one of those, or add it");
    document.fault(key, Problem::UnknownName { kind, name: name.to_owned(), known: list(known) }, remedy)
}

/// Fills in the projector of pairs that name none: the only one that lit both of their cameras.
///
/// `lit` lists each projector with the cameras that looked while it was on, as a recording or a cell configuration
/// shows. A pair that names its projector is left as it is.
///
/// # Errors
/// No projector lit both cameras of a pair, or several did; the key names the pair by its name.
pub fn resolve_pairs(rig_path: &Path, rig: &mut Rig, lit: &[(&str, &[String])]) -> Result<(), FileError> {
    let projectors: Vec<String> = rig.projectors.iter().map(|p| p.name.clone()).collect();
    for pair in rig.pairs.iter_mut().filter(|pair| pair.projector.is_empty()) {
        if projectors.contains(&pair.right) {
            pair.projector = pair.right.clone();
            continue;
        }
        let sees = |cameras: &[String], name: &str| cameras.iter().any(|camera| camera == name);
        let both: Vec<&str> = lit
            .iter()
            .filter(|(_, cameras)| sees(cameras, &pair.left) && sees(cameras, &pair.right))
            .map(|(name, _)| *name)
            .collect();
        let [only] = both.as_slice() else {
            let problem = Problem::Disagreement {
                what: "pair and projectors",
                here: format!(
                    "pair \"{}\" of {} and {} names no projector",
                    pair.name, pair.left, pair.right
                ),
                there: format!("{} projectors light both ({})", both.len(), list(both.iter().copied())),
            };
            let remedy = "add projector = \"…\" to the pair, or light both of its cameras with one projector";
            return Err(FileError::new(rig_path, problem, remedy).at(format!("pair {}", pair.name)));
        };
        pair.projector = (*only).to_owned();
    }
    Ok(())
}
