//! Loops over short vectors.
#![allow(clippy::inline_always)] // other functions are compiled without the caller's instruction set

use super::Matrix;
use crate::real::Real;
use std::ops::Mul;

/// `out += factor * x`
#[inline(always)]
pub fn add_scaled<R: Real + Mul<F, Output = R>, F: Copy>(out: &mut [R], factor: F, x: &[R]) {
    for (out, x) in out.iter_mut().zip(x) {
        *out += *x * factor;
    }
}

/// Runs `$small` with the constant `$N` equal to `$n` up to 8, and `$any` beyond: the vectors of small
/// systems are so short that a loop of unknown length costs more than its work.
macro_rules! short {
    ($n:expr, $N:ident => $small:expr, $any:expr) => {
        short!(@ $n, $N, $small, $any, 1 2 3 4 5 6 7 8)
    };
    (@ $n:expr, $N:ident, $small:expr, $any:expr, $($size:literal)*) => {
        match $n {
            $($size => { const $N: usize = $size; $small })*
            _ => $any,
        }
    };
}
pub(super) use short;

/// Columns that are summed in registers at a time, where there are so many.
const BLOCK: usize = 16;

/// `out_ik = Σ_j weights_ij x_jk`, for as many rows as both `out` and `weights` have; then `finish(i, k, sums)`
/// does what is left to do to some that follow one another.
#[inline(always)]
pub fn combine<R: Real>(
    out: &mut [R],
    weights: &Matrix,
    x: &Matrix<R>,
    finish: impl Fn(usize, usize, &mut [R]) + Copy,
) {
    combine_rows(out, weights, (x.flat(), x.cols()), finish);
}

/// [`combine`] of rows of `cols` numbers that follow one another in `x`.
#[inline(always)]
pub fn combine_rows<R: Real>(
    out: &mut [R],
    weights: &Matrix,
    (x, cols): (&[R], usize),
    finish: impl Fn(usize, usize, &mut [R]) + Copy,
) {
    if R::IS_SINGLE {
        combine_alone(out, weights, (x, cols), finish);
    } else {
        // a sum of several members is kept in registers as it is
        combine_members(out, weights, (x, cols), finish);
    }
}

#[inline(always)]
fn combine_members<R: Real>(
    out: &mut [R],
    weights: &Matrix,
    (x, cols): (&[R], usize),
    finish: impl Fn(usize, usize, &mut [R]),
) {
    let inner = weights.cols();
    let rows = weights.flat().chunks_exact(inner);
    for (i, (out, weights)) in out.chunks_exact_mut(cols).zip(rows).enumerate() {
        for (k, out) in out.iter_mut().enumerate() {
            let mut sum = R::splat(0.0);
            for (weight, x) in weights.iter().zip(x.chunks_exact(cols)) {
                sum += x[k] * *weight;
            }
            *out = sum;
            finish(i, k, std::slice::from_mut(out));
        }
    }
}

#[inline(always)]
fn combine_alone<R: Real>(
    out: &mut [R],
    weights: &Matrix,
    (x, cols): (&[R], usize),
    finish: impl Fn(usize, usize, &mut [R]) + Copy,
) {
    short!(
        cols,
        N => combine_short::<R, N>(out, weights, x, finish),
        combine_long(out, weights, (x, cols), finish)
    );
}

/// Not inlined in each instruction set: a copy for each length would take the compiler a minute.
#[inline]
fn combine_short<R: Real, const N: usize>(
    out: &mut [R],
    weights: &Matrix,
    x: &[R],
    finish: impl Fn(usize, usize, &mut [R]) + Copy,
) {
    let rows = weights.flat().chunks_exact(weights.cols());
    for ((i, out), weights) in out.chunks_exact_mut(N).enumerate().zip(rows) {
        combine_blocks::<R, N>((i, 0), out, weights, (x, N), finish);
    }
}

#[inline(always)]
fn combine_long<R: Real>(
    out: &mut [R],
    weights: &Matrix,
    (x, cols): (&[R], usize),
    finish: impl Fn(usize, usize, &mut [R]) + Copy,
) {
    let rows = weights.flat().chunks_exact(weights.cols());
    for ((i, out), weights) in out.chunks_exact_mut(cols).enumerate().zip(rows) {
        let first = combine_blocks::<R, BLOCK>((i, 0), out, weights, (x, cols), finish);
        let first = combine_blocks::<R, 4>((i, first), out, weights, (x, cols), finish);
        combine_blocks::<R, 1>((i, first), out, weights, (x, cols), finish);
    }
}

/// Combines all blocks of columns from this one on; returns the first column that is left.
#[inline(always)]
fn combine_blocks<R: Real, const SIZE: usize>(
    (i, mut first): (usize, usize),
    out: &mut [R],
    weights: &[f64],
    (x, cols): (&[R], usize),
    finish: impl Fn(usize, usize, &mut [R]),
) -> usize {
    for out in out[first..].as_chunks_mut::<SIZE>().0 {
        let mut sum = [R::splat(0.0); SIZE];
        for (j, weight) in weights.iter().enumerate() {
            if let Some(x) = x[j * cols + first..].first_chunk::<SIZE>() {
                for k in 0..SIZE {
                    sum[k] += x[k] * *weight;
                }
            }
        }
        finish(i, first, &mut sum);
        *out = sum;
        first += SIZE;
    }
    first
}

