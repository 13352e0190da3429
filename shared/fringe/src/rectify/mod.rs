//! Epipolar geometry of a pair without resampling: the rectified frame, and the exact way to and from the native grids.
//!
//! The rectified frame has its x axis along the baseline (left → right optical centre), its z axis along the mean
//! optical axis made orthogonal to it, and its origin in the left centre. In it a point X has the rectified
//! normalised coordinates (X/Z, Y/Z) in the left view and ((X − b)/Z, Y/Z) in the right one: the same y, and a
//! disparity b/Z along x. (Thesis 2.1.5; rectification as in Fusiello 2000, but no image is ever warped: the left
//! pixels carry a table of exact coordinates, and an epipolar line is a curve on the native right grid.)
//!
//! A vertical baseline needs no special case: its rectified rows run along image columns.

mod directions;

pub use directions::Directions;

use crate::geometry::camera::Camera;
use nalgebra::{Matrix3, Point2, Point3, Vector2, Vector3};
use rayon::prelude::*;
use thiserror::Error;

/// Rectified coordinates beyond this (75° off the axis) are not used: the grid would explode near the epipole.
const MAX_TANGENT: f64 = 3.7;

/// Cells of a rectified raster for each pixel of its camera: about one where both views have one scale, and this many where
/// their focal lengths differ by four or a view is turned far off the common axis.
const CELLS_PER_PIXEL: f64 = 64.0;

/// As many cells are always granted: tiny images have mostly rim.
const LEAST_CELLS: f64 = 1e6;

/// A baseline shorter than this does not determine depth, mm.
pub const MIN_BASELINE_MM: f64 = 1e-6;

/// Marks a grid cell that no native pixel belongs to.
pub const NO_PIXEL: u32 = u32::MAX;

/// Why a pair has no usable epipolar geometry.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum RectifyError {
    /// Both optical centres coincide.
    #[error("the optical centres are {baseline_mm:.3e} mm apart: a pair needs a baseline")]
    NoBaseline {
        /// Distance of the centres, mm.
        baseline_mm: f64,
    },
    /// One camera (nearly) sees the other one.
    #[error(
        "the {side} image contains its epipole, at normalised ({x:.3}, {y:.3}): the cameras look along their \
         baseline, and rows cannot be matched; place them side by side"
    )]
    EpipoleInView {
        /// Which view: "left" or "right".
        side: &'static str,
        /// Ideal normalised x of the epipole.
        x: f64,
        /// Ideal normalised y of the epipole.
        y: f64,
    },
    /// The optical axes are opposite.
    #[error("the optical axes point away from each other ({angle_deg:.0}° apart, limit 150°)")]
    Opposed {
        /// Angle between the axes, degrees.
        angle_deg: f64,
    },
    /// The rectified raster would have far more cells than the camera has pixels.
    #[error(
        "the rectified raster would have {cells:.1e} cells, limit {limit:.1e}: the focal lengths of both views differ too \
         much, or a distortion is wrong"
    )]
    GridTooLarge {
        /// Columns times rows of the grid.
        cells: f64,
        /// Largest number of cells accepted.
        limit: f64,
    },
    /// The lens model folds over in the whole image.
    #[error("no pixel of the {side} camera has a ray: its distortion folds over everywhere")]
    NoRays {
        /// Which view: "left" or "right".
        side: &'static str,
    },
}

/// A camera seen from the rectified frame.
#[derive(Debug, Clone, PartialEq)]
pub struct RectifiedCamera {
    /// The camera with its lens.
    pub camera: Camera,
    /// Rotation of rectified directions into the camera frame.
    pub camera_from_rectified: Matrix3<f64>,
}

impl RectifiedCamera {
    /// Exact rectified normalised coordinates of a pixel; `None` without a ray or too far off the axis.
    pub fn rectified_from_pixel(&self, pixel: Point2<f64>) -> Option<[f64; 2]> {
        let ideal = self.camera.normalised_from_pixel(pixel)?;
        let direction = self.camera_from_rectified.transpose() * Vector3::new(ideal.x, ideal.y, 1.0);
        if direction.z <= 0.0 {
            return None;
        }
        let (x, y) = (direction.x / direction.z, direction.y / direction.z);
        (x.abs() < MAX_TANGENT && y.abs() < MAX_TANGENT).then_some([x, y])
    }

