//! Rows of a product with a sparse matrix.
#![allow(clippy::inline_always)] // all of a kernel is compiled for one instruction set

use super::update::update;
use super::{Block, Update};
use liouville_base::linalg::Rows;
use liouville_base::simd::{ForEach, InstructionSet, Kernel, Number, SimdView, SimdViews, Stored};
use std::ops::Range;

/// Updates a block of rows.
pub(super) fn act<S: Stored>(
    rows: &Rows,
    machine: InstructionSet,
    update: Update,
    block: Block<'_, S>,
) {
    let act = Act {
        rows,
        update,
        block,
    };
    S::run(machine, act);
}

struct Act<'a, S> {
    rows: &'a Rows,
    update: Update,
    block: Block<'a, S>,
}

impl<S> Kernel<S> for Act<'_, S> {
    type Output = ();

    #[inline(always)]
    fn run<W: SimdViews<Stored = S>>(self, windows: W) {
        let Block { row, out, place, x } = self.block;
        for (k, out) in out.iter_mut().enumerate() {
            let (cols, values) = self.rows.row(row + k);
            let mut one = Row {
                cols,
                values,
                update: self.update,
                at: row + k - place,
                place,
                x,
                out: std::slice::from_mut(out),
            };
            windows.each(1, &mut one);
        }
    }
}

/// Adds the products of some listed rows.
pub(super) fn add_listed<S: Stored>(
    listed: (&Rows, &[usize], Range<usize>),
    machine: InstructionSet,
    factor: f64,
    block: Block<'_, S>,
) {
    let update = Update::added(factor);
    let act = Listed {
        which: listed,
        update,
        block,
    };
    S::run(machine, act);
}

struct Listed<'a, S> {
    /// Rows, their numbers, and which of them.
    which: (&'a Rows, &'a [usize], Range<usize>),
    update: Update,
    block: Block<'a, S>,
}

impl<S> Kernel<S> for Listed<'_, S> {
    type Output = ();

    #[inline(always)]
    fn run<W: SimdViews<Stored = S>>(self, windows: W) {
        let Block { row, out, place, x } = self.block;
        let (rows, numbers, which) = self.which;
        for k in which {
            let (i, (cols, values)) = (numbers[k], rows.row(k));
            let mut one = Row {
                cols,
                values,
                update: self.update,
                at: i - place,
                place,
                x,
                out: &mut out[i - row..],
            };
            windows.each(1, &mut one);
        }
    }
}

/// One row.
struct Row<'a, S> {
    cols: &'a [u32],
    values: &'a [f64],
    update: Update,
    /// Where x_i is.
    at: usize,
    place: usize,
    x: &'a [S],
    out: &'a mut [S],
}

impl<S> ForEach<S> for Row<'_, S> {
    #[inline(always)]
    fn visit<W: SimdView<Stored = S>>(&mut self, window: W) -> bool {
        let mut sum = window.constant(0.0);
        for (col, value) in self.cols.iter().zip(self.values) {
            let x = window.load(self.x, *col as usize - self.place);
            sum = sum + x.scaled(*value);
        }
        update(window, self.update, (self.x, self.at), (self.out, 0), sum);
        true
    }
}
