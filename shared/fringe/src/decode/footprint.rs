//! The pixel's footprint: what it does to the phase, how large it is, and how its bias is removed.
//!
//! A pixel does not see a point. Its light, and so its phasor R e^{iφ}, is an average over the pixel's area and the lens
//! blur, a weight w of variance s² per axis: Z = w ∗ R e^{iφ}. To second order in s
//!
//! ```text
//! arg Z = φ + s² (½ ∇²φ + ∇ln R · ∇φ),      |Z| = R (1 − ½ s² |∇φ|²) + ½ s² ∇²R
//! ```
//!
//! With the modulation as it is seen, |Z| in place of R, fine fringes leave a part of fourth order, of which the largest is
//! ½ s⁴ ∇φᵀ H ∇φ, H the second derivatives of φ: from ln |Z|, whose gradient has −s² H ∇φ, the formula takes twice of what a Gaussian
//! does to a curved phase. Beside ½ s² ∇²φ it is s² |∇φ|²: for s² = 0.25 px² 4 % where a fringe is 16 px wide in the picture, 15 % where it is 8.
//!
//! The first states that curvature and shading shift the phase; a sphere measured by two cameras comes out too large by
//! some s² times the square of the pixel's size over its radius, 5 to 12 µm at 0.2 mm per pixel. The second states how to
//! find s² without knowing the lens: steep fringes lose modulation. The difference of white and black is R with the
//! same ½ s² ∇²R, so over the image
//!
//! ```text
//! ln (B / (white − black)) = constant − ½ s² |∇φ|²
//! ```
//!
//! is a straight line against |∇φ|². The constant holds the projector's contrast and blur, which do not depend on the
//! camera. The estimate is joined with what is known of lenses, by inverse variance. Without white and black, and of parts too small for a
//! line, only what is known of lenses counts. Where the surface is all of one slope there is no line either, but nothing to correct.
//!
//! Derivatives of the phase are those of a least-squares quadratic over 5 × 5 pixels, all of them valid and smooth (`survey`).

use super::block::CHUNK;
use super::contrast_bins::{BINS, Bins, GROUPS, ROWS, Reflectance, Sums};
use super::survey::{Bias, Survey};
use super::{Bounced, DecodeError, Decoder, FootprintTest};
use crate::math::ln;
use crate::math::simd::{loaded, put, vectorised};
use crate::phase::PhaseViewMut;
use crate::sensor::{MEAN_FIELD, USUAL_LENS_PX2, USUAL_LENS_U_PX2};
use fearless_simd::{Level, Select, Simd, SimdBase, SimdFloat};
use rayon::prelude::*;

/// Weight of the middle pixel in the Laplacian, and the sum of all squared weights.
const LAPLACIAN_MIDDLE: f64 = -8.0 / 70.0;
const LAPLACIAN_POWER: f64 = 8.0 / 70.0;
/// Fewer pixels in a group of a bin say nothing.
const LEAST_IN_GROUP: u32 = 20;
/// A variance below this, px², moves no phase that could be measured.
const LEAST_PX2: f64 = 0.005;
/// Beyond this the expansion does not hold and the image is out of focus; settings take no larger one either.
const MOST_PX2: f64 = 1.0;

/// Values of the widest vectors.
const WIDEST: usize = 16;
/// The places of their values.
const PLACES: [f32; WIDEST] =
    [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0, 15.0];

/// Memory of the estimate and the correction, reserved once.
#[derive(Debug)]
pub struct Footprint {
    width: usize,
    /// The bias over s² for a small s², rad/px²; NaN where the neighbourhood is not smooth.
    bias: Vec<f32>,
    /// What is added to it with another s², rad/px⁴; says nothing where it is NaN.
    pub(super) fourth: Vec<f32>,
    jobs: Vec<Bins>,
}

/// What the line of the contrast against the slope says of the footprint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Line {
    /// Variance of the footprint; noise may make it negative, px².
    pub variance_px2: f64,
    /// Its standard uncertainty, px².
    pub u_px2: f64,
}

impl Line {
    /// Joined with what is known of lenses, px².
    pub fn joined_px2(self) -> f64 {
        let (measured, known) =
            (1.0 / (self.u_px2 * self.u_px2), 1.0 / (USUAL_LENS_U_PX2 * USUAL_LENS_U_PX2));
        let variance_px2 = (measured * self.variance_px2 + known * USUAL_LENS_PX2) / (measured + known);
        variance_px2.min(MOST_PX2)
    }
}