    /// The epipolar curve of rectified ordinate y on the native grid.
    #[inline(always)]
    pub fn curve(&self, y: f64) -> EpipolarCurve<'_> {
        let m = &self.camera_from_rectified;
        EpipolarCurve {
            camera: &self.camera,
            base: m * Vector3::new(0.0, y, 1.0),
            along: Vector3::new(m[(0, 0)], m[(1, 0)], m[(2, 0)]),
        }
    }

    /// How far one may go along a curve from an exact place, by tangent and stretch alone, until the neglected bend of
    /// the lens displaces by `error_px`; in units of the rectified abscissa, the least over a lattice of pixels.
    pub fn reach(&self, error_px: f64) -> f64 {
        let h = 2.0 / self.camera.mean_focal_px();
        let (last_column, last_row) = (self.camera.width_px - 1, self.camera.height_px - 1);
        let mut worst = 0.0_f64;
        for i in 0..=16 {
            for j in 0..=16 {
                let pixel = Point2::new(f64::from(last_column * i) / 16.0, f64::from(last_row * j) / 16.0);
                let Some([x, y]) = self.rectified_from_pixel(pixel) else { continue };
                let curve = self.curve(y);
                let (low, here, high) = (curve.at(x - h), curve.at(x), curve.at(x + h));
                for axis in 0..2 {
                    let second = (low.pixel[axis] - 2.0 * here.pixel[axis] + high.pixel[axis]) / (h * h);
                    // NaN beyond the front half space is skipped by max.
                    worst = worst.max((second - here.stretch * here.tangent[axis]).abs());
                }
            }
        }
        (2.0 * error_px / worst.max(1e-9)).sqrt()
    }

    /// Rectified coordinates of all pixels, row by row; NaN where there are none.
    pub fn table(&self) -> Vec<[f64; 2]> {
        let width = self.camera.width_px as usize;
        let mut table = vec![[f64::NAN; 2]; width * self.camera.height_px as usize];
        table.par_chunks_mut(width.max(1)).enumerate().for_each(|(row, line)| {
            for (column, cell) in line.iter_mut().enumerate() {
                let pixel = Point2::new(column as f64, row as f64);
                *cell = self.rectified_from_pixel(pixel).unwrap_or([f64::NAN; 2]);
            }
        });
        table
    }
}

/// An epipolar line as it runs over the native, distorted grid of a camera.
#[derive(Debug, Clone, Copy)]
pub struct EpipolarCurve<'a> {
    camera: &'a Camera,
    base: Vector3<f64>,
    along: Vector3<f64>,
}

/// A place on an epipolar curve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CurvePoint {
    /// Native pixel (column, row).
    pub pixel: [f64; 2],
    /// Its derivative by the rectified abscissa.
    pub tangent: [f64; 2],
    /// Second derivative over the first, as the perspective makes it; the lens adds a little.
    pub stretch: f64,
}

impl EpipolarCurve<'_> {
    /// Rotates, projects, distorts: closed form, exact. Not finite where the direction leaves the front half space.
    #[inline(always)]
    pub fn at(&self, x: f64) -> CurvePoint {
        let direction = self.base + self.along * x;
        let inverse_z = if direction.z > 0.0 { 1.0 / direction.z } else { f64::NAN };
        let ideal = Vector2::new(direction.x * inverse_z, direction.y * inverse_z);
        let slope = Vector2::new(
            (self.along.x - ideal.x * self.along.z) * inverse_z,
            (self.along.y - ideal.y * self.along.z) * inverse_z,
        );
        let lens = &self.camera.distortion;
        let distorted = self.camera.pixel_from_distorted(lens.distort(ideal));
        let turned = lens.jacobian(ideal) * slope;
        let [fx, fy] = self.camera.focal_px;
        CurvePoint {
            pixel: [distorted.x, distorted.y],
            tangent: [fx * turned.x + self.camera.skew * turned.y, fy * turned.y],
            stretch: -2.0 * self.along.z * inverse_z,
        }
    }
}

