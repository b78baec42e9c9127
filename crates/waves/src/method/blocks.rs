//! Sums of vectors and inner products by blocks of rows, which stay in the nearest cache while all vectors are added to them.
//!
//! Sums of inner products are taken side by side in the same way on all machines, so that they have the same bits.
#![allow(clippy::inline_always)] // a block is compiled for one instruction set as a whole

use liouville_base::simd::dispatch_simd_long;
use std::ops::Range;

/// Rows of a block.
const ROWS: usize = 512;

/// Sums of an inner product that are taken side by side.
const SUMS: usize = 8;

/// Vectors that are added to a block at once.
const AT_ONCE: usize = 4;

/// A vector times a number.
pub(super) type Scaled<'a> = (f64, &'a [f64]);

/// Calls `work`, which must be inlined, for all blocks of so many rows.
#[inline(always)]
pub(super) fn by_blocks(rows: usize, mut work: impl FnMut(Range<usize>)) {
    dispatch_simd_long::<f64, _>(
        rows,
        #[inline(always)]
        || {
            for start in (0..rows).step_by(ROWS) {
                work(start..rows.min(start + ROWS));
            }
        },
    );
}

/// `out ← keep·out`; nothing of `out` is used where `keep` is zero.
pub(super) fn keep_times(out: &mut [f64], keep: f64) {
    if keep == 0.0 {
        return out.fill(0.0);
    }
    for out in out {
        *out *= keep;
    }
}

/// `out ← out + Σ a x`
pub(super) fn combine(out: &mut [f64], vectors: &[Scaled<'_>]) {
    by_blocks(
        out.len(),
        #[inline(always)]
        |rows| add_all(&mut out[rows.clone()], vectors, rows),
    );
}

/// Adds i times a vector times a number: real parts, then imaginary parts.
pub(super) fn add_i(factor: f64, x: &[f64], out: &mut [f64]) {
    let half = x.len() / 2;
    let (q, p) = out.split_at_mut(half);
    by_blocks(
        half,
        #[inline(always)]
        |rows| {
            add(&mut q[rows.clone()], -factor, &x[half..][rows.clone()]);
            add(&mut p[rows.clone()], factor, &x[rows]);
        },
    );
}

/// Adds rows of all vectors to a block.
#[inline(always)]
pub(super) fn add_all(out: &mut [f64], vectors: &[Scaled<'_>], rows: Range<usize>) {
    let several = vectors.chunks_exact(AT_ONCE);
    let rest = several.remainder();
    for each in several {
        let [a, b, c, d] = [0, 1, 2, 3].map(|k| &each[k].1[rows.clone()]);
        let factors = [0, 1, 2, 3].map(|k| each[k].0);
        for ((((out, a), b), c), d) in out.iter_mut().zip(a).zip(b).zip(c).zip(d) {
            *out += factors[0] * a + factors[1] * b + (factors[2] * c + factors[3] * d);
        }
    }
    for (factor, x) in rest {
        add(out, *factor, &x[rows.clone()]);
    }
}

/// Adds a vector times a number to a block.
#[inline(always)]
pub(super) fn add(out: &mut [f64], factor: f64, x: &[f64]) {
    for (out, x) in out.iter_mut().zip(x) {
        *out += factor * x;
    }
}

/// `out ← factor·x − out` of a block.
#[inline(always)]
pub(super) fn take_from(out: &mut [f64], factor: f64, x: &[f64]) {
    for (out, x) in out.iter_mut().zip(x) {
        *out = factor * x - *out;
    }
}

/// Adds a product place by place to a block.
#[inline(always)]
pub(super) fn add_products(out: &mut [f64], factor: f64, v: &[f64], x: &[f64]) {
    for ((out, v), x) in out.iter_mut().zip(v).zip(x) {
        *out += factor * v * x;
    }
}

/// Σ x y
pub(super) fn inner(x: &[f64], y: &[f64]) -> f64 {
    let mut sum = 0.0;
    by_blocks(
        x.len(),
        #[inline(always)]
        |rows| sum += inner_of_block(&x[rows.clone()], &y[rows]),
    );
    sum
}

/// Σ x y of a block.
#[inline(always)]
fn inner_of_block(x: &[f64], y: &[f64]) -> f64 {
    let mut sums = [0.0; SUMS];
    let (x, y) = (x.chunks_exact(SUMS), y.chunks_exact(SUMS));
    let rest = x.remainder().iter().zip(y.remainder());
    let rest: f64 = rest.map(|(x, y)| x * y).sum();
    for (x, y) in x.zip(y) {
        for ((sum, x), y) in sums.iter_mut().zip(x).zip(y) {
            *sum += x * y;
        }
    }
    rest + sums.iter().sum::<f64>()
}

/// Adds two vectors to a block, and gives their inner products with another.
#[inline(always)]
pub(super) fn add_and_pair(out: &mut [f64], two: [Scaled<'_>; 2], y: &[f64]) -> [f64; 2] {
    let [(a, u), (b, v)] = two;
    let mut sums = [[0.0; SUMS]; 2];
    let whole = out.len() - out.len() % SUMS;
    let vectors = u.chunks_exact(SUMS).zip(v.chunks_exact(SUMS));
    let outs = out[..whole].chunks_exact_mut(SUMS);
    for ((out, (u, v)), y) in outs.zip(vectors).zip(y.chunks_exact(SUMS)) {
        for i in 0..SUMS {
            out[i] += a * u[i] + b * v[i];
            sums[0][i] += u[i] * y[i];
            sums[1][i] += v[i] * y[i];
        }
    }
    let mut found = sums.map(|sums| sums.iter().sum::<f64>());
    for i in whole..out.len() {
        out[i] += a * u[i] + b * v[i];
        found[0] += u[i] * y[i];
        found[1] += v[i] * y[i];
    }
    found
}

/// Multiplies a vector by e^{i angle}.
pub(super) fn turn(x: &mut [f64], angle: f64) {
    let (sin, cos) = angle.sin_cos();
    let (q, p) = x.split_at_mut(x.len() / 2);
    for (q, p) in q.iter_mut().zip(p) {
        (*q, *p) = (*q * cos - *p * sin, *p * cos + *q * sin);
    }
}
