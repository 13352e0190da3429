//! Micro phase shifting: the order of the first frequency from one frame of each of the others.
//!
//! Three frames of the first period give A, B and the place x_w within a period. Each order m is a candidate x = x_w + m p: it predicts the
//! further frames, A + B cos(2π x/pⱼ − δⱼ), and the order whose prediction leaves least is taken. A, B and x carry noise from three frames, so
//! the best candidates are compared after a common adjustment of the three to all frames (Gauss–Newton, one step: the
//! deviations are small). The same adjustment makes the coordinate finer than three frames do.
//!
//! The difference of the remaining squares over twice the variance of a grey value is the logarithm of the odds of two orders. What the best one
//! leaves counts as variance where it is more than noise: a projector that is not linear makes the odds worse, not wrong.

use super::DecodeError;
use crate::math::{erfc, sincos};
use crate::pattern::PatternSet;
use nalgebra::{Matrix3, Vector3};
use std::f64::consts::{SQRT_2, TAU};
use std::ops::Range;

/// Frames of the first frequency.
pub(super) const MICRO_STEPS: usize = 3;
/// Candidates that are adjusted: those that leave least before.
const ADJUSTED: usize = 4;
/// Coordinates at which the distance to other orders is sampled.
const PLACES: usize = 64;
/// Nearest other orders that are kept for each of them.
const NEAREST: usize = 8;
/// Orders whose frames differ by less than this share of the modulation cannot be told apart.
const LEAST_DISTANCE: f64 = 0.05;
/// Most further frames of a micro set.
pub(super) const MOST_FURTHER: usize = 16;

/// The further frequencies of a micro set.
#[derive(Debug, Clone, PartialEq)]
pub struct Micro {
    /// Stored raster of the first further frame.
    first: usize,
    /// Period of the fringes, projector px.
    pub(super) period_px: f64,
    /// Phase steps of its three frames, rad.
    shifts_rad: [f64; MICRO_STEPS],
    /// (period in projector px, phase step in rad) of each further frame.
    pub(super) further: Vec<(f64, f64)>,
    extent_px: f64,
    /// Cosine and sine of 2π m p/pⱼ, for all m from −1 on.
    turns: Vec<(f64, f64)>,
    /// Distances of other orders in units of the modulation, and the share of the projector that they stand for.
    distances: Vec<(f64, f64)>,
}

/// What a candidate leaves after the adjustment.
#[derive(Debug, Clone, Copy)]
pub(super) struct Adjusted {
    /// Order, one more than that of the coordinate.
    pub order: usize,
    /// What the frames leave, DN².
    pub squares_dn2: f64,
    /// What all frames add to the coordinate, px.
    pub move_px: f64,
    /// Variance of the coordinate over that of a grey value, px²/DN².
    pub variance: f64,
}

impl Micro {
    /// Prepares the set for a projector of `extent_px` pixels; its further frames are kept from raster `first` on.
    ///
    /// # Errors
    /// Periods that give two places of the projector the same grey values.
    pub fn new(set: &PatternSet, first: usize, extent_px: u32) -> Result<Self, DecodeError> {
        let PatternSet::Micro { axis, periods_px, .. } = set else {
            return Err(DecodeError::NothingToDecode);
        };
        let period_px = periods_px[0];
        let further: Vec<(f64, f64)> =
            periods_px[1..].iter().enumerate().map(|(j, p)| (*p, set.step_rad(MICRO_STEPS + j))).collect();
        let orders = (f64::from(extent_px) / period_px).ceil() as usize + 2;
        let turns = (0..orders).flat_map(|order| {
            further.iter().map(move |(p, _)| {
                let (s, c) = sincos(TAU * (order as f64 - 1.0) * period_px / p);
                (c, s)
            })
        });
        let turns = turns.collect();
        let shifts_rad = std::array::from_fn(|step| set.step_rad(step));
        let extent = f64::from(extent_px);
        let mut micro =
            Self { first, period_px, shifts_rad, further, extent_px: extent, turns, distances: Vec::new() };
        let places: Vec<Vec<(f64, f64)>> = (0..PLACES)
            .map(|place| micro.neighbours((place as f64 + 0.5) / PLACES as f64 * extent - 0.5))
            .collect();
        let mut least: Vec<(f64, f64)> = places.iter().filter_map(|near| near.first().copied()).collect();
        least.sort_by(|a, b| a.0.total_cmp(&b.0));
        if let Some((distance, apart_px)) = least.get(least.len() / 2)
            && *distance < LEAST_DISTANCE
        {
            let missing = format!(
                "the periods of the micro set show the same grey values again {apart_px:.1} px further on"
            );
            return Err(DecodeError::NoAbsoluteOrder {
                axis: *axis,
                extent_px,
                finest_px: period_px,
                missing,
            });
        }
        let all = places.into_iter().flatten();
        micro.distances = all.map(|(distance, _)| (distance, 1.0 / PLACES as f64)).collect();
        Ok(micro)
    }

    /// Rasters of the further frames.
    pub fn rasters(&self) -> Range<usize> {
        self.first..self.first + self.further.len()
    }

