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
mod beside;
mod epipolar_rows;
mod error;
#[cfg(test)]
mod figures;
mod mask;
mod noisy_rows;
mod patch;
mod report;
mod run;
mod scan;
mod settings;
mod subpixel;
#[cfg(test)]
mod tests;

pub use error::MatchError;
pub(crate) use error::check_map;
pub(crate) use mask::mask;
pub use patch::Interpolation;
pub use report::MatchReport;
pub use settings::MatchSettings;
pub(crate) use settings::check_depth;

use crate::cloud::Point;
use crate::geometry::camera::Camera;
use crate::math::parallel::for_parts;
use crate::math::simd::best_level;
use crate::math::statistics::median;
use crate::phase::PhaseView;
use crate::rectify::{Rectification, RectifiedGrid, range};
use crate::surface::{Cause, Sample, SurfaceBuilder, View, independent_share, mark_rims, rim_is_hidden};
use epipolar_rows::{Row, StepLimits};
use fearless_simd::Level;
use nalgebra::Vector3;
use report::PART_ROWS;
use scan::{Scan, Task};
use std::f64::consts::TAU;
use subpixel::{RightPhase, SETTLED_PX};

/// Relative difference of two periods that are the same: they come from the same sequence.
const SAME_PERIOD: f64 = 1e-9;

/// Noise of the phase, projector pixels, beside which the shift two pixels from a rim does not matter.
const RIM_NOISE_PX: f64 = 0.25;

/// The median noise of a map comes from at most so many pixels.
const NOISE_SAMPLES: usize = 65_536;

