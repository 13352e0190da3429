//! A code without sines, finer than its stripes: the edges between stripes are located between pixels, and the coordinate is
//! interpolated between them.
//!
//! Where two neighbouring pixels stand in neighbouring stripes, one bit differs, and its frame less its reference (the inverted frame, or
//! the mean of white and black) passes zero between them: there the coordinate is that of the edge, exactly. Between pixels
//! the zero is found on a straight line. A plane through the edges around a pixel, read at the pixel, is its coordinate.
//!
//! The stripe of a pixel is an interval, not a measurement with noise: it decides which edges belong to the pixel, and a plane that
//! leaves it by more than a quarter of a stripe is refused. Uncertain bits make the interval longer: such pixels need edges that
//! confirm what they show. Their own edges count: noise turns the bit whose edge is near, and other bits not by one stripe. The uncertainty comes from the scatter of the edges about the planes.

use super::block::{CHUNK, state};
use super::coarse::MOST_STRIPES_APART;
use super::edge_sag::Planes;
use super::rasters::Rasters;
use super::roles::{CodePlan, Reference};
use crate::math::statistics::median;
use crate::pattern::Code;
use crate::phase::PhaseViewMut;
use rayon::prelude::*;
use std::f64::consts::TAU;

/// Half widths of the windows in which edges are sought, px: the first with enough of them is used.
const WINDOWS: [usize; 5] = [2, 3, 5, 8, 12];
/// Fewest edges of a plane: twice its unknowns.
const LEAST_EDGES: f64 = 6.0;
/// A plane may leave the stripe of its pixel by this share of a stripe …
const BEYOND: f64 = 0.25;
/// … and by so many standard deviations of an edge …
const NOISE_SIGMAS: f64 = 3.0;
/// … up to one stripe.
const MOST_BEYOND: f64 = 1.0;
/// Edges farther from the plane than this share of a stripe do not belong to it.
const OUTLIER: f64 = 0.5;
/// Coordinates of edges are whole stripes apart: a smaller sum of squares about their mean is that of one line of edges.
const ONE_LINE: f64 = 0.5;
/// Edges from dark to light and from light to dark are displaced against each other (white and black do not mark the middle exactly): a plane
/// needs both kinds on either side, as three lines of edges have, two stripes apart. Two lines do where there are no more.
pub(super) const THREE_LINES: f32 = 2.0;
/// Steps per pixel beyond so many times the median are another surface.
const STEP_RATIO: f64 = 3.0;
/// The scatter of one plane counts as so many edges of the common one.
const COMMON_EDGES: f64 = 6.0;
/// The median step and the median scatter come from at most so many pixels.
const SAMPLES: usize = 16_384;

/// Buffers of the edge search, allocated once.
#[derive(Debug)]
pub struct Edges {
    width: usize,
    /// Place of an edge between a pixel and its right neighbour, 0 to 1 px; NaN without one.
    right: Vec<f32>,
    /// The same towards the neighbour below.
    down: Vec<f32>,
    planes: Vec<Plane>,
    scratch: Vec<f64>,
}

/// The plane of a pixel.
#[derive(Debug, Clone, Copy)]
pub(super) struct Plane {
    /// Coordinate less that of the stripe's centre, stripes; NaN without a plane.
    pub offset: f32,
    /// Standard deviation of the offset over that of an edge.
    pub factor: f32,
    /// Σ of squared residuals, stripes².
    pub squares: f32,
    /// Edges less the three unknowns.
    pub freedom: f32,
    /// Coordinates of the edges from the first to the last, stripes.
    pub span: f32,
    /// Mean squares of the edges' distances along rows and columns as the plane weighs them, px².
    pub mean_squares: [f32; 2],
    /// Half width of its window, px.
    pub half: u8,
}

const NO_PLANE: Plane = Plane {
    offset: f32::NAN,
    factor: f32::NAN,
    squares: 0.0,
    freedom: 0.0,
    span: 0.0,
    mean_squares: [0.0; 2],
    half: 0,
};

