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

/// What a footprint of variance s² that was taken off a phase does to the noise that a window of a half width leaves: its variance grows by a first number
/// times s² and a second times s⁴. The half Laplacian over 5 × 5 pixels, s² times which is taken off, raises the noise of a single pixel by less
/// than that at the periods of windows, which is all that smoothing leaves.
const RAISED: [[f64; 2]; MAX_HALF + 1] =
    [[0.114_286, 0.028_571], [0.205_714, 0.043_991], [0.419_725, 0.067_445], [0.331_690, 0.042_138]];

/// The same of the other view, whose noise is interpolated in every window; the third number times s² comes off for each of its pixels that a sample
/// fills.
const OTHER_RAISED: [[f64; 3]; MAX_HALF + 1] =
    [[0.42, 0.063, 0.0], [0.45, 0.066, 0.0], [0.49, 0.060, 0.065], [0.50, 0.042, 0.125]];

/// Least and most pixels of the other view that the table is made for.
const FILLED: [f64; 2] = [0.5, 2.0];

/// What is left of the noise of a view and of the other one by the half width of a window, over what the decoder states of single pixels.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Shares {
    own: [f64; MAX_HALF + 1],
    /// Factors on [`other_left`], and what comes off them for each pixel that a sample fills.
    other: [[f64; 2]; MAX_HALF + 1],
}

impl Shares {
    /// By the variances of the footprints that were taken off the phases of this and of the other view, px².
    pub fn new([own_px2, other_px2]: [f64; 2]) -> Self {
        let raised = |first: f64, second: f64, s2: f64| 1.0 + s2 * (first + s2 * second);
        // The decoder has raised its uncertainties by what a single pixel becomes noisier.
        let single = [own_px2, other_px2].map(|s2| raised(RAISED[0][0], RAISED[0][1], s2));
        let own = |half: usize| {
            let [first, second] = RAISED[half];
            OWN_SHARE[half] * raised(first, second, own_px2) / single[0]
        };
        let other = |[first, second, each]: [f64; 3]| {
            [raised(first, second, other_px2), other_px2 * each].map(|part| part / single[1])
        };
        Self { own: std::array::from_fn(own), other: OTHER_RAISED.map(other) }
    }

    /// Variance left by a window of a half width, of noise whose share `own` is independent in each sample; a sample fills so many pixels of the
    /// other view.
    #[inline(always)]
    pub fn left(&self, half: usize, own: f64, filled: f64) -> f64 {
        let half = half.min(MAX_HALF);
        own * self.own[half] + (1.0 - own) * self.other_left(half, filled)
    }

    /// The part of it that is its own.
    pub fn own_left(&self, half: usize) -> f64 {
        self.own[half]
    }

    /// The part of it that is the other view's.
    #[inline(always)]
    pub fn other_left(&self, half: usize, filled: f64) -> f64 {
        let [at_none, each] = self.other[half];
        // Not a number where no surface is.
        let within = if filled > FILLED[0] { filled } else { FILLED[0] };
        let within = if within < FILLED[1] { within } else { FILLED[1] };
        other_left(half, filled) * (at_none - each * within)
    }
}

