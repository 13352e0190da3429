//! Loops compiled for the vector instructions that the processor has, with the same bits on all of them.
//!
//! The loops are plain Rust, or vectors where the compiler makes single values of a loop: sums, products, quotients, square roots and integers,
//! each rounded by itself. Neither fuses or reorders them, so wider vectors change the time and not the result. The functions called must be
//! `#[inline(always)]`: what is not inlined, as a closure may not be, is compiled for the plainest processor.
//!
//! What the compiler made single values of, as `callgrind --dump-instr=yes` shows: a choice between two numbers in memory, which it takes for one of
//! two places; a counter of 64 bits that becomes a number; five windows that overlap, which it shuffles together; long functions.

use fearless_simd::{Level, Simd, SimdBase, f32x8, f64x8};

/// Runs an expression compiled for each level of instructions, at the best one up to a given [`Level`]. `|simd|` before it names what makes
/// vectors of that level, for loops that the compiler does not make vectors of by itself.
macro_rules! vectorised {
    ($level:expr, |$simd:ident| $body:expr) => {
        fearless_simd::dispatch!($level, $simd => $body)
    };
    ($level:expr, $body:expr) => {
        fearless_simd::dispatch!($level, _level => $body)
    };
}
pub(crate) use vectorised;

/// The best level of this processor.
pub(crate) fn best_level() -> Level {
    Level::new()
}

/// A fixed number of values from a place on; they must be there.
#[inline(always)]
pub(crate) fn taken<T: Copy + Default, const N: usize>(values: &[T], first: usize) -> [T; N] {
    let mut taken = [T::default(); N];
    taken.copy_from_slice(&values[first..first + N]);
    taken
}

/// Values from a place on, as many as a vector of the level has.
#[inline(always)]
pub(crate) fn loaded<S: Simd>(simd: S, values: &[f32], first: usize) -> S::f32s {
    S::f32s::from_slice(simd, &values[first..][..S::f32s::LEN])
}

/// Writes a vector from a place on.
#[inline(always)]
pub(crate) fn put<S: Simd>(vector: S::f32s, values: &mut [f32], first: usize) {
    vector.store_slice(&mut values[first..][..S::f32s::LEN]);
}

/// The same numbers in single precision.
#[inline(always)]
pub(crate) fn narrowed<S: Simd>(simd: S, numbers: f64x8<S>) -> f32x8<S> {
    let (low, high) = simd.split_f64x8(numbers);
    simd.narrow_f64x4(low, high)
}

/// The same numbers in double precision.
#[inline(always)]
pub(crate) fn widened<S: Simd>(simd: S, numbers: f32x8<S>) -> f64x8<S> {
    let (low, high) = simd.widen_f32x8(numbers);
    simd.combine_f64x4(low, high)
}

/// All levels of this processor, the plainest first.
#[cfg(test)]
pub(crate) fn levels() -> Vec<Level> {
    let best = Level::new();
    let mut all = vec![Level::baseline()];
    #[cfg(target_arch = "x86_64")]
    {
        all.extend(best.as_sse4_2().map(fearless_simd::Simd::level));
        all.extend(best.as_avx2().map(fearless_simd::Simd::level));
        all.extend(best.as_avx512().map(fearless_simd::Simd::level));
    }
    all.push(best);
    all
}
