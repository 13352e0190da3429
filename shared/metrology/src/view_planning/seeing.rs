//! Whether a pair sees an element, and how well.

use super::conditions::Fringes;
use super::elements::Element;
use super::planner::{PairViews, Planner};
use super::view::View;
use fringe::math::acos;
use fringe::planning::geometry::{
    Place, by_phase_at, by_projector_at, matched_noise_rad, projector_px_across,
};
use rayon::prelude::*;
use serde::Serialize;
use std::ops::Range;

/// Why a pair does not see an element, from what is farthest from seeing it to what is nearest.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Cause {
    /// It lies within another body of the part.
    Buried,
    /// It looks away from a camera or from the projector.
    FacesAway,
    /// It lies beside the picture of a camera or of the projector.
    Outside,
    /// Another face of the part hides it from a camera.
    Hidden,
    /// Another face of the part keeps the light away.
    Shadow,
    /// A view sees it more steeply than the matcher allows.
    Steep,
    /// Its fringes are too faint or too noisy for the decoder.
    Faint,
    /// Its fringes exceed the range of the camera.
    Bright,
    /// It lies so near to an edge in a picture that the matcher leaves it out.
    Rim,
    /// The pair sees it.
    Seen,
}

impl Cause {
    /// All of them, in their order.
    pub const ALL: [Self; 10] = [
        Self::Buried,
        Self::FacesAway,
        Self::Outside,
        Self::Hidden,
        Self::Shadow,
        Self::Steep,
        Self::Faint,
        Self::Bright,
        Self::Rim,
        Self::Seen,
    ];

    /// What it is in words.
    pub fn words(self) -> &'static str {
        match self {
            Self::Buried => "within another body",
            Self::FacesAway => "faces away",
            Self::Outside => "beside the picture",
            Self::Hidden => "hidden by the part",
            Self::Shadow => "in the part's shadow",
            Self::Steep => "too steep",
            Self::Faint => "too faint or noisy",
            Self::Bright => "too bright",
            Self::Rim => "at an edge in the picture",
            Self::Seen => "seen",
        }
    }
}

/// What a pair sees of an element; values that are not known are NaN.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seeing {
    /// Seen, or why not.
    pub cause: Cause,
    /// Larger one of the angles at which both views see it, from its normal, rad.
    pub incidence_rad: f32,
    /// Modulation of the finest fringes, DN.
    pub modulation_dn: f32,
    /// Standard uncertainty of a point along the normal, as the cloud states it, mm.
    pub sigma_mm: f32,
    /// Light that comes by way of other faces, as a share of that of the projector.
    pub bounce: f32,
}

impl Seeing {
    fn not(cause: Cause) -> Self {
        let absent = f32::NAN;
        Self { cause, incidence_rad: absent, modulation_dn: absent, sigma_mm: absent, bounce: absent }
    }

    /// Whether the pair sees the element.
    pub fn is_seen(&self) -> bool {
        self.cause == Cause::Seen
    }
}

/// Noise of a point and the modulation that it comes from.
struct Noise {
    modulation_dn: f64,
    sigma_mm: f64,
    usable: bool,
}

impl Planner {
    /// What each pair sees of some elements: for each element all pairs, in the order of the rig.
    pub fn seeing(&self, elements: Range<usize>) -> Vec<Seeing> {
        let all = self.elements[elements].par_iter();
        all.flat_map_iter(|element| self.pairs.iter().map(|pair| self.seen_by(pair, element))).collect()
    }

    /// What one pair sees of one element.
    pub(super) fn seen_by(&self, pair: &PairViews, element: &Element) -> Seeing {
        let mut seeing = self.seen_apart_from_rims(pair, element);
        if seeing.is_seen() && self.is_at_rim(pair, element) {
            seeing.cause = Cause::Rim;
        }
        if let (true, Some(projector)) = (seeing.cause >= Cause::Rim, &pair.projector) {
            seeing.bounce = self.bounce(projector, element) as f32;
        }
        seeing
    }

