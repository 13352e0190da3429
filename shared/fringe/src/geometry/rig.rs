//! The rig as the mathematics sees it: named cameras, named projectors, pairs.

use crate::geometry::camera::Camera;
use crate::geometry::viewpoint::{Viewpoint, Viewpoints};
use crate::sensor::Sensor;
use crate::surface::reach_px;
use std::collections::BTreeMap;

/// Views that stand nearer than this to each other are rather given in metres, mm.
const METRES_BELOW_MM: f64 = 5.0;

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
    /// Whence each pair sees its points, in the world frame; nothing of a pair whose left view is no camera.
    pub fn viewpoints(&self, pairs: &[Pair]) -> Vec<Option<Viewpoints>> {
        let of = |name: &String| {
            let camera = self.camera(name)?;
            let limb_rad = reach_px(self.sensor(name).footprint) / camera.mean_focal_px();
            Some(Viewpoint { place_mm: camera.centre_mm().into(), limb_rad })
        };
        pairs.iter().map(|pair| Some(Viewpoints { own: of(&pair.left)?, other: of(&pair.right) })).collect()
    }

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

    /// A sentence for a rig whose views all stand so near to each other that its lengths seem to be metres instead of mm.
    pub fn unit_hint(&self) -> Option<String> {
        let centres: Vec<_> =
            self.cameras.iter().chain(&self.projectors).map(|view| view.camera.centre_mm()).collect();
        let bases = centres.iter().flat_map(|a| centres.iter().map(move |b| (a - b).norm()));
        let longest_mm = bases.fold(0.0, f64::max);
        (longest_mm > 0.0 && longest_mm < METRES_BELOW_MM).then(|| {
            format!("no two views stand further apart than {longest_mm:.4} mm: are its lengths metres? they are read as mm")
        })
    }
}

#[cfg(test)]
mod tests {
    use super::{Named, Pair, Rig, pictures};
    use crate::geometry::camera::{Camera, Lens};
    use nalgebra::Isometry3;

    /// Views a fifth of a metre apart, in mm and in metres; a single view tells nothing.
    #[test]
    fn a_rig_in_metres_is_noticed() {
        let rig = |at: &[f64]| Rig {
            cameras: at.iter().map(|x| Named { name: x.to_string(), camera: camera_at(*x) }).collect(),
            ..Rig::default()
        };
        for at in [&[0.0, 200.0][..], &[0.0, 0.1, 200.0], &[0.2], &[0.2, 0.2], &[]] {
            assert_eq!(rig(at).unit_hint(), None, "{at:?}");
        }
        let hint = rig(&[0.0, 0.1, 0.2]).unit_hint().unwrap();
        assert!(hint.contains("further apart than 0.2000 mm"), "{hint}");
    }

    fn camera_at(x: f64) -> Camera {
        Camera {
            width_px: 640,
            height_px: 480,
            focal_px: [1000.0; 2],
            principal_point_px: [320.0, 240.0],
            skew: 0.0,
            distortion: Lens::default(),
            camera_from_world: Isometry3::translation(-x, 0.0, 500.0),
        }
    }

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
