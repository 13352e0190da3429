//! What is adjusted to what: image points, the columns of their parameters, and the equations of independent errors.
//!
//! A projector's pixel is read where a camera found the point (see [`super::Link`]); its error S e_c + e_r holds that camera's
//! error e_c. The two residuals r_c and r_p are correlated, but r_c and r_p − S r_c are not: their errors are e_c and e_r. That
//! is what a linked image point brings into the sums, with the rows J_p − S J_c and the covariance of e_r; it is least squares with
//! the whole covariance matrix of all pixels, block by block.

use super::datum::Datum;
use super::model::{Board, DEVICE, FACE, FURTHER, INTRINSIC, LOCAL, POSE, Projector, State, WARP};
use super::observations::ImagePoint;
use super::settings::{LensModel, TargetShape};
use nalgebra::{Matrix2, Point2, Vector3};
use std::collections::BTreeMap;

/// Columns of an equation: those of [`super::model`], those of the camera that an image point is linked to, those of its face.
pub(super) const WIDE: usize = LOCAL + DEVICE + FACE;

/// First column of the face.
const OF_FACE: usize = LOCAL + DEVICE;

/// Of a quotient of polynomials, numerator and denominator may take the same factor: along this the sum of squares is flat to
/// rounding. So much damping holds it, and changes what the points determine by less than their noise.
pub(super) const RIDGE: f64 = 1e-9;

/// Two rows of the Jacobian.
pub(super) type WideRows = [[f64; WIDE]; 2];

/// A view as the adjustment sees it: image points `start .. end` of the flat list.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct ViewRange {
    /// Index of the device.
    pub device: usize,
    /// Index of the pose.
    pub pose: usize,
    /// Index of the first image point.
    pub start: usize,
    /// One past the last image point.
    pub end: usize,
}

/// What does not change during an adjustment.
#[derive(Debug, Clone)]
pub(super) struct Problem<'a> {
    /// The target and its points.
    pub board: &'a Board,
    /// Views in a fixed order.
    pub views: Vec<ViewRange>,
    /// All image points, view by view.
    pub image_points: Vec<ImagePoint>,
    /// What each image point is linked to.
    pub links: Vec<Option<Linked>>,
    /// Lower triangle (a, b, c) of the whitening matrix of each image point's own error: r ↦ (a r₀, b r₀ + c r₁).
    pub whiten: Vec<[f64; 3]>,
    /// Column of each device's parameters and of the warp (last) in the reduced system; `None` where fixed.
    pub columns: Vec<Vec<Option<usize>>>,
    /// Column of the first parameter of each face whose place on the target is adjusted.
    pub faces: Vec<Option<usize>>,
    /// Size of the reduced system.
    pub unknowns: usize,
    /// Damping that is never taken off: 0, but for lenses whose terms follow each other.
    pub ridge: f64,
    /// What holds the target's points when they are adjusted; their columns are the last ones.
    pub datum: Option<Datum>,
}

/// A projector's image point and the camera's image point of the same point in the same pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Linked {
    /// Place of the camera's image point in the flat list.
    pub image_point: usize,
    /// Index of the camera.
    pub device: usize,
    /// Projector pixels per camera pixel.
    pub slopes: Matrix2<f64>,
    /// Covariance of the reading alone, px².
    pub covariance_px2: Matrix2<f64>,
}

/// Finds the camera's image point of each linked one; where it is not there, a projector's image point stands by itself.
fn links(views: &[ViewRange], image_points: &[ImagePoint]) -> Vec<Option<Linked>> {
    let mut places = BTreeMap::new();
    for view in views {
        for (number, image_point) in image_points.iter().enumerate().take(view.end).skip(view.start) {
            places.insert((view.device, view.pose, image_point.index), number);
        }
    }
    let mut links = vec![None; image_points.len()];
    for view in views {
        for (number, image_point) in image_points.iter().enumerate().take(view.end).skip(view.start) {
            links[number] = image_point.link.and_then(|link| {
                let image_point = *places.get(&(link.device, view.pose, image_point.index))?;
                let (device, slopes, covariance_px2) = (link.device, link.slopes, link.covariance_px2);
                Some(Linked { image_point, device, slopes, covariance_px2 })
            });
        }
    }
    links
}

/// Consecutive image points of a view that lie on one face and hang on the same camera, or on none.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Run {
    /// Index of the device.
    pub device: usize,
    /// Index of the pose.
    pub pose: usize,
    /// Camera that the image points are linked to.
    pub linked: Option<usize>,
    /// Face that they lie on.
    pub face: usize,
    /// Index of the first image point.
    pub start: usize,
    /// One past the last image point.
    pub end: usize,
}

