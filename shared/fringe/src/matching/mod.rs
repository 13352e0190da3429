//! Stereo matching of absolute phase maps (approach 2 of the thesis, 2.2.2): equal phase on corresponding epipolar
//! lines.
//!
//! Neither phase map is resampled. For each left pixel, whose rectified coordinates are exact:
//! 1. coarse: a monotone walk along the right row, seen through a map of nearest pixels, brackets the phase;
//! 2. uniqueness: a second place of equal phase in the right row or, searched backwards, in the left row within the
//!    disparity limits makes the match ambiguous, and it is refused;
//! 3. fine: Newton's method on the exact epipolar curve over the native right grid (see [`Interpolation`]);
//! 4. depth: both rays meet by construction, Z = b/(x_left − x_right), so the optimal correction of
//!    [`crate::triangulate`] is zero;
//! 5. support, normal and uncertainty on the left grid (see [`crate::surface`]).
//!
//! # Uncertainty
//! σ²(x_right) = (σ²_left + w σ²_right)/(∂φ_right/∂x)², w the sum of squared interpolation weights actually used; then
//! along the ray and onto the normal. It is the scatter of single points. Neighbours share right pixels: the mean over a
//! region of n points varies as (σ²_left + σ²_right)/n whatever the interpolation, 1.6 times the variance that single
//! points suggest for the quadratic (w = 0.242 in the mean).

mod axis;
#[cfg(test)]
mod figures;
mod rows;
mod subpixel;
#[cfg(test)]
mod tests;

pub use subpixel::Interpolation;

use crate::camera::{Camera, CameraError};
use crate::cloud::Point;
use crate::parallel::for_parts;
use crate::pattern::Axis;
use crate::phase::PhaseView;
use crate::rectify::{Rectification, RectifiedGrid, RectifyError, range};
use crate::surface::{Sample, SurfaceBuilder, SurfaceReport, SurfaceSettings, View};
use nalgebra::Vector3;
use rows::{Row, StepLimits};
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;
use subpixel::{Crossing, RightPhase, SETTLED_PX, solve};
use thiserror::Error;

/// Rectified rows per part of parallel work; fixed, so that no result depends on the number of threads.
const PART_ROWS: usize = 16;

/// Relative difference of two periods that are the same: they come from the same sequence.
const SAME_PERIOD: f64 = 1e-9;

/// How to match.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MatchSettings {
    /// Nearest and farthest depth along the optical axis of the left camera, mm; absent: everything in front of it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depth_mm: Option<[f64; 2]>,
    /// How the right phase is read between pixels.
    pub interpolation: Interpolation,
    /// Neighbouring pixels whose phases differ by more lie on different surfaces, projector pixels.
    pub max_step_px: f64,
    /// Steps against the sense of the phase along a row beyond this end a surface, projector pixels.
    pub max_back_step_px: f64,
    /// Two places of equal phase this close in a row are one (noise), camera pixels.
    pub left_right_tolerance_px: f64,
    /// Matches whose disparity is less certain are dropped, camera pixels.
    pub max_disparity_sigma_px: f64,
    /// What counts as a surface.
    pub surface: SurfaceSettings,
}

impl Default for MatchSettings {
    fn default() -> Self {
        Self {
            depth_mm: None,
            interpolation: Interpolation::default(),
            max_step_px: 6.0,
            max_back_step_px: 0.5,
            left_right_tolerance_px: 1.5,
            max_disparity_sigma_px: 0.5,
            surface: SurfaceSettings::default(),
        }
    }
}

