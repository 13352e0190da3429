//! What a camera and a projector have to do.

use anyhow::Result;

/// How a camera delivers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Format {
    /// 1 or 2.
    pub bytes_per_px: u32,
    /// Grey value of a full pixel.
    pub full_scale_dn: u16,
}

impl Format {
    /// Whole bytes for a full scale.
    pub fn of(full_scale_dn: u16) -> Self {
        Self { bytes_per_px: if full_scale_dn > 255 { 2 } else { 1 }, full_scale_dn }
    }
}

/// A camera.
pub trait Camera {
    /// A cycle starts: the part stands.
    ///
    /// # Errors
    /// There is no part for this cycle.
    fn begin(&mut self, cycle: u64) -> Result<()>;

    /// Takes the frame of a projector's sequence straight into shared memory: width · height · `bytes_per_px` bytes.
    ///
    /// # Errors
    /// The frame cannot be had, or is of another size than `out`.
    fn expose(&mut self, projector: usize, frame: usize, out: &mut [u8]) -> Result<()>;
}

/// A projector, or all of them when they share one driver.
pub trait Projector {
    /// A cycle starts.
    fn begin(&mut self, now_ns: u64);

    /// When the next pattern may be shown, if it has to wait.
    fn due_ns(&self) -> Option<u64>;

    /// Shows a pattern.
    ///
    /// # Errors
    /// The device refuses.
    fn show(&mut self, projector: usize, frame: usize, now_ns: u64) -> Result<()>;
}
