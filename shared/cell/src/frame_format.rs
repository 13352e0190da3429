//! How the frames of a camera lie in memory.

/// How a camera delivers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FrameFormat {
    /// Bytes of one pixel, 1 or 2.
    pub bytes_per_px: u32,
    /// Grey value of a full pixel.
    pub full_scale_dn: u16,
}

impl FrameFormat {
    /// Whole bytes for a full scale.
    pub fn of(full_scale_dn: u16) -> Self {
        Self { bytes_per_px: if full_scale_dn > 255 { 2 } else { 1 }, full_scale_dn }
    }
}
