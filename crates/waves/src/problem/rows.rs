//! Rows of a product with a sparse matrix: all of them, or some that are listed.
#![allow(clippy::inline_always)] // all of a kernel is compiled for one instruction set

use super::row_product::{Input, MatrixRows};
use liouville_base::linalg::Rows;
use liouville_base::simd::{Number, SimdView};
use std::ops::Range;

/// Columns and values of a row.
type SparseRow<'a> = (&'a [u32], &'a [f64]);

/// Σ_j H_ij x_j
#[inline(always)]
fn dot<V: SimdView>((cols, values): SparseRow<'_>, view: V, x: Input<'_, V::Stored>) -> V::Number {
    let mut sum = view.constant(0.0);
    for (col, value) in cols.iter().zip(values) {
        sum = sum + x.load(view, *col as usize).scaled(*value);
    }
    sum
}

impl MatrixRows for Rows {
    type Stretch<'a> = SparseRow<'a>;
    const IS_SINGLE: bool = true;

    #[inline(always)]
    fn stretches<'a>(
        &'a self,
        rows: Range<usize>,
        mut visit: impl FnMut(Range<usize>, SparseRow<'a>),
    ) {
        for i in rows {
            visit(i..i + 1, self.row(i));
        }
    }

    #[inline(always)]
    fn product<V: SimdView>(
        &self,
        row: SparseRow<'_>,
        view: V,
        _: usize,
        x: Input<'_, V::Stored>,
    ) -> V::Number {
        dot(row, view, x)
    }
}

/// Some rows of a sparse matrix; all others are empty.
#[derive(Clone, Debug)]
pub(super) struct ListedRows {
    /// Which rows, ascending.
    pub(super) numbers: Vec<usize>,
    pub(super) rows: Rows,
}

impl MatrixRows for ListedRows {
    type Stretch<'a> = SparseRow<'a>;
    const IS_SINGLE: bool = true;

    #[inline(always)]
    fn stretches<'a>(
        &'a self,
        rows: Range<usize>,
        mut visit: impl FnMut(Range<usize>, SparseRow<'a>),
    ) {
        let first = self.numbers.partition_point(|i| *i < rows.start);
        for (k, &i) in self.numbers.iter().enumerate().skip(first) {
            if i >= rows.end {
                break;
            }
            visit(i..i + 1, self.rows.row(k));
        }
    }

    #[inline(always)]
    fn product<V: SimdView>(
        &self,
        row: SparseRow<'_>,
        view: V,
        _: usize,
        x: Input<'_, V::Stored>,
    ) -> V::Number {
        dot(row, view, x)
    }
}
