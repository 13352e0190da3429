//! Normal equations with the poses eliminated (Schur complement), in a fixed order of sums.

use super::datum::Datum;
use super::dense::{Dense, Factor, dot};
use super::model::{Board, DEVICE, INTRINSIC, LOCAL, POSE, Projector, Rows, State, WARP};
use super::observations::Sight;
use super::settings::{LensModel, TargetShape};

/// A view as the adjustment sees it: sights `start .. end` of the flat list.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct ViewRange {
    /// Device.
    pub device: usize,
    /// Pose.
    pub pose: usize,
    /// First sight.
    pub start: usize,
    /// One past the last sight.
    pub end: usize,
}

/// What does not change during an adjustment.
#[derive(Debug, Clone)]
pub(super) struct Problem<'a> {
    /// The target.
    pub board: &'a Board,
    /// Views in a fixed order.
    pub views: Vec<ViewRange>,
    /// All sights, view by view.
    pub sights: Vec<Sight>,
    /// Lower triangle (a, b, c) of the whitening matrix of each sight: r ↦ (a r₀, b r₀ + c r₁).
    pub whiten: Vec<[f64; 3]>,
    /// Column of each device's parameters and of the warp (last) in the reduced system; `None` where fixed.
    pub columns: Vec<Vec<Option<usize>>>,
    /// Size of the reduced system.
    pub unknowns: usize,
    /// What holds the target's points when they are adjusted; their columns are the last ones.
    pub datum: Option<Datum>,
}

/// Inverse Cholesky factor of a checked covariance.
pub(super) fn whitening(sight: &Sight) -> [f64; 3] {
    let c = &sight.covariance_px2;
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
            _ => device > 0,
        };
        columns.push((0..DEVICE).map(|local| take(free(local))).collect());
    }
    columns.push((0..WARP).map(|_| take(target == TargetShape::Bent)).collect());
    (columns, next)
}

impl Problem<'_> {
    /// Column of each local parameter of a device's view, pose excluded.
    fn local_columns(&self, device: usize) -> impl Iterator<Item = Option<usize>> + '_ {
        self.columns[device].iter().chain(self.columns.last().into_iter().flatten()).copied()
    }

    /// The whitened residual (seen − model) of a sight.
    #[inline]
    pub fn whitened(&self, sight: usize, residual: [f64; 2]) -> [f64; 2] {
        let [a, b, c] = self.whiten[sight];
        [a * residual[0], b * residual[0] + c * residual[1]]
    }

    /// Residual in px (seen − model) of each sight; `None` behind the device or without a pose.
    pub fn residuals(&self, state: &State) -> Vec<Option<[f64; 2]>> {
        let mut residuals = Vec::with_capacity(self.sights.len());
        for view in &self.views {
            let projector = state.boards[view.pose]
                .as_ref()
                .map(|board| Projector::new(&state.cameras[view.device], board));
            for sight in &self.sights[view.start..view.end] {
                let point = self.board.point(sight.index, &state.shape);
                let pixel = projector.as_ref().and_then(|p| p.pixel(&point));
                residuals.push(pixel.map(|q| [sight.pixel.x - q.x, sight.pixel.y - q.y]));
            }
        }
        residuals
    }

    /// Squared whitened length of each residual; infinite where there is none.
    pub fn squares(&self, state: &State) -> Vec<f64> {
        let square = |(sight, residual): (usize, Option<[f64; 2]>)| {
            residual.map_or(f64::INFINITY, |r| {
                let [x, y] = self.whitened(sight, r);
                x * x + y * y
            })
        };
        self.residuals(state).into_iter().enumerate().map(square).collect()
    }

    /// Weighted sum of squares; infinite when a sight that counts lies behind its device.
    pub fn cost(&self, state: &State, weights: &[f64]) -> f64 {
        self.squares(state).iter().zip(weights).filter(|(_, w)| **w > 0.0).map(|(s, w)| s * w).sum()
    }

    /// Parameters that the sights determine, poses excluded.
    pub fn parameters(&self) -> usize {
        self.unknowns - self.datum.as_ref().map_or(0, |_| Datum::HELD)
    }

    /// First column of a point of the target; `None` unless the points are adjusted.
    fn point_column(&self, index: usize) -> Option<usize> {
        self.datum.as_ref().map(|datum| self.unknowns - datum.size() + 3 * index)
    }

    /// Normal equations of a state; `None` when a sight that counts lies behind its device.
    pub fn normal(&self, state: &State, weights: &[f64]) -> Option<Normal> {
        let n = self.unknowns;
        let mut normal = Normal {
            devices: Dense::zeros(n, n),
            right: vec![0.0; n],
            poses: vec![None; state.boards.len()],
            shares: Vec::with_capacity(self.views.len()),
            point_shares: vec![0.0; self.views.len()],
            cost: 0.0,
        };
        for (number, view) in self.views.iter().enumerate() {
            let columns: Vec<Option<usize>> = self.local_columns(view.device).collect();
            let block = normal.poses[view.pose].get_or_insert_with(|| PoseBlock::new(n));
            let mut points = Points {
                columns: &columns,
                devices: &mut normal.devices,
                right: &mut normal.right,
                block,
                share: 0.0,
            };
            let local = self.view_sums(state, view, weights, &mut points)?;
            normal.point_shares[number] = points.share;
            normal.scatter(view, &local, &columns);
        }
        if let Some(datum) = &self.datum {
            datum.hold(&mut normal.devices, n - datum.size());
        }
        Some(normal)
    }

    /// JᵀJ and Jᵀr of one view in its local parameters.
    fn view_sums(
        &self,
        state: &State,
        view: &ViewRange,
        weights: &[f64],
        points: &mut Points,
    ) -> Option<Local> {
        let mut local = Local { matrix: [[0.0; LOCAL]; LOCAL], right: [0.0; LOCAL], cost: 0.0 };
        let Some(board) = state.boards[view.pose].as_ref() else { return Some(local) };
        let projector = Projector::new(&state.cameras[view.device], board);
        for (number, weight) in weights.iter().enumerate().take(view.end).skip(view.start) {
            if *weight == 0.0 {
                continue;
            }
            let sight = &self.sights[number];
            let point = self.board.point(sight.index, &state.shape);
            let (pixel, rows) = projector.rows(&point, self.board.rise[sight.index])?;
            let residual = self.whitened(number, [sight.pixel.x - pixel.x, sight.pixel.y - pixel.y]);
            let rows = self.whitened_rows(number, &rows);
            local.add(&rows, residual, *weight);
            if let Some(first) = self.point_column(sight.index) {
                points.add(first, &rows, residual, *weight);
            }
        }
        Some(local)
    }

    /// The rows of a sight, whitened.
    pub fn whitened_rows(&self, sight: usize, rows: &Rows) -> Rows {
        let [a, b, c] = self.whiten[sight];
        let mut white = [[0.0; LOCAL]; 2];
        for column in 0..LOCAL {
            white[0][column] = a * rows[0][column];
            white[1][column] = b * rows[0][column] + c * rows[1][column];
        }
        white
    }
}