/// Why a pair cannot be matched.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum MatchError {
    /// A camera with impossible numbers.
    #[error("{side} view of the pair")]
    Camera {
        /// "left" or "right".
        side: &'static str,
        /// What is wrong.
        source: CameraError,
    },
    /// The cameras do not make a pair.
    #[error("geometry of the pair")]
    Geometry(#[from] RectifyError),
    /// A setting out of its limits.
    #[error("{key} = {value} is outside its limits: {limits}")]
    Setting {
        /// Name as in the configuration.
        key: &'static str,
        /// What was given.
        value: f64,
        /// What is allowed.
        limits: &'static str,
    },
    /// A map does not belong to its camera.
    #[error(
        "the {side} phase map has {map_px:?} px, its camera {camera_px:?} px: decode frames of the calibrated size, \
         or calibrate at this one"
    )]
    Size {
        /// "left" or "right".
        side: &'static str,
        /// Columns, rows of the map.
        map_px: [u32; 2],
        /// Columns, rows of the camera.
        camera_px: [u32; 2],
    },
    /// A plane of a map is too short or too long.
    #[error(
        "the {side} phase map's plane `{plane}` has {length} values where {expected} pixels need one each"
    )]
    Plane {
        /// "left" or "right".
        side: &'static str,
        /// Name of the plane.
        plane: &'static str,
        /// Its length.
        length: usize,
        /// Number of pixels.
        expected: usize,
    },
    /// The maps tell different projector axes.
    #[error(
        "the left phase map tells projector axis {left:?}, the right one {right:?}: both must tell the same"
    )]
    Axis {
        /// Of the left map.
        left: Axis,
        /// Of the right map.
        right: Axis,
    },
    /// A map tells the other axis than the one it was given for.
    #[error("a phase map of projector axis {found:?} was given for axis {wanted:?}")]
    WrongAxis {
        /// What it was given for.
        wanted: Axis,
        /// What it tells.
        found: Axis,
    },
    /// The maps have different fringe periods.
    #[error(
        "the left phase map has a period of {left_px} projector px, the right one {right_px}: both must be decoded \
         from the same sequence"
    )]
    Period {
        /// Of the left map.
        left_px: f64,
        /// Of the right map.
        right_px: f64,
    },
    /// The caller's buffer cannot take a full image.
    #[error("room for {room} points, a full image needs {needed}")]
    Room {
        /// Length of the buffer.
        room: usize,
        /// The matcher's capacity.
        needed: usize,
    },
    /// The projector method was given no phase at all.
    #[error("neither a phase along x nor one along y was given: the projector method needs one of them")]
    NoPhase,
}

/// What became of the left pixels. All numbers count pixels; they add up to `valid`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct MatchReport {
    /// Valid left pixels that have an epipolar line in the right image.
    pub valid: u32,
    /// The right row does not show their phase: occluded, or outside the image or the depth limits.
    pub unmatched: u32,
    /// More than one place in a row shows their phase.
    pub ambiguous: u32,
    /// The backward search does not return to them.
    pub inconsistent: u32,
    /// The phase around the match is no continuous surface, or too uncertain.
    pub discontinuous: u32,
    /// Of the points, how many were read bilinearly for want of a 4 × 4 neighbourhood (before support is judged).
    pub bilinear: u32,
    /// Dropped as spikes, crumbs or steep, and points.
    pub surface: SurfaceReport,
    /// Points written: `surface.points`.
    pub points: u32,
}

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
    /// First element of each part in `order`.
    parts: Vec<usize>,
    tasks: Vec<Task>,
    /// Left phase with NaN where masked.
    left_phase: Vec<f32>,
    /// Right phase with NaN where masked.
    right_phase: Vec<f32>,
    /// In the sequence of `order`.
    hits: Vec<Sample>,
    /// On the native left grid.
    samples: Vec<Sample>,
    surface: SurfaceBuilder,
}

/// Buffers and counts of one part.
#[derive(Debug, Clone, Default)]
struct Task {
    left: Row,
    right: Row,
    report: MatchReport,
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
        let left_grid = RectifiedGrid::new(&pair.left, &directions, pair.focal_px, y0, height);
        let right_grid = RectifiedGrid::new(&pair.right, &right_table, pair.focal_px, y0, height);
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
            parts,
            tasks,
            left_phase: vec![f32::NAN; columns * rows],
            right_phase: vec![f32::NAN; right.width_px as usize * right.height_px as usize],
            hits: vec![Sample::NONE; order.len()],
            order,
            samples: vec![Sample::NONE; columns * rows],
            surface: SurfaceBuilder::new(columns, rows, settings.surface),
            directions,
            pair,
        })
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
        let mut report = self.match_rows(left, right);
        self.samples.fill(Sample::NONE);
        for (pixel, hit) in self.order.iter().zip(&self.hits) {
            self.samples[*pixel as usize] = *hit;
        }
        let view = View {
            width: self.pair.left.camera.width_px as usize,
            height: self.pair.left.camera.height_px as usize,
            directions: &self.directions,
            pitch: 1.0 / self.pair.focal_px,
            world_from_sight: self.pair.world_from_rectified,
            origin_mm: self.pair.origin_mm,
            other_mm: Vector3::new(self.pair.baseline_mm, 0.0, 0.0),
        };
        report.surface = self.surface.build(&view, &mut self.samples, pair, out);
        report.points = report.surface.points;
        Ok(report)
    }

    fn match_rows(&mut self, left: &PhaseView, right: &PhaseView) -> MatchReport {
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
                width: right.info.width_px as usize,
                height: right.info.height_px as usize,
                pitch: 1.0 / self.pair.focal_px,
                reach: self.reach,
                interpolation: self.settings.interpolation,
            },
            directions: &self.directions,
            left: *left,
            right: *right,
            limits: self.settings.step_limits(left.info.period_px),
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

    fn check(&self, left: &PhaseView, right: &PhaseView, room: usize) -> Result<(), MatchError> {
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
        if room < needed { Err(MatchError::Room { room, needed }) } else { Ok(()) }
    }
}