/// Matches the phase maps of one pair. All tables and buffers are made once; `run` allocates nothing.
#[derive(Debug, Clone)]
pub struct Matcher {
    pair: Rectification,
    settings: MatchSettings,
    /// See [`crate::rectify::RectifiedCamera::reach`], of the right view.
    reach: f64,
    /// Rectified coordinates of the left pixels.
    directions: Vec<[f64; 2]>,
    left_grid: RectifiedGrid,
    right_grid: RectifiedGrid,
    /// Left pixels sorted by rectified row, then as they come on the native grid along the row.
    order: Vec<u32>,
    /// The other left pixels: those without a row that the right view shares.
    outside: Vec<u32>,
    /// First element of each rectified row in `order`, and of each part.
    row_starts: Vec<usize>,
    parts: Vec<usize>,
    tasks: Vec<Task>,
    /// Left phase with NaN where masked.
    left_phase: Vec<f32>,
    /// Right phase with NaN where masked.
    right_phase: Vec<f32>,
    /// Not zero where the right surface ends within `surface.edge_px`.
    right_rims: Vec<u8>,
    /// Scratch for the gaps between them.
    right_gaps: Vec<u8>,
    /// Scratch for the median noise.
    noise: Vec<f32>,
    /// In the sequence of `order`.
    hits: Vec<Sample>,
    /// On the native left grid.
    samples: Vec<Sample>,
    surface: SurfaceBuilder,
    /// Instructions that may be used.
    level: Level,
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
        let (directions, right_table) = (pair.left.table(), pair.right.table());
        let (y0, height) = common_rows(&directions, &right_table, pair.focal_px);
        let left_grid = RectifiedGrid::new(&pair.left, &directions, pair.focal_px, y0, height)?;
        let right_grid = RectifiedGrid::new(&pair.right, &right_table, pair.focal_px, y0, height)?;
        let (order, row_starts) = order(&directions, &left_grid);
        let parts: Vec<usize> =
            (0..=height.div_ceil(PART_ROWS)).map(|part| row_starts[(part * PART_ROWS).min(height)]).collect();
        let task = Task {
            left: Row::with_capacity(left_grid.width),
            right: Row::with_capacity(right_grid.width),
            report: MatchReport::default(),
        };
        // `vec![task; n]` would clone without the capacity.
        let tasks =
            (0..height.div_ceil(PART_ROWS)).map(|_| task.sized(left_grid.width, right_grid.width)).collect();
        let (columns, rows) = (left.width_px as usize, left.height_px as usize);
        Ok(Self {
            settings: *settings,
            reach: pair.right.reach(SETTLED_PX),
            left_grid,
            right_grid,
            row_starts,
            parts,
            tasks,
            left_phase: vec![f32::NAN; columns * rows],
            right_phase: vec![f32::NAN; right.width_px as usize * right.height_px as usize],
            right_rims: vec![0; right.width_px as usize * right.height_px as usize],
            right_gaps: vec![0; right.width_px as usize * right.height_px as usize],
            noise: Vec::with_capacity(NOISE_SAMPLES),
            hits: vec![Sample::NONE; order.len()],
            outside: others(&order, columns * rows),
            order,
            samples: vec![Sample::NONE; columns * rows],
            surface: SurfaceBuilder::new(columns, rows, settings.surface),
            level: best_level(),
            directions,
            pair,
        })
    }

    /// Uses no more than these instructions.
    #[cfg(test)]
    fn limit_level(&mut self, level: Level) {
        self.level = level;
        self.surface.level = level;
    }

    /// How many points `run` may write: one per left pixel.
    pub fn capacity(&self) -> usize {
        self.samples.len()
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
        mask(left, &mut self.left_phase);
        mask(right, &mut self.right_phase);
        let edge_px = self.settings.surface.edge_px as usize;
        let independent = independent_share(left, &self.left_phase, &mut self.noise).min(independent_share(
            right,
            &self.right_phase,
            &mut self.noise,
        ));
        let (limits, noise_px) = self.step_limits(left, right);
        // A rim shifts the phase two pixels away by less than noise like this hides, and hardly one that was interpolated.
        let hidden = rim_is_hidden(noise_px, RIM_NOISE_PX, independent);
        let edge = if hidden { edge_px.min(1) } else { edge_px };
        let Self { right_gaps, right_rims, .. } = self;
        mark_rims(
            (right.info.width_px as usize, &self.right_phase),
            edge,
            limits.max_rad,
            right_gaps,
            right_rims,
        );
        let mut report = self.match_rows(left, right, limits);
        for (pixel, hit) in self.order.iter().zip(&self.hits) {
            self.samples[*pixel as usize] = *hit;
            self.surface.put(*pixel as usize, hit);
        }
        for pixel in &self.outside {
            let dark = self.left_phase[*pixel as usize].is_nan();
            let none = Sample::without(if dark { Cause::Dark } else { Cause::Outside });
            self.samples[*pixel as usize] = none;
            self.surface.put(*pixel as usize, &none);
            report.outside += u32::from(!dark);
        }
        let view = View {
            width: self.pair.left.camera.width_px as usize,
            height: self.pair.left.camera.height_px as usize,
            directions: &self.directions,
            pitch: 1.0 / self.pair.focal_px,
            world_from_sight: self.pair.world_from_rectified,
            origin_mm: self.pair.origin_mm,
            other_mm: Vector3::new(self.pair.baseline_mm, 0.0, 0.0),
            independent,
            max_sigma: self.settings.max_disparity_sigma_px / (self.pair.focal_px * self.pair.baseline_mm),
        };
        report.surface = self.surface.build(&view, &mut self.samples, pair, out);
        report.points = report.surface.points;
        Ok(report)
    }

    /// What became of each left pixel in the last run.
    pub fn causes(&self) -> &[Cause] {
        self.surface.causes()
    }

    /// Limits of the steps along rows, for the median noise of both maps, and this noise, projector pixels.
    fn step_limits(&mut self, left: &PhaseView, right: &PhaseView) -> (StepLimits, f64) {
        let noise_rad = [(left, &self.left_phase), (right, &self.right_phase)].map(|(map, masked)| {
            let stride = masked.len().div_ceil(NOISE_SAMPLES).max(1);
            self.noise.clear();
            let places = (0..masked.len()).step_by(stride).filter(|i| !masked[*i].is_nan());
            self.noise.extend(places.map(|i| map.sigma_rad[i]));
            median(&mut self.noise).unwrap_or(0.0)
        });
        let (period_px, noise_rad) = (left.info.period_px, noise_rad[0].max(noise_rad[1]));
        let step_rad = self.median_step_rad();
        (self.settings.step_limits(period_px, noise_rad, step_rad), f64::from(noise_rad) * period_px / TAU)
    }

    /// Median difference of neighbours, rad: along rows and along columns, in both maps, the largest.
    fn median_step_rad(&mut self) -> f32 {
        let Self { left_phase, right_phase, noise, pair, .. } = self;
        let widths = [pair.left.camera.width_px, pair.right.camera.width_px].map(|w| w as usize);
        let mut most = 0.0_f32;
        for (phase, width) in [(&*left_phase, widths[0]), (&*right_phase, widths[1])] {
            let stride = phase.len().div_ceil(NOISE_SAMPLES).max(1);
            for next in [1, width] {
                noise.clear();
                let places = (0..phase.len().saturating_sub(next)).step_by(stride);
                noise
                    .extend(places.map(|i| (phase[i + next] - phase[i]).abs()).filter(|step| !step.is_nan()));
                most = most.max(median(noise).unwrap_or(0.0));
            }
        }
        most
    }

    fn match_rows(&mut self, left: &PhaseView, right: &PhaseView, limits: StepLimits) -> MatchReport {
        let Self { tasks, hits, parts, .. } = self;
        let scan = Scan {
            pair: &self.pair,
            settings: &self.settings,
            left_grid: &self.left_grid,
            right_grid: &self.right_grid,
            left_phase: &self.left_phase,
            right_phase: RightPhase {
                phase_rad: &self.right_phase,
                sigma_rad: right.sigma_rad,
                rims: &self.right_rims,
                width: right.info.width_px as usize,
                height: right.info.height_px as usize,
                pitch: 1.0 / self.pair.focal_px,
                reach: self.reach,
                interpolation: self.settings.interpolation,
            },
            directions: &self.directions,
            row_starts: &self.row_starts,
            level: self.level,
            left: *left,
            right: *right,
            limits,
            disparities: self
                .settings
                .depth_mm
                .map(|[near, far]| [self.pair.baseline_mm / far, self.pair.baseline_mm / near]),
        };
        let order = &self.order;
        for_parts(parts, hits, tasks, &|part, hits, task| {
            task.report = MatchReport::default();
            scan.part(part, &order[parts[part]..parts[part + 1]], hits, task);
        });
        let mut sum = MatchReport::default();
        for task in tasks.iter() {
            sum.add(&task.report);
        }
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

/// First ordinate and number of the rectified rows that both views share; no rows where they share none.
fn common_rows(left: &[[f64; 2]], right: &[[f64; 2]], focal_px: f64) -> (f64, usize) {
    let (Some(left), Some(right)) = (range(left, 1), range(right, 1)) else { return (0.0, 0) };
    let (low, high) = (left.0.max(right.0), left.1.min(right.1));
    if low > high { (0.0, 0) } else { (low, ((high - low) * focal_px).round() as usize + 1) }
}

/// Left pixels sorted by rectified row (a counting sort, so in native order along a row), and where each row begins.
fn order(directions: &[[f64; 2]], grid: &RectifiedGrid) -> (Vec<u32>, Vec<usize>) {
    let row = |y: f64| {
        let row = ((y - grid.y0) * grid.focal_px).round();
        // NaN fails the comparison.
        (row >= 0.0 && row < grid.height as f64).then_some(row as usize)
    };
    let mut starts = vec![0_usize; grid.height + 1];
    for row in directions.iter().filter_map(|d| row(d[1])) {
        starts[row + 1] += 1;
    }
    for index in 0..grid.height {
        starts[index + 1] += starts[index];
    }
    let mut next = starts.clone();
    let mut order = vec![0; starts[grid.height]];
    for (pixel, direction) in directions.iter().enumerate() {
        if let Some(row) = row(direction[1]) {
            order[next[row]] = pixel as u32;
            next[row] += 1;
        }
    }
    (order, starts)
}

/// Those of so many pixels that are not among the given ones.
fn others(pixels: &[u32], count: usize) -> Vec<u32> {
    let mut given = vec![false; count];
    for pixel in pixels {
        given[*pixel as usize] = true;
    }
    (0..count as u32).filter(|pixel| !given[*pixel as usize]).collect()
}
