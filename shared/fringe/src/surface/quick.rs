//! Points side by side: where a whole 5 × 5 window is one smooth surface, as nearly everywhere, fit, normal, limits and point of
//! neighbouring pixels are the same steps on vectors. Every other pixel is left to the general way, whose formulas these are.

// Without branches a loop vectorises.
#![allow(clippy::needless_bitwise_bool)]

use super::limb::FRONTAL_COSINE2;
use super::normals::MAX_SLOPE_NOISE;
use super::point::{STEEP_ERROR, STEEP_SHARE, Sample, View};
use super::raster::Raster;
use super::shares::shared;
use super::windows::{Block, Broken, Columns, HALF, LANES, Lanes, fits, taken};
use nalgebra::Vector3;

/// Keeps rounding out of a comparison.
const STRICTER: f64 = 1.0 + 1e-9;

/// Values of the settings and the image that all pixels share.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shared {
    /// Largest relative change of the inverse depth per pixel.
    pub max_step: f64,
    /// Excess of the scatter, see [`super::scatter`].
    pub excess: f64,
    /// Smallest cosine between normal and lines of sight.
    pub min_cosine: f64,
}

/// What becomes of neighbouring pixels.
pub(super) struct Group {
    /// Whether the rest holds; where not, the general way decides.
    pub settled: [bool; LANES],
    /// Whether a view sees the pixel so steeply that a limb may be near.
    pub turned_away: [bool; LANES],
    /// x, y, z in mm.
    pub position_mm: [Lanes; 3],
    /// Unit normal in the world.
    pub normal: [Lanes; 3],
    /// Standard uncertainty along the normal, mm.
    pub sigma_mm: [f32; LANES],
    /// Unit normal in the view.
    own_normal: [Lanes; 3],
    /// Smoothed inverse depth and its standard uncertainty, 1/mm.
    inverse_depth: Lanes,
    sigma: [f32; LANES],
}

impl Group {
    /// The smoothed sample and the normal of one of the pixels, in the view, as the general way gives them.
    #[inline(always)]
    pub fn smoothed(&self, sample: Sample, l: usize) -> (Sample, Vector3<f64>) {
        let normal = Vector3::from(self.own_normal.map(|part| part[l]));
        (Sample { inverse_depth: self.inverse_depth[l], sigma: self.sigma[l], ..sample }, normal)
    }

    /// What the general way need not try again for one of the pixels.
    #[inline(always)]
    pub fn broken(&self, l: usize) -> Broken {
        Broken { plane: self.own_normal[2][l].is_nan(), quadratic: self.inverse_depth[l].is_nan() }
    }
}

