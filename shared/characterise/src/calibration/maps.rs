//! Maps of the predicted uncertainty on planes through the working volume.

use super::result::Calibration;
use super::spacing::{SpacingSettings, Volume, directions};
use nalgebra::{Point3, Vector3};

/// Predicted values on a plane of constant z of a volume; x runs along a row, y from row to row.
#[derive(Debug, Clone, PartialEq)]
pub struct UncertaintyMap {
    /// Height of the plane in the volume's frame, mm.
    pub z_mm: f64,
    /// Values in a row.
    pub columns: usize,
    /// Row by row; NaN where nothing can be measured.
    pub values: Vec<f64>,
}

/// Where maps are computed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MapGrid {
    /// Places along the longer edge of the volume; the shorter one has as many as its length gives.
    pub across: usize,
    /// Planes from the bottom to the top of the volume.
    pub planes: usize,
}

impl MapGrid {
    /// Fills all planes of a volume by the function of a world point.
    pub fn fill(&self, volume: &Volume, value: impl Fn(&Point3<f64>) -> Option<f64>) -> Vec<UncertaintyMap> {
        let half = volume.half_mm;
        let longer = half.x.max(half.y);
        let count = |edge: f64| ((edge / longer * self.across as f64).round() as usize).max(1);
        let (columns, rows) = (count(half.x), count(half.y));
        // Middles of cells, so that the images end where the volume does.
        let middle = |i: usize, n: usize| (2.0 * i as f64 + 1.0) / n as f64 - 1.0;
        let plane = |number: usize| {
            let z_mm = if self.planes < 2 {
                0.0
            } else {
                half.z * (2.0 * number as f64 / (self.planes - 1) as f64 - 1.0)
            };
            let at = |i: usize| {
                let (x, y) = (half.x * middle(i % columns, columns), half.y * middle(i / columns, rows));
                volume.world_from_volume * Point3::new(x, y, z_mm)
            };
            let values = (0..columns * rows).map(|i| value(&at(i)).unwrap_or(f64::NAN)).collect();
            UncertaintyMap { z_mm, columns, values }
        };
        (0..self.planes).map(plane).collect()
    }
}

impl Calibration {
    /// Standard uncertainty of a device's projection, px; outside its image there is none.
    pub fn projection_maps(&self, device: usize, volume: &Volume, grid: &MapGrid) -> Vec<UncertaintyMap> {
        let value = |point: &Point3<f64>| {
            let camera = &self.devices.get(device)?.camera;
            camera.contains(camera.project(point)?).then_some(())?;
            self.projection_u_px(device, point)
        };
        grid.fill(volume, value)
    }

    /// Standard uncertainty of a point by the calibration along one axis of the volume (0, 1, 2), mm: what stays the same in
    /// each measurement.
    pub fn point_maps(
        &self,
        pair: [usize; 2],
        axis: usize,
        volume: &Volume,
        grid: &MapGrid,
    ) -> Vec<UncertaintyMap> {
        let along = volume.world_from_volume.rotation * axis_vector(axis);
        let value = |point: &Point3<f64>| {
            self.sees(&pair, point).then_some(())?;
            let u = self.point_uncertainty(pair, point, [0.0; 2])?;
            Some(along.dot(&(u.systematic_mm2 * along)).max(0.0).sqrt())
        };
        grid.fill(volume, value)
    }

    /// Largest standard uncertainty of a sphere spacing from a place to another one within the volume, over all directions
    /// that the pair sees, mm.
    pub fn spacing_maps(
        &self,
        pair: [usize; 2],
        volume: &Volume,
        grid: &MapGrid,
        settings: &SpacingSettings,
    ) -> Vec<UncertaintyMap> {
        let to_volume = volume.world_from_volume.inverse();
        let inside = |point: &Point3<f64>| {
            let own = to_volume * point;
            (0..3).all(|i| own[i].abs() <= volume.half_mm[i] * (1.0 + 1e-9))
        };
        let value = |from: &Point3<f64>| {
            let worst = directions()
                .flat_map(|direction| [direction, -direction])
                .map(|direction| from + volume.world_from_volume.rotation * direction * settings.spacing_mm)
                .filter(inside)
                .filter_map(|to| self.spacing_variance_mm2(&pair, &[*from, to], settings))
                .fold(f64::NEG_INFINITY, f64::max);
            worst.is_finite().then(|| worst.sqrt())
        };
        grid.fill(volume, value)
    }
}

fn axis_vector(axis: usize) -> Vector3<f64> {
    Vector3::from_fn(|i, _| if i == axis { 1.0 } else { 0.0 })
}
