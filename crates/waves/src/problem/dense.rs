//! Products with a dense symmetric matrix.
//!
//! Rows are computed side by side and columns one after another: H[i, j] and H[i + 1, j] stand beside
//! each other, in panels of so many rows that what is read is read in one stretch.
#![allow(clippy::inline_always)] // all of a kernel is compiled for one instruction set

use super::update::update;
use super::{Block, Update};
use liouville_base::simd::{ForEach, InstructionSet, Kernel, SimdView, SimdViews, Stored};

/// Rows of a panel.
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

    /// How many bytes all rows are.
    pub(super) fn bytes(&self) -> usize {
        size_of_val(&*self.panels)
    }

    /// Updates a block of rows.
    pub(super) fn act<S: Stored>(
        &self,
        machine: InstructionSet,
        update: Update,
        block: Block<'_, S>,
    ) {
        let dense = self;
        let act = Act {
            dense,
            update,
            block,
        };
        S::run(machine, act);
    }
}

struct Act<'a, S> {
    dense: &'a Dense,
    update: Update,
    block: Block<'a, S>,
}

impl<S> Kernel<S> for Act<'_, S> {
    type Output = ();

    #[inline(always)]
    fn run<W: SimdViews<Stored = S>>(self, windows: W) {
        let Block { row, out, place, x } = self.block;
        let (n, end) = (self.dense.n, row + out.len());
        let x = &x[..n];
        let mut start = row;
        while start < end {
            let first = start - start % PANEL;
            let width = PANEL.min(n - first);
            let count = (first + width).min(end) - start;
            let mut rows = Rows {
                panel: &self.dense.panels[first * n..][..width * n],
                width,
                within: start - first,
                update: self.update,
                at: start - place,
                x,
                out: &mut out[start - row..],
            };
            windows.each(count, &mut rows);
            start += count;
        }
    }
}

/// Rows within a panel.
struct Rows<'a, S> {
    panel: &'a [f64],
    width: usize,
    within: usize,
    update: Update,
    /// Where x_i is.
    at: usize,
    x: &'a [S],
    out: &'a mut [S],
}

impl<S> ForEach<S> for Rows<'_, S> {
    #[inline(always)]
    fn visit<W: SimdView<Stored = S>>(&mut self, window: W) -> bool {
        let mut sum = window.constant(0.0);
        for (j, column) in self.panel.chunks_exact(self.width).enumerate() {
            sum = sum + window.shared(column, self.within) * window.every(self.x, j);
        }
        update(window, self.update, (self.x, self.at), (self.out, 0), sum);
        true
    }
}
