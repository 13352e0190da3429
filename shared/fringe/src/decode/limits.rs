//! How large a sequence may be.

/// Longest sequence that is decoded, frames.
pub const MAX_FRAMES: usize = 4096;
/// Most frames of a sine set.
pub const MAX_STEPS: usize = 64;
/// Most sine sets on one axis.
pub const MAX_SINES: usize = 6;
