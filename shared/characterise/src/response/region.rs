//! Means over a region of frames of even grey levels.

use super::ResponseError;
use fringe::frame::FrameView;
use serde::Serialize;
use std::fmt;
use std::str::FromStr;

/// Most pixels of a region: with 1024 frames of 16 bits these are half a gigabyte.
const MOST_PIXELS: u64 = 1 << 18;

/// Side of the region that is taken when none is named, px: that of the thesis (section 3.1.3.1).
const USUAL_SIDE_PX: u32 = 100;

/// A rectangle of pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Roi {
    /// First column of the region, px.
    pub x: u32,
    /// First row of the region, px.
    pub y: u32,
    /// Number of columns, px.
    pub width_px: u32,
    /// Number of rows, px.
    pub height_px: u32,
}

impl Roi {
    /// The middle of a frame: 100 × 100 px, or half of a side that is shorter than 200 px.
    pub fn centre(width_px: u32, height_px: u32) -> Self {
        let side = |full: u32| (full / 2).clamp(1, USUAL_SIDE_PX);
        let (width, height) = (side(width_px), side(height_px));
        Self {
            x: width_px.saturating_sub(width) / 2,
            y: height_px.saturating_sub(height) / 2,
            width_px: width,
            height_px: height,
        }
    }

    /// Number of pixels of the region.
    pub fn pixels(&self) -> u64 {
        u64::from(self.width_px) * u64::from(self.height_px)
    }

    /// Refuses a region that is empty or not within a frame.
    ///
    /// # Errors
    /// [`ResponseError::RoiOutside`].
    pub fn check(&self, width_px: u32, height_px: u32) -> Result<(), ResponseError> {
        let within = |first: u32, length: u32, full: u32| {
            length > 0 && u64::from(first) + u64::from(length) <= u64::from(full)
        };
        if within(self.x, self.width_px, width_px) && within(self.y, self.height_px, height_px) {
            return Ok(());
        }
        Err(ResponseError::RoiOutside { roi: self.to_string(), width_px, height_px })
    }

    /// Grey values of the region, row by row, DN. The region must lie within the frame.
    pub fn crop(&self, frame: &FrameView<'_>) -> Vec<u16> {
        let mut values = Vec::with_capacity(self.pixels() as usize);
        for row in self.y..self.y + self.height_px {
            let first = row as usize * frame.width_px as usize + self.x as usize;
            values.extend((first..first + self.width_px as usize).map(|i| frame.pixels.get(i) as u16));
        }
        values
    }
}

impl fmt::Display for Roi {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{},{},{},{}", self.x, self.y, self.width_px, self.height_px)
    }
}

impl FromStr for Roi {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers: Vec<u32> = text
            .split(',')
            .map(|part| part.trim().parse::<u32>().map_err(|_| format!("\"{part}\" is no pixel number")))
            .collect::<Result<_, _>>()?;
        match numbers.as_slice() {
            [x, y, width_px, height_px] if *width_px > 0 && *height_px > 0 => {
                Ok(Self { x: *x, y: *y, width_px: *width_px, height_px: *height_px })
            }
            _ => Err("four numbers x,y,width,height in px, width and height above 0".into()),
        }
    }
}

/// What the region showed at one level.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct GreyLevel {
    /// Drawn, 0 … 1.
    pub level: f64,
    /// Mean over the pixels that never saturate, DN.
    pub mean_dn: f64,
    /// Sample standard deviation over these pixels, DN: shading and noise.
    pub sd_dn: f64,
    /// Pixels of the region that are full at this level.
    pub saturated: usize,
}

/// The region in all frames.
#[derive(Debug, Clone)]
pub struct Stack {
    size: Option<(u32, u32, u16)>,
    asked: Option<Roi>,
    roi: Roi,
    crops: Vec<(f64, Vec<u16>)>,
}

impl Stack {
    /// An empty stack; without a region the middle of the frames is taken.
    pub fn new(roi: Option<Roi>) -> Self {
        Self { size: None, asked: roi, roi: Roi::centre(1, 1), crops: Vec::new() }
    }

