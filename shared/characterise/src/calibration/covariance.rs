//! Covariance of the devices, (JᵀJ)⁻¹ with the poses eliminated, in two gauges.
//!
//! The world may be moved as a whole without changing any pixel, so a covariance needs a statement of what is held.
//! - *First device*: its frame is the world. Extrinsics are relative poses, which is how they are reported.
//! - *Boards*: the mean of all target points (their best-fitting rigid motion) is held. It shows how well a device
//!   sees the working volume, the first one included: the question of projection uncertainty.
//!
//! Distances have the same uncertainty in both.

use super::factorised::Factorised;
use super::model::{Board, DEVICE, FURTHER, INTRINSIC, POSE, State, WARP};
use super::normal::Normal;
use super::problem::Problem;
use fringe::math::linear::{Dense, Factor, dot};
use nalgebra::{Isometry3, Vector3};

/// What is held fixed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Gauge {
    /// The frame of the first device.
    FirstDevice,
    /// The mean of the target's points over all poses.
    Boards,
}

/// Names of a device's parameters, in the order of the covariance: px, 1, then rad and mm in the device's own frame
/// (X ↦ exp(ω) X + τ), then the coefficients that only some lenses have.
pub const PARAMETERS: [&str; DEVICE] = [
    "fx_px", "fy_px", "cx_px", "cy_px", "skew", "k1", "k2", "k3", "p1", "p2", "rx_rad", "ry_rad", "rz_rad",
    "tx_mm", "ty_mm", "tz_mm", "k4", "k5", "k6", "s1", "s2", "s3", "s4",
];

/// Number of the parameters that each lens has: the first ones of [`PARAMETERS`].
pub const COMMON_PARAMETERS: usize = FURTHER;

/// Covariance of all devices' parameters and the warp.
///
/// Parameter i of device d stands at d · n + i (see [`PARAMETERS`], n in all), the two of the warp at the end; rows of parameters
/// that were not adjusted are zero.
#[derive(Debug, Clone, PartialEq)]
pub struct Covariance {
    first_device: Dense,
    boards: Dense,
}

impl Covariance {
    /// Number of rows of the covariance.
    pub fn size(&self) -> usize {
        self.first_device.rows
    }

    /// An entry; 0 beyond the matrix.
    pub fn at(&self, gauge: Gauge, row: usize, column: usize) -> f64 {
        let matrix = self.matrix(gauge);
        if row < matrix.rows && column < matrix.cols { matrix.at(row, column) } else { 0.0 }
    }

    /// Standard uncertainties of a device's parameters.
    pub fn standard_uncertainty(&self, gauge: Gauge, device: usize) -> [f64; DEVICE] {
        std::array::from_fn(|i| self.at(gauge, DEVICE * device + i, DEVICE * device + i).max(0.0).sqrt())
    }

    pub(super) fn matrix(&self, gauge: Gauge) -> &Dense {
        match gauge {
            Gauge::FirstDevice => &self.first_device,
            Gauge::Boards => &self.boards,
        }
    }
}

/// The covariance at a solution; `None` when the reduced matrix is singular. `variance` scales it.
pub(super) fn covariance(
    problem: &Problem,
    state: &State,
    normal: &Normal,
    variance: f64,
) -> Option<Covariance> {
    let inverses = normal.pose_inverses(0.0).ok()?;
    let reduced = normal.factorised(problem.ridge)?;
    let full = DEVICE * state.cameras.len() + WARP;
    // Place of the devices' and the warp's unknowns in the full matrix; those of target points come after them.
    let place: Vec<(usize, usize)> = problem
        .columns
        .iter()
        .flatten()
        .enumerate()
        .filter_map(|(position, column)| Some((column.as_ref().copied()?, position)))
        .collect();
    let mut first_device = Dense::zeros(full, full);
    for (column, col) in &place {
        let mut unit = vec![0.0; problem.unknowns];
        unit[*column] = variance;
        let solved = reduced.solve(&unit);
        for (other, row) in &place {
            first_device.set(*row, *col, solved[*other]);
        }
    }
    symmetric(&mut first_device);
    let boards = hold_boards(problem, state, normal, &inverses, &first_device, (&reduced, &place), variance)?;
    Some(Covariance { first_device, boards })
}

/// Copies the lower triangle: the solutions of both halves differ by rounding.
fn symmetric(matrix: &mut Dense) {
    for i in 0..matrix.rows {
        for j in 0..i {
            matrix.set(j, i, matrix.at(i, j));
        }
    }
}