/// Variance left by a window of a half width of what is interpolated, of which no footprint was taken off.
#[inline(always)]
fn other_left(half: usize, filled: f64) -> f64 {
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

    /// Pixels along a side of the other view.
    const PIXELS: usize = 40;

    /// Weights of a window's quadratic at its middle, with the columns and rows from it.
    fn weights(half: usize) -> Vec<([f64; 2], f64)> {
        let reach = -(half as isize)..=half as isize;
        if half == 0 {
            return vec![([0.0; 2], 1.0)];
        }
        let inverse = whole(half).cholesky().unwrap().inverse();
        let weight =
            |u: f64, v: f64| inverse.row(0).transpose().dot(&Vector6::new(1.0, u, v, u * u, u * v, v * v));
        let places = reach.clone().flat_map(|v| reach.clone().map(move |u| [u as f64, v as f64]));
        places.map(|[u, v]| ([u, v], weight(u, v))).collect()
    }

    /// Sum of the squares of the weights of pixels from which the half Laplacian over 5 × 5 pixels was taken off, so many times.
    fn without_bend(sums: &[f64], s2: f64) -> f64 {
        let bend = |i: usize| ((i % 5) as f64 - 2.0).powi(2) + ((i / 5) as f64 - 2.0).powi(2) - 4.0;
        let mut taken = sums.to_vec();
        for (pixel, sum) in sums.iter().enumerate().filter(|(_, sum)| **sum != 0.0) {
            for i in 0..25 {
                taken[pixel + i / 5 * PIXELS + i % 5 - 2 * PIXELS - 2] -= s2 * sum * bend(i) / 70.0;
            }
        }
        taken.iter().map(|sum| sum * sum).sum()
    }

    /// Variance left by a window's quadratic of what is interpolated between independent pixels from which the bend was taken off, over that of a sample
    /// of independent ones, by `map` from samples to pixels.
    fn left_of_interpolated(half: usize, map: [[f64; 2]; 2], s2: f64) -> f64 {
        let (mut left, mut alone) = (0.0, 0.0);
        for place in 0..36 {
            let shift = [place % 6, place / 6].map(|i| 20.0 + (f64::from(i) + 0.5) / 6.0);
            let mut sums = vec![0.0; PIXELS * PIXELS];
            for ([u, v], weight) in weights(half) {
                let [x, y] = [0, 1].map(|i| shift[i] + map[i][0] * u + map[i][1] * v);
                let (column, row) = (x.floor() as usize - 1, y.floor() as usize - 1);
                for (i, share) in between(x - x.floor() - 0.5, y - y.floor() - 0.5).into_iter().enumerate() {
                    sums[(row + i / 4) * PIXELS + column + i % 4] += weight * share;
                }
            }
            left += without_bend(&sums, s2);
            alone += between(shift[0].fract() - 0.5, shift[1].fract() - 0.5)
                .map(|share| share * share)
                .iter()
                .sum::<f64>();
        }
        left / alone
    }

    /// Pixels of the other view stretched along a row, alike in both directions, and obliquely; with no footprint and with one.
    #[test]
    fn the_share_of_the_other_view_follows_its_pixels() {
        let c = f64::sqrt(0.5);
        for (half, s2) in (0..=MAX_HALF).flat_map(|half| [0.0, 0.3].map(|s2| (half, s2))) {
            let stated = Shares::new([0.0, s2]);
            for filled in [0.5, 0.7, 1.0, 1.4, 2.0] {
                let root = f64::sqrt(filled);
                let maps = [
                    [[filled, 0.0], [0.0, 1.0]],
                    [[root, 0.0], [0.0, root]],
                    [[filled * c, -filled * c], [c, c]],
                ];
                let shares = maps.map(|map| left_of_interpolated(half, map, s2));
                // What a single pixel becomes noisier is in what is stated of it.
                let mean = shares.iter().sum::<f64>() / 3.0 / single(s2);
                let stated = stated.other_left(half, filled);
                assert!((stated / mean - 1.0).abs() < 0.06, "{half}, {s2}, {filled}: {stated} of {shares:?}");
            }
        }
    }

    /// Variance of a single pixel without its footprint.
    fn single(s2: f64) -> f64 {
        let mut alone = vec![0.0; PIXELS * PIXELS];
        alone[PIXELS * PIXELS / 2 + PIXELS / 2] = 1.0;
        without_bend(&alone, s2)
    }

    /// Windows leave more of noise from which a footprint was taken off: 9 % more of its variance over 5 × 5 pixels where it is 0.53 px.
    #[test]
    fn a_footprint_that_is_taken_off_leaves_more_noise() {
        for (half, s2) in (0..=MAX_HALF).flat_map(|half| [0.0, 0.1, 0.286, 0.5].map(|s2| (half, s2))) {
            let mut sums = vec![0.0; PIXELS * PIXELS];
            for ([u, v], weight) in weights(half) {
                sums[(20.0 + v) as usize * PIXELS + (20.0 + u) as usize] = weight;
            }
            let expected = without_bend(&sums, s2) / single(s2);
            let found = Shares::new([s2, 0.0]).left(half, 1.0, 1.0);
            assert!((found / expected - 1.0).abs() < 1e-3, "{half}, {s2}: {found} of {expected}");
        }
        let [none, some] = [0.0, 0.286].map(|s2| Shares::new([s2, 0.0]).own_left(2));
        assert!((some / none - 1.09).abs() < 0.005, "{some} of {none}");
    }
}
