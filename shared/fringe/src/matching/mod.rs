//! Stereo matching of absolute phase maps (approach 2 of the thesis, 2.2.2): equal phase on corresponding epipolar
//! lines.
//!
//! Neither phase map is resampled. For each left pixel, whose rectified coordinates are exact:
//! 1. coarse: a monotone walk along the right row, seen through a map of nearest pixels, brackets the phase;
//! 2. uniqueness: a second place of equal phase in the right row or, searched backwards, in the left row within the
//!    disparity limits makes the match ambiguous, and it is refused;
//! 3. fine: Newton's method on the exact epipolar curve over the native right grid (see [`Interpolation`]);
//! 4. depth: both rays meet by construction, Z = b/(x_left − x_right), so the optimal correction of
//!    [`crate::geometry::triangulate`] is zero;
//! 5. support, normal and uncertainty on the left grid (see [`crate::surface`]).
//!
//! # Why not resampled
//! Measured on exact maps of the demo geometry, points up to 70° incidence, deviation from the true surface in µm (mean and rms
//! without noise; rms with 0.02 rad), by `figures.rs`:
//!
//! | | plane | ball 22.4 mm | ball 60 mm |
//! |---|---|---|---|
//! | quadratic (default) | 0.000, 0.007; 41.3 | 0.04, 0.32; 32.9 | 0.00, 0.03; 31.0 |
//! | cubic | 0.000, 0.008; 46.9 | 0.00, 0.01; 38.3 | 0.00, 0.01; 35.7 |
//! | bilinear | −0.006, 0.010; 44.7 | −0.46, 0.56; 36.5 | −0.19, 0.24; 34.0 |
//! | both maps resampled bilinearly, then linear | −0.015, 0.018; 32.9 | −1.34, 1.50; 26.2 | −0.49, 0.55; 24.7 |
//!
//! Resampling smooths the left map as well, which lowers the scatter of points but not the uncertainty of anything fitted to
//! them, and pays with four times the bias of curvature.
//!
//! # Uncertainty
//! σ²(x_right) = (σ²_left + w σ²_right)/(∂φ_right/∂x)², w the sum of squared interpolation weights actually used; then
//! along the ray and onto the normal. It is the scatter of single points. Neighbours share right pixels: the mean over a
//! region of n points varies as (σ²_left + σ²_right)/n whatever the interpolation, 1.6 times the variance that single
//! points suggest for the quadratic (w = 0.242 in the mean). The surface stage then smooths, see [`crate::surface`]: less
//! scatter of single points, more of it shared by neighbours.

mod axis;
mod ends;
mod epipolar_lanes;
mod epipolar_rows;
mod error;
#[cfg(test)]
mod figures;
mod map_statistics;
mod mask;
mod match_rows;
mod noisy_rows;
mod order;
mod patch;
mod patch_lanes;
mod phase_run;
mod report;
mod settings;
mod subpixel;
mod subpixel_lanes;
mod task;
#[cfg(test)]
mod tests;

pub use error::MatchError;
pub(crate) use error::check_map;
pub(crate) use mask::mask;
use mask::masked;
pub use patch::Interpolation;
pub use report::MatchReport;
pub use settings::MatchSettings;
pub(crate) use settings::check_depth;

use crate::cloud::Point;
use crate::geometry::camera::Camera;
use crate::math::parallel::for_parts;
use crate::math::simd::best_level;
use crate::phase::PhaseView;
use crate::rectify::{Directions, Rectification, RectifiedGrid};
use crate::sensor::Footprint;
use crate::surface::{Cause, Sample, Shares, SurfaceBuilder, View, WINDOWS, axis_of, rim_is_hidden};
use ends::Ends;
use epipolar_rows::StepLimits;
use fearless_simd::Level;
use map_statistics::MapStatistics;
use match_rows::Scan;
use nalgebra::Vector3;
use order::{Order, common_rows};
use std::f64::consts::TAU;
use subpixel::{RightPhase, SETTLED_PX};
use task::{Hit, Task};

