//! The work on one part of the rows: coarse search, uniqueness, fine solution.

use super::epipolar_rows::{Row, StepLimits};
use super::report::{MatchReport, PART_ROWS};
use super::settings::MatchSettings;
use super::subpixel::{Crossing, MAX_SHIFT_PX, RightPhase, solve};
use super::subpixel_lanes::{Batch, Depths, LANES, depths_beside, step_beside};
use crate::math::simd::vectorised;
use crate::phase::PhaseView;
use crate::rectify::{Directions, Rectification, RectifiedGrid};
use crate::surface::{Cause, Sample};
use fearless_simd::Level;

/// Buffers and counts of one part.
#[derive(Debug, Clone, Default)]
pub(super) struct Task {
    pub left: Row,
    pub right: Row,
    pub report: MatchReport,
}

impl Task {
    pub fn sized(&self, left: usize, right: usize) -> Self {
        Self { left: Row::with_capacity(left), right: Row::with_capacity(right), report: self.report }
    }
}

/// Why a left pixel has no point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Miss {
    Unmatched,
    Ambiguous,
    Inconsistent,
    Discontinuous,
    Uncertain,
}

impl Miss {
    fn cause(self) -> Cause {
        match self {
            Self::Unmatched => Cause::Unmatched,
            Self::Ambiguous => Cause::Ambiguous,
            Self::Inconsistent => Cause::Inconsistent,
            Self::Discontinuous => Cause::Discontinuous,
            Self::Uncertain => Cause::Uncertain,
        }
    }
}

/// Single matches may be so many times less certain than smoothed ones must be: no smoothing mends more.
const SINGLE_SIGMAS: f64 = 6.0;

/// So many standard deviations of the left phase widen the search of the fine stage …
const SEARCH_SIGMAS: f64 = 4.0;

/// … up to this, px.
const MAX_SEARCH_PX: f64 = 12.0;

/// The place of the phase that a cell shows lies no farther from its pixel: half a cell, and half a cell more where two of them show it.
const SAME_PLACE_PX: f64 = 1.0;

/// A coarse place in the right row.
struct Coarse {
    /// Rectified coordinates of the left pixel.
    place: [f64; 2],
    /// Rectified abscissa of the pixel.
    x: f64,
    /// How far the fine place may be from it, px.
    search_px: f64,
    /// Smallest and largest disparity.
    limits: [f64; 2],
    /// Uncertainty of the left phase, rad.
    sigma_rad: f64,
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
    /// First left pixel of each rectified row, in their order.
    pub row_starts: &'a [usize],
    pub left: PhaseView<'a>,
    pub right: PhaseView<'a>,
    pub limits: StepLimits,
    /// Smallest and largest disparity of a pixel whose depth along the optical axis is that in the rectified frame.
    pub disparities: Option<[f64; 2]>,
    /// Instructions that may be used.
    pub level: Level,
}