/// The rectified frame of a pair.
#[derive(Debug, Clone, PartialEq)]
pub struct Rectification {
    /// Left view of the pair.
    pub left: RectifiedCamera,
    /// Right view of the pair.
    pub right: RectifiedCamera,
    /// Distance of the optical centres, mm.
    pub baseline_mm: f64,
    /// Rotation of rectified directions into the world.
    pub world_from_rectified: Matrix3<f64>,
    /// Left optical centre in the world, mm.
    pub origin_mm: Point3<f64>,
    /// Pixels per unit of rectified coordinates: the mean focal length.
    pub focal_px: f64,
}

impl Rectification {
    /// Builds the frame.
    ///
    /// # Errors
    /// No baseline, opposed cameras, or an epipole inside an image.
    pub fn new(left: &Camera, right: &Camera) -> Result<Self, RectifyError> {
        let (origin_mm, other) = (left.centre_mm(), right.centre_mm());
        let baseline = other - origin_mm;
        let baseline_mm = baseline.norm();
        // Written so that a NaN is refused too.
        if baseline_mm.is_nan() || baseline_mm < MIN_BASELINE_MM {
            return Err(RectifyError::NoBaseline { baseline_mm });
        }
        let x = baseline / baseline_mm;
        let axes =
            [left, right].map(|camera| camera.camera_from_world.rotation.inverse() * Vector3::<f64>::z());
        let cosine = axes[0].dot(&axes[1]).clamp(-1.0, 1.0);
        // cos 150°: beyond it the mean axis has no direction worth the name.
        if cosine < -0.866 {
            return Err(RectifyError::Opposed { angle_deg: crate::math::acos(cosine).to_degrees() });
        }
        for (side, camera) in [("left", left), ("right", right)] {
            refuse_epipole(side, camera, x)?;
        }
        let mean = axes[0] + axes[1];
        let Some(z) = (mean - x * mean.dot(&x)).try_normalize(1e-9) else {
            return Err(RectifyError::EpipoleInView { side: "left", x: 0.0, y: 0.0 });
        };
        let world_from_rectified = Matrix3::from_columns(&[x, z.cross(&x), z]);
        let rectified = |camera: &Camera| RectifiedCamera {
            camera: camera.clone(),
            camera_from_rectified: camera.camera_from_world.rotation.to_rotation_matrix().matrix()
                * world_from_rectified,
        };
        let focal_px = [left, right].iter().flat_map(|c| c.focal_px).sum::<f64>() / 4.0;
        Ok(Self {
            left: rectified(left),
            right: rectified(right),
            baseline_mm,
            world_from_rectified,
            origin_mm,
            focal_px,
        })
    }
}

/// Refuses a camera whose image (as a rectangle of ideal coordinates) contains the direction of the baseline.
fn refuse_epipole(
    side: &'static str,
    camera: &Camera,
    world_baseline: Vector3<f64>,
) -> Result<(), RectifyError> {
    let direction = camera.camera_from_world.rotation * world_baseline;
    if direction.z.abs() < 1e-9 {
        return Ok(());
    }
    let (x, y) = (direction.x / direction.z, direction.y / direction.z);
    let (right, bottom) = (f64::from(camera.width_px) - 0.5, f64::from(camera.height_px) - 0.5);
    let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for i in 0..=16 {
        let t = f64::from(i) / 16.0;
        let (u, v) = (-0.5 + t * (right + 0.5), -0.5 + t * (bottom + 0.5));
        for (u, v) in [(u, -0.5), (u, bottom), (-0.5, v), (right, v)] {
            if let Some(ideal) = camera.normalised_from_pixel(Point2::new(u, v)) {
                low = [low[0].min(ideal.x), low[1].min(ideal.y)];
                high = [high[0].max(ideal.x), high[1].max(ideal.y)];
            }
        }
    }
    if low[0] > high[0] {
        return Err(RectifyError::NoRays { side });
    }
    let inside = x >= low[0] && x <= high[0] && y >= low[1] && y <= high[1];
    if inside { Err(RectifyError::EpipoleInView { side, x, y }) } else { Ok(()) }
}

