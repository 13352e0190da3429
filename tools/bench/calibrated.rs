//! A calibration of the twin's rig from drawn corner errors, for benchmarks that measure with it.

use super::calibration::board::Cell;
use super::calibration::solve;
use anyhow::{Context, Result};
use characterise::calibration::{Calibration, Gauge, Mode, PARAMETERS, TargetShape, modes};
use characterise::health::{PairCovariance, ViewCovariance};
use fringe::geometry::camera::Camera;
use fringe::geometry::rig::{Named, Rig};

/// Corner errors of cameras and projectors, px.
const CORNERS_PX: [f64; 2] = [0.006, 0.012];

/// A calibrated rig in the world of the true one, and its covariance.
pub struct Calibrated {
    /// As adjusted, in the frame of its first device.
    pub found: Calibration,
    /// The same with the first camera where it truly is.
    pub rig: Rig,
    /// The rig as it truly is.
    pub truth: Rig,
}

impl Calibrated {
    /// From drawn corner errors and poses of this seed.
    pub fn new(cell: &Cell, seed: u64) -> Result<Self> {
        let noise: Vec<f64> = (0..cell.devices().len())
            .map(|device| CORNERS_PX[usize::from(device >= cell.rig.cameras.len())])
            .collect();
        let boards = cell.plan.boards(200_000 + seed, cell.plan.poses);
        let found = solve(&cell.draw(&boards, 200_000 + seed, &noise), TargetShape::Bent)?;
        // The first camera is common to both worlds.
        let first = cell.rig.cameras.first().context("a rig has cameras")?.camera.camera_from_world;
        let ours_from_true = found.devices[0].camera.camera_from_world.inverse() * first;
        let named = |name: &str| {
            let camera = found.device(name).map(|device| device.camera.clone()).context("a known device")?;
            let camera_from_world = camera.camera_from_world * ours_from_true;
            Ok(Named { name: name.to_owned(), camera: Camera { camera_from_world, ..camera } })
        };
        let all = |list: &[Named]| list.iter().map(|n| named(&n.name)).collect::<Result<Vec<_>>>();
        let rig = Rig {
            cameras: all(&cell.rig.cameras)?,
            projectors: all(&cell.rig.projectors)?,
            pairs: cell.rig.pairs.clone(),
            ..Rig::default()
        };
        Ok(Self { rig, truth: cell.rig.clone(), found })
    }

    /// A camera or projector by its name.
    pub fn device(&self, name: &str) -> Result<&Camera> {
        self.rig.device(name).context("a known device")
    }

    /// Covariance of two devices.
    pub fn covariance(&self, left: &str, right: &str) -> Result<PairCovariance> {
        let names = PARAMETERS.map(str::to_owned).to_vec();
        Ok(PairCovariance { names: [names.clone(), names], matrix: self.part(&[left, right])? })
    }

    /// Covariance of the partners of a view, then of the view itself.
    pub fn joint(&self, devices: &[&str]) -> Result<ViewCovariance> {
        let names = PARAMETERS.map(str::to_owned).to_vec();
        Ok(ViewCovariance { blocks: (0..devices.len()).collect(), names, matrix: self.part(devices)? })
    }

    /// The part of the covariance that belongs to some devices, row by row.
    fn part(&self, devices: &[&str]) -> Result<Vec<f64>> {
        let place =
            |name: &&str| self.found.devices.iter().position(|d| d.name == *name).context("a known device");
        let places: Vec<usize> = devices.iter().map(place).collect::<Result<_>>()?;
        let n = PARAMETERS.len();
        let rows: Vec<usize> = places.iter().flat_map(|place| (0..n).map(move |i| place * n + i)).collect();
        let at = |a: usize, b: usize| self.found.covariance.at(Gauge::FirstDevice, a, b);
        Ok(rows.iter().flat_map(|a| rows.iter().map(|b| at(*a, *b))).collect())
    }

    /// What the covariance leaves open, as motions of points.
    pub fn modes(&self) -> Result<Vec<Mode>> {
        let (n, devices) = (PARAMETERS.len(), self.found.devices.len());
        let size = n * devices;
        let covariance = &self.found.covariance;
        let matrix: Vec<f64> =
            (0..size * size).map(|k| covariance.at(Gauge::FirstDevice, k / size, k % size)).collect();
        let names: Vec<String> = self.found.devices.iter().map(|device| device.name.clone()).collect();
        modes(&self.rig, &names, n, &matrix).context("all views of the pairs are calibrated")
    }
}
