//! Loops over short vectors.

use super::Matrix;

/// `out += factor * x`
#[inline]
pub fn add_scaled(out: &mut [f64], factor: f64, x: &[f64]) {
    for (out, x) in out.iter_mut().zip(x) {
        *out += factor * x;
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

/// `out_ik = finish(i, k, Σ_j weights_ij x_jk)`, for as many rows as both `out` and `weights` have.
#[inline]
pub fn combine(
    out: &mut [f64],
    weights: &Matrix,
    x: &Matrix,
    finish: impl Fn(usize, usize, f64) -> f64,
) {
    short!(x.cols(), N => combine_short::<N>(out, weights, x, finish), combine_long(out, weights, x, finish));
}

#[inline]
fn combine_short<const N: usize>(
    out: &mut [f64],
    weights: &Matrix,
    x: &Matrix,
    finish: impl Fn(usize, usize, f64) -> f64,
) {
    let (out, x) = (out.as_chunks_mut::<N>().0, x.flat().as_chunks::<N>().0);
    let rows = weights.flat().chunks_exact(weights.cols());
    for (i, (out, weights)) in out.iter_mut().zip(rows).enumerate() {
        let mut sum = [0.0; N];
        for (weight, x) in weights.iter().zip(x) {
            for k in 0..N {
                sum[k] += weight * x[k];
            }
        }
        for k in 0..N {
            out[k] = finish(i, k, sum[k]);
        }
    }
}

fn combine_long(
    out: &mut [f64],
    weights: &Matrix,
    x: &Matrix,
    finish: impl Fn(usize, usize, f64) -> f64,
) {
    let rows = weights.flat().chunks_exact(weights.cols());
    for (i, (out, weights)) in out.chunks_exact_mut(x.cols()).zip(rows).enumerate() {
        out.fill(0.0);
        for (weight, x) in weights.iter().zip(x.flat().chunks_exact(x.cols())) {
            add_scaled(out, *weight, x);
        }
        for (k, out) in out.iter_mut().enumerate() {
            *out = finish(i, k, *out);
        }
    }
}

/// `out = x`
///
/// # Panics
/// When the sizes differ.
#[inline]
pub fn copy<T: Copy>(out: &mut [T], x: &[T]) {
    assert_eq!(out.len(), x.len(), "sizes of a copy");
    short!(
        x.len(),
        N => if let (Some(out), Some(x)) = (out.first_chunk_mut::<N>(), x.first_chunk::<N>()) { *out = *x; },
        out.copy_from_slice(x)
    );
}

/// `out = factor * x`
#[inline]
pub fn copy_scaled(out: &mut [f64], factor: f64, x: &[f64]) {
    for (out, x) in out.iter_mut().zip(x) {
        *out = factor * x;
    }
}

/// Largest magnitude; NaN counts as infinite.
#[inline]
pub fn max_norm(x: &[f64]) -> f64 {
    const SIGN: u64 = 1 << 63;
    // magnitudes are ordered as their bits are, NaN last, and these compare side by side
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

/// `Σ x_i y_i`, over as many as both have.
#[inline]
pub fn dot(x: &[f64], y: &[f64]) -> f64 {
    x.iter().zip(y).map(|(x, y)| x * y).sum()
}

/// `sum += x`, and what the additions lose is added to `lost` (Knuth's two-sum).
pub fn gather(sum: &mut [f64], lost: &mut [f64], x: &[f64]) {
    for ((sum, lost), x) in sum.iter_mut().zip(lost).zip(x) {
        let total = *sum + x;
        let part = total - *sum;
        *lost += (*sum - (total - part)) + (x - part);
        *sum = total;
    }
}

/// `sum = high + low`, and `low` becomes what the addition lost (Knuth's two-sum).
pub fn carry(high: &[f64], low: &mut [f64], sum: &mut [f64]) {
    for ((high, low), sum) in high.iter().zip(low).zip(sum) {
        *sum = high + *low;
        let part = *sum - high;
        *low = (high - (*sum - part)) + (*low - part);
    }
}
