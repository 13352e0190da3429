//! Footprints of the rig file that the frames of a cloud contradict, as a comment of its PLY file: whoever writes the cloud states them, and
//! `measure --rig` takes the difference into the uncertainty of each feature.

use crate::ply::Cloud;
use std::collections::BTreeMap;

/// Name of the comment; its value is a JSON object.
pub const COMMENT: &str = "footprint_off_px2";

/// By camera, by how much the variance of the footprint that the frames show differs from that of the rig file, px².
pub type Contradicted = BTreeMap<String, f64>;

/// Adds what the frames of one view contradict; of several of a camera the largest difference counts.
pub fn add(contradicted: &mut Contradicted, camera: &str, off_px2: f64) {
    let largest = contradicted.entry(camera.to_owned()).or_insert(0.0);
    if off_px2.abs() > largest.abs() {
        *largest = off_px2;
    }
}

/// The value of the comment; `None` where nothing is contradicted.
pub fn comment(contradicted: &Contradicted) -> Option<String> {
    (!contradicted.is_empty()).then(|| serde_json::json!(contradicted).to_string())
}

/// What the comment of a cloud says; nothing where there is none.
///
/// # Errors
/// A comment that is no object of numbers.
pub fn of_cloud(cloud: &Cloud) -> Result<Contradicted, serde_json::Error> {
    cloud.comment(COMMENT).map_or(Ok(Contradicted::new()), serde_json::from_str)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_largest_difference_of_each_camera_comes_back_from_the_comment() {
        let mut contradicted = Contradicted::new();
        assert_eq!(comment(&contradicted), None);
        for (camera, off_px2) in [("cam2", 0.1), ("cam1", -0.3), ("cam2", -0.4), ("cam1", 0.2)] {
            add(&mut contradicted, camera, off_px2);
        }
        let said = |text: String| Cloud { comments: vec![format!("{COMMENT}: {text}")], ..Cloud::default() };
        let read = of_cloud(&said(comment(&contradicted).unwrap())).unwrap();
        assert_eq!(read, Contradicted::from([("cam1".to_owned(), -0.3), ("cam2".to_owned(), -0.4)]));
        assert_eq!(of_cloud(&Cloud::default()).unwrap(), Contradicted::new());
        for wrong in ["{", "[0.1]", "{\"cam1\": \"much\"}", "{\"cam1\": 1e999}"] {
            assert!(of_cloud(&said(wrong.to_owned())).is_err(), "{wrong}");
        }
    }
}