/// A rectified raster that only states which native pixel lies nearest to each of its cells.
#[derive(Debug, Clone, PartialEq)]
pub struct RectifiedGrid {
    /// Cells per unit of rectified coordinates.
    pub focal_px: f64,
    /// Length of a cell in these coordinates.
    pub pitch: f64,
    /// Rectified abscissa of column 0.
    pub x0: f64,
    /// Rectified ordinate of row 0.
    pub y0: f64,
    /// Columns of the grid.
    pub width: usize,
    /// Rows of the grid.
    pub height: usize,
    /// Native pixel of each cell, row by row, or [`NO_PIXEL`].
    pub index: Vec<u32>,
}

impl RectifiedGrid {
    /// Builds the map of a camera for the given rows; `table` is its [`RectifiedCamera::table`].
    ///
    /// # Errors
    /// [`RectifyError::GridTooLarge`] when the views differ so much in scale that the raster would burst the memory.
    pub fn new(
        camera: &RectifiedCamera,
        table: &[[f64; 2]],
        focal_px: f64,
        y0: f64,
        height: usize,
    ) -> Result<RectifiedGrid, RectifyError> {
        let (low, high) = range(table, 0).unwrap_or((0.0, 0.0));
        // In floating point, where nothing overflows.
        let columns = ((high - low) * focal_px).ceil() + 1.0;
        let (cells, limit) = (columns * height as f64, CELLS_PER_PIXEL * table.len() as f64 + LEAST_CELLS);
        if cells.is_nan() || cells > limit {
            return Err(RectifyError::GridTooLarge { cells, limit });
        }
        let width = columns as usize;
        let mut index = vec![NO_PIXEL; width * height];
        index.par_chunks_mut(width).enumerate().for_each(|(row, line)| {
            let y = y0 + row as f64 / focal_px;
            let curve = camera.curve(y);
            for (column, cell) in line.iter_mut().enumerate() {
                let x = low + column as f64 / focal_px;
                *cell = nearest(&camera.camera, table, curve.at(x).pixel, [x, y], focal_px);
            }
        });
        Ok(RectifiedGrid { focal_px, pitch: 1.0 / focal_px, x0: low, y0, width, height, index })
    }

    /// Fractional column of a rectified abscissa.
    #[inline]
    pub fn column(&self, x: f64) -> f64 {
        (x - self.x0) * self.focal_px
    }

    /// Rectified abscissa of a fractional column.
    #[inline]
    pub fn abscissa(&self, column: f64) -> f64 {
        self.x0 + column * self.pitch
    }
}

/// Smallest and largest finite entry of one coordinate of a table.
pub fn range(table: &[[f64; 2]], coordinate: usize) -> Option<(f64, f64)> {
    let (low, high) = table.iter().map(|entry| entry[coordinate]).fold(
        (f64::INFINITY, f64::NEG_INFINITY),
        |(low, high), v| {
            (low.min(v), high.max(v)) // min and max skip NaN
        },
    );
    (low <= high).then_some((low, high))
}

/// The native pixel nearest to a place; [`NO_PIXEL`] outside the image and where the lens model has folded back into it.
fn nearest(camera: &Camera, table: &[[f64; 2]], pixel: [f64; 2], rectified: [f64; 2], focal_px: f64) -> u32 {
    let (u, v) = (pixel[0].round(), pixel[1].round());
    // NaN fails each of these comparisons.
    if !(u >= 0.0 && v >= 0.0 && u < f64::from(camera.width_px) && v < f64::from(camera.height_px)) {
        return NO_PIXEL;
    }
    let index = v as usize * camera.width_px as usize + u as usize;
    let [x, y] = table[index];
    let off = (x - rectified[0]).abs().max((y - rectified[1]).abs()) * focal_px;
    if off < 2.0 { index as u32 } else { NO_PIXEL }
}

#[cfg(test)]
mod tests;
