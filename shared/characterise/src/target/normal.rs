//! Normal equations of a grey-value model over the pixels of a window, sixteen pixels side by side.

use fearless_simd::prelude::*;
use fearless_simd::{Level, dispatch, f32x16, mask32x16};
use nalgebra::{SMatrix, SVector};

/// One pixel of a window: position relative to the window's origin, px, and grey value, DN.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sample {
    pub x: f32,
    pub y: f32,
    pub value: f32,
}

/// A model of N parameters, of which the first two are the position sought.
pub(crate) trait Model<const N: usize> {
    /// What all pixels share at one set of parameters.
    type Prepared;
    /// Computes what all pixels share.
    fn prepare(&self, parameters: &SVector<f64, N>) -> Self::Prepared;
    /// Value and derivative by each parameter, of sixteen pixels side by side.
    fn evaluate<S: Simd>(
        &self,
        prepared: &Self::Prepared,
        x: f32x16<S>,
        y: f32x16<S>,
    ) -> (f32x16<S>, [f32x16<S>; N]);
}

/// Grey values at which the sensor is clipped.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Range {
    empty_dn: f32,
    full_dn: f32,
}

/// With fewer pixels between empty and full than this part, an image has two levels by intent, not by too much light.
const BETWEEN: f64 = 0.04;

impl Range {
    /// A sensor that is never clipped.
    pub const OPEN: Self = Self { empty_dn: f32::NEG_INFINITY, full_dn: f32::INFINITY };

    /// The range of a window of pixels.
    pub fn of(pixels: &Pixels, full_scale_dn: f64) -> Self {
        let full_scale_dn = full_scale_dn as f32;
        let between = pixels.values().filter(|value| *value > 0.0 && *value < full_scale_dn).count();
        if (between as f64) < BETWEEN * pixels.values().count() as f64 {
            return Self::OPEN;
        }
        Self { empty_dn: 0.0, full_dn: full_scale_dn }
    }

