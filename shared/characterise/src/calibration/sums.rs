//! JᵀJ and Jᵀr of all image points, run by run in a fixed order.

use super::datum::Datum;
use super::free_points::{PointBlock, Points};
use super::model::{DEVICE, LOCAL, POSE, State, WARP};
use super::normal::{Normal, PoseBlock};
use super::problem::{Problem, Run, WIDE, WideRows};
use fringe::math::linear::Dense;
use nalgebra::Vector3;

/// First of the pose's columns in an equation.
const FIRST: usize = DEVICE + WARP;

impl Problem<'_> {
    /// Normal equations of a state; `None` when an image point that counts lies behind its device.
    pub fn normal(&self, state: &State, weights: &[f64]) -> Option<Normal> {
        let n = self.unknowns - self.datum.as_ref().map_or(0, Datum::size);
        let mut normal = Normal {
            devices: Dense::zeros(n, n),
            right: vec![0.0; self.unknowns],
            poses: vec![None; state.boards.len()],
            points: None,
            shares: vec![Dense::zeros(POSE, POSE); self.views.len()],
            point_shares: vec![0.0; self.views.len()],
            cost: 0.0,
        };
        let count = self.datum.as_ref().map_or(0, |_| self.board.points.len());
        let mut blocks = vec![PointBlock::new(); count];
        for (number, view) in self.views.iter().enumerate() {
            normal.poses[view.pose].get_or_insert_with(|| PoseBlock::new(n));
            for run in self.runs(view) {
                self.add_run(state, &run, weights, (&mut normal, &mut blocks, number))?;
            }
        }
        if let Some(datum) = &self.datum {
            for (block, right) in blocks.iter().zip(normal.right[n..].chunks_exact_mut(3)) {
                right.copy_from_slice(block.right.as_slice());
            }
            normal.points = Some(Points::new(blocks, datum));
        }
        Some(normal)
    }

    /// Adds the image points of a run, which belongs to view `number`.
    fn add_run(
        &self,
        state: &State,
        run: &Run,
        weights: &[f64],
        (normal, blocks, number): (&mut Normal, &mut [PointBlock], usize),
    ) -> Option<()> {
        let Some(eyes) = Self::eyes(state, run) else { return Some(()) };
        let columns = self.run_columns(run);
        let mut local = Local::new(&columns);
        for (image_point, weight) in weights.iter().enumerate().take(run.end).skip(run.start) {
            if *weight == 0.0 {
                continue;
            }
            let (residual, rows) = self.equations(state, &eyes, image_point)?;
            local.add(&rows, residual, *weight);
            if let Some(block) = blocks.get_mut(self.image_points[image_point].index) {
                normal.point_shares[number] += add_point(block, &columns, run.pose, &rows, residual, *weight);
            }
        }
        normal.scatter(run.pose, number, &local, &columns);
        Some(())
    }
}

/// Sums of one run over the columns that are adjusted; only the upper triangle of the matrix is filled.
struct Local {
    /// The adjusted columns, in rising order.
    active: Vec<usize>,
    /// Place of each column among them.
    places: [Option<usize>; WIDE],
    matrix: Vec<[f64; WIDE]>,
    right: [f64; WIDE],
    cost: f64,
}

impl Local {
    fn new(columns: &[Option<usize>]) -> Self {
        let adjusted = |i: &usize| columns[*i].is_some() || (FIRST..LOCAL).contains(i);
        let active: Vec<usize> = (0..WIDE).filter(adjusted).collect();
        let mut places = [None; WIDE];
        active.iter().enumerate().for_each(|(place, column)| places[*column] = Some(place));
        let matrix = vec![[0.0; WIDE]; active.len()];
        Self { active, places, matrix, right: [0.0; WIDE], cost: 0.0 }
    }

    #[inline]
    fn add(&mut self, rows: &WideRows, residual: [f64; 2], weight: f64) {
        let mut packed = [0.0; WIDE];
        let width = self.active.len();
        for (row, r) in rows.iter().zip(residual) {
            packed.iter_mut().zip(&self.active).for_each(|(value, column)| *value = row[*column]);
            for i in 0..width {
                let scaled = weight * packed[i];
                for (sum, value) in self.matrix[i][i..width].iter_mut().zip(&packed[i..width]) {
                    *sum += scaled * value;
                }
                self.right[i] += scaled * r;
            }
            self.cost += weight * r * r;
        }
    }

    #[inline]
    fn at(&self, i: usize, j: usize) -> f64 {
        self.places[i].zip(self.places[j]).map_or(0.0, |(i, j)| self.matrix[i.min(j)][i.max(j)])
    }

    #[inline]
    fn right_of(&self, i: usize) -> f64 {
        self.places[i].map_or(0.0, |place| self.right[place])
    }
}

/// Adds the two rows of an image point to its target point, and gives the trace of what they add: each image point has columns of
/// its own, so no run can sum them first.
fn add_point(
    block: &mut PointBlock,
    columns: &[Option<usize>],
    pose: usize,
    rows: &WideRows,
    residual: [f64; 2],
    weight: f64,
) -> f64 {
    let mut share = 0.0;
    let by_pose = block.by_pose.entry(pose).or_insert_with(|| [Vector3::zeros(); POSE]);
    for (row, r) in rows.iter().zip(residual) {
        // The derivatives by the point are those by the shift of its pose.
        let slope = Vector3::from_column_slice(&row[FIRST + 3..LOCAL]);
        let scaled = slope * weight;
        block.right += scaled * r;
        block.matrix += scaled * slope.transpose();
        share += scaled.dot(&slope);
        for (column, value) in columns.iter().zip(row) {
            if let Some(column) = *column {
                *block.by_device.entry(column).or_insert_with(Vector3::zeros) += scaled * *value;
            }
        }
        for (sum, value) in by_pose.iter_mut().zip(&row[FIRST..LOCAL]) {
            *sum += scaled * *value;
        }
    }
    share
}

impl Normal {
    /// Adds the sums of a run of view `number`.
    fn scatter(&mut self, pose: usize, number: usize, local: &Local, columns: &[Option<usize>]) {
        let share = Dense::from_fn(POSE, POSE, |i, j| local.at(FIRST + i, FIRST + j));
        self.shares[number] = self.shares[number].plus(&share);
        self.cost += local.cost;
        let Some(block) = self.poses[pose].as_mut() else { return };
        for i in 0..POSE {
            block.right[i] += local.right_of(FIRST + i);
            for j in 0..POSE {
                block.matrix.add(i, j, local.at(FIRST + i, FIRST + j));
            }
        }
        for (i, column) in columns.iter().enumerate() {
            let Some(row) = *column else { continue };
            self.right[row] += local.right_of(i);
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