    fn orders(&self) -> usize {
        self.turns.len() / self.further.len()
    }

    /// Distances of the nearest other orders at a place, and how far away they are, px.
    fn neighbours(&self, place_px: f64) -> Vec<(f64, f64)> {
        let orders = 1..self.orders() as i64;
        let others = orders.flat_map(|m| [m, -m]).map(|m| place_px + m as f64 * self.period_px);
        let inside = others.filter(|x| *x > -0.5 && *x < self.extent_px - 0.5);
        let mut near: Vec<(f64, f64)> = inside
            .map(|x| {
                let level = |x: f64, (p, shift): (f64, f64)| sincos(TAU * x / p - shift).1;
                let rest: Vec<f64> =
                    self.further.iter().map(|f| level(place_px, *f) - level(x, *f)).collect();
                let left = self.adjust(0, x, 1.0, &rest).squares_dn2;
                (left.max(0.0).sqrt(), (x - place_px).abs())
            })
            .collect();
        near.sort_by(|a, b| a.0.total_cmp(&b.0));
        near.truncate(NEAREST);
        near
    }

    /// Adjusts background, modulation and coordinate to all frames, from a candidate that leaves `rest` in the further frames.
    fn adjust(&self, order: usize, x: f64, modulation_dn: f64, rest: &[f64]) -> Adjusted {
        let row = |period_px: f64, shift: f64| {
            let (s, c) = sincos(TAU * x / period_px - shift);
            Vector3::new(1.0, c, -modulation_dn * s * TAU / period_px)
        };
        let mut normal: Matrix3<f64> =
            self.shifts_rad.iter().map(|s| row(self.period_px, *s)).map(|r| r * r.transpose()).sum();
        let (mut right, mut squares) = (Vector3::zeros(), 0.0);
        for ((period_px, shift), rest) in self.further.iter().zip(rest) {
            let row = row(*period_px, *shift);
            normal += row * row.transpose();
            right += row * *rest;
            squares += rest * rest;
        }
        let Some(inverse) = normal.try_inverse() else {
            return Adjusted { order, squares_dn2: squares, move_px: 0.0, variance: f64::INFINITY };
        };
        let change = inverse * right;
        Adjusted {
            order,
            squares_dn2: squares - right.dot(&change),
            move_px: change.z,
            variance: inverse[(2, 2)],
        }
    }

    /// The best order of a pixel, and the squares that the second best leaves.
    pub(super) fn resolve(
        &self,
        x: f64,
        [background, modulation]: [f64; 2],
        values: &[f64],
    ) -> (Adjusted, f64) {
        let mut base = [(0.0, 0.0); MOST_FURTHER];
        for (base, (period_px, shift)) in base.iter_mut().zip(&self.further) {
            let (s, c) = sincos(TAU * x / period_px - shift);
            *base = (modulation * c, modulation * s);
        }
        let mut best = [(f64::INFINITY, 0_usize); ADJUSTED];
        for (order, turns) in self.turns.chunks_exact(self.further.len()).enumerate() {
            let place = x + (order as f64 - 1.0) * self.period_px;
            if place < -1.5 || place > self.extent_px + 0.5 {
                continue;
            }
            let mut left = 0.0;
            for (((c, s), base), value) in turns.iter().zip(&base).zip(values) {
                let rest = value - background - (base.0 * c - base.1 * s);
                left += rest * rest;
            }
            if left < best[ADJUSTED - 1].0 {
                best[ADJUSTED - 1] = (left, order);
                best.sort_by(|a, b| a.0.total_cmp(&b.0));
            }
        }
        let mut adjusted =
            [Adjusted { order: 1, squares_dn2: f64::INFINITY, move_px: 0.0, variance: 1.0 }; 2];
        for (_, order) in best.iter().filter(|(left, _)| left.is_finite()) {
            let turns = &self.turns[order * self.further.len()..][..self.further.len()];
            let mut rest = [0.0; MOST_FURTHER];
            for (rest, (((c, s), base), value)) in rest.iter_mut().zip(turns.iter().zip(&base).zip(values)) {
                *rest = value - background - (base.0 * c - base.1 * s);
            }
            let place = x + (*order as f64 - 1.0) * self.period_px;
            let found = self.adjust(*order, place, modulation, &rest[..self.further.len()]);
            if found.squares_dn2 < adjusted[0].squares_dn2 {
                adjusted = [found, adjusted[0]];
            } else if found.squares_dn2 < adjusted[1].squares_dn2 {
                adjusted[1] = found;
            }
        }
        (adjusted[0], adjusted[1].squares_dn2)
    }

    /// Probability of a wrong order for the phase noise that three frames have, as a bound over all other orders.
    pub fn wrong_order(&self, sigma_rad: f64) -> f64 {
        let noise = sigma_rad / (2.0 / MICRO_STEPS as f64).sqrt();
        let chance = |(distance, share): &(f64, f64)| share * 0.5 * erfc(distance / (2.0 * SQRT_2 * noise));
        self.distances.iter().map(chance).sum::<f64>().min(1.0)
    }
}
