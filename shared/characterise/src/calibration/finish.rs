//! From the solution of the adjustment to the result in the requested world frame.

use super::CalibrationError;
use super::adjust::Weighted;
use super::covariance::{Covariance, Gauge, covariance};
use super::model::{Board, DEVICE, compose};
use super::observations::Observations;
use super::problem::{Problem, ViewRange};
use super::result::{CalibratedDevice, Calibration, FacePlace, Outlier, Residual, ViewReport, Warp};
use super::settings::{CalibrationSettings, TargetShape, WorldFrame};
use super::start::{ViewHomography, open, remedy};
use fringe::math::atan2;
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion};

/// What the parts below need.
pub(super) struct Finish<'a> {
    /// The observations that were adjusted.
    pub observations: &'a Observations,
    /// Settings of the calibration.
    pub settings: &'a CalibrationSettings,
    /// The target and its points.
    pub board: &'a Board,
    /// Observations and unknowns of the adjustment.
    pub problem: &'a Problem<'a>,
    /// Views used, in the order of the problem.
    pub seen: &'a [ViewHomography],
    /// Which of them were turned.
    pub turned: &'a [bool],
    /// The solution with its weights.
    pub weighted: &'a Weighted,
}

impl Finish<'_> {
    /// Checks the solution and reports it.
    pub fn run(&self) -> Result<Calibration, CalibrationError> {
        let solved = &self.weighted.solved;
        self.refuse_outliers()?;
        if !solved.settled {
            let (stage, iterations) = ("joint adjustment".to_owned(), self.weighted.iterations);
            return Err(CalibrationError::NoConvergence { stage, iterations });
        }
        let used = self.weighted.weights.iter().filter(|w| **w > 0.0).count();
        let parameters = self.problem.parameters() + 6 * solved.state.boards.iter().flatten().count();
        let degrees_of_freedom = (2 * used).saturating_sub(parameters);
        let variance = solved.normal.cost / degrees_of_freedom.max(1) as f64;
        let scale = if self.settings.estimate_noise { 1.0 } else { variance };
        let covariance = covariance(self.problem, &solved.state, &solved.normal, scale);
        let covariance = covariance.ok_or_else(|| self.degenerate(0, "all parameters".into()))?;
        self.refuse_open(&covariance)?;
        let origin: Vec<(usize, bool)> =
            self.seen.iter().map(|s| s.view).zip(self.turned.iter().copied()).collect();
        let views = reports(self.problem, self.weighted, &origin);
        let devices =
            (0..self.observations.devices.len()).map(|d| self.device(d, &views, &covariance)).collect();
        let outliers = views.iter().flat_map(outliers).collect();
        let bent = |i: usize| Point3::from(self.board.point(i, &solved.state.shape) + self.board.centre);
        let mut calibration = Calibration {
            devices,
            boards: self.boards(),
            warp: self.warp(&covariance),
            target_misfit: self.problem.misfit(
                &solved.state,
                &self.weighted.weights,
                solved.normal.cost,
                degrees_of_freedom,
            ),
            faces: self.faces(),
            target_mm: (0..self.board.points.len()).map(bent).collect(),
            unused_views: self.unused(),
            views,
            outliers,
            covariance,
            sigma0: variance.sqrt(),
            degrees_of_freedom,
            iterations: self.weighted.iterations,
        };
        if self.settings.world == WorldFrame::FirstBoard {
            into_first_board(&mut calibration);
        }
        Ok(calibration)
    }

    fn refuse_outliers(&self) -> Result<(), CalibrationError> {
        let limit = self.settings.max_outlier_fraction;
        for (number, device) in self.observations.devices.iter().enumerate() {
            let own =
                || self.problem.views.iter().filter(|v| v.device == number).flat_map(|v| v.start..v.end);
            let (points, outliers) =
                (own().count(), own().filter(|i| self.weighted.weights[*i] == 0.0).count());
            if outliers as f64 > limit * points as f64 {
                return Err(CalibrationError::Outliers {
                    device: device.name.clone(),
                    outliers,
                    points,
                    limit,
                    worst: self.wrong_poses(number),
                });
            }
        }
        Ok(())
    }

    /// The poses in which all points of a device are outliers.
    fn wrong_poses(&self, device: usize) -> Vec<String> {
        let wrong = |v: &&ViewRange| (v.start..v.end).all(|i| self.weighted.weights[i] == 0.0);
        let own = self.problem.views.iter().filter(|v| v.device == device);
        own.filter(wrong).map(|v| self.observations.poses[v.pose].clone()).collect()
    }

    fn refuse_open(&self, covariance: &Covariance) -> Result<(), CalibrationError> {
        for (number, camera) in self.weighted.solved.state.cameras.iter().enumerate() {
            let u = covariance.standard_uncertainty(Gauge::FirstDevice, number);
            if let Some(what) = open(camera, &u) {
                return Err(self.degenerate(number, what));
            }
        }
        Ok(())
    }

    fn degenerate(&self, device: usize, what: String) -> CalibrationError {
        let state = &self.weighted.solved.state;
        let own: Vec<Isometry3<f64>> = self
            .seen
            .iter()
            .filter(|s| s.device == device)
            .filter_map(|s| state.boards[s.pose].map(|b| state.cameras[device].camera_from_world * b))
            .collect();
        CalibrationError::Degenerate {
            device: self.observations.devices[device].name.clone(),
            views: own.len(),
            what,
            remedy: remedy(own.iter()),
        }
    }

    fn device(&self, number: usize, views: &[ViewReport], covariance: &Covariance) -> CalibratedDevice {
        let device = &self.observations.devices[number];
        let own = || views.iter().filter(|v| v.device == number);
        let residuals = || own().flat_map(|v| v.residuals.iter());
        let points = residuals().filter(|r| r.used).count();
        CalibratedDevice {
            name: device.name.clone(),
            kind: device.kind,
            camera: self.weighted.solved.state.cameras[number].clone(),
            rms_reprojection_px: rms(residuals()),
            views: own().filter(|v| v.residuals.iter().any(|r| r.used)).count(),
            points,
            outliers: residuals().count() - points,
            noise_factor: self.weighted.variances[number].sqrt(),
            standard_uncertainty: covariance.standard_uncertainty(Gauge::FirstDevice, number),
        }
    }

    /// Poses of the target's own origin, not its centre.
    fn boards(&self) -> Vec<Option<Isometry3<f64>>> {
        let centred = Translation3::from(-self.board.centre);
        self.weighted.solved.state.boards.iter().map(|b| b.map(|b| b * centred)).collect()
    }

    fn warp(&self, covariance: &Covariance) -> Option<Warp> {
        let first = DEVICE * self.observations.devices.len();
        let u = |i: usize| covariance.at(Gauge::FirstDevice, first + i, first + i).max(0.0).sqrt();
        let [x_mm, y_mm] = self.weighted.solved.state.shape.warp_mm;
        (self.settings.target == TargetShape::Bent).then(|| Warp { x_mm, y_mm, u_mm: [u(0), u(1)] })
    }

    /// Places of the faces beside those that were declared.
    fn faces(&self) -> Vec<FacePlace> {
        if self.settings.target == TargetShape::Free {
            return Vec::new();
        }
        let found = self.weighted.solved.state.shape.faces.iter().zip(&self.board.declared);
        let place = |(number, (found, declared)): (usize, (&Isometry3<f64>, &Isometry3<f64>))| FacePlace {
            name: self.observations.faces[number].name.clone(),
            adjusted: self.problem.faces.get(number).is_some_and(Option::is_some),
            middle_mm: found.translation.vector.into(),
            shift_mm: (found.translation.vector - declared.translation.vector).norm(),
            turn_rad: angle_rad(&found.rotation, &declared.rotation),
        };
        found.enumerate().map(place).collect()
    }

    fn unused(&self) -> Vec<usize> {
        (0..self.observations.views.len()).filter(|v| self.seen.iter().all(|s| s.view != *v)).collect()
    }
}

