//! Synthetic targets with known points: accuracy, covariance, numbering, refusals; and frames of anything.

mod blur;
mod checkerboard;
mod circles;
mod scene;
mod strange;
