//! Whether the points of two cameras lie where the projector that lit them puts them.
//!
//! Two cameras match any two smooth pictures: frames of exchanged cameras, or those of one camera from another placement of the part, give a cloud as
//! well. Where the rig file has the projector, its phase at a camera's pixel is a projector's column or row, in which the point must lie.

use super::matching::Views;
use fringe::cloud::Point;
use fringe::geometry::camera::Camera;
use fringe::geometry::rig::{Pair, Rig};
use fringe::math::statistics::{SIGMA_OF_MEDIAN, median};
use fringe::pattern::Axis;
use fringe::phase::PhaseView;
use std::f64::consts::TAU;

/// Points that are asked, about.
const ASKED: usize = 512;
/// Fewer of them say nothing.
const LEAST: usize = 50;
/// Offset that is told, projector px: calibrated projectors leave some hundredths, a knock by 0.01° a quarter.
const TOLD_PX: f64 = 0.15;

/// Compares the points of a pair with its projector, again and again.
pub struct ProjectorCheck {
    pair: String,
    projector_name: String,
    left: Camera,
    projector: Camera,
    offsets_px: Vec<f64>,
}

impl ProjectorCheck {
    /// The check of a pair of two cameras; `None` where the rig file does not have their projector.
    pub fn new(rig: &Rig, pair: &Pair) -> Option<Self> {
        rig.camera(&pair.right)?;
        Some(Self {
            pair: pair.name.clone(),
            projector_name: pair.projector.clone(),
            left: rig.camera(&pair.left)?.clone(),
            projector: rig.projector(&pair.projector)?.clone(),
            offsets_px: Vec::with_capacity(4 * ASKED),
        })
    }

    /// How far the points lie beside what the left camera sees of the projector, the noise of the phase taken out: robust root mean square, projector px;
    /// `None` where too few tell.
    fn offset_px(&mut self, left: &Views<'_>, points: &[Point]) -> Option<f64> {
        self.offsets_px.clear();
        let mut noise_px2 = 0.0;
        for point in points.iter().step_by((points.len() / ASKED).max(1)) {
            let place = point.position();
            let seen =
                self.left.project(&place).and_then(|pixel| Some((pixel, self.projector.project(&place)?)));
            let Some((pixel, lit)) = seen else { continue };
            for (view, along) in [(left.along(Axis::X), lit.x), (left.along(Axis::Y), lit.y)] {
                let Some([shown, sigma]) = view.and_then(|view| coordinate_px(view, pixel.x, pixel.y)) else {
                    continue;
                };
                self.offsets_px.push((shown - along).abs());
                noise_px2 += sigma * sigma;
            }
        }
        let count = self.offsets_px.len();
        let offset_px =
            median(&mut self.offsets_px).filter(|_| count >= LEAST).map(|median| SIGMA_OF_MEDIAN * median)?;
        Some((offset_px * offset_px - noise_px2 / count as f64).max(0.0).sqrt())
    }

    /// The offset, and what a person should know of it.
    pub fn judge(&mut self, left: &Views<'_>, points: &[Point]) -> (Option<f64>, Option<String>) {
        let offset_px = self.offset_px(left, points);
        (offset_px, offset_px.and_then(|offset| self.warning(offset)))
    }

    /// What a person should know of an offset.
    fn warning(&self, offset_px: f64) -> Option<String> {
        (offset_px > TOLD_PX).then(|| {
            format!(
                "pair \"{}\": its points lie {offset_px:.2} px (rms) beside where projector \"{}\" of the rig file lights them, where {TOLD_PX} px is much: \
                 frames are those of another camera or of another place of the part, or a view has moved; look at the frames of both cameras, then \
                 run `fringetool check-rig`",
                self.pair, self.projector_name
            )
        })
    }
}