/// What the slopes of a surveyed map say of the footprint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Slopes {
    /// The line, where white and black and enough slopes give one.
    pub line: Option<Line>,
    /// Whether there is none since most pixels have one slope: then the footprint moves none of them.
    pub are_alike: bool,
}

/// What was removed of the footprint.
pub(super) struct Removed {
    /// Its standard deviation, px; `None` where nothing was.
    pub sigma_px: Option<f64>,
    /// Whether that is only what is known of lenses.
    pub assumed: bool,
    /// Light from other faces, which was looked for before.
    pub bounced: Bounced,
    /// What is left, as in [`super::DecodeReport::footprint_left_px2`].
    pub left_px2: Option<f64>,
    /// What the frames say of it.
    pub test: Option<FootprintTest>,
}

/// A point of the line.
#[derive(Debug, Clone, Copy)]
struct Place {
    slope2: f64,
    log_contrast: f64,
    weight: f64,
}

impl Footprint {
    /// Allocates the buffers for images of one size.
    pub fn new(width: usize, pixels: usize) -> Self {
        let jobs = (pixels / width.max(1)).div_ceil(ROWS);
        let empty = [[Sums::default(); GROUPS]; BINS];
        Self { width, bias: vec![f32::NAN; pixels], fourth: vec![0.0; pixels], jobs: vec![empty; jobs] }
    }

    /// Memory for a number of each pixel, until the next survey.
    pub fn scratch(&mut self) -> &mut [i16] {
        let pixels = self.bias.len();
        &mut bytemuck::cast_slice_mut(&mut self.bias)[..pixels]
    }

    /// Derivatives of the whole map, and what they say of the variance s² of the footprint.
    pub fn survey(
        &mut self,
        map: &PhaseViewMut,
        reflectance: Option<Reflectance>,
        shape: [f32; 2],
        level: Level,
    ) -> Slopes {
        let width = self.width;
        let survey = Survey { map, reflectance: reflectance.as_ref(), shape, width };
        let parts = self.bias.par_chunks_mut(ROWS * width).zip(self.fourth.par_chunks_mut(ROWS * width));
        parts.zip(&mut self.jobs).enumerate().for_each(|(chunk, ((second, fourth), bins))| {
            *bins = [[Sums::default(); GROUPS]; BINS];
            second.fill(f32::NAN);
            let mut bias = Bias { second, fourth };
            vectorised!(level, |simd| survey.rows(simd, chunk * ROWS, &mut bias, bins));
        });
        if reflectance.is_some() { self.contrast() } else { Slopes { line: None, are_alike: false } }
    }

    fn contrast(&self) -> Slopes {
        let mut total = [[Sums::default(); GROUPS]; BINS];
        for job in &self.jobs {
            for (sum, part) in total.as_flattened_mut().iter_mut().zip(job.as_flattened()) {
                sum.join(part);
            }
        }
        let mut places = [Place { slope2: 0.0, log_contrast: 0.0, weight: 0.0 }; BINS];
        let mut count = 0;
        let (mut in_places, mut in_all) = (0, 0);
        for groups in &total {
            let pixels: u64 = groups.iter().map(|group| u64::from(group.count)).sum();
            in_all += pixels;
            if let Some(place) = place(groups) {
                places[count] = place;
                count += 1;
                in_places += pixels;
            }
        }
        let line = line(&places[..count])
            .map(|(slope, u_slope)| Line { variance_px2: -2.0 * slope, u_px2: 2.0 * u_slope });
        Slopes { line, are_alike: line.is_none() && 2 * in_places > in_all }
    }

    /// Of each pixel of the map surveyed last: finite where its neighbourhood is one smooth surface.
    pub fn smooth(&self) -> &[f32] {
        &self.bias
    }

    /// Removes the bias of a footprint from the phase; its noise grows by some per cent, which the uncertainty contains.
    /// Pixels without a smooth neighbourhood stay as they are. The map must be the one surveyed last. `field_px2`: growth of the
    /// variance from the middle of the picture to its corner.
    pub fn correct(&self, variance_px2: f64, field_px2: f64, map: &mut PhaseViewMut, level: Level) {
        let half = 0.5 * variance_px2;
        let growth = (1.0 - 2.0 * half * LAPLACIAN_MIDDLE + half * half * LAPLACIAN_POWER).sqrt() as f32;
        let (width, height) = (self.width, self.bias.len() / self.width);
        let over = Field::new([width, height], variance_px2, field_px2);
        let rows = CHUNK.div_ceil(width);
        let part = rows * width;
        let planes = map.phase_rad.par_chunks_mut(part).zip(map.sigma_rad.par_chunks_mut(part));
        let bias = self.bias.par_chunks(part).zip(self.fourth.par_chunks(part));
        planes.zip(bias).enumerate().for_each(|(number, ((phase, sigma), (second, fourth)))| {
            let lines = phase.chunks_mut(width).zip(sigma.chunks_mut(width));
            let bias = second.chunks(width).zip(fourth.chunks(width));
            for (row, ((phase, sigma), bias)) in lines.zip(bias).enumerate() {
                let at_row = over.row(number * rows + row);
                vectorised!(level, |simd| unbias(simd, (phase, sigma), bias, (&over, at_row), growth));
            }
        });
    }
}

