//! Normal equations of a grey-value model over the pixels of a window, eight pixels side by side.

use fearless_simd::prelude::*;
use fearless_simd::{Level, dispatch, f64x8, mask64x8};
use nalgebra::{SMatrix, SVector};

/// One pixel of a window: position relative to the window's origin, px, and grey value, DN.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sample {
    pub x: f64,
    pub y: f64,
    pub value: f64,
}

/// A model of N parameters, of which the first two are the position sought.
pub(crate) trait Model<const N: usize> {
    /// What all pixels share at one set of parameters.
    type Prepared;
    /// Computes what all pixels share.
    fn prepare(&self, parameters: &SVector<f64, N>) -> Self::Prepared;
    /// Value and derivative by each parameter, of eight pixels side by side.
    fn evaluate<S: Simd>(
        &self,
        prepared: &Self::Prepared,
        x: f64x8<S>,
        y: f64x8<S>,
    ) -> (f64x8<S>, [f64x8<S>; N]);
}

/// Grey values at which the sensor is clipped.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Range {
    empty_dn: f64,
    full_dn: f64,
}

/// With fewer pixels between empty and full than this part, an image has two levels by intent, not by too much light.
const BETWEEN: f64 = 0.04;

impl Range {
    /// A sensor that is never clipped.
    pub const OPEN: Self = Self { empty_dn: f64::NEG_INFINITY, full_dn: f64::INFINITY };

    /// The range of a window of pixels.
    pub fn of(samples: &[Sample], full_scale_dn: f64) -> Self {
        let between = samples.iter().filter(|s| s.value > 0.0 && s.value < full_scale_dn).count();
        if (between as f64) < BETWEEN * samples.len() as f64 {
            return Self::OPEN;
        }
        Self { empty_dn: 0.0, full_dn: full_scale_dn }
    }

    /// A full pixel gives only a lower limit of the light, an empty one only an upper limit.
    #[inline(always)]
    fn hides<S: Simd>(&self, seen: f64x8<S>, model: f64x8<S>) -> mask64x8<S> {
        let full = seen.simd_ge(self.full_dn) & model.simd_ge(self.full_dn);
        let empty = seen.simd_le(self.empty_dn) & model.simd_le(self.empty_dn);
        full | empty
    }
}

/// JᵀJ, Jᵀr and rᵀr.
pub(crate) struct Normal<const N: usize> {
    pub matrix: SMatrix<f64, N, N>,
    pub vector: SVector<f64, N>,
    pub cost: f64,
    /// Number of pixels that were not clipped.
    pub count: usize,
}

impl<const N: usize> Normal<N> {
    /// Variance of the residuals.
    pub fn variance(&self) -> f64 {
        self.cost / self.count.saturating_sub(N).max(1) as f64
    }
}

/// Pixels that are evaluated together: their derivatives stay in the nearest cache.
const CHUNK: usize = 128;
const LANES: usize = 8;
/// Columns of the matrix that are summed side by side.
const TOGETHER: usize = 4;

/// Some pixels of a window, coordinate by coordinate.
struct Chunk {
    x: [f64; CHUNK],
    y: [f64; CHUNK],
    seen: [f64; CHUNK],
    count: usize,
}

/// A window of pixels as fits take it.
pub(crate) struct Pixels(Vec<Chunk>);

impl Pixels {
    pub fn new(samples: &[Sample]) -> Self {
        let chunk = |samples: &[Sample]| {
            let mut chunk =
                Chunk { x: [0.0; CHUNK], y: [0.0; CHUNK], seen: [0.0; CHUNK], count: samples.len() };
            for (k, sample) in samples.iter().enumerate() {
                (chunk.x[k], chunk.y[k], chunk.seen[k]) = (sample.x, sample.y, sample.value);
            }
            chunk
        };
        Self(samples.chunks(CHUNK).map(chunk).collect())
    }
}

/// Normal equations of a model at parameters, over the pixels that are not clipped.
pub(crate) fn normal<const N: usize>(
    model: &impl Model<N>,
    at: &SVector<f64, N>,
    pixels: &Pixels,
    range: Range,
) -> Normal<N> {
    normal_with(Level::new(), model, at, (pixels, range))
}

