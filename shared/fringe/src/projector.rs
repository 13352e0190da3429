//! The conventional approach: one camera and a projector read backwards (thesis eq. 3.7).
//!
//! The phase tells the projector column (or row), which is a surface in space: a plane without lens distortion, curved
//! with it. The point is where the camera's ray meets that surface. The plane gives the start, then Newton's method
//! along the ray solves the exact projector model, so that nothing is linearised. With phases along both axes the
//! point is the weighted least-squares one on the ray, and their disagreement tells wrong fringe orders (an epipolar
//! check, Bräuer-Burchardt 2011).

use crate::camera::Camera;
use crate::cloud::Point;
use crate::matching::{MatchError, check_map, mask};
use crate::parallel::for_parts;
use crate::pattern::Axis;
use crate::phase::PhaseView;
use crate::rectify::RectifiedCamera;
use crate::surface::{Sample, SurfaceBuilder, SurfaceReport, SurfaceSettings, View};
use nalgebra::{Matrix3, Point2, Vector2, Vector3};
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// Pixels per part of parallel work; fixed, so that no result depends on the number of threads.
const PART_PIXELS: usize = 16_384;

/// Newton steps along the ray; from the ideal plane three reach 1e-12 mm.
const MAX_STEPS: usize = 8;

/// A step shorter than this ends the iteration, relative to the depth: it is quadratic, the next one is below rounding.
const SETTLED: f64 = 1e-9;

/// How to intersect.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ProjectorSettings {
    /// Nearest and farthest depth along the optical axis of the camera, mm; absent: everything in front of both.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depth_mm: Option<[f64; 2]>,
    /// Largest disagreement of the two axes, projector pixels: beyond it one fringe order is wrong.
    pub max_epipolar_px: f64,
    /// Projector coordinates may exceed its image by this, px.
    pub margin_px: f64,
    /// What counts as a surface.
    pub surface: SurfaceSettings,
}

impl Default for ProjectorSettings {
    fn default() -> Self {
        Self { depth_mm: None, max_epipolar_px: 2.0, margin_px: 0.5, surface: SurfaceSettings::default() }
    }
}

/// What became of the pixels; all add up to `valid`.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct ProjectorReport {
    /// Pixels valid along all given axes.
    pub valid: u32,
    /// The ray does not meet the column within the projector's image and the depth limits.
    pub missed: u32,
    /// Both axes disagree.
    pub contradicting: u32,
    /// Root mean square disagreement of both axes, projector pixels; absent with one axis.
    pub epipolar_rms_px: Option<f64>,
    /// Dropped as spikes, crumbs or steep, and points.
    pub surface: SurfaceReport,
    /// Points written: `surface.points`.
    pub points: u32,
}

/// Intersects the rays of a camera with the columns and rows of a projector. `run` allocates nothing.
#[derive(Debug, Clone)]
pub struct ProjectorMatcher {
    camera: Camera,
    projector: Camera,
    settings: ProjectorSettings,
    /// Ideal normalised coordinates of the camera's pixels.
    directions: Vec<[f64; 2]>,
    parts: Vec<usize>,
    tasks: Vec<Task>,
    phase_x: Vec<f32>,
    phase_y: Vec<f32>,
    samples: Vec<Sample>,
    surface: SurfaceBuilder,
}

#[derive(Debug, Clone, Copy, Default)]
struct Task {
    valid: u32,
    missed: u32,
    contradicting: u32,
    checked: u32,
    squares_px2: f64,
}

/// One observed projector coordinate.
#[derive(Debug, Clone, Copy)]
struct Observation {
    pixel: f64,
    sigma_px: f64,
}

enum Miss {
    Missed,
    Contradicting,
}