/// Parts of the rows that are matched before what they found is put in the order of the pixels, which one thread does while others match the next ones.
const PARTS_AT_ONCE: usize = 8;

/// Relative difference of two periods that are the same: they come from the same sequence.
const SAME_PERIOD: f64 = 1e-9;

/// Noise of the phase, projector pixels, beside which the shift two pixels from a rim does not matter.
const RIM_NOISE_PX: f64 = 0.25;

/// Matches the phase maps of one pair. All tables and buffers are made once; `run` allocates nothing.
#[derive(Debug, Clone)]
pub struct Matcher {
    pair: Rectification,
    settings: MatchSettings,
    /// See [`crate::rectify::RectifiedCamera::reach`], of the right view.
    reach: f64,
    /// Rectified coordinates of the left pixels.
    directions: Directions,
    left_grid: RectifiedGrid,
    right_grid: RectifiedGrid,
    /// Left pixels sorted by rectified row.
    order: Order,
    /// The other left pixels: those without a row that the right view shares.
    outside: Vec<u32>,
    /// Number of the first group of pixels of each part.
    parts: Vec<usize>,
    /// Of the parts that are matched, and of those whose points are put in order meanwhile.
    tasks: [Vec<Task>; 2],
    /// Left and right phase with NaN where masked, where the maps do not have it so.
    copies: [Vec<f32>; 2],
    /// Where surfaces end in both pictures.
    ends: Ends,
    /// Scratch for the noise of both maps.
    noise: [Vec<f32>; 2],
    /// What was found of the lit groups of these parts, part by part.
    hits: [Vec<Hit>; 2],
    surface: SurfaceBuilder,
    /// What windows leave of the noise.
    shares: Shares,
    /// Instructions that may be used.
    level: Level,
}

/// The phases of both maps, with NaN where they may not be used.
#[derive(Clone, Copy)]
struct Phases<'a> {
    left: &'a [f32],
    right: &'a [f32],
}

impl Matcher {
    /// Computes all tables of a pair.
    ///
    /// # Errors
    /// Impossible cameras or settings, or a pair without epipolar geometry. Two views that share nothing are no error:
    /// they give no points.
    pub fn new(left: &Camera, right: &Camera, settings: &MatchSettings) -> Result<Self, MatchError> {
        settings.check()?;
        for (side, camera) in [("left", left), ("right", right)] {
            camera.check().map_err(|source| MatchError::Camera { side, source })?;
        }
        let pair = Rectification::new(left, right)?;
        let (left_table, right_table) = (pair.left.table(), pair.right.table());
        let (y0, height) = common_rows(&left_table, &right_table, pair.focal_px);
        // No table is kept longer than it is needed: it has 16 bytes for each pixel.
        let right_grid = RectifiedGrid::new(&pair.right, &right_table, pair.focal_px, y0, height)?;
        drop(right_table);
        let left_grid = RectifiedGrid::new(&pair.left, &left_table, pair.focal_px, y0, height)?;
        let order = Order::new(&left_table, &left_grid);
        let directions = Directions::new(&pair.left, left_table, pair.focal_px);
        let (columns, rows) = (left.width_px as usize, left.height_px as usize);
        let parts = order.parts();
        let at_once = PARTS_AT_ONCE.min(parts.len() - 1);
        let task = |_| Task::with_capacity(left_grid.width, right_grid.width);
        let tasks: Vec<Task> = (0..at_once).map(task).collect();
        let most = parts.windows(at_once + 1).map(|parts| parts[at_once] - parts[0]).max().unwrap_or(0);
        Ok(Self {
            settings: *settings,
            reach: pair.right.reach(SETTLED_PX),
            left_grid,
            right_grid,
            parts,
            tasks: [tasks.clone(), tasks],
            copies: [Vec::new(), Vec::new()],
            ends: Ends::new([left, right].map(|camera| [camera.width_px, camera.height_px])),
            noise: [(); 2].map(|()| Vec::with_capacity(WINDOWS)),
            hits: [(); 2].map(|()| vec![Hit::NONE; most]),
            outside: order.others(columns * rows),
            order,
            surface: SurfaceBuilder::new(columns, rows, settings.surface),
            shares: Shares::new([0.0; 2]),
            level: best_level(),
            directions,
            pair,
        })
    }