impl Scan<'_> {
    /// Matches the left pixels of one part, row by row.
    pub fn part(&self, part: usize, pixels: &[u32], hits: &mut [Sample], task: &mut Task) {
        let (mut first, mut second) = (Batch::default(), Batch::default());
        let rows = part * PART_ROWS..((part + 1) * PART_ROWS).min(self.right_grid.height);
        let begin = self.row_starts[rows.start];
        for row in rows {
            let mut loaded = false;
            for index in self.row_starts[row] - begin..self.row_starts[row + 1] - begin {
                let pixel = pixels[index] as usize;
                let phase = self.left_phase[pixel];
                if phase.is_nan() {
                    hits[index] = Sample::NONE;
                    continue;
                }
                if !loaded {
                    self.load(row, task);
                    loaded = true;
                }
                task.report.valid += 1;
                match self.coarse((pixel, row), phase, task) {
                    Ok(found) => put(&mut first, (index, pixel, phase), &found),
                    Err(miss) => {
                        hits[index] = Sample::without(miss.cause());
                        task.report.count(miss.cause());
                    }
                }
                if first.count == LANES {
                    self.settle(&mut first, Some(&mut second), hits, &mut task.report);
                }
            }
        }
        self.settle(&mut first, Some(&mut second), hits, &mut task.report);
        self.settle(&mut second, None, hits, &mut task.report);
    }

    /// One evaluation of a batch, which is then empty. Pixels that need another one go to `next`; the general way solves those that have had
    /// two, and those that it alone can solve.
    fn settle(
        &self,
        batch: &mut Batch,
        mut next: Option<&mut Batch>,
        hits: &mut [Sample],
        report: &mut MatchReport,
    ) {
        let again = next.is_none();
        let most = self.most_sigma();
        let (found, depths) = vectorised!(self.level, {
            let found = step_beside(&self.right_phase, &self.pair.right, batch, again);
            let depths = depths_beside(batch, &found, self.pair.baseline_mm, most);
            (found, depths)
        });
        for l in 0..batch.count {
            if let Some(next) = &mut next
                && !found.lost[l]
                && !found.settled[l]
            {
                next.take(batch, l, (found.x[l], found.cell[l]));
                if next.count == LANES {
                    self.settle(next, None, hits, report);
                }
                continue;
            }
            let sample = if found.settled[l] {
                self.settled(batch.pixel[l], found.pixel[l], &depths, l)
            } else {
                let curve = self.pair.right.curve(batch.y[l]);
                let coarse = (batch.coarse[l], batch.search_px[l]);
                let crossing = solve(&self.right_phase, &curve, batch.wanted[l], coarse);
                crossing.ok_or(Miss::Discontinuous).and_then(|crossing| {
                    let sample = self.sample(batch.pixel[l], &crossing, batch.limits[l])?;
                    report.bilinear += u32::from(crossing.bilinear);
                    Ok(sample)
                })
            };
            hits[batch.hit[l]] = sample.unwrap_or_else(|miss| {
                report.count(miss.cause());
                Sample::without(miss.cause())
            });
        }
        batch.count = 0;
    }

    /// As [`Self::sample`] decides, from what was found side by side.
    #[inline(always)]
    fn settled(&self, left: usize, right: usize, depths: &Depths, l: usize) -> Result<Sample, Miss> {
        if self.right_phase.rims[right] != 0 {
            Err(Miss::Discontinuous)
        } else if !depths.certain[l] {
            Err(Miss::Uncertain)
        } else if !depths.within[l] {
            Err(Miss::Discontinuous)
        } else {
            Ok(Sample {
                inverse_depth: depths.inverse_depth[l],
                sigma: depths.sigma[l],
                own_share: depths.own_share[l],
                modulation: self.left.modulation[left].min(self.right.modulation[right]),
                cause: Cause::Point,
            })
        }
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

    /// The coarse place of a left pixel in the right row.
    #[inline(always)]
    fn coarse(&self, (pixel, row): (usize, usize), phase: f32, task: &mut Task) -> Result<Coarse, Miss> {
        let [x, y] = self.directions.at(pixel);
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
        let coarse = coarse.ok_or(Miss::Unmatched)?;

        // Backwards: the left row must show this phase here and nowhere else that the right pixel could mean. Where the row shows the very
        // pixel in a run that alone has its phase, and cells beside it at most show it too, there is nothing to search.
        let cell = (own + 0.5) as usize;
        let shown = self.left_grid.index[row * self.left_grid.width..][..self.left_grid.width].get(cell);
        let mut returned = tolerance >= SAME_PLACE_PX
            && sought == phase
            && shown.is_some_and(|shown| *shown as usize == pixel)
            && task.left.returns_to(sought, cell);
        if !returned {
            task.left.find(sought, Some(own), |column, _| {
                if (column - own).abs() <= tolerance {
                    returned = true;
                } else {
                    ambiguous |= allowed(self.left_grid.abscissa(column), coarse);
                }
            });
        }
        if ambiguous {
            return Err(Miss::Ambiguous);
        }
        if !returned {
            return Err(Miss::Inconsistent);
        }
        let sigma_rad = f64::from(self.left.sigma_rad[pixel]);
        let noise_px = SEARCH_SIGMAS * sigma_rad * cells_per_rad;
        let search_px = MAX_SHIFT_PX + if noise_px < MAX_SEARCH_PX { noise_px } else { MAX_SEARCH_PX };
        Ok(Coarse { place: [x, y], x: coarse, search_px, limits, sigma_rad })
    }

    /// The inverse depth of a left pixel from its crossing.
    fn sample(&self, pixel: usize, crossing: &Crossing, limits: [f64; 2]) -> Result<Sample, Miss> {
        let [x, _] = self.directions.at(pixel);
        let Crossing { x: place, slope, variance, pixel: right, .. } = *crossing;
        let sigma_left = f64::from(self.left.sigma_rad[pixel]);
        let (own, both) = (sigma_left * sigma_left, sigma_left * sigma_left + variance);
        let sigma = (both / (slope * slope)).sqrt();
        // A silhouette of that view: the left view may see the surface go on.
        if self.right_phase.rims[right] != 0 {
            return Err(Miss::Discontinuous);
        }
        // Smoothing decides about the rest, see [`crate::surface::View::max_sigma`].
        let certain = sigma <= self.most_sigma();
        if !certain {
            return Err(Miss::Uncertain);
        }
        let disparity = x - place;
        if !(limits[0]..=limits[1]).contains(&disparity) {
            return Err(Miss::Discontinuous);
        }
        Ok(Sample {
            inverse_depth: disparity / self.pair.baseline_mm,
            sigma: (sigma / self.pair.baseline_mm) as f32,
            own_share: if both > 0.0 { (own / both) as f32 } else { 1.0 },
            modulation: self.left.modulation[pixel].min(self.right.modulation[right]),
            cause: Cause::Point,
        })
    }

    /// Smallest and largest disparity of a left pixel in rectified units.
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

/// Adds a pixel to a batch, with what the search found.
fn put(batch: &mut Batch, (hit, pixel, phase): (usize, usize, f32), found: &Coarse) {
    let l = batch.count;
    (batch.hit[l], batch.pixel[l], batch.wanted[l]) = (hit, pixel, phase);
    (batch.coarse[l], batch.search_px[l], batch.limits[l]) = (found.x, found.search_px, found.limits);
    [batch.left_x[l], batch.y[l]] = found.place;
    (batch.x[l], batch.sigma_rad[l]) = (found.x, found.sigma_rad);
    batch.count += 1;
}