/// The code as it was decoded.
struct Numbers<'a> {
    rasters: &'a Rasters,
    code: &'a CodePlan,
    width: usize,
    /// Stripe centres as phase, 2π per stripe.
    phase_rad: &'a [f32],
    valid: &'a [u8],
    /// Phase of the centre of stripe 0.
    first_rad: f64,
}

impl Edges {
    /// Allocates the buffers for one image.
    pub fn new(width: usize, pixels: usize) -> Self {
        Self {
            width,
            right: vec![f32::NAN; pixels],
            down: vec![f32::NAN; pixels],
            planes: vec![NO_PLANE; pixels],
            scratch: Vec::with_capacity(SAMPLES + 1),
        }
    }

    /// Replaces the centres of stripes in `out` by interpolated coordinates where there are edges; pixels whose stripe the edges
    /// around them contradict are masked. Returns how many.
    pub fn interpolate(&mut self, rasters: &Rasters, code: &CodePlan, out: &mut PhaseViewMut) -> usize {
        let stripe_px = code.stripe_px;
        let numbers = Numbers {
            rasters,
            code,
            width: self.width,
            phase_rad: out.phase_rad,
            valid: out.valid,
            first_rad: TAU * (0.5 * stripe_px - 0.5) / stripe_px,
        };
        let width = self.width;
        let rows = self.right.par_chunks_mut(width).zip(self.down.par_chunks_mut(width)).enumerate();
        rows.for_each(|(row, (right, down))| {
            for (column, (right, down)) in right.iter_mut().zip(down).enumerate() {
                let pixel = row * width + column;
                *right = if column + 1 < width { numbers.edge(pixel, pixel + 1) } else { f32::NAN };
                *down = numbers.edge(pixel, pixel + width);
            }
        });
        let most_step = STEP_RATIO * numbers.median_step(&mut self.scratch).max(1.0 / STEP_RATIO);
        let (right, down) = (&self.right, &self.down);
        self.planes.par_chunks_mut(width).enumerate().for_each(|(row, planes)| {
            for (column, plane) in planes.iter_mut().enumerate() {
                *plane = numbers.plane(right, down, (column, row), most_step).unwrap_or(NO_PLANE);
            }
        });
        let curved = Planes { width, all: &self.planes, phase_rad: numbers.phase_rad, most_step };
        // The places of the edges are not needed any more.
        curved.sags(&mut self.right, &mut self.down);
        let common = self.common_variance();
        let sags = self.right.par_chunks(CHUNK).zip(self.down.par_chunks(CHUNK));
        let planes = self.planes.par_chunks(CHUNK).zip(sags).zip(out.phase_rad.par_chunks_mut(CHUNK));
        let planes = planes.zip(out.sigma_rad.par_chunks_mut(CHUNK)).zip(out.valid.par_chunks_mut(CHUNK));
        planes
            .map(|((((planes, (added, growth)), phase), sigma), valid)| {
                let mut masked = 0;
                for (i, plane) in planes.iter().enumerate() {
                    if valid[i] == state::INVALID {
                        continue;
                    }
                    let open = valid[i] == state::OPEN;
                    valid[i] = state::SURE;
                    if plane.offset.is_nan() && !open {
                        continue;
                    }
                    let squares = f64::from(plane.squares) + COMMON_EDGES * common;
                    let variance = squares / (f64::from(plane.freedom) + COMMON_EDGES);
                    // The bits of a pixel near an edge turn with the noise of that edge.
                    let noise = NOISE_SIGMAS * variance.sqrt();
                    let beyond =
                        if open { f64::from(MOST_STRIPES_APART) } else { noise.clamp(BEYOND, MOST_BEYOND) };
                    let within = f64::from(plane.offset.abs()) <= 0.5 + beyond;
                    if within {
                        phase[i] += (TAU * f64::from(plane.offset + added[i])) as f32;
                        sigma[i] = (TAU * f64::from(plane.factor * growth[i]) * variance.sqrt()) as f32;
                    } else {
                        (phase[i], sigma[i], valid[i]) = (f32::NAN, f32::NAN, state::INVALID);
                        masked += 1;
                    }
                }
                masked
            })
            .sum()
    }

