//! The fine stage for some pixels side by side: the same steps as [`solve`](super::subpixel::solve), as vectors, where the 4 × 4
//! neighbourhood is one smooth surface and two evaluations of the curve are enough. That is so nearly everywhere; other pixels are
//! left to it.

// Without branches a loop vectorises.
#![allow(clippy::needless_bitwise_bool)]

use super::patch::{Interpolation, Patch, Sums};
use super::subpixel::{Crossing, RightPhase, inside};
use crate::rectify::RectifiedCamera;

/// Pixels that are solved side by side.
pub(super) const LANES: usize = 8;

/// Evaluations of the curve.
const STEPS: usize = 2;

type Lanes = [f64; LANES];

/// Pixels whose coarse place is known.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Batch {
    /// How many there are, from the front.
    pub count: usize,
    /// Number of the pixel among the hits of the part.
    pub hit: [usize; LANES],
    /// Number of the pixel in its image.
    pub pixel: [usize; LANES],
    /// Phase of the pixel, rad.
    pub wanted: [f32; LANES],
    /// Rectified ordinate of the pixel.
    pub y: Lanes,
    /// Coarse rectified abscissa on the right.
    pub coarse: Lanes,
    /// How far the fine place may be from it, px.
    pub search_px: Lanes,
    /// Smallest and largest disparity.
    pub limits: [[f64; 2]; LANES],
}

/// State of the search.
struct Search {
    x: Lanes,
    /// Whether the general way has to take over.
    lost: [bool; LANES],
    cell: [(usize, usize); LANES],
    offset: [Lanes; 2],
    tangent: [Lanes; 2],
    stretch: Lanes,
}

/// The crossings of a batch; `None` where [`super::subpixel::solve`] has to be asked.
#[inline(always)]
pub(super) fn solve_beside(
    right: &RightPhase,
    camera: &RectifiedCamera,
    batch: &Batch,
) -> [Option<Crossing>; LANES] {
    let mut found = [None; LANES];
    if right.interpolation != Interpolation::Quadratic || right.width < 4 || right.height < 4 {
        return found;
    }
    let zero = [0.0; LANES];
    let mut search = Search {
        x: batch.coarse,
        lost: std::array::from_fn(|l| l >= batch.count),
        cell: [(0, 0); LANES],
        offset: [zero; 2],
        tangent: [zero; 2],
        stretch: zero,
    };
    for step in 0..STEPS {
        search.evaluate(camera, batch);
        let (samples, sigma) = search.gather(right, batch, step > 0);
        search.advance(right, batch, (&samples, &sigma), &mut found);
        if (0..LANES).all(|l| search.lost[l] || found[l].is_some()) {
            break;
        }
    }
    found
}

impl Search {
    /// The places on the curves.
    #[inline(always)]
    fn evaluate(&mut self, camera: &RectifiedCamera, batch: &Batch) {
        for l in 0..LANES {
            let at = camera.curve(batch.y[l]).at(self.x[l]);
            (self.offset[0][l], self.offset[1][l]) = (at.pixel[0], at.pixel[1]);
            (self.tangent[0][l], self.tangent[1][l]) = (at.tangent[0], at.tangent[1]);
            self.stretch[l] = at.stretch;
        }
    }

    /// Finds the cells and their 4 × 4 samples, less the wanted phase; places become offsets from the centres of the cells.
    #[inline(always)]
    fn gather(
        &mut self,
        right: &RightPhase,
        batch: &Batch,
        again: bool,
    ) -> ([[[f32; LANES]; 4]; 4], [f32; LANES]) {
        let (mut samples, mut sigma) = ([[[f32::NAN; LANES]; 4]; 4], [0.0; LANES]);
        let last = [right.width as f64 - 2.0, right.height as f64 - 2.0];
        for l in 0..LANES {
            let place = [self.offset[0][l], self.offset[1][l]];
            let from =
                |(column, row): (usize, usize)| [place[0] - column as f64 - 0.5, place[1] - row as f64 - 0.5];
            if !(again && inside(from(self.cell[l]))) {
                // The whole neighbourhood must lie in the image; NaN fails the comparison.
                let inner = place[0] >= 1.0 && place[1] >= 1.0 && place[0] < last[0] && place[1] < last[1];
                self.lost[l] |= !inner;
                self.cell[l] = if inner { (place[0] as usize, place[1] as usize) } else { (1, 1) };
            }
            let (column, row) = self.cell[l];
            let offset = from((column, row));
            (self.offset[0][l], self.offset[1][l]) = (offset[0], offset[1]);
            if self.lost[l] {
                continue;
            }
            for (line, samples) in samples.iter_mut().enumerate() {
                let values = &right.phase_rad[(row + line - 1) * right.width + column - 1..][..4];
                for (sample, value) in samples.iter_mut().zip(values) {
                    sample[l] = value - batch.wanted[l];
                }
            }
            sigma[l] = right.sigma_rad[right.nearest(column, row, offset)];
        }
        (samples, sigma)
    }

