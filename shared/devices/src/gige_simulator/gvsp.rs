//! GigE Vision stream protocol (GVSP): a frame as a leader, packets of pixels, and a trailer.

/// IP, UDP and stream header of a packet, bytes.
pub const OVERHEAD_BYTES: usize = 20 + 8 + HEADER_BYTES;

const HEADER_BYTES: usize = 8;
const LEADER: u8 = 1;
const TRAILER: u8 = 2;
const PAYLOAD: u8 = 3;
const IMAGE: u16 = 1;

/// A frame in flight: kept until newer ones replace it, so that lost packets can be sent again.
#[derive(Debug, Clone)]
pub struct Block {
    /// Number of the frame, 1 … 65535, then 1 again.
    pub id: u16,
    /// Time of the exposure, ns.
    pub timestamp_ns: u64,
    /// Value of the feature `PixelFormat`.
    pub pixel_format: u32,
    /// First column and row on the sensor, px.
    pub corner_px: [u32; 2],
    /// Columns of the frame, px.
    pub width_px: u32,
    /// Rows of the frame, px.
    pub height_px: u32,
    /// Size of a packet, headers included, bytes.
    pub packet_bytes: usize,
    /// The pixels, row by row.
    pub pixels: Vec<u8>,
}

impl Block {
    fn data_bytes(&self) -> usize {
        self.packet_bytes.saturating_sub(OVERHEAD_BYTES).max(1)
    }

    /// Number of its packets: leader, pixels, trailer.
    pub fn packets(&self) -> u32 {
        self.pixels.len().div_ceil(self.data_bytes()) as u32 + 2
    }

    /// Writes packet `number` (0: leader) into `out`; `false` beyond the last one.
    pub fn packet(&self, number: u32, out: &mut Vec<u8>) -> bool {
        out.clear();
        let last = self.packets() - 1;
        let kind = match number {
            0 => LEADER,
            n if n == last => TRAILER,
            n if n < last => PAYLOAD,
            _ => return false,
        };
        out.extend([0, 0]);
        out.extend(self.id.to_be_bytes());
        out.extend((u32::from(kind) << 24 | number & 0x00ff_ffff).to_be_bytes());
        match kind {
            LEADER => {
                out.extend([0, 0]);
                out.extend(IMAGE.to_be_bytes());
                out.extend(self.timestamp_ns.to_be_bytes());
                let [x, y] = self.corner_px;
                for value in [self.pixel_format, self.width_px, self.height_px, x, y, 0] {
                    out.extend(value.to_be_bytes());
                }
            }
            TRAILER => {
                out.extend([0, 0]);
                out.extend(IMAGE.to_be_bytes());
                out.extend(self.height_px.to_be_bytes());
            }
            _ => {
                let start = (number as usize - 1) * self.data_bytes();
                let end = (start + self.data_bytes()).min(self.pixels.len());
                out.extend(&self.pixels[start..end]);
            }
        }
        true
    }
}

/// The number after this one: 0 is never used.
pub fn next_id(id: u16) -> u16 {
    id.checked_add(1).unwrap_or(1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn packets_carry_every_pixel_once() {
        for (pixels, packet_bytes) in [(1, 576), (540, 576), (541, 576), (100_000, 1500)] {
            let block = Block {
                id: 7,
                timestamp_ns: 1 << 40,
                pixel_format: cell::pixel_format::PixelFormat::Mono8.code(),
                corner_px: [0, 0],
                width_px: pixels as u32,
                height_px: 1,
                packet_bytes,
                pixels: (0..pixels).map(|i| i as u8).collect(),
            };
            let (mut packet, mut joined) = (Vec::new(), Vec::<u8>::new());
            for number in 0..block.packets() {
                assert!(block.packet(number, &mut packet));
                assert!(packet.len() + 28 <= packet_bytes.max(28 + 8 + 36));
                assert_eq!(&packet[2..4], [0, 7]);
                if packet[4] == PAYLOAD {
                    joined.extend(&packet[8..]);
                }
            }
            assert!(!block.packet(block.packets(), &mut packet));
            assert_eq!(joined, block.pixels);
        }
        assert_eq!((next_id(1), next_id(u16::MAX)), (2, 1));
    }
}
