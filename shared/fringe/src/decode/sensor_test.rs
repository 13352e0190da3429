//! What the frames say of a camera whose footprint and noise the calibration has found.
//!
//! Both are constants of the camera. A recording of a small part estimates them badly, so the calibration's values count; but
//! a lens out of focus, dirt or another gain must not go unseen.

use crate::sensor::{CameraNoise, Footprint};

/// Beyond so many standard uncertainties two values contradict each other.
const CONTRADICTION: f64 = 3.0;
/// What light between surfaces and focus bend the line of the contrast by, px²: it belongs to the scene, not to the lens.
pub(super) const SCENE_U_PX2: f64 = 0.05;
/// Standard deviations of the noise that differ by more than this part contradict each other: harmonics, flicker and texture
/// make up the rest.
const NOISE_PART: f64 = 0.25;

/// A footprint as the calibration and as the frames show it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FootprintTest {
    /// Of the calibration, mean of both directions, px.
    pub known_px: f64,
    /// As these frames alone show it, px.
    pub seen_px: f64,
    /// Standard uncertainty of the latter, px.
    pub u_seen_px: f64,
    /// Whether the frames contradict the calibration.
    pub contradicts: bool,
}

/// Noise as the calibration and as the frames show it, at the background of the frames.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NoiseTest {
    /// Background at which both are compared, DN.
    pub background_dn: f64,
    /// Standard deviation by the calibration, DN.
    pub known_dn: f64,
    /// Standard deviation as these frames show it, DN.
    pub seen_dn: f64,
    /// Whether the frames contradict the calibration; then their own noise counts.
    pub contradicts: bool,
}

/// What the frames of one axis say of the camera's constants.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct SensorTest {
    /// Where the calibration states a footprint and the frames show one.
    pub footprint: Option<FootprintTest>,
    /// Where the calibration states the noise and the frames show it.
    pub noise: Option<NoiseTest>,
}

impl SensorTest {
    /// By how much the variance of the footprint differs from that of the calibration, px², where the frames contradict it.
    pub fn footprint_off_px2(&self) -> Option<f64> {
        let test = self.footprint.filter(|test| test.contradicts)?;
        Some(test.seen_px * test.seen_px - test.known_px * test.known_px)
    }

    /// What contradicts the calibration, each with its numbers; `camera` is named.
    pub fn warnings(&self, camera: &str) -> Vec<String> {
        let footprint = self.footprint.filter(|test| test.contradicts).map(|test| {
            format!(
                "camera \"{camera}\": these frames show a footprint of {:.3} px (u {:.3} px), the rig file states {:.3} px, which \
                 counts: look at focus, aperture and dirt, or calibrate again",
                test.seen_px, test.u_seen_px, test.known_px
            )
        });
        let noise = self.noise.filter(|test| test.contradicts).map(|test| {
            format!(
                "camera \"{camera}\": these frames show a noise of {:.2} DN at {:.0} DN, the rig file states {:.2} DN; that of the \
                 frames counts: look at the camera's gain and at light that flickers, or calibrate again",
                test.seen_dn, test.background_dn, test.known_dn
            )
        });
        footprint.into_iter().chain(noise).collect()
    }
}

/// Compares a footprint with the variance that the frames show, px², and its standard uncertainty, px².
pub(super) fn footprint(known: Footprint, (seen_px2, u_seen_px2): (f64, f64)) -> FootprintTest {
    let (variance_px2, u_px2) = known.variance_px2();
    let u2 = u_px2 * u_px2 + u_seen_px2 * u_seen_px2 + SCENE_U_PX2 * SCENE_U_PX2;
    let seen_px = seen_px2.max(0.0).sqrt();
    FootprintTest {
        known_px: variance_px2.sqrt(),
        seen_px,
        // d(σ²) = 2 σ dσ; near zero the root of the uncertainty bounds it.
        u_seen_px: (0.5 * u_seen_px2 / seen_px.max(f64::MIN_POSITIVE)).min(u_seen_px2.sqrt()),
        contradicts: (seen_px2 - variance_px2).abs() > CONTRADICTION * u2.sqrt(),
    }
}

/// Compares the noise with that of the frames at a background.
pub(super) fn noise(known: CameraNoise, seen_dn: f64, background_dn: f64) -> NoiseTest {
    let known_dn = known.variance_dn2(background_dn).sqrt();
    let (less, more) = (known_dn.min(seen_dn), known_dn.max(seen_dn));
    NoiseTest { background_dn, known_dn, seen_dn, contradicts: more > (1.0 + NOISE_PART) * less }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lens_out_of_focus_is_found_and_a_bad_estimate_is_not_blamed() {
        let known = Footprint { sigma_px: [0.55, 0.59], u_px: Some([0.01; 2]), field_px2: 0.0 };
        let line = |sigma_px: f64, u_px2| (sigma_px * sigma_px, u_px2);
        assert!(!footprint(known, line(0.6, 0.01)).contradicts);
        assert!(!footprint(known, line(0.74, 0.1)).contradicts, "a small part tells little");
        assert!(footprint(known, line(0.95, 0.03)).contradicts);
        let sharp = footprint(known, (-0.2, 0.02));
        assert!(sharp.contradicts && sharp.seen_px == 0.0 && sharp.u_seen_px.is_finite());
    }

    #[test]
    fn another_gain_is_a_contradiction_and_the_warning_has_the_numbers() {
        let known = CameraNoise { read_noise_dn: 0.5, gain_dn: 0.024 };
        let seen_dn = |factor: f64| factor * known.variance_dn2(80.0).sqrt();
        assert!(!noise(known, seen_dn(1.2), 80.0).contradicts);
        assert!(noise(known, seen_dn(0.6), 80.0).contradicts);
        let test = noise(known, seen_dn(2.0), 80.0);
        assert!(test.contradicts);
        let warnings = SensorTest { noise: Some(test), footprint: None }.warnings("cam2");
        assert_eq!(warnings.len(), 1);
        assert!(warnings[0].contains("\"cam2\"") && warnings[0].contains("2.95 DN at 80 DN"), "{warnings:?}");
        assert!(SensorTest::default().warnings("cam2").is_empty());
    }
}