impl MatchSettings {
    fn check(&self) -> Result<(), MatchError> {
        if let Some((key, value, limits)) = self.surface.fault() {
            return Err(MatchError::Setting { key, value, limits });
        }
        check_depth(self.depth_mm)?;
        let positive = [
            ("max_step_px", self.max_step_px),
            ("max_back_step_px", self.max_back_step_px),
            ("left_right_tolerance_px", self.left_right_tolerance_px),
            ("max_disparity_sigma_px", self.max_disparity_sigma_px),
        ];
        match positive.iter().find(|(_, value)| !(value.is_finite() && *value > 0.0)) {
            Some((key, value)) => {
                Err(MatchError::Setting { key, value: *value, limits: "a positive number" })
            }
            None => Ok(()),
        }
    }

    fn step_limits(&self, period_px: f64) -> StepLimits {
        let rad = TAU / period_px;
        StepLimits {
            max_rad: (self.max_step_px * rad) as f32,
            back_rad: (self.max_back_step_px * rad) as f32,
        }
    }
}

impl MatchReport {
    fn add(&mut self, other: &Self) {
        self.valid += other.valid;
        self.unmatched += other.unmatched;
        self.ambiguous += other.ambiguous;
        self.inconsistent += other.inconsistent;
        self.discontinuous += other.discontinuous;
        self.bilinear += other.bilinear;
    }
}

impl Task {
    fn sized(&self, left: usize, right: usize) -> Self {
        Self { left: Row::with_capacity(left), right: Row::with_capacity(right), report: self.report }
    }
}

/// Checks the limits of the depth.
pub(crate) fn check_depth(depth_mm: Option<[f64; 2]>) -> Result<(), MatchError> {
    let Some([near, far]) = depth_mm else { return Ok(()) };
    if !(near.is_finite() && near > 0.0) {
        return Err(MatchError::Setting { key: "depth_mm[0]", value: near, limits: "a positive number" });
    }
    if !(far.is_finite() && far > near) {
        return Err(MatchError::Setting {
            key: "depth_mm[1]",
            value: far,
            limits: "larger than depth_mm[0]",
        });
    }
    Ok(())
}

/// Checks that a map has the size of its camera and complete planes.
pub(crate) fn check_map(side: &'static str, map: &PhaseView, camera: &Camera) -> Result<(), MatchError> {
    let map_px = [map.info.width_px, map.info.height_px];
    let camera_px = [camera.width_px, camera.height_px];
    if map_px != camera_px {
        return Err(MatchError::Size { side, map_px, camera_px });
    }
    let expected = map.info.len();
    let planes = [
        ("phase_rad", map.phase_rad.len()),
        ("sigma_rad", map.sigma_rad.len()),
        ("modulation", map.modulation.len()),
        ("valid", map.valid.len()),
    ];
    if let Some((plane, length)) = planes.into_iter().find(|(_, length)| *length != expected) {
        return Err(MatchError::Plane { side, plane, length, expected });
    }
    let period = map.info.period_px;
    if !(period.is_finite() && period > 0.0) {
        return Err(MatchError::Setting { key: "period_px", value: period, limits: "a positive number" });
    }
    Ok(())
}

/// Copies the phase, with NaN where the mask, the phase or its uncertainty forbids its use.
pub(crate) fn mask(map: &PhaseView, out: &mut [f32]) {
    let planes = map.phase_rad.iter().zip(map.sigma_rad).zip(map.valid);
    for (((phase, sigma), valid), out) in planes.zip(out) {
        let usable = *valid != 0 && phase.is_finite() && sigma.is_finite();
        *out = if usable { *phase } else { f32::NAN };
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

/// Why a left pixel has no point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Miss {
    Unmatched,
    Ambiguous,
    Inconsistent,
    Discontinuous,
}

/// What all parts of a run share.
struct Scan<'a> {
    pair: &'a Rectification,
    settings: &'a MatchSettings,
    left_grid: &'a RectifiedGrid,
    right_grid: &'a RectifiedGrid,
    left_phase: &'a [f32],
    right_phase: RightPhase<'a>,
    directions: &'a [[f64; 2]],
    left: PhaseView<'a>,
    right: PhaseView<'a>,
    limits: StepLimits,
}

