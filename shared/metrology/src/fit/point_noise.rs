//! What noise along lines of sight does to an element, and the element without it.
//!
//! A camera's point errs along the pixel's line of sight, so that noise moves it along the surface as well, which the orthogonal distance does not show. Its
//! square stays in the mean: on a steep face the distance is too large by σ² (1 − g²) / 2R (g: cosine between line and normal), and the normal that goes with
//! the distance is turned by the same noise. A ball of 24 mm seen up to 65° from its normal with a noise of 0.1 mm comes out 30 µm too small.
//!
//! With F = r ∂r/∂θ of a point, whose sum is zero at the least-squares element, noise adds ½ σ² F'' along the line to its expectation. That sum is taken off,
//! by F a standard deviation ahead and behind. Derived here; the errors-in-variables bias is in Fuller, Measurement Error Models, 1987, chapter 3.

use nalgebra::{Point3, SVector, Vector3};

use super::adjust::{Adjusted, Model};
use super::normal::Normal;

/// Noise of a point along the line on which it moves it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointNoise {
    /// Where the point lies, in the frame of the points that are fitted, mm.
    pub at_mm: Point3<f64>,
    /// Direction of the line, as long as the standard deviation, mm.
    pub along_mm: Vector3<f64>,
}

/// Least square of the residuals, as a part of what the noise would make of them: points that scatter by less contradict it, and nothing is taken off.
/// Leaving out the largest residuals takes a tenth away.
const LEAST_SHOWN: f64 = 0.5;

/// The element that noise has moved to where it was found; as it is where no noise is given, or where the points do not show it.
pub(super) fn freed<M: Model<P>, const P: usize>(
    found: Adjusted<M, P>,
    noise: &[PointNoise],
    centroid: &Vector3<f64>,
) -> M {
    let Adjusted { model, normal } = found;
    if noise.is_empty() || normal.rows == 0 {
        return model;
    }
    let (mut gradient, mut square_mm2) = (SVector::<f64, P>::zeros(), 0.0);
    for point in noise {
        let (at, along) = (point.at_mm.coords - centroid, point.along_mm);
        let [ahead, here, behind] = [at + along, at, at - along].map(|place| gradient_of(&model, &place));
        gradient += (ahead + behind) * 0.5 - here;
        square_mm2 += (0.5 * (model.deviation(&(at + along)) - model.deviation(&(at - along)))).powi(2);
    }
    // The sums are of all points, and of some of them.
    let all = normal.rows as f64 / (M::ROWS * noise.len()) as f64;
    if normal.sum.is_nan() || normal.sum < LEAST_SHOWN * square_mm2 * all {
        return model;
    }
    match Normal::of_sums(normal.symmetric(), gradient * -all).step(0.0) {
        Some(step) if step.iter().all(|value| value.is_finite()) => model.moved(&step),
        _ => model,
    }
}

