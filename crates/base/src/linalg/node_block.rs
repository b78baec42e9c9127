//! Blocks of k by k numbers, column by column, in memory for K by K; those of several members number by number.
#![allow(clippy::inline_always)] // other functions are compiled without the caller's instruction set

use crate::real::{Real, Scalar};

/// Pivots below this fraction of the original diagonal element are roundoff.
const TINY: f64 = 1e3 * f64::EPSILON;

/// The columns of a block, of which the first k numbers of the first k are used.
pub(super) type Block<R, const K: usize> = [[R; K]; K];

#[inline(always)]
pub(super) fn zero<R: Real, const K: usize>() -> Block<R, K> {
    [[R::splat(0.0); K]; K]
}

#[inline(always)]
pub(super) fn clear<R: Real, const K: usize>(k: usize, block: &mut Block<R, K>) {
    for column in block.iter_mut().take(k) {
        column[..k].fill(R::splat(0.0));
    }
}

/// The k numbers in this place.
#[inline(always)]
pub(super) fn at<R: Scalar, const K: usize>(k: usize, values: &[R], place: usize) -> &[R] {
    if R::IS_SINGLE {
        &values.as_chunks::<K>().0[place] // a length known to the compiler
    } else {
        &values[place * k..(place + 1) * k]
    }
}

#[inline(always)]
pub(super) fn at_mut<R: Scalar, const K: usize>(
    k: usize,
    values: &mut [R],
    place: usize,
) -> &mut [R] {
    if R::IS_SINGLE {
        &mut values.as_chunks_mut::<K>().0[place]
    } else {
        &mut values[place * k..(place + 1) * k]
    }
}

/// The k by k numbers in this place, column by column.
#[inline(always)]
pub(super) fn block_at<R: Scalar, const K: usize>(k: usize, values: &[R], place: usize) -> &[R] {
    if R::IS_SINGLE {
        values.as_chunks::<K>().0[place * K..(place + 1) * K].as_flattened()
    } else {
        &values[place * k * k..(place + 1) * k * k]
    }
}

#[inline(always)]
pub(super) fn block_at_mut<R: Scalar, const K: usize>(
    k: usize,
    values: &mut [R],
    place: usize,
) -> &mut [R] {
    if R::IS_SINGLE {
        values.as_chunks_mut::<K>().0[place * K..(place + 1) * K].as_flattened_mut()
    } else {
        &mut values[place * k * k..(place + 1) * k * k]
    }
}

#[inline(always)]
pub(super) fn read<R: Real, const K: usize>(
    k: usize,
    values: &[R],
    place: usize,
    block: &mut Block<R, K>,
) {
    let columns = block_at::<R, K>(k, values, place).chunks_exact(k);
    for (out, column) in block.iter_mut().zip(columns) {
        out[..k].copy_from_slice(column);
    }
}

#[inline(always)]
pub(super) fn write<R: Real, const K: usize>(
    k: usize,
    values: &mut [R],
    place: usize,
    block: &Block<R, K>,
) {
    let columns = block_at_mut::<R, K>(k, values, place).chunks_exact_mut(k);
    for (out, column) in columns.zip(block) {
        out.copy_from_slice(&column[..k]);
    }
}

#[inline(always)]
pub(super) fn add_outer<R: Real, const K: usize>(
    k: usize,
    sum: &mut Block<R, K>,
    a: &[R],
    b: &[R],
) {
    for l in 0..k {
        for i in 0..k {
            sum[l][i] += a[i] * b[l];
        }
    }
}

/// `out = A y`, with the columns of A one after another.
#[inline(always)]
pub(super) fn apply<R: Real, const K: usize>(k: usize, columns: &[R], y: &[R], out: &mut [R; K]) {
    for i in 0..k {
        out[i] = columns[i] * y[0];
    }
    for l in 1..k {
        for i in 0..k {
            out[i] += columns[l * k + i] * y[l];
        }
    }
}

/// `out = Aᵀ y`, with the columns of A one after another.
#[inline(always)]
pub(super) fn apply_transposed<R: Real, const K: usize>(
    k: usize,
    columns: &[R],
    y: &[R],
    out: &mut [R; K],
) {
    for l in 0..k {
        out[l] = columns[l * k] * y[0];
        for i in 1..k {
            out[l] += columns[l * k + i] * y[i];
        }
    }
}

/// `out = A y`, A being a block.
#[inline(always)]
pub(super) fn apply_block<R: Real, const K: usize>(
    k: usize,
    a: &Block<R, K>,
    y: &[R; K],
    out: &mut [R; K],
) {
    for i in 0..k {
        out[i] = a[0][i] * y[0];
    }
    for l in 1..k {
        for i in 0..k {
            out[i] += a[l][i] * y[l];
        }
    }
}

/// `x -= y`
#[inline(always)]
pub(super) fn subtract<R: Real, const K: usize>(k: usize, x: &mut [R], y: &[R; K]) {
    for i in 0..k {
        x[i] -= y[i];
    }
}

/// `out = A B`
#[inline(always)]
pub(super) fn times<R: Real, const K: usize>(
    k: usize,
    a: &Block<R, K>,
    b: &Block<R, K>,
    out: &mut Block<R, K>,
) {
    for l in 0..k {
        apply_block(k, a, &b[l], &mut out[l]);
    }
}

/// Subtracts `A B` from the block in this place.
#[inline(always)]
pub(super) fn subtract_product<R: Real, const K: usize>(
    k: usize,
    values: &mut [R],
    place: usize,
    a: &Block<R, K>,
    b: &Block<R, K>,
) {
    let mut product = [R::splat(0.0); K];
    let columns = block_at_mut::<R, K>(k, values, place).chunks_exact_mut(k);
    for (column, b) in columns.zip(b) {
        apply_block(k, a, b, &mut product);
        subtract(k, column, &product);
    }
}

/// Inverts a block whose diagonal dominates; false where a pivot is roundoff of `scale`.
#[inline(always)]
pub(super) fn invert<R: Real, const K: usize>(k: usize, a: &mut Block<R, K>, scale: R) -> bool {
    for p in 0..k {
        let pivot = a[p][p];
        let is_fine = |member| {
            let (pivot, scale): (f64, f64) = (pivot.member(member), scale.member(member));
            pivot.abs() > TINY * scale && pivot.is_finite()
        };
        if !(0..R::MEMBERS).all(is_fine) {
            return false;
        }
        let inverse = R::splat(1.0) / pivot;
        a[p][p] = R::splat(1.0);
        for i in 0..k {
            a[p][i] *= inverse;
        }
        let pivot_column = a[p];
        for l in 0..k {
            if l != p {
                let factor = a[l][p];
                a[l][p] = R::splat(0.0);
                for i in 0..k {
                    a[l][i] -= factor * pivot_column[i];
                }
            }
        }
    }
    true
}