/// The devices that the image points of a run depend on, and the target's pose before them.
pub(super) struct Eyes<'a> {
    own: Projector<'a>,
    linked: Option<Projector<'a>>,
}

/// Inverse Cholesky factor of a checked covariance.
fn whitening(c: &Matrix2<f64>) -> [f64; 3] {
    let a = c.m11.sqrt();
    let b = c.m12 / a;
    let d = (c.m22 - b * b).sqrt();
    [1.0 / a, -b / (a * d), 1.0 / d]
}

/// Columns of the reduced system: intrinsics as the lens models say, the first device fixed, then the warp.
pub(super) fn columns(lenses: &[LensModel], target: TargetShape) -> (Vec<Vec<Option<usize>>>, usize) {
    let mut next = 0;
    let mut take = |free: bool| {
        free.then(|| {
            next += 1;
            next - 1
        })
    };
    let mut columns: Vec<Vec<Option<usize>>> = Vec::with_capacity(lenses.len() + 1);
    for (device, lens) in lenses.iter().enumerate() {
        let free = |local: usize| match local {
            0..4 => true,
            4 => lens.skew,
            5..8 => local - 5 < lens.radial_terms,
            8..INTRINSIC => lens.tangential,
            INTRINSIC..FURTHER => device > 0,
            _ => lens.further(local - FURTHER),
        };
        columns.push((0..DEVICE).map(|local| take(free(local))).collect());
    }
    columns.push((0..WARP).map(|_| take(target == TargetShape::Bent)).collect());
    (columns, next)
}

impl<'a> Problem<'a> {
    /// With the columns of [`columns`].
    pub fn new(
        board: &'a Board,
        views: Vec<ViewRange>,
        image_points: Vec<ImagePoint>,
        (columns, unknowns): (Vec<Vec<Option<usize>>>, usize),
    ) -> Self {
        let links = links(&views, &image_points);
        let own = |(image_point, link): (&ImagePoint, &Option<Linked>)| {
            whitening(&link.map_or(image_point.covariance_px2, |l| l.covariance_px2))
        };
        let whiten = image_points.iter().zip(&links).map(own).collect();
        let faces = Vec::new();
        Self { board, views, image_points, links, whiten, columns, faces, unknowns, ridge: 0.0, datum: None }
    }

    /// Adjusts where these faces are on the target.
    pub fn adjust_faces(&mut self, adjusted: &[bool]) {
        let mut next = self.unknowns;
        let mut take = |free: &bool| {
            free.then(|| {
                next += FACE;
                next - FACE
            })
        };
        self.faces = adjusted.iter().map(&mut take).collect();
        self.unknowns = next;
    }
}

