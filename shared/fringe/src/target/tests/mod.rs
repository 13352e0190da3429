//! Synthetic targets with known points: accuracy, covariance, numbering, refusals.

mod checkerboard;
mod circles;
mod scene;