    /// Takes the footprints of the left and the right camera, where they are known: they say how far a limb reaches, and what taking them off the
    /// phases did to the noise.
    #[must_use]
    pub fn with_footprints(mut self, footprints: [Option<Footprint>; 2]) -> Self {
        self.ends.set_footprints(footprints);
        self.shares = Shares::new(footprints.map(Footprint::taken_px2));
        self
    }

    /// Uses no more than these instructions.
    #[cfg(test)]
    fn limit_level(&mut self, level: Level) {
        self.level = level;
        self.surface.level = level;
    }

    /// How many points `run` may write: one per left pixel.
    pub fn capacity(&self) -> usize {
        self.directions.pixels()
    }

    /// Matches two phase maps; the first `report.points` elements of `out` are the points in the order of the left
    /// pixels.
    ///
    /// # Errors
    /// Maps that do not fit their cameras or each other, or an `out` shorter than [`Self::capacity`].
    pub fn run(
        &mut self,
        left: &PhaseView,
        right: &PhaseView,
        pair: u32,
        out: &mut [Point],
    ) -> Result<MatchReport, MatchError> {
        self.check(left, right, out.len())?;
        let mut copies = std::mem::take(&mut self.copies);
        let [left_copy, right_copy] = &mut copies;
        let phases = Phases { left: masked(left, left_copy), right: masked(right, right_copy) };
        let report = self.run_masked(left, right, phases, pair, out);
        self.copies = copies;
        Ok(report)
    }

    fn run_masked(
        &mut self,
        left: &PhaseView,
        right: &PhaseView,
        phases: Phases,
        pair: u32,
        out: &mut [Point],
    ) -> MatchReport {
        let edge_px = self.settings.surface.edge_px as usize;
        let [scratch_left, scratch_right] = &mut self.noise;
        let (of_left, of_right) = rayon::join(
            || MapStatistics::of(left, phases.left, scratch_left),
            || MapStatistics::of(right, phases.right, scratch_right),
        );
        let MapStatistics { independence, noise_rad, step_rad } = of_left.worse(of_right);
        let period_px = left.info.period_px;
        let limits = self.settings.step_limits(period_px, noise_rad, step_rad);
        let noise_px = f64::from(noise_rad) * period_px / TAU;
        // A rim shifts the phase two pixels away by less than noise like this hides, and hardly one that was interpolated.
        let hidden = rim_is_hidden(noise_px, RIM_NOISE_PX, independence.interpolated);
        let edge = if hidden { edge_px.min(1) } else { edge_px };
        if edge_px == 0 {
            self.ends.clear();
        } else {
            let sigmas = [left.sigma_rad, right.sigma_rad];
            self.ends.mark(phases, sigmas, (edge, limits.max_rad), self.surface.scratch());
        }
        self.surface.clear();
        let mut report = self.match_rows(left, right, phases, limits);
        for pixel in self.outside.iter().filter(|pixel| !phases.left[**pixel as usize].is_nan()) {
            self.surface.put(*pixel as usize, &Sample::without(Cause::Outside));
            report.outside += 1;
        }
        let view = View {
            width: self.pair.left.camera.width_px as usize,
            height: self.pair.left.camera.height_px as usize,
            directions: &self.directions,
            pitch: 1.0 / self.pair.focal_px,
            world_from_sight: self.pair.world_from_rectified,
            origin_mm: self.pair.origin_mm,
            two_pictures: true,
            other_mm: Vector3::new(self.pair.baseline_mm, 0.0, 0.0),
            axes: [&self.pair.left, &self.pair.right].map(|c| axis_of(&c.camera, &c.camera_from_rectified)),
            independence,
            shares: self.shares,
            max_sigma: self.settings.max_disparity_sigma_px / (self.pair.focal_px * self.pair.baseline_mm),
        };
        report.surface = self.surface.build(&view, pair, out);
        report.points = report.surface.points;
        report
    }

