//! Read noise and gain of a camera from the lines of variance against grey value that its recordings show.

use fringe::decode::QUANTISATION_DN2;
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

/// Standard uncertainty of either number from a single line, as a part of it: what one recording does not tell. Of n lines the n-th part of the n-th
/// part is left at least: the scatter of two or three may be small by chance.
const SINGLE_PART: f64 = 0.1;

/// Read noise and gain with their standard uncertainties, DN, from several lines; `None` without any.
///
/// The lines are averaged by their pixels; the scatter from line to line gives the uncertainty. No line has less read noise than rounding makes: where the
/// black level lies above 0 the line through it may, and then only a limit of the read noise is known, and the gain as from a single line.
pub fn photon_transfer(lines: &[NoiseEstimate]) -> Option<(CameraNoise, [f64; 2])> {
    let weight = lines.iter().map(|line| line.pixels as f64).sum::<f64>();
    if weight <= 0.0 {
        return None;
    }
    let values: [fn(&NoiseEstimate) -> f64; 2] = [|line| line.read_variance_dn2, |line| line.gain_dn];
    let means =
        values.map(|value| lines.iter().map(|line| line.pixels as f64 * value(line)).sum::<f64>() / weight);
    let n = lines.len() as f64;
    let at_limit = lines.iter().any(|line| line.read_variance_dn2 <= QUANTISATION_DN2);
    let u = [0, 1].map(|i| {
        if lines.len() < 2 {
            return SINGLE_PART * means[i];
        }
        let squares = |line: &NoiseEstimate| {
            let part = line.pixels as f64 / weight;
            part * part * (values[i](line) - means[i]).powi(2)
        };
        let scatter = (lines.iter().map(squares).sum::<f64>() * n / (n - 1.0)).sqrt();
        scatter.max(SINGLE_PART * means[i] / (n * n))
    });
    let read_noise_dn = means[0].max(0.0).sqrt();
    let noise = CameraNoise { read_noise_dn, gain_dn: means[1] };
    // d(read²) = 2 read d(read).
    let u_read_dn = u[0] / (2.0 * read_noise_dn.max(f64::MIN_POSITIVE));
    if !at_limit {
        return Some((noise, [u_read_dn, u[1]]));
    }
    // Anything from 0 to the limit, as a rectangle about the limit that reaches 0.
    Some((noise, [u_read_dn.max(read_noise_dn / 3.0_f64.sqrt()), u[1].max(SINGLE_PART * means[1])]))
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
        let alike = photon_transfer(&[lines[0], lines[0]]).unwrap();
        assert!((alike.1[1] - 0.025 * 0.025).abs() < 1e-12, "two that are alike by chance: {alike:?}");
        let black = [line(QUANTISATION_DN2, 0.0229, 8000), line(QUANTISATION_DN2, 0.0228, 8000)];
        let (noise, u) = photon_transfer(&black).unwrap();
        assert!(u[0] > 0.5 * noise.read_noise_dn && u[1] > 0.09 * noise.gain_dn, "{noise:?}, {u:?}");
        let single = photon_transfer(&lines[..1]).unwrap();
        assert!(single.1[1] > 0.002);
        assert_eq!(photon_transfer(&[]), None);
    }
}