/// The same with given instructions, which change no bit.
fn normal_with<const N: usize>(
    level: Level,
    model: &impl Model<N>,
    at: &SVector<f64, N>,
    (pixels, range): (&Pixels, Range),
) -> Normal<N> {
    let prepared = model.prepare(at);
    let mut normal = Normal { matrix: SMatrix::zeros(), vector: SVector::zeros(), cost: 0.0, count: 0 };
    let mut rows = Rows { slopes: [[0.0; CHUNK]; N], residuals: [0.0; CHUNK] };
    for chunk in &pixels.0 {
        normal.count += dispatch!(level, simd => rows.fill(simd, (model, &prepared), chunk, range));
        dispatch!(level, simd => normal.add(simd, &rows, chunk.count));
    }
    for i in 0..N {
        for j in 0..i {
            normal.matrix[(j, i)] = normal.matrix[(i, j)];
        }
        // A parameter without influence is held.
        if normal.matrix[(i, i)] == 0.0 {
            normal.matrix[(i, i)] = 1.0;
        }
    }
    normal
}

/// Derivatives and residuals of a chunk of pixels.
struct Rows<const N: usize> {
    slopes: [[f64; CHUNK]; N],
    residuals: [f64; CHUNK],
}

impl<const N: usize> Rows<N> {
    /// Evaluates a chunk and returns the number of pixels that count; the others have zeros, as have those beyond the chunk.
    #[inline(always)]
    fn fill<S: Simd, M: Model<N>>(
        &mut self,
        simd: S,
        (model, prepared): (&M, &M::Prepared),
        chunk: &Chunk,
        range: Range,
    ) -> usize {
        let (blocks, mut count) = (chunk.count.div_ceil(LANES).min(CHUNK / LANES), chunk.count);
        for block in 0..blocks {
            let start = block * LANES;
            let lanes = |of: &[f64; CHUNK]| f64x8::from_slice(simd, &of[start..start + LANES]);
            let (seen, (value, slopes)) =
                (lanes(&chunk.seen), model.evaluate(prepared, lanes(&chunk.x), lanes(&chunk.y)));
            self.residuals[start..start + LANES].copy_from_slice((seen - value).as_slice());
            for (row, slope) in self.slopes.iter_mut().zip(&slopes) {
                row[start..start + LANES].copy_from_slice(slope.as_slice());
            }
            if range.hides(seen, value).any_true() {
                for l in 0..LANES.min(chunk.count - start) {
                    if range.hides(f64x8::splat(simd, seen[l]), f64x8::splat(simd, value[l])).any_true() {
                        self.clear(start + l);
                        count -= 1;
                    }
                }
            }
        }
        for beyond in chunk.count..blocks * LANES {
            self.clear(beyond);
        }
        count
    }

    fn clear(&mut self, pixel: usize) {
        self.residuals[pixel] = 0.0;
        self.slopes.iter_mut().for_each(|row| row[pixel] = 0.0);
    }
}

impl<const N: usize> Normal<N> {
    /// Adds pixels to the lower half of the matrix, to the vector and to the cost.
    #[inline(always)]
    fn add<S: Simd>(&mut self, simd: S, rows: &Rows<N>, count: usize) {
        let blocks = count.div_ceil(LANES).min(CHUNK / LANES);
        for i in 0..N {
            let row = &rows.slopes[i];
            for j in (0..=i).step_by(TOGETHER) {
                // Beyond the diagonal the last one is repeated.
                let columns = std::array::from_fn(|k| &rows.slopes[(j + k).min(i)]);
                let sums = dots(simd, row, columns, blocks);
                for (k, sum) in sums.into_iter().enumerate().take(i + 1 - j) {
                    self.matrix[(i, j + k)] += sum;
                }
            }
        }
        for i in (0..N).step_by(TOGETHER) {
            let columns = std::array::from_fn(|k| &rows.slopes[(i + k).min(N - 1)]);
            let sums = dots(simd, &rows.residuals, columns, blocks);
            for (k, sum) in sums.into_iter().enumerate().take(N - i) {
                self.vector[i + k] += sum;
            }
        }
        self.cost += dots(simd, &rows.residuals, [&rows.residuals; TOGETHER], blocks)[0];
    }
}

