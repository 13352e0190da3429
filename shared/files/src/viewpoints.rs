//! Whence the points of a cloud were seen, as a comment of its PLY file: whoever writes the cloud states it, and elements are freed of what noise along the lines
//! of sight does to them ([`metrology::inspection::Plan::with_viewpoints`]).

use crate::cloud_pairs;
use crate::ply::Cloud;
use fringe::geometry::rig::{Pair, Rig};
use nalgebra::Point3;
use std::collections::BTreeMap;

/// Name of the comment; its value is a JSON object: by pair, the place of the camera whose pixels became its points, in the frame of the cloud, mm.
pub const COMMENT: &str = "viewpoints_mm";

/// The value of the comment.
pub fn comment(rig: &Rig, pairs: &[Pair]) -> String {
    let places = rig.viewpoints(pairs).into_iter();
    let known = pairs.iter().zip(places).filter_map(|(pair, place)| Some((pair.name.as_str(), place?)));
    let known: BTreeMap<&str, [f64; 3]> = known.map(|(name, place)| (name, place.into())).collect();
    serde_json::json!(known).to_string()
}

/// What the comment of a cloud says, by the numbers of the pairs that its points have: those of the rig file (`names`) where they were numbered by one, or of its
/// own list of pairs. Nothing where there is no comment, as in a cloud of other programs or one that was moved.
///
/// # Errors
/// A comment that is no object of places.
pub fn of_cloud(
    cloud: &Cloud,
    names: Option<&[Pair]>,
) -> Result<Vec<Option<Point3<f64>>>, serde_json::Error> {
    let Some(text) = cloud.comment(COMMENT) else { return Ok(Vec::new()) };
    let places: BTreeMap<String, [f64; 3]> = serde_json::from_str(text)?;
    let own =
        || cloud.comment(cloud_pairs::COMMENT).map_or(Ok(Vec::new()), serde_json::from_str::<Vec<String>>);
    let names = names.map_or_else(own, |pairs| Ok(pairs.iter().map(|pair| pair.name.clone()).collect()))?;
    Ok(names.iter().map(|name| places.get(name).map(|place| Point3::from(*place))).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig_file::read_rig;
    use fringe::geometry::camera::Camera;
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
        let left = |pair: &Pair| rig.camera(&pair.left).map(Camera::centre_mm);
        assert!(pairs.len() > 1);
        assert_eq!(of_cloud(&cloud, None).unwrap(), pairs.iter().map(left).collect::<Vec<_>>());
        assert_eq!(
            of_cloud(&cloud, Some(&rig.pairs)).unwrap(),
            rig.pairs.iter().map(left).collect::<Vec<_>>()
        );
        assert_eq!(of_cloud(&Cloud::default(), Some(&rig.pairs)).unwrap(), Vec::new());
        assert_eq!(of_cloud(&said(&[(COMMENT, &places)]), None).unwrap(), Vec::new());
        for wrong in
            ["{", "[1]", "{\"pair1\": [1, 2]}", "{\"pair1\": [1, 2, 1e999]}", "{\"pair1\": [1, 2, null]}"]
        {
            assert!(of_cloud(&said(&[(COMMENT, wrong)]), Some(&rig.pairs)).is_err(), "{wrong}");
        }
    }
}