    /// Adds the frame of a level 0 … 1.
    ///
    /// # Errors
    /// A region outside of the frame or too large, a frame unlike the first one.
    pub fn push(&mut self, level: f64, frame: &FrameView<'_>) -> Result<(), ResponseError> {
        let size = (frame.width_px, frame.height_px, frame.full_scale_dn);
        match self.size {
            None => {
                self.roi = self.asked.unwrap_or_else(|| Roi::centre(size.0, size.1));
                self.roi.check(size.0, size.1)?;
                if self.roi.pixels() > MOST_PIXELS {
                    return Err(ResponseError::RoiLarge { pixels: self.roi.pixels(), limit: MOST_PIXELS });
                }
                self.size = Some(size);
            }
            Some(first) if first != size => {
                let text = |(w, h, full): (u32, u32, u16)| format!("{w} × {h} px, full at {full} DN");
                let number = self.crops.len();
                return Err(ResponseError::Unequal { number, found: text(size), expected: text(first) });
            }
            Some(_) => {}
        }
        self.crops.push((level, self.roi.crop(frame)));
        Ok(())
    }

    /// The region in use.
    pub fn roi(&self) -> Roi {
        self.roi
    }

    /// Grey value at which the sensor is full.
    pub fn full_scale_dn(&self) -> u16 {
        self.size.map_or(u16::MAX, |size| size.2)
    }

    /// Pixels that saturate in some frame: they are left out of all, so that each level is the mean of the same pixels.
    pub fn saturated_pixels(&self) -> usize {
        self.usable().iter().filter(|usable| !**usable).count()
    }

    fn usable(&self) -> Vec<bool> {
        let full = self.full_scale_dn();
        let mut usable = vec![true; self.roi.pixels() as usize];
        for (_, crop) in &self.crops {
            usable.iter_mut().zip(crop).for_each(|(u, dn)| *u &= *dn < full);
        }
        usable
    }

    /// Means by rising level; frames of equal level are averaged.
    ///
    /// # Errors
    /// More than half of the region's pixels saturate.
    pub fn levels(&self) -> Result<Vec<GreyLevel>, ResponseError> {
        let usable = self.usable();
        let mut levels: Vec<(usize, GreyLevel)> =
            self.crops.iter().map(|(level, crop)| (1, self.grey_level(*level, crop, &usable))).collect();
        let kept = usable.iter().filter(|u| **u).count();
        if 2 * kept < usable.len() || kept == 0 {
            let worst = levels.iter().map(|(_, l)| l).max_by_key(|l| l.saturated);
            return Err(ResponseError::Saturated {
                saturated: usable.len() - kept,
                pixels: usable.len(),
                level: worst.map_or(0.0, |l| l.level),
            });
        }
        levels.sort_by(|(_, a), (_, b)| a.level.total_cmp(&b.level));
        levels.dedup_by(|(_, next), (count, first)| {
            let same = next.level == first.level;
            if same {
                *count += 1;
                first.mean_dn += (next.mean_dn - first.mean_dn) / *count as f64;
                first.saturated = first.saturated.max(next.saturated);
            }
            same
        });
        Ok(levels.into_iter().map(|(_, level)| level).collect())
    }

    fn grey_level(&self, level: f64, crop: &[u16], usable: &[bool]) -> GreyLevel {
        let full = self.full_scale_dn();
        let values = || crop.iter().zip(usable).filter(|(_, usable)| **usable).map(|(dn, _)| f64::from(*dn));
        let count = values().count();
        let mean_dn = values().sum::<f64>() / count.max(1) as f64;
        let squares: f64 = values().map(|dn| (dn - mean_dn) * (dn - mean_dn)).sum();
        let sd_dn = (squares / count.saturating_sub(1).max(1) as f64).sqrt();
        GreyLevel { level, mean_dn, sd_dn, saturated: crop.iter().filter(|dn| **dn >= full).count() }
    }
}