    /// Median over the planes of the variance of an edge, stripes².
    fn common_variance(&mut self) -> f64 {
        let stride = self.planes.len().div_ceil(SAMPLES).max(1);
        self.scratch.clear();
        let usable = self.planes.iter().step_by(stride).filter(|p| p.freedom > 2.0);
        self.scratch.extend(usable.map(|p| f64::from(p.squares / p.freedom)));
        median(&mut self.scratch).unwrap_or(0.0)
    }
}

impl Numbers<'_> {
    fn stripe(&self, pixel: usize) -> Option<i64> {
        let valid = self.valid.get(pixel).is_some_and(|valid| *valid != state::INVALID);
        valid.then(|| ((f64::from(self.phase_rad[pixel]) - self.first_rad) / TAU).round() as i64)
    }

    /// Where the edge lies between two neighbouring pixels in neighbouring stripes.
    fn edge(&self, one: usize, other: usize) -> f32 {
        let (Some(a), Some(b)) = (self.stripe(one), self.stripe(other)) else { return f32::NAN };
        if (a - b).abs() != 1 {
            return f32::NAN;
        }
        let word = |number: i64| match self.code.code {
            Code::Binary => number,
            Code::Gray => number ^ (number >> 1),
        };
        // Of the bits that differ, all edges lie at the same place; the finest has the steepest one.
        let differ = word(a) ^ word(b);
        let bit = self.code.bits - 1 - (differ.trailing_zeros() as usize).min(self.code.bits - 1);
        let (from, to) = (self.contrast(bit, one), self.contrast(bit, other));
        let place = from / (from - to);
        if (0.0..=1.0).contains(&place) { place } else { f32::NAN }
    }

    /// Twice a frame less its reference.
    fn contrast(&self, bit: usize, pixel: usize) -> f32 {
        let raster = self.code.first + bit;
        let pair = |one, other| {
            let (a, b) = self.rasters.pair(one, other, pixel);
            (f32::from(a), f32::from(b))
        };
        match self.code.reference {
            Reference::Complement(first) => {
                let (value, inverse) = pair(raster, first + bit);
                value - inverse
            }
            Reference::WhiteBlack(white, black) => {
                let ((value, _), (white, black)) = (pair(raster, white), pair(white, black));
                2.0 * value - white - black
            }
            Reference::SineMean(_) => f32::NAN,
        }
    }

    /// Median step of the stripe number over four pixels along rows and columns, stripes per pixel: of both the larger one.
    fn median_step(&self, scratch: &mut Vec<f64>) -> f64 {
        let stride = self.valid.len().div_ceil(SAMPLES).max(1);
        let mut most = 0.0_f64;
        for step in [4, 4 * self.width] {
            scratch.clear();
            for pixel in (0..self.valid.len().saturating_sub(step)).step_by(stride) {
                if let (Some(a), Some(b)) = (self.stripe(pixel), self.stripe(pixel + step)) {
                    scratch.push((a - b).abs() as f64 / 4.0);
                }
            }
            most = most.max(median(scratch).unwrap_or(0.0));
        }
        most
    }

    /// The plane through the edges around a pixel, in stripes from the centre of its stripe.
    fn plane(&self, right: &[f32], down: &[f32], at: (usize, usize), most_step: f64) -> Option<Plane> {
        let own = self.stripe(at.1 * self.width + at.0)?;
        let mut two_lines = None;
        for half in WINDOWS {
            let window = Window { numbers: self, right, down, at, half, own, most_step };
            let fit = window.fit(None).and_then(|first| window.fit(Some(first.1)));
            match fit {
                Some((plane, _)) if plane.span >= THREE_LINES => return Some(plane),
                Some((plane, _)) => two_lines = two_lines.or(Some(plane)),
                None => {}
            }
        }
        two_lines
    }
}

/// The edges around a pixel.
struct Window<'a> {
    numbers: &'a Numbers<'a>,
    right: &'a [f32],
    down: &'a [f32],
    at: (usize, usize),
    half: usize,
    own: i64,
    most_step: f64,
}