/// Sums of one view; only the upper triangle of the matrix is filled.
struct Local {
    matrix: [[f64; LOCAL]; LOCAL],
    right: [f64; LOCAL],
    cost: f64,
}

impl Local {
    #[inline]
    fn add(&mut self, rows: &Rows, residual: [f64; 2], weight: f64) {
        for (row, r) in rows.iter().zip(residual) {
            for i in 0..LOCAL {
                let scaled = weight * row[i];
                for (sum, value) in self.matrix[i][i..].iter_mut().zip(&row[i..]) {
                    *sum += scaled * value;
                }
                self.right[i] += scaled * r;
            }
            self.cost += weight * r * r;
        }
    }

    #[inline]
    fn at(&self, i: usize, j: usize) -> f64 {
        self.matrix[i.min(j)][i.max(j)]
    }
}

/// Normal equations: devices dense, poses block diagonal.
#[derive(Debug, Clone)]
pub(super) struct Normal {
    /// Matrix of the reduced parameters before elimination.
    pub devices: Dense,
    /// Their right side Jᵀr.
    pub right: Vec<f64>,
    /// One block per pose that is used.
    pub poses: Vec<Option<PoseBlock>>,
    /// The 6 × 6 information of each view about its pose.
    pub shares: Vec<Dense>,
    /// Trace of the information of each view about the target's points; 0 unless they are adjusted.
    pub point_shares: Vec<f64>,
    /// Weighted sum of squares.
    pub cost: f64,
}

/// What belongs to one pose.
#[derive(Debug, Clone)]
pub(super) struct PoseBlock {
    /// 6 × 6.
    pub matrix: Dense,
    /// Jᵀr.
    pub right: Vec<f64>,
    /// Reduced parameters × 6.
    pub coupling: Dense,
}

impl PoseBlock {
    fn new(unknowns: usize) -> Self {
        let coupling = Dense::zeros(unknowns, POSE);
        Self { matrix: Dense::zeros(POSE, POSE), right: vec![0.0; POSE], coupling }
    }
}

/// Where the rows of single target points go: each sight has columns of its own, so no view can sum them first.
struct Points<'a> {
    columns: &'a [Option<usize>],
    devices: &'a mut Dense,
    right: &'a mut [f64],
    block: &'a mut PoseBlock,
    share: f64,
}

impl Points<'_> {
    /// Adds the two rows of a sight whose point has the columns `first .. first + 3`.
    fn add(&mut self, first: usize, rows: &Rows, residual: [f64; 2], weight: f64) {
        let pose = DEVICE + WARP;
        for (row, r) in rows.iter().zip(residual) {
            // The derivatives by the point are those by the shift of its pose.
            for (axis, slope) in row[pose + 3..].iter().enumerate() {
                let (at, scaled) = (first + axis, weight * slope);
                self.right[at] += scaled * r;
                self.share += scaled * slope;
                for (other, value) in row[pose + 3..].iter().enumerate() {
                    self.devices.add(at, first + other, scaled * value);
                }
                for (column, value) in self.columns.iter().zip(row) {
                    if let Some(column) = *column {
                        self.devices.add(at, column, scaled * value);
                        self.devices.add(column, at, scaled * value);
                    }
                }
                for (other, value) in row[pose..].iter().enumerate() {
                    self.block.coupling.add(at, other, scaled * value);
                }
            }
        }
    }
}

