//! Footprints that differ from what was taken off the frames of a cloud, as a comment of its PLY file: whoever writes the cloud states them, and
//! `measure --rig` takes the difference into the uncertainty of each feature.

use crate::ply::Cloud;
use std::collections::{BTreeMap, BTreeSet};

/// Name of the comment; its value is a JSON object.
pub const COMMENT: &str = "footprint_off_px2";

/// By camera, by how much the variance of the footprint differs from what was taken off, px²: the frames contradict the rig file, or nothing
/// was taken off, or what settings state.
pub type FootprintsOff = BTreeMap<String, f64>;

/// Name of the comment with the cameras of which only what is known of any lens was taken off; its value is a JSON list.
pub const ASSUMED: &str = "footprint_assumed";

/// The value of that comment; `None` where there is no such camera.
pub fn assumed_comment(cameras: &BTreeSet<String>) -> Option<String> {
    (!cameras.is_empty()).then(|| serde_json::json!(cameras).to_string())
}

/// The cameras that this comment of a cloud names.
///
/// # Errors
/// A comment that is no list of names.
pub fn assumed_of_cloud(cloud: &Cloud) -> Result<BTreeSet<String>, serde_json::Error> {
    cloud.comment(ASSUMED).map_or(Ok(BTreeSet::new()), serde_json::from_str)
}

/// Adds what one view says; of several of a camera the largest difference counts.
pub fn add(all: &mut FootprintsOff, camera: &str, off_px2: f64) {
    let largest = all.entry(camera.to_owned()).or_insert(0.0);
    if off_px2.abs() > largest.abs() {
        *largest = off_px2;
    }
}

/// The value of the comment; `None` where nothing differs.
pub fn comment(all: &FootprintsOff) -> Option<String> {
    (!all.is_empty()).then(|| serde_json::json!(all).to_string())
}

/// What the comment of a cloud says; nothing where there is none.
///
/// # Errors
/// A comment that is no object of numbers.
pub fn of_cloud(cloud: &Cloud) -> Result<FootprintsOff, serde_json::Error> {
    cloud.comment(COMMENT).map_or(Ok(FootprintsOff::new()), serde_json::from_str)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_largest_difference_of_each_camera_comes_back_from_the_comment() {
        let mut off = FootprintsOff::new();
        assert_eq!(comment(&off), None);
        for (camera, off_px2) in [("cam2", 0.1), ("cam1", -0.3), ("cam2", -0.4), ("cam1", 0.2)] {
            add(&mut off, camera, off_px2);
        }
        let said = |text: String| Cloud { comments: vec![format!("{COMMENT}: {text}")], ..Cloud::default() };
        let read = of_cloud(&said(comment(&off).unwrap())).unwrap();
        assert_eq!(read, FootprintsOff::from([("cam1".to_owned(), -0.3), ("cam2".to_owned(), -0.4)]));
        assert_eq!(of_cloud(&Cloud::default()).unwrap(), FootprintsOff::new());
        for wrong in ["{", "[0.1]", "{\"cam1\": \"much\"}", "{\"cam1\": 1e999}"] {
            assert!(of_cloud(&said(wrong.to_owned())).is_err(), "{wrong}");
        }
    }

    #[test]
    fn cameras_whose_footprint_was_assumed_come_back_from_the_comment() {
        let cameras = BTreeSet::from(["cam2".to_owned(), "a \"b\"".to_owned()]);
        let said = |text: String| Cloud { comments: vec![format!("{ASSUMED}: {text}")], ..Cloud::default() };
        assert_eq!(assumed_of_cloud(&said(assumed_comment(&cameras).unwrap())).unwrap(), cameras);
        assert_eq!(assumed_comment(&BTreeSet::new()), None);
        assert!(assumed_of_cloud(&Cloud::default()).unwrap().is_empty());
        for wrong in ["{", "{\"cam1\": 1}", "[1]"] {
            assert!(assumed_of_cloud(&said(wrong.to_owned())).is_err(), "{wrong}");
        }
    }
}
