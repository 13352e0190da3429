//! The raster of inverse depths, and the point of a pixel.

use super::cause::Cause;
use super::independence::Independence;
use super::shares::Shares;
use crate::cloud::Point;
use crate::geometry::camera::Camera;
use crate::rectify::Directions;
use nalgebra::{Matrix3, Point3, Vector3};

/// What a view knows of one pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Sample {
    /// Inverse depth, 1/mm; NaN where there is no point.
    pub inverse_depth: f64,
    /// Its standard uncertainty, 1/mm.
    pub sigma: f32,
    /// Share of its variance that comes from the pixel itself and is independent of its neighbours'; the rest comes from
    /// the other view.
    pub own_share: f32,
    /// Modulation B of the pixel, DN.
    pub modulation: f32,
    /// In the pictures of which cameras phases end nearby: [`super::OWN`], [`super::OTHER`].
    pub limbs: u8,
    /// Why there is no point; [`Cause::Point`] where there is one.
    pub cause: Cause,
}

impl Sample {
    pub const NONE: Sample = Sample {
        inverse_depth: f64::NAN,
        sigma: f32::NAN,
        own_share: 1.0,
        modulation: 0.0,
        limbs: 0,
        cause: Cause::Dark,
    };

    /// No point, for this cause.
    pub const fn without(cause: Cause) -> Self {
        Sample { cause, ..Self::NONE }
    }
}

/// The geometry of the raster.
#[derive(Debug, Clone, Copy)]
pub(crate) struct View<'a> {
    pub width: usize,
    pub height: usize,
    /// (x, y) of the line of sight (x, y, 1) of each pixel.
    pub directions: &'a Directions,
    /// Length of a pixel in these coordinates.
    pub pitch: f64,
    pub world_from_sight: Matrix3<f64>,
    pub origin_mm: Point3<f64>,
    /// Whether the other view has a picture, too: then what bends in one alone is a silhouette.
    pub two_pictures: bool,
    /// Optical centre of the other view, mm, seen from this one.
    pub other_mm: Vector3<f64>,
    /// Optical axes of this and the other view, seen from this one, each of the length that [`axis_of`] gives it.
    pub axes: [Vector3<f64>; 2],
    /// How far the noise differs from pixel to pixel, so that smoothing takes it out.
    pub independence: Independence,
    /// What windows leave of it.
    pub shares: Shares,
    /// Largest standard uncertainty of the inverse depth after smoothing, 1/mm.
    pub max_sigma: f64,
}

/// The optical axis of a camera by its rotation from the view's lines of sight (x, y, 1), of a length such that cubes of its products with them are as the
/// areas that the camera's pixels fill in the plane of x and y.
pub(crate) fn axis_of(camera: &Camera, camera_from_sight: &Matrix3<f64>) -> Vector3<f64> {
    axis_of_pitch(camera_from_sight.row(2).transpose(), 1.0 / camera.mean_focal_px())
}

/// The same by a unit vector along the axis and the length of a pixel.
pub(super) fn axis_of_pitch(unit: Vector3<f64>, pitch: f64) -> Vector3<f64> {
    unit * crate::math::cbrt(pitch * pitch)
}

/// Error of a point seen at an angle of incidence θ: this share of the pixel's length on the surface, over cos³ θ. On a ball of 22 mm at 0.21 mm
/// per pixel it is 1 µm at 70°, 3 µm at 75° and 8 µm at 80°; what a limb adds is left out by [`super::limb`].
pub(super) const STEEP_ERROR: f64 = 2e-4;

/// Such an error counts where it is more than this share of the point's own uncertainty: fits average noise, not this.
pub(super) const STEEP_SHARE: f64 = 0.1;

/// The least cosine of the incidence where the depth noise of a point, in pixels on the surface, hides the error of the footprint beyond a limit.
#[inline]
pub(super) fn steepest(min_cosine: f64, noise_px: f64) -> f64 {
    let cube = STEEP_ERROR / (STEEP_SHARE * noise_px.max(1e-9));
    if min_cosine * min_cosine * min_cosine > cube { crate::math::cbrt(cube) } else { min_cosine }
}

/// Cosine of the steepest incidence that a slope is turned back from: 87°.
const LEAST_COSINE: f64 = 0.05;

/// Noise of points that were interpolated is at least this part of what hides a rim: shape and blur are shared by neighbours too, and where there
/// is hardly any noise they are all that is seen.
const INTERPOLATED_NOISE: f64 = 0.1;

