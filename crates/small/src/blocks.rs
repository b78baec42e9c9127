//! A matrix of blocks between points, factored without pivots: a column of a block stands in registers as its points do.
#![allow(clippy::inline_always)] // other functions are compiled without the caller's instruction set

use super::layout::{Layout, POINTS};
use liouville_base::real::Scalar;

/// The columns of a block; those it has not are zero.
pub(super) type Columns<L> = [<L as Layout>::Points; POINTS];

/// The blocks, row by row: K, then its factors L below the diagonal, U above it, and the inverses on it.
#[derive(Clone, Debug)]
pub(super) struct BlockLu<L: Layout> {
    blocks: Vec<Columns<L>>,
    /// How many rows and columns the blocks of a row and column have.
    sizes: Vec<usize>,
    /// How many pivots of the factors are negative.
    pub(super) negative: L,
}

impl<L: Layout> BlockLu<L> {
    pub(super) fn new(sizes: Vec<usize>) -> Self {
        Self {
            blocks: vec![[L::zeros(); POINTS]; sizes.len() * sizes.len()],
            sizes,
            negative: L::splat(0.0),
        }
    }

    /// Clears the rows and columns of blocks from this one on.
    #[inline(always)]
    pub(super) fn clear_from(&mut self, first: usize) {
        let count = self.sizes.len();
        for (row, blocks) in self.blocks.chunks_exact_mut(count).enumerate() {
            let start = if row < first { first } else { 0 };
            blocks[start..].fill([L::zeros(); POINTS]);
        }
    }

    #[inline(always)]
    pub(super) fn block(&mut self, row: usize, col: usize) -> &mut Columns<L> {
        &mut self.blocks[row * self.sizes.len() + col]
    }

    /// Factors the blocks that have been written.
    #[inline(always)]
    pub(super) fn factor(&mut self) {
        let count = self.sizes.len();
        self.negative = L::splat(0.0);
        for (p, &size) in self.sizes.iter().enumerate() {
            let (above, below) = self.blocks.split_at_mut((p + 1) * count);
            let above = &mut above[p * count..];
            self.negative += invert::<L>(&mut above[p], size);
            for (row, of) in below.chunks_exact_mut(count).zip(&self.sizes[p + 1..]) {
                let given = std::mem::replace(&mut row[p], [L::zeros(); POINTS]);
                for (out, x) in row[p].iter_mut().zip(&above[p]).take(size) {
                    add_product::<L>(out, &given, x, (*of, size), 1.0);
                }
                let (factor, rest) = row.split_at_mut(p + 1);
                let columns = rest.iter_mut().zip(&above[p + 1..]);
                for ((out, x), cols) in columns.zip(&self.sizes[p + 1..]) {
                    for (out, x) in out.iter_mut().zip(x).take(*cols) {
                        add_product::<L>(out, &factor[p], x, (*of, size), -1.0);
                    }
                }
            }
        }
    }

    /// Solves in place.
    #[inline(always)]
    pub(super) fn solve(&self, x: &mut [L::Points]) {
        let count = self.sizes.len();
        for (p, row) in self.blocks.chunks_exact(count).enumerate() {
            let (before, rest) = x.split_at_mut(p);
            for (a, (x, size)) in row.iter().zip(before.iter().zip(&self.sizes)) {
                add_product::<L>(&mut rest[0], a, x, (self.sizes[p], *size), -1.0);
            }
        }
        for (p, row) in self.blocks.chunks_exact(count).enumerate().rev() {
            let (before, after) = x.split_at_mut(p + 1);
            let size = self.sizes[p];
            let given = after.iter().zip(&self.sizes[p + 1..]);
            for (a, (x, cols)) in row[p + 1..].iter().zip(given) {
                add_product::<L>(&mut before[p], a, x, (size, *cols), -1.0);
            }
            let given = std::mem::replace(&mut before[p], L::zeros());
            add_product::<L>(&mut before[p], &row[p], &given, (size, size), 1.0);
        }
    }
}

/// `out += sign A x`, of a block A with so many rows and columns; even and odd columns apart.
#[inline(always)]
fn add_product<L: Layout>(
    out: &mut L::Points,
    a: &Columns<L>,
    x: &L::Points,
    (rows, cols): (usize, usize),
    sign: f64,
) {
    let pairs = &a.as_chunks::<2>().0[..cols.div_ceil(2)];
    for row in 0..L::rows(rows) {
        let mut sums = [L::Row::splat(0.0); 2];
        for (l, [even, odd]) in pairs.iter().enumerate() {
            sums[0] += even.as_ref()[row] * L::at(x, 2 * l).every();
            sums[1] += odd.as_ref()[row] * L::at(x, 2 * l + 1).every();
        }
        let out = &mut out.as_mut()[row];
        if sign > 0.0 {
            *out += sums[0] + sums[1];
        } else {
            *out -= sums[0] + sums[1];
        }
    }
}

/// The inverse of a block in its place, by Gauss and Jordan; returns how many pivots are negative.
#[inline(always)]
fn invert<L: Layout>(columns: &mut Columns<L>, size: usize) -> L {
    let (rows, mut negative) = (L::rows(size), L::splat(0.0));
    for l in 0..size {
        let pivot = columns[l];
        let inverse = L::splat(1.0) / L::at(&pivot, l);
        negative += one_if_negative(inverse);
        for (j, column) in columns.iter_mut().enumerate().take(size) {
            if j == l {
                continue;
            }
            let factor = L::at(column, l) * inverse;
            let every = factor.every();
            L::replace(
                column,
                rows,
                (l, factor),
                #[inline(always)]
                |row, x| x - every * pivot.as_ref()[row],
            );
        }
        let every = (-inverse).every();
        L::replace(
            &mut columns[l],
            rows,
            (l, inverse),
            #[inline(always)]
            |_, x| x * every,
        );
    }
    negative
}

#[inline(always)]
pub(super) fn one_if_negative<L: Layout>(x: L) -> L {
    x.map(
        #[inline(always)]
        |x| f64::from(u8::from(x < 0.0)),
    )
}
