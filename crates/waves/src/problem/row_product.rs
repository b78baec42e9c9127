//! Products by rows: one driver for all matrix forms.
//!
//! A form cuts rows into stretches that are computed alike and gives (H x)_i in a stretch; the driver runs over them in
//! the registers of the machine and updates `out`.
#![allow(clippy::inline_always)] // all of a kernel is compiled for one instruction set

use liouville_base::simd::{ForEach, InstructionSet, Kernel, Number, SimdView, SimdViews, Stored};
use std::ops::Range;

/// The use of a product: out ← keep·out + factor·H x + diagonal·x.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Update {
    /// The factor of `out`.
    pub keep: f64,
    /// The factor of the product.
    pub factor: f64,
    /// The factor of x itself.
    pub diagonal: f64,
}

impl Update {
    /// A product added to `out`.
    pub fn added(factor: f64) -> Self {
        Self {
            keep: 1.0,
            factor,
            diagonal: 0.0,
        }
    }
}

/// Some rows of a product, and their neighbourhood in x.
#[derive(Debug)]
pub struct RowBlock<'a, S> {
    /// The row of `out[0]`.
    pub row: usize,
    /// The rows to be updated.
    pub out: &'a mut [S],
    /// The place of `x[0]` in all of x.
    pub place: usize,
    /// The rows, and at least [`super::Operator::reach`] places more on both sides, as far as there are any.
    pub x: &'a [S],
}

/// A matrix form that computes rows of a product.
pub(super) trait MatrixRows {
    /// Data shared by rows that are computed alike.
    type Stretch<'a>: Copy
    where
        Self: 'a;

    /// Whether a stretch is one row, so that no code is made for several rows in one register.
    const IS_SINGLE: bool = false;

    /// Calls `visit` for the stretches of these rows, first to last.
    fn stretches<'a>(
        &'a self,
        rows: Range<usize>,
        visit: impl FnMut(Range<usize>, Self::Stretch<'a>),
    );

    /// (H x)_i for i = `row`, or for as many rows from there on as the view has.
    fn product<V: SimdView>(
        &self,
        stretch: Self::Stretch<'_>,
        view: V,
        row: usize,
        x: Input<'_, V::Stored>,
    ) -> V::Number;

    /// Adds `factor` times those products of a stretch that only some rows have.
    #[inline(always)]
    fn add_scattered<W: SimdViews>(
        &self,
        _stretch: Self::Stretch<'_>,
        _views: W,
        _factor: f64,
        _row: usize,
        _x: Input<'_, W::Stored>,
        _out: &mut [W::Stored],
    ) {
    }
}

/// The part of x that a block of rows reads.
#[derive(Debug)]
pub(super) struct Input<'a, S> {
    /// The row of `x[0]`.
    pub(super) place: usize,
    pub(super) x: &'a [S],
}

impl<S> Clone for Input<'_, S> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<S> Copy for Input<'_, S> {}

impl<S> Input<'_, S> {
    /// Reads x_i for i = `row`, or for the rows from there on.
    #[inline(always)]
    pub(super) fn load<V: SimdView<Stored = S>>(self, view: V, row: usize) -> V::Number {
        view.load(self.x, row - self.place)
    }

    /// Reads x_i for i = `row`, the same for all rows of the view.
    #[inline(always)]
    pub(super) fn every<V: SimdView<Stored = S>>(self, view: V, row: usize) -> V::Number {
        view.every(self.x, row - self.place)
    }
}

/// Updates a block of rows by the product with a matrix.
pub(super) fn update_rows<M: MatrixRows, S: Stored>(
    matrix: &M,
    machine: InstructionSet,
    update: Update,
    block: RowBlock<'_, S>,
) {
    let product = RowProduct {
        matrix,
        update,
        block,
    };
    S::run(machine, product);
}

struct RowProduct<'a, M, S> {
    matrix: &'a M,
    update: Update,
    block: RowBlock<'a, S>,
}

impl<M: MatrixRows, S> Kernel<S> for RowProduct<'_, M, S> {
    type Output = ();

    #[inline(always)]
    fn run<W: SimdViews<Stored = S>>(self, views: W) {
        let RowBlock { row, out, place, x } = self.block;
        let (matrix, update, x) = (self.matrix, self.update, Input { place, x });
        matrix.stretches(
            row..row + out.len(),
            #[inline(always)]
            |rows, stretch| {
                let count = if M::IS_SINGLE { 1 } else { rows.len() };
                let out = &mut out[rows.start - row..][..count];
                let row = rows.start;
                let mut update_stretch = UpdateStretch {
                    matrix,
                    stretch,
                    update,
                    row,
                    x,
                    out,
                };
                views.each(count, &mut update_stretch);
                matrix.add_scattered(stretch, views, update.factor, row, x, out);
            },
        );
    }
}

/// out ← keep·out + factor·H x + diagonal·x in a stretch.
struct UpdateStretch<'a, 'b, M: MatrixRows + 'a, S> {
    matrix: &'a M,
    stretch: M::Stretch<'a>,
    update: Update,
    row: usize,
    x: Input<'b, S>,
    out: &'b mut [S],
}

impl<M: MatrixRows, S> ForEach<S> for UpdateStretch<'_, '_, M, S> {
    #[inline(always)]
    fn visit<V: SimdView<Stored = S>>(&mut self, view: V) -> bool {
        let (row, x, by) = (self.row, self.x, self.update);
        let product = self.matrix.product(self.stretch, view, row, x);
        let mut change = product.scaled(by.factor);
        if by.diagonal != 0.0 {
            change = change + x.load(view, row).scaled(by.diagonal);
        }
        if by.keep != 0.0 {
            change = view.load(self.out, 0).scaled(by.keep) + change;
        }
        view.store(self.out, 0, change);
        true
    }
}