    /// A full pixel gives only a lower limit of the light, an empty one only an upper limit.
    #[inline(always)]
    fn hides<S: Simd>(self, seen: f32x16<S>, model: f32x16<S>) -> mask32x16<S> {
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
const LANES: usize = 16;
/// Columns of the matrix that are summed side by side.
const TOGETHER: usize = 4;

/// Some pixels of a window, coordinate by coordinate.
struct Chunk {
    x: [f32; CHUNK],
    y: [f32; CHUNK],
    seen: [f32; CHUNK],
    count: usize,
}

/// A window of pixels as fits take it.
#[derive(Default)]
pub(crate) struct Pixels(Vec<Chunk>);

impl Pixels {
    #[inline]
    pub fn push(&mut self, sample: Sample) {
        if self.0.last().is_none_or(|last| last.count == CHUNK) {
            self.0.push(Chunk { x: [0.0; CHUNK], y: [0.0; CHUNK], seen: [0.0; CHUNK], count: 0 });
        }
        if let Some(chunk) = self.0.last_mut() {
            let at = chunk.count;
            (chunk.x[at], chunk.y[at], chunk.seen[at]) = (sample.x, sample.y, sample.value);
            chunk.count += 1;
        }
    }

    fn values(&self) -> impl Iterator<Item = f32> {
        self.0.iter().flat_map(|chunk| &chunk.seen[..chunk.count]).copied()
    }
}

impl FromIterator<Sample> for Pixels {
    fn from_iter<I: IntoIterator<Item = Sample>>(samples: I) -> Self {
        let mut pixels = Self::default();
        samples.into_iter().for_each(|sample| pixels.push(sample));
        pixels
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
    let mut rows = Rows { slopes: [[0.0; CHUNK]; N], residuals: [0.0; CHUNK] };
    let mut sums = Sums { matrix: [[[0.0; LANES]; N]; N], vector: [[0.0; LANES]; N], cost: [0.0; LANES] };
    let mut count = 0;
    for chunk in &pixels.0 {
        count += dispatch!(level, simd => rows.fill(simd, (model, &prepared), chunk, range));
        dispatch!(level, simd => sums.add(simd, &rows, chunk.count));
    }
    let mut normal = sums.total(count);
    for i in 0..N {
        // A parameter without influence is held.
        if normal.matrix[(i, i)] == 0.0 {
            normal.matrix[(i, i)] = 1.0;
        }
    }
    normal
}

/// Derivatives and residuals of a chunk of pixels.
struct Rows<const N: usize> {
    slopes: [[f32; CHUNK]; N],
    residuals: [f32; CHUNK],
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
            let lanes = |of: &[f32; CHUNK]| f32x16::from_slice(simd, &of[start..start + LANES]);
            let (seen, (value, slopes)) =
                (lanes(&chunk.seen), model.evaluate(prepared, lanes(&chunk.x), lanes(&chunk.y)));
            self.residuals[start..start + LANES].copy_from_slice((seen - value).as_slice());
            for (row, slope) in self.slopes.iter_mut().zip(&slopes) {
                row[start..start + LANES].copy_from_slice(slope.as_slice());
            }
            if range.hides(seen, value).any_true() {
                for l in 0..LANES.min(chunk.count - start) {
                    if range.hides(f32x16::splat(simd, seen[l]), f32x16::splat(simd, value[l])).any_true() {
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

/// Lower half of JᵀJ, Jᵀr and rᵀr, the sums over each lane by themselves.
struct Sums<const N: usize> {
    matrix: [[[f32; LANES]; N]; N],
    vector: [[f32; LANES]; N],
    cost: [f32; LANES],
}

impl<const N: usize> Sums<N> {
    /// Adds a chunk of pixels.
    #[inline(always)]
    fn add<S: Simd>(&mut self, simd: S, rows: &Rows<N>, count: usize) {
        let blocks = count.div_ceil(LANES).min(CHUNK / LANES);
        for i in 0..N {
            let row = &rows.slopes[i];
            for (j, sums) in self.matrix[i][..=i].chunks_mut(TOGETHER).enumerate() {
                // Beyond the diagonal the last one is repeated.
                let columns = std::array::from_fn(|k| &rows.slopes[(j * TOGETHER + k).min(i)]);
                add_products(simd, row, columns, blocks, sums);
            }
        }
        for (i, sums) in self.vector.chunks_mut(TOGETHER).enumerate() {
            let columns = std::array::from_fn(|k| &rows.slopes[(i * TOGETHER + k).min(N - 1)]);
            add_products(simd, &rows.residuals, columns, blocks, sums);
        }
        let cost = std::slice::from_mut(&mut self.cost);
        add_products(simd, &rows.residuals, [&rows.residuals; TOGETHER], blocks, cost);
    }

    /// The sums over all lanes, of pixels that count.
    fn total(&self, count: usize) -> Normal<N> {
        let mut matrix = SMatrix::zeros();
        for i in 0..N {
            for j in 0..=i {
                matrix[(i, j)] = total(&self.matrix[i][j]);
                matrix[(j, i)] = matrix[(i, j)];
            }
        }
        let vector = SVector::from_fn(|i, _| total(&self.vector[i]));
        Normal { matrix, vector, cost: total(&self.cost), count }
    }
}

/// Sum of all lanes, always in the same order.
fn total(lanes: &[f32; LANES]) -> f64 {
    let [a, b, c, d]: [f32; 4] =
        std::array::from_fn(|l| (lanes[l] + lanes[l + 8]) + (lanes[l + 4] + lanes[l + 12]));
    (f64::from(a) + f64::from(c)) + (f64::from(b) + f64::from(d))
}

/// Adds the products of the first blocks of lanes of one row and of up to four others to sums.
#[inline(always)]
fn add_products<S: Simd>(
    simd: S,
    row: &[f32; CHUNK],
    with: [&[f32; CHUNK]; TOGETHER],
    blocks: usize,
    sums: &mut [[f32; LANES]],
) {
    let lanes =
        |of: &[f32; CHUNK], block: usize| f32x16::from_slice(simd, &of[block * LANES..(block + 1) * LANES]);
    let mut adding = [f32x16::splat(simd, 0.0); TOGETHER];
    for block in 0..blocks {
        let a = lanes(row, block);
        for k in 0..TOGETHER {
            adding[k] += a * lanes(with[k], block);
        }
    }
    for (sum, adding) in sums.iter_mut().zip(adding) {
        *sum = (f32x16::simd_from(simd, *sum) + adding).into();
    }
}

/// Value and derivatives of a model at one pixel.
#[cfg(test)]
pub(crate) fn evaluated<const N: usize>(
    model: &impl Model<N>,
    at: &SVector<f64, N>,
    x: f32,
    y: f32,
) -> (f32, [f32; N]) {
    let prepared = model.prepare(at);
    dispatch!(Level::new(), simd => {
        let (value, slopes) =
            model.evaluate(&prepared, f32x16::splat(simd, x), f32x16::splat(simd, y));
        (value[0], slopes.map(|slope| slope[0]))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// a + b·x + c·x·y.
    struct Twisted;

    impl Model<3> for Twisted {
        type Prepared = SVector<f32, 3>;

        fn prepare(&self, p: &SVector<f64, 3>) -> Self::Prepared {
            p.cast()
        }

        #[inline(always)]
        fn evaluate<S: Simd>(
            &self,
            p: &Self::Prepared,
            x: f32x16<S>,
            y: f32x16<S>,
        ) -> (f32x16<S>, [f32x16<S>; 3]) {
            let xy = x * y;
            (p[0] + p[1] * x + p[2] * xy, [f32x16::splat(x.simd, 1.0), x, xy])
        }
    }

    /// Proves: chunks, blocks and clipped pixels give the sums of a plain loop, to the bit the same with all instructions.
    #[test]
    fn sums_are_those_of_a_plain_loop_with_all_instructions() {
        let at = SVector::from([100.0, 7.0, -0.3]);
        let range = Range { empty_dn: 0.0, full_dn: 120.0 };
        for count in [0, 1, 7, 8, CHUNK - 1, CHUNK, CHUNK + 9, 3 * CHUNK] {
            let sample = |k: usize| {
                let (x, y) = ((k % 13) as f32 - 6.0, (k % 17) as f32 - 8.0);
                Sample { x, y, value: (100.0 + 9.0 * x + (k % 5) as f32).clamp(0.0, 120.0) }
            };
            let samples: Vec<Sample> = (0..count).map(sample).collect();
            let (mut matrix, mut vector, mut used) = (SMatrix::<f64, 3, 3>::zeros(), SVector::zeros(), 0);
            for [x, y, value] in samples.iter().map(|s| [s.x, s.y, s.value].map(f64::from)) {
                let model = at[0] + at[1] * x + at[2] * x * y;
                if value >= 120.0 && model >= 120.0 {
                    continue;
                }
                let slope = SVector::from([1.0, x, x * y]);
                matrix += slope * slope.transpose();
                vector += slope * (value - model);
                used += 1;
            }
            let pixels: Pixels = samples.iter().copied().collect();
            let best = normal(&Twisted, &at, &pixels, range);
            assert_eq!(best.count, used, "{count}");
            let held = SMatrix::from_diagonal(&matrix.diagonal().map(|d| f64::from(d == 0.0)));
            assert!((best.matrix - (matrix + held)).amax() < 1e-6 * matrix.amax().max(1.0), "{count}");
            assert!((best.vector - vector).amax() < 1e-6 * matrix.amax().max(1.0), "{count}");
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