impl ProjectorMatcher {
    /// Computes the rays of the camera.
    ///
    /// # Errors
    /// Impossible cameras or settings.
    pub fn new(
        camera: &Camera,
        projector: &Camera,
        settings: &ProjectorSettings,
    ) -> Result<Self, MatchError> {
        settings.check()?;
        for (side, view) in [("camera", camera), ("projector", projector)] {
            view.check().map_err(|source| MatchError::Camera { side, source })?;
        }
        let (width, height) = (camera.width_px as usize, camera.height_px as usize);
        let straight = RectifiedCamera { camera: camera.clone(), camera_from_rectified: Matrix3::identity() };
        let pixels = width * height;
        let parts = (0..=pixels.div_ceil(PART_PIXELS)).map(|part| (part * PART_PIXELS).min(pixels)).collect();
        Ok(Self {
            directions: straight.table(),
            camera: camera.clone(),
            projector: projector.clone(),
            settings: *settings,
            parts,
            tasks: vec![Task::default(); pixels.div_ceil(PART_PIXELS)],
            phase_x: vec![f32::NAN; pixels],
            phase_y: vec![f32::NAN; pixels],
            samples: vec![Sample::NONE; pixels],
            surface: SurfaceBuilder::new(width, height, settings.surface),
        })
    }

    /// How many points `run` may write: one per pixel.
    pub fn capacity(&self) -> usize {
        self.samples.len()
    }

    /// Intersects; the first `report.points` elements of `out` are the points in the order of the pixels.
    ///
    /// # Errors
    /// No phase at all, maps that do not fit the camera or tell another axis, or an `out` shorter than
    /// [`Self::capacity`].
    pub fn run(
        &mut self,
        phase_x: Option<&PhaseView>,
        phase_y: Option<&PhaseView>,
        pair: u32,
        out: &mut [Point],
    ) -> Result<ProjectorReport, MatchError> {
        self.check(phase_x, phase_y, out.len())?;
        if let Some(map) = phase_x {
            mask(map, &mut self.phase_x);
        }
        if let Some(map) = phase_y {
            mask(map, &mut self.phase_y);
        }
        let mut report = self.intersect(phase_x, phase_y);
        let view = View {
            width: self.camera.width_px as usize,
            height: self.camera.height_px as usize,
            directions: &self.directions,
            pitch: 2.0 / (self.camera.focal_px[0] + self.camera.focal_px[1]),
            world_from_sight: self
                .camera
                .camera_from_world
                .rotation
                .inverse()
                .to_rotation_matrix()
                .into_inner(),
            origin_mm: self.camera.centre_mm(),
            other_mm: (self.camera.camera_from_world * self.projector.centre_mm()).coords,
        };
        report.surface = self.surface.build(&view, &mut self.samples, pair, out);
        report.points = report.surface.points;
        Ok(report)
    }

    fn intersect(&mut self, phase_x: Option<&PhaseView>, phase_y: Option<&PhaseView>) -> ProjectorReport {
        let projector_from_camera =
            self.projector.camera_from_world * self.camera.camera_from_world.inverse();
        let rays = Rays {
            projector: &self.projector,
            settings: &self.settings,
            rotation: projector_from_camera.rotation.to_rotation_matrix().into_inner(),
            origin: projector_from_camera.translation.vector,
        };
        let read = |map: Option<&PhaseView>, masked: &[f32], pixel: usize| {
            map.map(|map| {
                let scale = map.info.period_px / TAU;
                let sigma_px = f64::from(map.sigma_rad[pixel]) * scale;
                Observation { pixel: f64::from(masked[pixel]) * scale, sigma_px }
            })
        };
        let modulation = |pixel: usize| {
            let all = [phase_x, phase_y].into_iter().flatten().map(|map| map.modulation[pixel]);
            all.fold(f32::INFINITY, f32::min)
        };
        let Self { samples, tasks, parts, directions, phase_x: masked_x, phase_y: masked_y, .. } = self;
        for_parts(parts, samples, tasks, &|part, samples, task| {
            *task = Task::default();
            for (pixel, sample) in (parts[part]..).zip(samples) {
                *sample = Sample::NONE;
                let (x, y) = (read(phase_x, masked_x, pixel), read(phase_y, masked_y, pixel));
                let seen =
                    [x, y].iter().flatten().all(|o| o.pixel.is_finite()) && directions[pixel][0].is_finite();
                if seen {
                    rays.solve(directions[pixel], [x, y], modulation(pixel), sample, task);
                }
            }
        });
        summed(tasks)
    }

