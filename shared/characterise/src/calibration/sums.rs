//! JᵀJ and Jᵀr of all image points, run by run in a fixed order.

use super::model::{DEVICE, LOCAL, POSE, State, WARP};
use super::normal::{Normal, PoseBlock};
use super::problem::{Problem, Run, WIDE, WideRows};
use fringe::math::linear::Dense;

/// First of the pose's columns in an equation.
const FIRST: usize = DEVICE + WARP;

impl Problem<'_> {
    /// First column of a point of the target; `None` unless the points are adjusted.
    fn point_column(&self, index: usize) -> Option<usize> {
        self.datum.as_ref().map(|datum| self.unknowns - datum.size() + 3 * index)
    }

    /// Normal equations of a state; `None` when an image point that counts lies behind its device.
    pub fn normal(&self, state: &State, weights: &[f64]) -> Option<Normal> {
        let n = self.unknowns;
        let mut normal = Normal {
            devices: Dense::zeros(n, n),
            right: vec![0.0; n],
            poses: vec![None; state.boards.len()],
            shares: vec![Dense::zeros(POSE, POSE); self.views.len()],
            point_shares: vec![0.0; self.views.len()],
            cost: 0.0,
        };
        for (number, view) in self.views.iter().enumerate() {
            normal.poses[view.pose].get_or_insert_with(|| PoseBlock::new(n));
            for run in self.runs(view) {
                self.add_run(state, &run, weights, (&mut normal, number))?;
            }
        }
        if let Some(datum) = &self.datum {
            datum.hold(&mut normal.devices, n - datum.size());
        }
        Some(normal)
    }

    /// Adds the image points of a run, which belongs to view `number`.
    fn add_run(
        &self,
        state: &State,
        run: &Run,
        weights: &[f64],
        (normal, number): (&mut Normal, usize),
    ) -> Option<()> {
        let Some(eyes) = Self::eyes(state, run) else { return Some(()) };
        let columns = self.run_columns(run);
        let mut local = Local::new(if run.linked.is_some() { WIDE } else { LOCAL });
        let Some(block) = normal.poses[run.pose].as_mut() else { return Some(()) };
        let mut points = Points {
            columns: &columns,
            devices: &mut normal.devices,
            right: &mut normal.right,
            block,
            share: 0.0,
        };
        for (image_point, weight) in weights.iter().enumerate().take(run.end).skip(run.start) {
            if *weight == 0.0 {
                continue;
            }
            let (residual, rows) = self.equations(state, &eyes, image_point)?;
            local.add(&rows, residual, *weight);
            if let Some(first) = self.point_column(self.image_points[image_point].index) {
                points.add(first, &rows, residual, *weight);
            }
        }
        normal.point_shares[number] += points.share;
        normal.scatter(run.pose, number, &local, &columns);
        Some(())
    }
}

/// Sums of one run; only the upper triangle of the matrix is filled.
struct Local {
    /// Columns that are not zero: those of a linked camera stand last.
    width: usize,
    matrix: [[f64; WIDE]; WIDE],
    right: [f64; WIDE],
    cost: f64,
}

impl Local {
    fn new(width: usize) -> Self {
        Self { width, matrix: [[0.0; WIDE]; WIDE], right: [0.0; WIDE], cost: 0.0 }
    }

    #[inline]
    fn add(&mut self, rows: &WideRows, residual: [f64; 2], weight: f64) {
        let width = self.width;
        for (row, r) in rows.iter().zip(residual) {
            for i in 0..width {
                let scaled = weight * row[i];
                for (sum, value) in self.matrix[i][i..width].iter_mut().zip(&row[i..width]) {
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

/// Where the rows of single target points go: each image point has columns of its own, so no run can sum them first.
struct Points<'a> {
    columns: &'a [Option<usize>],
    devices: &'a mut Dense,
    right: &'a mut [f64],
    block: &'a mut PoseBlock,
    share: f64,
}

impl Points<'_> {
    /// Adds the two rows of an image point whose point has the columns `first .. first + 3`.
    fn add(&mut self, first: usize, rows: &WideRows, residual: [f64; 2], weight: f64) {
        for (row, r) in rows.iter().zip(residual) {
            // The derivatives by the point are those by the shift of its pose.
            for (axis, slope) in row[FIRST + 3..LOCAL].iter().enumerate() {
                let (at, scaled) = (first + axis, weight * slope);
                self.right[at] += scaled * r;
                self.share += scaled * slope;
                for (other, value) in row[FIRST + 3..LOCAL].iter().enumerate() {
                    self.devices.add(at, first + other, scaled * value);
                }
                for (column, value) in self.columns.iter().zip(row) {
                    if let Some(column) = *column {
                        self.devices.add(at, column, scaled * value);
                        self.devices.add(column, at, scaled * value);
                    }
                }
                for (other, value) in row[FIRST..LOCAL].iter().enumerate() {
                    self.block.coupling.add(at, other, scaled * value);
                }
            }
        }
    }
}

impl Normal {
    /// Adds the sums of a run of view `number`.
    fn scatter(&mut self, pose: usize, number: usize, local: &Local, columns: &[Option<usize>]) {
        let share = Dense::from_fn(POSE, POSE, |i, j| local.at(FIRST + i, FIRST + j));
        self.shares[number] = self.shares[number].plus(&share);
        self.cost += local.cost;
        let Some(block) = self.poses[pose].as_mut() else { return };
        for i in 0..POSE {
            block.right[i] += local.right[FIRST + i];
            for j in 0..POSE {
                block.matrix.add(i, j, local.at(FIRST + i, FIRST + j));
            }
        }
        for (i, column) in columns.iter().enumerate() {
            let Some(row) = *column else { continue };
            self.right[row] += local.right[i];
            for j in 0..POSE {
                block.coupling.add(row, j, local.at(i, FIRST + j));
            }
            for (j, other) in columns.iter().enumerate() {
                if let Some(col) = *other {
                    self.devices.add(row, col, local.at(i, j));
                }
            }
        }
    }
}
