//! The work on one part of the rows: coarse search, uniqueness, fine solution.

// Without branches a loop vectorises.
#![allow(clippy::needless_bitwise_bool)]

use super::epipolar_rows::{Row, StepLimits};
use super::order::{Group, Order};
use super::report::{MatchReport, PART_ROWS};
use super::settings::MatchSettings;
use super::subpixel::{Crossing, MAX_SHIFT_PX, RightPhase, solve};
use super::subpixel_lanes::{Batch, Found, LANES, depths_beside, step_beside};
use crate::math::simd::vectorised;
use crate::phase::PhaseView;
use crate::rectify::{Directions, Rectification, RectifiedGrid};
use crate::surface::{Cause, RIM, Sample, Samples};
use fearless_simd::Level;

/// What was found of a group.
#[derive(Debug, Clone, Copy)]
pub(super) struct Hit {
    /// Number of the group.
    pub group: usize,
    pub samples: Samples,
}

impl Hit {
    pub const NONE: Self = Self { group: 0, samples: Samples::NONE };
}

/// Buffers and counts of one part.
#[derive(Debug, Clone, Default)]
pub(super) struct Task {
    pub left: Row,
    pub right: Row,
    /// Groups of the part that have a lit pixel.
    pub lit: usize,
    pub report: MatchReport,
}

impl Task {
    /// With room for rows of these lengths.
    pub fn with_capacity(left: usize, right: usize) -> Self {
        Self { left: Row::with_capacity(left), right: Row::with_capacity(right), ..Self::default() }
    }
}

/// Single matches may be so many times less certain than smoothed ones must be: no smoothing mends more.
const SINGLE_SIGMAS: f64 = 6.0;

/// So many standard deviations of the left phase widen the search of the fine stage …
const SEARCH_SIGMAS: f64 = 4.0;

/// … up to this, px.
const MAX_SEARCH_PX: f64 = 12.0;

/// A coarse place in the right row.
struct Coarse {
    /// Rectified abscissa of the pixel.
    x: f64,
    /// How far the fine place may be from it, px.
    search_px: f64,
}

/// Pixels that wait for others that need another evaluation too.
#[derive(Default)]
struct Later {
    batch: Batch,
    count: usize,
    /// Group of each among the lit ones of the part, and place in it.
    hits: [(usize, usize); LANES],
}

/// What all parts of a run share.
pub(super) struct Scan<'a> {
    pub pair: &'a Rectification,
    pub settings: &'a MatchSettings,
    pub left_grid: &'a RectifiedGrid,
    pub right_grid: &'a RectifiedGrid,
    pub left_phase: &'a [f32],
    pub right_phase: RightPhase<'a>,
    pub directions: &'a Directions,
    /// Left pixels in the order of the rectified rows.
    pub order: &'a Order,
    pub left: PhaseView<'a>,
    /// Marks where the left surface ends within the reach of a limb.
    pub left_limbs: &'a [u8],
    pub right: PhaseView<'a>,
    pub limits: StepLimits,
    /// Smallest and largest disparity of a pixel whose depth along the optical axis is that in the rectified frame.
    pub disparities: Option<[f64; 2]>,
    /// Instructions that may be used.
    pub level: Level,
}