    fn check(&self, x: Option<&PhaseView>, y: Option<&PhaseView>, room: usize) -> Result<(), MatchError> {
        if x.is_none() && y.is_none() {
            return Err(MatchError::NoPhase);
        }
        for (map, wanted) in [(x, Axis::X), (y, Axis::Y)] {
            let Some(map) = map else { continue };
            check_map("camera", map, &self.camera)?;
            if map.info.axis != wanted {
                return Err(MatchError::WrongAxis { wanted, found: map.info.axis });
            }
        }
        let needed = self.capacity();
        if room < needed { Err(MatchError::Room { room, needed }) } else { Ok(()) }
    }
}

fn summed(tasks: &[Task]) -> ProjectorReport {
    let mut report = ProjectorReport::default();
    let (mut squares, mut checked) = (0.0, 0);
    for task in tasks {
        report.valid += task.valid;
        report.missed += task.missed;
        report.contradicting += task.contradicting;
        squares += task.squares_px2;
        checked += task.checked;
    }
    report.epipolar_rms_px = (checked > 0).then(|| (squares / f64::from(checked)).sqrt());
    report
}

impl ProjectorSettings {
    fn check(&self) -> Result<(), MatchError> {
        if let Some((key, value, limits)) = self.surface.fault() {
            return Err(MatchError::Setting { key, value, limits });
        }
        crate::matching::check_depth(self.depth_mm)?;
        for (key, value) in [("max_epipolar_px", self.max_epipolar_px), ("margin_px", self.margin_px)] {
            if !(value.is_finite() && value >= 0.0) {
                return Err(MatchError::Setting { key, value, limits: "zero or a positive number" });
            }
        }
        Ok(())
    }
}

/// The camera's rays in the projector frame: X(Z) = rotation · (x, y, 1) Z + origin.
struct Rays<'a> {
    projector: &'a Camera,
    settings: &'a ProjectorSettings,
    rotation: Matrix3<f64>,
    origin: Vector3<f64>,
}

