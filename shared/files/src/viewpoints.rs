//! Whence the points of a cloud were seen, as a comment of its PLY file: whoever writes the cloud states it, and elements are freed of what noise along the lines
//! of sight does to them and measured without the points near their limbs ([`metrology::inspection::Plan::with_viewpoints`]).

use crate::cloud_pairs;
use crate::ply::Cloud;
use fringe::geometry::rig::{Pair, Rig};
use fringe::geometry::viewpoint::Viewpoints;
use serde::de::Error;
use std::collections::BTreeMap;

/// Name of the comment; its value is a JSON object: by pair, whence its cameras saw the points, in the frame of the cloud.
pub const COMMENT: &str = "viewpoints";

/// The value of the comment.
pub fn comment(rig: &Rig, pairs: &[Pair]) -> String {
    let seen = rig.viewpoints(pairs).into_iter();
    let known = pairs.iter().zip(seen).filter_map(|(pair, seen)| Some((pair.name.as_str(), seen?)));
    serde_json::json!(known.collect::<BTreeMap<&str, Viewpoints>>()).to_string()
}

/// What the comment of a cloud says, by the numbers of the pairs that its points have: those of the rig file (`pairs`) where they were numbered by one, or of its
/// own list of pairs. Nothing where there is no comment, as in a cloud of other programs or one that was moved.
///
/// # Errors
/// A comment that is no object of viewpoints.
pub fn of_cloud(cloud: &Cloud, pairs: Option<&[Pair]>) -> Result<Vec<Option<Viewpoints>>, serde_json::Error> {
    let Some(text) = cloud.comment(COMMENT) else { return Ok(Vec::new()) };
    let seen: BTreeMap<String, Viewpoints> = serde_json::from_str(text)?;
    if seen.values().flat_map(|seen| seen.all().copied().collect::<Vec<_>>()).any(|view| !view.is_finite()) {
        return Err(serde_json::Error::custom("limb_rad must lie within 0 … 1"));
    }
    let own =
        || cloud.comment(cloud_pairs::COMMENT).map_or(Ok(Vec::new()), serde_json::from_str::<Vec<String>>);
    let names = pairs.map_or_else(own, |pairs| Ok(pairs.iter().map(|pair| pair.name.clone()).collect()))?;
    Ok(names.iter().map(|name| seen.get(name).copied()).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig_file::read_rig;
    use std::path::Path;

    #[test]
    fn places_come_back_by_the_numbers_of_the_pairs() {
        let file =
            read_rig(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/demo-rig.toml")).unwrap();
        let rig = file.rig;
        let mut pairs = rig.pairs.clone();
        pairs.reverse();
        let said = |comments: &[(&str, &str)]| Cloud {
            comments: comments.iter().map(|(name, text)| format!("{name}: {text}")).collect(),
            ..Cloud::default()
        };
        let (places, names) = (comment(&rig, &pairs), cloud_pairs::comment(&pairs));
        let cloud = said(&[(COMMENT, &places), (cloud_pairs::COMMENT, &names)]);
        assert!(pairs.len() > 1);
        let seen = of_cloud(&cloud, None).unwrap();
        assert_eq!(seen, rig.viewpoints(&pairs));
        let (first, left) = (seen[0].unwrap(), rig.camera(&pairs[0].left).unwrap());
        assert_eq!(first.own.place(), left.centre_mm());
        // Half a window and four footprints of a lens, in pixels.
        let reach_px = first.own.limb_rad * left.mean_focal_px();
        assert!((3.5..8.0).contains(&reach_px) && first.other.is_some(), "{reach_px}");
        assert_eq!(of_cloud(&cloud, Some(&rig.pairs)).unwrap(), rig.viewpoints(&rig.pairs));
        assert_eq!(of_cloud(&Cloud::default(), Some(&rig.pairs)).unwrap(), Vec::new());
        assert_eq!(of_cloud(&said(&[(COMMENT, &places)]), None).unwrap(), Vec::new());
        let view = |place: &str, limb: &str| {
            format!("{{\"pair1\": {{\"own\": {{\"place_mm\": {place}, \"limb_rad\": {limb}}}}}}}")
        };
        assert!(of_cloud(&said(&[(COMMENT, &view("[1, 2, 3]", "0.002"))]), Some(&rig.pairs)).is_ok());
        let damaged = [
            ("[1, 2]", "0.1"),
            ("[1, 2, 1e999]", "0.1"),
            ("[1, 2, null]", "0.1"),
            ("[1, 2, 3]", "-0.1"),
            ("[1, 2, 3]", "9"),
        ];
        let damaged = damaged.map(|(place, limb)| view(place, limb));
        for wrong in ["{", "[1]", "{\"pair1\": {}}"].into_iter().chain(damaged.iter().map(String::as_str)) {
            assert!(of_cloud(&said(&[(COMMENT, wrong)]), Some(&rig.pairs)).is_err(), "{wrong}");
        }
    }
}