/// Σ a·b over the first blocks of lanes, for some b side by side.
#[inline(always)]
fn dots<S: Simd>(
    simd: S,
    a: &[f64; CHUNK],
    with: [&[f64; CHUNK]; TOGETHER],
    blocks: usize,
) -> [f64; TOGETHER] {
    let lanes =
        |of: &[f64; CHUNK], block: usize| f64x8::from_slice(simd, &of[block * LANES..(block + 1) * LANES]);
    let mut sums = [f64x8::splat(simd, 0.0); TOGETHER];
    for block in 0..blocks {
        let a = lanes(a, block);
        for k in 0..TOGETHER {
            sums[k] += a * lanes(with[k], block);
        }
    }
    let mut totals = [0.0; TOGETHER];
    for k in 0..TOGETHER {
        let [a, b, c, d, e, f, g, h] = sums[k].into();
        totals[k] = ((a + e) + (c + g)) + ((b + f) + (d + h));
    }
    totals
}

/// Value and derivatives of a model at one pixel.
#[cfg(test)]
pub(crate) fn evaluated<const N: usize>(
    model: &impl Model<N>,
    at: &SVector<f64, N>,
    x: f64,
    y: f64,
) -> (f64, [f64; N]) {
    let prepared = model.prepare(at);
    dispatch!(Level::new(), simd => {
        let (value, slopes) =
            model.evaluate(&prepared, f64x8::splat(simd, x), f64x8::splat(simd, y));
        (value[0], slopes.map(|slope| slope[0]))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// a + b·x + c·x·y.
    struct Twisted;

    impl Model<3> for Twisted {
        type Prepared = SVector<f64, 3>;

        fn prepare(&self, p: &SVector<f64, 3>) -> Self::Prepared {
            *p
        }

        #[inline(always)]
        fn evaluate<S: Simd>(
            &self,
            p: &Self::Prepared,
            x: f64x8<S>,
            y: f64x8<S>,
        ) -> (f64x8<S>, [f64x8<S>; 3]) {
            let xy = x * y;
            (p[0] + p[1] * x + p[2] * xy, [f64x8::splat(x.simd, 1.0), x, xy])
        }
    }

    /// Proves: chunks, blocks and clipped pixels give the sums of a plain loop, to the bit the same with all instructions.
    #[test]
    fn sums_are_those_of_a_plain_loop_with_all_instructions() {
        let at = SVector::from([100.0, 7.0, -0.3]);
        let range = Range { empty_dn: 0.0, full_dn: 120.0 };
        for count in [0, 1, 7, 8, CHUNK - 1, CHUNK, CHUNK + 9, 3 * CHUNK] {
            let sample = |k: usize| {
                let (x, y) = ((k % 13) as f64 - 6.0, (k % 17) as f64 - 8.0);
                Sample { x, y, value: (100.0 + 9.0 * x + (k % 5) as f64).clamp(0.0, 120.0) }
            };
            let samples: Vec<Sample> = (0..count).map(sample).collect();
            let (mut matrix, mut vector, mut used) = (SMatrix::<f64, 3, 3>::zeros(), SVector::zeros(), 0);
            for Sample { x, y, value } in &samples {
                let model = at[0] + at[1] * x + at[2] * x * y;
                if *value >= 120.0 && model >= 120.0 {
                    continue;
                }
                let slope = SVector::from([1.0, *x, x * y]);
                matrix += slope * slope.transpose();
                vector += slope * (value - model);
                used += 1;
            }
            let pixels = Pixels::new(&samples);
            let best = normal(&Twisted, &at, &pixels, range);
            assert_eq!(best.count, used, "{count}");
            let held = SMatrix::from_diagonal(&matrix.diagonal().map(|d| f64::from(d == 0.0)));
            assert!((best.matrix - (matrix + held)).amax() < 1e-9 * matrix.amax().max(1.0), "{count}");
            assert!((best.vector - vector).amax() < 1e-9 * matrix.amax().max(1.0), "{count}");
            let new = Level::new();
            let levels =
                [Some(Level::baseline()), new.as_sse4_2().map(Simd::level), new.as_avx2().map(Simd::level)];
            for level in levels.into_iter().flatten() {
                let other = normal_with(level, &Twisted, &at, (&pixels, range));
                assert_eq!((other.matrix, other.vector, other.cost), (best.matrix, best.vector, best.cost));
            }
        }
    }
}