impl Rays<'_> {
    fn solve(
        &self,
        [x, y]: [f64; 2],
        observed: [Option<Observation>; 2],
        modulation: f32,
        sample: &mut Sample,
        task: &mut Task,
    ) {
        task.valid += 1;
        let along = self.rotation * Vector3::new(x, y, 1.0);
        match self.depth(&along, &observed) {
            Ok((depth, sigma_depth, disagreement_px)) => {
                if let Some(off) = disagreement_px {
                    task.checked += 1;
                    task.squares_px2 += off * off;
                }
                // dq = dZ / Z².
                let sigma = (sigma_depth / (depth * depth)) as f32;
                *sample = Sample { inverse_depth: 1.0 / depth, sigma, modulation };
            }
            Err(Miss::Missed) => task.missed += 1,
            Err(Miss::Contradicting) => task.contradicting += 1,
        }
    }

    /// Depth, its uncertainty, and the disagreement of both axes where both are given.
    fn depth(
        &self,
        along: &Vector3<f64>,
        observed: &[Option<Observation>; 2],
    ) -> Result<(f64, f64, Option<f64>), Miss> {
        let start = self.start(along, observed).ok_or(Miss::Missed)?;
        let solved = self.newton(along, observed, start).ok_or(Miss::Missed)?;
        let Solution { depth, pixel, slope } = solved;
        let [near, far] = self.settings.depth_mm.unwrap_or([0.0, f64::INFINITY]);
        let margin = self.settings.margin_px;
        let inside =
            |value: f64, count: u32| value >= -0.5 - margin && value <= f64::from(count) - 0.5 + margin;
        let on_image = inside(pixel.x, self.projector.width_px) && inside(pixel.y, self.projector.height_px);
        if !(on_image && depth >= near && depth <= far) {
            return Err(Miss::Missed);
        }
        let mut information = 0.0;
        let mut residuals = [None; 2];
        for axis in 0..2 {
            if let Some(o) = observed[axis] {
                let weight = weight(observed, axis);
                information += weight * slope[axis] * slope[axis];
                residuals[axis] = Some(pixel[axis] - o.pixel);
            }
        }
        let off = match residuals {
            [Some(u), Some(v)] => Some((u * u + v * v).sqrt()),
            _ => None,
        };
        if off.is_some_and(|off| off > self.settings.max_epipolar_px) {
            return Err(Miss::Contradicting);
        }
        // Weights are relative to the first sigma when that is zero (ideal data): then so is the result.
        let exact = observed.iter().flatten().any(|o| o.sigma_px == 0.0);
        let sigma = if exact { 0.0 } else { 1.0 / information.sqrt() };
        if sigma.is_finite() { Ok((depth, sigma, off)) } else { Err(Miss::Missed) }
    }

    /// Intersection with the ideal plane of the column (or row) through its pixel beside the principal point.
    fn start(&self, along: &Vector3<f64>, observed: &[Option<Observation>; 2]) -> Option<f64> {
        let [cx, cy] = self.projector.principal_point_px;
        let axis = usize::from(observed[0].is_none());
        let value = observed[axis]?.pixel;
        let pixel = if axis == 0 { Point2::new(value, cy) } else { Point2::new(cx, value) };
        let ideal = self.projector.normalised_from_pixel(pixel)?[axis];
        // Plane X − ideal·Z = 0 (or Y − ideal·Z = 0) in the projector frame.
        let depth = (ideal * self.origin.z - self.origin[axis]) / (along[axis] - ideal * along.z);
        (depth > 0.0 && depth.is_finite()).then_some(depth)
    }

    /// Gauss–Newton on the observed coordinates along the ray.
    fn newton(
        &self,
        along: &Vector3<f64>,
        observed: &[Option<Observation>; 2],
        start: f64,
    ) -> Option<Solution> {
        let mut depth = start;
        for _ in 0..MAX_STEPS {
            let (pixel, slope) = self.project(along, depth)?;
            let (mut pull, mut stiffness) = (0.0, 0.0);
            for axis in 0..2 {
                if let Some(o) = observed[axis] {
                    let weight = weight(observed, axis);
                    pull += weight * slope[axis] * (o.pixel - pixel[axis]);
                    stiffness += weight * slope[axis] * slope[axis];
                }
            }
            let step = pull / stiffness;
            depth += step;
            let sane = depth > 0.0 && depth.is_finite();
            if !sane {
                return None;
            }
            if step.abs() < SETTLED * depth {
                return Some(Solution { depth, pixel: pixel + slope * step, slope });
            }
        }
        None
    }

    /// Projector pixel of the ray at a depth, and its derivative by the depth.
    fn project(&self, along: &Vector3<f64>, depth: f64) -> Option<(Point2<f64>, Vector2<f64>)> {
        let at = along * depth + self.origin;
        if at.z <= 1e-9 {
            return None;
        }
        let ideal = Vector2::new(at.x / at.z, at.y / at.z);
        let turn = Vector2::new(along.x - ideal.x * along.z, along.y - ideal.y * along.z) / at.z;
        let lens = self.projector.distortion.jacobian(ideal) * turn;
        let [fx, fy] = self.projector.focal_px;
        let slope = Vector2::new(fx * lens.x + self.projector.skew * lens.y, fy * lens.y);
        Some((self.projector.pixel_from_normalised(ideal), slope))
    }
}

struct Solution {
    depth: f64,
    pixel: Point2<f64>,
    slope: Vector2<f64>,
}