/// The variance of the footprint over the picture, px².
struct Field {
    /// Column and row of the middle of the picture.
    middle: [f32; 2],
    /// Variance in the middle, px².
    in_the_middle: f32,
    /// Growth per squared pixel from the middle.
    growth: f32,
}

impl Field {
    fn new(size: [usize; 2], mean_px2: f64, field_px2: f64) -> Self {
        let middle = size.map(|length| 0.5 * (length as f64 - 1.0));
        let corner2 = (middle[0] * middle[0] + middle[1] * middle[1]).max(1.0);
        Self {
            middle: middle.map(|at| at as f32),
            in_the_middle: (mean_px2 - MEAN_FIELD * field_px2) as f32,
            growth: (field_px2 / corner2) as f32,
        }
    }

    /// Variance in the middle of a row.
    fn row(&self, row: usize) -> f32 {
        let off = row as f32 - self.middle[1];
        self.in_the_middle + self.growth * (off * off)
    }
}

#[inline(always)]
fn unbias<S: Simd>(
    simd: S,
    (phase_rad, sigma_rad): (&mut [f32], &mut [f32]),
    bias: (&[f32], &[f32]),
    (over, at_row): (&Field, f32),
    growth: f32,
) {
    let count = phase_rad.len();
    let whole = count - count % S::f32s::LEN;
    for first in (0..whole).step_by(S::f32s::LEN) {
        unbias_vector(simd, (phase_rad, sigma_rad), bias, [first; 2], (over, at_row), growth);
    }
    // What is left of a row, in a vector whose other places are not known to be smooth.
    let rest = whole..count;
    let (mut phase, mut sigma, mut fourth) = ([0.0; WIDEST], [0.0; WIDEST], [0.0; WIDEST]);
    let mut second = [f32::NAN; WIDEST];
    phase[..rest.len()].copy_from_slice(&phase_rad[rest.clone()]);
    sigma[..rest.len()].copy_from_slice(&sigma_rad[rest.clone()]);
    second[..rest.len()].copy_from_slice(&bias.0[rest.clone()]);
    fourth[..rest.len()].copy_from_slice(&bias.1[rest.clone()]);
    let left = (&mut phase[..], &mut sigma[..]);
    unbias_vector(simd, left, (&second, &fourth), [0, whole], (over, at_row), growth);
    phase_rad[rest.clone()].copy_from_slice(&phase[..rest.len()]);
    sigma_rad[rest.clone()].copy_from_slice(&sigma[..rest.len()]);
}

/// The pixels from a place on, which stand from a column on (`at`: both).
#[inline(always)]
fn unbias_vector<S: Simd>(
    simd: S,
    (phase_rad, sigma_rad): (&mut [f32], &mut [f32]),
    bias: (&[f32], &[f32]),
    [first, column]: [usize; 2],
    (over, at_row): (&Field, f32),
    growth: f32,
) {
    let (phase, sigma) = (loaded(simd, phase_rad, first), loaded(simd, sigma_rad, first));
    let (bias, fourth) = (loaded(simd, bias.0, first), loaded(simd, bias.1, first));
    let off = loaded(simd, &PLACES, 0) + column as f32 - over.middle[0];
    let s2 = off * off * over.growth + at_row;
    let known = bias.is_finite();
    put::<S>(known.select(phase - s2 * (bias + s2 * fourth), phase), phase_rad, first);
    put::<S>(known.select(sigma * growth, sigma), sigma_rad, first);
}

/// Mean and scatter of the groups of a bin; `None` where one of them has too few pixels.
fn place(groups: &[Sums; GROUPS]) -> Option<Place> {
    if groups.iter().any(|g| g.count < LEAST_IN_GROUP) {
        return None;
    }
    let mut all = Sums::default();
    for group in groups {
        all.join(group);
    }
    let logs = groups.map(|g| ln(g.modulation / g.reflectance));
    let n = GROUPS as f64;
    let mean = logs.iter().sum::<f64>() / n;
    let variance = logs.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / (n - 1.0) / n;
    // Never below what single precision and rounded grey values resolve.
    let weight = 1.0 / variance.max(1e-9);
    Some(Place {
        slope2: all.slope2 / all.reflectance,
        log_contrast: ln(all.modulation / all.reflectance),
        weight,
    })
}