/// Whether the shift of points two pixels from a rim is hidden: by noise beyond a limit, or by less of it where points were interpolated
/// from more than the pixel itself, which then hardly know its own footprint.
pub(crate) fn rim_is_hidden(noise: f64, limit: f64, interpolated: bool) -> bool {
    noise > limit || (interpolated && noise > INTERPOLATED_NOISE * limit)
}

/// With more depth noise than this, in pixels on the surface, the shift of points two pixels from a rim does not matter.
const RIM_NOISE_PX: f64 = 1.0;

#[cfg(test)]
impl<'a> View<'a> {
    /// A view along the axes of the world, from its origin, without a limit of uncertainty.
    pub(super) fn along_the_axes(
        [width, height]: [usize; 2],
        directions: &'a Directions,
        pitch: f64,
    ) -> Self {
        Self {
            width,
            height,
            directions,
            pitch,
            world_from_sight: Matrix3::identity(),
            origin_mm: Point3::origin(),
            two_pictures: true,
            other_mm: Vector3::zeros(),
            axes: [axis_of_pitch(Vector3::z(), pitch); 2],
            max_sigma: f64::INFINITY,
            independence: Independence::WHOLE,
            shares: Shares::new([0.0; 2]),
        }
    }
}

impl View<'_> {
    /// Depth noise of a sample in pixels on the surface: dZ / (Z pitch) = dq / (q pitch).
    #[inline]
    pub(super) fn noise_px(&self, sample: &Sample) -> f64 {
        f64::from(sample.sigma) / (sample.inverse_depth.abs() * self.pitch)
    }

    /// How far from a rim the footprint still shifts a point by more than a tenth of its noise, px: a shift of 0.05 px is a depth of
    /// some 0.1 pixels.
    #[inline]
    pub(super) fn rim_px(&self, sample: &Sample, edge_px: usize) -> usize {
        let hidden = rim_is_hidden(self.noise_px(sample), RIM_NOISE_PX, self.independence.interpolated);
        if hidden { edge_px.min(1) } else { edge_px }
    }

    /// How many pixels of the other view the piece of the surface fills that a pixel sees, of a smooth inverse depth with these derivatives by
    /// columns and rows; all eight neighbours lie in the image.
    #[inline]
    pub(super) fn filled(&self, pixel: usize, inverse_depth: f64, [by_column, by_row]: [f64; 2]) -> f64 {
        let at = |pixel: usize| self.directions.at(pixel);
        let half = |one: [f64; 2], other: [f64; 2]| [(one[0] - other[0]) * 0.5, (one[1] - other[1]) * 0.5];
        let [xu, yu] = half(at(pixel + 1), at(pixel - 1));
        let [xv, yv] = half(at(pixel + self.width), at(pixel - self.width));
        let inverse = 1.0 / (xu * yv - xv * yu);
        let gradient = [(yv * by_column - yu * by_row) * inverse, (xu * by_row - xv * by_column) * inverse];
        self.filled_at(at(pixel), inverse_depth, gradient)
    }

    /// The same by the line of sight (x, y, 1) and the inverse depth's derivatives by x and y.
    ///
    /// The plane n · X = 1 of a surface has n = (q_x, q_y, q − x q_x − y q_y), and 1 − n · t is how much larger the other view, at t, sees it than this one
    /// would there, on planes that are parallel; the cube of the axes' products turns these planes into both pictures.
    #[inline(always)]
    pub(super) fn filled_at(&self, [x, y]: [f64; 2], q: f64, [gx, gy]: [f64; 2]) -> f64 {
        let (t, [own, other]) = (&self.other_mm, &self.axes);
        let facing = 1.0 - (gx * t.x + gy * t.y + (q - x * gx - y * gy) * t.z);
        let own = own.x * x + own.y * y + own.z;
        let other = other.x * (x - t.x * q) + other.y * (y - t.y * q) + other.z * (1.0 - t.z * q);
        let ratio = own / other;
        facing * (ratio * ratio * ratio)
    }

    /// How far the normal lies beyond the limit of incidence of either view, rad; 0 or less within both. The limit is where the
    /// error of the pixel's footprint matters.
    #[inline]
    pub(super) fn beyond_incidence(
        &self,
        sample: &Sample,
        pixel: usize,
        normal: &Vector3<f64>,
        min_cosine: f64,
    ) -> f64 {
        let [x, y] = self.directions.at(pixel);
        let own = Vector3::new(x, y, 1.0);
        // The direction from the other view, scaled by the inverse depth.
        let other = own - self.other_mm * sample.inverse_depth;
        let least = (-normal.dot(&own) / own.norm()).min(-normal.dot(&other) / other.norm());
        if least >= min_cosine {
            return 0.0;
        }
        let min_cosine = steepest(min_cosine, self.noise_px(sample));
        if least >= min_cosine {
            return 0.0;
        }
        (crate::math::acos(least.clamp(-1.0, 1.0)) - crate::math::acos(min_cosine)).max(f64::MIN_POSITIVE)
    }

    /// Uncertainty of the inverse depth where noise made the window of the normal wide and its slope is still one that cannot be: over
    /// the window, `half` pixels to either side, the depth is wrong by what turns the slope back.
    #[inline]
    pub(super) fn slope_error(
        &self,
        sample: &Sample,
        pixel: usize,
        normal: &Vector3<f64>,
        half: usize,
        beyond: f64,
    ) -> f64 {
        let [x, y] = self.directions.at(pixel);
        let own = Vector3::new(x, y, 1.0);
        let cosine = (-normal.dot(&own) / own.norm()).max(LEAST_COSINE);
        half as f64 * self.pitch * sample.inverse_depth.abs() * beyond / (cosine * cosine)
    }

    /// The point of a pixel. Its uncertainty is along the normal, or along the ray where there is no normal.
    #[inline]
    pub(super) fn point(
        &self,
        sample: &Sample,
        pixel: usize,
        pair: u32,
        normal: Option<Vector3<f64>>,
    ) -> Point {
        let [x, y] = self.directions.at(pixel);
        let direction = Vector3::new(x, y, 1.0);
        let depth = 1.0 / sample.inverse_depth;
        let position = self.origin_mm + self.world_from_sight * (direction * depth);
        // dX = (x, y, 1) dZ with dZ = Z² dq; along the normal, |n·(x, y, 1)| of it.
        let share = normal.map_or(direction.norm(), |n| n.dot(&direction).abs());
        let world = normal.map_or(Vector3::zeros(), |n| self.world_from_sight * n);
        Point {
            position_mm: position.into(),
            normal: [world.x as f32, world.y as f32, world.z as f32],
            sigma_mm: (share * depth * depth * f64::from(sample.sigma)) as f32,
            modulation: sample.modulation,
            pair,
            pixel: pixel as u32,
            shared_mm: 0.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Without noise neighbours share shape and blur, which is no interpolation: points near a rim stay suspect.
    #[test]
    fn a_rim_is_hidden_by_noise_not_by_what_neighbours_share_without_it() {
        for (noise, interpolated, hidden) in
            [(2.0, false, true), (0.5, false, false), (0.5, true, true), (1e-4, true, false)]
        {
            assert_eq!(rim_is_hidden(noise, 1.0, interpolated), hidden, "noise {noise}, {interpolated}");
        }
    }

    /// The corners of a pixel on a plane, seen by the other view: the area of what it fills there.
    #[test]
    fn a_pixel_fills_as_many_of_the_other_view_as_its_corners_enclose() {
        let pitch = [4e-4, 7e-4];
        let directions = {
            let at = |i: usize| [(i % 3) as f64 * pitch[0] + 0.1, (i / 3) as f64 * pitch[0] - 0.2];
            Directions::kept(3, (0..9).map(at).collect())
        };
        let (other_mm, turn) =
            (Vector3::new(150.0, -20.0, 30.0), nalgebra::Rotation3::new(Vector3::new(0.1, -0.35, 0.2)));
        let plane = Vector3::new(4e-4, -8e-4, 2e-3);
        let view = View {
            other_mm,
            axes: [
                axis_of_pitch(Vector3::z(), pitch[0]),
                axis_of_pitch(turn.matrix().row(2).transpose(), pitch[1]),
            ],
            ..View::along_the_axes([3, 3], &directions, pitch[0])
        };
        let seen = |x: f64, y: f64| {
            let sight = Vector3::new(x, y, 1.0);
            let from_other = turn * (sight / plane.dot(&sight) - other_mm);
            [from_other.x / from_other.z / pitch[1], from_other.y / from_other.z / pitch[1]]
        };
        let ([x, y], h) = (directions.at(4), 0.5 * pitch[0]);
        let [a, b, c, d] = [(-h, -h), (h, -h), (h, h), (-h, h)].map(|(u, v)| seen(x + u, y + v));
        let cross = |p: [f64; 2], q: [f64; 2]| 0.5 * (p[0] * q[1] - p[1] * q[0]);
        let area = cross(a, b) + cross(b, c) + cross(c, d) + cross(d, a);
        let q = plane.dot(&Vector3::new(x, y, 1.0));
        let filled = view.filled(4, q, [plane.x * pitch[0], plane.y * pitch[0]]);
        assert!((filled / area - 1.0).abs() < 1e-3, "{filled} of {area}");
    }
}