    /// What became of each left pixel in the last run.
    pub fn causes(&self) -> &[Cause] {
        self.surface.causes()
    }

    /// Matches some parts of the rows at a time, so that what they found lies in a cache when it is put in the order of the pixels.
    fn match_rows(
        &mut self,
        left: &PhaseView,
        right: &PhaseView,
        phases: Phases,
        limits: StepLimits,
    ) -> MatchReport {
        let Self { tasks, hits, parts, order, surface, pair, settings, .. } = self;
        let scan = Scan {
            pair,
            settings,
            left_grid: &self.left_grid,
            right_grid: &self.right_grid,
            left_phase: phases.left,
            right_phase: RightPhase {
                phase_rad: phases.right,
                sigma_rad: right.sigma_rad,
                rims: &self.ends.right,
                width: right.info.width_px as usize,
                height: right.info.height_px as usize,
                pitch: 1.0 / pair.focal_px,
                reach: self.reach,
                interpolation: settings.interpolation,
            },
            directions: &self.directions,
            order,
            level: self.level,
            left: *left,
            left_limbs: &self.ends.left,
            right: *right,
            limits,
            disparities: settings
                .depth_mm
                .map(|[near, far]| [pair.baseline_mm / far, pair.baseline_mm / near]),
        };
        let ([mut tasks, mut others], [mut hits, mut found]) = (tasks.each_mut(), hits.each_mut());
        let mut sum = MatchReport::default();
        let mut starts = &parts[..1];
        for first in (0..parts.len() - 1).step_by(PARTS_AT_ONCE) {
            let before = (starts, others.as_slice(), found.as_slice());
            starts = &parts[first..(first + PARTS_AT_ONCE + 1).min(parts.len())];
            let (last, count) = (starts.len() - 1, starts[starts.len() - 1] - starts[0]);
            rayon::join(
                || put(order, before, surface, &mut sum),
                || {
                    for_parts(starts, &mut hits[..count], &mut tasks[..last], &|part, hits, task| {
                        task.report = MatchReport::default();
                        scan.part(first + part, hits, task);
                    });
                },
            );
            (tasks, others, hits, found) = (others, tasks, found, hits);
        }
        put(order, (starts, others, found), surface, &mut sum);
        sum
    }

    fn check(&self, left: &PhaseView, right: &PhaseView, capacity: usize) -> Result<(), MatchError> {
        check_map("left", left, &self.pair.left.camera)?;
        check_map("right", right, &self.pair.right.camera)?;
        if left.info.axis != right.info.axis {
            return Err(MatchError::Axis { left: left.info.axis, right: right.info.axis });
        }
        let (left_px, right_px) = (left.info.period_px, right.info.period_px);
        if (left_px - right_px).abs() > SAME_PERIOD * left_px {
            return Err(MatchError::Period { left_px, right_px });
        }
        let needed = self.capacity();
        if capacity < needed { Err(MatchError::BufferTooSmall { capacity, needed }) } else { Ok(()) }
    }
}

/// Puts what was found of some parts in the order of the pixels.
fn put(
    order: &Order,
    (starts, tasks, found): (&[usize], &[Task], &[Hit]),
    surface: &mut SurfaceBuilder,
    sum: &mut MatchReport,
) {
    for (start, task) in starts[..starts.len() - 1].iter().zip(tasks) {
        for hit in &found[start - starts[0]..][..task.lit] {
            order.group(hit.group).put(surface, &hit.samples);
        }
        sum.add(&task.report);
    }
}

impl MatchReport {
    fn add(&mut self, other: &Self) {
        self.valid += other.valid;
        self.unmatched += other.unmatched;
        self.ambiguous += other.ambiguous;
        self.inconsistent += other.inconsistent;
        self.discontinuous += other.discontinuous;
        self.uncertain += other.uncertain;
        self.bilinear += other.bilinear;
    }
}
