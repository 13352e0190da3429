//! The conventional approach: one camera and a projector read backwards (thesis eq. 3.7).
//!
//! The phase gives the projector column (or row), which is a surface in space: a plane without lens distortion, curved
//! with it. The point is where the camera's ray meets that surface. The plane gives the start, then Newton's method
//! along the ray solves the exact projector model, so that nothing is linearised. With phases along both axes the
//! point is the weighted least-squares one on the ray, and their disagreement shows wrong fringe orders (an epipolar
//! check, Bräuer-Burchardt 2011).

mod rays;
mod report;
mod settings;
#[cfg(test)]
mod tests;

pub use report::ProjectorReport;
pub use settings::ProjectorSettings;

use crate::cloud::Point;
use crate::geometry::camera::Camera;
use crate::matching::{MatchError, check_map, mask};
use crate::math::parallel::for_parts;
use crate::pattern::Axis;
use crate::phase::PhaseView;
use crate::rectify::{Directions, RectifiedCamera};
use crate::sensor::Footprint;
use crate::surface::{
    Cause, Independence, OWN, Reach, Sample, Shares, SurfaceBuilder, View, WINDOWS, axis_of, independence,
    mark_limbs, mark_missing, reach_px,
};
use nalgebra::Matrix3;
use rays::{Observation, Rays};
use report::{Task, summed};
use std::f64::consts::TAU;

/// Pixels per part of parallel work; fixed, so that no result depends on the number of threads.
const PART_PIXELS: usize = 16_384;

/// Neighbouring pixels whose phases differ by more than this lie on different surfaces, projector pixels.
const MAX_STEP_PX: f64 = 6.0;

/// Intersects the rays of a camera with the columns and rows of a projector. `run` allocates nothing.
#[derive(Debug, Clone)]
pub struct ProjectorMatcher {
    camera: Camera,
    projector: Camera,
    settings: ProjectorSettings,
    /// Ideal normalised coordinates of the camera's pixels.
    directions: Directions,
    parts: Vec<usize>,
    tasks: Vec<Task>,
    phase_x: Vec<f32>,
    phase_y: Vec<f32>,
    scratch: Vec<f32>,
    /// How far a limb shifts points in the picture, px.
    reach_px: f64,
    /// Marks where the surface ends within this.
    limbs: Vec<u8>,
    /// Scratch: what is missing in the picture, and its borders.
    missing: Vec<u8>,
    borders: Vec<u8>,
    samples: Vec<Sample>,
    surface: SurfaceBuilder,
    /// What windows leave of the noise.
    shares: Shares,
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
        let focal_px = camera.mean_focal_px();
        let parts = (0..=pixels.div_ceil(PART_PIXELS)).map(|part| (part * PART_PIXELS).min(pixels)).collect();
        Ok(Self {
            directions: Directions::new(&straight, straight.table(), focal_px),
            camera: camera.clone(),
            projector: projector.clone(),
            settings: *settings,
            parts,
            tasks: vec![Task::default(); pixels.div_ceil(PART_PIXELS)],
            phase_x: vec![f32::NAN; pixels],
            phase_y: vec![f32::NAN; pixels],
            scratch: Vec::with_capacity(WINDOWS + 1),
            reach_px: reach_px(None),
            limbs: vec![0; pixels],
            missing: vec![0; pixels],
            borders: vec![0; pixels],
            samples: vec![Sample::NONE; pixels],
            surface: SurfaceBuilder::new(width, height, settings.surface),
            shares: Shares::new([0.0; 2]),
        })
    }

    /// Takes the footprint of the camera, where it is known: it says how far a limb reaches, and what taking it off the phases did to the noise.
    #[must_use]
    pub fn with_footprint(mut self, footprint: Option<Footprint>) -> Self {
        self.reach_px = reach_px(footprint);
        self.shares = Shares::new([Footprint::taken_px2(footprint), 0.0]);
        self
    }

    /// How many points `run` may write: one per pixel.
    pub fn capacity(&self) -> usize {
        self.samples.len()
    }

    /// Intersects; the first `report.points` elements of `out` are the points in the order of the pixels.
    ///
    /// # Errors
    /// No phase at all, maps that do not fit the camera or have another axis, or an `out` shorter than
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
        let Self { phase_x: masked_x, phase_y: masked_y, scratch, .. } = self;
        let independence = [(phase_x, masked_x), (phase_y, masked_y)]
            .into_iter()
            .filter_map(|(map, masked)| Some(independence(map?, masked, scratch)))
            .fold(Independence::WHOLE, Independence::worse);
        self.mark_limbs(phase_x, phase_y);
        let mut report = self.intersect(phase_x, phase_y);
        let view = View {
            width: self.camera.width_px as usize,
            height: self.camera.height_px as usize,
            directions: &self.directions,
            pitch: 1.0 / self.camera.mean_focal_px(),
            world_from_sight: self
                .camera
                .camera_from_world
                .rotation
                .inverse()
                .to_rotation_matrix()
                .into_inner(),
            origin_mm: self.camera.centre_mm(),
            two_pictures: false,
            other_mm: (self.camera.camera_from_world * self.projector.centre_mm()).coords,
            axes: [&self.camera, &self.projector].map(|view| {
                let of_camera = self.camera.camera_from_world.rotation.inverse();
                axis_of(view, (view.camera_from_world.rotation * of_camera).to_rotation_matrix().matrix())
            }),
            independence,
            shares: self.shares,
            max_sigma: f64::INFINITY,
        };
        self.surface.load(&self.samples);
        report.surface = self.surface.build(&view, pair, out);
        report.points = report.surface.points;
        Ok(report)
    }

    /// What became of each pixel in the last run.
    pub fn causes(&self) -> &[Cause] {
        self.surface.causes()
    }

    /// Marks where phases end in the picture.
    fn mark_limbs(&mut self, phase_x: Option<&PhaseView>, phase_y: Option<&PhaseView>) {
        self.limbs.fill(0);
        let Self { phase_x: masked_x, phase_y: masked_y, missing, borders, limbs, .. } = self;
        let width = self.camera.width_px as usize;
        for (map, masked) in [(phase_x, masked_x), (phase_y, masked_y)] {
            let Some(map) = map.filter(|_| self.settings.surface.edge_px > 0) else { continue };
            let max_step = (MAX_STEP_PX * TAU / map.info.period_px) as f32;
            mark_missing((width, masked), max_step, missing);
            let (seen, reach) = ((width, &masked[..], map.sigma_rad), Reach { limb: self.reach_px, rim: 0 });
            mark_limbs(seen, (reach, max_step), missing, borders, (OWN, limbs));
        }
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
        let Self { samples, tasks, parts, directions, limbs, phase_x: masked_x, phase_y: masked_y, .. } =
            self;
        for_parts(parts, samples, tasks, &|part, samples, task| {
            *task = Task::default();
            for (pixel, sample) in (parts[part]..).zip(samples) {
                *sample = Sample::NONE;
                let (x, y) = (read(phase_x, masked_x, pixel), read(phase_y, masked_y, pixel));
                let seen = [x, y].iter().flatten().all(|o| o.pixel.is_finite())
                    && directions.at(pixel)[0].is_finite();
                if seen {
                    rays.solve(directions.at(pixel), [x, y], modulation(pixel), (limbs[pixel], sample), task);
                }
            }
        });
        summed(tasks)
    }

    fn check(&self, x: Option<&PhaseView>, y: Option<&PhaseView>, capacity: usize) -> Result<(), MatchError> {
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
        if capacity < needed { Err(MatchError::BufferTooSmall { capacity, needed }) } else { Ok(()) }
    }
}