    /// The same without rims and bounces, which take most of the work.
    pub(super) fn seen_apart_from_rims(&self, pair: &PairViews, element: &Element) -> Seeing {
        if element.buried {
            return Seeing::not(Cause::Buried);
        }
        if let Some(cause) = self.not_visible(pair, element) {
            return Seeing::not(cause);
        }
        let other = pair.right.as_ref().or(pair.projector.as_ref()).unwrap_or(&pair.left);
        let cosine = pair.left.cosine(element).min(other.cosine(element));
        let incidence_rad = acos(cosine.clamp(-1.0, 1.0)) as f32;
        let Some(projector) = &pair.projector else {
            let cause = if cosine < self.conditions.usual_cosine() { Cause::Steep } else { Cause::Seen };
            return Seeing { incidence_rad, ..Seeing { cause, ..Seeing::not(cause) } };
        };
        let Some(noise) = self.noise(pair, projector, element) else {
            return Seeing { incidence_rad, ..Seeing::not(Cause::Faint) };
        };
        let cause = if cosine < self.least_cosine(pair, element, noise.sigma_mm) {
            Cause::Steep
        } else if !noise.usable {
            let white = self.conditions.white_dn * projector.unhidden_light(&element.at, &element.normal);
            if white > 0.5 * self.conditions.full_scale_dn { Cause::Bright } else { Cause::Faint }
        } else {
            Cause::Seen
        };
        let (modulation_dn, sigma_mm) = (noise.modulation_dn as f32, noise.sigma_mm as f32);
        Seeing { incidence_rad, modulation_dn, sigma_mm, ..Seeing::not(cause) }
    }

    /// Why the rays of a pair do not reach an element.
    fn not_visible(&self, pair: &PairViews, element: &Element) -> Option<Cause> {
        let cameras = [Some(&pair.left), pair.right.as_ref()].into_iter().flatten();
        let views = cameras.clone().chain(&pair.projector);
        if views.clone().any(|view| view.cosine(element) <= 0.0) {
            return Some(Cause::FacesAway);
        }
        if views.clone().any(|view| view.pixel(&element.at).is_none()) {
            return Some(Cause::Outside);
        }
        let hidden = |view: &View| view.is_hidden(&self.mesh, &element.at, &element.normal);
        if cameras.clone().any(hidden) {
            return Some(Cause::Hidden);
        }
        pair.projector.as_ref().is_some_and(hidden).then_some(Cause::Shadow)
    }

    /// Least cosine of the incidence that the matcher keeps, for the noise of a point.
    fn least_cosine(&self, pair: &PairViews, element: &Element, sigma_mm: f64) -> f64 {
        let range_mm = (pair.left.centre - element.at).norm();
        let pixel_mm = range_mm / pair.left.camera.focal_px[0];
        let depth_mm = sigma_mm / pair.left.cosine(element).max(1e-3);
        self.conditions.surface.least_cosine(depth_mm / pixel_mm)
    }

    /// Noise of a point by the axis that determines it best; `None` where no axis does.
    fn noise(&self, pair: &PairViews, projector: &View, element: &Element) -> Option<Noise> {
        let light = projector.unhidden_light(&element.at, &element.normal);
        let place = Place { at: element.at, normal: element.normal };
        let of = |fringes: &Fringes| {
            let (axis, surface) = (fringes.axis, &self.conditions.surface);
            let phase = |view: &View, noise| {
                let across = projector_px_across(&view.camera, &projector.camera, axis, &place)?;
                let brightness = self.conditions.brightness(light, across, noise);
                let (modulation_dn, sigma_rad) = brightness.phase_noise(fringes.period_px, fringes.steps);
                let usable = brightness.usable(&self.conditions.decode, modulation_dn, sigma_rad);
                Some((modulation_dn, sigma_rad, usable))
            };
            let (left_dn, left_rad, left_usable) = phase(&pair.left, pair.noise[0])?;
            let (depth, sigma_rad, modulation_dn, usable) = if let Some(right) = &pair.right {
                let cameras = (&pair.left.camera, &right.camera);
                let (right_dn, right_rad, right_usable) = phase(right, pair.noise[1])?;
                let depth = by_phase_at(cameras, &projector.camera, axis, surface, &place)?;
                let noise_rad = matched_noise_rad(left_rad, right_rad);
                (depth, noise_rad, left_dn.min(right_dn), left_usable && right_usable)
            } else {
                let views = (&pair.left.camera, &projector.camera);
                (by_projector_at(views, axis, surface, &place)?, left_rad, left_dn, left_usable)
            };
            let sigma_mm = 1e-3 * depth.u_point_um(sigma_rad, 0.0, fringes.period_px);
            Some(Noise { modulation_dn, sigma_mm, usable })
        };
        pair.fringes.iter().filter_map(of).min_by(|a, b| a.sigma_mm.total_cmp(&b.sigma_mm))
    }
}
