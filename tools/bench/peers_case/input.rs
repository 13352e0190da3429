//! The inputs: NumPy files and `calib.json` in one folder.

use super::Bench;
use anyhow::{Context, Result, ensure};
use files::document::read_bytes;
use files::npy::{Array, Values, read_array};
use fringe::geometry::camera::{Camera, Lens};
use fringe::geometry::pose::Pose;
use nalgebra::{Matrix3, Point3, Vector3};
use serde::Deserialize;

/// Largest `calib.json` that is read.
const LARGEST_BYTES: u64 = 1 << 20;

/// A camera as the script writes it.
#[derive(Deserialize)]
#[allow(non_snake_case, reason = "keys of the foreign file")]
struct ForeignCamera {
    K: [[f64; 3]; 3],
    dist: [f64; 5],
    R: [[f64; 3]; 3],
    C: [f64; 3],
}

#[derive(Deserialize)]
struct Calibration {
    cams: [ForeignCamera; 2],
}

impl Bench {
    fn array(&self, name: &str) -> Result<Array> {
        Ok(read_array(&self.input.join(format!("{name}.npy")))?)
    }

    /// An array of bytes with its shape.
    pub(super) fn bytes(&self, name: &str) -> Result<(Vec<usize>, Vec<u8>)> {
        let array = self.array(name)?;
        match array.values {
            Values::U8(values) => Ok((array.shape, values)),
            _ => anyhow::bail!("{name}.npy holds no uint8"),
        }
    }

    /// An array of numbers with its shape, in double precision.
    pub(super) fn numbers(&self, name: &str) -> Result<(Vec<usize>, Vec<f64>)> {
        let array = self.array(name)?;
        let values = match array.values {
            Values::U8(values) => values.into_iter().map(f64::from).collect(),
            Values::F32(values) => values.into_iter().map(f64::from).collect(),
            Values::F64(values) => values,
        };
        Ok((array.shape, values))
    }

    /// An array of single precision, a number for each pixel.
    pub(super) fn picture(&self, name: &str) -> Result<Vec<f32>> {
        let Array { shape, values } = self.array(name)?;
        self.of_pixels(name, &shape)?;
        match values {
            Values::F32(values) => Ok(values),
            _ => anyhow::bail!("{name}.npy holds no float32"),
        }
    }

    /// An array of bytes, one for each pixel.
    pub(super) fn marks(&self, name: &str) -> Result<Vec<u8>> {
        let (shape, values) = self.bytes(name)?;
        self.of_pixels(name, &shape)?;
        Ok(values)
    }

    /// Refuses an array that has not one number for each pixel.
    fn of_pixels(&self, name: &str, shape: &[usize]) -> Result<()> {
        let (width, height) = self.image_size()?;
        ensure!(
            shape == [height as usize, width as usize],
            "{name}.npy has shape {shape:?} where {height} x {width}, the rows and columns of --size, is needed"
        );
        Ok(())
    }

    /// A matrix of so many rows and columns, row by row.
    pub(super) fn matrix(&self, name: &str, rows: usize, columns: usize) -> Result<Vec<f64>> {
        let (shape, values) = self.numbers(name)?;
        ensure!(
            shape == [rows, columns],
            "{name}.npy has shape {shape:?} where {rows} x {columns} is needed"
        );
        ensure!(values.iter().all(|v| v.is_finite()), "{name}.npy holds values that are no finite numbers");
        Ok(values)
    }

    /// Points in rows of three.
    pub(super) fn points(&self, name: &str) -> Result<Vec<Point3<f64>>> {
        let (shape, values) = self.numbers(name)?;
        ensure!(shape.len() == 2 && shape[1] == 3, "{name}.npy has shape {shape:?} where n x 3 is needed");
        let least = 4;
        ensure!(shape[0] >= least, "{name}.npy holds {} points where {least} are needed at least", shape[0]);
        ensure!(
            values.iter().all(|v| v.is_finite()),
            "{name}.npy holds points that have no place (not finite)"
        );
        Ok(values.as_chunks::<3>().0.iter().map(|p| Point3::new(p[0], p[1], p[2])).collect())
    }

    /// Both cameras of the pair.
    pub(super) fn cameras(&self) -> Result<[Camera; 2]> {
        let (width_px, height_px) = self.image_size()?;
        let path = self.input.join("calib.json");
        let text = read_bytes(&path, LARGEST_BYTES)?;
        let calibration: Calibration =
            serde_json::from_slice(&text).with_context(|| path.display().to_string())?;
        Ok(calibration.cams.map(|cam| {
            let rotation = Matrix3::from_fn(|r, c| cam.R[r][c]);
            let translation = -(rotation * Vector3::from(cam.C));
            let [k1, k2, p1, p2, k3] = cam.dist;
            Camera {
                width_px,
                height_px,
                focal_px: [cam.K[0][0], cam.K[1][1]],
                principal_point_px: [cam.K[0][2], cam.K[1][2]],
                skew: cam.K[0][1],
                distortion: Lens::brown_conrady([k1, k2, k3], [p1, p2]),
                camera_from_world: Pose { rotation, translation }.isometry(),
            }
        }))
    }
}