/// The projector's column or row that the pixel nearest to a place shows, and its standard uncertainty.
fn coordinate_px(view: &PhaseView, x: f64, y: f64) -> Option<[f64; 2]> {
    let (width, height) = (f64::from(view.info.width_px), f64::from(view.info.height_px));
    let (column, row) = (x.round(), y.round());
    let inside = (0.0..width).contains(&column) && (0.0..height).contains(&row);
    let index = inside.then(|| row as usize * view.info.width_px as usize + column as usize)?;
    let px = |rad: f32| f64::from(rad) * view.info.period_px / TAU;
    (view.valid[index] == 1).then(|| [px(view.phase_rad[index]), px(view.sigma_rad[index])])
}

#[cfg(test)]
mod tests {
    use super::*;
    use fringe::geometry::rig::Named;
    use fringe::phase::{PhaseInfo, PhaseMap};

    /// Two cameras with a projector between them.
    fn rig() -> Rig {
        let [left, right, projector] = fringe::synthetic::rig(168, 112);
        let named = |name: &str, camera: Camera| Named { name: name.to_owned(), camera };
        let pair = Pair {
            name: "pair1".into(),
            left: "cam1".into(),
            right: "cam2".into(),
            projector: "proj1".into(),
        };
        Rig {
            cameras: vec![named("cam1", left), named("cam2", right)],
            projectors: vec![named("proj1", projector)],
            pairs: vec![pair],
            sensors: std::collections::BTreeMap::new(),
        }
    }

    /// A plane as a pair sees it: points where the projector lights them, and what the left camera shows of that, moved by so many pixels.
    fn shown(moved_px: f64) -> (ProjectorCheck, PhaseMap, Vec<Point>) {
        let rig = rig();
        let check = ProjectorCheck::new(&rig, &rig.pairs[0]).unwrap();
        let info = PhaseInfo { width_px: 168, height_px: 112, axis: Axis::X, period_px: 16.0 };
        let mut map = PhaseMap::new(info);
        let mut points = Vec::new();
        for i in 0..900 {
            let at = |i: usize| (i as f64 - 15.0) * 2.0;
            let point = Point { position_mm: [at(i % 30), at(i / 30), 5.0], ..bytemuck::Zeroable::zeroed() };
            let place = point.position();
            let (pixel, lit) =
                (check.left.project(&place).unwrap(), check.projector.project(&place).unwrap());
            let (column, row) = (pixel.x.round(), pixel.y.round());
            let inside = (0.0..168.0).contains(&column) && (0.0..112.0).contains(&row);
            if !inside {
                continue;
            }
            let index = row as usize * 168 + column as usize;
            map.phase_rad[index] = ((lit.x + moved_px) * TAU / 16.0) as f32;
            (map.sigma_rad[index], map.valid[index]) = (0.001, 1);
            points.push(point);
        }
        (check, map, points)
    }

    #[test]
    fn points_beside_what_their_camera_sees_of_the_projector_are_told() {
        for (moved_px, told) in [(0.0, false), (0.05, false), (0.4, true), (-3.0, true)] {
            let (mut check, map, points) = shown(moved_px);
            let offset = check.offset_px(&Views::of([map.view()]), &points).unwrap();
            // Neighbouring points may share a pixel, whose phase is that of the last one.
            assert!(
                (offset - SIGMA_OF_MEDIAN * moved_px.abs()).abs() < 0.05 + 0.1 * moved_px.abs(),
                "{offset} of {moved_px}"
            );
            let warning = check.warning(offset);
            assert_eq!(warning.is_some_and(|text| text.contains("\"pair1\"")), told, "{moved_px}: {offset}");
        }
    }

    #[test]
    fn a_few_points_or_a_rig_without_the_projector_tell_nothing() {
        let (mut check, map, points) = shown(3.0);
        assert_eq!(check.offset_px(&Views::of([map.view()]), &points[..20]), None);
        assert_eq!(check.offset_px(&Views::default(), &points), None);
        let mut rig = rig();
        let pair = rig.pairs[0].clone();
        rig.projectors.clear();
        assert!(ProjectorCheck::new(&rig, &pair).is_none());
    }
}