/// What becomes of the pixels from `at` on, whose windows lie in the image.
#[inline(always)]
pub(super) fn group(view: &View, samples: &Raster, at: usize, shared_by: Shared, block: &mut Block) -> Group {
    let depths = &samples.depths[..];
    let sigmas = taken::<_, LANES>(&samples.sigmas, at);
    let own_shares = taken::<_, LANES>(&samples.own_shares, at);
    let mut sigma = [0.0; LANES];
    let mut own = [0.0; LANES];
    for l in 0..LANES {
        sigma[l] = f64::from(sigmas[l]);
        own[l] = f64::from(own_shares[l]);
    }
    let columns = block.columns(view, depths, at);
    let fits = fits(columns, |k, l| k + l, [&sigma, &own], (shared_by.max_step, view.pitch));
    let [above_x, above_y] = view.directions.along::<LANES>(at - view.width);
    let [below_x, below_y] = view.directions.along::<LANES>(at + view.width);
    let [beside_x, beside_y] = view.directions.along::<{ LANES + 2 }>(at - 1);
    let zero = [0.0; LANES];
    let mut out = Group {
        settled: [false; LANES],
        turned_away: [false; LANES],
        position_mm: [zero; 3],
        normal: [zero; 3],
        sigma_mm: [0.0; LANES],
        own_normal: [zero; 3],
        inverse_depth: fits.smooth,
        sigma: [0.0; LANES],
    };
    let world = view.world_from_sight;
    for l in 0..LANES {
        let (x, y) = (beside_x[l + 1], beside_y[l + 1]);
        let (xu, yu) = ((beside_x[l + 2] - beside_x[l]) * 0.5, (beside_y[l + 2] - beside_y[l]) * 0.5);
        let (xv, yv) = ((below_x[l] - above_x[l]) * 0.5, (below_y[l] - above_y[l]) * 0.5);
        // q_u = q_x x_u + q_y y_u, q_v = q_x x_v + q_y y_v.
        let inverse = 1.0 / (xu * yv - xv * yu);
        let (qu, qv) = (fits.by_column[l], fits.by_row[l]);
        let gx = (yv * qu - yu * qv) * inverse;
        let gy = (xu * qv - xv * qu) * inverse;
        let (nx, ny, nz) = (-gx, -gy, -(fits.value[l] - x * gx - y * gy));
        let unit = 1.0 / (nx * nx + ny * ny + nz * nz).sqrt();
        let (nx, ny, nz) = (nx * unit, ny * unit, nz * unit);

        let q = fits.smooth[l];
        let filled = view.filled_at([x, y], q, [gx, gy]);
        let left = shared(view.shares.left(HALF, own[l], filled), view.independence.share);
        let single = (sigma[l] * left.sqrt()) as f32;
        let after = (f64::from(single) * shared_by.excess) as f32;
        let whole = columns[0][l + HALF];
        let seen = Seen::new(view, [nx, ny, nz], [x, y, q]);
        // What bends may be a crease.
        out.settled[l] =
            seen.holds(view, shared_by, [nz, q], [whole, sigma[l], f64::from(after)]) & (fits.bent[l] <= 0.0);
        out.turned_away[l] = seen.is_turned_away();

        let depth = 1.0 / q;
        let (px, py, pz) = (x * depth, y * depth, depth);
        for axis in 0..3 {
            let (a, b, c) = (world[(axis, 0)], world[(axis, 1)], world[(axis, 2)]);
            out.position_mm[axis][l] = view.origin_mm[axis] + (a * px + b * py + c * pz);
            out.normal[axis][l] = a * nx + b * ny + c * nz;
        }
        (out.own_normal[0][l], out.own_normal[1][l], out.own_normal[2][l]) = (nx, ny, nz);
        out.sigma[l] = after;
        let share = (nx * x + ny * y + nz).abs();
        out.sigma_mm[l] = (share * depth * depth * f64::from(after)) as f32;
    }
    out
}

/// How both views see a pixel: products of its normal with the lines of sight, and the squares of their lengths.
#[derive(Clone, Copy)]
struct Seen {
    own_dot: f64,
    far_dot: f64,
    own_square: f64,
    far_square: f64,
}

impl Seen {
    /// Of a pixel with this normal, line of sight (x, y, 1) and smoothed inverse depth q.
    #[inline(always)]
    fn new(view: &View, [nx, ny, nz]: [f64; 3], [x, y, q]: [f64; 3]) -> Self {
        let other = [x - view.other_mm.x * q, y - view.other_mm.y * q, 1.0 - view.other_mm.z * q];
        Self {
            own_dot: -(nx * x + ny * y + nz),
            far_dot: -(nx * other[0] + ny * other[1] + nz * other[2]),
            own_square: x * x + y * y + 1.0,
            far_square: other[0] * other[0] + other[1] * other[1] + other[2] * other[2],
        }
    }

    /// Whether it is a point by all limits; of the sample: its own inverse depth, its uncertainty and that after smoothing. Without quotients and
    /// roots, and a little stricter than the general way, which decides where rounding could.
    #[inline(always)]
    fn holds(self, view: &View, limits: Shared, [nz, q]: [f64; 2], [single, sigma, after]: [f64; 3]) -> bool {
        let facing = (self.own_dot > 0.0) & (self.far_dot > 0.0);
        let (own_dot2, far_dot2) = (self.own_dot * self.own_dot, self.far_dot * self.far_dot);
        let wanted = limits.min_cosine * limits.min_cosine * STRICTER;
        let open = (own_dot2 >= wanted * self.own_square) & (far_dot2 >= wanted * self.far_square);
        // The cosine cubed, times the noise, against the error that a footprint makes: all squared, as everything here.
        let least = STEEP_ERROR / STEEP_SHARE * (q.abs() * view.pitch);
        let wanted = least * least * STRICTER;
        let noise2 = after * after;
        let enough =
            |dot2: f64, square: f64| dot2 * dot2 * dot2 * noise2 >= wanted * (square * square * square);
        let hidden = enough(own_dot2, self.own_square) & enough(far_dot2, self.far_square);
        let most = single * (view.pitch * MAX_SLOPE_NOISE);
        let quiet = sigma * sigma * STRICTER <= 50.0 * (most * most);
        // NaN fails these comparisons.
        facing
            & (open | hidden)
            & quiet
            & (after <= view.max_sigma)
            & (q.abs() < f64::INFINITY)
            & (nz.abs() <= 2.0)
    }

