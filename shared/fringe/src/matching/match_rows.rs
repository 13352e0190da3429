//! The work on one part of the rows: coarse search, uniqueness, fine solution.

// Without branches a loop vectorises.
#![allow(clippy::needless_bitwise_bool)]

use super::epipolar_rows::{Row, StepLimits};
use super::order::{Group, Order};
use super::report::{MatchReport, PART_ROWS};
use super::settings::MatchSettings;
use super::subpixel::{Crossing, MAX_SHIFT_PX, RightPhase, solve};
use super::subpixel_lanes::{Batch, Bits, Found, LANES, bits, depths_beside, set, step_beside};
use super::task::{Hit, Task};
use crate::math::simd::{vectorised, widened};
use crate::phase::PhaseView;
use crate::rectify::{Directions, Rectification, RectifiedGrid};
use crate::surface::{Cause, RIM, Sample, Samples};
use fearless_simd::{Level, Select, Simd, SimdBase, SimdFrom, SimdMask, f32x8, f64x8, mask64x8};

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
        vectorised!(self.level, |simd| self.rows(simd, part, hits, task));
    }

    #[inline(always)]
    fn rows<S: Simd>(&self, simd: S, part: usize, hits: &mut [Hit], task: &mut Task) {
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
                let batch = self.search(simd, &group, (wanted, live), &mut hits[lit].samples, task);
                self.settle(simd, &batch, (lit, hits), &mut later, &mut task.report);
                lit += 1;
            }
        }
        self.settle_later(&mut later, hits, &mut task.report);
        task.lit = lit;
    }

    /// Coarse places of a group; those that have none are noted.
    #[inline(always)]
    fn search<S: Simd>(
        &self,
        simd: S,
        group: &Group,
        (wanted, live): ([f32; LANES], [bool; LANES]),
        hits: &mut Samples,
        task: &mut Task,
    ) -> Batch {
        let [left_x, y] = group.directions(self.directions);
        let (sigmas, modulation) = (group.values(self.left.sigma_rad), group.values(self.left.modulation));
        let sigma_rad = widened(simd, f32x8::simd_from(simd, sigmas));
        let (x, row_y) = (f64x8::simd_from(simd, left_x), f64x8::simd_from(simd, y));
        let own = (x - self.left_grid.x0) * self.left_grid.focal_px;
        let limbs = group.values(self.left_limbs);
        let [least, most] = self.limits_beside(simd, [x, row_y]);
        let tolerance = self.settings.left_right_tolerance_px;
        // Where noise was averaged out of the rows, the mean phase of this place is sought, and the fine stage searches farther.
        let (sought, returned) = task.left.sought_beside(simd, &wanted, own, tolerance);
        let asked = bits(&live);
        let places = task.right.columns(simd, &sought, asked & returned);
        let coarse = places.column * self.right_grid.pitch + self.right_grid.x0;
        let disparity = x - coarse;
        let known = places.found & set(least.simd_le(disparity)) & set(disparity.simd_le(most));
        let mut batch = Batch {
            live,
            wanted,
            left_x,
            y,
            sigma_rad: sigma_rad.into(),
            modulation,
            limbs,
            limits: [least.into(), most.into()],
            coarse: coarse.into(),
            search_px: search_pxs(simd, sigma_rad, places.cells_per_rad).into(),
            ..Batch::default()
        };
        if known != asked {
            for l in (0..LANES).filter(|l| (asked & !known) >> l & 1 != 0) {
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
        task.report.valid += asked.count_ones();
        batch.x = batch.coarse;
        batch
    }

    /// One evaluation of a group. Pixels that need another one go to `later`; the general way solves those that it alone can solve.
    #[inline(always)]
    fn settle<S: Simd>(
        &self,
        simd: S,
        batch: &Batch,
        (number, hits): (usize, &mut [Hit]),
        later: &mut Later,
        report: &mut MatchReport,
    ) {
        let (found, points, samples) = self.evaluate(simd, batch, false);
        let none = hits[number].samples.cause;
        hits[number].samples = samples;
        if points == Bits::MAX {
            return;
        }
        for (l, unmatched) in none.into_iter().enumerate() {
            let holds = |bits: Bits| bits >> l & 1 != 0;
            if holds(points) {
                continue;
            }
            if !batch.live[l] {
                hits[number].samples.cause[l] = unmatched;
            } else if holds(found.settled) {
                report.count(samples.cause[l]);
            } else if holds(found.lost) {
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
        let (found, _, samples) = vectorised!(self.level, |simd| self.evaluate(simd, batch, true));
        for (l, (number, place)) in places[..*count].iter().enumerate() {
            let settled = found.settled >> l & 1 != 0;
            let sample = if settled { samples.at(l) } else { self.general(batch, l, report) };
            if settled && sample.cause != Cause::Point {
                report.count(sample.cause);
            }
            hits[*number].samples.set(*place, &sample);
        }
        *count = 0;
    }

    /// One evaluation, which pixels are points by it, and the samples of the pixels that are settled by it.
    #[inline(always)]
    fn evaluate<S: Simd>(&self, simd: S, batch: &Batch, again: bool) -> (Found, Bits, Samples) {
        let found = step_beside(simd, &self.right_phase, &self.pair.right, batch, again);
        let depths = depths_beside(simd, batch, &found, self.pair.baseline_mm, self.most_sigma());
        let mut modulation = batch.modulation;
        let (mut limbs, mut whole) = (batch.limbs, [false; LANES]);
        for l in 0..LANES {
            let pixel = found.pixel[l];
            limbs[l] |= self.right_phase.rims[pixel];
            modulation[l] = modulation[l].min(self.right.modulation[pixel]);
            whole[l] = limbs[l] & RIM == 0;
        }
        // In the order in which the general way decides, see `sample`.
        let whole = bits(&whole);
        let points = found.settled & whole & depths.certain & depths.within;
        let known = mask64x8::from_bitmask(simd, u64::from(points));
        let [depth, none] =
            [depths.inverse_depth, [f64::NAN; LANES]].map(|lanes| f64x8::simd_from(simd, lanes));
        let mut samples = Samples {
            modulation,
            inverse_depth: known.select(depth, none).into(),
            sigma: depths.sigma,
            own_share: depths.own_share,
            limbs,
            cause: [Cause::Point; LANES],
        };
        if points != Bits::MAX {
            let uncertain = whole & !depths.certain;
            for (l, cause) in samples.cause.iter_mut().enumerate() {
                *cause = match (points >> l & 1 != 0, uncertain >> l & 1 != 0) {
                    (true, _) => Cause::Point,
                    (_, true) => Cause::Uncertain,
                    _ => Cause::Discontinuous,
                };
            }
        }
        (found, points, samples)
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

    /// The same of pixels side by side.
    #[inline(always)]
    fn limits_beside<S: Simd>(&self, simd: S, [x, y]: [f64x8<S>; 2]) -> [f64x8<S>; 2] {
        let Some([least, most]) = self.disparities else {
            return [self.right_grid.pitch, f64::INFINITY].map(|limit| f64x8::simd_from(simd, limit));
        };
        let m = &self.pair.left.camera_from_rectified;
        let share = x * m[(2, 0)] + y * m[(2, 1)] + m[(2, 2)];
        [share * least, share * most]
    }
}

/// How far the fine place may be from the coarse one, px, for an uncertainty of the left phase (rad).
#[inline(always)]
fn search_px(sigma_rad: f64, cells_per_rad: f64) -> f64 {
    let noise_px = SEARCH_SIGMAS * sigma_rad * cells_per_rad;
    MAX_SHIFT_PX + if noise_px < MAX_SEARCH_PX { noise_px } else { MAX_SEARCH_PX }
}

/// The same for pixels side by side.
#[inline(always)]
fn search_pxs<S: Simd>(simd: S, sigma_rad: f64x8<S>, cells_per_rad: f64) -> f64x8<S> {
    let (noise_px, most) = (sigma_rad * SEARCH_SIGMAS * cells_per_rad, f64x8::simd_from(simd, MAX_SEARCH_PX));
    noise_px.simd_lt(most).select(noise_px, most) + MAX_SHIFT_PX
}
