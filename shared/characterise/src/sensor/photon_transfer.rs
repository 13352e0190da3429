//! Read noise and gain of a camera from the lines of variance against grey value that its recordings show.

use fringe::sensor::CameraNoise;

/// One line of variance against grey value: what the residuals of stepped fringes show in one recording.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NoiseEstimate {
    /// Variance in the dark, DN².
    pub read_variance_dn2: f64,
    /// Variance per DN of signal, DN.
    pub gain_dn: f64,
    /// Pixels that it rests on.
    pub pixels: usize,
}

/// Standard uncertainty of either number from a single line, as a part of it: what one recording does not tell.
const SINGLE_PART: f64 = 0.1;

/// Read noise and gain with their standard uncertainties, DN, from several lines; `None` without any.
///
/// The lines are averaged by their pixels; the scatter from line to line gives the uncertainty.
pub fn photon_transfer(lines: &[NoiseEstimate]) -> Option<(CameraNoise, [f64; 2])> {
    let weight = lines.iter().map(|line| line.pixels as f64).sum::<f64>();
    if weight <= 0.0 {
        return None;
    }
    let values: [fn(&NoiseEstimate) -> f64; 2] = [|line| line.read_variance_dn2, |line| line.gain_dn];
    let means =
        values.map(|value| lines.iter().map(|line| line.pixels as f64 * value(line)).sum::<f64>() / weight);
    let n = lines.len() as f64;
    let u = [0, 1].map(|i| {
        if lines.len() < 2 {
            return SINGLE_PART * means[i];
        }
        let squares = |line: &NoiseEstimate| {
            let part = line.pixels as f64 / weight;
            part * part * (values[i](line) - means[i]).powi(2)
        };
        (lines.iter().map(squares).sum::<f64>() * n / (n - 1.0)).sqrt()
    });
    let read_noise_dn = means[0].max(0.0).sqrt();
    let noise = CameraNoise { read_noise_dn, gain_dn: means[1] };
    // d(read²) = 2 read d(read).
    Some((noise, [u[0] / (2.0 * read_noise_dn.max(f64::MIN_POSITIVE)), u[1]]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_averaged_and_their_scatter_is_the_uncertainty() {
        let line = |read_variance_dn2, gain_dn, pixels| NoiseEstimate { read_variance_dn2, gain_dn, pixels };
        let lines = [line(0.24, 0.025, 8000), line(0.26, 0.023, 8000)];
        let (noise, u) = photon_transfer(&lines).unwrap();
        assert!((noise.read_noise_dn - 0.5).abs() < 1e-12 && (noise.gain_dn - 0.024).abs() < 1e-12);
        // Two values ± d about their mean: s/√2 = d.
        assert!((u[1] - 0.001).abs() < 1e-12 && (u[0] - 0.01).abs() < 1e-12, "{u:?}");
        let single = photon_transfer(&lines[..1]).unwrap();
        assert!(single.1[1] > 0.002);
        assert_eq!(photon_transfer(&[]), None);
    }
}