    /// Whether a view sees it so steeply that a limb may be near, a little earlier than the general way says.
    #[inline(always)]
    fn is_turned_away(self) -> bool {
        let least = FRONTAL_COSINE2 * STRICTER;
        (self.own_dot * self.own_dot <= least * self.own_square)
            | (self.far_dot * self.far_dot <= least * self.far_square)
    }
}

/// Samples at places whose windows lie in the image, less noise, and their uncertainties; NaN where their windows are not one smooth surface. A sample
/// fills so many pixels of the other view.
#[inline(always)]
pub(super) fn smoothed(
    view: &View,
    samples: &Raster,
    (places, filled): (&[usize; LANES], &Lanes),
    max_step: f64,
) -> (Lanes, [f32; LANES]) {
    let mut windows = [[0.0; 5 * LANES]; 5];
    let (mut sigma, mut of_own, mut single) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
    for l in 0..LANES {
        let first = places[l] - HALF * view.width - HALF;
        for (r, row) in windows.iter_mut().enumerate() {
            for (k, value) in samples.depths[first + r * view.width..][..5].iter().enumerate() {
                row[k * LANES + l] = *value;
            }
        }
        sigma[l] = f64::from(samples.sigmas[places[l]]);
        of_own[l] = f64::from(samples.own_shares[places[l]]);
    }
    let mut columns = Columns::<{ 5 * LANES }>::NONE;
    let [above, over, own, under, below] = &windows;
    columns.fill([above, over, own, under, below]);
    let fits = fits(
        columns.part::<{ 5 * LANES }>(0),
        |k, l| k * LANES + l,
        [&sigma, &of_own],
        (max_step, view.pitch),
    );
    for l in 0..LANES {
        let left = shared(view.shares.left(HALF, of_own[l], filled[l]), view.independence.share);
        single[l] = (sigma[l] * left.sqrt()) as f32;
    }
    (fits.smooth, single)
}

#[cfg(test)]
mod tests {
    use super::super::build::Selector;
    use super::super::independence::Independence;
    use super::super::normals::Link;
    use super::super::point::axis_of_pitch;
    use super::super::{Cause, Shares, SurfaceSettings};
    use super::*;
    use crate::math::random::{Key, normal_quantile};
    use crate::rectify::Directions;
    use nalgebra::{Matrix3, Point3};

    const SIDE: usize = 60;
    const PITCH: f64 = 1.0 / 2330.0;

    fn same_but_for_rounding(one: &(Sample, Vector3<f64>), other: &(Sample, Vector3<f64>)) {
        let off = (one.0.inverse_depth - other.0.inverse_depth).abs();
        assert!(off <= 1e-6 * f64::from(other.0.sigma), "{off}");
        assert!((one.0.sigma / other.0.sigma - 1.0).abs() < 1e-6);
        assert!((one.1 - other.1).norm() < 1e-9);
    }

    /// What is known to be broken, and therefore not tried again, would have failed; how many fits of the pixels from one on that are.
    fn would_have_failed(selector: &Selector, found: &Group, first: usize) -> usize {
        let open = |l: &usize| !found.settled[*l] && selector.samples.depths[first + l].is_finite();
        let broken = (0..LANES).filter(open).map(|l| {
            let known = found.broken(l);
            let (told, asked) =
                (selector.pixel(first + l, known), selector.pixel(first + l, Broken::UNKNOWN));
            // The sample of a pixel at a rim is not used.
            assert!(told.2 == asked.2 && (told.2 == Cause::Rim || told == asked), "{told:?} {asked:?}");
            usize::from(known.plane) + usize::from(known.quadratic)
        });
        broken.sum()
    }