impl Scan<'_> {
    /// Matches the left pixels of one part, row by row.
    fn part(&self, part: usize, pixels: &[u32], hits: &mut [Sample], task: &mut Task) {
        let mut current = usize::MAX;
        for (pixel, hit) in pixels.iter().zip(hits) {
            let pixel = *pixel as usize;
            *hit = Sample::NONE;
            let phase = self.left_phase[pixel];
            if phase.is_nan() {
                continue;
            }
            let row = ((self.directions[pixel][1] - self.right_grid.y0) * self.right_grid.focal_px).round()
                as usize;
            debug_assert!(row / PART_ROWS == part);
            if row != current {
                self.load(row, task);
                current = row;
            }
            task.report.valid += 1;
            match self.pixel(pixel, phase, task) {
                Ok((sample, bilinear)) => {
                    *hit = sample;
                    task.report.bilinear += u32::from(bilinear);
                }
                Err(Miss::Unmatched) => task.report.unmatched += 1,
                Err(Miss::Ambiguous) => task.report.ambiguous += 1,
                Err(Miss::Inconsistent) => task.report.inconsistent += 1,
                Err(Miss::Discontinuous) => task.report.discontinuous += 1,
            }
        }
    }

    fn load(&self, row: usize, task: &mut Task) {
        let gather = |grid: &RectifiedGrid, phase: &[f32], out: &mut Row| {
            let cells = &grid.index[row * grid.width..(row + 1) * grid.width];
            // NO_PIXEL lies beyond any image.
            out.fill(cells.iter().map(|i| phase.get(*i as usize).copied().unwrap_or(f32::NAN)), self.limits);
        };
        gather(self.right_grid, self.right_phase.phase_rad, &mut task.right);
        gather(self.left_grid, self.left_phase, &mut task.left);
    }

    fn pixel(&self, pixel: usize, phase: f32, task: &mut Task) -> Result<(Sample, bool), Miss> {
        let [x, y] = self.directions[pixel];
        let limits = self.disparity_limits(x, y);
        let allowed = |left: f64, right: f64| (limits[0]..=limits[1]).contains(&(left - right));
        let tolerance = self.settings.left_right_tolerance_px;

        let mut coarse = None;
        let mut ambiguous = false;
        task.right.find(phase, None, |column| {
            let place = self.right_grid.abscissa(column);
            if allowed(x, place) {
                ambiguous |= coarse.is_some_and(|c: f64| (c - place).abs() * self.pair.focal_px > tolerance);
                coarse = Some(place);
            }
        });
        let coarse = coarse.ok_or(Miss::Unmatched)?;

        // Backwards: the left row must show this phase here and nowhere else that the right pixel could mean.
        let own = self.left_grid.column(x);
        let mut returned = false;
        task.left.find(phase, Some(own), |column| {
            if (column - own).abs() <= tolerance {
                returned = true;
            } else {
                ambiguous |= allowed(self.left_grid.abscissa(column), coarse);
            }
        });
        if ambiguous {
            return Err(Miss::Ambiguous);
        }
        if !returned {
            return Err(Miss::Inconsistent);
        }
        self.refine(pixel, phase, coarse, limits)
    }

    fn refine(
        &self,
        pixel: usize,
        phase: f32,
        coarse: f64,
        limits: [f64; 2],
    ) -> Result<(Sample, bool), Miss> {
        let [x, y] = self.directions[pixel];
        let curve = self.pair.right.curve(y);
        let pitch = 1.0 / self.pair.focal_px;
        let Crossing { x: place, slope, variance, pixel: right, bilinear } =
            solve(&self.right_phase, &curve, phase, coarse).ok_or(Miss::Discontinuous)?;
        let sigma_left = f64::from(self.left.sigma_rad[pixel]);
        let sigma = ((sigma_left * sigma_left + variance) / (slope * slope)).sqrt();
        let certain = sigma <= self.settings.max_disparity_sigma_px * pitch;
        let disparity = x - place;
        if !certain || !(limits[0]..=limits[1]).contains(&disparity) {
            return Err(Miss::Discontinuous);
        }
        let sample = Sample {
            inverse_depth: disparity / self.pair.baseline_mm,
            sigma: (sigma / self.pair.baseline_mm) as f32,
            modulation: self.left.modulation[pixel].min(self.right.modulation[right]),
        };
        Ok((sample, bilinear))
    }

    /// Smallest and largest disparity of a left pixel in rectified units.
    fn disparity_limits(&self, x: f64, y: f64) -> [f64; 2] {
        // Z along the optical axis is this share of Z in the rectified frame.
        let m = &self.pair.left.camera_from_rectified;
        let share = m[(2, 0)] * x + m[(2, 1)] * y + m[(2, 2)];
        match self.settings.depth_mm {
            Some([near, far]) => [self.pair.baseline_mm * share / far, self.pair.baseline_mm * share / near],
            // In front of both views: positive, and not so far that one pixel of error reaches the horizon.
            None => [1.0 / self.pair.focal_px, f64::INFINITY],
        }
    }
}
