//! Normal equations of a target whose points are adjusted: the points are eliminated one by one, before devices and poses.
//!
//! Each point meets the others only through devices, poses and the [`Datum`]. With B the 3 × 3 blocks of the points, W their coupling to
//! devices and poses A, and the datum c HᵀH of seven rows, (B + c HᵀH)⁻¹ = B⁻¹ − G K⁻¹ Gᵀ (Woodbury), G = B⁻¹Hᵀ and
//! K = 1/c + H G. What is factorised is A − W B⁻¹ Wᵀ + (W G) K⁻¹ (W G)ᵀ, whose size does not grow with the points: a board of 400 points
//! takes a thousandth of the operations that a matrix of all of them takes.

use super::free_points::{PointBlock, Points};
use super::model::POSE;
use super::normal::Normal;
use fringe::math::linear::{Dense, Factor, dot};
use nalgebra::{Matrix3, Vector3};

/// The factorised system of devices, poses and points.
pub(super) struct Eliminated<'a> {
    points: &'a Points,
    /// Number of reduced parameters of devices and warp.
    devices: usize,
    /// Where each pose stands behind the devices; `None` of a pose that is not used.
    places: Vec<Option<usize>>,
    /// B⁻¹ of each point.
    inverses: Vec<Matrix3<f64>>,
    /// W G: a row for each device parameter and pose parameter, seven columns.
    by_held: Dense,
    held: Factor,
    factor: Factor,
}

impl<'a> Eliminated<'a> {
    /// Factorises; `None` when something is open.
    pub fn new(normal: &Normal, points: &'a Points, damping: f64) -> Option<Self> {
        let devices = normal.devices.rows;
        let mut size = devices;
        let mut places = Vec::with_capacity(normal.poses.len());
        for pose in &normal.poses {
            let used = pose.as_ref().is_some_and(|block| (0..POSE).any(|i| block.matrix.at(i, i) != 0.0));
            places.push(used.then_some(size));
            size += if used { POSE } else { 0 };
        }
        let mut matrix = Dense::zeros(size, size);
        add_devices(normal, &places, damping, &mut matrix);
        let rows = points.rows.len();
        let (mut inverses, mut by_held) = (Vec::with_capacity(points.blocks.len()), Dense::zeros(size, rows));
        let mut middle = Dense::zeros(rows, rows);
        (0..rows).for_each(|i| middle.set(i, i, 1.0 / points.held));
        for (number, block) in points.blocks.iter().enumerate() {
            let mut own = block.matrix;
            (0..3).for_each(|i| own[(i, i)] = own[(i, i)] * (1.0 + damping) + points.unseen);
            let inverse = own.try_inverse()?;
            let coupled = coupled(block, &places);
            let left: Vec<Vector3<f64>> = coupled.iter().map(|(_, w)| inverse * w).collect();
            for ((row, _), left) in coupled.iter().zip(&left) {
                for (column, w) in coupled.iter().take_while(|(column, _)| column <= row) {
                    matrix.add(*row, *column, -left.dot(w));
                }
            }
            for i in 0..rows {
                let g = inverse * points.part(i, number);
                for (row, w) in &coupled {
                    by_held.add(*row, i, w.dot(&g));
                }
                (0..rows).for_each(|j| middle.add(j, i, points.part(j, number).dot(&g)));
            }
            inverses.push(inverse);
        }
        let held = Factor::new(&middle).ok()?;
        let solved: Vec<Vec<f64>> = (0..size).map(|row| held.solve(by_held.row(row))).collect();
        for (row, solved) in solved.iter().enumerate() {
            for column in 0..=row {
                matrix.add(row, column, dot(solved, by_held.row(column)));
            }
        }
        let factor = Factor::new(&matrix).ok()?;
        Some(Self { points, devices, places, inverses, by_held, held, factor })
    }

    /// Number of reduced parameters of devices and warp.
    pub fn devices(&self) -> usize {
        self.devices
    }

