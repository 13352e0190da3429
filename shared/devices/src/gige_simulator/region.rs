//! The window of the sensor that a frame shows: along each axis a size and an offset, which limit each other.

use super::gvcp::Status;
use super::registers::{Registers, feature};

/// Registers and names of the window along an axis.
#[derive(Debug, Clone, Copy)]
pub struct Axis {
    /// Registers of the size and of the largest one that the offset leaves.
    pub size: u32,
    pub size_limit: u32,
    /// Registers of the offset and of the largest one that the size leaves.
    pub offset: u32,
    pub offset_limit: u32,
    /// Register of the size of the sensor.
    pub sensor: u32,
    /// Names of the features: size, offset, size of the sensor.
    pub names: [&'static str; 3],
    /// Sizes and offsets are multiples of this, px.
    step_px: u32,
}

/// The axes of the sensor: columns, rows.
pub const AXES: [Axis; 2] = [
    Axis {
        size: feature::WIDTH,
        size_limit: feature::WIDTH_LIMIT,
        offset: feature::OFFSET_X,
        offset_limit: feature::OFFSET_X_LIMIT,
        sensor: feature::SENSOR_WIDTH,
        names: ["Width", "OffsetX", "WidthMax"],
        step_px: 4,
    },
    Axis {
        size: feature::HEIGHT,
        size_limit: feature::HEIGHT_LIMIT,
        offset: feature::OFFSET_Y,
        offset_limit: feature::OFFSET_Y_LIMIT,
        sensor: feature::SENSOR_HEIGHT,
        names: ["Height", "OffsetY", "HeightMax"],
        step_px: 2,
    },
];

impl Axis {
    /// Steps of sizes and offsets; of a sensor that is no multiple of the usual ones a pixel.
    pub fn step_px(&self, sensor_px: u32) -> u32 {
        if sensor_px.is_multiple_of(self.step_px) { self.step_px } else { 1 }
    }

    /// Limits that follow from size and offset.
    fn limit(&self, r: &mut Registers) {
        let sensor_px = r.get(self.sensor);
        r.set(self.size_limit, sensor_px - r.get(self.offset).min(sensor_px));
        r.set(self.offset_limit, sensor_px - r.get(self.size).min(sensor_px));
    }
}

/// Opens the window to the whole sensor.
pub fn open(r: &mut Registers, sensor_px: [u32; 2], bytes_per_px: u32) {
    for (axis, sensor_px) in AXES.iter().zip(sensor_px) {
        r.set(axis.sensor, sensor_px);
        r.set(axis.size, sensor_px);
        r.set(axis.offset, 0);
        axis.limit(r);
    }
    r.set(feature::PAYLOAD_BYTES, sensor_px[0] * sensor_px[1] * bytes_per_px);
}

/// Whether a register belongs to the window.
pub fn has(register: u32) -> bool {
    AXES.iter().any(|axis| register == axis.size || register == axis.offset)
}

/// Sets a size or an offset.
///
/// # Errors
/// It is beyond the sensor, or no multiple of the step.
pub fn write(r: &mut Registers, register: u32, value: u32, bytes_per_px: u32) -> Result<(), Status> {
    let Some(axis) = AXES.iter().find(|axis| register == axis.size || register == axis.offset) else {
        return Err(Status::InvalidAddress);
    };
    let step = axis.step_px(r.get(axis.sensor));
    let (least, limit) = if register == axis.size { (step, axis.size_limit) } else { (0, axis.offset_limit) };
    if !(least..=r.get(limit)).contains(&value) || !value.is_multiple_of(step) {
        return Err(Status::InvalidParameter);
    }
    r.set(register, value);
    axis.limit(r);
    let size = |axis: &Axis| r.get(axis.size);
    let bytes = AXES.iter().map(size).product::<u32>() * bytes_per_px;
    r.set(feature::PAYLOAD_BYTES, bytes);
    Ok(())
}

/// A window of the sensor, px.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Region {
    /// First column and row of it.
    pub corner: [u32; 2],
    /// Columns and rows of it.
    pub size: [u32; 2],
    /// Columns and rows of the sensor.
    sensor: [u32; 2],
}

impl Region {
    /// As the registers state it.
    pub fn of(r: &Registers) -> Self {
        Self {
            corner: AXES.map(|axis| r.get(axis.offset)),
            size: AXES.map(|axis| r.get(axis.size)),
            sensor: AXES.map(|axis| r.get(axis.sensor)),
        }
    }

    /// Cuts the window out of the rows of the whole sensor; rows that are not there stay absent.
    pub fn cut(self, bytes_per_px: usize, pixels: &mut Vec<u8>) {
        if self.size == self.sensor {
            return;
        }
        let [x, y] = self.corner.map(|place| place as usize);
        let [width, height] = self.size.map(|size| size as usize);
        let (row_bytes, sensor_bytes) = (width * bytes_per_px, self.sensor[0] as usize * bytes_per_px);
        let rows = (pixels.len() / sensor_bytes.max(1)).saturating_sub(y).min(height);
        for row in 0..rows {
            let from = (y + row) * sensor_bytes + x * bytes_per_px;
            pixels.copy_within(from..from + row_bytes, row * row_bytes);
        }
        pixels.truncate(rows * row_bytes);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_window_has_the_pixels_of_its_place() {
        for bytes_per_px in [1, 2] {
            let mut r = Registers::new("");
            open(&mut r, [12, 6], bytes_per_px as u32);
            for (register, value) in
                [(feature::WIDTH, 4), (feature::OFFSET_X, 8), (feature::HEIGHT, 2), (feature::OFFSET_Y, 4)]
            {
                write(&mut r, register, value, bytes_per_px as u32).unwrap();
            }
            assert_eq!(r.get(feature::PAYLOAD_BYTES), 8 * bytes_per_px as u32);
            let whole: Vec<u8> = (0..72 * bytes_per_px).map(|n| n as u8).collect();
            let mut pixels = whole.clone();
            Region::of(&r).cut(bytes_per_px, &mut pixels);
            let expected: Vec<u8> = [4, 5]
                .iter()
                .flat_map(|y| &whole[(y * 12 + 8) * bytes_per_px..(y * 12 + 12) * bytes_per_px])
                .copied()
                .collect();
            assert_eq!(pixels, expected);
            // A frame that lacks its last row lacks it in the window too.
            let mut short = whole[..60 * bytes_per_px].to_vec();
            Region::of(&r).cut(bytes_per_px, &mut short);
            assert_eq!(short, expected[..4 * bytes_per_px]);
        }
    }

    #[test]
    fn a_window_beyond_the_sensor_or_between_its_steps_is_refused() {
        let mut r = Registers::new("");
        open(&mut r, [12, 5], 1);
        let mut refused =
            |register, value| write(&mut r, register, value, 1) == Err(Status::InvalidParameter);
        assert!(refused(feature::WIDTH, 16) && refused(feature::WIDTH, 6) && refused(feature::WIDTH, 0));
        assert!(refused(feature::OFFSET_X, 4), "the window is as wide as the sensor");
        assert!(!refused(feature::WIDTH, 8) && !refused(feature::OFFSET_X, 4) && refused(feature::WIDTH, 12));
        // An odd sensor moves by single rows.
        assert!(
            !refused(feature::HEIGHT, 3) && !refused(feature::OFFSET_Y, 1) && refused(feature::OFFSET_Y, 3)
        );
    }
}
