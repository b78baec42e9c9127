//! The use of the vectors that moves make, beside the next move: sums of them, or copies tile by tile.
//!
//! A tile is some rows of several vectors, so that a block of vectors is added to many sums while its rows stay in
//! the nearest cache.
#![allow(clippy::inline_always)] // all of a kernel is compiled for one instruction set

use crate::problem::Update;
use liouville_base::simd::{ForEach, InstructionSet, Kernel, Number, SimdView, SimdViews, Stored};

/// One product: a ← keep·a + factor·H b + diagonal·b, or the same into b from a.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Move {
    /// Whether b is updated, not a.
    pub into_second: bool,
    /// The use of the product.
    pub update: Update,
    /// The factor of the updated vector in its sum, where there are sums.
    pub weight: f64,
    /// Its place among the copies, where there are copies.
    pub copy: usize,
}

impl Move {
    /// A product whose result is of no other use than the next one.
    pub fn new(into_second: bool, update: Update) -> Self {
        Self {
            into_second,
            update,
            weight: 0.0,
            copy: 0,
        }
    }
}

/// Bytes of a vector in a tile.
const TILE: usize = 512;

/// Rows of a tile.
pub(super) const fn tile_rows<S>() -> usize {
    let rows = TILE / size_of::<S>();
    if rows == 0 { 1 } else { rows }
}

/// Numbers in tiles of so many rows and vectors.
pub(super) const fn tiled<S>(rows: usize, vectors: usize) -> usize {
    rows.div_ceil(tile_rows::<S>()) * tile_rows::<S>() * vectors
}

/// The use of the vectors that moves make.
#[derive(Debug)]
pub enum Sink<'a, S> {
    /// None.
    Nothing,
    /// Weighted sums of the values of a and of b.
    Sums(&'a mut [S], &'a mut [S]),
    /// Tiles of copies, so many in each.
    Copies(&'a mut [S], usize),
}

impl<S: Stored> Sink<'_, S> {
    /// The same for a shorter time.
    pub(super) fn reborrow(&mut self) -> Sink<'_, S> {
        match self {
            Self::Nothing => Sink::Nothing,
            Self::Sums(a, b) => Sink::Sums(a, b),
            Self::Copies(tiles, count) => Sink::Copies(tiles, *count),
        }
    }

    /// The part of the first `rows` rows, whole tiles unless they are all, and the rest.
    pub(super) fn split_at(self, rows: usize) -> (Self, Self) {
        match self {
            Self::Nothing => (Self::Nothing, Self::Nothing),
            Self::Sums(a, b) => {
                let (a, rest_a) = a.split_at_mut(rows.min(a.len()));
                let (b, rest_b) = b.split_at_mut(rows.min(b.len()));
                (Self::Sums(a, b), Self::Sums(rest_a, rest_b))
            }
            Self::Copies(tiles, count) => {
                let (tiles, rest) = tiles.split_at_mut(tiled::<S>(rows, count).min(tiles.len()));
                (Self::Copies(tiles, count), Self::Copies(rest, count))
            }
        }
    }

    /// Takes what a move made, from a row of this part on.
    pub(super) fn take(&mut self, machine: InstructionSet, step: &Move, row: usize, made: &[S]) {
        match self {
            Self::Nothing => {}
            Self::Sums(a, b) => {
                let sum = if step.into_second { b } else { a };
                add_scaled(machine, step.weight, made, &mut sum[row..row + made.len()]);
            }
            Self::Copies(tiles, count) => copy(tiles, (*count, step.copy), row, made),
        }
    }
}

/// Copies rows of a vector into its place among `count` in each tile.
pub(super) fn copy<S: Stored>(
    tiles: &mut [S],
    (count, place): (usize, usize),
    row: usize,
    from: &[S],
) {
    let rows = tile_rows::<S>();
    let mut done = 0;
    while done < from.len() {
        let (tile, inside) = ((row + done) / rows, (row + done) % rows);
        let now = (rows - inside).min(from.len() - done);
        let to = (tile * count + place) * rows + inside;
        tiles[to..to + now].copy_from_slice(&from[done..done + now]);
        done += now;
    }
}

/// sum += weight x
pub(super) fn add_scaled<S: Stored>(machine: InstructionSet, weight: f64, x: &[S], sum: &mut [S]) {
    S::run(machine, AddScaled { weight, x, sum });
}

struct AddScaled<'a, S> {
    weight: f64,
    x: &'a [S],
    sum: &'a mut [S],
}

impl<S> Kernel<S> for AddScaled<'_, S> {
    type Output = ();

    #[inline(always)]
    fn run<W: SimdViews<Stored = S>>(mut self, views: W) {
        views.each(self.x.len(), &mut self);
    }
}

impl<S> ForEach<S> for AddScaled<'_, S> {
    #[inline(always)]
    fn visit<W: SimdView<Stored = S>>(&mut self, view: W) -> bool {
        let change = view.load(self.x, 0).scaled(self.weight);
        let sum = view.load(self.sum, 0) + change;
        view.store(self.sum, 0, sum);
        true
    }
}