    /// A ball with noise before a plane far behind it, with specks: what is settled side by side is what the general way gives.
    #[test]
    fn pixels_side_by_side_are_those_of_the_general_way() {
        let at = |i: usize| [(i % SIDE) as f64 - 30.0, (i / SIDE) as f64 - 30.0].map(|v| v * PITCH);
        let table = (0..SIDE * SIDE).map(|i| at(i).map(|v| v * (1.0 + 0.02 * v))).collect();
        let directions = Directions::kept(SIDE, table);
        // With less noise the ball bends by more than that everywhere, and is left to the general way.
        let sample = |i: usize| {
            let [x, y] = at(i).map(|v| 500.0 * v);
            let depth = 500.0 - (36.0 - x * x - y * y).max(0.0).sqrt();
            let noise = 2e-7 * normal_quantile(Key::new(7).open(i as u64));
            let inverse_depth = if i % 97 == 5 { f64::NAN } else { 1.0 / depth + noise };
            Sample { inverse_depth, sigma: 2e-7, own_share: 0.7, modulation: 1.0, ..Sample::NONE }
        };
        let samples: Vec<Sample> = (0..SIDE * SIDE).map(sample).collect();
        let raster = Raster::from(&samples[..]);
        let (cosine, sine) = (0.8, 0.6);
        let view = View {
            width: SIDE,
            height: SIDE,
            directions: &directions,
            pitch: PITCH,
            world_from_sight: Matrix3::new(cosine, 0.0, sine, 0.0, 1.0, 0.0, -sine, 0.0, cosine),
            origin_mm: Point3::new(3.0, -20.0, 7.0),
            two_pictures: true,
            other_mm: Vector3::new(150.0, 0.0, 0.0),
            axes: [[0.1, 0.0, 1.0], [-0.2, 0.05, 0.9]].map(|axis| axis_of_pitch(Vector3::from(axis), PITCH)),
            independence: Independence { share: 0.9, interpolated: false },
            shares: Shares::new([0.3, 0.2]),
            max_sigma: 5e-7,
        };
        let (settings, gaps) = (SurfaceSettings::default(), vec![0; samples.len()]);
        let common = Shared { max_step: 5.67 * PITCH, excess: 1.1, min_cosine: 0.34 };
        let selector = Selector {
            view: &view,
            samples: &raster,
            link: Link { max_step: common.max_step },
            excess: common.excess,
            settings: &settings,
            min_cosine: common.min_cosine,
            gaps: &gaps,
        };
        let (mut settled, mut broken, mut block) = (0, 0, Block::NONE);
        for start in (HALF..SIDE - HALF).map(|row| row * SIDE + HALF) {
            for first in (start..start + SIDE - 2 * HALF - LANES).step_by(LANES) {
                let found = group(&view, &raster, first, common, &mut block);
                broken += would_have_failed(&selector, &found, first);
                for l in (0..LANES).filter(|l| found.settled[*l]) {
                    settled += 1;
                    let (sample, normal, cause) = selector.pixel(first + l, Broken::UNKNOWN);
                    assert_eq!(cause, Cause::Point);
                    same_but_for_rounding(&found.smoothed(samples[first + l], l), &(sample, normal.unwrap()));
                    let point = view.point(&sample, first + l, 0, normal);
                    // But for rounding: a millionth of the uncertainty.
                    let sigma_mm = f64::from(point.sigma_mm);
                    for axis in 0..3 {
                        let off = point.position_mm[axis] - found.position_mm[axis][l];
                        assert!(off.abs() <= 1e-6 * sigma_mm, "{off} mm at {}", first + l);
                        assert!((f64::from(point.normal[axis]) - found.normal[axis][l]).abs() < 1e-6);
                    }
                    assert!((f64::from(found.sigma_mm[l]) / sigma_mm - 1.0).abs() < 1e-6);
                }
            }
        }
        assert!(settled > 1000 && broken > 500, "{settled} {broken}");
    }
}
