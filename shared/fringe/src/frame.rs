//! A frame: what a camera saw while one pattern was projected.

use std::sync::Arc;

/// Largest frame that is decoded, and largest phase map, pixels.
pub const MAX_PIXELS: usize = 1 << 27;

/// Grey values, row by row, without padding.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Pixels<'a> {
    /// 8 bits per pixel.
    Mono8(&'a [u8]),
    /// 9 to 16 bits per pixel, in the low bits.
    Mono16(&'a [u16]),
}

impl Pixels<'_> {
    /// Number of pixels of the buffer.
    pub fn len(&self) -> usize {
        match self {
            Self::Mono8(values) => values.len(),
            Self::Mono16(values) => values.len(),
        }
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Grey value of one pixel, DN.
    pub fn get(&self, index: usize) -> f32 {
        match self {
            Self::Mono8(values) => f32::from(values[index]),
            Self::Mono16(values) => f32::from(values[index]),
        }
    }
}

/// A frame stored elsewhere: in shared memory, in a decoded file.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameView<'a> {
    /// Number of columns, px.
    pub width_px: u32,
    /// Number of rows, px.
    pub height_px: u32,
    /// The grey value at which the sensor is full: 255, 1023, 4095, 65535.
    pub full_scale_dn: u16,
    /// width × height values.
    pub pixels: Pixels<'a>,
}

impl<'a> FrameView<'a> {
    /// A frame in one piece: one byte per pixel, or two in the order of the machine. `None` for another length, or 16-bit
    /// values that are not aligned.
    pub fn from_bytes(width_px: u32, height_px: u32, full_scale_dn: u16, bytes: &'a [u8]) -> Option<Self> {
        let pixels = match (width_px as usize).checked_mul(height_px as usize)? {
            n if bytes.len() == n => Pixels::Mono8(bytes),
            n if bytes.len() == 2 * n => Pixels::Mono16(bytemuck::try_cast_slice(bytes).ok()?),
            _ => return None,
        };
        Some(Self { width_px, height_px, full_scale_dn, pixels })
    }

    /// Writes the grey values in 8 bits, rounded, full scale as 255. A cell does this while its stages decode: loops that become vectors.
    pub fn to_8_bits(&self, grey: &mut Vec<u8>) {
        grey.clear();
        match self.pixels {
            Pixels::Mono8(values) if self.full_scale_dn == 255 => grey.extend_from_slice(values),
            Pixels::Mono8(values) => grey.extend(in_8_bits(values, self.full_scale_dn)),
            Pixels::Mono16(values) => grey.extend(in_8_bits(values, self.full_scale_dn)),
        }
    }
}

fn in_8_bits<T: Copy + Into<f32>>(values: &[T], full_scale_dn: u16) -> impl Iterator<Item = u8> {
    let scale = 255.0 / f32::from(full_scale_dn.max(1));
    values.iter().map(move |value| ((*value).into() * scale + 0.5) as u8)
}

/// Grey values that a frame owns.
#[derive(Debug, Clone, PartialEq)]
pub enum PixelBuffer {
    /// 8 bits per pixel.
    Mono8(Vec<u8>),
    /// 9 to 16 bits per pixel, in the low bits.
    Mono16(Vec<u16>),
}

/// A frame that owns its pixels.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// Number of columns, px.
    pub width_px: u32,
    /// Number of rows, px.
    pub height_px: u32,
    /// The grey value at which the sensor is full.
    pub full_scale_dn: u16,
    /// width × height values.
    pub pixels: PixelBuffer,
}

impl Frame {
    /// A view that borrows the frame.
    pub fn view(&self) -> FrameView<'_> {
        FrameView {
            width_px: self.width_px,
            height_px: self.height_px,
            full_scale_dn: self.full_scale_dn,
            pixels: match &self.pixels {
                PixelBuffer::Mono8(values) => Pixels::Mono8(values),
                PixelBuffer::Mono16(values) => Pixels::Mono16(values),
            },
        }
    }
}

/// Grey values that several may hold at once without copying them.
#[derive(Debug, Clone, PartialEq)]
pub enum SharedPixels {
    /// 8 bits per pixel.
    Mono8(Arc<Vec<u8>>),
    /// 9 to 16 bits per pixel, in the low bits.
    Mono16(Arc<Vec<u16>>),
}

impl SharedPixels {
    /// A view that borrows them.
    pub fn view(&self) -> Pixels<'_> {
        match self {
            Self::Mono8(values) => Pixels::Mono8(values),
            Self::Mono16(values) => Pixels::Mono16(values),
        }
    }
}

/// A frame that several may hold at once: a decoder keeps it where it is ([`crate::decode::Decoder::push_shared`]).
#[derive(Debug, Clone, PartialEq)]
pub struct SharedFrame {
    /// Number of columns, px.
    pub width_px: u32,
    /// Number of rows, px.
    pub height_px: u32,
    /// The grey value at which the sensor is full.
    pub full_scale_dn: u16,
    /// width × height values.
    pub pixels: SharedPixels,
}

impl SharedFrame {
    /// A view that borrows the frame.
    pub fn view(&self) -> FrameView<'_> {
        let Self { width_px, height_px, full_scale_dn, ref pixels } = *self;
        FrameView { width_px, height_px, full_scale_dn, pixels: pixels.view() }
    }
}

impl From<Frame> for SharedFrame {
    fn from(Frame { width_px, height_px, full_scale_dn, pixels }: Frame) -> Self {
        let pixels = match pixels {
            PixelBuffer::Mono8(values) => SharedPixels::Mono8(Arc::new(values)),
            PixelBuffer::Mono16(values) => SharedPixels::Mono16(Arc::new(values)),
        };
        Self { width_px, height_px, full_scale_dn, pixels }
    }
}

impl From<FrameView<'_>> for Frame {
    fn from(view: FrameView<'_>) -> Self {
        let pixels = match view.pixels {
            Pixels::Mono8(values) => PixelBuffer::Mono8(values.to_vec()),
            Pixels::Mono16(values) => PixelBuffer::Mono16(values.to_vec()),
        };
        let FrameView { width_px, height_px, full_scale_dn, .. } = view;
        Self { width_px, height_px, full_scale_dn, pixels }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn full_scale_becomes_255_and_grey_values_are_rounded() {
        for full_scale_dn in [200, 255, 1023, 4095, u16::MAX] {
            let values: Vec<u16> = (0..=full_scale_dn).collect();
            let bytes: Vec<u8> = values.iter().filter_map(|value| u8::try_from(*value).ok()).collect();
            for pixels in [Pixels::Mono16(&values), Pixels::Mono8(&bytes)] {
                let view = FrameView { width_px: pixels.len() as u32, height_px: 1, full_scale_dn, pixels };
                let mut grey = vec![7; 3];
                view.to_8_bits(&mut grey);
                assert_eq!(grey.len(), pixels.len());
                for (value, grey) in values.iter().zip(grey) {
                    let exact = f64::from(*value) * 255.0 / f64::from(full_scale_dn);
                    assert!(
                        (f64::from(grey) - exact).abs() < 0.5 + 1e-4,
                        "{value} of {full_scale_dn}: {grey}"
                    );
                }
            }
        }
    }
}