/// Weighted straight line: slope and its standard uncertainty.
fn line(places: &[Place]) -> Option<(f64, f64)> {
    if places.len() < 3 {
        return None;
    }
    let sum = |f: &dyn Fn(&Place) -> f64| places.iter().map(f).sum::<f64>();
    let weight = sum(&|p| p.weight);
    let (x0, y0) = (sum(&|p| p.weight * p.slope2) / weight, sum(&|p| p.weight * p.log_contrast) / weight);
    let xx = sum(&|p| p.weight * (p.slope2 - x0) * (p.slope2 - x0));
    if !(xx.is_finite() && xx > 0.0) {
        return None;
    }
    let slope = sum(&|p| p.weight * (p.slope2 - x0) * (p.log_contrast - y0)) / xx;
    let misfit = |p: &Place| p.log_contrast - y0 - slope * (p.slope2 - x0);
    // What the line does not explain (light between surfaces, focus) counts as uncertainty.
    let chi2 = sum(&|p| p.weight * misfit(p) * misfit(p)) / (places.len() as f64 - 2.0);
    Some((slope, (chi2.max(1.0) / xx).sqrt()))
}

impl Decoder {
    /// Removes the bias of the pixel's footprint, and looks for light from other faces on the way.
    pub(super) fn remove_footprint(
        &mut self,
        home: usize,
        out: &mut PhaseViewMut,
    ) -> Result<Removed, DecodeError> {
        let plan = &self.plan.axes[home];
        if let Some(levels) = plan.levels
            && self.rasters.mostly_below(levels.white, levels.black, out.valid)
        {
            return Err(DecodeError::WhiteBelowBlack { axis: plan.axis });
        }
        let given_px = self.settings.footprint_px;
        let (rasters, clipped_dn) = (&self.rasters, self.clipped_dn);
        let reflectance = plan.levels.filter(|_| given_px.is_none()).map(|levels| Reflectance {
            rasters,
            levels,
            clipped_dn,
        });
        let calibrated = self.settings.sensor.footprint.filter(|_| given_px.is_none());
        let corrects = given_px != Some(0.0);
        // Nothing to take off: no derivative is needed, unless bounced light is looked for.
        if plan.sines.is_empty() || !(corrects || self.looks_for_bounce(home)) {
            let left_px2 = self.left_px2(0.0);
            let bounced = Bounced::default();
            return Ok(Removed { sigma_px: None, assumed: false, bounced, left_px2, test: None });
        }
        let shape = calibrated.map_or([1.0; 2], |footprint| footprint.shape().map(|part| part as f32));
        let known_px2 = given_px.map(|footprint_px| footprint_px * footprint_px);
        let known_px2 = known_px2.or(calibrated.map(|footprint| footprint.variance_px2().0));
        let Slopes { line: seen, are_alike } = self.footprint.survey(out, reflectance, shape, self.level);
        let told_px2 = known_px2.or(seen.map(|line| line.joined_px2().max(0.0))).filter(|_| corrects);
        let assumed = corrects && told_px2.is_none() && !are_alike;
        let moves = |variance_px2: &f64| known_px2.is_some() || *variance_px2 > LEAST_PX2;
        let variance_px2 = told_px2.or(assumed.then_some(USUAL_LENS_PX2)).filter(moves);
        // Of the slopes as they were seen: what is taken off follows the noise of the modulation, whose scatter shows the light.
        let bounced = self.find_bounce(home, told_px2, out);
        if let Some(variance_px2) = variance_px2 {
            let field_px2 = calibrated.map_or(0.0, |footprint| footprint.field_px2);
            self.footprint.correct(variance_px2, field_px2, out, self.level);
        }
        let left_px2 = given_px.and_then(|px| self.left_px2(px));
        let seen = seen.map(|line| (line.variance_px2, line.u_px2));
        let test = calibrated.zip(seen).map(|(known, seen)| super::sensor_test::footprint(known, seen));
        Ok(Removed { sigma_px: variance_px2.map(f64::sqrt), assumed, bounced, left_px2, test })
    }

    /// What is left of the variance, px², where this standard deviation, px, is taken off, as far as it moves a phase.
    fn left_px2(&self, taken_px: f64) -> Option<f64> {
        self.settings.sensor.footprint_left_px2(taken_px).filter(|left_px2| left_px2.abs() > LEAST_PX2)
    }
}
