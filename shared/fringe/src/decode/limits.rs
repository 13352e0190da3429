//! How large a sequence and its frames may be.

/// Largest frame that is decoded, pixels.
pub const MAX_PIXELS: usize = 1 << 27;
/// Longest sequence that is decoded, frames.
pub const MAX_FRAMES: usize = 4096;
/// Most frames of a sine set.
pub const MAX_STEPS: usize = 64;
/// Most sine sets on one axis.
pub const MAX_SINES: usize = 6;
