//! The rig as the mathematics sees it: named cameras, named projectors, pairs.

use crate::geometry::camera::Camera;
use crate::sensor::Sensor;
use std::collections::BTreeMap;

/// A camera or projector with its name.
#[derive(Debug, Clone, PartialEq)]
pub struct Named {
    /// Unique among cameras and projectors.
    pub name: String,
    /// Intrinsics, distortion and pose.
    pub camera: Camera,
}

/// Two views that are matched, and the projector whose phase they share.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Pair {
    /// Name of the pair, unique.
    pub name: String,
    /// Name of the left camera.
    pub left: String,
    /// A camera, or a projector for the conventional approach.
    pub right: String,
    /// The projector that lights the pair.
    pub projector: String,
}

/// What pairs are measured from: for each, the numbers of its pictures, one for each camera under each projector. A projector
/// takes none.
pub fn pictures<'a>(pairs: impl IntoIterator<Item = &'a Pair>) -> Vec<Vec<usize>> {
    let mut known = Vec::new();
    let of = |pair: &Pair| {
        let cameras = [&pair.left, &pair.right].into_iter().filter(|view| **view != pair.projector);
        let number = |camera: &String| {
            let picture = (camera.clone(), pair.projector.clone());
            known.iter().position(|other| *other == picture).unwrap_or_else(|| {
                known.push(picture);
                known.len() - 1
            })
        };
        cameras.map(number).collect()
    };
    pairs.into_iter().map(of).collect()
}

/// All of it, in the order of the rig file.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Rig {
    /// Cameras of the rig, in the order of the file.
    pub cameras: Vec<Named>,
    /// Projectors that are characterised; approach 2 needs none.
    pub projectors: Vec<Named>,
    /// Pairs of the rig, in the order of the file.
    pub pairs: Vec<Pair>,
    /// What is known of sensor and lens of cameras, by their names.
    pub sensors: BTreeMap<String, Sensor>,
}

impl Rig {
    /// A camera by name.
    pub fn camera(&self, name: &str) -> Option<&Camera> {
        self.cameras.iter().find(|c| c.name == name).map(|c| &c.camera)
    }

    /// What is known of a camera's sensor and lens; nothing where the rig file states nothing.
    pub fn sensor(&self, name: &str) -> Sensor {
        self.sensors.get(name).copied().unwrap_or_default()
    }

    /// A projector by name.
    pub fn projector(&self, name: &str) -> Option<&Camera> {
        self.projectors.iter().find(|p| p.name == name).map(|p| &p.camera)
    }

    /// A camera by name, or the projector of that name where no camera has it: the views of a pair are either.
    pub fn device(&self, name: &str) -> Option<&Camera> {
        self.camera(name).or_else(|| self.projector(name))
    }
}

#[cfg(test)]
mod tests {
    use super::{Pair, pictures};

    /// Proves: a picture is a camera under a projector, and a projector takes none.
    #[test]
    fn pairs_share_pictures_not_cameras_or_projectors() {
        let pair = |left: &str, right: &str, projector: &str| Pair {
            name: format!("{left}-{right}"),
            left: left.into(),
            right: right.into(),
            projector: projector.into(),
        };
        let pairs = [
            pair("a", "b", "p"),
            pair("b", "c", "p"),
            pair("a", "b", "q"),
            pair("a", "p", "p"),
            pair("d", "p", "p"),
        ];
        assert_eq!(pictures(&pairs), [vec![0, 1], vec![1, 2], vec![3, 4], vec![0], vec![5]]);
    }
}
