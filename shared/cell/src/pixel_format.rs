//! How a camera sends its pixels: the formats of the GenICam pixel format naming convention that one channel has.

/// A format of grey pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PixelFormat {
    /// 8 bits a pixel.
    #[default]
    Mono8,
    /// 10 bits in two bytes.
    Mono10,
    /// 12 bits in two bytes.
    Mono12,
    /// 16 bits a pixel.
    Mono16,
    /// Four pixels of 10 bits in five bytes, least significant bits first.
    Mono10p,
    /// Two pixels of 12 bits in three bytes, least significant bits first.
    Mono12p,
    /// Two pixels of 10 bits in three bytes, the packing of GigE Vision.
    Mono10Packed,
    /// Two pixels of 12 bits in three bytes, the packing of GigE Vision.
    Mono12Packed,
}

impl PixelFormat {
    /// All formats that a driver can set.
    pub const ALL: [Self; 8] = [
        Self::Mono8,
        Self::Mono10,
        Self::Mono12,
        Self::Mono16,
        Self::Mono10p,
        Self::Mono12p,
        Self::Mono10Packed,
        Self::Mono12Packed,
    ];

    /// Name, as in the feature `PixelFormat`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Mono8 => "Mono8",
            Self::Mono10 => "Mono10",
            Self::Mono12 => "Mono12",
            Self::Mono16 => "Mono16",
            Self::Mono10p => "Mono10p",
            Self::Mono12p => "Mono12p",
            Self::Mono10Packed => "Mono10Packed",
            Self::Mono12Packed => "Mono12Packed",
        }
    }

    /// Number of the format on the wire.
    pub fn code(self) -> u32 {
        match self {
            Self::Mono8 => 0x0108_0001,
            Self::Mono10 => 0x0110_0003,
            Self::Mono12 => 0x0110_0005,
            Self::Mono16 => 0x0110_0007,
            Self::Mono10p => 0x010a_0046,
            Self::Mono12p => 0x010c_0047,
            Self::Mono10Packed => 0x010c_0004,
            Self::Mono12Packed => 0x010c_0006,
        }
    }

    /// Grey value of a full pixel, DN.
    pub fn full_scale_dn(self) -> u16 {
        match self {
            Self::Mono8 => 255,
            Self::Mono10 | Self::Mono10p | Self::Mono10Packed => 1023,
            Self::Mono12 | Self::Mono12p | Self::Mono12Packed => 4095,
            Self::Mono16 => u16::MAX,
        }
    }

    /// Writes the pixels of `data` to `out`: one byte each, or two in the order of this machine. `false` where the lengths do not fit
    /// each other, or a value lies beyond full scale.
    pub fn unpack(self, data: &[u8], out: &mut [u8]) -> bool {
        if self == Self::Mono8 {
            if data.len() == out.len() {
                out.copy_from_slice(data);
            }
            return data.len() == out.len();
        }
        let pixels = out.len() / 2;
        let needed = match self {
            Self::Mono10p => (10 * pixels).div_ceil(8),
            Self::Mono12p | Self::Mono12Packed | Self::Mono10Packed => (12 * pixels).div_ceil(8),
            _ => 2 * pixels,
        };
        if data.len() != needed || !out.len().is_multiple_of(2) {
            return false;
        }
        let full = self.full_scale_dn();
        out.as_chunks_mut::<2>().0.iter_mut().enumerate().all(|(pixel, out)| {
            let value = self.value(data, pixel);
            *out = value.to_ne_bytes();
            value <= full
        })
    }

    /// Grey value of a pixel, DN.
    fn value(self, data: &[u8], pixel: usize) -> u16 {
        // A last byte that does not exist holds no bit of the last pixel.
        let byte = |at: usize| u16::from(data.get(at).copied().unwrap_or(0));
        match self {
            Self::Mono8 => byte(pixel),
            Self::Mono10 | Self::Mono12 | Self::Mono16 => byte(2 * pixel) | byte(2 * pixel + 1) << 8,
            Self::Mono10p | Self::Mono12p => {
                let bits = if self == Self::Mono10p { 10 } else { 12 };
                let first = pixel * bits;
                let word = u32::from(byte(first / 8)) | u32::from(byte(first / 8 + 1)) << 8;
                (word >> (first % 8)) as u16 & self.full_scale_dn()
            }
            Self::Mono10Packed | Self::Mono12Packed => {
                let low_bits = if self == Self::Mono10Packed { 2 } else { 4 };
                let (start, second) = (pixel / 2 * 3, !pixel.is_multiple_of(2));
                let low = byte(start + 1) >> if second { 4 } else { 0 } & 0xf;
                byte(start + if second { 2 } else { 0 }) << low_bits | low & ((1 << low_bits) - 1)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pack(format: PixelFormat, values: &[u16]) -> Vec<u8> {
        let mut bytes = vec![0_u8; 2 * values.len() + 4];
        let mut put = |bit: usize, value: u16, count: usize| {
            for i in 0..count {
                bytes[(bit + i) / 8] |= u8::from(value >> i & 1 == 1) << ((bit + i) % 8);
            }
        };
        let mut bits = 0;
        for (pixel, value) in values.iter().enumerate() {
            match format {
                PixelFormat::Mono10p | PixelFormat::Mono12p => {
                    let size = if format == PixelFormat::Mono10p { 10 } else { 12 };
                    put(pixel * size, *value, size);
                    bits = (pixel + 1) * size;
                }
                PixelFormat::Mono10Packed | PixelFormat::Mono12Packed => {
                    let low = if format == PixelFormat::Mono10Packed { 2 } else { 4 };
                    let start = pixel / 2 * 24;
                    put(start + pixel % 2 * 16, value >> low, 8);
                    put(start + 8 + pixel % 2 * 4, value & ((1 << low) - 1), low);
                    bits = (pixel + 1) * 12;
                }
                _ => {
                    put(pixel * 16, *value, 16);
                    bits = (pixel + 1) * 16;
                }
            }
        }
        // Two bytes of the packing of GigE Vision belong to the first of two pixels.
        bytes.truncate(bits.div_ceil(8));
        bytes
    }

    #[test]
    fn every_format_unpacks_to_the_values_that_were_packed() {
        for format in PixelFormat::ALL.into_iter().filter(|f| *f != PixelFormat::Mono8) {
            for count in [1, 2, 3, 4, 5, 17, 100] {
                let full = u32::from(format.full_scale_dn());
                let values: Vec<u16> = (0..count)
                    .map(|i: u32| (i.wrapping_mul(2_654_435_761_u32) % (full + 1)) as u16)
                    .collect();
                let packed = pack(format, &values);
                let mut out = vec![0; 2 * values.len()];
                assert!(format.unpack(&packed, &mut out), "{format:?} {count}");
                let got: Vec<u16> = out.as_chunks::<2>().0.iter().map(|b| u16::from_ne_bytes(*b)).collect();
                assert_eq!(got, values, "{format:?} {count}");
                assert!(!format.unpack(&packed[1..], &mut out), "{format:?}: too short");
            }
        }
        assert!(!PixelFormat::Mono12.unpack(&[0xff, 0xff], &mut [0; 2]), "beyond full scale");
        let mut out = [0; 3];
        assert!(PixelFormat::Mono8.unpack(&[1, 2, 3], &mut out) && out == [1, 2, 3]);
        assert!(!PixelFormat::Mono8.unpack(&[1, 2], &mut out));
    }
}
