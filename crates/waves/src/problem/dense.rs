//! Products with a dense symmetric matrix.
//!
//! Rows are computed side by side and columns one after another: H[i, j] and H[i + 1, j] are neighbours in memory, in
//! panels of so few rows that a panel is read from its first value to its last.
#![allow(clippy::inline_always)] // all of a kernel is compiled for one instruction set

use super::row_product::{Input, MatrixRows};
use liouville_base::simd::SimdView;
use std::ops::Range;

/// Rows in a panel.
const PANEL: usize = 64;

/// A dense symmetric matrix.
#[derive(Clone, Debug)]
pub struct Dense {
    n: usize,
    /// Column by column, panel by panel.
    panels: Vec<f64>,
}

impl Dense {
    /// The matrix of these values, row by row.
    ///
    /// # Panics
    /// When they are not the square of `n`.
    pub fn new(n: usize, values: &[f64]) -> Self {
        assert_eq!(values.len(), n * n, "number of values");
        let mut panels = Vec::with_capacity(n * n);
        for first in (0..n).step_by(PANEL) {
            for j in 0..n {
                let rows = first..(first + PANEL).min(n);
                panels.extend(rows.map(|i| values[i * n + j]));
            }
        }
        Self { n, panels }
    }

    /// Number of rows.
    pub fn size(&self) -> usize {
        self.n
    }

    /// Bytes of all rows.
    pub(super) fn bytes(&self) -> usize {
        size_of_val(&*self.panels)
    }
}

/// Rows of a panel.
#[derive(Clone, Copy)]
pub(super) struct Panel<'a> {
    first: usize,
    width: usize,
    /// Column by column.
    values: &'a [f64],
}

impl MatrixRows for Dense {
    type Stretch<'a> = Panel<'a>;

    #[inline(always)]
    fn stretches<'a>(&'a self, rows: Range<usize>, mut visit: impl FnMut(Range<usize>, Panel<'a>)) {
        let n = self.n;
        let mut start = rows.start;
        while start < rows.end {
            let first = start - start % PANEL;
            let width = PANEL.min(n - first);
            let end = rows.end.min(first + width);
            let values = &self.panels[first * n..][..width * n];
            let panel = Panel {
                first,
                width,
                values,
            };
            visit(start..end, panel);
            start = end;
        }
    }

    #[inline(always)]
    fn product<V: SimdView>(
        &self,
        panel: Panel<'_>,
        view: V,
        row: usize,
        x: Input<'_, V::Stored>,
    ) -> V::Number {
        let mut sum = view.constant(0.0);
        for (j, column) in panel.values.chunks_exact(panel.width).enumerate() {
            sum = sum + view.shared(column, row - panel.first) * x.every(view, j);
        }
        sum
    }
}
