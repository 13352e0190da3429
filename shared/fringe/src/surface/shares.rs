//! What smoothing leaves of the noise of both views.
//!
//! Each sample has noise of its own pixel, which its neighbours do not share, and noise of the other view, which they do: it is interpolated, and how many
//! pixels of the other view lie between two samples depends on how steeply it sees the surface.

/// Largest half width of the smoothing window, px.
pub(super) const MAX_HALF: usize = 3;

/// Sum of squared weights by the half width of the window: the variance left of noise that is independent in each sample.
pub(super) const OWN_SHARE: [f64; MAX_HALF + 1] = [1.0, 0.5556, 0.1543, 0.0748];

/// The same for the noise of the other view, which interpolation over 4 × 4 of its pixels has spread over neighbouring
/// samples already: one over the first number and, for each of its pixels that a sample fills ([`super::point::View::filled`]), the second. Mean over
/// all places between its pixels; within 5 % from 0.5 to 2 pixels, however they are stretched or turned.
const OTHER_SHARE: [[f64; 2]; MAX_HALF + 1] = [[1.0, 0.0], [1.012, 0.121], [0.873, 1.198], [0.90, 2.859]];

/// Variance left by a window of a half width, of noise whose share `own` is independent in each sample; a sample fills so many pixels of the
/// other view.
#[inline(always)]
pub(super) fn share_left(half: usize, own: f64, filled: f64) -> f64 {
    let half = half.min(MAX_HALF);
    own * OWN_SHARE[half] + (1.0 - own) * other_left(half, filled)
}

/// The part of it that is the other view's.
#[inline(always)]
pub(super) fn other_left(half: usize, filled: f64) -> f64 {
    let [first, each] = OTHER_SHARE[half];
    // Neither view sees the back of a surface: less than nothing is noise of its slope.
    let left = 1.0 / (first + each * if filled > 0.0 { filled } else { 0.0 });
    if left < 1.0 { left } else { 1.0 }
}

/// Smoothing takes out only what differs from pixel to pixel.
#[inline(always)]
pub(super) fn shared(left: f64, independent: f64) -> f64 {
    1.0 - (1.0 - left) * independent
}

#[cfg(test)]
mod tests {
    use super::super::smooth::whole;
    use super::*;
    use nalgebra::Vector6;

    /// Value at a place between four pixels of the quadratic through 4 × 4 of them, as a sum of theirs.
    fn between(x: f64, y: f64) -> [f64; 16] {
        let terms = |x: f64, y: f64| Vector6::new(1.0, x, y, x * x - 1.25, x * y, y * y - 1.25);
        let norms = [16.0, 20.0, 20.0, 16.0, 25.0, 16.0];
        let at = |i: usize| [(i % 4) as f64 - 1.5, (i / 4) as f64 - 1.5];
        std::array::from_fn(|i| {
            let products = terms(x, y).component_mul(&terms(at(i)[0], at(i)[1]));
            products.iter().zip(norms).map(|(product, norm)| product / norm).sum()
        })
    }

    /// Variance left by a window's quadratic of what is interpolated between independent pixels, over that of a sample, by `map` from samples to pixels.
    fn left_of_interpolated(half: usize, map: [[f64; 2]; 2]) -> f64 {
        const PIXELS: usize = 40;
        let inverse = whole(half).cholesky().unwrap().inverse();
        let reach = -(half as isize)..=half as isize;
        let (mut left, mut alone) = (0.0, 0.0);
        for place in 0..36 {
            let shift = [place % 6, place / 6].map(|i| 20.0 + (f64::from(i) + 0.5) / 6.0);
            let mut sums = vec![0.0; PIXELS * PIXELS];
            for (v, u) in reach.clone().flat_map(|v| reach.clone().map(move |u| (v as f64, u as f64))) {
                let weight = inverse.row(0).transpose().dot(&Vector6::new(1.0, u, v, u * u, u * v, v * v));
                let [x, y] = [0, 1].map(|i| shift[i] + map[i][0] * u + map[i][1] * v);
                let (column, row) = (x.floor() as usize - 1, y.floor() as usize - 1);
                for (i, share) in between(x - x.floor() - 0.5, y - y.floor() - 0.5).into_iter().enumerate() {
                    sums[(row + i / 4) * PIXELS + column + i % 4] += weight * share;
                }
            }
            left += sums.iter().map(|sum| sum * sum).sum::<f64>();
            alone += between(shift[0].fract() - 0.5, shift[1].fract() - 0.5)
                .map(|share| share * share)
                .iter()
                .sum::<f64>();
        }
        left / alone
    }

    /// Pixels of the other view stretched along a row, alike in both directions, and obliquely.
    #[test]
    fn the_share_of_the_other_view_follows_its_pixels() {
        let c = f64::sqrt(0.5);
        for half in 1..=MAX_HALF {
            for filled in [0.5, 0.7, 1.0, 1.4, 2.0] {
                let root = f64::sqrt(filled);
                let maps = [
                    [[filled, 0.0], [0.0, 1.0]],
                    [[root, 0.0], [0.0, root]],
                    [[filled * c, -filled * c], [c, c]],
                ];
                let shares = maps.map(|map| left_of_interpolated(half, map));
                let (mean, stated) = (shares.iter().sum::<f64>() / 3.0, other_left(half, filled));
                assert!((stated / mean - 1.0).abs() < 0.06, "{half}, {filled}: {stated} of {shares:?}");
            }
        }
    }
}
