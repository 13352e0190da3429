//! Which pairs a recording and a rig file have in common.

use anyhow::{Result, bail};
use files::recording::{RecordedRig, Recording};
use files::rig_file::RigFile;
use fringe::geometry::rig::Pair;

/// The pairs with these names, in their order; all where none is named.
pub(super) fn chosen(mut pairs: Vec<Pair>, names: &[String]) -> Result<Vec<Pair>> {
    if let Some(unknown) = names.iter().find(|name| pairs.iter().all(|p| p.name != **name)) {
        let known: Vec<&str> = pairs.iter().map(|p| p.name.as_str()).collect();
        bail!("--pair {unknown}: no such pair for this method; known: {}", known.join(", "));
    }
    pairs.retain(|pair| names.is_empty() || names.contains(&pair.name));
    Ok(pairs)
}

/// Why a recording does not show a pair of the rig file.
pub fn why_absent(pair: &Pair, recording: &Recording) -> String {
    let projectors: Vec<&str> = recording.projectors.iter().map(|p| p.name.as_str()).collect();
    if !pair.projector.is_empty() && !projectors.contains(&pair.projector.as_str()) {
        return format!(
            "its projector \"{}\" was not recorded; recorded: {}",
            pair.projector,
            projectors.join(", ")
        );
    }
    format!("{} and {} were not recorded together", pair.left, pair.right)
}

pub(super) fn camera_pairs(recording: &Recording, rig_file: &RigFile) -> Result<Vec<Pair>> {
    let RecordedRig { rig, absent_pairs } = recording.rig(rig_file)?;
    for pair in &absent_pairs {
        let why = why_absent(pair, recording);
        eprintln!("{}: pair \"{}\": {why}; skipped", rig_file.path.display(), pair.name);
    }
    let pairs: Vec<Pair> =
        rig.pairs.into_iter().filter(|pair| rig_file.rig.camera(&pair.right).is_some()).collect();
    if pairs.is_empty() {
        bail!(
            "{}: no pair of two cameras that {} holds; add a [[pair]] with left, right and projector, or use \
             --method projector",
            rig_file.path.display(),
            recording.document.path.display()
        );
    }
    Ok(pairs)
}

pub(super) fn projector_pairs_or_fault(recording: &Recording, rig_file: &RigFile) -> Result<Vec<Pair>> {
    let pairs = projector_pairs(recording, rig_file)?;
    let rig = &rig_file.rig;
    if pairs.is_empty() {
        let recorded: Vec<&str> = recording.projectors.iter().map(|p| p.name.as_str()).collect();
        let known: Vec<&str> = rig.projectors.iter().map(|p| p.name.as_str()).collect();
        bail!(
            "{}: --method projector needs a [[projector]] that the recording names and a camera that it lit; recorded: \
             {}; in the rig file: {}",
            rig_file.path.display(),
            recorded.join(", "),
            if known.is_empty() { "none".to_owned() } else { known.join(", ") }
        );
    }
    Ok(pairs)
}

/// Every recorded camera under every characterised projector, named as in the rig file where that names them; may be none.
///
/// # Errors
/// A projector of another size than in the rig file.
pub fn projector_pairs(recording: &Recording, rig_file: &RigFile) -> Result<Vec<Pair>> {
    let rig = &rig_file.rig;
    let mut pairs = Vec::new();
    for projector in &recording.projectors {
        let Some(known) = rig.projector(&projector.name) else { continue };
        let (here, there) = ((projector.width_px, projector.height_px), (known.width_px, known.height_px));
        if here != there {
            bail!(
                "{}: projector \"{}\" has {} × {} px, in {} it has {} × {} px; calibrate at the size that is projected",
                recording.document.path.display(),
                projector.name,
                here.0,
                here.1,
                rig_file.path.display(),
                there.0,
                there.1
            );
        }
        for camera in projector.cameras.iter().filter(|camera| rig.camera(&camera.name).is_some()) {
            let named = rig.pairs.iter().find(|p| p.left == camera.name && p.right == projector.name);
            let name =
                named.map_or_else(|| format!("{}-{}", camera.name, projector.name), |p| p.name.clone());
            let (left, right) = (camera.name.clone(), projector.name.clone());
            pairs.push(Pair { name, left, right: right.clone(), projector: right });
        }
    }
    Ok(pairs)
}