/// A step of all parameters.
#[derive(Debug, Clone)]
pub(super) struct Step {
    /// Reduced parameters.
    pub devices: Vec<f64>,
    /// Six for each pose that is used.
    pub poses: Vec<Option<Vec<f64>>>,
}

impl Normal {
    fn scatter(&mut self, view: &ViewRange, local: &Local, columns: &[Option<usize>]) {
        let first = DEVICE + WARP;
        self.shares.push(Dense::from_fn(POSE, POSE, |i, j| local.at(first + i, first + j)));
        self.cost += local.cost;
        let Some(block) = self.poses[view.pose].as_mut() else { return };
        for i in 0..POSE {
            block.right[i] += local.right[first + i];
            for j in 0..POSE {
                block.matrix.add(i, j, local.at(first + i, first + j));
            }
        }
        for (i, column) in columns.iter().enumerate() {
            let Some(row) = *column else { continue };
            self.right[row] += local.right[i];
            for j in 0..POSE {
                block.coupling.add(row, j, local.at(i, first + j));
            }
            for (j, other) in columns.iter().enumerate() {
                if let Some(col) = *other {
                    self.devices.add(row, col, local.at(i, j));
                }
            }
        }
    }

    /// V⁻¹ of each pose, damped; `Err` names a pose that is open.
    pub fn pose_inverses(&self, damping: f64) -> Result<Vec<Option<Dense>>, usize> {
        let inverse = |(pose, block): (usize, &Option<PoseBlock>)| match block {
            None => Ok(None),
            // All its sights are outliers: the pose stays where it is.
            Some(block) if (0..POSE).all(|i| block.matrix.at(i, i) == 0.0) => Ok(None),
            Some(block) => {
                Factor::new(&damped(&block.matrix, damping)).map(|f| Some(f.inverse())).map_err(|_| pose)
            }
        };
        self.poses.iter().enumerate().map(inverse).collect()
    }

    /// The reduced matrix U − Σ W V⁻¹ Wᵀ and right side, given the inverses of the poses.
    pub fn reduced(&self, inverses: &[Option<Dense>], damping: f64) -> (Dense, Vec<f64>) {
        let mut matrix = damped(&self.devices, damping);
        let mut right = self.right.clone();
        for (block, inverse) in self.poses.iter().zip(inverses) {
            let (Some(block), Some(inverse)) = (block, inverse) else { continue };
            // Rows of devices that do not see the pose are zero.
            let touched: Vec<usize> =
                (0..matrix.rows).filter(|r| block.coupling.row(*r).iter().any(|v| *v != 0.0)).collect();
            let known = inverse.apply(&block.right);
            for row in &touched {
                let left = inverse.apply(block.coupling.row(*row));
                right[*row] -= dot(block.coupling.row(*row), &known);
                for col in &touched {
                    matrix.add(*row, *col, -dot(&left, block.coupling.row(*col)));
                }
            }
        }
        (matrix, right)
    }

    /// The step (JᵀJ + λ diag)⁻¹ Jᵀr; `None` when singular.
    pub fn step(&self, damping: f64) -> Option<Step> {
        let inverses = self.pose_inverses(damping).ok()?;
        let (matrix, right) = self.reduced(&inverses, damping);
        let devices = Factor::new(&matrix).ok()?.solve(&right);
        let poses = self.poses.iter().zip(&inverses).map(|(block, inverse)| {
            let (block, inverse) = (block.as_ref()?, inverse.as_ref()?);
            let rest: Vec<f64> = (0..POSE)
                .map(|j| {
                    block.right[j]
                        - (0..devices.len()).map(|r| block.coupling.at(r, j) * devices[r]).sum::<f64>()
                })
                .collect();
            Some(inverse.apply(&rest))
        });
        Some(Step { poses: poses.collect(), devices })
    }

    /// δᵀ JᵀJ δ: the square of a step in standard deviations.
    pub fn length(&self, step: &Step) -> f64 {
        let mut sum = dot(&step.devices, &self.devices.apply(&step.devices));
        for (block, pose) in self.poses.iter().zip(&step.poses) {
            let (Some(block), Some(pose)) = (block, pose) else { continue };
            sum += dot(pose, &block.matrix.apply(pose));
            sum += 2.0 * dot(&step.devices, &block.coupling.apply(pose));
        }
        sum.max(0.0)
    }
}

fn damped(matrix: &Dense, damping: f64) -> Dense {
    let mut damped = matrix.clone();
    for i in 0..matrix.rows {
        damped.add(i, i, damping * matrix.at(i, i));
    }
    damped
}
