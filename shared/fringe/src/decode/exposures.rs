//! One phase map from several exposures of the same scene, for parts that are shiny here and dark there.
//!
//! Each exposure is decoded by itself, with its own noise and its own mask of clipped and dark pixels; then a pixel takes the inverse-variance mean
//! of the exposures that are valid there. Merging phases and not grey values keeps the camera's black level and the steps between exposures out of
//! the fringes: a sum of cosines with an offset is still one, a patchwork of two scales is not.

use crate::phase::{PhaseMap, PhaseViewMut};

/// The map of one exposure.
#[derive(Debug, Clone, Copy)]
pub struct Exposed<'a> {
    /// Absolute phase decoded from this exposure.
    pub map: &'a PhaseMap,
    /// Exposure time in milliseconds.
    pub exposure_ms: f64,
}

/// Phases that differ by more standard deviations than this, or by this angle, are not of one order, rad: then the better one stands alone.
const APART_SIGMAS: f64 = 6.0;
const APART_RAD: f32 = 1.0;

/// Merges maps of the size, axis and period of `out`; also counts the pixels that each exposure measures best. The modulation is that of the best
/// exposure, scaled to the first one's time.
///
/// A pixel where two exposures contradict each other by an order keeps the one with the smaller uncertainty. Without a map no pixel is valid.
pub fn merge_exposures(exposures: &[Exposed<'_>], out: &mut PhaseViewMut<'_>, best_of: &mut [usize]) {
    best_of.fill(0);
    let alike = || exposures.iter().enumerate().filter(|(_, e)| e.map.info == out.info);
    for i in 0..out.info.len() {
        let usable = || alike().filter(|(_, e)| e.map.valid[i] == 1);
        let best = usable().min_by(|a, b| a.1.map.sigma_rad[i].total_cmp(&b.1.map.sigma_rad[i]));
        let Some((number, best)) = best else {
            (out.phase_rad[i], out.sigma_rad[i], out.valid[i]) = (f32::NAN, f32::NAN, 0);
            out.modulation[i] = alike().next().map_or(0.0, |(_, first)| first.map.modulation[i]);
            continue;
        };
        let (phase, sigma) = (best.map.phase_rad[i], f64::from(best.map.sigma_rad[i]));
        let (mut w, mut wx) = (0.0, 0.0);
        for (_, e) in usable() {
            let apart = e.map.phase_rad[i] - phase;
            let other = f64::from(e.map.sigma_rad[i]);
            let limit = APART_SIGMAS * (sigma * sigma + other * other).sqrt();
            if apart.abs() < APART_RAD && f64::from(apart.abs()) <= limit {
                w += 1.0 / (other * other);
                wx += f64::from(apart) / (other * other);
            }
        }
        out.phase_rad[i] = (f64::from(phase) + wx / w) as f32;
        out.sigma_rad[i] = (1.0 / w).sqrt() as f32;
        out.modulation[i] = best.map.modulation[i] * (exposures[0].exposure_ms / best.exposure_ms) as f32;
        out.valid[i] = 1;
        best_of[number] += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pattern::Axis;
    use crate::phase::PhaseInfo;

    fn map(pixels: &[Option<(f32, f32)>]) -> PhaseMap {
        let info = PhaseInfo { width_px: pixels.len() as u32, height_px: 1, axis: Axis::X, period_px: 16.0 };
        let mut map = PhaseMap::new(info);
        for (i, (phase, sigma)) in pixels.iter().enumerate().filter_map(|(i, p)| Some((i, (*p)?))) {
            (map.phase_rad[i], map.sigma_rad[i], map.modulation[i], map.valid[i]) = (phase, sigma, 80.0, 1);
        }
        map
    }

    #[test]
    fn each_pixel_takes_what_its_exposures_tell() {
        let short = map(&[Some((5.0, 0.02)), Some((5.0, 0.03)), None, Some((7.0, 0.05))]);
        let long = map(&[None, Some((5.05, 0.04)), None, Some((7.0 + std::f32::consts::TAU, 0.01))]);
        let exposures = [Exposed { map: &short, exposure_ms: 2.0 }, Exposed { map: &long, exposure_ms: 8.0 }];
        let (mut merged, mut best_of) = (map(&[Some((1.0, 0.5)); 4]), vec![7; 2]);
        merge_exposures(&exposures, &mut merged.view_mut(), &mut best_of);
        assert_eq!(merged.valid, [1, 1, 0, 1]);
        assert!(merged.phase_rad[2].is_nan() && merged.sigma_rad[2].is_nan());
        assert_eq!((merged.phase_rad[0], merged.sigma_rad[0]), (5.0, 0.02));
        // Weights 1/9 and 1/16.
        assert!((merged.phase_rad[1] - (5.0 + 0.05 * 9.0 / 25.0)).abs() < 1e-5);
        assert!((merged.sigma_rad[1] - 0.024).abs() < 1e-6);
        assert!(
            (merged.phase_rad[3] - 7.0 - std::f32::consts::TAU).abs() < 1e-6 && merged.sigma_rad[3] == 0.01
        );
        assert_eq!((merged.modulation[0], merged.modulation[3], best_of), (80.0, 20.0, vec![2, 1]));
        merge_exposures(&[], &mut merged.view_mut(), &mut []);
        assert_eq!(merged.valid, [0; 4]);
    }
}
