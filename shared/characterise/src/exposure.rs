//! How well a camera is exposed for a sequence of patterns, and which exposure times suit it better.
//!
//! A pixel's range over all frames of a sequence is twice the modulation that its fringes have, as far as the projector blurs neither
//! stripes nor fringes. Lit pixels are those with a range; whether they are clipped, or too dark for their phase, says how to
//! expose.

use fringe::frame::FrameView;
use serde::Serialize;

/// A pixel whose range is below this share of the full scale sees no light of the projector.
const LEAST_RANGE: f64 = 0.04;
/// A pixel at or above this share of the full scale may be clipped.
const CLIPPED: f64 = 0.99;
/// Brightest values of the lit pixels end here, as a share of the full scale.
const WANTED: f64 = 0.85;
/// Share of the lit pixels that may be brighter: mirrors, rims.
const BRIGHTER: f64 = 0.005;
/// An exposure that is off by less is good.
const GOOD: f64 = 0.1;
/// Largest step at once where pixels are clipped, and where none are.
const DOWN: f64 = 0.5;
const UP: f64 = 16.0;
/// Modulation, as a share of the full scale, below which a pixel is weak.
const WEAK: f64 = 0.05;
/// Share of weak pixels from which a second, longer exposure pays.
const MANY_WEAK: f64 = 0.05;
/// Ratio of two exposures that belong together.
const RATIO: f64 = 4.0;

/// The brightest and the darkest value of each pixel over the frames that came.
#[derive(Debug, Clone)]
pub struct SeenRange {
    least: Vec<u16>,
    most: Vec<u16>,
    full_scale_dn: u16,
}

/// What a pixel sees of the projector over the frames that came.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PixelLight {
    /// Nothing: its range is below 4 % of the full scale.
    Unlit,
    /// Fringes with this modulation over the full scale, 0.02 … 0.5.
    Lit(f32),
    /// A frame in which it may be clipped.
    Clipped,
}

/// What the ranges of a camera say.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ExposureState {
    /// Lit pixels over all pixels.
    pub lit_fraction: f64,
    /// Clipped pixels over the lit ones.
    pub clipped_fraction: f64,
    /// Weak pixels, with a modulation below 5 % of the full scale, over the lit ones.
    pub weak_fraction: f64,
    /// Median modulation of the lit pixels over the full scale.
    pub modulation_median: f64,
    /// Brightest value of the lit pixels over the full scale, but for the brightest 0.5 %.
    pub brightest: f64,
    /// Median of the darkest values of the lit pixels over the full scale.
    pub darkest: f64,
}

impl SeenRange {
    /// Nothing seen yet of so many pixels.
    pub fn new(pixels: usize, full_scale_dn: u16) -> Self {
        Self { least: vec![u16::MAX; pixels], most: vec![0; pixels], full_scale_dn: full_scale_dn.max(1) }
    }

    /// Takes a frame of the sequence; further pixels than the range has are left out.
    pub fn take(&mut self, frame: &FrameView<'_>) {
        for (place, (least, most)) in
            self.least.iter_mut().zip(&mut self.most).enumerate().take(frame.pixels.len())
        {
            let value = frame.pixels.get(place) as u16;
            *least = (*least).min(value);
            *most = (*most).max(value);
        }
    }

    /// What each pixel sees, row by row.
    pub fn pixels(&self) -> Vec<PixelLight> {
        let full = f64::from(self.full_scale_dn);
        let light = |(least, most): (&u16, &u16)| {
            let range = f64::from(most.saturating_sub(*least));
            if f64::from(*most) >= CLIPPED * full {
                PixelLight::Clipped
            } else if range < LEAST_RANGE * full {
                PixelLight::Unlit
            } else {
                PixelLight::Lit((0.5 * range / full) as f32)
            }
        };
        self.least.iter().zip(&self.most).map(light).collect()
    }

    /// What the ranges say; `None` where no pixel is lit.
    pub fn state(&self) -> Option<ExposureState> {
        let full = f64::from(self.full_scale_dn);
        let pairs =
            self.least.iter().zip(&self.most).map(|(least, most)| (f64::from(*least), f64::from(*most)));
        let lit: Vec<(f64, f64)> = pairs.filter(|(least, most)| most - least >= LEAST_RANGE * full).collect();
        if lit.is_empty() {
            return None;
        }
        let count = lit.len() as f64;
        let share =
            |is: &dyn Fn(&(f64, f64)) -> bool| lit.iter().filter(|pair| is(pair)).count() as f64 / count;
        let sorted = |of: &dyn Fn(&(f64, f64)) -> f64| {
            let mut values: Vec<f64> = lit.iter().map(of).collect();
            values.sort_by(f64::total_cmp);
            values
        };
        let ranges = sorted(&|(least, most)| most - least);
        let brightest = sorted(&|(_, most)| *most);
        let darkest = sorted(&|(least, _)| *least);
        let most = ((1.0 - BRIGHTER) * (count - 1.0)).floor() as usize;
        Some(ExposureState {
            lit_fraction: count / self.least.len() as f64,
            clipped_fraction: share(&|(_, most)| *most >= CLIPPED * full),
            weak_fraction: share(&|(least, most)| 0.5 * (most - least) < WEAK * full),
            modulation_median: 0.5 * ranges[ranges.len() / 2] / full,
            brightest: brightest[most] / full,
            darkest: darkest[darkest.len() / 2] / full,
        })
    }
}

impl ExposureState {
    /// Factor on the exposure time that brings the brightest pixels to 85 % of the full scale; clipped ones hide how bright they
    /// are, so the time is halved.
    pub fn factor(&self) -> f64 {
        if self.clipped_fraction > BRIGHTER {
            return DOWN;
        }
        // What is there without light does not grow.
        let light = (self.brightest - self.darkest).max(1e-3);
        ((WANTED - self.darkest) / light).clamp(DOWN, UP)
    }