    /// Solves for devices, poses and points, given the right sides in the same order; `None` of a pose has none.
    pub fn solve(
        &self,
        devices: &[f64],
        poses: &[Option<Vec<f64>>],
        points: &[f64],
    ) -> (Vec<f64>, Vec<Option<Vec<f64>>>, Vec<f64>) {
        let mut right = vec![0.0; self.by_held.rows];
        right[..self.devices].copy_from_slice(devices);
        for (place, pose) in self.places.iter().zip(poses) {
            if let (Some(place), Some(pose)) = (place, pose) {
                right[*place..place + POSE].copy_from_slice(pose);
            }
        }
        let known = self.of_points(points);
        for (number, block) in self.points.blocks.iter().enumerate() {
            let x = Vector3::from_column_slice(&known[3 * number..3 * number + 3]);
            for (row, w) in coupled(block, &self.places) {
                right[row] -= w.dot(&x);
            }
        }
        let solved = self.factor.solve(&right);
        let mut rest = points.to_vec();
        for (number, block) in self.points.blocks.iter().enumerate() {
            let taken: Vector3<f64> = coupled(block, &self.places)
                .iter()
                .fold(Vector3::zeros(), |sum, (row, w)| sum + w * solved[*row]);
            (0..3).for_each(|axis| rest[3 * number + axis] -= taken[axis]);
        }
        let of_poses =
            self.places.iter().map(|place| place.map(|place| solved[place..place + POSE].to_vec()));
        (solved[..self.devices].to_vec(), of_poses.collect(), self.of_points(&rest))
    }

    /// (B + c HᵀH)⁻¹ b of the points alone.
    fn of_points(&self, right: &[f64]) -> Vec<f64> {
        let rows = self.points.rows.len();
        let vector = |of: &[f64], number: usize| Vector3::from_column_slice(&of[3 * number..3 * number + 3]);
        let mut solved = vec![0.0; right.len()];
        let mut middle = vec![0.0; rows];
        for (number, inverse) in self.inverses.iter().enumerate() {
            let x = inverse * vector(right, number);
            (0..rows).for_each(|i| middle[i] += self.points.part(i, number).dot(&x));
            solved[3 * number..3 * number + 3].copy_from_slice(x.as_slice());
        }
        let pulled = self.held.solve(&middle);
        for (number, inverse) in self.inverses.iter().enumerate() {
            let pull =
                (0..rows).fold(Vector3::zeros(), |sum, i| sum + self.points.part(i, number) * pulled[i]);
            let x = inverse * pull;
            (0..3).for_each(|axis| solved[3 * number + axis] -= x[axis]);
        }
        solved
    }
}

/// Devices and poses before the points are eliminated, the lower half; damped.
fn add_devices(normal: &Normal, places: &[Option<usize>], damping: f64, matrix: &mut Dense) {
    let devices = normal.devices.rows;
    for row in 0..devices {
        for column in 0..=row {
            matrix.set(row, column, normal.devices.at(row, column));
        }
        matrix.add(row, row, damping * normal.devices.at(row, row));
    }
    for (block, place) in normal.poses.iter().zip(places) {
        let (Some(block), Some(place)) = (block, place) else { continue };
        for i in 0..POSE {
            for j in 0..=i {
                matrix.set(place + i, place + j, block.matrix.at(i, j));
            }
            matrix.add(place + i, place + i, damping * block.matrix.at(i, i));
            (0..devices).for_each(|column| matrix.set(place + i, column, block.coupling.at(column, i)));
        }
    }
}

/// The rows of W of a point with their places, in rising order.
fn coupled(block: &PointBlock, places: &[Option<usize>]) -> Vec<(usize, Vector3<f64>)> {
    let devices = block.by_device.iter().map(|(column, w)| (*column, *w));
    let poses = block.by_pose.iter().filter_map(|(pose, w)| Some((places[*pose]?, w)));
    devices
        .chain(poses.flat_map(|(place, w)| w.iter().enumerate().map(move |(i, w)| (place + i, *w))))
        .collect()
}