/// 1/σ² of an axis; 1 when a sigma is zero, as in ideal data.
fn weight(observed: &[Option<Observation>; 2], axis: usize) -> f64 {
    let exact = observed.iter().flatten().any(|o| o.sigma_px == 0.0);
    observed[axis].map_or(0.0, |o| if exact { 1.0 } else { 1.0 / (o.sigma_px * o.sigma_px) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{Scene, Surface, pixel_of, rig};
    use proptest::prelude::*;

    fn scene(projector: &Camera, surface: Surface) -> Scene {
        Scene { surfaces: vec![surface], projector: projector.clone(), period_px: 16.0 }
    }

    fn rays<'a>(camera: &Camera, projector: &'a Camera, settings: &'a ProjectorSettings) -> Rays<'a> {
        let projector_from_camera = projector.camera_from_world * camera.camera_from_world.inverse();
        Rays {
            projector,
            settings,
            rotation: projector_from_camera.rotation.to_rotation_matrix().into_inner(),
            origin: projector_from_camera.translation.vector,
        }
    }

    proptest! {
        /// The exact projector coordinates of a point give the point back to 1e-9 mm, with a strongly distorted projector.
        #[test]
        fn the_curved_column_is_met_exactly(
            x in -60.0_f64..60.0, y in -50.0_f64..50.0, z in -45.0_f64..45.0, k1 in -0.25_f64..0.25, axes in 0..3_usize,
        ) {
            let [camera, _, mut projector] = rig(1124, 750);
            projector.distortion.k = [k1, 0.1, 0.0];
            projector.distortion.p = [1e-3, -2e-3];
            projector.skew = 0.5;
            let settings = ProjectorSettings::default();
            let rays = rays(&camera, &projector, &settings);
            let truth = nalgebra::Point3::new(x, y, z);
            let (inside, lit) = (camera.camera_from_world * truth, projector.project(&truth).unwrap());
            let along = rays.rotation * Vector3::new(inside.x / inside.z, inside.y / inside.z, 1.0);
            let observe = |axis: usize| {
                (axes == 2 || axes == axis).then_some(Observation { pixel: lit[axis], sigma_px: 0.1 })
            };
            // Rows meet the camera's rays at a glancing angle here: the solution is as exact, scaled by that.
            let result = rays.depth(&along, &[observe(0), observe(1)]);
            if projector.contains(lit) && axes != 1 {
                let Ok((depth, _, off)) = result else { return Err(TestCaseError::fail("missed")) };
                prop_assert!((depth - inside.z).abs() < 1e-9, "{} beside {}", depth, inside.z);
                prop_assert!(off.is_none_or(|off| off < 1e-9));
            }
        }

        /// Newton's root is the one that bisection finds.
        #[test]
        fn newton_agrees_with_bisection(u in 50.0_f64..550.0, row in 100..650_usize, column in 200..900_usize) {
            let [camera, _, mut projector] = rig(1124, 750);
            projector.distortion.k = [-0.2, 0.1, 0.0];
            let settings = ProjectorSettings { margin_px: 1e4, ..ProjectorSettings::default() };
            let rays = rays(&camera, &projector, &settings);
            let ideal = camera.normalised_from_pixel(Point2::new(column as f64, row as f64)).unwrap();
            let along = rays.rotation * Vector3::new(ideal.x, ideal.y, 1.0);
            let residual = |depth: f64| rays.project(&along, depth).unwrap().0.x - u;
            let (mut low, mut high) = (300.0, 900.0);
            prop_assume!(residual(low) * residual(high) < 0.0);
            for _ in 0..100 {
                let middle = f64::midpoint(low, high);
                if residual(low) * residual(middle) <= 0.0 { high = middle } else { low = middle }
            }
            let observed = [Some(Observation { pixel: u, sigma_px: 0.1 }), None];
            let Ok((depth, ..)) = rays.depth(&along, &observed) else { return Err(TestCaseError::fail("missed")) };
            prop_assert!((depth - low).abs() < 1e-9, "{} beside {}", depth, low);
        }
    }

    fn points(
        matcher: &mut ProjectorMatcher,
        x: Option<&PhaseView>,
        y: Option<&PhaseView>,
    ) -> (Vec<Point>, ProjectorReport) {
        let mut out = vec![bytemuck::Zeroable::zeroed(); matcher.capacity()];
        let report = matcher.run(x, y, 1, &mut out).unwrap();
        out.truncate(report.points as usize);
        (out, report)
    }

    #[test]
    fn a_plane_is_measured_to_the_resolution_of_the_phase() {
        let [camera, _, projector] = rig(300, 200);
        let surface = Surface::plane([0.2, -0.3, 1.0], 4.0);
        let scene = scene(&projector, surface);
        let maps = [Axis::X, Axis::Y].map(|axis| scene.phase_map(&camera, axis, 0.0, 0));
        let mut matcher = ProjectorMatcher::new(&camera, &projector, &ProjectorSettings::default()).unwrap();
        for y in [None, Some(maps[1].view())] {
            let (points, report) = points(&mut matcher, Some(&maps[0].view()), y.as_ref());
            assert!(
                report.points > 20_000 && report.epipolar_rms_px.is_none_or(|rms| rms < 1e-3),
                "{report:?}"
            );
            for point in &points {
                // f32 phases near 240 rad are 2e-5 px coarse, 0.06 µm per 1e-4 px here.
                assert!(surface.distance(&point.position()).abs() < 1e-4);
                assert!((point.normal_vector() - surface.normal(&point.position())).norm() < 2e-3);
                let pixel = camera.project(&point.position()).unwrap();
                assert!((pixel - pixel_of(point.pixel as usize, 300)).norm() < 1e-8, "not on its ray");
            }
        }
    }

    #[test]
    fn predicted_uncertainty_meets_the_scatter() {
        let [camera, _, projector] = rig(300, 200);
        for (normal, both) in [([0.0, 0.0, 1.0], false), ([0.5, -0.3, 1.0], false), ([0.2, 0.2, 1.0], true)] {
            let surface = Surface::plane(normal, 4.0);
            let scene = scene(&projector, surface);
            let mut matcher =
                ProjectorMatcher::new(&camera, &projector, &ProjectorSettings::default()).unwrap();
            let (mut sum, mut n) = (0.0, 0.0);
            for seed in 0..4 {
                let x = scene.phase_map(&camera, Axis::X, 0.02, 2 * seed);
                let y = scene.phase_map(&camera, Axis::Y, 0.05, 2 * seed + 1);
                let y = y.view();
                let (points, _) = points(&mut matcher, Some(&x.view()), both.then_some(&y));
                for point in &points {
                    let ratio = surface.distance(&point.position()) / f64::from(point.sigma_mm);
                    sum += ratio * ratio;
                    n += 1.0;
                }
            }
            let ratio = f64::sqrt(sum / n);
            assert!((0.98..1.02).contains(&ratio), "{ratio} for {normal:?}, both axes: {both}");
        }
    }

    #[test]
    fn a_wrong_order_in_one_axis_is_noticed() {
        let [camera, _, projector] = rig(300, 200);
        let scene = scene(&projector, Surface::plane([0.0, 0.0, 1.0], 0.0));
        let x = scene.phase_map(&camera, Axis::X, 0.01, 1);
        let mut y = scene.phase_map(&camera, Axis::Y, 0.01, 2);
        let band = 100 * 300..110 * 300;
        for phase in &mut y.phase_rad[band.clone()] {
            *phase += TAU as f32;
        }
        let wrong = y.valid[band.clone()].iter().map(|v| u32::from(*v)).sum::<u32>();
        let mut matcher = ProjectorMatcher::new(&camera, &projector, &ProjectorSettings::default()).unwrap();
        let (points, report) = points(&mut matcher, Some(&x.view()), Some(&y.view()));
        assert_eq!(report.contradicting, wrong);
        assert!(points.iter().all(|p| !band.contains(&(p.pixel as usize))));
    }

    #[test]
    fn degenerate_input_is_refused_or_empty() {
        let [camera, _, projector] = rig(30, 20);
        let scene = scene(&projector, Surface::plane([0.0, 0.0, 1.0], 0.0));
        let map = scene.phase_map(&camera, Axis::X, 0.01, 1);
        let mut matcher = ProjectorMatcher::new(&camera, &projector, &ProjectorSettings::default()).unwrap();
        let mut out: Vec<Point> = vec![bytemuck::Zeroable::zeroed(); matcher.capacity()];
        assert_eq!(matcher.run(None, None, 0, &mut out), Err(MatchError::NoPhase));
        assert!(matches!(
            matcher.run(None, Some(&map.view()), 0, &mut out),
            Err(MatchError::WrongAxis { .. })
        ));
        let small = scene.phase_map(&rig(20, 20)[0], Axis::X, 0.01, 1);
        assert!(matches!(matcher.run(Some(&small.view()), None, 0, &mut out), Err(MatchError::Size { .. })));
        let masked = crate::phase::PhaseMap::new(map.info);
        assert_eq!(matcher.run(Some(&masked.view()), None, 0, &mut out).unwrap().points, 0);
        let mut constant = map.clone();
        constant.phase_rad.fill(1e9);
        assert_eq!(
            matcher.run(Some(&constant.view()), None, 0, &mut out).unwrap().points,
            0,
            "outside its image"
        );
    }
}