    /// Whether another exposure would gain little.
    pub fn is_good(&self) -> bool {
        self.clipped_fraction <= BRIGHTER && (self.factor() - 1.0).abs() <= GOOD
    }

    /// Exposure times for a part that is bright here and dark there, the shortest first: this one, and longer ones as long as pixels
    /// are weak.
    pub fn several_us(&self, exposure_us: f64) -> Vec<f64> {
        let mut times = vec![exposure_us];
        if self.weak_fraction > MANY_WEAK {
            times.push(exposure_us * RATIO);
        }
        // Where most of what is lit stays weak, once more.
        if self.weak_fraction > 0.5 {
            times.push(exposure_us * RATIO * RATIO);
        }
        times
    }
}

/// From this value on a pixel may be clipped, DN.
pub fn clipped_dn(full_scale_dn: u16) -> f64 {
    CLIPPED * f64::from(full_scale_dn)
}

/// How sharp a picture is: the mean square of the differences of neighbouring pixels over the square of the mean, in percent. It has no unit and
/// rises towards focus; only values of the same scene under the same pattern may be compared.
pub fn sharpness(frame: &FrameView<'_>) -> f64 {
    let (width, height) = (frame.width_px as usize, frame.height_px as usize);
    let (mut squares, mut sum, mut count) = (0.0, 0.0, 0.0);
    for row in 0..height {
        for column in 0..width {
            let place = row * width + column;
            let value = f64::from(frame.pixels.get(place));
            sum += value;
            if column + 1 < width && row + 1 < height {
                let across = f64::from(frame.pixels.get(place + 1)) - value;
                let down = f64::from(frame.pixels.get(place + width)) - value;
                squares += across * across + down * down;
                count += 1.0;
            }
        }
    }
    let mean = sum / (width * height).max(1) as f64;
    if count > 0.0 && mean > 0.0 { 100.0 * squares / count / (mean * mean) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn state(pairs: &[(u8, u8)]) -> Option<ExposureState> {
        let mut range = SeenRange::new(pairs.len(), 255);
        for pick in [|pair: &(u8, u8)| pair.0, |pair: &(u8, u8)| pair.1] {
            let values: Vec<u8> = pairs.iter().map(pick).collect();
            range.take(&FrameView::from_bytes(values.len() as u32, 1, 255, &values).unwrap());
        }
        range.state()
    }

    #[test]
    fn bright_is_shortened_dark_is_prolonged_and_good_is_left() {
        assert_eq!(state(&[(5, 5); 10]), None);
        let bright = state(&[(5, 255); 10]).unwrap();
        assert_eq!((bright.clipped_fraction, bright.factor(), bright.is_good()), (1.0, 0.5, false));
        let dark = state(&[(0, 51); 10]).unwrap();
        assert!((dark.factor() - 4.25).abs() < 1e-9 && !dark.is_good());
        // The factor leads to a good exposure, with any light that is always there.
        for black in [0, 20, 60] {
            let seen = state(&[(black, black + 40); 10]).unwrap();
            let after = black + (40.0 * seen.factor()).round() as u8;
            assert!(state(&[(black, after); 10]).unwrap().is_good(), "{black}: {after}");
        }
    }

    #[test]
    fn a_part_that_is_dark_in_places_gets_longer_exposures_too() {
        let mut pairs = [(0, 215); 100];
        assert_eq!(state(&pairs).unwrap().several_us(1000.0), [1000.0]);
        pairs[..20].fill((0, 15));
        let state = state(&pairs).unwrap();
        assert!(state.is_good() && (state.weak_fraction - 0.2).abs() < 1e-9);
        assert_eq!(state.several_us(1000.0), [1000.0, 4000.0]);
    }

    #[test]
    fn blur_lowers_the_sharpness_and_brightness_leaves_it() {
        let stripes = |soft: bool, gain: u8| -> Vec<u8> {
            let level = |x: usize| match (x % 8, soft) {
                (0..4, false) => 100,
                (4.., false) => 20,
                (2 | 6, true) => 60,
                (0..2 | 7, true) => 90,
                (_, true) => 30,
            };
            (0..64 * 8).map(|i| level(i % 64) / gain).collect()
        };
        let of = |values: Vec<u8>| sharpness(&FrameView::from_bytes(64, 8, 255, &values).unwrap());
        let (sharp, soft, dim) = (of(stripes(false, 1)), of(stripes(true, 1)), of(stripes(false, 2)));
        assert!(sharp > 1.5 * soft && (sharp - dim).abs() < 1e-9, "{sharp} {soft} {dim}");
        assert_eq!(of(vec![0; 512]), 0.0);
    }

    #[test]
    fn each_pixel_is_unlit_clipped_or_lit_with_its_modulation() {
        let mut range = SeenRange::new(4, 255);
        range.take(&FrameView::from_bytes(4, 1, 255, &[9, 0, 100, 200]).unwrap());
        range.take(&FrameView::from_bytes(4, 1, 255, &[18, 51, 255, 98]).unwrap());
        assert_eq!(
            range.pixels(),
            [PixelLight::Unlit, PixelLight::Lit(0.1), PixelLight::Clipped, PixelLight::Lit(0.2)]
        );
    }

    #[test]
    fn frames_of_another_size_do_no_harm() {
        let mut range = SeenRange::new(2, 255);
        range.take(&FrameView::from_bytes(3, 1, 255, &[1, 2, 3]).unwrap());
        range.take(&FrameView::from_bytes(1, 1, 255, &[200]).unwrap());
        assert!(range.state().is_some_and(|state| state.lit_fraction == 0.5));
    }
}