/// Half the gradient of a point's square by the parameters.
fn gradient_of<M: Model<P>, const P: usize>(model: &M, point: &Vector3<f64>) -> SVector<f64, P> {
    let mut gradient = SVector::zeros();
    model.rows(point, &mut |residual, derivatives| gradient += derivatives * residual);
    gradient
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::tests::Noise;
    use crate::fit::{FitSettings, cylinder, plane, sphere};
    use fringe::math::sincos;

    /// Where a camera stands, above the part.
    const EYE: Vector3<f64> = Vector3::new(20.0, -30.0, 400.0);
    const COUNT: usize = 6000;

    /// Points that noise moves along the lines of sight, with that noise.
    fn seen(
        surface: impl Fn(f64, f64) -> Vector3<f64>,
        sigma_mm: f64,
        seed: u64,
    ) -> (Vec<Point3<f64>>, Vec<PointNoise>) {
        let mut noise = Noise(seed);
        (0..COUNT)
            .map(|_| {
                let (u, v) = (noise.uniform(), noise.uniform());
                let place = surface(u, v);
                let along_mm = (place - EYE).normalize() * sigma_mm;
                let at_mm = Point3::from(place + along_mm * noise.normal());
                (at_mm, PointNoise { at_mm, along_mm })
            })
            .unzip()
    }

    /// Means of an error without and with the noise, their standard error, and the uncertainty that is stated.
    fn means(measure: impl Fn(u64, bool) -> (f64, f64)) -> ([f64; 2], f64, f64) {
        const TRIALS: u64 = 24;
        let found =
            [false, true].map(|known| (1..=TRIALS).map(|seed| measure(seed, known)).collect::<Vec<_>>());
        let mean = |values: &[(f64, f64)]| values.iter().map(|(error, _)| error).sum::<f64>() / TRIALS as f64;
        let u = found[1].iter().map(|(_, u)| u).sum::<f64>() / TRIALS as f64;
        ([mean(&found[0]), mean(&found[1])], u / (TRIALS as f64).sqrt(), u)
    }

    /// Up to 65° from the upper pole of a ball, around it.
    fn ball(radius: f64, u: f64, v: f64) -> Vector3<f64> {
        let up = 1.0 - u * 0.58;
        let ((sin, cos), out) = (sincos(std::f64::consts::TAU * v), (1.0 - up * up).sqrt());
        Vector3::new(radius * out * cos, radius * out * sin, radius * up)
    }

    /// Proves: without the noise a ball is too small by far more than what is stated, with it by no more than chance allows.
    #[test]
    fn a_ball_seen_by_a_camera_has_its_size() {
        let measured = |seed, known: bool| {
            let (points, noise) = seen(|u, v| ball(12.0, u, v), 0.15, seed);
            let noise = if known { &noise[..] } else { &[] };
            let fit = sphere(&points, &FitSettings { noise, ..FitSettings::default() }).unwrap();
            (fit.diameter_mm - 24.0, fit.u_diameter_mm)
        };
        let ([before, after], u_mean, u) = means(measured);
        assert!(before < -3.0 * u_mean && before.abs() > u, "{before} of {u}");
        assert!(after.abs() < 3.0 * u_mean, "{after} of {u_mean}");
    }

    /// Proves: some of the points tell the same as all of them, and a cylinder is freed as a ball is.
    #[test]
    fn a_cylinder_is_freed_by_some_of_its_points() {
        let tube = |u: f64, v: f64| {
            let (sin, cos) = sincos(2.4 * (v - 0.5));
            Vector3::new(30.0 * (u - 0.5), 10.0 * sin, 10.0 * cos)
        };
        let measured = |seed, known: bool| {
            let (points, noise) = seen(tube, 0.15, seed);
            let some: Vec<PointNoise> = noise.into_iter().step_by(4).collect();
            let noise = if known { &some[..] } else { &[] };
            let fit = cylinder(&points, &FitSettings { noise, ..FitSettings::default() }).unwrap();
            (fit.diameter_mm - 20.0, fit.u_diameter_mm)
        };
        let ([before, after], u_mean, u) = means(measured);
        assert!(before.abs() > 3.0 * u_mean, "{before} of {u}");
        assert!(after.abs() < 3.0 * u_mean, "{after} of {u_mean}");
    }

    /// Proves: a plane seen aslant is turned away by its noise, and turned back.
    #[test]
    fn a_plane_seen_aslant_keeps_its_slope() {
        let slope = 1.0_f64;
        let face = |u: f64, v: f64| Vector3::new(4.0 * (u - 0.5), 20.0 * (v - 0.5), slope * 4.0 * (u - 0.5));
        let measured = |seed, known: bool| {
            let (points, noise) = seen(face, 0.15, seed);
            let noise = if known { &noise[..] } else { &[] };
            let fit = plane(&points, &FitSettings { noise, ..FitSettings::default() }).unwrap();
            let normal = fit.normal_vector();
            (-normal.x / normal.z - slope, 2.0 * fit.u_normal_rad)
        };
        let ([before, after], u_mean, u) = means(measured);
        assert!(before.abs() > 3.0 * u_mean, "{before} of {u}");
        assert!(after.abs() < 3.0 * u_mean, "{after} of {u_mean}");
    }

    /// Proves: without noise, and with one that the points do not show, nothing moves.
    #[test]
    fn no_noise_moves_nothing() {
        let (points, noise) = seen(|u, v| ball(12.0, u, v), 0.0, 1);
        let plain = sphere(&points, &FitSettings::default()).unwrap();
        let freed = sphere(&points, &FitSettings { noise: &noise, ..FitSettings::default() }).unwrap();
        assert!((plain.diameter_mm - freed.diameter_mm).abs() < 1e-12);
        let noise: Vec<_> =
            noise.iter().map(|point| PointNoise { along_mm: Vector3::z() * 0.1, ..*point }).collect();
        let refused = sphere(&points, &FitSettings { noise: &noise, ..FitSettings::default() }).unwrap();
        assert_eq!(plain.diameter_mm, refused.diameter_mm);
    }
}