impl Scan<'_> {
    /// Matches the left pixels of one part, row by row; each group that has a lit pixel gives a hit.
    pub fn part(&self, part: usize, hits: &mut [Hit], task: &mut Task) {
        vectorised!(self.level, self.rows(part, hits, task));
    }

    #[inline(always)]
    fn rows(&self, part: usize, hits: &mut [Hit], task: &mut Task) {
        let mut later = Later::default();
        let mut lit = 0;
        for row in part * PART_ROWS..((part + 1) * PART_ROWS).min(self.right_grid.height) {
            let mut loaded = false;
            for number in self.order.groups(row) {
                let group = self.order.group(number);
                let wanted = group.values(self.left_phase);
                let mut live = [false; LANES];
                for l in 0..LANES {
                    live[l] = (l < group.count) & !wanted[l].is_nan();
                }
                if live == [false; LANES] {
                    continue;
                }
                if !loaded {
                    self.load(row, task);
                    loaded = true;
                }
                hits[lit] = Hit { group: number, samples: Samples::NONE };
                let batch = self.search(&group, (wanted, live), &mut hits[lit].samples, task);
                self.settle(&batch, (lit, hits), &mut later, &mut task.report);
                lit += 1;
            }
        }
        self.settle_later(&mut later, hits, &mut task.report);
        task.lit = lit;
    }

    /// Coarse places of a group; those that have none are noted.
    #[inline(always)]
    fn search(
        &self,
        group: &Group,
        (wanted, live): ([f32; LANES], [bool; LANES]),
        hits: &mut Samples,
        task: &mut Task,
    ) -> Batch {
        let [left_x, y] = group.directions(self.directions);
        let (sigmas, modulation) = (group.values(self.left.sigma_rad), group.values(self.left.modulation));
        let (mut sigma_rad, mut own) = ([0.0; LANES], [0.0; LANES]);
        for l in 0..LANES {
            sigma_rad[l] = f64::from(sigmas[l]);
            own[l] = self.left_grid.column(left_x[l]);
        }
        let limbs = group.values(self.left_limbs);
        let mut batch = Batch { live, wanted, left_x, y, sigma_rad, modulation, limbs, ..Batch::default() };
        for l in 0..LANES {
            [batch.limits[0][l], batch.limits[1][l]] = self.disparity_limits(left_x[l], y[l]);
        }
        let tolerance = self.settings.left_right_tolerance_px;
        let returned = task.left.return_beside(&wanted, &own, tolerance);
        let mut asked = [false; LANES];
        for l in 0..LANES {
            asked[l] = live[l] & returned[l];
        }
        let places = task.right.columns(&wanted, asked);
        let mut known = [false; LANES];
        for l in 0..LANES {
            let place = self.right_grid.abscissa(places.column[l]);
            let disparity = left_x[l] - place;
            known[l] =
                places.found[l] & (batch.limits[0][l] <= disparity) & (disparity <= batch.limits[1][l]);
            (batch.coarse[l], batch.search_px[l]) = (place, search_px(sigma_rad[l], places.cells_per_rad));
        }
        if known != live {
            for l in (0..LANES).filter(|l| live[*l] && !known[*l]) {
                match self.coarse(group.pixel(l), [left_x[l], y[l]], wanted[l], task) {
                    Ok(coarse) => (batch.coarse[l], batch.search_px[l]) = (coarse.x, coarse.search_px),
                    Err(cause) => {
                        batch.live[l] = false;
                        hits.cause[l] = cause;
                        task.report.count(cause);
                    }
                }
            }
        }
        task.report.valid += live.iter().map(|live| u32::from(*live)).sum::<u32>();
        batch.x = batch.coarse;
        batch
    }

    /// One evaluation of a group. Pixels that need another one go to `later`; the general way solves those that it alone can solve.
    #[inline(always)]
    fn settle(
        &self,
        batch: &Batch,
        (number, hits): (usize, &mut [Hit]),
        later: &mut Later,
        report: &mut MatchReport,
    ) {
        let (found, samples) = self.evaluate(batch, false);
        let none = hits[number].samples.cause;
        hits[number].samples = samples;
        let mut points = [false; LANES];
        for (l, point) in points.iter_mut().enumerate() {
            *point = samples.cause[l] == Cause::Point;
        }
        if points == [true; LANES] {
            return;
        }
        for l in 0..LANES {
            if points[l] {
                continue;
            }
            if !batch.live[l] {
                hits[number].samples.cause[l] = none[l];
            } else if found.settled[l] {
                report.count(samples.cause[l]);
            } else if found.lost[l] {
                hits[number].samples.set(l, &self.general(batch, l, report));
            } else {
                later.hits[later.count] = (number, l);
                later.batch.take(later.count, (batch, l), &found);
                later.count += 1;
                if later.count == LANES {
                    self.settle_later(later, hits, report);
                }
            }
        }
    }

    /// The second evaluation; the general way solves those that need more.
    #[inline(never)]
    fn settle_later(&self, later: &mut Later, hits: &mut [Hit], report: &mut MatchReport) {
        let Later { batch, count, hits: places } = later;
        for (l, live) in batch.live.iter_mut().enumerate() {
            *live = l < *count;
        }
        let (found, samples) = vectorised!(self.level, self.evaluate(batch, true));
        for (l, (number, place)) in places[..*count].iter().enumerate() {
            let sample = if found.settled[l] { samples.at(l) } else { self.general(batch, l, report) };
            if found.settled[l] && sample.cause != Cause::Point {
                report.count(sample.cause);
            }
            hits[*number].samples.set(*place, &sample);
        }
        *count = 0;
    }

    /// One evaluation, and the samples of the pixels that are settled by it.
    #[inline(always)]
    fn evaluate(&self, batch: &Batch, again: bool) -> (Found, Samples) {
        let found = step_beside(&self.right_phase, &self.pair.right, batch, again);
        let depths = depths_beside(batch, &found, self.pair.baseline_mm, self.most_sigma());
        let mut modulation = batch.modulation;
        let mut limbs = batch.limbs;
        for l in 0..LANES {
            let pixel = found.pixel[l];
            limbs[l] |= self.right_phase.rims[pixel];
            modulation[l] = modulation[l].min(self.right.modulation[pixel]);
        }
        let mut samples =
            Samples { modulation, sigma: depths.sigma, own_share: depths.own_share, limbs, ..Samples::NONE };
        for (l, marks) in limbs.into_iter().enumerate() {
            // In the order in which the general way decides, see `sample`.
            let whole = marks & RIM == 0;
            let point = found.settled[l] & whole & depths.certain[l] & depths.within[l];
            samples.inverse_depth[l] = if point { depths.inverse_depth[l] } else { f64::NAN };
            let uncertain = whole & !depths.certain[l];
            samples.cause[l] = match (point, uncertain) {
                (true, _) => Cause::Point,
                (_, true) => Cause::Uncertain,
                _ => Cause::Discontinuous,
            };
        }
        (found, samples)
    }

    /// The sample of a pixel by itself.
    #[inline(never)]
    fn general(&self, batch: &Batch, l: usize, report: &mut MatchReport) -> Sample {
        let curve = self.pair.right.curve(batch.y[l]);
        let coarse = (batch.coarse[l], batch.search_px[l]);
        let crossing = solve(&self.right_phase, &curve, batch.wanted[l], coarse);
        let sample = crossing.ok_or(Cause::Discontinuous).and_then(|crossing| {
            let sample = self.sample(batch, l, &crossing)?;
            report.bilinear += u32::from(crossing.bilinear);
            Ok(sample)
        });
        sample.unwrap_or_else(|cause| {
            report.count(cause);
            Sample::without(cause)
        })
    }

    /// Largest uncertainty of a place in the right view, rectified.
    fn most_sigma(&self) -> f64 {
        SINGLE_SIGMAS * self.settings.max_disparity_sigma_px * self.right_phase.pitch
    }

    fn load(&self, row: usize, task: &mut Task) {
        let gather = |grid: &RectifiedGrid, phase: &[f32], out: &mut Row| {
            let cells = &grid.index[row * grid.width..(row + 1) * grid.width];
            // NO_PIXEL lies beyond any image.
            let values = cells.iter().map(|i| phase.get(*i as usize).copied().unwrap_or(f32::NAN));
            out.fill(values, self.limits, self.level);
        };
        gather(self.right_grid, self.right_phase.phase_rad, &mut task.right);
        gather(self.left_grid, self.left_phase, &mut task.left);
    }

    /// The coarse place of a left pixel in the right row, wherever its phase may be shown as well.
    #[inline(never)]
    fn coarse(&self, pixel: usize, [x, y]: [f64; 2], phase: f32, task: &mut Task) -> Result<Coarse, Cause> {
        let limits = self.disparity_limits(x, y);
        let allowed = |left: f64, right: f64| (limits[0]..=limits[1]).contains(&(left - right));
        let tolerance = self.settings.left_right_tolerance_px;

        let own = self.left_grid.column(x);
        // Where noise was averaged out of the rows, the mean phase of this place is sought, and the fine stage searches farther.
        let sought = task.left.mean_at(own).unwrap_or(phase);
        let mut coarse = None;
        let mut cells_per_rad = 0.0_f64;
        let mut ambiguous = false;
        task.right.find(sought, None, |column, per_rad| {
            let place = self.right_grid.abscissa(column);
            if allowed(x, place) {
                ambiguous |= coarse.is_some_and(|c: f64| (c - place).abs() * self.pair.focal_px > tolerance);
                coarse = Some(place);
                cells_per_rad = per_rad;
            }
        });
        let coarse = coarse.ok_or(Cause::Unmatched)?;

        // Backwards: the left row must show this phase here and nowhere else that the right pixel could mean.
        let mut returned = false;
        task.left.find(sought, Some(own), |column, _| {
            if (column - own).abs() <= tolerance {
                returned = true;
            } else {
                ambiguous |= allowed(self.left_grid.abscissa(column), coarse);
            }
        });
        if ambiguous {
            return Err(Cause::Ambiguous);
        }
        if !returned {
            return Err(Cause::Inconsistent);
        }
        let search_px = search_px(f64::from(self.left.sigma_rad[pixel]), cells_per_rad);
        Ok(Coarse { x: coarse, search_px })
    }

    /// The sample of a left pixel from its crossing.
    fn sample(&self, batch: &Batch, l: usize, crossing: &Crossing) -> Result<Sample, Cause> {
        let Crossing { x: place, slope, variance, pixel: right, .. } = *crossing;
        let (own, both) =
            (batch.sigma_rad[l] * batch.sigma_rad[l], batch.sigma_rad[l] * batch.sigma_rad[l] + variance);
        let sigma = (both / (slope * slope)).sqrt();
        // A silhouette of that view: the left view may see the surface go on.
        let marks = self.right_phase.rims[right];
        if marks & RIM != 0 {
            return Err(Cause::Discontinuous);
        }
        // Smoothing decides about the rest, see [`crate::surface::View::max_sigma`].
        let certain = sigma <= self.most_sigma();
        if !certain {
            return Err(Cause::Uncertain);
        }
        let disparity = batch.left_x[l] - place;
        if !(batch.limits[0][l]..=batch.limits[1][l]).contains(&disparity) {
            return Err(Cause::Discontinuous);
        }
        Ok(Sample {
            inverse_depth: disparity / self.pair.baseline_mm,
            sigma: (sigma / self.pair.baseline_mm) as f32,
            own_share: if both > 0.0 { (own / both) as f32 } else { 1.0 },
            modulation: batch.modulation[l].min(self.right.modulation[right]),
            limbs: batch.limbs[l] | marks,
            cause: Cause::Point,
        })
    }

    /// Smallest and largest disparity of a left pixel in rectified units.
    #[inline(always)]
    fn disparity_limits(&self, x: f64, y: f64) -> [f64; 2] {
        let Some([least, most]) = self.disparities else {
            // In front of both views: positive, and not so far that one pixel of error reaches the horizon.
            return [self.right_grid.pitch, f64::INFINITY];
        };
        // Z along the optical axis is this share of Z in the rectified frame.
        let m = &self.pair.left.camera_from_rectified;
        let share = m[(2, 0)] * x + m[(2, 1)] * y + m[(2, 2)];
        [share * least, share * most]
    }
}

/// How far the fine place may be from the coarse one, px, for an uncertainty of the left phase (rad).
#[inline(always)]
fn search_px(sigma_rad: f64, cells_per_rad: f64) -> f64 {
    let noise_px = SEARCH_SIGMAS * sigma_rad * cells_per_rad;
    MAX_SHIFT_PX + if noise_px < MAX_SEARCH_PX { noise_px } else { MAX_SEARCH_PX }
}
