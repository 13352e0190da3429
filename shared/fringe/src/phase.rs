//! Absolute phase maps: what a decoder gives and a matcher takes.

use crate::pattern::Axis;

/// Bytes per pixel of a phase map in one piece: phase, sigma and modulation as f32, validity as u8, one plane after
/// another.
pub const PHASE_BYTES_PER_PX: usize = 13;

/// What all planes of a phase map share.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PhaseInfo {
    /// Columns of the map, px.
    pub width_px: u32,
    /// Rows of the map, px.
    pub height_px: u32,
    /// The projector axis of the phase.
    pub axis: Axis,
    /// Projector pixels per 2π: projector coordinate = phase · period / 2π.
    pub period_px: f64,
}

impl PhaseInfo {
    /// Number of pixels: columns times rows.
    pub fn len(&self) -> usize {
        self.width_px as usize * self.height_px as usize
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// A phase map that lives elsewhere, in shared memory for instance. All planes are row by row, without padding.
#[derive(Debug, Clone, Copy)]
pub struct PhaseView<'a> {
    /// Size, projector axis and fringe period of the map.
    pub info: PhaseInfo,
    /// Absolute phase, rad; NaN where not valid.
    pub phase_rad: &'a [f32],
    /// Standard uncertainty of the phase, rad; NaN where not valid.
    pub sigma_rad: &'a [f32],
    /// Modulation B of each pixel, DN.
    pub modulation: &'a [f32],
    /// 1 where the phase may be used, else 0.
    pub valid: &'a [u8],
}

impl<'a> PhaseView<'a> {
    /// The planes of a map in one piece; `None` for another length, or memory that is not aligned to four bytes.
    pub fn from_bytes(info: PhaseInfo, bytes: &'a [u8]) -> Option<Self> {
        let plane = 4 * info.len();
        if bytes.len() != PHASE_BYTES_PER_PX * info.len() {
            return None;
        }
        let (phase, rest) = bytes.split_at(plane);
        let (sigma, rest) = rest.split_at(plane);
        let (modulation, valid) = rest.split_at(plane);
        Some(Self {
            info,
            phase_rad: bytemuck::try_cast_slice(phase).ok()?,
            sigma_rad: bytemuck::try_cast_slice(sigma).ok()?,
            modulation: bytemuck::try_cast_slice(modulation).ok()?,
            valid,
        })
    }
}

/// The same, to be written.
#[derive(Debug)]
pub struct PhaseViewMut<'a> {
    /// Size, projector axis and fringe period of the map.
    pub info: PhaseInfo,
    /// Absolute phase, rad; NaN where not valid.
    pub phase_rad: &'a mut [f32],
    /// Standard uncertainty of the phase, rad; NaN where not valid.
    pub sigma_rad: &'a mut [f32],
    /// Modulation B of each pixel, DN.
    pub modulation: &'a mut [f32],
    /// 1 where the phase may be used, else 0.
    pub valid: &'a mut [u8],
}

impl<'a> PhaseViewMut<'a> {
    /// The mutable form of [`PhaseView::from_bytes`].
    pub fn from_bytes(info: PhaseInfo, bytes: &'a mut [u8]) -> Option<Self> {
        let plane = 4 * info.len();
        if bytes.len() != PHASE_BYTES_PER_PX * info.len() {
            return None;
        }
        let (phase, rest) = bytes.split_at_mut(plane);
        let (sigma, rest) = rest.split_at_mut(plane);
        let (modulation, valid) = rest.split_at_mut(plane);
        Some(Self {
            info,
            phase_rad: bytemuck::try_cast_slice_mut(phase).ok()?,
            sigma_rad: bytemuck::try_cast_slice_mut(sigma).ok()?,
            modulation: bytemuck::try_cast_slice_mut(modulation).ok()?,
            valid,
        })
    }
}

/// A phase map that owns its planes.
#[derive(Debug, Clone, PartialEq)]
pub struct PhaseMap {
    /// Size, projector axis and fringe period of the map.
    pub info: PhaseInfo,
    /// Absolute phase, rad; NaN where not valid.
    pub phase_rad: Vec<f32>,
    /// Standard uncertainty of the phase, rad; NaN where not valid.
    pub sigma_rad: Vec<f32>,
    /// Modulation B of each pixel, DN.
    pub modulation: Vec<f32>,
    /// 1 where the phase may be used, else 0.
    pub valid: Vec<u8>,
}

impl PhaseMap {
    /// A map without any valid pixel.
    pub fn new(info: PhaseInfo) -> Self {
        let n = info.len();
        Self {
            info,
            phase_rad: vec![f32::NAN; n],
            sigma_rad: vec![f32::NAN; n],
            modulation: vec![0.0; n],
            valid: vec![0; n],
        }
    }

    /// Borrows the map as a view of its planes.
    pub fn view(&self) -> PhaseView<'_> {
        PhaseView {
            info: self.info,
            phase_rad: &self.phase_rad,
            sigma_rad: &self.sigma_rad,
            modulation: &self.modulation,
            valid: &self.valid,
        }
    }

    /// Borrows the map to write it.
    pub fn view_mut(&mut self) -> PhaseViewMut<'_> {
        PhaseViewMut {
            info: self.info,
            phase_rad: &mut self.phase_rad,
            sigma_rad: &mut self.sigma_rad,
            modulation: &mut self.modulation,
            valid: &mut self.valid,
        }
    }
}