impl Problem<'_> {
    /// The whitened residual (seen − model) of an image point's own error.
    #[inline]
    fn whitened(&self, image_point: usize, residual: [f64; 2]) -> [f64; 2] {
        let [a, b, c] = self.whiten[image_point];
        [a * residual[0], b * residual[0] + c * residual[1]]
    }

    /// Residual in px (seen − model) of each image point; `None` behind the device or without a pose.
    pub fn residuals(&self, state: &State) -> Vec<Option<[f64; 2]>> {
        let mut residuals = Vec::with_capacity(self.image_points.len());
        for view in &self.views {
            let projector = state.boards[view.pose]
                .as_ref()
                .map(|board| Projector::new(&state.cameras[view.device], board));
            for image_point in &self.image_points[view.start..view.end] {
                let point = self.board.point(image_point.index, &state.shape);
                let pixel = projector.as_ref().and_then(|p| p.pixel(&point));
                residuals.push(pixel.map(|q| [image_point.pixel.x - q.x, image_point.pixel.y - q.y]));
            }
        }
        residuals
    }

    /// Squared whitened length of each image point's own error; infinite where there is none.
    pub fn squares(&self, state: &State) -> Vec<f64> {
        let residuals = self.residuals(state);
        let own = |image_point: usize| {
            let [x, y] = residuals[image_point]?;
            let Some(link) = &self.links[image_point] else { return Some([x, y]) };
            let [left, up] = residuals[link.image_point]?;
            let s = &link.slopes;
            Some([x - s.m11 * left - s.m12 * up, y - s.m21 * left - s.m22 * up])
        };
        let square = |image_point: usize| {
            own(image_point).map_or(f64::INFINITY, |r| {
                let [x, y] = self.whitened(image_point, r);
                x * x + y * y
            })
        };
        (0..residuals.len()).map(square).collect()
    }

    /// Weighted sum of squares; infinite when an image point that counts lies behind its device.
    pub fn cost(&self, state: &State, weights: &[f64]) -> f64 {
        self.squares(state).iter().zip(weights).filter(|(_, w)| **w > 0.0).map(|(s, w)| s * w).sum()
    }

    /// Parameters that the image points determine, poses excluded.
    pub fn parameters(&self) -> usize {
        self.unknowns - self.datum.as_ref().map_or(0, |_| Datum::HELD)
    }

    /// The runs of a view.
    pub fn runs(&self, view: &ViewRange) -> impl Iterator<Item = Run> + '_ {
        let ViewRange { device: own, pose, mut start, end } = *view;
        let kind = move |number: &usize| {
            let linked = self.links[*number].as_ref().map(|l| l.device);
            (linked, self.board.face(self.image_points[*number].index))
        };
        std::iter::from_fn(move || {
            let (linked, face) = (start < end).then(|| kind(&start))?;
            let first = start;
            start = (first..end).find(|number| kind(number) != (linked, face)).unwrap_or(end);
            Some(Run { device: own, pose, linked, face, start: first, end: start })
        })
    }

    /// Column of each parameter of a run's equations, pose excluded.
    pub fn run_columns(&self, run: &Run) -> Vec<Option<usize>> {
        let own = self.columns[run.device].iter().chain(self.columns.last().into_iter().flatten()).copied();
        let linked = (0..DEVICE).map(|i| run.linked.and_then(|device| self.columns[device][i]));
        let of_face = self.faces.get(run.face).copied().flatten();
        let face = (0..FACE).map(|i| of_face.map(|first| first + i));
        own.chain([None; POSE]).chain(linked).chain(face).collect()
    }

    /// What looks at the image points of a run; `None` without a pose.
    pub fn eyes<'s>(state: &'s State, run: &Run) -> Option<Eyes<'s>> {
        let board = state.boards[run.pose].as_ref()?;
        let eye = |device: usize| Projector::new(&state.cameras[device], board);
        Some(Eyes { own: eye(run.device), linked: run.linked.map(eye) })
    }

    /// The whitened residual of an image point's own error and its derivatives; `None` behind a device.
    pub fn equations(&self, state: &State, eyes: &Eyes, number: usize) -> Option<([f64; 2], WideRows)> {
        let image_point = &self.image_points[number];
        let point = self.board.point(image_point.index, &state.shape);
        let rise = self.board.rise[image_point.index];
        let off = |seen: &Point2<f64>, model: Point2<f64>| [seen.x - model.x, seen.y - model.y];
        let (pixel, rows) = eyes.own.rows(&point, rise)?;
        let mut residual = off(&image_point.pixel, pixel);
        let mut wide = [[0.0; WIDE]; 2];
        for (wide, row) in wide.iter_mut().zip(&rows) {
            wide[..LOCAL].copy_from_slice(row);
        }
        if let (Some(link), Some(eye)) = (&self.links[number], &eyes.linked) {
            let (pixel, rows) = eye.rows(&point, rise)?;
            let other = off(&self.image_points[link.image_point].pixel, pixel);
            for (i, wide) in wide.iter_mut().enumerate() {
                for (j, row) in rows.iter().enumerate() {
                    let slope = link.slopes[(i, j)];
                    residual[i] -= slope * other[j];
                    // Target and pose are common to both, the devices are not.
                    wide[DEVICE..LOCAL].iter_mut().zip(&row[DEVICE..]).for_each(|(w, v)| *w -= slope * v);
                    wide[LOCAL..OF_FACE].iter_mut().zip(&row[..DEVICE]).for_each(|(w, v)| *w -= slope * v);
                }
            }
        }
        if let Some(face) = state.shape.faces.get(self.board.face(image_point.index)) {
            let local = self.board.points[image_point.index];
            for wide in &mut wide {
                // The derivatives by the point are those by the shift of its pose.
                let by_point = Vector3::from_column_slice(&wide[LOCAL - 3..LOCAL]);
                let by_face = face.rotation.inverse() * by_point;
                wide[OF_FACE..OF_FACE + 3].copy_from_slice(local.cross(&by_face).as_slice());
                wide[OF_FACE + 3..].copy_from_slice(by_face.as_slice());
            }
        }
        let [a, b, c] = self.whiten[number];
        let [first, second] = &mut wide;
        for (first, second) in first.iter_mut().zip(second) {
            *second = b * *first + c * *second;
            *first *= a;
        }
        Some((self.whitened(number, residual), wide))
    }
}