/// `out = x`
///
/// # Panics
/// When the sizes differ.
#[inline(always)]
pub fn copy<T: Copy>(out: &mut [T], x: &[T]) {
    assert_eq!(out.len(), x.len(), "sizes of a copy");
    if size_of::<T>() > size_of::<f64>() {
        for (out, x) in out.iter_mut().zip(x) {
            *out = *x;
        }
    } else {
        copy_alone(out, x);
    }
}

#[inline]
fn copy_alone<T: Copy>(out: &mut [T], x: &[T]) {
    short!(
        x.len(),
        N => if let (Some(out), Some(x)) = (out.first_chunk_mut::<N>(), x.first_chunk::<N>()) { *out = *x; },
        out.copy_from_slice(x)
    );
}

/// `out = factor * x`
#[inline(always)]
pub fn copy_scaled<R: Real + Mul<F, Output = R>, F: Copy>(out: &mut [R], factor: F, x: &[R]) {
    for (out, x) in out.iter_mut().zip(x) {
        *out = *x * factor;
    }
}

/// `x_i *= factors_i`
#[inline(always)]
pub fn scale_each<R: Real>(x: &mut [R], factors: &[R]) {
    for (x, factor) in x.iter_mut().zip(factors) {
        *x *= *factor;
    }
}

/// The largest difference of two vectors, in a unit, and where it is; the first NaN is larger than any.
pub fn furthest(a: &[f64], b: &[f64], unit: f64) -> (f64, usize) {
    let mut furthest = (0.0, 0);
    for (k, (a, b)) in a.iter().zip(b).enumerate() {
        let apart = (a - b).abs();
        if apart.is_nan() {
            return (apart, k);
        }
        if apart > furthest.0 {
            furthest = (apart, k);
        }
    }
    let (apart, k) = furthest;
    (if apart == 0.0 { 0.0 } else { apart / unit }, k)
}

/// Largest magnitude; NaN counts as infinite.
#[inline(always)]
pub fn max_norm<R: Real>(x: &[R]) -> R {
    if let Some(x) = R::alone(x) {
        return R::splat(largest(x));
    }
    let mut largest = R::splat(0.0);
    for x in x {
        // magnitudes are ordered as their bits are, NaN last
        largest = largest.zip(
            *x,
            #[inline(always)]
            |a, b| f64::from_bits(a.to_bits().max(b.to_bits() & !SIGN)),
        );
    }
    largest.map(
        #[inline(always)]
        |x| if x.is_nan() { f64::INFINITY } else { x },
    )
}

const SIGN: u64 = 1 << 63;

#[inline(always)]
fn largest(x: &[f64]) -> f64 {
    // these compare side by side
    let (chunks, rest) = x.as_chunks::<4>();
    let mut largest = [0_u64; 4];
    for chunk in chunks {
        for (largest, x) in largest.iter_mut().zip(chunk) {
            *largest = (*largest).max(x.to_bits() & !SIGN);
        }
    }
    let rest = rest.iter().map(|x| x.to_bits() & !SIGN);
    let largest = f64::from_bits(largest.into_iter().chain(rest).fold(0, u64::max));
    if largest.is_nan() {
        f64::INFINITY
    } else {
        largest
    }
}

/// Whether all values are finite.
#[inline(always)]
pub fn all_finite<R: Real>(x: &[R]) -> bool {
    // without a way out, so that several are looked at in one instruction
    let mut all = true;
    for x in x {
        all &= x.all(f64::is_finite);
    }
    all
}

/// The sums of [`combine`] as they are.
#[inline(always)]
pub fn as_is<R>(_: usize, _: usize, _: &mut [R]) {}

/// `Σ x_i y_i`, over as many as both have.
#[inline(always)]
pub fn dot<R: Real>(x: &[R], y: &[R]) -> R {
    // as the standard library sums, from −0
    let mut sum = R::splat(-0.0);
    for (x, y) in x.iter().zip(y) {
        sum += *x * *y;
    }
    sum
}

/// `sum += x`; the rounding errors are added to `lost` (Knuth's two-sum).
#[inline(always)]
pub fn add_compensated<R: Real>(sum: &mut [R], lost: &mut [R], x: &[R]) {
    for ((sum, lost), x) in sum.iter_mut().zip(lost).zip(x) {
        let total = *sum + *x;
        let part = total - *sum;
        *lost += (*sum - (total - part)) + (*x - part);
        *sum = total;
    }
}

/// `sum = high + low`; `low` becomes the rounding error (Knuth's two-sum).
#[inline(always)]
pub fn sum_compensated<R: Real>(high: &[R], low: &mut [R], sum: &mut [R]) {
    for ((high, low), sum) in high.iter().zip(low).zip(sum) {
        *sum = *high + *low;
        let part = *sum - *high;
        *low = (*high - (*sum - part)) + (*low - part);
    }
}