/// Moves the covariance into the gauge of the boards.
///
/// With δp = −V⁻¹Wᵀ δu + ε for each pose (u: devices, warp and target points) and B its share in the mean motion g of all
/// points, g = −Q δu + Σ B ε with Q = Σ B V⁻¹ Wᵀ. Taking the motion out of the devices, δd′ = δd − D g has the covariance
/// Σ_dd + D QΣ_ud + (D QΣ_ud)ᵀ + D (Q Σ_uu Qᵀ + Σ B V⁻¹ Bᵀ) Dᵀ.
fn hold_boards(
    problem: &Problem,
    state: &State,
    normal: &Normal,
    inverses: &[Option<Dense>],
    first_device: &Dense,
    (reduced, place): (&Factorised, &[(usize, usize)]),
    variance: f64,
) -> Option<Dense> {
    let n = first_device.rows;
    let (middle, shares) = motion_shares(problem.board, state, inverses)?;
    let (mut q, mut inner) = (Dense::zeros(POSE, problem.unknowns), Dense::zeros(POSE, POSE));
    for (pose, (share, inverse)) in shares.iter().zip(inverses).enumerate() {
        let (Some(share), Some(inverse), Some(coupling)) = (share, inverse, normal.coupling(pose)) else {
            continue;
        };
        let both = share.times(inverse);
        inner = inner.plus(&both.times(&share.transposed()));
        q = q.plus(&both.times(&coupling.transposed()));
    }
    let spread: Vec<Vec<f64>> = (0..POSE).map(|i| reduced.solve(q.row(i))).collect();
    inner = inner.plus(&Dense::from_fn(POSE, POSE, |i, j| dot(&spread[i], q.row(j))));
    let mut mixed = Dense::zeros(POSE, n);
    for (column, position) in place {
        for (i, own) in spread.iter().enumerate() {
            mixed.set(i, *position, own[*column]);
        }
    }
    let d = device_motion(state, &middle, n);
    let (turned, noise) = (d.times(&mixed), d.sandwich(&inner));
    let added = |i: usize, j: usize| turned.at(i, j) + turned.at(j, i) + noise.at(i, j);
    let mut boards = Dense::from_fn(n, n, |i, j| first_device.at(i, j) + variance * added(i, j));
    symmetric(&mut boards);
    Some(boards)
}

/// Steps of all devices (full size × 6) when the world moves by X ↦ X + ω × (X − middle) + τ.
fn device_motion(state: &State, middle: &Vector3<f64>, n: usize) -> Dense {
    let mut motion = Dense::zeros(n, POSE);
    for (number, camera) in state.cameras.iter().enumerate() {
        let r = camera.camera_from_world.rotation.to_rotation_matrix().into_inner();
        let seen = r * middle + camera.camera_from_world.translation.vector;
        for axis in 0..3 {
            let turn: Vector3<f64> = r.column(axis).into_owned();
            let shift = turn.cross(&seen);
            for row in 0..3 {
                let at = DEVICE * number + INTRINSIC + row;
                motion.set(at, axis, -turn[row]);
                motion.set(at + 3, axis, shift[row]);
                motion.set(at + 3, axis + 3, -turn[row]);
            }
        }
    }
    motion
}

/// The middle of all target points in the world, and how the step of each pose moves their best-fitting frame.
fn motion_shares(
    board: &Board,
    state: &State,
    inverses: &[Option<Dense>],
) -> Option<(Vector3<f64>, Vec<Option<Dense>>)> {
    let shown = board.rigid_points(&state.shape);
    let used: Vec<Option<&Isometry3<f64>>> =
        state.boards.iter().zip(inverses).map(|(b, i)| b.as_ref().filter(|_| i.is_some())).collect();
    let count = (used.iter().flatten().count() * shown.len()).max(1) as f64;
    let points = || {
        used.iter().flatten().flat_map(|b| shown.iter().map(|p| (**b * nalgebra::Point3::from(*p)).coords))
    };
    let middle = points().fold(Vector3::zeros(), |sum, p| sum + p) / count;
    let mut normal = Dense::zeros(POSE, POSE);
    for point in points() {
        let rows = rigid(&(point - middle));
        for (i, a) in rows.iter().enumerate() {
            for (j, b) in rows.iter().enumerate() {
                normal.add(i, j, a.dot(b));
            }
        }
    }
    let inverse = Factor::new(&normal).ok()?.inverse();
    let share = |pose: &Isometry3<f64>| {
        let r = pose.rotation.to_rotation_matrix().into_inner();
        let mut sum = Dense::zeros(POSE, POSE);
        for point in &shown {
            let world = rigid(&((pose * nalgebra::Point3::from(*point)).coords - middle));
            for (j, step) in rigid(point).iter().map(|s| r * s).enumerate() {
                for (i, a) in world.iter().enumerate() {
                    sum.add(i, j, a.dot(&step));
                }
            }
        }
        inverse.times(&sum)
    };
    Some((middle, used.into_iter().map(|pose| pose.map(share)).collect()))
}

/// Velocities of a point under the six unit steps ω, τ.
fn rigid(point: &Vector3<f64>) -> [Vector3<f64>; POSE] {
    let [x, y, z] = [Vector3::x(), Vector3::y(), Vector3::z()];
    [x.cross(point), y.cross(point), z.cross(point), x, y, z]
}