/// All views of an adjustment with their residuals; `origin` gives each one's number and whether it was turned.
pub(super) fn reports(problem: &Problem, weighted: &Weighted, origin: &[(usize, bool)]) -> Vec<ViewReport> {
    let errors = problem.residuals(&weighted.solved.state);
    let report = |(range, (view, turned)): (&ViewRange, &(usize, bool))| {
        let residuals: Vec<Residual> = (range.start..range.end)
            .map(|i| Residual {
                index: problem.image_points[i].index,
                pixel: problem.image_points[i].pixel,
                error_px: errors[i],
                used: weighted.weights[i] > 0.0,
            })
            .collect();
        let rms_px = rms(residuals.iter());
        ViewReport { view: *view, device: range.device, pose: range.pose, turned: *turned, rms_px, residuals }
    };
    problem.views.iter().zip(origin).map(report).collect()
}

/// Angle between two orientations, 0 … π.
fn angle_rad(a: &UnitQuaternion<f64>, b: &UnitQuaternion<f64>) -> f64 {
    let between = a.inverse() * b;
    2.0 * atan2(between.imag().norm(), between.w.abs())
}

/// Root mean squared distance over the points used; 0 of none.
pub(super) fn rms<'a>(residuals: impl Iterator<Item = &'a Residual>) -> f64 {
    let (mut sum, mut count) = (0.0, 0);
    for [x, y] in residuals.filter(|r| r.used).filter_map(|r| r.error_px) {
        sum += x * x + y * y;
        count += 1;
    }
    (sum / f64::from(count.max(1))).sqrt()
}

fn outliers(report: &ViewReport) -> impl Iterator<Item = Outlier> + '_ {
    let rejected = report.residuals.iter().filter(|r| !r.used);
    rejected.map(|r| Outlier { view: report.view, index: r.index, error_px: r.error_px })
}

/// Makes the first pose's board the world.
fn into_first_board(calibration: &mut Calibration) {
    let Some(first) = calibration.boards.iter().flatten().next().copied() else { return };
    for device in &mut calibration.devices {
        device.camera.camera_from_world = compose(&device.camera.camera_from_world, &first);
    }
    let first_from_world = first.inverse();
    for board in calibration.boards.iter_mut().flatten() {
        *board = compose(&first_from_world, board);
    }
}
