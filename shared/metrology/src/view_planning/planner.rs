//! Rig, part and conditions together.

use super::conditions::{Conditions, Fringes};
use super::elements::{Element, elements};
use super::error::ViewPlanError;
use super::view::View;
use crate::spatial::TriangleMesh;
use fringe::geometry::rig::{Pair, Rig};
use fringe::planning::geometry::middle_mm;
use fringe::sensor::CameraNoise;
use nalgebra::Point3;
use std::collections::BTreeMap;

/// A part of fewer pixels than this is none.
const LEAST_PX: f64 = 20.0;

/// The views of a pair.
#[derive(Debug, Clone)]
pub(super) struct PairViews {
    pub pair: Pair,
    pub left: View,
    /// The other camera; none where a projector is read backwards.
    pub right: Option<View>,
    /// The light; none where the rig does not hold it.
    pub projector: Option<View>,
    pub fringes: Vec<Fringes>,
    /// Noise of the left and the right camera.
    pub noise: [CameraNoise; 2],
}

/// What the pairs of a rig will see of a part.
#[derive(Debug, Clone)]
pub struct Planner {
    pub(super) mesh: TriangleMesh,
    pub(super) elements: Vec<Element>,
    pub(super) pairs: Vec<PairViews>,
    pub(super) conditions: Conditions,
}

/// The fringes of each projector, by its name.
pub type FringesOf = BTreeMap<String, Vec<Fringes>>;

impl Planner {
    /// Prepares the part, a mesh in the world frame, and the pairs of a rig. Where `fringes` has no entry for a projector, that under the empty name counts.
    ///
    /// # Errors
    /// Conditions out of their range, a rig without pairs, a part that is too small or lies where no pair looks.
    pub fn new(
        mesh: TriangleMesh,
        rig: &Rig,
        fringes: &FringesOf,
        conditions: Conditions,
    ) -> Result<Self, ViewPlanError> {
        conditions.check()?;
        let middle = mesh.bounds().centre();
        let pairs = rig
            .pairs
            .iter()
            .map(|pair| pair_views(rig, pair, fringes, &conditions, &middle))
            .collect::<Result<Vec<_>, _>>()?;
        if pairs.is_empty() {
            return Err(ViewPlanError::NoPair);
        }
        let elements = elements(&mesh, conditions.element_mm)?;
        let planner = Self { mesh, elements, pairs, conditions };
        planner.check_place(&middle)?;
        planner.check_size()?;
        Ok(planner)
    }

    /// Refuses a part of a few pixels.
    fn check_size(&self) -> Result<(), ViewPlanError> {
        let bounds = self.mesh.bounds();
        let size_mm = (bounds.high - bounds.low).norm();
        let left = &self.pairs[0].left;
        let pixel_mm = left.reference_mm / left.camera.focal_px[0];
        if size_mm < LEAST_PX * pixel_mm {
            return Err(ViewPlanError::Tiny { size_mm, camera: left.name.clone(), pixel_mm });
        }
        Ok(())
    }

    /// Refuses a part of which no pair has anything in both pictures.
    fn check_place(&self, middle: &Point3<f64>) -> Result<(), ViewPlanError> {
        let any = |pair: &PairViews| {
            let views = [Some(&pair.left), pair.right.as_ref(), pair.projector.as_ref()];
            let in_all = |at: &Point3<f64>| views.iter().flatten().all(|view| view.pixel(at).is_some());
            self.elements.iter().any(|element| in_all(&element.at))
        };
        if self.pairs.iter().any(any) {
            return Ok(());
        }
        let pair = &self.pairs[0];
        let other = pair.right.as_ref().or(pair.projector.as_ref());
        let looks_at = other.and_then(|other| middle_mm(&pair.left.camera, &other.camera));
        Err(ViewPlanError::Outside {
            middle_mm: middle.coords.into(),
            pair: pair.pair.name.clone(),
            looks_at_mm: looks_at.unwrap_or(pair.left.centre).coords.into(),
        })
    }

    /// The elements of the surface.
    pub fn elements(&self) -> &[Element] {
        &self.elements
    }

    /// The part in the world frame.
    pub fn mesh(&self) -> &TriangleMesh {
        &self.mesh
    }

    /// The pairs in the order of the rig.
    pub fn pairs(&self) -> impl ExactSizeIterator<Item = &Pair> {
        self.pairs.iter().map(|views| &views.pair)
    }

    /// Whether the rig states where the light of a pair comes from.
    pub fn is_lit(&self, pair: usize) -> bool {
        self.pairs.get(pair).is_some_and(|views| views.projector.is_some())
    }

    /// What is assumed of light, cameras and part.
    pub fn conditions(&self) -> &Conditions {
        &self.conditions
    }
}

/// The views of a pair, each with its name checked.
pub(super) fn pair_views(
    rig: &Rig,
    pair: &Pair,
    fringes: &FringesOf,
    conditions: &Conditions,
    middle: &Point3<f64>,
) -> Result<PairViews, ViewPlanError> {
    let unknown = |view: &str| ViewPlanError::NoView { pair: pair.name.clone(), view: view.to_owned() };
    let left = rig.camera(&pair.left).ok_or_else(|| unknown(&pair.left))?;
    let right = rig.camera(&pair.right).map(|camera| View::new(&pair.right, camera, middle));
    let lamp = if right.is_some() { &pair.projector } else { &pair.right };
    let projector = rig.projector(lamp).map(|camera| View::new(lamp, camera, middle));
    if right.is_none() && projector.is_none() {
        return Err(unknown(&pair.right));
    }
    let own = fringes.get(lamp).or_else(|| fringes.get("")).cloned().unwrap_or_default();
    if own.is_empty() && projector.is_some() {
        return Err(ViewPlanError::NoFringes { pair: pair.name.clone(), projector: lamp.clone() });
    }
    let noise = [&pair.left, &pair.right].map(|name| rig.sensor(name).noise.unwrap_or(conditions.noise));
    Ok(PairViews {
        pair: pair.clone(),
        left: View::new(&pair.left, left, middle),
        right,
        projector,
        fringes: own,
        noise,
    })
}