impl Window<'_> {
    /// Calls `take(u, v, x)` with the place of each edge, px from the pixel, and its coordinate, stripes from the stripe's centre.
    fn edges(&self, mut take: impl FnMut(f64, f64, f64)) {
        let (width, height) = (self.numbers.width, self.numbers.valid.len() / self.numbers.width);
        let (column, row) = self.at;
        for line in row.saturating_sub(self.half)..(row + self.half + 1).min(height) {
            for place in column.saturating_sub(self.half)..(column + self.half + 1).min(width) {
                let pixel = line * width + place;
                let (across, along) = (self.right[pixel], self.down[pixel]);
                if across.is_nan() && along.is_nan() {
                    continue;
                }
                let Some(number) = self.numbers.stripe(pixel) else { continue };
                let (u, v) = (place as f64 - column as f64, line as f64 - row as f64);
                let mut offer = |next: usize, u: f64, v: f64| {
                    let Some(other) = self.numbers.stripe(next) else { return };
                    let x = 0.5 * (number + other) as f64 - self.own as f64;
                    let distance = u.abs().max(v.abs()).max(1.0);
                    if x.abs() <= self.most_step * distance + 1.0 {
                        take(u, v, x);
                    }
                };
                if !across.is_nan() {
                    offer(pixel + 1, u + f64::from(across), v);
                }
                if !along.is_nan() {
                    offer(pixel + width, u, v + f64::from(along));
                }
            }
        }
    }

    /// Least squares over the edges, or over those near a first plane; also the plane's coefficients.
    fn fit(&self, near: Option<[f64; 3]>) -> Option<(Plane, [f64; 3])> {
        let (mut n, mut su, mut sv, mut suu, mut suv, mut svv) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
        let (mut sx, mut sux, mut svx, mut sxx) = (0.0, 0.0, 0.0, 0.0);
        let (mut suuu, mut suuv, mut suvv, mut svvv) = (0.0, 0.0, 0.0, 0.0);
        let (mut least, mut most) = (f64::INFINITY, f64::NEG_INFINITY);
        self.edges(|u, v, x| {
            if near.is_some_and(|[a, b, c]| (x - a - b * u - c * v).abs() > OUTLIER) {
                return;
            }
            n += 1.0;
            su += u;
            sv += v;
            suu += u * u;
            suv += u * v;
            svv += v * v;
            suuu += u * u * u;
            suuv += u * u * v;
            suvv += u * v * v;
            svvv += v * v * v;
            sx += x;
            sux += u * x;
            svx += v * x;
            sxx += x * x;
            least = least.min(x);
            most = most.max(x);
        });
        if n < LEAST_EDGES {
            return None;
        }
        let (mu, mv) = (su / n, sv / n);
        let (cuu, cuv, cvv) = (suu - su * mu, suv - su * mv, svv - sv * mv);
        let (cux, cvx) = (sux - su * sx / n, svx - sv * sx / n);
        let determinant = cuu * cvv - cuv * cuv;
        // Edges in a line, or all between the same two stripes, leave the slope across them open.
        if determinant < 0.02 * n * n || sxx - sx * sx / n < ONE_LINE {
            return None;
        }
        let b = (cvv * cux - cuv * cvx) / determinant;
        let c = (cuu * cvx - cuv * cux) / determinant;
        let a = sx / n - b * mu - c * mv;
        // What the plane reads at the pixel of u² and v² instead of nothing.
        let of_square = |sum: f64, with_u: f64, with_v: f64| {
            let (cu, cv) = (with_u - mu * sum, with_v - mv * sum);
            let (b, c) = ((cvv * cu - cuv * cv) / determinant, (cuu * cv - cuv * cu) / determinant);
            (sum / n - b * mu - c * mv) as f32
        };
        let squares = (sxx - sx * sx / n - b * cux - c * cvx).max(0.0);
        let factor = (1.0 / n + (cvv * mu * mu - 2.0 * cuv * mu * mv + cuu * mv * mv) / determinant).sqrt();
        let plane = Plane {
            offset: a as f32,
            factor: factor as f32,
            squares: squares as f32,
            freedom: (n - 3.0) as f32,
            span: (most - least) as f32,
            mean_squares: [of_square(suu, suuu, suuv), of_square(svv, suvv, svvv)],
            half: self.half as u8,
        };
        Some((plane, [a, b, c]))
    }
}