    /// One step along the tangents to where the models vanish; places that are exact enough are found.
    #[inline(always)]
    fn advance(
        &mut self,
        right: &RightPhase,
        batch: &Batch,
        (samples, sigma): (&[[[f32; LANES]; 4]; 4], &[f32; LANES]),
        found: &mut [Option<Crossing>; LANES],
    ) {
        let patches = Patches::fit(samples, sigma);
        let (mut smooth, mut settled) = ([0_u8; LANES], [0_u8; LANES]);
        let (mut slope, mut factor) = ([0.0; LANES], [0.0; LANES]);
        let pitch = right.pitch;
        for l in 0..LANES {
            let tangent = [self.tangent[0][l], self.tangent[1][l]];
            let before = [self.offset[0][l], self.offset[1][l]];
            let (along, steepness) = patches.at(l).step(before, tangent, pitch);
            let x = self.x[l] + along * (1.0 - 0.5 * self.stretch[l] * along);
            let offset = [before[0] + tangent[0] * along, before[1] + tangent[1] * along];
            smooth[l] = patches.accepted[l] & u8::from(along.abs() <= 2.0 * batch.search_px[l] * pitch);
            settled[l] = u8::from(along.abs() < right.reach)
                & u8::from(inside(offset))
                & u8::from((x - batch.coarse[l]).abs() <= batch.search_px[l] * pitch);
            slope[l] = steepness;
            factor[l] = Patch::quadratic_variance(offset[0], offset[1]);
            self.x[l] = x;
            (self.offset[0][l], self.offset[1][l]) = (offset[0], offset[1]);
        }
        for l in 0..LANES {
            self.lost[l] |= smooth[l] == 0;
            if !self.lost[l] && settled[l] != 0 && found[l].is_none() {
                let (column, row) = self.cell[l];
                let pixel = right.nearest(column, row, [self.offset[0][l], self.offset[1][l]]);
                let sigma = f64::from(right.sigma_rad[pixel]);
                found[l] = Some(Crossing {
                    x: self.x[l],
                    slope: slope[l],
                    variance: factor[l] * sigma * sigma,
                    pixel,
                    bilinear: false,
                });
            }
        }
    }
}

/// Single values of the pixels side by side.
type Singles = [f32; LANES];

/// The quadratics of [`Patch::quadratic`], side by side.
struct Patches {
    a: Singles,
    b: [Singles; 2],
    c: [Singles; 3],
    /// 1 where the quadratic holds.
    accepted: [u8; LANES],
}

impl Patches {
    /// The same steps in the same order as for one pixel.
    #[inline(always)]
    fn fit(samples: &[[Singles; 4]; 4], sigma: &Singles) -> Self {
        let zero = [0.0; LANES];
        let (mut zeroth, mut first, mut second, mut squares) = ([zero; 4], [zero; 4], [zero; 4], [zero; 4]);
        let [l0, l1, l2, l3] = samples;
        for i in 0..4 {
            for l in 0..LANES {
                let (inner, outer) = (l1[i][l] + l2[i][l], l0[i][l] + l3[i][l]);
                zeroth[i][l] = inner + outer;
                first[i][l] = 1.5 * (l3[i][l] - l0[i][l]) + 0.5 * (l2[i][l] - l1[i][l]);
                second[i][l] = outer - inner;
                squares[i][l] =
                    l0[i][l] * l0[i][l] + l1[i][l] * l1[i][l] + l2[i][l] * l2[i][l] + l3[i][l] * l3[i][l];
            }
        }
        let mut out = Self { a: zero, b: [zero; 2], c: [zero; 3], accepted: [0; LANES] };
        for l in 0..LANES {
            let sums = Sums {
                zeroth: zeroth.map(|v| v[l]),
                first: first.map(|v| v[l]),
                second: second.map(|v| v[l]),
                squares: squares.map(|v| v[l]),
            };
            let (patch, accepted) = Patch::from_sums(&sums, sigma[l]);
            out.a[l] = patch.a;
            (out.b[0][l], out.b[1][l]) = (patch.b[0], patch.b[1]);
            (out.c[0][l], out.c[1][l], out.c[2][l]) = (patch.c[0], patch.c[1], patch.c[2]);
            out.accepted[l] = u8::from(accepted);
        }
        out
    }

    #[inline(always)]
    fn at(&self, l: usize) -> Patch {
        Patch {
            a: self.a[l],
            b: [self.b[0][l], self.b[1][l]],
            c: [self.c[0][l], self.c[1][l], self.c[2][l]],
            kind: Interpolation::Quadratic,
        }
    }
}
